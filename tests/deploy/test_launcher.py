"""Processes of this machine: how they start, what they report, and that none is left after any kill."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.deploy.agents import Abandoned
from robocomp_py.deploy.launcher import cgroups, forking, forkserver, leftovers, local, traces
from robocomp_py.deploy.launcher.birth import PADDING, Birth, adopt_orphans
from robocomp_py.deploy.launcher.forking import forkable
from robocomp_py.deploy.launcher.local import Launcher
from robocomp_py.deploy.place import AlreadyRuns, Place
from robocomp_py.deploy.plan import Process
from robocomp_py.errors import DeploymentError
from robocomp_py.testing.patience import SOON, wait_until

from ..leftovers import killed_on_failure
from .told import Told

FOREVER = "import signal; signal.pause()"
NOTIFY = """
import os, signal, socket, subprocess, sys, time
def notify(*lines):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.sendto("\\n".join(lines).encode(), os.environ["NOTIFY_SOCKET"])
"""
DEAF = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
STRAY = """
import subprocess, sys
code = "print('here', flush=True); import signal; signal.pause()"
child = subprocess.Popen([sys.executable, "-ISc", code], start_new_session=True, stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
"""
"""Starts a child that leaves its session."""


class Heard(Told):
    """Takes a repeated line of output once."""

    def output(self, name: str, line: str) -> None:
        if ("output", name, line) not in self.told:
            super().output(name, line)

    def lost(self, host: str, why: str) -> None:
        raise AssertionError("this is the only host")

    def back(self, host: str) -> None:
        raise AssertionError("this is the only host")

    def lines(self, name: str = "it") -> list[str]:
        return [told[2] for told in self.told if told[:2] == ("output", name)]

    async def until(self, kind: str, name: str = "it") -> tuple[Any, ...]:
        """The first of a kind, as soon as it is told. A process may have to start first."""
        end = time.monotonic() + 3 * SOON
        while time.monotonic() < end:
            for told in self.told:
                if told[:2] == (kind, name):
                    return told
            await asyncio.sleep(0.002)
        raise AssertionError(f"not told: {kind} of {name}; but {self.told}")


def program(text: str, name: str = "it", *, notifies: bool = True, env: Mapping[str, str] | None = None) -> Process:
    return Process(name, name, (sys.executable, "-ISc", text), Path("/"), env or {}, notifies=notifies)


def launched(folder: Path, story: Callable[[Launcher, Heard], Awaitable[object]]) -> Heard:
    """What was told until a story was over, and everything closed."""

    async def run() -> Heard:
        heard = Heard()
        launcher = Launcher(heard, "net", place=Place("net", folder))
        await launcher.open()
        try:
            await story(launcher, heard)
        finally:
            await launcher.close()
        return heard

    return asyncio.run(run())


def ended(text: str, folder: Path) -> Heard:
    """What was told of a program until it had ended."""

    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(text))
        await heard.until("exited")

    return launched(folder, story)


def is_gone(pid: int) -> bool:
    trace = traces.look(pid)
    return trace is None or trace.state == "Z"


@pytest.fixture(params=["groups", "no groups"])
def with_and_without_groups(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Control groups end every started process; without them, session, descent and mark are used."""
    if request.param == "no groups":
        monkeypatch.setattr(cgroups, "make", lambda name: None)


# What is heard.


def test_what_it_prints_comes_before_its_end_line_by_line(tmp_path: Path) -> None:
    heard = ended(
        "print('one'); print('x' * 5000); import sys; print('last', end='', file=sys.stderr); sys.exit(3)", tmp_path
    )
    assert heard.told == [
        ("output", "it", "one"),
        ("output", "it", "x" * 4096),
        ("output", "it", "x" * 904),
        ("output", "it", "last"),
        ("exited", "it", 3),
    ]


def test_a_process_that_sends_no_notifications_is_ready_when_it_runs(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program("", notifies=False))
        await heard.until("exited")

    assert launched(tmp_path, story).told == [("ready", "it"), ("exited", "it", 0)]


def test_a_process_is_ready_once_and_may_report_any_status(tmp_path: Path) -> None:
    text = "notify('READY=1', 'STATUS=a\\tb'); notify('RELOADING=1'); notify('READY=1'); notify('X_ROBOCOMP_ENDED=arm')"
    heard = ended(NOTIFY + text, tmp_path)
    assert heard.told == [
        ("status", "it", "a b"),
        ("ready", "it"),
        ("left", "it", "arm"),
        ("exited", "it", 0),
    ]


def test_no_other_process_may_report_it_ready(tmp_path: Path) -> None:
    child = "import os, socket; socket.socket(1, 2).sendto(b'READY=1', os.environ['NOTIFY_SOCKET'])"
    heard = ended(f"{NOTIFY}subprocess.run([sys.executable, '-ISc', {child!r}])", tmp_path)
    assert ("ready", "it") not in heard.told
    assert "was ignored" in heard.lines()[0]


def test_unless_it_says_that_they_may(tmp_path: Path) -> None:
    child = "import os, socket; socket.socket(1, 2).sendto(b'READY=1', os.environ['NOTIFY_SOCKET'])"
    wait = "signal.pause()"

    async def story(launcher: Launcher, heard: Heard) -> None:
        code = f"{child}; import time; time.sleep(600)"
        text = f"notify('NOTIFYACCESS=all'); subprocess.Popen([sys.executable, '-ISc', {code!r}])"
        await launcher.start(program(f"{NOTIFY}{text}\n{wait}"))
        await heard.until("ready")

    launched(tmp_path, story)


def test_another_process_of_it_may_be_the_one_that_counts(tmp_path: Path, with_and_without_groups: None) -> None:
    text = (
        "pid = os.fork()\nif pid: notify(f'MAINPID={pid}'); os._exit(0)\n"
        "while os.getppid() == os.getsid(0): time.sleep(0.001)\n"
        "notify('READY=1'); time.sleep(0.01); os._exit(7)"
    )
    heard = ended(NOTIFY + text, tmp_path)
    assert [told for told in heard.told if told[0] != "output"] == [("ready", "it"), ("exited", "it", 7)]


def test_a_main_process_that_has_already_ended_counts(tmp_path: Path, with_and_without_groups: None) -> None:
    text = (
        "pid = os.fork()\nif pid: notify(f'MAINPID={pid}'); os._exit(0)\n"
        "while os.getppid() == os.getsid(0): time.sleep(0.001)\n"
        "notify('READY=1'); os._exit(7)"
    )

    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(NOTIFY + text))
        first = launcher._running["it"].pid
        wait_until(lambda: {each.state for each in traces.all_processes() if each.session == first} == {"Z"})
        await heard.until("exited")

    told = launched(tmp_path, story).told
    assert [each for each in told if each[0] != "output"] == [("ready", "it"), ("exited", "it", 7)]


def test_what_it_uses_and_how_busy_it_is_is_known(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(f"{NOTIFY}notify('X_ROBOCOMP_CALLS=12.5 3', 'READY=1')\n{FOREVER}"))
        await heard.until("ready")
        (usage,) = launcher.usage().values()
        assert (usage.calls_per_s, usage.worst_ms) == (12.5, 3.0)
        assert usage.memory > 1_000_000

    launched(tmp_path, story)


def test_a_process_that_floods_its_log_delays_no_other(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program("import os\nwhile True: os.write(1, b'noise\\n' * 10000)", "flood"))
        await heard.until("output", "flood")
        await launcher.start(program(f"{NOTIFY}notify('READY=1'); print('hello', flush=True)\n{FOREVER}"))
        await heard.until("output")
        await heard.until("ready")
        launcher.stop("flood")
        await heard.until("exited", "flood")

    launched(tmp_path, story)


# How it starts.


def test_without_descriptors_a_start_is_refused_and_others_go_on(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(FOREVER, "before"))
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        highest = max(int(each) for each in os.listdir("/proc/self/fd"))
        taken: list[int] = []
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 20, hard))
            with contextlib.suppress(OSError):
                while True:
                    taken.append(os.open(os.devnull, os.O_RDONLY))
            for _ in range(12):
                with pytest.raises(DeploymentError, match=r"late cannot be started: .*ulimit -n"):
                    await launcher.start(program(FOREVER, "late"))
                os.close(taken.pop())
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for each in taken:
                os.close(each)
        await launcher.start(program(FOREVER, "late"))

    launched(tmp_path, story)


def test_a_missing_program_is_reported(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        for process in (
            Process("it", "it", ("/no/such/program",), Path("/")),
            Process("it", "it", (sys.executable,), Path("/no/such/folder")),
        ):
            with pytest.raises(DeploymentError, match=r"it: /no/such/(program|folder) cannot be started: No such file"):
                await launcher.start(process)
        await launcher.start(program("print('after all')"))
        await heard.until("exited")

    assert launched(tmp_path, story).lines() == ["after all"]


def test_components_are_forked_and_whatever_else_there_is_is_not() -> None:
    run = (sys.executable, "-m", "robocomp_py.cli.rc", "run", "/camera")
    assert forkable(Process("it", "it", run, Path("/")))
    assert forkable(Process("it", "it", run, Path("/"), {"ROBOT": "1"}))
    assert not forkable(Process("it", "it", run, Path("/"), {"PYTHONHASHSEED": "1"}))
    assert not forkable(Process("it", "it", ("/other/bin/python", *run[1:]), Path("/")))
    assert not forkable(Process("it", "it", (*run[:3], "lint", "/camera"), Path("/")))


def test_a_process_with_threads_does_not_fork() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    over = threading.Event()
    other = threading.Thread(target=over.wait)
    other.start()
    with ours, theirs:
        ours.send(json.dumps({"id": 1}).encode())
        ours.shutdown(socket.SHUT_WR)
        try:
            assert forkserver.serve(theirs, -1) is None
        finally:
            over.set()
            other.join()
        assert json.loads(ours.recv(4096)) == {"id": 1, "error": "the fork server has threads"}


COMPONENT = """
import os, random, signal, socket, sys, threading
from typing import Any
import numpy
from robocomp_py.contract.component import Component
from robocomp_py.runtime.worker import Worker

class SpecificWorker(Worker[Any]):
    component, middleware = Component("probe"), "inproc"

    def initialize(self) -> None:
        pass

    def compute(self) -> None:
        self.log.info("here: %s", {
            "main": sys.modules["__main__"].__name__, "argv": sys.argv[1:], "path": sys.path[0] == os.getcwd(),
            "session": os.getsid(0) == os.getpid(), "threads": threading.main_thread() is threading.current_thread(),
            "interrupt": signal.getsignal(signal.SIGQUIT) == signal.SIG_DFL, "cwd": os.getcwd(),
            "env": os.environ.get("ROBOT"), "stdin": os.read(0, 1), "encoding": sys.stdout.encoding,
        })
        print("random", random.random(), numpy.random.random(), flush=True)
        self.stop()
"""


@pytest.fixture
def component(tmp_path: Path) -> Path:
    folder = tmp_path / "probe"
    (folder / "generic").mkdir(parents=True)
    for file in ("__init__.py", "generic/__init__.py", "generic/genericworker.py"):
        (folder / file).touch()
    (folder / "specificworker.py").write_text(COMPONENT)
    return folder


def probed(component: Path, folder: Path, *, twice: bool = False, **env: str) -> Heard:
    command = (sys.executable, "-m", "robocomp_py.cli.rc", "run", str(component), "--name", "it")

    async def story(launcher: Launcher, heard: Heard) -> None:
        for name in ("it", "other")[: 1 + twice]:
            await launcher.start(Process(name, name, command, component, {"ROBOT": "1", **env}))
            await heard.until("exited", name)

    return launched(folder, story)


def here(heard: Heard) -> str:
    (text,) = [json.loads(line[1:])["text"] for line in heard.lines() if "here:" in line]
    return str(text)


def test_a_forked_component_is_as_one_that_was_executed(component: Path, tmp_path: Path, runtime_folder: Path) -> None:
    forked = probed(component, tmp_path / "run", twice=True)
    executed = probed(component, tmp_path / "run", PYTHONHASHSEED="1")
    assert here(forked) == here(executed) != ""
    assert forked.told[-1] == ("exited", "other", 0)
    drawn = [line for name in ("it", "other") for line in forked.lines(name) if line.startswith("random")]
    assert len({number for line in drawn for number in line.split()[1:]}) == 4


def test_many_may_be_asked_for_at_once(component: Path, tmp_path: Path, runtime_folder: Path) -> None:
    command = (sys.executable, "-m", "robocomp_py.cli.rc", "run", str(component))
    names = [f"it{number}" for number in range(12)]

    async def story(launcher: Launcher, heard: Heard) -> None:
        await asyncio.gather(
            *(launcher.start(Process(name, name, (*command, "--name", name), component)) for name in names)
        )
        for name in names:
            assert (await heard.until("exited", name))[2] == 0

        assert launcher._fork_server
        assert not launcher._fork_server.ended

    heard = launched(tmp_path / "run", story)
    assert len({line for name in names for line in heard.lines(name) if line.startswith("random")}) == len(names)


@pytest.mark.parametrize("how", ["it ends", "it is given up"])
def test_what_was_answered_counts_also_when_the_process_that_forks_is_gone(
    monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """Whatever is not known is started again."""

    class Forking:
        pid, returncode = 0, 0

        def __init__(self, command: tuple[str, ...], pass_fds: tuple[int, ...], **_: object) -> None:
            self.channel = socket.socket(fileno=os.dup(pass_fds[0]))

        def kill(self) -> None: ...

    async def asked() -> list[object]:
        asking = forking.ForkServer([], 0, {})
        channel: socket.socket = asking._running.channel  # type: ignore[attr-defined]
        wanted = [program("", name) for name in ("first", "second", "third")]
        starts = [asyncio.create_task(asking.start(each, {}, 1, Birth(os.getpid(), -1))) for each in wanted]
        await asyncio.sleep(0)  # no time passes: they go as far as they can without an answer
        for pid in (101, 102):
            number = json.loads(channel.recv(65536))["id"]
            channel.send(json.dumps({"id": number, "pid": pid}).encode())
        if how == "it ends":
            channel.close()  # with an unread request, which the other end learns first
        else:
            asking.close()
            channel.close()
        return await asyncio.gather(*starts, return_exceptions=True)

    monkeypatch.setattr(forking.subprocess, "Popen", Forking)
    first, second, third = asyncio.run(asked())
    assert (first, second) == (101, 102)
    assert isinstance(third, forking.Unavailable)


def test_a_start_that_is_cancelled_while_its_answer_arrives_ends_and_leaves_no_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Forking:
        pid, returncode = 0, 0

        def __init__(self, command: tuple[str, ...], pass_fds: tuple[int, ...], **_: object) -> None:
            self.channel = socket.socket(fileno=os.dup(pass_fds[0]))

        def kill(self) -> None: ...

    async def cancelled(pid: int) -> None:
        asking = forking.ForkServer([], 0, {})
        channel: socket.socket = asking._running.channel  # type: ignore[attr-defined]
        start = asyncio.create_task(asking.start(program("", "one"), {}, 1, Birth(os.getpid(), -1)))
        await asyncio.sleep(0)
        channel.send(json.dumps({"id": json.loads(channel.recv(65536))["id"], "pid": pid}).encode())
        asking._answered()
        start.cancel()
        await asyncio.wait((start,))
        asking.close()
        channel.close()
        assert start.cancelled()

    with subprocess.Popen([sys.executable, "-c", FOREVER]) as born:
        monkeypatch.setattr(forking.subprocess, "Popen", Forking)
        try:
            asyncio.run(cancelled(born.pid))
            assert born.wait(SOON) == -signal.SIGKILL
        finally:
            born.kill()


def test_a_process_that_cannot_be_reported_is_ended(request: pytest.FixtureRequest) -> None:
    adopt_orphans(True)  # or it would end for want of a parent
    request.addfinalizer(lambda: adopt_orphans(False))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    lifeline, held = os.pipe()
    out, into = os.pipe()
    numbers = (theirs.fileno(), lifeline)
    command = (
        sys.executable,
        "-P",
        "-m",
        "robocomp_py.deploy.launcher.forkserver",
        *map(str, numbers),
        "inproc",
        PADDING,
    )
    with killed_on_failure(command, pass_fds=numbers) as forks:
        wanted = {"id": 1, "name": "it", "arguments": ["--help"], "cwd": "/", "env": {}, "parent": os.getpid()}
        socket.send_fds(ours, [json.dumps({**wanted, "cgroup": "", "files": None}).encode()], [into])
        for each in (ours, theirs):
            each.close()  # it is still importing, and will find the question
        os.close(into)
        assert forks.wait(SOON) == 0
        with open(out, "rb") as printed:
            assert printed.read() == b""  # no process is left that could print
    for descriptor in (lifeline, held):
        os.close(descriptor)


def test_a_forked_component_lets_equal_pages_be_merged(component: Path, tmp_path: Path, runtime_folder: Path) -> None:
    asked = "from ctypes import PyDLL\nprint('merged', PyDLL(None).prctl(68, 0, 0, 0, 0))\n"
    allowing = asked.replace("print", "PyDLL(None).prctl(67, 1, 0, 0, 0); print")
    possible = subprocess.run((sys.executable, "-ISc", allowing), stdout=subprocess.PIPE, text=True, check=True).stdout
    (component / "specificworker.py").write_text(asked + COMPONENT)
    assert possible.strip() in probed(component, tmp_path / "run").lines()


ENDING = """
import atexit, concurrent.futures, sys, threading, time, weakref
from typing import Any
from robocomp_py.contract.component import Component
from robocomp_py.runtime.worker import Worker

class Owner:
    def __init__(self, name): self.name = name
    def __del__(self): notes.write(f"{self.name} was finalized\\n")

notes = open("notes", "a")  # written out when it is closed, which is left to Python
owned, pool = Owner("what a module has"), concurrent.futures.ThreadPoolExecutor()
atexit.register(notes.write, "what was registered was called\\n")

class SpecificWorker(Worker[Any]):
    component, middleware = Component("probe"), "inproc"

    def initialize(self) -> None:
        self.owned, self.cycle = Owner("what a worker has"), self
        self.left_open, concurrent.opened = open("worker", "a"), open("shared", "a")
        weakref.finalize(self, notes.write, "the worker was finalized\\n")

    def compute(self) -> None:
        threading.Thread(target=lambda: (time.sleep(0.1), notes.write("a thread was waited for\\n"))).start()
        pool.submit(time.sleep, 0)
        print("last words")
        for file in (self.left_open, concurrent.opened):
            file.write("words")
        self.stop()
"""


def test_a_forked_component_ends_as_one_that_was_executed(
    component: Path, tmp_path: Path, runtime_folder: Path
) -> None:
    (component / "specificworker.py").write_text(ENDING)
    notes = component / "notes"
    executed = probed(component, tmp_path / "run", PYTHONHASHSEED="1")
    said = set(notes.read_text().splitlines())
    assert len(said) == 4
    notes.unlink()
    forked = probed(component, tmp_path / "run")
    assert [(component / name).read_text() for name in ("worker", "shared")] == ["wordswords"] * 2
    assert set(notes.read_text().splitlines()) >= said
    assert forked.told[-1] == executed.told[-1] == ("exited", "it", 0)
    assert "last words" in forked.lines()


def test_a_forked_component_writes_its_files_also_if_something_shared_knows_its_modules(
    component: Path, tmp_path: Path, runtime_folder: Path
) -> None:
    known = 'sys.modules["robocomp_py.runtime.worker"].known = lambda: notes\n'
    (component / "specificworker.py").write_text(ENDING.replace("atexit.register", f"{known}atexit.register"))
    probed(component, tmp_path / "run")
    assert len((component / "notes").read_text().splitlines()) >= 4


def test_without_the_process_that_forks_components_start_all_the_same(
    component: Path, tmp_path: Path, runtime_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    command = (sys.executable, "-m", "robocomp_py.cli.rc", "run", str(component), "--name", "it")

    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(Process("first", "it", command, component))
        assert launcher._fork_server
        os.kill(launcher._fork_server.pid, signal.SIGKILL)
        assert (await heard.until("exited", "first"))[2] == 0
        await launcher.start(Process("it", "it", command, component))
        assert (await heard.until("exited"))[2] == 0

    launched(tmp_path / "run", story)
    assert sum("without the fork server" in record.message for record in caplog.records) == 1


# How it ends.


async def being_started(launcher: Launcher, process: Process) -> asyncio.Task[None]:
    """One that was asked for of the process that forks, which takes long to be ready."""
    coming = asyncio.create_task(launcher.start(process))
    await asyncio.sleep(0)  # no time passes: the task goes as far as it can without an answer
    return coming


STAYS = "import os, time\nwhile 'STAY' in os.environ: time.sleep(0.1)\n"
"""In front of a component's code: it does not end by itself, if asked to."""


def staying(component: Path) -> Process:
    """One that has to be ended, started from a component of which others end by themselves."""
    worker = component / "specificworker.py"
    worker.write_text(STAYS + worker.read_text())
    command = (sys.executable, "-m", "robocomp_py.cli.rc", "run", str(component), "--name", "it")
    return Process("it", "it", command, component, {"STAY": "1"})


@pytest.mark.parametrize("deed", ["stop", "kill"])
def test_a_process_whose_start_was_abandoned_is_ended_and_not_waited_for(
    component: Path, tmp_path: Path, runtime_folder: Path, with_and_without_groups: None, deed: str
) -> None:
    stays = staying(component)

    async def story(launcher: Launcher, heard: Heard) -> None:
        coming = await being_started(launcher, stays)
        getattr(launcher, deed)("it")
        with pytest.raises(Abandoned):
            await coming
        assert heard.told == []
        await launcher.start(replace(stays, env={}))  # what was asked for first has come by then
        assert (await heard.until("exited"))[2] == 0
        assert launcher._fork_server
        forking = launcher._fork_server.pid
        wait_until(lambda: [each.pid for each in traces.marked(launcher._launch)] == [forking])

    heard = launched(tmp_path / "run", story)
    assert [each[0] for each in heard.told].count("exited") == 1


def test_a_process_being_started_is_abandoned_when_its_launcher_closes(
    component: Path, tmp_path: Path, runtime_folder: Path
) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        coming = await being_started(launcher, staying(component))
        await launcher.close()
        with pytest.raises(Abandoned):
            await coming
        assert traces.marked(launcher._launch) == []

    assert launched(tmp_path / "run", story).told == []


def test_a_process_that_starts_although_it_was_abandoned_is_ended(
    component: Path, tmp_path: Path, runtime_folder: Path
) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        coming = await being_started(launcher, staying(component))
        assert launcher._fork_server
        ((_, answer),) = launcher._fork_server._asked.values()
        answer.add_done_callback(lambda _: launcher.stop("it"))  # too late for it to be left out
        os.kill(launcher._fork_server.pid, signal.SIGKILL)
        await coming
        assert (await heard.until("exited"))[2] in (-signal.SIGTERM, 128 + signal.SIGTERM)

    launched(tmp_path / "run", story)


def test_a_suspended_process_is_asked_to_end(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(f"{NOTIFY}notify('READY=1'); os.kill(os.getpid(), signal.SIGSTOP)\n{FOREVER}"))
        await heard.until("ready")
        launcher.stop("it")
        assert (await heard.until("exited"))[2] == -signal.SIGTERM

    launched(tmp_path, story)


def test_a_process_without_a_group_of_its_own_yet_is_asked_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killpg(pid: int, number: int) -> None:
        raise ProcessLookupError

    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(f"{NOTIFY}notify('READY=1')\n{FOREVER}"))
        await heard.until("ready")
        with monkeypatch.context() as early:
            early.setattr(os, "killpg", killpg)
            launcher.stop("it")
        assert (await heard.until("exited"))[2] == -signal.SIGTERM

    launched(tmp_path, story)


def test_what_it_started_ends_with_it(tmp_path: Path, with_and_without_groups: None) -> None:
    heard = ended(STRAY, tmp_path)
    assert is_gone(int(heard.lines()[0]))
    assert heard.told[-1] == ("exited", "it", 0)


def test_what_is_killed_ends_with_all_that_it_started(tmp_path: Path, with_and_without_groups: None) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(f"{DEAF}{STRAY}{FOREVER}"))
        await heard.until("output")
        launcher.kill("it")
        assert (await heard.until("exited"))[2] == -signal.SIGKILL
        assert is_gone(int(heard.lines()[0]))

    launched(tmp_path, story)


def test_closing_leaves_nothing(tmp_path: Path, with_and_without_groups: None) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(f"{DEAF}{STRAY}{FOREVER}"))
        await heard.until("output")

    heard = launched(tmp_path, story)
    assert is_gone(int(heard.lines()[0]))
    assert not (tmp_path / "net").exists()


def test_a_name_may_be_used_again_after_its_end_and_not_before(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        await launcher.start(program(FOREVER))
        with pytest.raises(DeploymentError, match="it is already running"):
            await launcher.start(program(FOREVER))
        launcher.kill("it")
        await heard.until("exited")
        await launcher.start(program("print('again')"))
        await heard.until("output")

    launched(tmp_path, story)


# The watchdog.


def test_a_process_that_stops_feeding_its_watchdog_is_reported_aborted_and_ended(tmp_path: Path) -> None:
    text = "import faulthandler; faulthandler.enable(); notify('READY=1', 'WATCHDOG_USEC=50000', 'WATCHDOG=1')"
    heard = ended(f"{NOTIFY}{text}\n{FOREVER}", tmp_path)
    assert [told for told in heard.told if told[0] != "output"] == [
        ("ready", "it"),
        ("hung", "it"),
        ("exited", "it", -signal.SIGABRT),
    ]
    assert any("most recent call first" in line for line in heard.lines())


def test_a_hung_process_that_ignores_its_abortion_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local, "TRACES", 0.01)
    text = "signal.signal(signal.SIGABRT, signal.SIG_IGN); notify('WATCHDOG=trigger')"
    assert ended(f"{NOTIFY}{text}\n{FOREVER}", tmp_path).told == [("hung", "it"), ("exited", "it", -signal.SIGKILL)]


def test_a_process_that_never_fed_the_watchdog_or_is_stopping_is_not_watched(tmp_path: Path) -> None:
    text = "notify('WATCHDOG_USEC=1000'); {0}time.sleep(0.1); notify('READY=1')\n"
    feeds = "notify('WATCHDOG=1', 'STOPPING=1'); "
    for each in (text.format(""), text.format(feeds)):
        assert ended(NOTIFY + each, tmp_path).told == [("ready", "it"), ("exited", "it", 0)]


# One at a time, and no process left.


def test_a_network_that_runs_is_not_run_again(tmp_path: Path) -> None:
    async def story(launcher: Launcher, heard: Heard) -> None:
        second = Launcher(Heard(), "net", place=Place("net", tmp_path))
        with pytest.raises(AlreadyRuns, match=rf"net is already running: process {os.getpid()}.*rcdeploy down"):
            await second.open()
        await launcher.start(program("print('undisturbed')"))
        await heard.until("exited")

    launched(tmp_path, story)


CONTROLLER = """
import asyncio, sys
from pathlib import Path
from tests.deploy.test_launcher import Heard, Launcher, Place, program, cgroups, DEAF, FOREVER, STRAY

class Telling(Heard):
    def output(self, name, line):
        print(name, line, flush=True)

async def main():
    if sys.argv[2] == "no groups":
        cgroups.make = lambda name: None
    launcher = Launcher(Telling(), "net", place=Place("net", Path(sys.argv[1])))
    await launcher.open()
    print("keeper", launcher._keeper.pid, flush=True)
    deaf = DEAF if sys.argv[3] == "deaf" else ""
    await launcher.start(program(f"{deaf}import os; print(os.getpid(), flush=True); {FOREVER}", "one"))
    await launcher.start(program(f"{STRAY}{FOREVER}", "stray"))
    await asyncio.sleep(600)

asyncio.run(main())
"""


class Controller:
    """A launcher in a process of its own, with one process, and one that has gone astray from another."""

    def __init__(self, folder: Path, groups: str = "no groups", deaf: str = "") -> None:
        self.running = subprocess.Popen(
            [sys.executable, "-c", CONTROLLER, str(folder), groups, deaf], stdout=subprocess.PIPE, text=True
        )
        assert self.running.stdout
        told = dict(self.running.stdout.readline().split() for _ in range(3))
        self.keeper, self.one, self.stray = (int(told[name]) for name in ("keeper", "one", "stray"))

    def kill(self) -> None:
        self.running.kill()
        self.running.wait()
        assert self.running.stdout
        self.running.stdout.close()


@pytest.fixture
def controlled(tmp_path: Path) -> Iterator[Callable[..., Controller]]:
    with contextlib.ExitStack() as running:

        def start(*arguments: str) -> Controller:
            controller = Controller(tmp_path, *arguments)
            running.callback(controller.kill)
            return controller

        yield start


@pytest.mark.parametrize("groups", ["groups", "no groups"])
def test_when_the_launcher_is_killed_its_keeper_ends_everything(
    controlled: Callable[..., Controller], tmp_path: Path, groups: str
) -> None:
    controller = controlled(groups)
    controller.kill()
    for pid in (controller.one, controller.stray, controller.keeper):
        wait_until(lambda pid=pid: is_gone(pid))  # type: ignore[misc]
    assert not (tmp_path / "net").exists()


def test_a_keeper_that_is_killed_is_replaced(controlled: Callable[..., Controller]) -> None:
    controller = controlled()
    os.kill(controller.keeper, signal.SIGKILL)
    wait_until(lambda: is_gone(controller.keeper))
    program = "robocomp_py.deploy.launcher.keeper"
    wait_until(
        lambda: [e for e in traces.all_processes() if e.parent == controller.running.pid and program in _command(e)]
    )
    controller.kill()
    wait_until(lambda: is_gone(controller.one) and is_gone(controller.stray))


def test_when_both_are_killed_the_kernel_ends_processes_and_the_next_launch_the_rest(
    controlled: Callable[..., Controller], tmp_path: Path
) -> None:
    controller = controlled("no groups", "deaf")
    os.kill(controller.running.pid, signal.SIGSTOP)  # so that it does not notice
    os.kill(controller.keeper, signal.SIGKILL)
    controller.kill()
    wait_until(lambda: is_gone(controller.one))
    assert not is_gone(controller.stray)

    async def story(launcher: Launcher, heard: Heard) -> None:
        assert is_gone(controller.stray)

    launched(tmp_path, story)


def test_the_sockets_of_a_killed_launch_do_not_stop_the_next_one(tmp_path: Path) -> None:
    left = Place("net", tmp_path).notify
    left.mkdir(parents=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as first:
        first.bind(str(left / "1"))
    assert ended("print('started')", tmp_path).lines() == ["started"]


def test_a_stranger_with_the_id_of_a_leftover_is_left_alone(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-ISc", FOREVER], start_new_session=True) as stranger:
        try:
            trace = traces.look(stranger.pid)
            assert trace
            left = leftovers.Leftovers("mark", traces.boot(), "", {stranger.pid: trace.started - 1})
            assert left.end(grace=0.0) == 0
            left.processes[stranger.pid] = trace.started
            assert left.end(grace=SOON) == 1
            assert stranger.wait(SOON) == -signal.SIGTERM
        finally:
            stranger.kill()


def test_before_the_machine_was_started_anew_ids_meant_others(tmp_path: Path) -> None:
    trace = traces.look(os.getpid())
    assert trace
    assert leftovers.Leftovers("mark", "another start", "", {os.getpid(): trace.started}).end() == 0


def _command(trace: traces.Trace) -> str:
    try:
        return Path(f"/proc/{trace.pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""
