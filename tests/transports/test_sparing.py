"""What others can bring about as often as they like is logged sparingly."""

from __future__ import annotations

from robocomp_py.transports.sparing import FIRST, PAUSE, Sparing


def test_the_first_few_are_told_and_later_one_now_and_then() -> None:
    clock = 0.0
    sparing = Sparing(now=lambda: clock)
    told = []
    for _ in range(1000):
        told.append(sparing.may_tell())
        clock += PAUSE / 100
    assert told[: FIRST + 1] == [True] * FIRST + [False]
    assert sum(told) == FIRST + 1000 // 100 - 1 or sum(told) == FIRST + 1000 // 100
