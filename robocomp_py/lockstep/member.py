"""A component in lock-step: its clock, and what its leader asks of it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from ..contract.component import Port
from ..contract.interface import Verb
from ..errors import Closed, ComponentError, RobocompError
from ..runtime.clock import NEVER
from ..runtime.monitor import Threads
from ..threads import NO_THREAD, start_thread
from ..transports.base import about_to_block
from ..wire import names
from .answering import Answering
from .balance import State
from .clock import Followed, Moved
from .counts import Counts
from .handover import Handover
from .links import Reaches
from .RoboCompLockstep import (
    LOCKSTEPFOLLOWER_INTERFACE,
    LOCKSTEPLEADER_INTERFACE,
    Counter,
    LockstepLeaderProxy,
    Report,
)

if TYPE_CHECKING:
    from ..runtime.settings import Settings

log = logging.getLogger("robocomp.clock")

PATIENCE = 0.02
"""Longest time in seconds that a follower works before it reports that it is not done."""

_CALL = 0.002
"""Seconds after which a thread that waits for a reply no longer keeps others of its component from going on."""

_POLL = 0.0005
"""Seconds between two looks at whether handlers have ended."""

_SHORT = 0.0002
"""Seconds for which a question may keep others from being received, since most components are done by then."""

_AGAIN = 1.0
"""Seconds between two looks at whether the leader knows this component."""

_STUCK = 5.0
"""Seconds that closing waits for the thread."""


class AwayThreads(Threads):
    """Threads whose wait for a future is no work."""

    def __init__(self, clock: Followed) -> None:
        super().__init__()
        self._clock = clock

    def wait_for(self, future: Future[Any], timeout: float | None) -> None:
        with self._clock.away():
            super().wait_for(future, timeout)


class Member:
    """One component that follows the clock of a leader, which may be itself.

    `open`, `begin` when it is about to be ready, `wait` before its first `compute`, `close`.
    """

    def __init__(self, settings: Settings, is_idle: Callable[[], bool], is_over: Callable[[], bool]) -> None:
        """`is_idle` returns whether no code of the component runs, and `is_over` whether it is about to end."""
        assert settings.clock
        self.instance = names.whole(settings.instance, settings.namespace)
        self.leader = names.whole(settings.clock.leader, settings.namespace)
        self._is_idle, self._is_over = is_idle, is_over
        self._is_ready = False
        self._admitted = threading.Event()
        self._closing = threading.Event()
        self._proxy: LockstepLeaderProxy | None = None
        self._thread: threading.Thread | None = None
        self.clock = Followed(self._is_free)
        self.threads = AwayThreads(self.clock)
        self.counts = Counts(self.clock)
        self._answering = Answering(self.instance[1:], self)

    @property
    def handover(self) -> Handover:
        """That of a follower."""
        return self._answering.handover

    @property
    def leads(self) -> bool:
        """Whether this component is the leader."""
        return self.leader == self.instance

    def open(self, connections: Reaches) -> None:
        """Open what connects a follower with its leader."""
        if not self.leads:
            self._answering.begin()
            connections.serve(Port(Verb.IMPLEMENTS, LOCKSTEPFOLLOWER_INTERFACE), self)
            port = Port(Verb.REQUIRES, LOCKSTEPLEADER_INTERFACE, proxy=LockstepLeaderProxy)
            self._proxy, _ = connections.reach(port, self.leader)

    def begin(self) -> None:
        """From now on the clock stands still until the leader moves it."""
        self._is_ready = True
        if self._proxy:
            self._thread = threading.Thread(target=self._keep_joined, name=f"{self.instance[1:]}-clock", daemon=True)
            if not start_thread(self._thread):
                raise ComponentError(f"the clock cannot be followed: {NO_THREAD}")

    def wait(self) -> None:
        """Wait until the leader has moved the clock for the first time, or the component is about to end."""
        while not self._admitted.wait(0.1):
            if self._is_over():
                return

    def close(self) -> None:
        """Take part no longer."""
        self._closing.set()
        if self._proxy and self._admitted.is_set():
            try:
                self._proxy.leave(self.instance, deadline=1.0)
            except RobocompError as exc:
                log.debug("the leader was not told that %s ends: %s", self.instance[1:], exc)
        self._answering.close()
        if self._thread and self._thread.ident:
            self._thread.join(_STUCK)

    # What the leader asks.

    def LockstepFollower_step(self, now: int) -> Report:
        return (self.work(now) or self._state()).report()

    def LockstepFollower_tell(self, now: int) -> Report:
        return self.tell(now).report()

    def LockstepFollower_look(self, last: Report) -> Report:
        return self.watch(State.of(last)).report()

    def LockstepFollower_counters(self) -> list[Counter]:
        return self.counters()

    def LockstepFollower_line(self) -> str:
        return self._answering.address

    def work(self, now: int, asking: threading.Event | None = None) -> State | None:
        """Do all that is due until an instant; None, before that is done, if the calling thread has something to do.

        That is the case if the event `asking`, by which it waits for the clock, is set, or if it is due itself.
        """
        clock, counts = self.clock, self.counts
        if not self._admitted.is_set():
            clock.show(now)  # first: it is what the component sees when it begins
            self._admitted.set()
        begun = quiet = elapsed = 0.0  # the machine is asked for its time only if this takes longer
        while True:
            is_busy = not self._is_idle()
            if not is_busy and (not counts.calls or elapsed - quiet > _CALL):
                moved = clock.proceed(now, asking)
                if moved is Moved.QUIETLY:
                    return State(clock.due_next, True, counts.version, counts.numbers(), counts.made)
                if moved is Moved.TO_ASKING:
                    return None
                is_busy = moved is Moved.NOT
            else:
                clock.show(now)
                is_busy = is_busy or not clock.is_still
            if asking and asking.is_set():
                return None
            if not begun:
                begun = quiet = elapsed = time.monotonic()
            if elapsed - begun > PATIENCE or (is_busy and self._is_over()):
                return self._state()
            if elapsed - begun > _SHORT:
                about_to_block()
            clock.wait_change(_POLL)
            elapsed = time.monotonic()
            if is_busy:
                quiet = elapsed

    def tell(self, now: int) -> State:
        """Show an instant to handlers. What is due waits for `work`."""
        self.clock.show(now)
        return self._state()

    def watch(self, last: State, asking: threading.Event | None = None) -> State:
        """Wait until its state differs from the last one, but not long.

        It does not wait if the event `asking`, by which the calling thread waits, is set.
        """
        begun = time.monotonic()
        while (
            (now := self._state()) == last and time.monotonic() - begun < PATIENCE and not (asking and asking.is_set())
        ):
            about_to_block()
            self.clock.wait_change(_POLL)
        return now

    def counters(self) -> list[Counter]:
        """What the numbers of its states count."""
        return list(self.counts.counters)

    @property
    def _is_settled(self) -> bool:
        # Until the clock is moved for the first time, the loop waits for that, and not for the clock.
        return self._is_idle() and (self.clock.is_still or not self._admitted.is_set())

    def _state(self) -> State:
        if self._is_over():  # its threads end; those that wait follow the machine
            return State(NEVER, True, self.counts.version, self.counts.numbers(), self.counts.made)
        is_settled = self._is_settled  # first: what begins after it is counted below
        return State(self.clock.due, is_settled, self.counts.version, self.counts.numbers(), self.counts.made)

    def _is_free(self) -> bool:
        return not self._is_ready or self._is_over()

    # Joining.

    def _keep_joined(self) -> None:
        """Join, and join again if the leader was restarted."""
        told = ""
        while not self._closing.is_set() and not self._is_over():
            assert self._proxy
            try:
                if not self._proxy.hasJoined(self.instance, deadline=_AGAIN):
                    self._proxy.join(self.instance, self.clock.now(), deadline=_AGAIN)
                told = ""
            except Closed:
                return
            except RobocompError as exc:
                if not told and self._admitted.is_set():
                    log.warning("the clock stands still: %s, which leads it, does not answer", self.leader[1:])
                told = str(exc)
            self._closing.wait(_AGAIN if self._admitted.is_set() else _AGAIN / 10)
