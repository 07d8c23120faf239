"""The socket by which the leader of a clock asks a follower."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

import pytest

from robocomp_py.errors import Timeout, Unreachable
from robocomp_py.lockstep.balance import State
from robocomp_py.lockstep.line import Answering, Line, connect
from robocomp_py.runtime.clock import NEVER
from robocomp_py.testing.patience import SOON

A_STATE = State(NEVER, True, -(2**31), (0, -1, 2**40))


class Follower:
    """Answers each step with its instant, and each look with the state that it was told."""

    def __init__(self) -> None:
        self.may_answer = threading.Event()
        self.may_answer.set()

    def step(self, now: int) -> State:
        assert self.may_answer.wait(SOON)
        return State(now, False, 7, ())

    def look(self, last: State) -> State:
        return last


@contextlib.contextmanager
def answering(follower: Follower) -> Iterator[Answering]:
    made = Answering("follower", follower)
    made.begin()
    try:
        yield made
    finally:
        made.close()


@contextlib.contextmanager
def asking(answers: Answering, deadline: float = SOON) -> Iterator[Line]:
    line = connect(answers.address, deadline)
    assert line
    with contextlib.closing(line):
        yield line


def test_instants_and_states_arrive_as_they_were_sent() -> None:
    with answering(Follower()) as answers, asking(answers) as line:
        assert [line.step(now) for now in (0, 2**62)] == [State(0, False, 7, ()), State(2**62, False, 7, ())]
        assert line.look(A_STATE) == A_STATE


def test_a_follower_that_is_gone_is_told_at_once() -> None:
    with answering(Follower()) as answers, asking(answers) as line:
        line.step(1)
        answers.close()
        with pytest.raises(Unreachable, match="the connection has ended"):
            line.step(2)


def test_an_answer_that_comes_too_late_is_not_taken_for_that_of_the_next_question() -> None:
    follower = Follower()
    with answering(follower) as answers, asking(answers, deadline=0.05) as line:
        follower.may_answer.clear()
        with pytest.raises(Timeout):
            line.step(1)
        follower.may_answer.set()
        due = None
        while due is None:  # under load, further answers may be late, too
            with contextlib.suppress(Timeout):
                due = line.step(2).due
        assert due == 2


def test_another_leader_may_ask_after_the_first_one() -> None:
    with answering(Follower()) as answers:
        for now in (1, 2):
            with asking(answers) as line:
                assert line.step(now).due == now


def test_there_is_no_line_to_an_address_at_which_nothing_listens() -> None:
    assert connect("robocomp-clock-nothing", SOON) is None
    with answering(Follower()) as answers:
        pass
    assert connect(answers.address, SOON) is None
