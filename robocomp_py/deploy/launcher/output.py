"""What a process prints, read from its pipe on the event loop, line by line."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable

LINE = 4096
"""Longer lines are cut into pieces of so many characters."""

_CHUNK = 65536

_MUCH = 8192
"""Bytes in one turn after which its next turn comes later."""

_LATER = 4.0
"""... by so many times as long as that turn took: who floods is slowed down, and nobody else."""


class Output:
    """Reads until all who hold the other end are gone, or `close`; it does so at once, or after what waits."""

    def __init__(self, pipe: int, tell: Callable[[str], None]) -> None:
        self._pipe, self._tell = pipe, tell
        self._loop = asyncio.get_running_loop()
        self._rest = b""
        self._pause: asyncio.TimerHandle | None = None
        self.ended: asyncio.Future[None] = self._loop.create_future()
        os.set_blocking(pipe, False)
        self._loop.add_reader(pipe, self._turn)

    async def drain(self, seconds: float) -> None:
        """Read what was printed until now, for so long at most, and close."""
        await asyncio.wait({self.ended}, timeout=seconds)
        self.close()

    def close(self) -> None:
        """What was not read is lost. May be called twice."""
        if self._pipe < 0:
            return
        if self._pause:
            self._pause.cancel()
        self._loop.remove_reader(self._pipe)
        os.close(self._pipe)
        self._pipe = -1
        if self._rest:
            self._print(self._rest)
        self._rest = b""
        if not self.ended.done():
            self.ended.set_result(None)

    def _turn(self) -> None:
        begun = self._loop.time()
        try:
            chunk = os.read(self._pipe, _CHUNK)
        except BlockingIOError:
            return
        if not chunk:
            self.close()
            return
        self._take(chunk)
        if len(chunk) > _MUCH:
            self._loop.remove_reader(self._pipe)
            self._pause = self._loop.call_later((self._loop.time() - begun) * _LATER, self._go_on)

    def _go_on(self) -> None:
        self._pause = None
        self._loop.add_reader(self._pipe, self._turn)

    def _take(self, chunk: bytes) -> None:
        *lines, rest = (self._rest + chunk).split(b"\n")
        self._rest = b""
        while len(rest) > LINE:
            lines.append(rest[:LINE])
            rest = rest[LINE:]
        self._rest = rest
        for line in lines:
            self._print(line)

    def _print(self, line: bytes) -> None:
        text = line.decode(errors="replace").rstrip("\r")
        for start in range(0, max(1, len(text)), LINE):
            self._tell(text[start : start + LINE])
