"""Who waits in Python's library lets others in meanwhile, and who need not wait does not."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, Full
from types import ModuleType
from typing import Any

import pytest

from robocomp_py.compat import waits
from robocomp_py.testing.patience import SOON, wait_until


class House:
    """The modules of a component, and who of it is outside."""

    def __init__(self) -> None:
        self.outside: set[int] = set()
        self.left = 0
        """How often somebody went outside."""
        self.locked = 0
        """How many locks are taken."""
        self.modules = waits.modules(self._released, self._count, lambda thread: None)

    def __getattr__(self, name: str) -> ModuleType:
        return self.modules[name]

    @property
    def futures(self) -> Any:
        return self.modules["concurrent.futures"]

    @contextmanager
    def _released(self) -> Iterator[None]:
        here = threading.get_ident()
        is_first = here not in self.outside
        self.left += 1
        self.outside.add(here)
        try:
            yield
        finally:
            if is_first:
                self.outside.discard(here)

    def _count(self, change: int) -> None:
        self.locked += change


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
def test_who_waits_is_outside(house: House, scene: Callable[[House], Scene]) -> None:
    wait, end = scene(house)
    waiting = threading.Thread(target=wait)
    waiting.start()
    wait_until(lambda: waiting.ident in house.outside, SOON, "it waits")
    assert waiting.is_alive()
    end()
    waiting.join(SOON)
    assert not waiting.is_alive()
    assert not house.outside


def test_who_need_not_wait_stays_inside(house: House) -> None:
    queue = house.queue.Queue(1)
    queue.put(1)
    with pytest.raises(Full):
        queue.put_nowait(2)
    assert queue.get() == 1
    for each in (queue, house.queue.SimpleQueue()):
        with pytest.raises(Empty):
            each.get(False)
    future = house.futures.Future()
    future.set_result(1)
    assert (future.result(), future.exception()) == (1, None)
    with house.threading.Lock(), house.threading.Semaphore(), house.threading.RLock(), house.threading.Condition():
        pass
    assert house.left == 0


def test_who_waits_for_a_condition_holds_no_lock_however_often_it_was_taken(house: House) -> None:
    wait, notify = condition(house)
    waiting = threading.Thread(target=wait)
    waiting.start()
    wait_until(lambda: waiting.ident in house.outside and not house.locked, SOON, "it waits, and no lock is taken")
    notify()
    waiting.join(SOON)
    assert not waiting.is_alive()
    assert house.locked == 0


def test_the_action_of_a_barrier_runs_inside(house: House) -> None:
    acting: list[bool] = []
    made = house.threading.Barrier(2, lambda: acting.append(threading.get_ident() in house.outside))
    waiting = threading.Thread(target=made.wait)
    waiting.start()
    wait_until(lambda: made.n_waiting == 1, SOON, "it waits")
    made.wait()
    waiting.join(SOON)
    assert acting == [False]


def test_the_rest_of_the_modules_is_pythons(house: House) -> None:
    assert house.threading.current_thread() is threading.current_thread()
    assert house.concurrent.futures is house.futures
    assert house.futures.ProcessPoolExecutor.__name__ == "ProcessPoolExecutor"
    assert house.futures.TimeoutError is TimeoutError
