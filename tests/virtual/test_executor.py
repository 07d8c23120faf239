"""Events run one after the other, in an order that depends on nothing else."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from functools import partial

import pytest

from robocomp_py.errors import Closed, ComponentError
from robocomp_py.virtual.executor import Executor, Pause

FOREVER = 10**18


@pytest.fixture
def executor() -> Iterator[Executor]:
    made = Executor()
    yield made
    made.close()
    assert not any(thread.name.startswith("simulation-") for thread in threading.enumerate())


class Ticker:
    """Something with an event every `period` ns."""

    def __init__(self, period: int, tick: Callable[[], object]) -> None:
        self._period, self._next, self._tick = period, 0, tick

    def due(self) -> int:
        return self._next

    def step(self) -> None:
        self._next += self._period
        self._tick()


def nothing_left() -> bool:
    return False


def test_events_run_by_time_then_in_the_order_in_which_they_were_added(executor: Executor) -> None:
    story: list[tuple[int, str]] = []
    executor.add(Ticker(20, lambda: story.append((executor.now, "slow"))))
    executor.add(Ticker(10, lambda: story.append((executor.now, "quick"))))
    executor.at(10, lambda: story.append((executor.now, "once")))
    assert not executor.run(nothing_left, 20)
    assert story == [(0, "slow"), (0, "quick"), (10, "quick"), (10, "once"), (20, "slow"), (20, "quick")]
    assert executor.now == 20


def test_what_an_event_asks_for_is_done_before_the_next_event(executor: Executor) -> None:
    story: list[str] = []

    def ask() -> None:
        executor.do(lambda: story.append("first"))
        executor.do(lambda: story.append("second"))
        story.append("asked")

    executor.add(Ticker(10, ask))
    executor.add(Ticker(10, lambda: story.append("next")))
    executor.run(nothing_left, 0)
    assert story == ["asked", "first", "second", "next"]


def test_a_run_ends_at_the_event_after_which_its_condition_holds(executor: Executor) -> None:
    ticks: list[int] = []
    executor.add(Ticker(10, lambda: ticks.append(executor.now)))
    assert executor.run(lambda: len(ticks) == 3, FOREVER)
    assert ticks == [0, 10, 20]
    assert executor.run(lambda: len(ticks) == 3, FOREVER)
    assert not executor.run(lambda: len(ticks) == 9, 40)
    assert ticks == [0, 10, 20, 30, 40]


def test_without_events_the_clock_stays(executor: Executor) -> None:
    assert not executor.run(nothing_left, 50)
    assert executor.now == 0


def test_waits_need_not_end_in_the_order_in_which_they_began(executor: Executor) -> None:
    story: list[tuple[int, str]] = []

    def wait(name: str, until: int) -> None:
        story.append((executor.now, f"{name} begins"))
        assert not Pause(executor).wait(until)
        story.append((executor.now, f"{name} ends"))

    executor.do(lambda: wait("long", 30))
    executor.do(lambda: wait("short", 10))
    executor.at(20, lambda: story.append((20, "between")))
    executor.run(nothing_left, FOREVER)
    assert story == [
        (0, "long begins"),
        (0, "short begins"),
        (10, "short ends"),
        (20, "between"),
        (30, "long ends"),
    ]


def test_of_waits_until_one_instant_the_lowest_order_ends_first(executor: Executor) -> None:
    story: list[str] = []

    def wait(name: str, order: int) -> None:
        Pause(executor).wait(10, order)
        story.append(name)

    for name, order in (("third", 3), ("first", 1), ("second", 2)):
        executor.do(partial(wait, name, order))
    executor.run(nothing_left, FOREVER)
    assert story == ["first", "second", "third"]


def test_the_end_of_a_wait_lets_its_thread_go_on_at_that_instant(executor: Executor) -> None:
    pause, story = Pause(executor), list[int]()

    def wait() -> None:
        assert pause.wait(100)
        story.append(executor.now)

    executor.do(wait)
    executor.at(7, pause.end)
    executor.at(8, pause.end)  # no effect
    executor.run(nothing_left, FOREVER)
    assert story == [7]


def test_a_wait_that_was_ended_before_it_began_does_not_wait(executor: Executor) -> None:
    story: list[object] = []

    def wait() -> None:
        pause = Pause(executor)
        pause.end()
        story.append(pause.wait(100))
        story.append(executor.now)

    executor.do(wait)
    executor.run(nothing_left, FOREVER)
    assert story == [True, 0]


def test_a_condition_ends_a_wait_after_the_event_that_made_it_true(executor: Executor) -> None:
    event, story = threading.Event(), list[int]()

    def wait() -> None:
        for _ in range(2):
            assert Pause(executor, event.is_set).wait(100)
            story.append(executor.now)

    executor.do(wait)
    executor.at(9, event.set)
    executor.run(nothing_left, FOREVER)
    assert story == [9, 9], "the second wait does not begin"


def test_a_wait_fails_if_no_thread_can_go_on_instead(executor: Executor, monkeypatch: pytest.MonkeyPatch) -> None:
    story: list[str] = []

    def wait() -> None:
        monkeypatch.setattr("robocomp_py.virtual.executor.start_thread", lambda thread: False)
        with pytest.raises(ComponentError, match="no thread can be started"):
            Pause(executor).wait(10)
        story.append("goes on")

    executor.do(wait)
    executor.run(nothing_left, 20)
    assert story == ["goes on"]


def test_a_run_may_return_while_events_wait_and_go_on_later(executor: Executor) -> None:
    story: list[int] = []

    def wait() -> None:
        Pause(executor).wait(100)
        story.append(executor.now)

    executor.do(wait)
    executor.at(10, lambda: None)
    executor.run(nothing_left, 50)
    assert (story, executor.now) == ([], 50)
    executor.run(nothing_left, 150)
    assert story == [100]


def test_closing_ends_all_waits(executor: Executor) -> None:
    ended: list[type[Exception]] = []

    def wait() -> None:
        try:
            Pause(executor).wait()
        except Closed:
            ended.append(Closed)
            with pytest.raises(Closed):
                Pause(executor).wait()

    for _ in range(3):
        executor.do(wait)
    executor.run(nothing_left, 10)
    executor.close()
    assert ended == [Closed] * 3


def test_what_an_event_raises_comes_out_of_the_run(executor: Executor) -> None:
    executor.do(lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        executor.run(nothing_left, 10)
    story: list[int] = []
    executor.at(5, lambda: story.append(5))
    executor.run(nothing_left, 10)
    assert story == [5]


def test_a_thread_of_a_component_may_not_wait(executor: Executor) -> None:
    raised: list[str] = []

    def stray() -> None:
        try:
            Pause(executor).wait(10)
        except ComponentError as exc:
            raised.append(str(exc))

    def start() -> None:
        thread = threading.Thread(target=stray, name="stray")
        thread.start()
        thread.join()

    executor.do(start)
    executor.run(nothing_left, 20)
    assert raised[0].startswith("the thread `stray` is not part of the simulation")


def press_ctrl_c() -> None:
    signal.raise_signal(signal.SIGINT)


@pytest.fixture
def handles() -> Iterator[Callable[[Callable[..., object]], object]]:
    """Sets the handler of Ctrl-C."""
    before = signal.getsignal(signal.SIGINT)
    yield lambda handler: signal.signal(signal.SIGINT, handler)
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_in_the_last_event_ends_the_run(executor: Executor, handles: Callable[..., object]) -> None:
    handles(signal.default_int_handler)
    for _ in range(20):
        executor.do(press_ctrl_c)
        with pytest.raises(KeyboardInterrupt):
            executor.run(nothing_left, FOREVER)
    executor.close()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def run_again_and_again(executor: Executor, besides: threading.Thread) -> None:
    besides.start()
    while True:
        executor.run(nothing_left, executor.now + 1)


def test_ctrl_c_ends_a_run_at_any_moment(handles: Callable[..., object]) -> None:
    handles(signal.default_int_handler)
    main = threading.get_ident()
    for _ in range(100):
        executor = Executor()
        executor.add(Ticker(1, lambda: None))
        presses = threading.Thread(target=lambda: signal.pthread_kill(main, signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            run_again_and_again(executor, presses)
        presses.join()
        executor.close()
    assert not any(thread.name.startswith("simulation-") for thread in threading.enumerate())


def test_a_signal_whose_handler_raises_nothing_does_not_end_a_run(
    executor: Executor, handles: Callable[..., object]
) -> None:
    story: list[object] = []
    handles(lambda number, frame: story.append(number))
    executor.do(press_ctrl_c)
    executor.at(10, lambda: story.append("later"))
    assert not executor.run(nothing_left, 20)
    assert sorted(story, key=str) == [signal.SIGINT, "later"]
