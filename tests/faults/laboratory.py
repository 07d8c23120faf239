"""Starts actors, does things to them, and sees to it that none is left."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from robocomp_py.transports.base import TransportConfig, hosting

from .history import Done, Event, Journal, Left, read

ROOT = Path(__file__).parents[2]

PATIENCE = 60.0
"""Seconds that an actor has for what it is asked to do."""


class Laboratory:
    """One run: a folder of its own, in which its processes meet, and where they write what happens."""

    def __init__(self, transport: str, options: Mapping[str, Any] | None = None, prefix: tuple[str, ...] = ()) -> None:
        """`prefix`: a command that runs a command elsewhere, in a network namespace, say."""
        self.transport, self.options = transport, dict(options or {})
        self.folder = Path(tempfile.mkdtemp(prefix="rcf-", dir="/tmp"))
        self._nurseries: dict[tuple[str, ...], subprocess.Popen[str]] = {}
        self.prefix = prefix
        self._actors: list[Remote] = []
        self._count = 0
        self._starting = threading.Lock()
        self._undo = contextlib.ExitStack()
        self._started: dict[int, tuple[str, str]] = {}
        (self.folder / "run").mkdir(mode=0o700)

    def __enter__(self) -> Self:
        self._journal = Journal(self.folder / "laboratory.events")
        self._undo.callback(shutil.rmtree, self.folder, ignore_errors=True)
        self._undo.callback(self._journal.close)
        before = os.environ.get("ROBOCOMP_RUNTIME_DIR")
        os.environ["ROBOCOMP_RUNTIME_DIR"] = str(self.folder / "run")
        self._undo.callback(_set, "ROBOCOMP_RUNTIME_DIR", before)
        if not self.options.get("connect"):
            self._undo.enter_context(hosting(self.transport, TransportConfig(self.options, owner="laboratory")))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._undo:
            self.kill_all()
            for nursery in self._nurseries.values():
                assert nursery.stdin
                nursery.stdin.close()
                nursery.wait(PATIENCE)
                assert nursery.stdout
                nursery.stdout.close()

    def start(
        self,
        name: str = "",
        *,
        prefix: tuple[str, ...] | None = None,
        options: Mapping[str, Any] | None = None,
        environment: Mapping[str, str] | None = None,
        run: str = "run",
    ) -> Remote:
        """A new actor; `run` is the folder in which it meets others, if that is not the same for all."""
        with self._starting:
            self._count += 1
            number = self._count
        name = name or f"a{number}"
        control = self.folder / f"{number}.control"
        (self.folder / run).mkdir(mode=0o700, exist_ok=True)
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(str(control))
            listener.listen()
            spec: dict[str, Any] = {
                "name": name,
                "transport": self.transport,
                "options": self.options if options is None else dict(options),
                "control": str(control),
                "journal": str(self.folder / f"{number}.events"),
                "log": str(self.folder / f"{name}.log"),
                "environment": {"ROBOCOMP_RUNTIME_DIR": str(self.folder / run), **(environment or {})},
            }
            pid = self._fork(self.prefix if prefix is None else prefix, spec)
            connection = self._accepted(listener, pid, name)
        control.unlink()
        actor = Remote(self, name, pid, connection, Path(spec["journal"]))
        self._actors.append(actor)
        actor.hear()
        return actor

    def _accepted(self, listener: socket.socket, pid: int, name: str) -> socket.socket:
        """Its connection; raises RuntimeError if it ends before it makes one."""
        listener.settimeout(0.5)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            with contextlib.suppress(TimeoutError):
                return listener.accept()[0]
            if _began(pid) != self.began(pid):
                break
        raise RuntimeError(f"{name} did not start:\n{self.log(name)}")

    def try_to_start(self, name: str) -> Remote | None:
        """The same, where that may fail."""
        try:
            return self.start(name)
        except RuntimeError:
            return None

    def kill_all(self) -> None:
        for actor in self._actors:
            if actor.alive():
                actor.kill()

    def done(self, what: str, whom: str) -> float:
        at = time.monotonic()
        self._journal.note(Done(what, whom, at))
        return at

    def began(self, pid: int) -> str:
        return self._started[pid][0]

    def log(self, name: str) -> str:
        path = self.folder / f"{name}.log"
        return path.read_text() if path.exists() else ""

    def history(self) -> list[Event]:
        """What happened until now."""
        return read(self.folder)

    def end(self) -> list[Event]:
        """Have all end, as they should; what happened, with those who are there nevertheless."""
        for actor in self._actors:
            actor.end()
        deadline = time.monotonic() + PATIENCE
        while (left := self._left()) and time.monotonic() < deadline:
            time.sleep(0.02)
        return [*read(self.folder), *(Left(pid, name) for pid, name in left)]

    def _left(self) -> list[tuple[int, str]]:
        return [(pid, name) for pid, (began, name) in self._started.items() if _lives(pid, began)]

    def _fork(self, prefix: tuple[str, ...], spec: Mapping[str, Any]) -> int:
        with self._starting:
            nursery = self._nursery(prefix)
            assert nursery.stdin
            assert nursery.stdout
            nursery.stdin.write(json.dumps(spec) + "\n")
            nursery.stdin.flush()
            pid = int(nursery.stdout.readline())
            self._started[pid] = (_began(pid), str(spec["name"]))
            return pid

    def _nursery(self, prefix: tuple[str, ...]) -> subprocess.Popen[str]:
        if prefix not in self._nurseries:
            command = [*prefix, sys.executable, "-m", "tests.faults.actors"]
            self._nurseries[prefix] = subprocess.Popen(
                command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
        return self._nurseries[prefix]


class Remote:
    """An actor as the laboratory knows it. `actor.serve(…)` has it do that, and returns what it says."""

    def __init__(self, laboratory: Laboratory, name: str, pid: int, connection: socket.socket, journal: Path) -> None:
        self.journal, self.began = journal, laboratory.began(pid)
        self.name, self.pid, self._laboratory, self._connection = name, pid, laboratory, connection
        connection.settimeout(PATIENCE)
        self._answers = connection.makefile("r")

    def __getattr__(self, do: str) -> Any:
        return lambda *arguments, **named: self._do(do, arguments, named)

    def hear(self) -> Any:
        line = self._answers.readline()
        if not line:
            raise RuntimeError(f"{self.name} ended:\n{self._laboratory.log(self.name)}")
        answer = json.loads(line)
        if "failed" in answer:
            raise RuntimeError(f"{self.name}: {answer['failed']}")
        return answer.get("said")

    def kill(self) -> float:
        """`kill -9`, and wait until it is dead, as who restarts it does; when it was done."""
        at = self._laboratory.done("kill", self.name)
        self._signal(signal.SIGKILL)
        self._hang_up()
        until(lambda: not self.alive(), PATIENCE, f"{self.name} is dead")
        return at

    def freeze(self) -> float:
        at = self._laboratory.done("stop", self.name)
        self._signal(signal.SIGSTOP)
        return at

    def thaw(self) -> float:
        at = self._laboratory.done("go on", self.name)
        self._signal(signal.SIGCONT)
        return at

    def end(self) -> None:
        """Have it close everything, and end."""
        self._hang_up()

    def alive(self) -> bool:
        return _lives(self.pid, self.began)

    def written(self) -> int:
        """How much its journal holds."""
        return self.journal.stat().st_size

    def _do(self, do: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        if arguments:
            named = {**dict(zip(("channel", "count"), arguments, strict=False)), **named}
        self._connection.settimeout(PATIENCE + named.get("timeout", 0.0))
        self._connection.sendall(json.dumps({"do": do, **named}).encode() + b"\n")
        return self.hear()

    def _signal(self, number: int) -> None:
        if self.alive():
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def _hang_up(self) -> None:
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._answers.close()
        self._connection.close()


def until(condition: Any, seconds: float, what: str) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"not in {seconds:g} s: {what}")
        time.sleep(0.002)


@contextlib.contextmanager
def running(command: list[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(command, text=True, **options)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _began(pid: int) -> str:
    """When a process began, as the kernel counts; "" if it is gone, with all its threads."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return fields[19]


def _lives(pid: int, began: str) -> bool:
    """Whether that process still exists; one that ended before the first look never `began`."""
    return began != "" and _began(pid) == began


def _set(name: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value
