"""One thread waits at one wake-up pipe for all input: messages of topics, those in the queue, and timers."""

from __future__ import annotations

import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

from ...errors import TransportError
from ..leader_followers import Job
from .wakeup import LOOK, NEWS, QUEUED, WAKEUPS, Waker, Wakeup

log = logging.getLogger("robocomp.transport.shm")

TICK = 0.1
"""Seconds between two looks at awaited peers, and into the directory if its changes are not reported."""

MOMENT = 0.01
"""Seconds between two looks into a directory that keeps changing."""

TURNS = 16
"""Messages in a row after which topics have their turn."""


class Attending(Protocol):
    """A link that may have input."""

    def on_input(self, *, one: bool = False) -> Sequence[Job]:
        """Take the messages that are there, or only `one`; returns the job that remains."""


class Loop:
    """`receive` is for one thread at a time."""

    def __init__(
        self, wakeup: Wakeup, own: Waker, tick: Callable[[], float], take_queued: Callable[[], Job | None]
    ) -> None:
        self._wakeup, self._own, self._tick, self._take_queued = wakeup, own, tick, take_queued
        self._attending: dict[int, list[Attending]] = {number: [] for number in range(WAKEUPS)}
        self._ready: deque[Attending] = deque()
        self._jobs: deque[Job] = deque()
        self._queued = True
        """Whether the queue may hold messages."""
        self._taken = 0
        self._next_tick = 0.0
        self._sleeping = False
        self._afterwards: list[Callable[[], object]] = []
        self.afterwards = self._afterwards.append
        """Schedules a call on the receiving thread, after the current jobs."""

    def add(self, number: int, link: Attending) -> None:
        """Take input of a link whenever this wake-up number arrives."""
        self._attending[number].append(link)
        self.attend(link)

    def remove(self, number: int, link: Attending) -> None:
        with contextlib.suppress(ValueError):  # it was never added
            self._attending[number].remove(link)

    def attend(self, link: Attending) -> None:
        """Take input of this link in the next `receive`, without a wake-up."""
        if link not in self._ready:
            self._ready.append(link)
        if self._sleeping:
            self._own.wake(QUEUED)

    def do(self, job: Job) -> None:
        """Return this job from the next `receive`."""
        self._jobs.append(job)
        if self._sleeping:
            self._own.wake(QUEUED)

    def wake(self) -> None:
        """Run the next tick now, because something became due earlier."""
        self._own.wake(LOOK)

    def receive(self) -> Iterable[Job]:
        while self._afterwards:
            try:
                self._afterwards.pop()()
            except TransportError:
                log.exception("taking input")
        now = time.monotonic()
        if now >= self._next_tick:
            self._next_tick = now + self._tick()
        if self._queued and (job := self._next_queued()):
            return (job,)
        self._sleeping = True  # before looking at what is ready: a thread that adds to it later sees this, and wakes us
        busy = self._queued or self._ready or self._jobs
        numbers = self._wakeup.wait(0.0 if busy else max(0.0, self._next_tick - now))
        self._sleeping = False
        if (
            type(numbers) is bytes
            and numbers
            and numbers[0] != QUEUED
            and not busy
            and (jobs := self._one(numbers[0])) is not None
        ):
            return jobs
        for number in numbers:
            if number == QUEUED:
                self._queued = True
            elif number == LOOK:
                self._next_tick = 0.0
            elif number == NEWS:
                self._next_tick = min(self._next_tick, time.monotonic() + MOMENT)
            else:
                links = tuple(self._attending[number])  # a copy, since links may be removed at any time
                self._ready.extend(link for link in links if link not in self._ready)
        if self._queued and not self._ready and not self._jobs and (job := self._next_queued()):
            return (job,)
        for _ in range(len(self._ready)):
            link = self._ready.popleft()
            try:
                self._jobs.extend(link.on_input())
            except TransportError:
                log.exception("taking input")  # only of this link
        return [self._jobs.popleft() for _ in range(len(self._jobs))]

    def _one(self, number: int) -> Sequence[Job] | None:
        """Take the one message that the wake-up announced. None if the wake-up was for something else.

        Looking for further messages takes time, so it is done `afterwards`. Messages in the queue are different: a
        client that has got its reply often calls again before this thread would sleep.
        """
        links = tuple(self._attending[number])  # a copy, since links may be removed at any time
        if len(links) != 1:
            return None
        try:
            return links[0].on_input(one=True)
        except TransportError:
            log.exception("taking input")
            return ()

    def _next_queued(self) -> Job | None:
        """The job for the next message, unless it is the turn of the topics."""
        if self._taken == TURNS:
            self._taken = 0
            return None
        job = self._take_queued()
        self._queued = job is not None
        self._taken = self._taken + 1 if job else 0
        return job
