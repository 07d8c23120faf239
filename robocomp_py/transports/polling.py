"""A base for transports over Python's sockets: one thread polls all of them.

A subclass says how it listens, connects and frames its messages, and derives its links from `PublishingLink` and
`SubscribingLink` (`topics.py`), `CommandingLink` and `CallingLink` (`client.py`), `CommandInlet` and `Server`
(`server.py`). See `docs/guides/transports.md`.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

from ..wire.header import random_id
from .base import TransportConfig
from .directory import Directory
from .leader_followers import Job, LeaderFollowers
from .runtime_folder import runtime_dir
from .server import ServingTransport

TICK = 0.1
"""Seconds between two looks at the directory and at what is due."""


class _Watched(NamedTuple):
    socket: socket.socket
    on_input: Callable[[], Iterable[Job]]
    on_end: Callable[[], object]


class PollingTransport(ServingTransport):
    """`name` names its folder and its threads. A subclass calls `start` once it can take input."""

    name: str

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        self.owner, self.incarnation = config.owner, random_id()
        self.folder = runtime_dir(self.name)
        self.served = self.folder / "served"
        self._watched: dict[int, _Watched] = {}
        self._jobs: deque[Job] = deque()
        self._next_tick = 0.0
        self.directory = Directory(self.folder)
        self.member = self.directory.join(self.owner)
        self._wakes, self._wake = socket.socketpair()
        self._threads = LeaderFollowers(self.name, self._receive, self.look_soon)

    def start(self) -> None:
        self._threads.start(self.close)

    def watch(self, what: socket.socket, on_input: Callable[[], Iterable[Job]], on_end: Callable[[], object]) -> None:
        """Have the receiving thread call `on_input` when there is input.

        When that raises OSError, the thread closes the socket and calls `on_end`. Only that thread closes sockets;
        other threads shut them down, which it notices. Otherwise a closed descriptor that is still being polled could
        already belong to another socket.
        """
        self._watched[what.fileno()] = _Watched(what, on_input, on_end)
        self._ring()

    def do(self, job: Job) -> None:
        self._jobs.append(job)
        self._ring()

    def look_soon(self) -> None:
        self._next_tick = 0.0
        self._ring()

    def release(self, everything: contextlib.ExitStack) -> None:
        for each in (self._wake, self._wakes):
            everything.callback(each.close)
        everything.callback(self._close_sockets)
        everything.callback(self._threads.close)
        everything.callback(self.close_peers)
        everything.callback(self.member.close)

    def _close_sockets(self) -> None:
        for each in list(self._watched.values()):
            each.socket.close()

    def _ring(self) -> None:
        with contextlib.suppress(OSError):  # closed meanwhile
            self._wake.send(b"x")

    def _receive(self) -> Iterable[Job]:
        now = time.monotonic()
        if now >= self._next_tick:
            self._next_tick = now + TICK  # before the tick, so that a later request to tick is not missed
            self._next_tick = min(self._next_tick, time.monotonic() + self.tick())
        watched, poll = dict(self._watched), select.poll()
        for number in (self._wakes.fileno(), *watched):
            poll.register(number, select.POLLIN)
        jobs: list[Job] = []
        for number, _ in poll.poll(0 if self._jobs else max(0.0, self._next_tick - now) * 1000):
            if number == self._wakes.fileno():
                self._wakes.recv(4096)
            else:
                jobs += self._input(number, watched[number])
        jobs += [self._jobs.popleft() for _ in range(len(self._jobs))]
        return jobs

    def _input(self, number: int, ready: _Watched) -> Iterable[Job]:
        # To the end, since all jobs of this call run before the next one: a client whose answer was the last has not
        # asked again by then. In a fixed order it would be the same one each time, and get half as many turns.
        self._watched[number] = self._watched.pop(number)
        try:
            return ready.on_input()
        except OSError:
            del self._watched[number]
            ready.socket.close()
            ready.on_end()
            return ()
