"""A sender may be so far ahead of its readers, and no further."""

from __future__ import annotations

import threading
import time

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.transports.credit import Credit
from robocomp_py.transports.limits import BYTES_AHEAD


def still() -> None: ...


def now() -> float:
    return time.monotonic()


def test_without_readers_there_is_no_wait() -> None:
    credit = Credit(2, dict)
    assert all(credit.wait(now(), still) for _ in range(100))
    assert credit.sent == 100


def test_the_slowest_reader_decides() -> None:
    credit = Credit(2, lambda: {1: 0, 2: 0})
    assert [credit.wait(now(), still) for _ in range(3)] == [True, True, False]
    credit.took(1, 2)
    assert not credit.wait(now(), still)
    credit.took(2, 1)
    assert credit.wait(now(), still)
    assert credit.sent == 3


def test_new_readers_count_from_their_arrival_and_departed_ones_do_not_count() -> None:
    readers: dict[int, int] = {}
    credit = Credit(1, lambda: readers)
    assert credit.wait(now(), still)
    readers[1] = 5
    assert [credit.wait(now(), still) for _ in range(2)] == [True, False]
    readers.clear()
    assert credit.wait(now(), still)


def test_a_reader_that_returned_between_two_looks_counts_from_its_return() -> None:
    readers = {1: 5}
    credit = Credit(1, lambda: readers)
    assert credit.wait(now(), still)
    readers[1] = 7
    assert [credit.wait(now(), still) for _ in range(2)] == [True, False]


def test_what_is_on_its_way_is_limited_in_bytes_too_whatever_comes_next() -> None:
    credit = Credit(100, lambda: {1: 0})
    assert [credit.wait(now(), still, size) for size in (BYTES_AHEAD - 1, 2 * BYTES_AHEAD, 1)] == [True, True, False]
    credit.took(1, 1)
    assert not credit.wait(now(), still, 1)
    credit.took(1, 2)
    assert credit.wait(now(), still, 1)


def test_what_all_have_taken_is_not_asked_before_it_matters() -> None:
    looks = list[int]()
    credit = Credit(4, lambda: looks.append(credit.sent) or {1: 0})  # type: ignore[func-returns-value]
    assert not credit.claim()
    assert [credit.wait(now(), still)] + [credit.claim() for _ in range(4)] == [True, True, True, True, False]
    assert looks == [0]


def test_lies_about_what_was_taken_gain_nothing() -> None:
    credit = Credit(1, lambda: {1: 0})
    assert credit.wait(now(), still)
    credit.took(2, 1)
    credit.took(1, 2**63)
    credit.took(1, 0)
    assert [credit.wait(now(), still) for _ in range(2)] == [True, False]


def test_an_acknowledgement_ends_the_wait() -> None:
    credit = Credit(1, lambda: {1: 0})
    assert credit.wait(now(), still)
    threading.Timer(0.05, credit.took, (1, 1)).start()
    assert credit.wait(now() + SOON, still)


def test_waiting_ends_when_there_is_no_point_in_it() -> None:
    credit = Credit(1, lambda: {1: 0})
    assert credit.wait(now(), still)

    def closed() -> None:
        raise KeyError

    with pytest.raises(KeyError):
        credit.wait(now() + SOON, closed)
