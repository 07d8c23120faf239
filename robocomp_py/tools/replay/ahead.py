"""Reads a recording ahead of its replay, on a thread of its own, so that a slow disk delays no message."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Collection, Iterator
from typing import NamedTuple, Self

from ...errors import RobocompError
from ...threads import NO_THREAD, start_thread
from ..recording.reader import Recording

MOST_OCTETS = 64 * 1024 * 1024
MOST_MESSAGES = 10_000
"""What may wait for its turn."""

_SHORTEST_LOOP = 100_000_000
"""ns after which a loop begins again at the earliest: a recording of one message has no duration."""


class Upcoming(NamedTuple):
    position: int
    """In ns since the replay began, also over loops."""
    topic: str
    data: bytes


class Ahead:
    """The messages of a part of a recording, in their order. It belongs to one thread, and is closed by it."""

    def __init__(
        self, recording: Recording, topics: Collection[str], *, start: int, end: int | None, is_loop: bool
    ) -> None:
        """Times are in ns since 1970. Raises RobocompError if there is no thread."""
        self._recording, self._topics, self._start, self._end = recording, topics, start, end
        self._is_loop = is_loop
        self._waiting: deque[Upcoming] = deque()
        self._octets = 0
        self._changed = threading.Condition()
        self._is_over = self._is_closed = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._read, name="replay-ahead")
        if not start_thread(self._thread):
            raise RobocompError(NO_THREAD)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join()

    def __iter__(self) -> Iterator[Upcoming]:
        """Raises what reading has raised, after the messages before it."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_over)
                if not self._waiting:
                    if self._error:
                        raise self._error
                    return
                message = self._waiting.popleft()
                self._octets -= len(message.data)
                self._changed.notify_all()
            yield message

    def _read(self) -> None:
        try:
            loop = 0
            while self._read_once(loop * self._length) and self._is_loop and not self._is_closed:
                loop += 1
        except BaseException as exc:  # raised where the messages are taken
            self._error = exc
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    @property
    def _length(self) -> int:
        return max((self._end or self._recording.end) - self._start, _SHORTEST_LOOP)

    def _read_once(self, base: int) -> bool:
        """Whether there was a message."""
        was_any = False
        for message in self._recording.messages(self._topics, self._start, self._end):
            was_any = True
            if not self._put(Upcoming(base + message.log_time - self._start, message.topic.name, message.data)):
                return False
        return was_any

    def _put(self, message: Upcoming) -> bool:
        """False if the replay has ended."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or self._has_room(len(message.data)))
            if self._is_closed:
                return False
            self._waiting.append(message)
            self._octets += len(message.data)
            self._changed.notify_all()
        return True

    def _has_room(self, octets: int) -> bool:
        return not self._waiting or (len(self._waiting) < MOST_MESSAGES and self._octets + octets <= MOST_OCTETS)
