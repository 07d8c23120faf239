"""Rates and durations follow from two answers of a component."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robocomp_py.runtime.RoboCompIntrospection import Description, Measure, Measures
from robocomp_py.tools.measure import load, milliseconds, percentile


def operation(count: int, latest: list[float], **others: int) -> Measure:
    made = Measure("Laser", "implements", "read", "world/Laser/read", "shm", count, timed=count)
    made.latest = np.array(latest, np.float32)
    for name, value in others.items():
        setattr(made, name, value)
    return made


def told(awake: float, *operations: Measure, computes: int = 0, processor: float = 0.0) -> Measures:
    return Measures(awake=awake, state="compute", computes=computes, processor=processor, operations=list(operations))


def test_rates_are_differences_of_two_answers() -> None:
    before = told(10.0, operation(100, [9.0] * 4), computes=100, processor=1.0)
    now = told(12.0, operation(104, [9.0, 9.0, 0.5, 0.25]), computes=140, processor=1.5)
    found = load("world", now, before, Description(pid=7, host="here"))
    assert (found.computes, found.processor, found.pid, found.host) == (20.0, 0.25, 7, "here")
    assert found.operations[0].rate == 2.0


def test_durations_are_those_between_the_two_answers() -> None:
    found = load("world", told(2.0, operation(3, [9.0, 0.5, 0.25])), told(1.0, operation(1, [9.0])))
    (one,) = found.operations
    assert (one.p50, one.longest) == (0.25, 0.5)
    assert math.isnan(one.waited)


def test_of_frequent_calls_the_timed_ones_between_the_two_answers_count() -> None:
    before, now = operation(6400, [9.0, 9.0], timed=100), operation(6528, [9.0, 0.5, 0.25], timed=102)
    (one,) = load("world", told(2.0, now), told(1.0, before)).operations
    assert (one.rate, one.p50, one.longest) == (128.0, 0.25, 0.5)


def test_the_first_answer_counts_since_the_start() -> None:
    found = load("world", told(4.0, operation(8, [0.5])))
    assert (found.operations[0].rate, found.operations[0].p50) == (2.0, 0.5)


def test_a_component_that_was_restarted_counts_since_its_start() -> None:
    found = load("world", told(2.0, operation(4, [])), told(100.0, operation(900, [])))
    assert found.operations[0].rate == 2.0


def test_an_operation_that_was_bound_again_counts_from_zero() -> None:
    found = load("world", told(2.0, operation(4, [0.5])), told(1.0, operation(900, [])))
    assert (found.operations[0].rate, found.operations[0].p50) == (4.0, 0.5)


def test_losses_and_refusals_are_added_up() -> None:
    one = load("a", told(1.0, operation(1, [], lost=2, dropped=3, malformed=1, mismatched=1, expired=1))).operations[0]
    assert (one.lost, one.refused, one.is_quiet) == (5, 3, False)


def test_nonsense_of_others_is_left_out() -> None:
    found = load("a", told(0.0, operation(3, [math.nan, math.inf, 0.5])))
    assert math.isnan(found.operations[0].rate)
    assert found.operations[0].longest == 0.5


@pytest.mark.parametrize(
    ("durations", "part", "expected"),
    [([3.0, 1.0, 2.0], 0.5, 2.0), ([1.0], 0.99, 1.0), ([float(n) for n in range(1, 101)], 0.99, 99.0)],
)
def test_a_percentile_is_one_of_the_durations(durations: list[float], part: float, expected: float) -> None:
    assert percentile(durations, part) == expected


def test_nothing_has_no_percentile() -> None:
    assert math.isnan(percentile([], 0.5))


def test_milliseconds_have_three_digits() -> None:
    assert [milliseconds(each) for each in (0.0000123, 0.0012345, 0.5, math.nan)] == ["0.012", "1.23", "500", ""]
