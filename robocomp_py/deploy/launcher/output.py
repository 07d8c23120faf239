"""What a process prints, read from its pipe on the event loop, line by line."""

from __future__ import annotations

import asyncio
import codecs
import os
import time
from collections.abc import Callable

from ...runtime.records import MARK

LINE = 4096
"""Longer lines are cut into pieces of this many characters."""

_CHUNK = 65536

_MUCH = 8192
"""Bytes in one turn after which its next turn comes later."""

_LATER = 4.0
"""Factor for the pause after a turn that took long: it slows down only the process that floods."""

_HELD_UP = 0.02
"""Seconds that count, at most, of an idle turn: the launcher waited for its own reader, or was suspended."""

_REST = 1 << 20
"""Bytes that are read at most when it is too late to wait for them; a pipe holds fewer, unless it is still filled."""


class Output:
    """Reads until the other end is closed everywhere, or until `close`."""

    def __init__(self, pipe: int, tell: Callable[[str], None]) -> None:
        self._pipe, self._tell = pipe, tell
        self._loop = asyncio.get_running_loop()
        self._decoder = _new_decoder()
        self._rest = ""
        """The beginning of a line whose end has not come."""
        self._pause: asyncio.TimerHandle | None = None
        self._draining = False
        self.ended: asyncio.Future[None] = self._loop.create_future()
        os.set_blocking(pipe, False)
        self._loop.add_reader(pipe, self._turn)

    async def drain(self, seconds: float) -> None:
        """Read what was printed, wait for more for a limited time, and close."""
        self._draining = True
        if self._pause:
            self._pause.cancel()
            self._go_on()
        await asyncio.wait({self.ended}, timeout=seconds)
        self._read_rest()
        self.close()

    def close(self) -> None:
        """What was not read is lost. May be called twice."""
        if self._pipe < 0:
            return
        if self._pause:
            self._pause.cancel()
            self._pause = None
        self._loop.remove_reader(self._pipe)
        os.close(self._pipe)
        self._pipe = -1
        self._take(b"", last=True)
        if not self.ended.done():
            self.ended.set_result(None)

    def _turn(self) -> None:
        begun, worked = self._loop.time(), time.thread_time()
        count = self._read()
        if count > _MUCH and not self._draining:
            took = max(time.thread_time() - worked, min(self._loop.time() - begun, _HELD_UP))
            self._loop.remove_reader(self._pipe)
            self._pause = self._loop.call_later(took * _LATER, self._go_on)

    def _read(self) -> int:
        """Returns the number of bytes; 0 if there is nothing now, or at the end."""
        try:
            chunk = os.read(self._pipe, _CHUNK)
        except BlockingIOError:
            return 0
        if chunk:
            self._take(chunk)
        else:
            self.close()
        return len(chunk)

    def _read_rest(self) -> None:
        """We may have been stopped all the time that there was to read it."""
        left = _REST
        while self._pipe >= 0 and left > 0 and (count := self._read()):
            left -= count

    def _go_on(self) -> None:
        self._pause = None
        self._loop.add_reader(self._pipe, self._turn)

    def _take(self, chunk: bytes, *, last: bool = False) -> None:
        """A character may arrive in two chunks: the decoder keeps its first part."""
        *lines, rest = (self._rest + self._decoder.decode(chunk, last)).split("\n")
        while len(rest) > LINE or (last and rest):
            at = rest.find(MARK, 1, LINE)  # a record is not cut because it follows an unfinished line
            end = at if at > 0 else LINE
            lines.append(rest[:end])
            rest = rest[end:]
        self._rest = rest
        for line in lines:
            self._print(line)

    def _print(self, line: str) -> None:
        text, *records = line.rstrip("\r").split(MARK)
        if text or not records:
            for start in range(0, max(1, len(text)), LINE):
                self._tell(text[start : start + LINE])
        for each in records:
            self._tell((MARK + each)[:LINE])


def _new_decoder() -> codecs.IncrementalDecoder:
    return codecs.getincrementaldecoder("utf-8")(errors="replace")
