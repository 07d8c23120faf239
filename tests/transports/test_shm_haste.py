"""Whether somebody is woken before what he waits for is written."""

from __future__ import annotations

import pytest

from robocomp_py.transports.shm.haste import EVERY, TRIES, Haste


def calls(haste: Haste, count: int, usual: float, hurried: float) -> int:
    """Make calls that take so long in each way; how many were hurried."""
    hurries = 0
    for _ in range(count):
        hurry = haste.next()
        hurries += hurry
        if haste.trying:
            haste.took(hurry, hurried if hurry else usual)
    return hurries


@pytest.mark.parametrize(("hurried", "pays"), [(80e-6, True), (100e-6, False), (130e-6, False)])
def test_the_quicker_way_is_taken_and_the_usual_one_if_there_is_no_difference(hurried: float, pays: bool) -> None:
    haste = Haste()
    assert calls(haste, 2 * TRIES, 100e-6, hurried) == TRIES  # as many in each way
    rest = EVERY - 2 * TRIES
    assert calls(haste, rest, 100e-6, hurried) == (rest if pays else 0)


def test_it_is_tried_again_since_what_is_quicker_may_change() -> None:
    haste = Haste()
    assert calls(haste, EVERY, 100e-6, 80e-6) == EVERY - TRIES
    assert calls(haste, EVERY, 50e-6, 80e-6) == TRIES


def test_calls_that_failed_while_it_was_tried_are_no_reason_for_either_way() -> None:
    haste = Haste()
    for _ in range(EVERY):  # none of them is ever told to have taken a time
        haste.next()
    assert not haste.next()
    assert calls(haste, EVERY, 100e-6, 80e-6) > TRIES


def test_one_call_that_took_long_decides_nothing() -> None:
    haste = Haste()
    for number in range(2 * TRIES):
        hurry = haste.next()
        haste.took(hurry, 1.0 if number == 3 else 80e-6 if hurry else 100e-6)
    assert haste.next()
