"""The agent of this machine: processes are started, listened to, watched, ended, and never left behind.

What holds each of them, so that one of these may fail:

    a session of its own                 a signal reaches it and its children
    the death of its parent              the kernel tells it when the launcher ends, however that happens (SIGTERM)
    a lifeline                           the kernel ends it when launcher and keeper are both gone (SIGKILL)
    a control group, where there may be  ends all that it started, whatever that did to get away
    a mark in its environment            finds what it started without such groups
    the keeper                           ends all of that when the launcher is killed
    the leftovers, on disk               let the next launch do it, if the keeper was killed as well

Orphans become children of this process, which waits for them. Processes are waited for by a descriptor (pidfd).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import resource
import secrets
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ...errors import DeploymentError
from ...runtime.records import WANTED
from ..agents import Agent, Life, Listener, Usage
from ..beside import beside
from ..place import Place, file_name
from ..process import Process
from . import birth, cgroups, traces
from .birth import Birth
from .clearing import clear_up
from .forking import ForkServer, Unavailable, forkable
from .keeping import Keeper
from .leftovers import Record, load
from .notes import Contract, Note
from .notified import Notified
from .output import Output
from .usage import Meter, Used
from .watchdogs import Watchdogs

log = logging.getLogger("robocomp.deploy")

WATCHDOG = 30.0
"""Seconds after which a process that has stopped feeding its watchdog counts as stuck; components set their own limit
by `component.watchdog`."""

_DRAIN = 1.0
"""Seconds for which the output of a process that has ended is still read."""

TRACES = 5.0
"""Seconds in which a stuck process prints its stacks."""

_ENDED = 5.0
"""Seconds within which killed processes have ended."""

_SPARE_FILES = 16
"""File descriptors that have to be free for a start: a few for the process, and some for logs and commands."""

_NOT_HANDED_DOWN = (
    "NOTIFY_SOCKET",
    "WATCHDOG_USEC",
    "WATCHDOG_PID",
    "LISTEN_FDS",
    "LISTEN_PID",
    "LISTEN_FDNAMES",
    WANTED,
)
"""Variables between rcdeploy and its own service manager; the processes that it starts do not get them."""


@dataclass
class _Running:
    process: Process
    pid: int
    started: int
    group: Path | None
    output: Output
    notified: Notified
    main: int
    """The main process; a notification (MAINPID) can name another one."""
    handles: dict[int, int] = field(default_factory=dict)
    """Descriptors of the processes we wait for, by id."""
    ready: bool = False
    stopping: bool = False
    access: str = "main"
    calls: tuple[float, float] = (0.0, 0.0)
    lives: dict[str, Life] = field(default_factory=dict)
    contracts: dict[str, Contract] = field(default_factory=dict)
    warned: bool = False

    @property
    def name(self) -> str:
        return self.process.name

    def groups(self) -> set[int]:
        """The process groups that are still its own: their ids are not reused before the launcher has reaped it."""
        return {self.pid, self.main} & self.handles.keys()


class Launcher(Agent):
    """The agent of this machine, for one network. Use it on the main thread: the processes end with it."""

    def __init__(
        self,
        listener: Listener,
        network: str,
        middlewares: Iterable[str] = (),
        *,
        place: Place | None = None,
        command: str = "",
    ) -> None:
        """`middlewares` are imported before processes start; a second start of this network is shown `command`.

        Raises DeploymentError if there can be no run-time folder.
        """
        self._listener, self._network, self._middlewares = listener, network, tuple(middlewares)
        self.place = place or Place(network)
        self._command = command
        self._launch = secrets.token_hex(8)
        self._running: dict[str, _Running] = {}
        self._coming: dict[str, Callable[[str], None] | None] = {}
        """The processes that are just being started, and what to do with each afterwards."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._undo = contextlib.AsyncExitStack()
        self._fork_server: ForkServer | None = None
        self._was_told = False
        self._group: Path | None = None
        self._lifeline = -1
        self._files: tuple[int, int] | None = None
        self._sockets = 0
        self._meter = Meter()
        self._strays: dict[str, int] = {}
        self._search: asyncio.Task[dict[str, list[traces.Trace]]] | None = None

    # Opening and closing.

    async def open(self) -> None:
        self._loop = asyncio.get_running_loop()
        try:
            await self._open()
        except BaseException:
            await self.close()
            raise

    async def _open(self) -> None:
        self.place.take(self._command)
        self._undo.callback(self.place.release)
        self._undo.push_async_callback(beside, clear_up)
        await self._sweep()
        self._raise_limits()
        birth.adopt_orphans(True)
        self._undo.callback(birth.adopt_orphans, False)
        self._lifeline, held = os.pipe()
        self._undo.callback(os.close, self._lifeline)
        self._undo.callback(os.close, held)
        if group := cgroups.make(f"robocomp.{file_name(self._network)}.{self._launch}"):
            self._group = group
            self._undo.callback(cgroups.end, group)
        try:
            # A launch that was killed has left its sockets under the same names.
            shutil.rmtree(self.place.notify, ignore_errors=True)
            self.place.notify.mkdir(mode=0o700, exist_ok=True)
            self._record = Record(self.place.leftovers, self._launch, self._group)
            self._undo.callback(self._record.close)
            self._keeper = Keeper(self._network, self.place.folder, held, self._record.content)
        except OSError as exc:
            raise DeploymentError(f"{self.place.folder}: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc
        self._undo.callback(self._keeper.close)
        self._undo.push_async_callback(self._end_all)
        self._watchdogs = Watchdogs(self._loop, self._is_hung)
        self._undo.callback(self._watchdogs.close)
        tidy = self._loop.create_task(self._tidy(), name="tidy")
        self._undo.callback(tidy.cancel)

    async def close(self) -> None:
        await self._undo.aclose()

    async def _sweep(self) -> None:
        """End what a launch of this network left that was killed together with its keeper."""
        left = load(self.place.leftovers)
        if left:
            ended = await beside(left.end)
            if ended:
                log.warning("%s: %d processes were left by a launch that was killed; ended them", self._network, ended)

    def _raise_limits(self) -> None:
        """Each process needs descriptors of the launcher. The processes get the limits with which it was started."""
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if soft != hard:
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
                self._files = soft, hard
                self._undo.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))

    async def _end_all(self) -> None:
        for name in (*self._running, *self._coming):
            self.kill(name)
        if self._tasks or self._running:
            end = self._loop.time() + _ENDED
            while (self._tasks or self._running) and self._loop.time() < end:
                await asyncio.sleep(0.01)
        for task in self._tasks:
            task.cancel()
        if self._fork_server:
            self._fork_server.close()
        if self._group:
            cgroups.kill(self._group)
        end = self._loop.time() + _ENDED
        while (found := traces.marked(self._launch)) and self._loop.time() < end:
            traces.send_all(found, signal.SIGKILL)
            await asyncio.sleep(0.01)
            _reap(each.pid for each in found)

    # Starting.

    async def start(self, process: Process) -> None:
        if process.name in self._running or process.name in self._coming:
            raise DeploymentError(f"{process.name} is already running")
        self._coming[process.name] = None
        try:
            await self._start(process)
        finally:
            deed = self._coming.pop(process.name)
        if deed:
            deed(process.name)

    async def _start(self, process: Process) -> None:
        if not _files_left():
            raise DeploymentError(
                f"{process.name} cannot be started: rcdeploy may open no more files; raise the limit (ulimit -n 4096)"
            )
        self._sockets += 1
        path = self.place.notify / str(self._sockets)
        early: list[tuple[Note, int]] = []
        try:
            notified = Notified(path, lambda note, pid: early.append((note, pid)))
        except OSError as exc:
            why = exc.strerror or str(exc)
            raise DeploymentError(f"{process.name}: no socket {path}: {why}; set ROBOCOMP_RUNTIME_DIR") from exc
        told = {
            **process.env,
            "NOTIFY_SOCKET": str(path),
            WANTED: "1",
            "WATCHDOG_USEC": str(round(WATCHDOG * 1e6)),
            traces.LAUNCH: self._launch,
            traces.NAME: process.name,
        }
        group = cgroups.child(self._group, file_name(process.name)) if self._group else None
        out, into = os.pipe()
        output = Output(out, lambda line: self._listener.output(process.name, line))
        try:
            pid = await self._begin(process, told, into, group)
        except BaseException:
            output.close()
            notified.close()
            if group:
                cgroups.remove(group)
            raise
        finally:
            os.close(into)
        trace = traces.look(pid)
        running = _Running(process, pid, trace.started if trace else 0, group, output, notified, pid)
        self._running[process.name] = running
        self._record.add(pid, running.started)
        self._keeper.started(pid, running.started)
        self._wait_for(running, pid)
        notified.take = lambda note, sender: self._handle(running, note, sender)
        for note, sender in early:
            self._handle(running, note, sender)
        if not process.notifies:
            self._ready(running)

    async def _begin(self, process: Process, told: Mapping[str, str], into: int, group: Path | None) -> int:
        own = Birth(os.getpid(), -1, str(group or ""), self._files)
        if forkable(process):
            try:
                self._fork_server = self._fork_server or ForkServer(
                    self._middlewares, self._lifeline, self.environment()
                )
                return await self._fork_server.start(process, told, into, own)
            except (Unavailable, OSError) as exc:
                if not self._was_told:
                    self._was_told = True
                    log.warning("%s; from now on, components start without the fork server, which takes longer", exc)
        return self._execute(process, told, into, own)

    def _execute(self, process: Process, told: Mapping[str, str], into: int, own: Birth) -> int:
        lifeline = birth.lifeline_of_its_own(self._lifeline)
        own = replace(own, lifeline=lifeline)
        try:
            popen = subprocess.Popen(
                process.command,
                cwd=process.cwd,
                env={**self.environment(), **told},
                stdin=subprocess.DEVNULL,
                stdout=into,
                stderr=subprocess.STDOUT,
                pass_fds=(lifeline,) if lifeline >= 0 else (),
                preexec_fn=own.prepare,
            )
        except (OSError, subprocess.SubprocessError) as exc:
            what, why = getattr(exc, "filename", ""), getattr(exc, "strerror", "") or str(exc)
            raise DeploymentError(f"{process.name}: {what or process.command[0]} cannot be started: {why}") from exc
        finally:
            if lifeline >= 0:
                os.close(lifeline)
        popen.returncode = 0  # we wait for it, not that object
        return popen.pid

    def environment(self) -> dict[str, str]:
        """That of all processes of the network. What has it is ended with the network."""
        mine = {name: value for name, value in os.environ.items() if name not in _NOT_HANDED_DOWN}
        return {**mine, "PYTHONUNBUFFERED": "1", traces.LAUNCH: self._launch}

    # Ending.

    def stop(self, name: str) -> None:
        running = self._running.get(name)
        if running is None:
            self._abandon(name, self.stop)
            return
        running.stopping = True
        self._watchdogs.forget(name)
        groups = {pid for pid in running.groups() if _send_group(pid, signal.SIGTERM)}  # a new one may have none yet
        for pid in {*running.handles, *(cgroups.members(running.group) if running.group else ())}:
            with contextlib.suppress(OSError):
                if os.getpgid(pid) not in groups:
                    os.kill(pid, signal.SIGTERM)
        for pid in groups:
            _send_group(pid, signal.SIGCONT)  # a suspended process does not handle SIGTERM

    def kill(self, name: str) -> None:
        running = self._running.get(name)
        if running is None:
            self._abandon(name, self.kill)
            return
        running.stopping = True
        self._watchdogs.forget(name)
        self._kill(running)

    def _abandon(self, name: str, deed: Callable[[str], None]) -> None:
        """Abandon a process that is just being started; if it starts nevertheless, apply `deed` to it."""
        if name in self._coming:
            self._coming[name] = deed
            if self._fork_server:
                self._fork_server.abandon(name)

    def _kill(self, running: _Running) -> None:
        if running.group:
            cgroups.kill(running.group)
        for pid in running.groups():
            _send_group(pid, signal.SIGKILL)
        for handle in running.handles.values():
            _send(handle, signal.SIGKILL)

    def _wait_for(self, running: _Running, pid: int) -> None:
        try:
            handle = os.pidfd_open(pid)
        except ProcessLookupError:  # it has been reaped elsewhere
            self._conclude_later(running, 0)
            return
        running.handles[pid] = handle
        self._loop.add_reader(handle, self._left, running, pid)

    def _left(self, running: _Running, pid: int, tries: int = 100) -> None:
        """A process that is waited for has ended."""
        handle = running.handles.get(pid)
        if handle is None:
            return
        self._loop.remove_reader(handle)
        running.notified.read()  # it may have said before that another one counts from now on
        if pid == running.main:
            for group in running.groups():
                _send_group(group, signal.SIGKILL)  # what it started may outlive it, and hold the pipe
        code = _code(handle)
        if (
            code is None and tries and _parent(pid) != os.getpid() and traces.look(pid)
        ):  # not yet a child of this process
            self._loop.call_later(0.01, self._left, running, pid, tries - 1)
            return
        os.close(running.handles.pop(pid))
        if pid == running.main:
            self._conclude_later(running, code or 0)

    def _conclude_later(self, running: _Running, code: int) -> None:
        task = self._loop.create_task(self._conclude(running, code), name=f"conclude {running.name}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _conclude(self, running: _Running, code: int) -> None:
        """It has ended: end what it started, read the rest of its output, and report."""
        self._watchdogs.forget(running.name)
        await (self._clear_group(running.group) if running.group else self._clear_family(running))
        await running.output.drain(_DRAIN)  # a process that left its group may hold the pipe
        running.notified.read()
        running.notified.close()
        for pid, handle in running.handles.items():
            self._loop.remove_reader(handle)
            os.close(handle)
            _reap([pid])
        running.handles.clear()
        del self._running[running.name]
        self._record.remove(running.pid)
        self._keeper.ended(running.pid)
        self._listener.exited(running.name, code)

    async def _clear_group(self, group: Path) -> None:
        end = self._loop.time() + _ENDED
        ended: list[int] = []
        while cgroups.populated(group) and self._loop.time() < end:
            ended = cgroups.members(group) or ended
            cgroups.kill(group)
            await asyncio.sleep(0.005)
        _reap(ended)
        if not cgroups.remove(group):
            log.warning("%s cannot be removed", group)

    async def _clear_family(self, running: _Running) -> None:
        end = self._loop.time() + _ENDED
        while (found := await self._family(running)) and self._loop.time() < end:
            traces.send_all(found, signal.SIGKILL)
            await asyncio.sleep(0.005)
            _reap(each.pid for each in found)

    async def _family(self, running: _Running) -> list[traces.Trace]:
        """The living processes that it started. One look at /proc serves all calls at about the same time."""
        self._strays[running.name] = running.pid
        if self._search is None:
            self._search = self._loop.create_task(self._look_around(), name="look around")
        return (await asyncio.shield(self._search)).get(running.name, [])

    async def _look_around(self) -> dict[str, list[traces.Trace]]:
        await asyncio.sleep(0.02)
        asked, self._strays, self._search = self._strays, {}, None
        return traces.family(asked, self._launch)

    async def _tidy(self) -> None:
        """Reap orphans that have ended and that no other code has reaped in a while."""
        seen = 0
        while True:
            await asyncio.sleep(5.0)
            known = {pid for running in self._running.values() for pid in running.handles}
            ended = _ended_child()
            while ended and ended == seen and ended not in known:
                _reap([ended])
                seen = ended = _ended_child()
            seen = ended

    # Hearing.

    def _handle(self, running: _Running, note: Note, sender: int) -> None:
        if not self._counts(running, sender):
            if not running.warned:
                running.warned = True
                self._listener.output(
                    running.name,
                    f"(a notification of process {sender} was ignored: only process {running.main} may send them; "
                    "start the other one by `exec`, or have the first one send NOTIFYACCESS=all)",
                )
            return
        if note.main_pid and note.main_pid != running.main and self._is_of(running, note.main_pid):
            running.main = note.main_pid
            if note.main_pid not in running.handles:  # else we wait for it already
                self._wait_for(running, note.main_pid)
        running.access = note.access or running.access
        if note.stopping:
            self._watchdogs.forget(running.name)
        elif not running.stopping:
            self._watch(running, note)
        if note.status is not None:
            self._listener.status(running.name, note.status)
        running.calls = note.calls or running.calls
        known = running.process.instances
        running.lives |= {name: life for name, life in note.lives.items() if running.process.whole(name) in known}
        for part in note.contracts:
            self._note_contract(running, part)
        for instance in note.ended:
            self._listener.left(running.name, instance)
        if note.ready:
            self._ready(running)

    def _note_contract(self, running: _Running, part: Contract) -> None:
        if running.process.whole(part.instance) in running.process.instances:
            known = running.contracts.setdefault(part.instance, Contract(part.instance, part.count, {}))
            known.add(part)
            if known.complete:
                self._listener.contract(running.name, known.instance, known.operations)

    def _ready(self, running: _Running) -> None:
        if not running.ready:
            running.ready = True
            self._listener.ready(running.name)

    def _watch(self, running: _Running, note: Note) -> None:
        if note.watchdog_s is not None:
            self._watchdogs.limit(running.name, note.watchdog_s)
        if note.stuck:
            self._is_hung(running.name)
        elif note.fed:
            self._watchdogs.feed(running.name, WATCHDOG)

    def _is_hung(self, name: str) -> None:
        running = self._running.get(name)
        if running is None or running.stopping:
            return
        running.stopping = True
        self._watchdogs.forget(name)
        self._listener.hung(name)
        handle = running.handles.get(running.main)
        if handle is not None:
            _send(handle, signal.SIGABRT)
            _send(handle, signal.SIGCONT)
        self._loop.call_later(TRACES, self._kill_if, running)

    def _kill_if(self, running: _Running) -> None:
        if self._running.get(running.name) is running:
            self._kill(running)

    def _counts(self, running: _Running, sender: int) -> bool:
        match running.access:
            case "none":
                return False
            case "all":
                return sender == running.main or self._is_of(running, sender)
            case _:
                return sender == running.main

    def _is_of(self, running: _Running, pid: int) -> bool:
        """Whether a process was started by this one. It may have ended already, in the same session at least."""
        trace = traces.look(pid)
        if trace and trace.session == running.pid:
            return True
        if running.group:
            return pid in cgroups.members(running.group)
        found = traces.family({running.name: running.pid}, self._launch)[running.name]
        return any(each.pid == pid for each in found)

    # Being asked.

    def usage(self) -> Mapping[str, Usage]:
        used = self._meter.read({name: (each.main, each.group) for name, each in self._running.items()})
        return {name: _usage(each, used.get(name)) for name, each in self._running.items()}


def _usage(running: _Running, used: Used | None) -> Usage:
    if used is None:
        return Usage(running.main, 0.0, 0, *running.calls, lives=running.lives)
    return Usage(running.main, used.cpu_s, used.memory, *running.calls, used.at, running.lives)


def _send(handle: int, number: signal.Signals) -> None:
    with contextlib.suppress(OSError):
        signal.pidfd_send_signal(handle, number)


def _files_left() -> bool:
    """Whether a process can be started without using up the descriptors of this one."""
    spare: list[int] = []
    try:
        for _ in range(_SPARE_FILES):
            spare.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))
    except OSError:
        return False
    finally:
        for each in spare:
            os.close(each)
    return True


def _send_group(pid: int, number: signal.Signals) -> bool:
    """Whether there is such a group."""
    try:
        os.killpg(pid, number)
    except OSError:
        return False
    return True


def _parent(pid: int) -> int:
    trace = traces.look(pid)
    return trace.parent if trace else 0


def _code(handle: int) -> int | None:
    """The exit code as in subprocess; None if it is unknown, since it is not a child of this process."""
    try:
        found = os.waitid(os.P_PIDFD, handle, os.WEXITED | os.WNOHANG)
    except ChildProcessError:
        return None
    if found is None:
        return None
    return found.si_status if found.si_code == os.CLD_EXITED else -found.si_status


def _reap(pids: Iterable[int]) -> None:
    for pid in pids:
        with contextlib.suppress(OSError):
            os.waitpid(pid, os.WNOHANG)


def _ended_child() -> int:
    with contextlib.suppress(ChildProcessError):
        found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        return found.si_pid if found else 0
    return 0
