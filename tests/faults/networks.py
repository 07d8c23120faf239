"""Rows about networks that `rcdeploy` runs: many components, one that fails again and again, and every way to end."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from ..crowd import crowded
from .checker import Violation
from .laboratory import PATIENCE, until
from .nemesis import deeds
from .rows import Figure, Result, Row, Run
from .surroundings import LEAPS, with_clock

_IDSL = "module RoboCompEcho { interface Echo { idempotent int say(int number); }; };\n"
_CDSL = """import "Echo.idsl";
Component {name} {{ Communications {{ implements Echo; requires Echo; }}; language Python; }};
"""
_HEAD = """from __future__ import annotations

import os
import subprocess
import time

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.number = 0
"""
_NODE = (
    _HEAD
    + """
    def compute(self) -> None:
        if "asking" in os.environ["FAULTS"]:
            begun = time.monotonic()
            self.number = self.echo_proxy.say(self.number)
            with open(os.environ["FAULTS_TO"], "a") as notes:
                notes.write(f"{begun} {time.monotonic() - begun}\\n")

    def Echo_say(self, number: int) -> int:
        return number + 1
"""
)
"""Asks its neighbour, and notes how long that takes."""

_ODD = (
    _HEAD
    + """
        if "parent" in os.environ["FAULTS"]:
            subprocess.Popen(["setsid", "sleep", "1000"], start_new_session=True)

    def compute(self) -> None:
        if "failing" in os.environ["FAULTS"]:
            os._exit(1)

    def Echo_say(self, number: int) -> int:
        return number + 1
"""
)
"""Fails, or has a child in a session of its own."""

_KNOCKS = 200
"""Connections to the control socket that a program keeps: more than it takes."""

_GONE = 5.0
"""Seconds after which nothing of a network may be left."""


class _Network:
    """A folder with a network of so many components, which ask each other, and nobody one that has settings.

    They share so many `processes`, where none asks one of its own; or each has one.
    """

    def __init__(
        self,
        count: int,
        middleware: str,
        more: str = "",
        period: float = 1.0,
        hosts: str = "",
        home: Path | None = None,
        processes: int = 0,
    ) -> None:
        memory = Path("/dev/shm")  # where run-time folders of logins are
        self.folder = Path(tempfile.mkdtemp(prefix="rcf-", dir=memory if memory.is_dir() else None))
        self.run_folder = self.folder / "run"
        self.run_folder.mkdir(mode=0o700)
        self.environment = os.environ | {
            "ROBOCOMP_RUNTIME_DIR": str(self.run_folder),
            "FAULTS_TO": str(self.folder / "calls"),
        }
        for name, worker in (("node", _NODE), ("odd", _ODD)):
            folder = self.folder / name
            folder.mkdir()
            (folder / "Echo.idsl").write_text(_IDSL)
            (folder / f"{name}.cdsl").write_text(_CDSL.format(name=name))
            subprocess.run([_tool("rcgen"), f"{name}.cdsl"], cwd=folder, check=True, capture_output=True)
            (folder / "specificworker.py").write_text(worker)
            (folder / "etc" / "config.toml").write_text(f"[component]\nperiod = {period}\n")
        instances = ""
        for number in range(count):
            asked = min(number ^ 1, count - 1)
            if more and number > 0:  # n0 fails: it has no client
                asked = number + 1 if number < count - 1 else 1
            settings = more if number == 0 else ""
            kind = "node" if number else "odd"
            shared = f"process p{number % processes}; " if processes else "grace 3; "
            instances += f"    Component n{number} : {kind} {{ requires Echo from n{asked}; {shared}{settings}}};\n"
        self.hosts, self.home = hosts, home
        self.model = self.folder / "net.ddsl"
        imports = 'import "node/node.cdsl";\nimport "odd/odd.cdsl";\n'
        self.model.write_text(f"{imports}\nDeployment Net\n{{\n    middleware {middleware};\n{hosts}{instances}}};\n")

    def start(self, *faults: str) -> subprocess.Popen[str]:
        self.said = self.folder / "said"
        with self.said.open("w") as said:
            return subprocess.Popen(
                [_tool("rcdeploy"), str(self.model), *(["--insecure"] if self.hosts else [])],
                cwd=self.folder,
                env=self.environment | {"FAULTS": " ".join(faults)} | ({"HOME": str(self.home)} if self.home else {}),
                stdout=said,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
            )

    def ready(self) -> bool:
        return "components of Net are ready" in self.said.read_text()

    def called(self) -> bool:
        return (self.folder / "calls").exists()

    def processes(self) -> dict[int, str]:
        """All processes that were started from within the network, and what they are."""
        marks = {f"ROBOCOMP_RUNTIME_DIR={path}".encode() for path in (self.run_folder, self.folder / "far" / "run")}
        found = {}
        for each in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if marks & set((each / "environ").read_bytes().split(b"\0")):
                    found[int(each.name)] = (each / "cmdline").read_bytes().replace(b"\0", b" ").decode()[:100]
        return found

    def far(self) -> set[int]:
        """Those on the other host."""
        mark = f"ROBOCOMP_RUNTIME_DIR={self.folder / 'far' / 'run'}".encode()
        found = set()
        for pid in self.processes():
            with contextlib.suppress(OSError):
                if mark in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0"):
                    found.add(pid)
        return found

    def memory(self) -> int:
        """Of all of them, in bytes; what they share is counted once."""
        total = 0
        for pid in self.processes():
            with contextlib.suppress(OSError, IndexError):
                total += int(re.findall(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M)[0])
        return total * 1024

    def __enter__(self) -> _Network:
        return self

    def __exit__(self, *exc: object) -> None:
        for pid in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        until(lambda: not self.processes(), 30.0, "all are dead")
        shutil.rmtree(self.folder, ignore_errors=True)


def _tool(name: str) -> str:
    return str(Path(sys.executable).with_name(name))


_MANY = {"zeromq": 500, "zenoh": 250, "dds": 60}


def _many(run: Run) -> Result:
    return _crowd(run, run.rounds(_MANY[run.transport], 12), 1)


def _together(run: Run) -> Result:
    return _crowd(run, _MANY[run.transport], 10)


def _crowd(run: Run, count: int, to_a_process: int) -> Result:
    processes = count // to_a_process
    with _Network(count, run.transport, processes=0 if to_a_process == 1 else processes) as network:
        begun = time.monotonic()
        deployer = network.start()
        until(lambda: network.ready() or deployer.poll() is not None, 180.0, f"ready:\n{network.said.read_text()}")
        ready = time.monotonic() - begun
        run.tell(f"{count} ready after {ready:.1f} s")
        memory = network.memory()
        asked = time.monotonic()
        status = subprocess.run(
            [_tool("rcdeploy"), "status", "--json", str(network.model)],
            env=network.environment,
            capture_output=True,
            text=True,
        )
        answered = time.monotonic() - asked
        states: Counter[str] = Counter()
        for each in json.loads(status.stdout)["processes"] if status.stdout else []:
            states[each["state"]] += len(each["instances"])
        deployer.send_signal(signal.SIGINT)
        stopping = time.monotonic()
        deployer.wait(60.0)
        stopped = time.monotonic() - stopping
        left = network.processes()
        network_said = network.said.read_text()
    violations = [Violation("nobody left", f"{pid} {what}") for pid, what in left.items()]
    if states != {"ready": count}:
        said = network_said[-300:]
        violations.append(Violation("ready", f"status says {dict(states)}: {status.stderr}; rcdeploy said: …{said}"))
    return Result(
        [
            Figure("components", count),
            Figure("processes", processes),
            Figure("ready", ready, "s", 10, timed=True),
            Figure("stopped", stopped, "s", 5, timed=True),
            Figure("memory (PSS)", memory / 1e9, "GB", 1.5, timed=True),
            Figure("`status` answers", answered, "s", 0.5, timed=True),
        ],
        violations,
    )


def _leapt(run: Run) -> Result:
    """The clock of rcdeploy and its components leaps by an hour, forward and back, while `compute` runs."""
    leaps, period = run.rounds(20, 4), 0.05
    with _Network(2, run.transport, period=period) as network:
        clock = network.folder / "clock"
        clock.write_text("+0")
        network.environment |= with_clock(clock)
        deployer = network.start("asking")
        until(network.called, 60.0, "calls")
        begun = time.monotonic()
        for number in range(leaps):
            time.sleep(0.5)
            clock.write_text(LEAPS[number % len(LEAPS)])
        time.sleep(0.5)
        seconds = time.monotonic() - begun
        code = deployer.poll()
        unmoved = [what for pid, what in network.processes().items() if "libfaketime" not in _mapped(pid)]
        lines = [line.split() for line in (network.folder / "calls").read_text().splitlines()[:-1]]
        at = sorted(float(each[0]) for each in lines if begun < float(each[0]) < begun + seconds)
        deployer.send_signal(signal.SIGTERM)
        deployer.wait(30.0)
        said, left = network.said.read_text(), network.processes()
    violations = [Violation("nobody left", f"{pid} {what}") for pid, what in left.items()]
    violations += [Violation("clock", f"is libfaketime at work in {what}?") for what in unmoved]
    if code is not None or "again" in said:
        violations.append(Violation("runs on", f"rcdeploy: {code}, and said: …{said[-300:]}"))
    return Result(
        [
            Figure("leaps", leaps),
            Figure("`compute` ran", len(at)),
            Figure("calls of `compute` left out", max(0.0, 1 - len(at) / (seconds / period)) * 100, "%", 5, timed=True),
            Figure("longest pause", max(late - early for early, late in itertools.pairwise(at)), "s", 0.5, timed=True),
        ],
        violations,
    )


def _stormy(run: Run) -> Result:
    """One fails at once, is started again and again, and its neighbours ask each other meanwhile."""
    seconds = run.rounds(30, 3)
    measured = {}
    for faults in ("asking", "asking failing"):
        with _Network(
            5, run.transport, "restart always(delay 0.2, max_delay 0.2, intensity 1000, period 60);", 0.01
        ) as network:
            deployer = network.start(*faults.split())
            until(network.called, 60.0, "calls")
            time.sleep(2.0)
            before, since = _cpu(network, deployer.pid), time.monotonic()
            time.sleep(seconds)
            used = (_cpu(network, deployer.pid) - before) / (time.monotonic() - since)
            lines = [line.split() for line in (network.folder / "calls").read_text().splitlines()[:-1]]
            took = sorted(float(each[1]) for each in lines if float(each[0]) > since)
            measured[faults] = took[int(len(took) * 0.99)], used, network.said.read_text().count("n0")
            deployer.send_signal(signal.SIGTERM)
            deployer.wait(30.0)
            left = network.processes()
            run.tell(f"{faults}: p99 {measured[faults][0] * 1000:.2f} ms of {len(took)} calls, {used:.1%} of a core")
    (calm, _, _), (storm, used, _) = measured.values()
    return Result(
        [
            Figure("neighbours' p99 before", calm * 1000, "ms"),
            Figure("neighbours' p99 meanwhile", storm * 1000, "ms", max(1.2 * calm, calm + 0.002) * 1000, timed=True),
            Figure("CPU of rcdeploy", used * 100, "% of a core", 5, timed=True),
        ],
        [Violation("nobody left", f"{pid} {what}") for pid, what in left.items()],
    )


def _controlled(run: Run) -> Result:
    """Another program of this user keeps connecting to the control socket; `status` and `down` work all the same."""
    looks = run.rounds(20, 4)
    took, violations = [], []
    with _Network(4, run.transport) as network:
        deployer = network.start("")
        until(network.ready, 60.0, "the network is ready")
        (control,) = network.run_folder.glob("**/control*")
        with crowded(control, _KNOCKS):
            for number in range(looks):
                begun = time.monotonic()
                done = _told(network, "status", str(network.model))
                took.append(time.monotonic() - begun)
                if done.returncode or "4 ready" not in done.stdout:
                    violations.append(Violation("control", f"status {number}: {done.returncode} {done.stderr[-200:]}"))
            done = _told(network, "down", str(network.model))
            if done.returncode:
                violations.append(Violation("control", f"down: {done.returncode} {done.stderr[-200:]}"))
            with contextlib.suppress(subprocess.TimeoutExpired):
                deployer.wait(30.0)
        violations += [Violation("nobody left", f"{pid} {what}") for pid, what in network.processes().items()]
    return Result([Figure("`status`", looks), Figure("slowest", max(took), "s")], violations)


def _told(network: _Network, *words: str) -> subprocess.CompletedProcess[str]:
    """What rcdeploy answers."""
    return subprocess.run(
        [_tool("rcdeploy"), *words],
        cwd=network.folder,
        env=network.environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )


_DEEDS = ("Ctrl-C", "Ctrl-C twice", "SIGTERM", "SIGHUP", "kill -9")


def _ended(run: Run) -> Result:
    """Every way to end, at any time: while it starts, while it runs, and again while it stops."""
    rounds, patience = run.rounds(200, 5), _GONE if run.full else PATIENCE
    slowest, done = 0.0, Counter[str]()
    violations: list[Violation] = []
    with _Network(4, run.transport) as network:
        for number, deed in enumerate(deeds(run.seed, rounds, _DEEDS, 0.0, 3.0)):
            deployer = network.start("parent")
            end = time.monotonic() + deed.after
            while time.monotonic() < end and not (network.ready() and deed.after > 1.0):
                time.sleep(0.02)
            begun = time.monotonic()
            _do(deployer, deed.what, random.Random(run.seed + number))
            done[deed.what] += 1
            with contextlib.suppress(RuntimeError):
                until(lambda: not network.processes(), patience, "")
            slowest = max(slowest, time.monotonic() - begun)
            for pid, what in network.processes().items():
                text = f"round {number}, {deed.what} after {deed.after:.2f} s: {pid} {what}"
                violations.append(Violation("nobody left", text))
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                deployer.wait(10.0)
            if number % max(1, rounds // 10) == 0:
                run.tell(f"{number} of {rounds}")
    figures = [Figure(what, count) for what, count in sorted(done.items())]
    return Result([*figures, Figure("all gone after", slowest, "s", _GONE, timed=True)], violations)


_FAR_DEEDS = (*_DEEDS, "kill -9 of the agent", "dropped ssh")


def _ended_far(run: Run) -> Result:
    """The same, with a host that is reached by SSH: nothing is left there, either."""
    from tests.deploy.laboratory import Laboratory as Machines
    from tests.deploy.laboratory import SshServer, make_key

    rounds, patience = run.rounds(60, 4), _GONE if run.full else PATIENCE
    slowest, done = 0.0, Counter[str]()
    violations: list[Violation] = []
    with Machines() as machines, tempfile.TemporaryDirectory(prefix="rcf-", dir="/tmp") as home:
        far = machines.host("far")
        own = Path(home) / ".ssh"
        own.mkdir(mode=0o700)
        make_key(own / "id_ed25519")
        python = sys.executable
        block = f'    security open;\n    host far {{ address "{far.address}"; user "root"; python "{python}"; }};\n'
        with _Network(4, run.transport, "host far;", hosts=block, home=Path(home)) as network:
            environment = {"FAULTS": "parent", "FAULTS_TO": str(network.folder / "calls")}
            server = SshServer(far, network.folder / "far", own / "id_ed25519", environment)
            (own / "known_hosts").write_text(f"{far.address} {server.public_key}\n")
            for number, deed in enumerate(deeds(run.seed, rounds, _FAR_DEEDS, 0.5, 6.0)):
                deployer = network.start("parent")
                end = time.monotonic() + deed.after
                while time.monotonic() < end and not network.ready():
                    time.sleep(0.02)
                if deed.what not in _DEEDS:
                    until(lambda: len(network.far()) > 3, 30.0, "something runs there")
                begun = time.monotonic()
                if deed.what in _DEEDS:
                    _do(deployer, deed.what, random.Random(run.seed + number))
                    hit = set(network.processes())
                else:
                    hit = network.far()
                    _cut_off(network, far.pids(), deed.what)
                done[deed.what] += 1
                with contextlib.suppress(RuntimeError):
                    until(lambda hit=hit: not hit & set(network.processes()), patience, "")
                slowest = max(slowest, time.monotonic() - begun)
                left = {pid: what for pid, what in network.processes().items() if pid in hit}
                deployer.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    deployer.wait(20.0)
                with contextlib.suppress(RuntimeError):
                    until(lambda: not network.processes(), patience, "")
                for pid, what in (left | network.processes()).items():
                    text = f"round {number}, {deed.what} after {deed.after:.2f} s: {pid} {what}"
                    violations.append(Violation("nobody left", text))
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)
                if number % max(1, rounds // 10) == 0:
                    run.tell(f"{number} of {rounds}")
    figures = [Figure(what, count) for what, count in sorted(done.items())]
    return Result([*figures, Figure("all gone after", slowest, "s", _GONE, timed=True)], violations)


def _cut_off(network: _Network, there: list[int], what: str) -> None:
    """Kill the agent on a host, or what carries the connection to it."""
    for pid in there:
        with contextlib.suppress(OSError):
            words = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
            agent = "robocomp_py.deploy.agent" in words
            session = words.startswith("sshd") and "-D" not in words
            if (agent and what == "kill -9 of the agent") or (session and what == "dropped ssh"):
                os.kill(pid, signal.SIGKILL)


def _do(deployer: subprocess.Popen[str], what: str, chance: random.Random) -> None:
    number = {"SIGTERM": signal.SIGTERM, "SIGHUP": signal.SIGHUP, "kill -9": signal.SIGKILL}.get(what, signal.SIGINT)
    deployer.send_signal(number)
    if what == "Ctrl-C twice":
        time.sleep(chance.uniform(0.0, 0.3))
        with contextlib.suppress(ProcessLookupError):
            deployer.send_signal(signal.SIGINT)


def _mapped(pid: int) -> str:
    """The files that a process has in its memory."""
    return Path(f"/proc/{pid}/maps").read_text()


def _cpu(network: _Network, deployer: int) -> float:
    """Seconds that rcdeploy has computed, with what starts and keeps processes for it."""
    its_own = [pid for pid, what in network.processes().items() if "robocomp_py.deploy.launcher" in what]
    used = 0.0
    for pid in (deployer, *its_own):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        used += sum(map(int, fields[11:15] if pid != deployer else fields[11:13])) / os.sysconf("SC_CLK_TCK")
    return used


ROWS = [
    Row(
        "storm",
        "restart storm: a component fails at each start",
        "neighbours' p99 + ≤ 20 % (or 2 ms), rcdeploy ≤ 5 % CPU",
        ("zeromq",),
        70,
        _stormy,
    ),
    Row(
        "timers",
        "clock jump ± 1 h of rcdeploy and its components",
        "no timer misfires: `compute` keeps its period; no component is taken for stuck or restarted",
        ("zeromq",),
        14,
        _leapt,
        root=True,
    ),
    Row(
        "control",
        "a program keeps connecting to the control socket",
        "`rcdeploy status` and `down` work",
        ("zeromq",),
        60,
        _controlled,
    ),
    Row(
        "end",
        "Ctrl-C once and twice, SIGTERM, SIGHUP, kill -9 of rcdeploy; 200 random rounds",
        "0 processes after 5 s, `setsid` grandchildren included where cgroups allow",
        ("zeromq",),
        310,
        _ended,
    ),
    Row(
        "end-far",
        "the same with a second host, and kill -9 of its agent, dropped ssh; 60 random rounds",
        "0 processes after 5 s, there too",
        ("zeromq",),
        215,
        _ended_far,
        root=True,
    ),
    Row(
        "many",
        "500 components on one host of 2 cores over zeromq (zenoh 250, dds 60), each a process",
        "ready ≤ 10 s, stopped ≤ 5 s, ≤ 1.5 GB (PSS), `status` answers in 0.5 s",
        tuple(_MANY),
        10,
        _many,
    ),
    Row(
        "together",
        "the same, ten to a process (`process NAME;`)",
        "as for many",
        tuple(_MANY),
        8,
        _together,
        reduced=False,
    ),
]
