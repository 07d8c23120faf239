"""Who waits in Python's library lets others in meanwhile, and threads and pools end when their component does."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, Full
from types import ModuleType
from typing import Any, TypeVar

import pytest

from robocomp_py.classic.workers import waits
from robocomp_py.testing.patience import SOON, wait_until

T = TypeVar("T")


class House:
    """The modules of a component, and who of it is out."""

    def __init__(self) -> None:
        self.out: set[int] = set()
        self.left = 0
        """How often a thread went out."""
        self.taken = 0
        """How many locks are."""
        self.begun = waits.Begun()
        self.modules = waits.modules(self, self.begun)

    def __getattr__(self, name: str) -> ModuleType:
        return self.modules[name]

    @property
    def futures(self) -> Any:
        return self.modules["concurrent.futures"]

    @contextmanager
    def outside(self) -> Iterator[None]:
        here = threading.get_ident()
        is_first = here not in self.out
        self.left += 1
        self.out.add(here)
        try:
            yield
        finally:
            if is_first:
                self.out.discard(here)

    def wait_for(self, function: Callable[[], T]) -> T:
        with self.outside():
            return function()

    def locked(self, change: int) -> None:
        self.taken += change


@pytest.fixture
def house() -> House:
    return House()


Scene = tuple[Callable[[], object], Callable[[], object]]
"""What waits, and what ends that."""


def lock(house: House) -> Scene:
    made = house.threading.Lock()
    made.acquire()
    return made.acquire, made.release


def event(house: House) -> Scene:
    made = house.threading.Event()
    return made.wait, made.set


def condition(house: House) -> Scene:
    made = house.threading.Condition()

    def wait() -> None:
        with made, made:
            made.wait()

    def notify() -> None:
        with made:
            made.notify()

    return wait, notify


def semaphore(house: House) -> Scene:
    made = house.threading.Semaphore(0)
    return made.acquire, made.release


def bounded_semaphore(house: House) -> Scene:
    made = house.threading.BoundedSemaphore(1)
    made.acquire()
    return made.acquire, made.release


def barrier(house: House) -> Scene:
    made = house.threading.Barrier(2)
    return made.wait, made.wait


def thread(house: House) -> Scene:
    end = threading.Event()
    made = house.threading.Thread(target=end.wait)
    made.start()
    return made.join, end.set


def empty_queue(house: House) -> Scene:
    made = house.queue.Queue()
    return made.get, lambda: made.put(1)


def full_queue(house: House) -> Scene:
    made = house.queue.PriorityQueue(1)
    made.put(1)
    return lambda: made.put(2), made.get


def simple_queue(house: House) -> Scene:
    made = house.queue.SimpleQueue()
    return made.get, lambda: made.put(1)


def result(house: House) -> Scene:
    end, pool = threading.Event(), house.futures.ThreadPoolExecutor(1)
    return pool.submit(end.wait).result, end.set


def results(house: House) -> Scene:
    end, pool = threading.Event(), house.futures.ThreadPoolExecutor(1)
    return lambda: list(pool.map(lambda _: end.wait(), "ab")), end.set


def completed(house: House) -> Scene:
    end, pool = threading.Event(), house.futures.ThreadPoolExecutor(1)
    every = [pool.submit(end.wait)]
    return lambda: list(house.futures.as_completed(every)) == every, end.set


def awaited(house: House) -> Scene:
    future = house.futures.Future()
    return lambda: house.futures.wait([future]), lambda: future.set_result(1)


def shut_down(house: House) -> Scene:
    end, pool = threading.Event(), house.futures.ThreadPoolExecutor(1)
    pool.submit(end.wait)
    return pool.shutdown, end.set


SCENES = (
    *(lock, event, condition, semaphore, bounded_semaphore, barrier, thread, empty_queue, full_queue, simple_queue),
    *(result, results, completed, awaited, shut_down),
)


@pytest.mark.parametrize("scene", SCENES)
def test_a_thread_that_waits_is_outside_the_monitor(house: House, scene: Callable[[House], Scene]) -> None:
    wait, end = scene(house)
    waiting = threading.Thread(target=wait)
    waiting.start()
    try:
        wait_until(lambda: waiting.ident in house.out, what="it waits")
        assert waiting.is_alive()
    finally:
        end()
        waiting.join(SOON)
    assert not waiting.is_alive()
    assert not house.out


def a_full_queue(house: House) -> Callable[[], object]:
    made = house.queue.Queue(1)
    made.put(1)
    return made.get


def an_empty_queue(house: House) -> Callable[[], object]:
    made = house.queue.LifoQueue(1)
    return lambda: made.put(1)


def a_simple_queue(house: House) -> Callable[[], object]:
    made = house.queue.SimpleQueue()
    made.put(1, False)
    return made.get


def a_result_that_is_there(house: House) -> Callable[[], object]:
    made = house.futures.Future()
    made.set_result(1)
    return made.result


def an_error_that_is_there(house: House) -> Callable[[], object]:
    made = house.futures.Future()
    made.set_exception(ValueError())
    return made.exception


def an_event_that_has_come(house: House) -> Callable[[], object]:
    made = house.threading.Event()
    made.set()
    return made.wait


def a_semaphore(house: House) -> Callable[[], object]:
    return house.threading.Semaphore(1).acquire


THERE = (
    *(a_full_queue, an_empty_queue, a_simple_queue, a_result_that_is_there, an_error_that_is_there),
    *(an_event_that_has_come, a_semaphore),
)


@pytest.mark.parametrize("there", THERE)
def test_taking_what_is_there_leaves_the_monitor_each_time(
    house: House, there: Callable[[House], Callable[[], object]]
) -> None:
    take = there(house)
    before = house.left
    take()
    assert house.left == before + 1
    assert not house.out


def test_calls_that_do_not_wait_and_free_locks_stay_in_the_monitor(house: House) -> None:
    queue = house.queue.Queue(1)
    queue.put_nowait(1)
    with pytest.raises(Full):
        queue.put_nowait(2)
    assert queue.get(False) == 1
    for each in (queue, house.queue.SimpleQueue()):
        with pytest.raises(Empty):
            each.get(False)
    assert not house.threading.Semaphore(0).acquire(blocking=False)
    with house.threading.Lock(), house.threading.RLock(), house.threading.Condition(), house.threading.Semaphore(1):
        pass
    assert house.left == 0


def test_a_semaphore_around_something_is_a_lock(house: House) -> None:
    made = house.threading.BoundedSemaphore(1)
    with suppress(ValueError), made:
        assert house.taken == 1
        raise ValueError
    assert house.taken == 0
    assert made.acquire(blocking=False)


def test_waiting_for_a_condition_releases_a_lock_that_was_taken_repeatedly(house: House) -> None:
    wait, notify = condition(house)
    waiting = threading.Thread(target=wait)
    waiting.start()
    try:
        wait_until(lambda: waiting.ident in house.out and not house.taken, what="it waits, and no lock is taken")
    finally:
        notify()
        waiting.join(SOON)
    assert not waiting.is_alive()
    assert house.taken == 0


def test_a_condition_wait_that_timed_out_consumes_no_notification(house: House) -> None:
    made, heard = house.threading.Condition(), list[bool]()

    def wait() -> None:
        with made:
            heard.append(made.wait())

    with made:
        assert not made.wait(0)
    with pytest.raises(RuntimeError, match="un-acquired"):
        made.wait()
    waiting = threading.Thread(target=wait)
    waiting.start()
    try:
        wait_until(lambda: waiting.ident in house.out, what="it waits")
    finally:
        with made:
            made.notify()
        waiting.join(SOON)
    assert heard == [True]


def test_the_action_of_a_barrier_runs_inside(house: House) -> None:
    acting: list[bool] = []
    made = house.threading.Barrier(2, lambda: acting.append(threading.get_ident() in house.out))
    waiting = threading.Thread(target=made.wait)
    waiting.start()
    wait_until(lambda: made.n_waiting == 1, what="it waits")
    made.wait()
    waiting.join(SOON)
    assert acting == [False]


def test_a_pool_begins_threads_for_workers_that_it_lacks_only(house: House) -> None:
    seen: set[int] = set()
    threading.setprofile(lambda *_: seen.add(threading.get_native_id()))
    try:
        pool, end = house.futures.ThreadPoolExecutor(1), threading.Event()
        first = pool.submit(end.wait)
        others = [pool.submit(int) for _ in range(5)]
        end.set()
        assert [each.result(SOON) for each in (first, *others)] == [True, 0, 0, 0, 0, 0]
        wait_until(lambda: pool._idle_semaphore._value, what="its worker is idle")
        assert pool.submit(int).result(SOON) == 0
    finally:
        threading.setprofile(None)
    assert len(seen) == 2  # the worker, and who began it


@pytest.fixture
def spare(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Holds how many threads can be started from now on."""
    start, left = threading.Thread.start, [0]

    def start_if_there_is_one(thread: threading.Thread) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", start_if_there_is_one)
    return left


@pytest.mark.parametrize("few", [0, 1])
def test_a_pool_without_any_thread_refuses_a_call_and_does_not_make_it_later(
    house: House, spare: list[int], few: int
) -> None:
    pool, made = house.futures.ThreadPoolExecutor(1), list[str]()
    spare[0] = few
    with pytest.raises(RuntimeError, match="no thread"):
        pool.submit(made.append, "refused")
    spare[0] = 2
    pool.submit(made.append, "taken").result(SOON)
    pool.shutdown()
    assert made == ["taken"]


def test_a_pool_with_a_thread_makes_a_call_for_which_it_gets_no_other(house: House, spare: list[int]) -> None:
    pool, end = house.futures.ThreadPoolExecutor(2), threading.Event()
    spare[0] = 2
    first = pool.submit(end.wait)
    second = pool.submit(str, "made")
    end.set()
    assert first.result(SOON)
    assert second.result(SOON) == "made"
    pool.shutdown()


def test_a_thread_that_could_not_be_started_at_first_is_awaited_all_the_same(house: House, spare: list[int]) -> None:
    end = threading.Event()
    thread = house.threading.Thread(target=end.wait, name="late")
    with pytest.raises(RuntimeError):
        thread.start()
    spare[0] = 1
    thread.start()
    assert house.begun.end((), 0, 0) == (["late"], 0)
    end.set()
    thread.join(SOON)


def test_an_idle_pool_that_is_still_referenced_ends_at_once(house: House) -> None:
    pool = house.futures.ThreadPoolExecutor(2)
    pool.submit(int).result()
    assert house.begun.end(house.begun.pools(), 10 * SOON, 0) == ([], 0)
    with pytest.raises(RuntimeError, match="shutdown"):
        pool.submit(int)


def test_calls_that_wait_in_a_pool_are_made_before_the_end(house: House) -> None:
    pool, made, may = house.futures.ThreadPoolExecutor(1), list[int](), threading.Semaphore(0)

    def call(number: int) -> None:
        may.acquire()
        made.append(number)

    for number in range(3):
        pool.submit(call, number)
    wait_until(lambda: pool._work_queue.qsize() == 2, what="it is at the first one")
    pools = house.begun.pools()
    assert house.begun.end(pools, 0, 0) == ([each.name for each in pool._threads], 2)
    for _ in range(3):
        may.release()
    assert house.begun.end(pools, SOON, 10 * SOON) == ([], 0)
    assert made == [0, 1, 2]


def test_a_pool_that_was_shut_down_already_is_no_reason_to_wait(house: House) -> None:
    over, pool = threading.Event(), house.futures.ThreadPoolExecutor(1, "endless")
    pool.submit(over.wait)
    pool.shutdown(wait=False)
    assert house.begun.end([pool], 0, 10 * SOON) == (["endless_0"], 0)
    over.set()


def test_the_rest_of_the_modules_is_pythons(house: House) -> None:
    assert house.threading.current_thread() is threading.current_thread()
    assert house.concurrent.futures is house.futures
    assert house.futures.ProcessPoolExecutor.__name__ == "ProcessPoolExecutor"
    assert house.futures.TimeoutError is TimeoutError
