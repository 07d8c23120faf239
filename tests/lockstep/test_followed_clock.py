"""A clock that another component moves."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

from robocomp_py.lockstep.clock import Followed, Moved
from robocomp_py.runtime.clock import NEVER
from robocomp_py.testing.patience import SOON, wait_until


def test_a_wait_ends_at_its_instant_and_not_before() -> None:
    clock, wake = Followed(lambda: False), threading.Event()
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(clock.wait, wake, 100)
        wait_until(lambda: clock.due == 100)
        assert clock.is_still
        assert clock.proceed(99) is Moved.QUIETLY
        assert clock.due == 100
        assert clock.proceed(100) is Moved.TO_OTHER
        waiting.result(SOON)
    assert clock.now() == 100
    assert clock.due == NEVER


def test_one_thread_goes_on_at_a_time_the_earliest_first() -> None:
    clock, first, second = Followed(lambda: False), threading.Event(), threading.Event()
    with ThreadPoolExecutor(2) as pool:
        later = pool.submit(clock.wait, second, 200)
        earlier = pool.submit(clock.wait, first, 100)
        wait_until(lambda: len(clock._waiting) == 2)
        assert clock.proceed(300) is Moved.TO_OTHER
        earlier.result(SOON)
        assert clock.proceed(300) is Moved.NOT, "the first one works"
        assert not later.done()
        del first, earlier
        wait_until(lambda: clock.proceed(300) is Moved.TO_OTHER)
        later.result(SOON)


def test_a_thread_that_asks_is_told_that_it_goes_on_itself() -> None:
    clock, wake = Followed(lambda: False), threading.Event()
    asked: list[Moved] = []

    def ask(event: threading.Event, _: float) -> bool:
        asked.append(clock.proceed(100, event))
        return True

    clock.pause = ask
    assert not clock.wait(wake, 100), "its event is not set"
    assert asked == [Moved.TO_ASKING]
    assert not clock.is_still


def test_a_thread_works_from_the_end_of_a_wait_until_its_next_one_or_until_it_drops_its_event() -> None:
    clock, wake = Followed(lambda: False), threading.Event()
    wake.set()
    assert clock.wait(wake, 100), "an event ends a wait at once"
    assert not clock.is_still
    del wake
    assert clock.is_still


def test_an_event_that_is_set_means_that_its_thread_is_about_to_work() -> None:
    clock, wake = Followed(lambda: False), threading.Event()
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(clock.wait, wake, NEVER)
        wait_until(lambda: clock._waiting)
        assert clock.is_still
        wake.set()
        assert not clock.is_still
        assert waiting.result(SOON)


def test_the_clock_never_goes_back() -> None:
    clock = Followed(lambda: False)
    clock.show(100)
    clock.show(50)
    assert clock.now() == 100
    clock.proceed(70)
    assert clock.now() == clock.reached() == 100


def test_what_is_due_at_an_instant_that_is_shown_waits_for_its_turn() -> None:
    clock, wake = Followed(lambda: False), threading.Event()
    clock.show(100)
    assert (clock.now(), clock.reached()) == (100, 0)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(clock.wait, wake, 100)
        wait_until(lambda: clock.due == 100)
        assert not waiting.done()
        assert clock.proceed(100) is Moved.TO_OTHER
        waiting.result(SOON)
    assert clock.reached() == 100


def test_while_nobody_moves_it_the_time_of_a_wait_passes_by_itself() -> None:
    clock = Followed(lambda: True)
    assert not clock.wait(threading.Event(), 1_000_000)
    assert clock.now() == 1_000_000


def test_a_wait_that_began_before_goes_on_by_itself_once_nobody_moves_the_clock() -> None:
    free = threading.Event()
    clock = Followed(free.is_set)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(clock.wait, threading.Event(), 1_000_000)
        wait_until(lambda: clock.due == 1_000_000)
        free.set()
        waiting.result(SOON)
    assert clock.now() == 1_000_000
