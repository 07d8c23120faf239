"""Processes of this machine: started, listened to, told to stop, never left behind."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import os
import signal
import socket
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from ..errors import DeploymentError
from ..runtime.notify import ENDED
from . import keeper
from .plan import Process

LINE = 4096
"""Longer lines of output are cut into pieces of so many characters."""

_DRAIN = 1.0
"""Seconds for which what a process said before it ended is still read."""

_PR_SET_PDEATHSIG = 1


class Launcher:
    """Starts processes, and calls back on the event loop.

    `output(name, line)`, `ready(name)`, `status(name, text)`, `left(name, instance)`, when one of several in a process
    has ended, and `exited(name, code)` are called as these things happen; `exited` after the last line.
    """

    def __init__(
        self,
        output: Callable[[str, str], None],
        ready: Callable[[str], None],
        exited: Callable[[str, int], None],
        status: Callable[[str, str], None] = lambda name, text: None,
        left: Callable[[str, str], None] = lambda name, instance: None,
    ) -> None:
        self._output, self._ready, self._exited = output, ready, exited
        self._status, self._left = status, left
        self._running: dict[str, asyncio.subprocess.Process] = {}
        self._watchers: set[asyncio.Task[None]] = set()
        self._sockets: list[socket.socket] = []
        self._folder = tempfile.TemporaryDirectory(prefix="rcdeploy-")
        self._keeper: asyncio.subprocess.Process | None = None

    async def open(self) -> None:
        """Start the keeper, which ends our processes if we are killed."""
        self._keeper = await asyncio.create_subprocess_exec(
            *(sys.executable, "-ISE", str(Path(keeper.__file__)), self._folder.name),
            stdin=asyncio.subprocess.PIPE,
            start_new_session=True,
        )

    async def close(self) -> None:
        for channel in self._sockets:
            asyncio.get_running_loop().remove_reader(channel)
            channel.close()
        if self._keeper and self._keeper.stdin:
            self._keeper.stdin.close()
            await self._keeper.wait()
        self._folder.cleanup()

    async def start(self, process: Process) -> None:
        """Raises DeploymentError if there is no such program, or it cannot be run."""
        environment = os.environ | {"PYTHONUNBUFFERED": "1"} | dict(process.env)
        try:
            environment["NOTIFY_SOCKET"] = str(self._listen(process.name))
        except OSError as exc:
            raise DeploymentError(f"{process.name}: no socket in {self._folder.name}: {exc}; set TMPDIR") from exc
        # A pipe of our own: asyncio takes a process for ended only once nobody holds the one it makes.
        out, into = os.pipe()
        try:
            running = await asyncio.create_subprocess_exec(
                *process.command,
                cwd=process.cwd,
                env=environment,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=into,
                stderr=asyncio.subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with(os.getpid()),
            )
        except OSError as exc:
            os.close(out)
            raise DeploymentError(f"{process.name}: {process.command[0]} cannot be started: {exc.strerror}") from exc
        finally:
            os.close(into)
        self._running[process.name] = running
        self._tell_keeper(f"+{running.pid}")
        watcher = asyncio.create_task(self._watch(process.name, running, out), name=f"watch {process.name}")
        self._watchers.add(watcher)
        watcher.add_done_callback(self._watchers.discard)
        if not process.notifies:
            self._ready(process.name)

    def pid(self, name: str) -> int | None:
        return self._running[name].pid if name in self._running else None

    def stop(self, name: str) -> None:
        """Ask it to end."""
        self._signal(name, signal.SIGTERM)

    def kill(self, name: str) -> None:
        """End it and all it started."""
        self._signal(name, signal.SIGKILL)

    def _signal(self, name: str, number: int) -> None:
        if name in self._running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._running[name].pid, number)

    async def _watch(self, name: str, running: asyncio.subprocess.Process, output: int) -> None:
        reader = asyncio.create_task(self._read(name, output))
        code = await running.wait()
        # What it started may outlive it and hold the pipe: end that first, then read what is left.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
        done, _ = await asyncio.wait({reader}, timeout=_DRAIN)
        if not done:  # somebody who left its process group holds the pipe, and is nobody we started
            reader.cancel()
        del self._running[name]
        self._tell_keeper(f"-{running.pid}")
        self._exited(name, code)

    async def _read(self, name: str, output: int) -> None:
        stream = asyncio.StreamReader()
        with os.fdopen(output, "rb") as pipe:
            transport, _ = await asyncio.get_running_loop().connect_read_pipe(
                lambda: asyncio.StreamReaderProtocol(stream), pipe
            )
            try:
                await self._read_lines(name, stream)
            finally:
                transport.close()

    async def _read_lines(self, name: str, stream: asyncio.StreamReader) -> None:
        rest = b""
        while chunk := await stream.read(65536):
            *lines, rest = (rest + chunk).split(b"\n")
            while len(rest) > LINE:
                lines.append(rest[:LINE])
                rest = rest[LINE:]
            for line in lines:
                self._print(name, line)
        if rest:
            self._print(name, rest)

    def _print(self, name: str, line: bytes) -> None:
        text = line.decode(errors="replace").rstrip("\r")
        for start in range(0, max(1, len(text)), LINE):
            self._output(name, text[start : start + LINE])

    def _listen(self, name: str) -> Path:
        """A socket at which a process says how it is."""
        path = Path(self._folder.name, f"{len(self._sockets)}.notify")
        channel = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._sockets.append(channel)
        channel.bind(str(path))
        asyncio.get_running_loop().add_reader(channel, self._notified, name, channel)
        return path

    def _notified(self, name: str, channel: socket.socket) -> None:
        with contextlib.suppress(BlockingIOError):
            for line in channel.recv(4096).decode(errors="replace").split("\n"):
                if line == "READY=1":
                    self._ready(name)
                elif line.startswith("STATUS="):
                    self._status(name, line.removeprefix("STATUS="))
                elif line.startswith(ENDED):
                    self._left(name, line.removeprefix(ENDED))

    def _tell_keeper(self, line: str) -> None:
        if self._keeper and self._keeper.stdin and not self._keeper.stdin.is_closing():
            self._keeper.stdin.write(f"{line}\n".encode())


def _die_with(parent: int) -> Callable[[], None] | None:
    """For a child to call before it becomes its program: end when the parent does (Linux only)."""
    if not sys.platform.startswith("linux"):
        return None
    prctl = ctypes.CDLL(None).prctl

    def arrange() -> None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it has ended already
            os._exit(1)

    return arrange
