"""Threads that take turns: a long job delays no other, and the order is kept."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from math import inf

import pytest

from robocomp_py.errors import TransportError
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.threads import start_thread
from robocomp_py.transports import leader_followers
from robocomp_py.transports.base import Reply, Statistics, Status, about_to_block
from robocomp_py.transports.leader_followers import Gate, Lane, LeaderFollowers, Servant

Work = queue.Queue[Callable[[], object]]


@pytest.fixture
def work() -> Iterator[Work]:
    """Jobs put here are run by a pool."""
    jobs: Work = queue.Queue()
    pool = LeaderFollowers("test", lambda: (jobs.get(),), wake=lambda: jobs.put(lambda: None))
    pool.start()
    yield jobs
    pool.close()


def test_one_thread_runs_all_jobs_that_are_quick(work: Work) -> None:
    threads: list[str] = []
    for _ in range(100):
        work.put(lambda: threads.append(threading.current_thread().name))
    wait_until(lambda: len(threads) == 100)
    assert len(set(threads)) == 1


def test_a_pool_without_a_thread_to_spare_goes_on_and_hires_one_later() -> None:
    jobs: Work = queue.Queue()
    spare, refused = threading.Semaphore(2), threading.Event()

    def start(thread: threading.Thread) -> bool:
        if not spare.acquire(blocking=False):
            refused.set()
            return False
        return start_thread(thread)

    pool = LeaderFollowers("test", lambda: (jobs.get(),), wake=lambda: jobs.put(lambda: None), start=start)
    pool.start()
    try:
        ran, release = threading.Semaphore(0), threading.Event()
        jobs.put(lambda: (about_to_block(), ran.release()))
        jobs.put(ran.release)  # is received, though no other thread could be hired
        assert ran.acquire(timeout=SOON)
        assert ran.acquire(timeout=SOON)
        assert refused.is_set()
        jobs.put(lambda: (about_to_block(), release.wait(SOON)))
        jobs.put(ran.release)
        spare.release()
        assert ran.acquire(timeout=SOON)  # while the other one waits: the lookout found a thread to hire
        release.set()
    finally:
        pool.close()


def test_a_pool_that_cannot_start_its_threads_says_so_and_keeps_no_thread() -> None:
    jobs: Work = queue.Queue()
    spare = threading.Semaphore(1)

    def start(thread: threading.Thread) -> bool:
        return spare.acquire(blocking=False) and start_thread(thread)

    pool = LeaderFollowers("few", lambda: (jobs.get(),), wake=lambda: jobs.put(lambda: None), start=start)
    with pytest.raises(TransportError, match="few: no thread can be started; raise the limit of processes"):
        pool.start()
    assert not [each for each in threading.enumerate() if each.name.startswith("few-")]


def test_jobs_begin_in_order_even_when_some_take_long(work: Work) -> None:
    begun: list[int] = []
    release = threading.Event()

    def job(number: int) -> None:
        begun.append(number)
        if number % 5 == 0:
            release.wait(SOON)

    for number in range(20):
        work.put(lambda n=number: job(n))  # type: ignore[misc]
    wait_until(lambda: len(begun) == 20)
    release.set()
    assert begun == list(range(20))


def test_another_thread_receives_while_a_job_takes_long(work: Work) -> None:
    release, heard = threading.Event(), threading.Event()
    work.put(lambda: release.wait(SOON))
    work.put(heard.set)
    assert heard.wait(SOON)
    release.set()


def test_a_leader_that_is_about_to_block_is_replaced_at_once(work: Work) -> None:
    answered = threading.Event()
    result: list[bool] = []

    def waits_for_the_next_job() -> None:
        about_to_block()
        result.append(answered.wait(SOON))

    work.put(waits_for_the_next_job)
    work.put(answered.set)
    wait_until(lambda: result)
    assert result == [True]


def test_about_to_block_outside_a_pool_does_nothing() -> None:
    about_to_block()


def test_a_job_that_raises_is_logged_and_the_next_one_runs(work: Work, caplog: pytest.LogCaptureFixture) -> None:
    heard = threading.Event()
    work.put(lambda: 1 / 0)
    work.put(heard.set)
    assert heard.wait(SOON)
    assert "ZeroDivisionError" in caplog.text


def test_closing_waits_for_the_threads_and_may_be_done_by_a_job() -> None:
    jobs: Work = queue.Queue()
    pool = LeaderFollowers("test", lambda: (jobs.get(),), wake=lambda: jobs.put(lambda: None))
    before = set(threading.enumerate())
    pool.start()
    closed = threading.Event()

    def close() -> None:
        pool.close()
        closed.set()

    jobs.put(close)
    assert closed.wait(SOON)
    wait_until(lambda: set(threading.enumerate()) <= before)  # others may end


def test_a_closed_gate_refuses_entry_and_waits_for_threads_inside() -> None:
    gate = Gate("test")
    inside, leave, closed = threading.Event(), threading.Event(), threading.Event()

    def visitor() -> None:
        assert gate.enter()
        inside.set()
        leave.wait(SOON)
        gate.leave()

    threads = [threading.Thread(target=visitor), threading.Thread(target=lambda: (gate.close(), closed.set()))]
    threads[0].start()
    assert inside.wait(SOON)
    threads[1].start()
    wait_until(lambda: gate.closed)
    assert not gate.enter()
    assert not closed.is_set()
    leave.set()
    assert closed.wait(SOON)
    for thread in threads:
        thread.join()


def test_a_full_lossy_lane_gives_up_its_oldest() -> None:
    heard: list[int] = []
    stats = Statistics()
    lane = Lane("test", heard.append, 3, lossy=True, stats=stats)
    for number in range(10):
        assert lane.put(number)
    lane.drain()
    assert (heard, stats.dropped, stats.received) == ([7, 8, 9], 7, 3)


def test_a_full_faithful_lane_takes_no_more_until_there_is_room() -> None:
    heard: list[int] = []
    lane = Lane("test", heard.append, 2, lossy=False, stats=Statistics())
    assert [lane.put(number) for number in range(3)] == [True, True, False]
    assert lane.full
    lane.drain()
    assert lane.put(3)
    lane.drain()
    assert heard == [0, 1, 3]


def test_messages_that_may_be_lost_displace_no_others() -> None:
    heard: list[str] = []
    stats = Statistics()
    lane = Lane("test", heard.append, 2, lossy=False, stats=stats)
    assert [lane.put(each, SOON, may_be_lost=True) for each in ("first", "second", "no room")] == [True] * 3
    lane.drain()
    assert (heard, stats.dropped) == (["first", "second"], 1)


def test_a_lane_is_drained_by_one_thread_at_a_time_in_order() -> None:
    heard: list[int] = []
    entered, release = threading.Event(), threading.Event()

    def sink(number: int) -> None:
        entered.set()
        if number == 0:
            release.wait(SOON)
        heard.append(number)

    lane = Lane("test", sink, 10, lossy=True, stats=Statistics())
    lane.put(0)
    first = threading.Thread(target=lane.drain)
    first.start()
    assert entered.wait(SOON)
    lane.put(1)
    lane.drain()  # returns, because the first thread goes on
    assert heard == []
    release.set()
    first.join()
    assert heard == [0, 1]


def test_a_closed_lane_calls_its_sink_no_more() -> None:
    heard: list[int] = []
    lane = Lane("test", heard.append, 3, lossy=True, stats=Statistics())
    lane.put(1)
    lane.close()
    lane.put(2)
    lane.drain()
    assert heard == []


@pytest.mark.parametrize("how", [sys.exit, lambda: 1 / 0])
def test_whatever_a_job_raises_the_next_one_runs(
    work: Work, how: Callable[[], object], caplog: pytest.LogCaptureFixture
) -> None:
    heard = threading.Event()
    work.put(how)
    work.put(heard.set)
    assert heard.wait(SOON)
    assert "a message was not handled" in caplog.text


def test_a_pool_whose_receiving_fails_goes_on_and_says_so_once(caplog: pytest.LogCaptureFixture) -> None:
    heard, failures = threading.Event(), [OSError("no descriptor is left")] * 4
    jobs: Work = queue.Queue()

    def receive() -> Iterable[Callable[[], object]]:
        if failures:
            raise failures.pop()
        return (jobs.get(),)

    pool = LeaderFollowers("test", receive, wake=lambda: jobs.put(lambda: None))
    pool.start()
    jobs.put(heard.set)
    assert heard.wait(SOON)
    pool.close()
    assert sum("receiving failed" in record.message for record in caplog.records) == 1


def test_one_thread_receives_at_a_time_even_if_it_is_about_to_block() -> None:
    jobs: Work = queue.Queue()
    inside, most = threading.Semaphore(1), [0]
    heard = threading.Event()

    def receive() -> Iterable[Callable[[], object]]:
        most[0] += not inside.acquire(blocking=False)
        about_to_block()
        job = jobs.get()
        inside.release()
        return (job,)

    pool = LeaderFollowers("test", receive, wake=lambda: jobs.put(lambda: None))
    pool.start()
    release = threading.Event()
    for _ in range(3):
        jobs.put(lambda: release.wait(SOON))
    jobs.put(heard.set)
    assert heard.wait(SOON)
    release.set()
    pool.close()
    assert most == [0]


def test_closing_gives_up_on_a_job_that_is_stuck(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(leader_followers, "STUCK", 0.05)
    jobs: Work = queue.Queue()
    pool = LeaderFollowers("test", lambda: (jobs.get(),), wake=lambda: jobs.put(lambda: None))
    before = threading.active_count()
    pool.start()
    entered, release = threading.Event(), threading.Event()
    jobs.put(lambda: (entered.set(), release.wait(SOON * 3)))
    assert entered.wait(SOON)
    pool.close()
    assert not release.is_set()
    assert "test-0" in caplog.text  # and others, if they take as long to end
    assert "still busy" in caplog.text
    release.set()
    wait_until(lambda: threading.active_count() <= before)  # threads of a test before this one may end, too


def test_a_lane_survives_a_sink_that_exits(caplog: pytest.LogCaptureFixture) -> None:
    heard: list[int] = []

    def sink(number: int) -> None:
        if number == 1:
            sys.exit("from a sink")
        heard.append(number)

    lane = Lane("test", sink, 5, lossy=False, stats=Statistics())
    for number in range(3):
        lane.put(number)
    lane.drain()
    assert heard == [0, 2]
    assert "from a sink" in caplog.text


def test_what_a_late_subscriber_missed_never_waits_for_room() -> None:
    heard: list[int] = []
    lane = Lane("test", heard.append, 2, lossy=False, stats=Statistics())
    lane.put(0)
    lane.start_with(range(1, 10))
    lane.drain()
    assert heard == [0, 8, 9]


def test_a_lane_is_drained_on_one_summons_however_much_was_put_into_it() -> None:
    inside: list[bool] = []
    lane = Lane("test", lambda _: inside.append(lane.summon()), 5, lossy=True, stats=Statistics())
    lane.put(0)
    assert [lane.summon() for _ in range(3)] == [True, False, False]
    lane.drain()
    assert inside == [False]  # a draining thread continues until nothing waits
    assert lane.summon()


@pytest.mark.parametrize("how", [sys.exit, lambda: 1 / 0])
def test_whatever_a_service_raises_its_call_fails_and_that_is_logged(
    how: Callable[[], Reply], caplog: pytest.LogCaptureFixture
) -> None:
    answers: list[Reply] = []
    Servant("test", lambda payload, expires: how(), Statistics()).serve(None, inf, answers.append)
    assert answers == [Reply(Status.FAILED)]
    assert "a service raised" in caplog.text


def test_a_call_fails_if_the_future_of_its_service_does(caplog: pytest.LogCaptureFixture) -> None:
    answers: list[Reply] = []
    reply: Future[Reply] = Future()
    Servant("test", lambda payload, expires: reply, Statistics()).serve(None, inf, answers.append)
    reply.set_exception(ValueError("broken later"))
    assert answers == [Reply(Status.FAILED)]
    assert "broken later" in caplog.text
