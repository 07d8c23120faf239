"""What the leader of a clock does when a follower is gone, or a message is."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.component import Port
from robocomp_py.errors import Timeout, TransportError, Unreachable
from robocomp_py.lockstep.leader import Leader
from robocomp_py.lockstep.member import Member
from robocomp_py.lockstep.RoboCompLockstep import Counter, Report, Way
from robocomp_py.runtime.clock import NEVER, SECOND
from robocomp_py.runtime.settings import ClockSettings, Settings
from robocomp_py.testing.patience import wait_until

AT_ONCE = threading.Lock()
"""Held while the numbers of two followers change, so that nothing happens in between."""


class Follower:
    """Stands for the proxy of one: it has something to do each second, unless `error` is raised instead."""

    def __init__(self, counters: list[Counter]) -> None:
        self._counters = counters
        self.told = 0, [0] * len(counters)
        """The version of its counters, and their numbers."""
        self.calls = 0
        """Number of calls of others that it has made."""
        self.steps: list[int] = []
        self.error: TransportError | None = None
        self.closed = 0
        """Number of connections with it that were closed."""

    def close(self) -> None:
        self.closed += 1

    def line(self, *, deadline: float) -> str:
        return ""

    def counters(self, *, deadline: float) -> list[Counter]:
        return self._counters

    def step(self, now: int, *, deadline: float) -> Report:
        self.steps.append(now)
        return self.look(Report(), deadline=deadline)

    def tell(self, now: int, *, deadline: float) -> Report:
        return self.look(Report(), deadline=deadline)

    def look(self, last: Report, *, deadline: float) -> Report:
        if self.error:
            raise self.error
        due = (self.steps[-1] // SECOND + 1) * SECOND if self.steps else NEVER
        with AT_ONCE:
            version, numbers = self.told
        return Report(due, True, version, self.calls, np.array(numbers, np.int64))


class Connections:
    """Stands for those of a component."""

    def __init__(self, followers: dict[str, Follower]) -> None:
        self._followers = followers

    def serve(self, port: Port, handlers: object) -> None: ...

    def reach(self, port: Port, instance: str) -> tuple[Any, Callable[[], None]]:
        follower = self._followers[instance]
        return follower, follower.close


@contextmanager
def leader(followers: dict[str, Follower], lost: str = "keep") -> Iterator[list[str]]:
    """A leader at work; what it fails of is in the list."""
    failures: list[str] = []
    names = tuple(followers)
    settings = Settings("sun", clock=ClockSettings("sun", names, speed=0.0, lost=lost))
    made = Leader(settings, Member(settings, lambda: True, lambda: False), failures.append)
    connections: Any = Connections(followers)
    made.open(connections)
    for name in followers:
        made.membership.LockstepLeader_join(name, 0)
    made.begin()
    try:
        yield failures
    finally:
        made.close()


def test_followers_are_asked_at_the_same_instants() -> None:
    followers = {"/a": Follower([]), "/b": Follower([])}
    with leader(followers):
        wait_until(lambda: len(followers["/b"].steps) > 5)
    assert followers["/a"].steps[:5] == followers["/b"].steps[:5] == [0, *(SECOND * each for each in range(1, 5))]


def test_the_clock_goes_on_without_a_follower_that_is_gone(caplog: pytest.LogCaptureFixture) -> None:
    followers = {"/a": Follower([]), "/b": Follower([])}
    with leader(followers) as failures:
        wait_until(lambda: len(followers["/b"].steps) > 5)
        followers["/b"].error = Unreachable("no server")
        reached = len(followers["/a"].steps)
        wait_until(lambda: len(followers["/a"].steps) > reached + 5)
    assert (followers["/a"].closed, followers["/b"].closed) == (0, 1)
    assert "b, which follows this clock, is gone (no server); the clock goes on without it" in caplog.text
    assert not failures


def test_the_leader_fails_with_a_follower_if_the_network_says_so() -> None:
    followers = {"/a": Follower([]), "/b": Follower([])}
    with leader(followers, lost="stop") as failures:
        wait_until(lambda: len(followers["/b"].steps) > 5)
        followers["/b"].error = Unreachable("no server")
        wait_until(lambda: failures)
        reached = len(followers["/a"].steps)
    assert failures == ["b, which follows this clock, is gone (no server)"]
    assert len(followers["/a"].steps) <= reached + 1


def test_a_follower_may_be_late_twice_but_not_three_times(caplog: pytest.LogCaptureFixture) -> None:
    class Late(Follower):
        late = 0

        def step(self, now: int, *, deadline: float) -> Report:
            if now >= 2 * SECOND and self.late < 2:
                self.late += 1
                raise Timeout("no answer")
            return super().step(now, deadline=deadline)

    followers = {"/a": Late([]), "/b": Follower([])}
    with leader(followers):
        wait_until(lambda: len(followers["/a"].steps) > 5)
        assert "follows this clock" not in caplog.text
        followers["/a"].error = Timeout("no answer")
        wait_until(lambda: "a, which follows this clock, does not answer" in caplog.text)


def test_a_lost_message_is_told_once_and_not_waited_for_forever(caplog: pytest.LogCaptureFixture) -> None:
    topic = "a/LaserPub/push"
    followers = {"/a": Follower([Counter(Way.Publishes, [topic])]), "/b": Follower([Counter(Way.Hears, [topic])])}
    with leader(followers):
        wait_until(lambda: len(followers["/a"].steps) > 2)
        followers["/a"].told = 0, [1]
        wait_until(lambda: f"a message of {topic} got lost" in caplog.text)
        reached = len(followers["/b"].steps)
        wait_until(lambda: len(followers["/b"].steps) > reached + 2)


def test_messages_that_were_sent_after_the_sender_was_asked_are_not_lost(caplog: pytest.LogCaptureFixture) -> None:
    """By a thread of its own, for example, that the clock does not stop."""
    topic = "a/LaserPub/push"
    sender = Follower([Counter(Way.Publishes, [topic])])

    class Hearing(Follower):
        def step(self, now: int, *, deadline: float) -> Report:
            with AT_ONCE:
                sender.told = self.told = 0, [len(self.steps)]
            return super().step(now, deadline=deadline)

    followers = {"/a": sender, "/b": Hearing([Counter(Way.Hears, [topic])])}
    with leader(followers):
        wait_until(lambda: len(followers["/b"].steps) > 5)
    assert "lost" not in caplog.text


def test_what_a_handler_sends_during_a_call_is_handled_before_the_next_one_computes() -> None:
    """`a` calls `b`, whose handler publishes to `c`, which handles messages only while it is looked at."""
    topic = "b/LaserPub/push"
    serving = Follower([Counter(Way.Publishes, [topic])])
    behind: list[int] = []
    """Number of messages that `c` had not handled, each time that it computed."""

    class Calling(Follower):
        def step(self, now: int, *, deadline: float) -> Report:
            self.calls += 1
            with AT_ONCE:
                serving.told = 0, [self.calls]
            return super().step(now, deadline=deadline)

    class Hearing(Follower):
        def step(self, now: int, *, deadline: float) -> Report:
            behind.append(serving.told[1][0] - self.told[1][0])
            self.steps.append(now)
            return super().look(Report(), deadline=deadline)

        def look(self, last: Report, *, deadline: float) -> Report:
            with AT_ONCE:
                self.told = serving.told
            return super().look(last, deadline=deadline)

    with leader({"/a": Calling([]), "/c": Hearing([Counter(Way.Hears, [topic])]), "/b": serving}):
        wait_until(lambda: len(behind) > 5)
    assert behind[:6] == [0, 0, 0, 0, 0, 0]


def test_a_follower_that_was_restarted_at_once_has_lost_no_message(caplog: pytest.LogCaptureFixture) -> None:
    """Its numbers begin at 0 again, its version elsewhere, and a call that is repeated hides that it was away."""
    topic = "a/LaserPub/push"
    followers = {"/a": Follower([Counter(Way.Publishes, [topic])]), "/b": Follower([Counter(Way.Hears, [topic])])}
    with leader(followers):
        wait_until(lambda: len(followers["/a"].steps) > 2)
        with AT_ONCE:
            followers["/a"].told = followers["/b"].told = 0, [5]
        reached = len(followers["/b"].steps)
        wait_until(lambda: len(followers["/b"].steps) > reached + 2)
        followers["/b"].told = 1 << 20, [0]
        reached = len(followers["/b"].steps)
        wait_until(lambda: len(followers["/b"].steps) > reached + 2)
    assert "lost" not in caplog.text


def test_a_restarted_follower_takes_the_place_of_the_former_one() -> None:
    followers = {"/a": Follower([])}
    settings = Settings("sun", clock=ClockSettings("sun", ("/a",), speed=0.0))
    made = Leader(settings, Member(settings, lambda: True, lambda: False), lambda message: None)
    connections: Any = Connections(followers)
    made.open(connections)
    made.membership.LockstepLeader_join("/a", 0)
    assert made.membership.LockstepLeader_hasJoined("/a")
    made.begin()
    try:
        wait_until(lambda: len(followers["/a"].steps) > 3)
        first, followers["/a"] = followers["/a"], Follower([])
        made.membership.LockstepLeader_join("/a", 0)
        wait_until(lambda: len(followers["/a"].steps) > 3)
        assert followers["/a"].steps[0] >= first.steps[3]
        assert first.closed == 1
    finally:
        made.close()


def test_a_leader_goes_on_from_the_latest_time_of_its_followers() -> None:
    """Also at the speed of the clock on the wall: it does not wait until that time has passed."""
    follower = Follower([])
    settings = Settings("sun", clock=ClockSettings("sun", ("/moon",), speed=1.0))
    made = Leader(settings, Member(settings, lambda: True, lambda: False), lambda why: None)
    connections: Any = Connections({"/moon": follower})
    made.open(connections)
    made.membership.LockstepLeader_join("/moon", 60 * 60 * SECOND)
    made.begin()
    try:
        wait_until(lambda: 60 * 60 * SECOND + SECOND in follower.steps)
    finally:
        made.close()
