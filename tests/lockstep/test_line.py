"""The socket by which the leader of a clock asks a follower."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from functools import partial

import pytest

from robocomp_py.errors import Timeout, Unreachable
from robocomp_py.lockstep.answering import Answering
from robocomp_py.lockstep.balance import State
from robocomp_py.lockstep.cores import ANY_CORE
from robocomp_py.lockstep.line import Line, connect
from robocomp_py.runtime.clock import NEVER
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import about_to_block

A_STATE = State(NEVER, True, -(2**31), (0, -1, 2**40))


class Follower:
    """Answers each step with its instant, and each look with the state that it was told."""

    def __init__(self) -> None:
        self.may_answer = threading.Event()
        self.may_answer.set()
        self.answered_by: list[int] = []
        """The threads that answered."""
        self.calls: Callable[[], object] | None = None
        """Called, once, instead of answering a step."""

    def work(self, now: int, asking: threading.Event | None) -> State | None:
        assert self.may_answer.wait(SOON)
        self.answered_by.append(threading.get_ident())
        if self.calls:
            call, self.calls = self.calls, None
            call()
        return None if asking and asking.is_set() else State(now, False, 7, ())

    def tell(self, now: int) -> State:
        return State(now, True, 8, ())

    def watch(self, last: State, asking: threading.Event | None) -> State:
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
def waiting(answers: Answering) -> Iterator[Loop]:
    """A thread that waits for its event, as the loop of a component does."""
    loop = Loop(answers)
    loop.start()
    try:
        yield loop
    finally:
        loop.is_over = True
        loop.may_work.set()
        loop.join(SOON)
        assert not loop.is_alive()


class Loop(threading.Thread):
    def __init__(self, answers: Answering) -> None:
        super().__init__(name="loop")
        self._answers = answers
        self.is_over = False
        self.works = 0
        """How often its event was set."""
        self.may_work = threading.Event()
        """While it is not set, work takes long."""
        self.may_work.set()
        self.blocks = False
        """Whether its work announces that it blocks."""
        self.cores: list[set[int]] = []
        """On which it could run when it worked."""

    def run(self) -> None:
        handover = self._answers.handover
        wake = handover.wake
        while not self.is_over:
            if handover.wait(wake, 0.01):
                wake.clear()
                self.works += 1
                self.cores.append(os.sched_getaffinity(0))
                if self.blocks:
                    about_to_block()
                assert self.may_work.wait(SOON)


def until_asked(line: Asking, follower: Follower, thread: threading.Thread) -> None:
    """Ask until this thread answers."""

    def is_asked() -> bool:
        line.step(0)
        return follower.answered_by[-1] == thread.ident

    wait_until(is_asked)


class Asking:
    """Asks, and waits for the answer."""

    def __init__(self, line: Line) -> None:
        self._line = line

    def tell_core(self, core: int) -> None:
        """From now on, questions tell that the leader's loop waits there."""
        self._line.core = core

    def step(self, now: int) -> State:
        self._line.step(now)
        return self._answer()

    def tell(self, now: int) -> State:
        self._line.tell(now)
        return self._answer()

    def look(self, last: State) -> State:
        self._line.look(last)
        return self._answer()

    def _answer(self) -> State:
        while (state := self._line.answer()) is None:
            pass
        return state


@contextlib.contextmanager
def asking(answers: Answering, deadline: float = SOON) -> Iterator[Asking]:
    line = connect(answers.address, deadline)
    assert line
    with contextlib.closing(line):
        yield Asking(line)


def test_instants_and_states_arrive_as_they_were_sent() -> None:
    with answering(Follower()) as answers, asking(answers) as line:
        assert [line.step(now) for now in (0, 2**62)] == [State(0, False, 7, ()), State(2**62, False, 7, ())]
        assert line.tell(3) == State(3, True, 8, ())
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


def test_a_loop_that_waits_answers_by_itself() -> None:
    follower = Follower()
    with answering(follower) as answers, asking(answers) as line, waiting(answers) as loop:
        until_asked(line, follower, loop)
        for now in range(100):
            assert line.step(now).due == now
        assert set(follower.answered_by[-100:]) == {loop.ident}
        assert line.look(A_STATE) == A_STATE


def test_a_loop_whose_event_is_set_by_a_question_works_and_then_answers_it() -> None:
    follower = Follower()
    with answering(follower) as answers, asking(answers) as line, waiting(answers) as loop:
        until_asked(line, follower, loop)
        before = loop.works
        follower.calls = answers.handover.wake.set
        assert line.step(5) == State(5, False, 7, ())
        assert loop.works == before + 1


@pytest.mark.parametrize("blocks", [True, False])
def test_the_question_is_answered_by_another_thread_while_the_loop_works(blocks: bool) -> None:
    follower = Follower()
    with answering(follower) as answers, asking(answers) as line, waiting(answers) as loop:
        until_asked(line, follower, loop)
        loop.blocks = blocks
        loop.may_work.clear()
        follower.calls = answers.handover.wake.set
        assert line.step(6).due == 6
        assert follower.answered_by[-1] != loop.ident
        assert line.step(7).due == 7
        loop.blocks = False
        loop.may_work.set()
        until_asked(line, follower, loop)


def test_an_event_ends_the_wait_of_a_loop_that_receives() -> None:
    follower = Follower()
    with answering(follower) as answers, asking(answers) as line, waiting(answers) as loop:
        until_asked(line, follower, loop)
        before = loop.works
        answers.handover.wake.set()
        wait_until(lambda: loop.works > before)


def test_a_loop_that_receives_is_there_for_the_next_leader_too() -> None:
    follower = Follower()
    with answering(follower) as answers, waiting(answers) as loop:
        for _ in range(2):
            with asking(answers) as line:
                until_asked(line, follower, loop)


def test_a_loop_waits_on_the_core_of_the_leader_and_works_on_all() -> None:
    every = os.sched_getaffinity(0)
    follower = Follower()
    with answering(follower) as answers, asking(answers) as line, waiting(answers) as loop:

        def waits_on(cores: set[int]) -> bool:
            """After it has worked."""
            follower.calls = answers.handover.wake.set
            line.step(1)
            return os.sched_getaffinity(loop.native_id or 0) == cores

        for core in every:
            line.tell_core(core)
            wait_until(partial(waits_on, {core}))
        line.tell_core(ANY_CORE)
        wait_until(partial(waits_on, every))
    assert all(cores == every for cores in loop.cores)


def test_a_core_on_which_the_loop_may_not_run_is_ignored() -> None:
    follower = Follower()
    with answering(follower) as answers, asking(answers) as line, waiting(answers) as loop:
        until_asked(line, follower, loop)
        line.tell_core(10_000)
        until_asked(line, follower, loop)
        assert os.sched_getaffinity(loop.native_id or 0) == os.sched_getaffinity(0)
