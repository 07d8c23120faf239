"""A call ends once."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future

import pytest

from robocomp_py.errors import Closed, Timeout, Unreachable
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Status
from robocomp_py.transports.pending import Pending

OK = Reply(Status.OK, b"")


def test_an_answer_ends_it() -> None:
    pending = Pending("test")
    future = pending.add(1, 60)
    assert pending.settle(1, OK)
    assert future.result(0) == OK
    assert len(pending) == 0
    assert not pending.settle(1, OK)


def test_a_cancelled_call_is_forgotten_and_its_answer_ignored() -> None:
    pending = Pending("test")
    assert pending.add(1, 60).cancel()
    assert len(pending) == 0
    assert not pending.settle(1, OK)


def test_what_is_asked_again_under_its_number_is_another_call(monkeypatch: pytest.MonkeyPatch) -> None:
    pending, asked_again = Pending("test"), threading.Event()
    first, tell = pending.add(1, 60), vars(Future)["_invoke_callbacks"]

    def tell_late(future: Future[Reply]) -> None:  # a waiting caller continues before
        assert future is not first or asked_again.wait(SOON)
        tell(future)

    monkeypatch.setattr(Future, "_invoke_callbacks", tell_late)
    failing = threading.Thread(target=lambda: pending.fail(1, Unreachable("its server left")))
    failing.start()
    with pytest.raises(Unreachable):
        first.result(SOON)
    second = pending.add(1, 60)
    asked_again.set()
    failing.join()
    assert pending.knows(1)
    assert pending.settle(1, OK)
    assert second.result(0) == OK


def test_the_deadline_ends_it() -> None:
    pending = Pending("test")
    late, early = pending.add(1, 60), pending.add(2, 0.0)
    wait = pending.expire()
    assert wait is not None
    assert 0 < wait <= 60
    with pytest.raises(Timeout, match="no answer in 0 s"):
        early.result(0)
    assert not late.done()


def test_a_call_that_has_waited_for_something_before_ends_no_later_for_that() -> None:
    pending = Pending("test")
    future = pending.add(1, 60, end=time.monotonic())
    assert pending.expire() is None
    with pytest.raises(Timeout, match="no answer in 60 s"):
        future.result(0)


def test_what_is_overdue_is_to_be_ended_once_however_often_one_looks_before_that_is_done() -> None:
    pending, jobs = Pending("test"), list[Callable[[], object]]()
    future = pending.add(1, 0.0)
    assert [pending.expire(jobs.append) for _ in range(3)] == [None] * 3
    assert len(jobs) == 1
    jobs.pop()()
    with pytest.raises(Timeout, match="no answer in 0 s"):
        future.result(0)


def test_with_no_call_there_is_nothing_to_wait_for() -> None:
    assert Pending("test").expire() is None


def test_closing_ends_them_all() -> None:
    pending = Pending("test")
    futures = [pending.add(number, 60) for number in range(3)]
    pending.fail_all(Closed("closed"))
    wait_until(lambda: all(future.done() for future in futures))
    for future in futures:
        with pytest.raises(Closed):
            future.result(0)


def test_calls_can_be_ended_in_another_thread() -> None:
    pending = Pending("test")
    overdue, other = pending.add(1, 0.0), pending.add(("peer", 2), 60)
    jobs: list[Callable[[], object]] = []
    pending.expire(jobs.append)
    pending.fail_all(Unreachable("left"), only=lambda key: key == ("peer", 2), do=jobs.append)
    assert not overdue.done()
    assert not other.done()
    for job in jobs:
        job()
    assert isinstance(overdue.exception(0), Timeout)
    assert isinstance(other.exception(0), Unreachable)


def test_after_closing_no_call_begins() -> None:
    pending = Pending("test")
    future = pending.add(1, 60)
    pending.close(Closed("closed"))
    assert isinstance(future.exception(0), Closed)
    with pytest.raises(Closed):
        pending.add(2, 60)
