"""Which components take part in lock-step, and which want to join or leave.

Followers ask on threads of the middleware. The leader takes what they asked for between two instants.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence

from .participants import Participant


class Membership:
    """The participants of one leader. Safe to use from any thread; the leader alone adds and removes them."""

    def __init__(self, own: str, followers: Iterable[str]) -> None:
        """`own` is the component that leads; `followers` are those that the network names, in its order."""
        self._own, self._followers = own, tuple(followers)
        self._order = {name: number for number, name in enumerate([own, *self._followers])}
        self._lock = threading.Lock()
        self._joining: dict[str, int] = {}
        """The times that their clocks show."""
        self._leaving: set[str] = set()
        self.participants: Sequence[Participant] = ()
        """Those that take part now, in the order in which they are asked. Replaced as a whole."""
        self.news = threading.Event()
        """Set when a follower wants to join."""

    # What followers ask.

    def LockstepLeader_join(self, instance: str, now: int) -> None:
        with self._lock:
            self._leaving.discard(instance)
            self._joining[instance] = now
        self.news.set()

    def LockstepLeader_hasJoined(self, instance: str) -> bool:
        with self._lock:
            return instance in self._joining or any(each.name == instance for each in self.participants)

    def LockstepLeader_leave(self, instance: str) -> None:
        with self._lock:
            self._joining.pop(instance, None)
            self._leaving.add(instance)

    # What the leader asks.

    @property
    def has_requests(self) -> bool:
        """Whether a component wants to join or leave."""
        return bool(self._joining or self._leaving)

    @property
    def absent(self) -> list[str]:
        """The followers that the network names and that have not asked to join yet."""
        with self._lock:
            return [name for name in self._followers if name not in self._joining and name != self._own]

    @property
    def followers(self) -> list[str]:
        """The names of those that take part, without that of the leader."""
        return [each.name for each in self.participants if each.name != self._own]

    def latest(self, now: int) -> int:
        """The latest time that a clock shows, `now` included."""
        with self._lock:
            return max([now, *self._joining.values()])

    def take_changes(self) -> tuple[Mapping[str, int], list[Participant]]:
        """Those that join, with the times of their clocks, and the participants that remain.

        Participants that left, or that join again because they were restarted, are closed.
        """
        with self._lock:
            joining, self._joining = self._joining, {}
            leaving, self._leaving = self._leaving, set()
        gone = [each for each in self.participants if each.name in joining or each.name in leaving]
        for each in gone:
            each.close()
        return joining, [each for each in self.participants if each not in gone]

    def replace(self, participants: Iterable[Participant]) -> None:
        """From now on these take part, in the order of the network; others come after, by name."""
        last = len(self._order)
        ordered = tuple(sorted(participants, key=lambda each: (self._order.get(each.name, last), each.name)))
        with self._lock:
            self.participants = ordered

    def drop(self, participant: Participant) -> bool:
        """Go on without it, and close it. Returns whether it had asked to leave."""
        with self._lock:
            self.participants = tuple(each for each in self.participants if each is not participant)
            has_left = participant.name in self._leaving
        participant.close()
        return has_left

    def hang_up(self) -> None:
        """Close the sockets of all, since the component ends."""
        for each in self.participants:
            each.hang_up()
