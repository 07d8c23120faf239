"""One at a time; who waits lets others in."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from robocomp_py.errors import Closed
from robocomp_py.runtime.monitor import MAX_CONCURRENT, MAX_SUSPENDED, MAX_WAITING, Monitor, Threads
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.threads import Pool, start_thread


@pytest.fixture
def monitor() -> Iterator[Monitor]:
    monitor = Monitor("test")
    yield monitor
    monitor.close()


@pytest.fixture
def opened(monitor: Monitor) -> Monitor:
    monitor.open()
    return monitor


def test_one_thread_at_a_time_is_inside(opened: Monitor) -> None:
    inside = most = 0

    def work() -> None:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        os.sched_yield()  # another thread could get in now
        inside -= 1

    def enter() -> None:
        for _ in range(200):
            with opened.held():
                work()

    with ThreadPoolExecutor(8) as pool:
        entering = [pool.submit(enter) for _ in range(4)]
        for _ in range(200):
            opened.run(work)
            opened.submit(work)
    for each in entering:
        each.result()
    assert most == 1


def test_a_result_is_passed_on_after_leaving(opened: Monitor) -> None:
    seen: list[tuple[str, bool]] = []
    opened.submit(lambda: "result", then=lambda result: seen.append((result, opened.is_inside)))
    opened.submit_concurrent(lambda: "concurrent", then=lambda result: seen.append((result, opened.is_inside)))
    wait_until(lambda: len(seen) == 2)
    assert sorted(seen) == [("concurrent", False), ("result", False)]


def test_slow_concurrent_calls_keep_no_call_out(opened: Monitor) -> None:
    release, ran = threading.Event(), threading.Event()
    assert all(opened.submit_concurrent(lambda: release.wait(SOON)) for _ in range(MAX_CONCURRENT))
    assert opened.submit(ran.set)
    assert ran.wait(SOON)
    release.set()


def test_jobs_run_in_order_of_arrival(opened: Monitor) -> None:
    order: list[int] = []
    opened.enter()
    for number in range(50):
        assert opened.submit(lambda n=number: order.append(n))  # type: ignore[misc]
    opened.leave()
    wait_until(lambda: len(order) == 50)
    assert order == list(range(50))


def test_a_job_runs_in_the_calling_thread_if_the_monitor_is_free(opened: Monitor) -> None:
    ran_on: list[int] = []
    opened.run(lambda: ran_on.append(threading.get_ident()))
    assert ran_on == [threading.get_ident()]
    assert not opened.is_inside


def test_a_newcomer_does_not_overtake_waiting_jobs(opened: Monitor) -> None:
    order: list[str] = []
    opened.enter()
    opened.submit(lambda: order.append("waited"))
    assert not opened.try_enter()
    opened.leave()
    wait_until(lambda: order == ["waited"])


def test_before_the_opening_only_the_worker_itself_gets_in(monitor: Monitor) -> None:
    order: list[str] = []
    assert monitor.submit(lambda: order.append("handler"))
    handler = threading.Thread(target=_enter_and, args=(monitor, lambda: order.append("thread")))
    handler.start()
    assert not monitor.try_enter()
    with monitor.held(early=True):
        order.append("initialize")
        with monitor.suspended():
            order.append("waiting for an answer")
    assert order == ["initialize", "waiting for an answer"]
    monitor.open()
    wait_until(lambda: len(order) == 4)
    assert sorted(order[2:]) == ["handler", "thread"]
    handler.join()


def test_a_suspended_thread_lets_others_in_and_returns_first(opened: Monitor) -> None:
    order: list[str] = []
    answered = threading.Event()

    def handler() -> None:
        order.append("handler")
        answered.set()

    opened.enter()
    opened.submit(handler)
    order.append("compute")
    with opened.suspended():
        assert answered.wait(SOON)
        assert not opened.is_inside
    order.append("compute again")
    assert opened.is_inside
    opened.leave()
    assert order == ["compute", "handler", "compute again"]


def test_stepping_out_without_being_inside_changes_nothing(opened: Monitor) -> None:
    assert opened.suspend() is False
    opened.resume(False)
    assert opened.try_enter()
    opened.leave()


def test_returning_threads_go_before_new_jobs(opened: Monitor) -> None:
    order: list[str] = []
    suspended, may_return = threading.Event(), threading.Event()

    def waits() -> None:
        with opened.suspended():
            suspended.set()
            may_return.wait(SOON)
        order.append("returned")

    waiter = threading.Thread(target=_enter_and, args=(opened, waits))
    waiter.start()
    assert suspended.wait(SOON)
    with opened.held():
        opened.submit(lambda: order.append("new"))
        may_return.set()
        wait_until(lambda: len(opened._queue) == 2)
    wait_until(lambda: len(order) == 2)
    assert order == ["returned", "new"]
    waiter.join()


def test_when_too_many_wait_for_answers_new_jobs_are_turned_away(opened: Monitor) -> None:
    release, out = threading.Event(), threading.Semaphore(0)

    def waits() -> None:
        with opened.suspended():
            out.release()
            release.wait(SOON)

    for _ in range(MAX_SUSPENDED):
        assert opened.submit(waits)
    for _ in range(MAX_SUSPENDED):
        assert out.acquire(timeout=SOON)
    assert not opened.submit(lambda: None)
    assert not opened.try_enter()
    ran = threading.Event()
    assert opened.submit(ran.set, limited=False)
    assert ran.wait(SOON)
    release.set()
    wait_until(lambda: opened.submit(lambda: None))


def test_when_too_many_wait_for_their_turn_new_jobs_are_turned_away(opened: Monitor) -> None:
    opened.enter()
    assert all(opened.submit(lambda: None) for _ in range(MAX_WAITING))
    assert not opened.submit(lambda: None)
    opened.leave()


def test_what_is_concurrent_runs_beside_but_not_without_limit(opened: Monitor) -> None:
    release, begun = threading.Event(), threading.Event()
    opened.enter()
    assert opened.submit_concurrent(begun.set)
    assert begun.wait(SOON)
    wait_until(lambda: opened._concurrent == 0)  # it has not only begun
    assert all(opened.submit_concurrent(lambda: release.wait(SOON)) for _ in range(MAX_CONCURRENT))
    assert not opened.submit_concurrent(lambda: None)
    release.set()
    opened.leave()


def test_a_job_that_raises_is_logged_and_releases_the_monitor(
    opened: Monitor, caplog: pytest.LogCaptureFixture
) -> None:
    opened.enter()
    opened.submit(lambda: 1 / 0)
    opened.leave()
    ran = threading.Event()
    wait_until(lambda: opened.try_enter())
    opened.submit(ran.set)
    opened.leave()
    assert ran.wait(SOON)
    assert "ZeroDivisionError" in caplog.text


def test_after_closing_nothing_runs(opened: Monitor) -> None:
    opened.close()
    assert not opened.submit(lambda: None)


def _enter_and(monitor: Monitor, work: Callable[[], object]) -> None:
    with monitor.held():
        work()


def test_closing_waits_for_suspended_threads_even_if_the_pool_is_busy() -> None:
    monitor, release, out = Monitor("closing"), threading.Event(), threading.Semaphore(0)
    monitor.open()
    come_back: list[bool] = []

    def waits() -> None:
        with monitor.suspended():
            out.release()
            release.wait(SOON)
        come_back.append(monitor.is_inside)

    for _ in range(MAX_SUSPENDED):
        assert monitor.submit(waits)
    for _ in range(MAX_SUSPENDED):
        assert out.acquire(timeout=SOON)
    for _ in range(8):  # no thread of the pool is left for the next job
        assert monitor.submit_concurrent(lambda: release.wait(SOON))
    assert monitor.submit(lambda: None, limited=False)
    closing = threading.Thread(target=monitor.close)
    closing.start()
    wait_until(lambda: monitor.closed)
    release.set()
    closing.join(SOON)
    assert not closing.is_alive()
    assert come_back == [True] * MAX_SUSPENDED


def test_threads_that_wait_to_enter_are_refused_when_it_closes(opened: Monitor) -> None:
    refused: list[bool] = []

    def enter() -> None:
        try:
            with opened.held():
                refused.append(False)
        except Closed:
            refused.append(True)

    opened.enter()
    threads = [threading.Thread(target=enter) for _ in range(3)]
    for thread in threads:
        thread.start()
    wait_until(lambda: len(opened._queue) == 3)
    opened.turn_away()
    for thread in threads:
        thread.join(SOON)
    opened.leave()
    assert refused == [True] * 3
    with pytest.raises(Closed):
        opened.enter()
    with opened.held(early=True):  # for what has to be done at the end
        assert opened.is_inside


def test_all_come_back_from_a_wait_though_more_wait_than_the_pool_has_threads(opened: Monitor) -> None:
    release, out, back = threading.Event(), threading.Semaphore(0), threading.Semaphore(0)

    def waits() -> None:
        with opened.suspended():
            out.release()
            release.wait(SOON)
        back.release()

    threads = MAX_SUSPENDED + 8
    for _ in range(2 * threads):
        assert opened.submit(waits, limited=False)
    for _ in range(threads):
        assert out.acquire(timeout=SOON)
    release.set()
    for _ in range(2 * threads):
        assert back.acquire(timeout=SOON)


class _Scarce:
    """Starts as many threads as there are to spare."""

    def __init__(self, spare: int) -> None:
        self.spare = spare

    def __call__(self, thread: threading.Thread) -> bool:
        if self.spare <= 0:
            return False
        self.spare -= 1
        return start_thread(thread)


@contextmanager
def _monitor_with(scarce: _Scarce) -> Iterator[Monitor]:
    monitor = Monitor("scarce", Threads(scarce))
    monitor.open()
    try:
        yield monitor
    finally:
        monitor.close()


def test_without_any_thread_jobs_are_turned_away_and_nothing_is_counted() -> None:
    scarce, ran = _Scarce(0), threading.Semaphore(0)
    with _monitor_with(scarce) as monitor:
        for _ in range(MAX_CONCURRENT + 1):  # more often than may be counted
            with monitor.held():
                assert not monitor.submit(ran.release)
                assert not monitor.submit_concurrent(ran.release)
                with monitor.suspended():
                    assert not monitor.is_inside
        monitor.run(ran.release)
        scarce.spare = 2
        with monitor.held():
            assert monitor.submit(ran.release)
            assert monitor.submit_concurrent(ran.release)
        for _ in range(3):
            assert ran.acquire(timeout=SOON)


def test_a_callback_is_run_by_the_calling_thread_if_there_is_no_other() -> None:
    ran_on: list[str] = []
    with _monitor_with(_Scarce(0)) as monitor:
        monitor.enter()
        calling = threading.Thread(
            target=monitor.run, args=(lambda: ran_on.append(threading.current_thread().name),), name="calling"
        )
        calling.start()
        wait_until(lambda: monitor._queue)
        monitor.leave()
        calling.join(SOON)
    assert ran_on == ["calling"]


def test_a_job_waits_for_the_only_thread_and_keeps_no_thread_out() -> None:
    scarce, order, release, out = _Scarce(1), list[str](), threading.Event(), threading.Event()

    def waits() -> None:
        with monitor.suspended():
            out.set()
            release.wait(SOON)
        order.append("came back")

    with _monitor_with(scarce) as monitor:
        assert monitor.submit(waits)
        assert out.wait(SOON)
        assert monitor.submit(lambda: order.append("job"))
        with monitor.held():
            order.append("thread")
        release.set()
        wait_until(lambda: len(order) == 3)
    assert order == ["thread", "came back", "job"]


def test_a_pool_takes_no_job_once_it_is_closed() -> None:
    pool, ran = Pool("closing", 1), threading.Event()
    assert pool.offer(ran.set)
    assert ran.wait(SOON)
    pool.close(wait=False)
    assert not pool.offer(ran.clear, may_wait=True)
