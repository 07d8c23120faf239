"""The components that take part in lock-step, and how their leader asks them.

LocalLink     asks the component that leads, in this process
SocketLink    asks a follower over its socket
QueryLink     asks a follower without a socket, by queries
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from ..errors import RobocompError
from ..runtime.clock import NEVER
from .balance import State
from .line import Line, connect
from .links import LocalComponent
from .pollable import PollableEvent
from .RoboCompLockstep import Counter, LockstepFollowerProxy, Report

log = logging.getLogger("robocomp.clock")

_DEADLINE = 2.0
"""Longest duration of one question in seconds."""

UNKNOWN = State(NEVER, True, -1, ())
"""A state from which all others differ, so that a component does not wait for a change."""


class Link(Protocol):
    """How the leader asks one component: by `step`, `tell` or `look`, and then by `answer` until that returns a state.

    All raise Timeout if the component does not answer in time, and another RobocompError if it is gone.
    """

    def step(self, now: int) -> None: ...

    def tell(self, now: int) -> None: ...

    def look(self, last: State) -> None: ...

    def answer(self, asking: PollableEvent | None) -> State | None:
        """The state; None if it takes longer, or if the thread of `asking`, a loop that waits for the clock, is due."""
        ...

    def counters(self) -> Sequence[Counter]: ...


class LocalLink:
    """Asks the component that leads, on the thread of its loop or on the backup thread."""

    def __init__(self, member: LocalComponent) -> None:
        self._member = member
        self._question: Callable[[PollableEvent | None], State | None] = lambda asking: UNKNOWN
        self.counters = member.counters

    def step(self, now: int) -> None:
        self._question = partial(self._member.work, now)

    def tell(self, now: int) -> None:
        self._question = lambda asking: self._member.tell(now)

    def look(self, last: State) -> None:
        self._question = partial(self._member.watch, last)

    def answer(self, asking: PollableEvent | None) -> State | None:
        return self._question(asking)


class QueryLink:
    """Asks a follower in another process that has no socket."""

    def __init__(self, proxy: LockstepFollowerProxy) -> None:
        self._proxy = proxy
        self._question: Callable[[], Report] = Report

    def step(self, now: int) -> None:
        self._question = partial(self._proxy.step, now, deadline=_DEADLINE)

    def tell(self, now: int) -> None:
        self._question = partial(self._proxy.tell, now, deadline=_DEADLINE)

    def look(self, last: State) -> None:
        self._question = partial(self._proxy.look, last.report(), deadline=_DEADLINE)

    def answer(self, asking: PollableEvent | None) -> State | None:
        return State.of(self._question())

    def counters(self) -> Sequence[Counter]:
        return self._proxy.counters(deadline=_DEADLINE)


class SocketLink:
    """Asks a follower over its socket."""

    def __init__(self, proxy: LockstepFollowerProxy, line: Line) -> None:
        self._proxy, self.line = proxy, line
        self.step, self.tell, self.look, self.answer = line.step, line.tell, line.look, line.answer

    def counters(self) -> Sequence[Counter]:
        return self._proxy.counters(deadline=_DEADLINE)


def link_to(proxy: LockstepFollowerProxy) -> SocketLink | QueryLink:
    """The link to the follower of this proxy: over its socket if that can be reached."""
    try:
        address = proxy.line(deadline=_DEADLINE)
    except RobocompError as exc:
        log.debug("no line to a follower: %s", exc)  # if it is gone, the first question finds out
        address = ""
    line = connect(address, _DEADLINE) if address else None
    return SocketLink(proxy, line) if line else QueryLink(proxy)


class Participant:
    """One component that takes part, and its latest state."""

    def __init__(self, name: str, link: Link, close: Callable[[], None] = lambda: None) -> None:
        """`close` closes what connects the middleware with it."""
        self.name, self.link, self._close = name, link, close
        self.is_local = isinstance(link, LocalLink)
        self.line = link.line if isinstance(link, SocketLink) else None
        self.state = State(NEVER, True, 0, ())
        self.version = -1
        """The version of `counters`; -1 before they are known."""
        self.counters: Sequence[Counter] = ()
        self.silent = 0
        """Number of questions that it did not answer in time."""

    @property
    def is_quick(self) -> bool:
        """Whether a question takes so little time that the loop may ask it."""
        return self.is_local or self.line is not None

    def close(self) -> None:
        """Close what connects the leader with it."""
        self.hang_up()
        self._close()

    def hang_up(self) -> None:
        """Close its socket alone: what connects the middleware ends with the component."""
        if self.line:
            self.line.close()
