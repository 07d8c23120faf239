"""The part of a component that keeps it in lock-step with its network."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from .clock import Followed
from .counts import Counts
from .leader import Leader
from .links import Reaches
from .member import Member

if TYPE_CHECKING:
    from ..runtime.monitor import Threads
    from ..runtime.settings import Settings


class Lockstep:
    """A member and, in the component that leads, the leader. Called in the order of these methods."""

    def __init__(
        self,
        settings: Settings,
        is_idle: Callable[[], bool],
        is_over: Callable[[], bool],
        fail: Callable[[str], None],
    ) -> None:
        """`is_idle` returns whether no code of the component runs, and `is_over` whether it is about to end.

        `fail` makes it fail.
        """
        self._member = Member(settings, is_idle, is_over)
        self._leader = Leader(settings, self._member, fail) if self._member.leads else None
        handover = self._leader.handover if self._leader else self._member.handover
        self._member.clock.pause = handover.wait
        self.wake: threading.Event = handover.wake
        """The event for which the loop of the component waits."""

    @property
    def clock(self) -> Followed:
        return self._member.clock

    @property
    def threads(self) -> Threads:
        """Those of the component's monitor."""
        return self._member.threads

    @property
    def counts(self) -> Counts:
        return self._member.counts

    def open(self, connections: Reaches) -> None:
        """Open the links to the others."""
        self._member.open(connections)
        if self._leader:
            self._leader.open(connections)

    def begin(self) -> None:
        """From now on the clock stands still until it is moved."""
        self._member.begin()
        if self._leader:
            self._leader.begin()

    def wait(self) -> None:
        """Wait until the clock is moved for the first time, or the component is about to end."""
        self._member.wait()

    def close(self) -> None:
        """Take part no longer."""
        if self._leader:
            self._leader.close()
        self._member.close()
