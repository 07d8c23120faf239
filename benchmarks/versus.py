"""Measures the round trip through other frameworks: an array of octets to another process, and back.

Each framework uses its fastest way (see the modules in `peers`), has two processes, and takes its turn in every round.
A framework that is missing or fails is reported, and the others are measured. Services are called; frameworks with
topics only send the array on one topic and back on another.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .goals import Finding, failed
from .parties import PATIENCE
from .peers.driver import MEETING
from .process import ROOT, folder, running
from .query import Tell
from .rounds import MOST_CALLS, Effort, Times, by_turns, ratio, times
from .tables import Table, octets, us

SYSTEM_PYTHON = "/usr/bin/python3"
"""That of Debian, whose packages no other one finds."""

Command = tuple[str, ...]


@dataclass(frozen=True)
class Peer:
    name: str
    version: Callable[[], str]
    """Raises LookupError if it is not installed."""
    install: str
    programs: Callable[[str], list[Command]]
    """What is to be started, given a folder."""


@dataclass(frozen=True)
class Row:
    """The results of one framework by size: times in µs, and ratios to ours."""

    name: str
    version: str
    times: dict[int, Times] = field(default_factory=dict)
    ratios: dict[int, float] = field(default_factory=dict)
    failure: str = ""


def run(middleware: str, peers: Iterable[Peer], sizes: Sequence[int], effort: Effort, tell: Tell) -> list[Row]:
    """Ours, by this middleware, is the first row."""
    rows, sessions = [], []
    with contextlib.ExitStack() as undo:
        for peer in (_ours(middleware), *peers):
            tell(f"peers · {peer.name}")
            found = ""
            try:
                found = peer.version()
                sessions.append(undo.enter_context(_session(peer)))
            except LookupError:
                rows.append(Row(peer.name, "", failure=f"not installed: {peer.install}"))
                continue
            except (OSError, RuntimeError) as exc:
                rows.append(Row(peer.name, found, failure=f"failed: {exc}"))
                continue
            rows.append(Row(peer.name, found))
        for size in sizes:
            tell(f"peers · {octets(size)}")
            _measure(size, rows, sessions, effort)
    return rows


def _measure(size: int, rows: list[Row], sessions: list[_Session], effort: Effort) -> None:
    """Add the results for this size to the rows of frameworks that have not failed."""
    for session in sessions:
        session.settle(size, effort.seconds)
    present = [session for session in sessions if not session.failure]
    found = by_turns([partial(session.round_trips, size, session.count) for session in present], effort.rounds)
    by_name = {session.name: rounds for session, rounds in zip(present, found, strict=True) if not session.failure}
    ours = by_name.get(rows[0].name)
    for number, row in enumerate(rows):
        if row.name in by_name:
            row.times[size] = times(by_name[row.name])
            if ours:
                row.ratios[size] = ratio(by_name[row.name], ours)
        failure = next((session.failure for session in sessions if session.name == row.name), "")
        if failure and not row.failure:
            rows[number] = Row(row.name, row.version, row.times, row.ratios, f"failed: {failure}")


class _Session:
    """A framework whose two ends are connected. `failure` describes its error."""

    def __init__(self, name: str, connection: socket.socket) -> None:
        self.name, self.failure, self.count = name, "", 0
        self._connection = connection
        self._lines = connection.makefile("rw")

    def close(self) -> None:
        with contextlib.suppress(OSError):  # the other end is gone
            self._lines.close()
        self._connection.close()

    def settle(self, size: int, seconds: float) -> None:
        """Choose a number of round trips that takes about this long; warm up."""
        taken = self.round_trips(size, 3)
        if taken:
            end = time.perf_counter() + seconds / 2
            while time.perf_counter() < end:
                taken += self.round_trips(size, max(1, int(seconds / 4 / statistics.median(taken))))
            self.count = max(5, min(MOST_CALLS, int(seconds / statistics.median(taken))))

    def round_trips(self, size: int, count: int) -> list[float]:
        """The seconds of each; empty after a failure."""
        if self.failure:
            return []
        try:
            print(size, count, file=self._lines, flush=True)
            answer = self._lines.readline()
        except OSError as exc:
            self.failure = str(exc)
            return []
        if not answer:
            self.failure = f"its process ended, at {octets(size)}"
            return []
        taken: list[float] = json.loads(answer)
        return taken


@contextlib.contextmanager
def _session(peer: Peer) -> Iterator[_Session]:
    with contextlib.ExitStack() as undo:
        place = undo.enter_context(folder())
        listening = undo.enter_context(socket.socket(socket.AF_UNIX))
        listening.bind(f"{place}/{MEETING}")
        listening.listen()
        listening.settimeout(0.1)
        log = undo.enter_context(open(f"{place}/output", "w+b"))
        options = {"cwd": ROOT, "env": _environment(place), "stdin": subprocess.PIPE, "stdout": log, "stderr": log}
        processes = [undo.enter_context(running(command, **options)) for command in peer.programs(place)]
        end = time.monotonic() + 3 * PATIENCE
        while True:
            with contextlib.suppress(TimeoutError):
                connection = listening.accept()[0]
                break
            if time.monotonic() > end or any(process.poll() is not None for process in processes):
                log.seek(0)
                said = log.read().decode(errors="replace").strip().splitlines()
                raise RuntimeError(f"its two ends did not meet: {said[-1] if said else 'no word from it'}")
        connection.settimeout(3 * PATIENCE)
        session = _Session(peer.name, connection)
        undo.callback(session.close)
        yield session


def _environment(folder: str) -> dict[str, str]:
    return os.environ | {"ROBOCOMP_RUNTIME_DIR": folder, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}


# The frameworks.


def _ours(middleware: str) -> Peer:
    domain = str(101 + 2 * (os.getpid() % 60))

    def programs(folder: str) -> list[Command]:
        return [_program("ours", end, folder, middleware, domain) for end in ("far", "near")]

    return Peer(f"ours, {middleware}", lambda: "", "", programs)


def _program(module: str, *arguments: str, python: str = sys.executable) -> Command:
    return python, "-m", f"benchmarks.peers.{module}", *arguments


def _two(module: str) -> Callable[[str], list[Command]]:
    return lambda folder: [_program(module, end, folder) for end in ("far", "near")]


def _of_pip(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError as exc:
        raise LookupError(distribution) from exc


def _dora() -> str:
    if not _dora_command().exists():
        raise LookupError("dora-rs-cli")
    return _of_pip("dora-rs")


def _dora_command() -> Path:
    return Path(sys.executable).parent / "dora"


def _dataflow(folder: str) -> list[Command]:
    """JSON is YAML."""
    nodes = [
        {
            "id": name,
            "path": sys.executable,
            "args": f"-m benchmarks.peers.dora {name} {folder}",
            "inputs": {heard: f"{other}/{heard}"},
            "outputs": [said],
        }
        for name, said, other, heard in (("near", "ping", "far", "pong"), ("far", "pong", "near", "ping"))
    ]
    Path(folder, "dataflow.yml").write_text(json.dumps({"nodes": nodes}), encoding="utf-8")
    return [(str(_dora_command()), "run", "--log-level", "error", f"{folder}/dataflow.yml")]


def _rospy() -> str:
    """Of the system's Python, which has other packages than this one."""
    code = "import numpy, rospy, rosmaster, std_msgs; from importlib.metadata import version; print(version('rospy'))"
    try:
        done = subprocess.run([SYSTEM_PYTHON, "-c", code], capture_output=True, text=True, timeout=PATIENCE)
    except OSError as exc:
        raise LookupError("python3") from exc
    if done.returncode:
        raise LookupError("rospy")
    return done.stdout.strip()


def _ros(by: str) -> Callable[[str], list[Command]]:
    def programs(folder: str) -> list[Command]:
        port = _free_port()
        ends = (("far", folder, port), ("near", folder, port, by))
        return [_program("ros", *end, python=SYSTEM_PYTHON) for end in ends]

    return programs


def _grpc(folder: str) -> list[Command]:
    port = _free_port()
    return [_program("grpc", end, folder, port) for end in ("far", "near")]


def _free_port() -> str:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return str(free.getsockname()[1])


_APT = "apt-get install python3-rospy python3-rosmaster python3-std-msgs python3-numpy"

PEERS = {
    "dora": Peer("dora-rs, two topics", _dora, "make bench-peers", _dataflow),
    "pyro5": Peer("Pyro5", partial(_of_pip, "Pyro5"), "make bench-peers", _two("pyro5")),
    "grpc": Peer("gRPC", partial(_of_pip, "grpcio"), "make bench-peers", _grpc),
    "rospy-service": Peer("rospy, service", _rospy, _APT, _ros("service")),
    "rospy-topics": Peer("rospy, two topics", _rospy, _APT, _ros("topics")),
}


# Results.


def table(rows: list[Row]) -> Table:
    sizes = list(dict.fromkeys(size for row in rows for size in row.times))
    head = ("", *(cell for size in sizes for cell in (octets(size), "p99")), "least ÷ ours")
    cells = []
    for row in rows:
        figures = [row.times.get(size) for size in sizes]
        found = [cell for each in figures for cell in ((us(each.p50), us(each.p99)) if each else ("–", "–"))]
        least = f"{min(row.ratios.values()):.2f} ×" if row.ratios and row is not rows[0] else ""
        cells.append((f"{row.name} {row.version}".strip(), *found, least))
    note = "; ".join(f"{row.name}: {row.failure}" for row in rows if row.failure)
    return Table("peers", "query round trip, beside other frameworks", head, cells, labels=1, note=note)


def findings(rows: list[Row]) -> list[Finding]:
    """Ratios of other frameworks say nothing about a regression of ours that the others do not."""
    if rows[0].failure:
        return [failed("peers", rows[0].name)]
    return [
        Finding("peers", row.name, octets(size), f"{each:.1f} ×", each > 1, value=-each)
        for row in rows[1:]
        for size, each in row.ratios.items()
    ]
