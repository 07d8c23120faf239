"""The scouts on a host, as its agent runs them: one process for each, which ends with its standard input."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Awaitable, Callable, Mapping

from .scouting import LONGEST, MOST

_ENDING = 3.0
"""Seconds that a scout has to end by itself."""

_UNREAD = 4 * 1024 * 1024
"""Octets that may wait for a scout that does not read them."""

Tell = Callable[[str], Awaitable[object]]
"""Passes a line on, once there is room for it."""

Ended = Callable[[str], object]
"""Called once, with the reason; "" if the scout was told to end."""


class Scouts:
    """To be used on the event loop only."""

    def __init__(self, environment: Callable[[], Mapping[str, str]]) -> None:
        """`environment` is that of the processes of the network."""
        self._environment = environment
        self._running: dict[int, _Scout] = {}

    def begin(self, number: int, tell: Tell, ended: Ended) -> None:
        if number in self._running:
            return
        if len(self._running) >= MOST:
            ended(f"{MOST} tools look at this network there already; end one of them")
            return
        self._running[number] = scout = _Scout(tell, ended, self._environment())
        scout.task.add_done_callback(lambda _: self._running.pop(number, None))

    def say(self, number: int, line: str) -> None:
        if scout := self._running.get(number):
            scout.say(line)

    def end(self, number: int) -> None:
        if scout := self._running.get(number):
            scout.end()

    async def close(self) -> None:
        """End all, and wait for it."""
        scouts = list(self._running.values())
        for each in scouts:
            each.end()
        await asyncio.gather(*(each.task for each in scouts), return_exceptions=True)


class _Scout:
    def __init__(self, tell: Tell, ended: Ended, environment: Mapping[str, str]) -> None:
        self._tell, self._ended, self._environment = tell, ended, environment
        self._early: list[bytes] = []
        """Lines that came before the process ran."""
        self._process: Process | None = None
        self._is_over = asyncio.Event()
        self._why = ""
        self.task = asyncio.create_task(self._run(), name="scout")

    def say(self, line: str) -> None:
        data = line.encode() + b"\n"
        if self._process is None or self._process.stdin is None:
            self._early.append(data)
        elif self._process.stdin.transport.get_write_buffer_size() > _UNREAD:
            self._why = "its scout does not read what it is asked"
            self.end()
        else:
            self._process.stdin.write(data)

    def end(self) -> None:
        self._is_over.set()

    async def _run(self) -> None:
        try:
            self._process = process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "robocomp_py.tools.scout"),
                stdin=PIPE,
                stdout=PIPE,
                stderr=DEVNULL,
                env=self._environment,
                limit=LONGEST,
                start_new_session=True,
            )
        except OSError as exc:
            self._ended(f"its scout cannot be started: {exc.strerror}")
            return
        passing = asyncio.create_task(self._pass_on(process))
        over = asyncio.create_task(self._is_over.wait())
        try:
            for data in self._early:
                self.say(data.decode().removesuffix("\n"))
            await asyncio.wait((passing, over), return_when=asyncio.FIRST_COMPLETED)
        finally:
            over.cancel()
            await _end(process)
            passing.cancel()
            await asyncio.gather(passing, return_exceptions=True)
        self._ended(
            self._why or ("" if self._is_over.is_set() else f"its scout has ended (exit code {process.returncode})")
        )

    async def _pass_on(self, process: Process) -> None:
        assert process.stdout
        try:
            while line := await process.stdout.readline():
                await self._tell(line.decode(errors="replace").rstrip("\n"))
        except (ValueError, OSError) as exc:
            self._why = str(exc)


async def _end(process: Process) -> None:
    """End it and its children: it ends by itself when its input does."""
    assert process.stdin
    with contextlib.suppress(OSError):
        process.stdin.close()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_ENDING):
            await process.wait()
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    await process.wait()
