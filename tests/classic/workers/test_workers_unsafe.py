"""What workers take from CPython beyond its public interface is there; without it, a process still ends."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import pytest

from robocomp_py.classic.workers import unsafe
from robocomp_py.testing.patience import SOON

PRIVATE = ("_register", "_awaited")

T = TypeVar("T")

ENDING = """\
import sys, threading
from robocomp_py.classic.workers import unsafe
for name in sys.argv[1:]:
    setattr(unsafe, name, None)
ended = threading.Event()
def run():
    ended.wait(SECONDS)
    print("thread", flush=True)
def called():
    print("called", flush=True)
    ended.set()
threading.Thread(target=run).start()
unsafe.before_threads(called)
"""

POOL = """\
import concurrent.futures, sys, threading
from robocomp_py.classic.workers import unsafe
for name in sys.argv[1:]:
    setattr(unsafe, name, None)
begun = threading.Event()
def run(seconds):
    begun.set()
    threading.Event().wait(seconds)
    print("waited for", flush=True)
pool = concurrent.futures.ThreadPoolExecutor(1)
def begin():
    pool.submit(run, SECONDS)
thread = threading.Thread(target=begin, daemon=True)
thread.start()
thread.join()
begun.wait()
[each] = [each for each in threading.enumerate() if each not in (threading.main_thread(), thread)]
unsafe.not_awaited(each)
"""


def printed(code: str, seconds: float, *missing: str) -> list[str]:
    call = [sys.executable, "-c", code.replace("SECONDS", str(seconds)), *missing]
    done = subprocess.run(call, capture_output=True, text=True, timeout=SOON * 6, check=True)
    return done.stdout.splitlines()


def test_all_private_names_exist_in_this_python() -> None:
    assert [name for name in PRIVATE if getattr(unsafe, name) is None] == []
    assert [name for name in unsafe.POOL if not hasattr(unsafe.Pool(1), name)] == []
    assert [name for name in unsafe.CONDITION if not hasattr(unsafe.Condition(), name)] == []
    assert hasattr(threading.Barrier(1), "_cond")


def test_a_call_comes_before_the_wait_for_threads_or_else_after_it() -> None:
    assert printed(ENDING, 60) == ["called", "thread"]
    assert printed(ENDING, 0.1, "_register") == ["thread", "called"]


def test_python_does_not_wait_for_a_thread_of_a_pool_unless_it_has_to() -> None:
    assert printed(POOL, 50) == []
    assert printed(POOL, 0.1, "_awaited") == ["waited for"]


@pytest.mark.parametrize("missing", [False, True])
def test_a_pool_makes_its_calls_also_without_the_private_parts(monkeypatch: pytest.MonkeyPatch, missing: bool) -> None:
    if missing:
        monkeypatch.setattr(unsafe, "POOL", ("_no_such_part",))
    pool, begun = unsafe.Pool(1), list[threading.Thread]()
    monkeypatch.setattr(pool, "begun", begun.append)
    assert pool.submit(len, "abc").result() == 3
    assert (len(pool.threads), len(begun)) == ((0, 0) if missing else (1, 1))
    pool.shutdown()
    assert (pool.ended, pool.waiting) == (not missing, 0)


class Loop:
    def __init__(self) -> None:
        self.waits = 0

    def outside(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def wait_for(self, function: Callable[[], T]) -> T:
        self.waits += 1
        return function()


@pytest.mark.parametrize("missing", [False, True])
def test_a_condition_waits_also_without_the_private_parts(monkeypatch: pytest.MonkeyPatch, missing: bool) -> None:
    if missing:
        monkeypatch.setattr(unsafe, "CONDITION", ("_no_such_part",))
    loop, condition = Loop(), unsafe.Condition()
    with condition:
        assert not condition.wait_outside(loop, 0.001)
    assert loop.waits == (0 if missing else 1)


def test_a_lock_without_the_private_parts_is_released_and_taken_once() -> None:
    for lock in (threading.RLock(), threading.Lock()):
        lock.acquire()
        state = unsafe.release_all(lock)
        assert state[0] == 1
        assert lock.acquire(False)
        lock.release()
        unsafe.retake(lock, state)
        lock.release()


def test_what_is_given_to_exit_is_noted_and_then_exit_is_as_before() -> None:
    noted: list[Any] = []
    before = sys.exit
    with unsafe.exits_noted(noted.append), pytest.raises(SystemExit) as ended:
        sys.exit(3)
    assert (noted, ended.value.code) == ([3], 3)
    assert sys.exit is before
