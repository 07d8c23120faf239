"""What others can bring about as often as they like is logged sparingly."""

from __future__ import annotations

from robocomp_py.transports.sparing import FIRST, PAUSE, Repeats, Sparing


def test_the_first_messages_are_logged_and_later_ones_now_and_then() -> None:
    clock = 0.0
    sparing = Sparing(now=lambda: clock)
    told = []
    for _ in range(1000):
        told.append(sparing.may_tell())
        clock += PAUSE / 100
    assert told[: FIRST + 1] == [True] * FIRST + [False]
    assert sum(told) == FIRST + 1000 // 100 - 1 or sum(told) == FIRST + 1000 // 100


def test_repeated_messages_are_logged_now_and_then_with_the_number_skipped() -> None:
    clock = 0.0
    repeats = Repeats(now=lambda: clock)
    assert [repeats.untold(way) for way in ("one", "other", "one", "one", "other")] == [0, 0, None, None, None]
    clock = PAUSE
    assert [repeats.untold(way) for way in ("one", "other", "one")] == [2, 1, None]


def test_what_is_kept_in_mind_of_many_ways_is_bounded() -> None:
    repeats = Repeats(now=lambda: 0.0)
    assert [repeats.untold(way) for way in range(1000)] == [0] * 1000
    assert len(repeats._told) <= 100
