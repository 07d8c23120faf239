"""The followers of a clock that pass a question on from one to the next."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest

from robocomp_py.contract.component import Port
from robocomp_py.errors import Timeout, Unreachable
from robocomp_py.lockstep.answering import Answering
from robocomp_py.lockstep.balance import State
from robocomp_py.lockstep.chain import Chain
from robocomp_py.lockstep.leader import Leader
from robocomp_py.lockstep.line import HEAR, TELL, Line, connect
from robocomp_py.lockstep.member import Member
from robocomp_py.lockstep.RoboCompLockstep import Counter, Way
from robocomp_py.runtime.clock import SECOND
from robocomp_py.runtime.settings import ClockSettings, Settings
from robocomp_py.testing.patience import SOON, wait_until

NEWS = [Counter(Way.Publishes, ["/c/LaserPub/push"])]


class Follower:
    """Has something to do each second. Stands for its proxy, too."""

    def __init__(self, name: str, steps: list[tuple[str, int]]) -> None:
        self.name, self._steps = name, steps
        self.sent = 0
        self.may_work = threading.Event()
        self.may_work.set()
        self.answering = Answering(name, self)
        self.answering.begin()
        self.due = 0

    def work(self, now: int, asking: threading.Event | None) -> State:
        assert self.may_work.wait(SOON)
        if now >= self.due:
            self._steps.append((self.name, now))
            self.due = (now // SECOND + 1) * SECOND
        return State(self.due, True, 0, (self.sent,))

    def watch(self, last: State, asking: threading.Event | None) -> State:
        return State(self.due, True, 0, (self.sent,))

    def line(self, *, deadline: float) -> str:
        return self.answering.address

    def counters(self, *, deadline: float) -> list[Counter]:
        return NEWS

    def close(self) -> None:
        self.may_work.set()
        self.answering.close()


@contextlib.contextmanager
def three() -> Iterator[list[Follower]]:
    """Three followers, which note in the list `steps` what they do."""
    steps: list[tuple[str, int]] = []
    with contextlib.ExitStack() as undo:
        followers = [Follower(name, steps) for name in ("/a", "/b", "/c")]
        for each in followers:
            undo.callback(each.close)
        yield followers


@contextlib.contextmanager
def chained(followers: list[Follower]) -> Iterator[tuple[Chain, list[Line]]]:
    """Their lines, connected as a leader does."""
    with contextlib.ExitStack() as undo:
        lines = []
        for each in followers:
            line = connect(each.answering.address, SOON)
            assert line
            lines.append(undo.enter_context(contextlib.closing(line)))
        for teller, hearer in pairwise(lines):
            ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with ends[0], ends[1]:
                hearer.take(HEAR, ends[0], 0)
                teller.take(TELL, ends[1], 0)
        yield Chain(lines), lines


@contextlib.contextmanager
def leading(followers: list[Follower], first: int = 3) -> Iterator[Leader]:
    """A leader of the first of them at work, whose own component has nothing to do."""

    class Connections:
        def serve(self, port: Port, handlers: object) -> None: ...

        def reach(self, port: Port, instance: str) -> tuple[Any, Callable[[], None]]:
            return next(each for each in followers if each.name == instance), lambda: None

    names = tuple(each.name for each in followers[:first])
    settings = Settings("sun", clock=ClockSettings("sun", names, speed=0.0))
    made = Leader(settings, Member(settings, lambda: True, lambda: False), lambda why: None)
    connections: Any = Connections()
    made.open(connections)
    for name in names:
        made.LockstepLeader_join(name, 0)
    made.begin()
    try:
        yield made
    finally:
        made.close()


def test_one_question_reaches_all_in_their_order() -> None:
    with three() as followers, chained(followers) as (chain, lines):
        answer = chain.step(lines[0], 2, SECOND)
        assert (answer.dues, answer.state.due) == ([2 * SECOND, 2 * SECOND], 2 * SECOND)
        assert followers[0]._steps[-3:] == [("/a", SECOND), ("/b", SECOND), ("/c", SECOND)]


def test_a_question_goes_no_further_than_it_was_told() -> None:
    with three() as followers, chained(followers) as (chain, lines):
        assert len(chain.step(lines[1], 1, SECOND).dues) == 1
        assert len(chain.step(lines[0], 1, 2 * SECOND).dues) == 1
        assert [each.due for each in followers] == [3 * SECOND, 3 * SECOND, 2 * SECOND]


def test_a_follower_that_has_sent_something_answers_instead_of_passing_the_question_on() -> None:
    with three() as followers, chained(followers) as (chain, lines):
        followers[1].sent = 1
        assert chain.step(lines[0], 2, SECOND)[1:] == ([2 * SECOND], State(2 * SECOND, True, 0, (1,)))
        assert followers[2].due == SECOND, "it was not asked"
        assert len(chain.step(lines[0], 2, 2 * SECOND).dues) == 2, "the leader knows it now"


def test_a_follower_that_is_gone_or_silent_is_told() -> None:
    with three() as followers, chained(followers) as (chain, lines):
        followers[1].may_work.clear()
        with pytest.raises(Timeout):
            chain.step(lines[0], 2, SECOND)
        followers[1].may_work.set()
        followers[1].close()
        with pytest.raises(Unreachable):
            chain.step(lines[1], 1, 2 * SECOND)


def test_a_question_that_arrives_after_a_later_one_is_ignored() -> None:
    """The leader waits for its answer no longer, so it would not know what that tells."""
    with three() as followers, chained(followers) as (chain, lines):
        followers[0].may_work.clear()
        with pytest.raises(Timeout):
            chain.step(lines[0], 2, SECOND)
        assert lines[1].step(2 * SECOND).due == 3 * SECOND
        followers[1].sent = 1
        followers[0].may_work.set()
        lines[0].step(2 * SECOND)  # it has passed the first question on before it answers this one
        assert lines[1].step(2 * SECOND).numbers == (1,)
        assert followers[2].due == SECOND, "the question went no further"


def test_the_clock_goes_on_in_the_same_order_when_one_of_the_chain_is_gone(caplog: pytest.LogCaptureFixture) -> None:
    with three() as followers, leading(followers) as leader:
        steps = followers[0]._steps
        wait_until(lambda: leader._chain is not None and len(steps) > 30)
        followers[1].close()
        wait_until(lambda: "b, which follows this clock, is gone" in caplog.text)
        wait_until(lambda: leader._chain is not None)
        reached = len(steps)
        wait_until(lambda: len(steps) > reached + 10)
    assert [name for name, _ in steps[:9]] == ["/a", "/b", "/c"] * 3
    begin = next(number for number, (name, _) in enumerate(steps) if number >= reached and name == "/a")
    (one, then), (other, at) = steps[begin : begin + 2]
    assert (one, other, then) == ("/a", "/c", at)


def test_one_that_joins_later_becomes_a_part_of_the_chain() -> None:
    with three() as followers, leading(followers, first=2) as leader:
        steps = followers[0]._steps
        wait_until(lambda: len(steps) > 10)
        leader.LockstepLeader_join("/c", 0)
        wait_until(lambda: steps[-1][0] == "/c")
        reached = len(steps)
        wait_until(lambda: len(steps) > reached + 10)
        assert leader._chain
        assert len(leader._chain._lines) == 3
    assert [name for name, _ in steps[reached : reached + 6]] == ["/a", "/b", "/c"] * 2
