"""Early wake-ups: a thread is woken before the message that it waits for is written."""

from __future__ import annotations

import pytest

from robocomp_py.transports.shm.early_wakeup import EVERY, TRIES, EarlyWakeup


def calls(trial: EarlyWakeup, count: int, usual: float, early_s: float) -> int:
    """Make calls that take so long in each way; how many were early_s."""
    hurries = 0
    for _ in range(count):
        early = trial.next()
        hurries += early
        if trial.trying:
            trial.took(early, early_s if early else usual)
    return hurries


@pytest.mark.parametrize(("early_s", "pays"), [(80e-6, True), (100e-6, False), (130e-6, False)])
def test_the_quicker_way_is_taken_and_the_usual_one_if_there_is_no_difference(early_s: float, pays: bool) -> None:
    trial = EarlyWakeup()
    assert calls(trial, 2 * TRIES, 100e-6, early_s) == TRIES  # as many in each way
    rest = EVERY - 2 * TRIES
    assert calls(trial, rest, 100e-6, early_s) == (rest if pays else 0)


def test_waking_early_is_tried_again_since_what_is_quicker_may_change() -> None:
    trial = EarlyWakeup()
    assert calls(trial, EVERY, 100e-6, 80e-6) == EVERY - TRIES
    assert calls(trial, EVERY, 50e-6, 80e-6) == TRIES


def test_calls_that_failed_while_it_was_tried_are_no_reason_for_either_way() -> None:
    trial = EarlyWakeup()
    for _ in range(EVERY):  # none of them is ever told to have taken a time
        trial.next()
    assert not trial.next()
    assert calls(trial, EVERY, 100e-6, 80e-6) > TRIES


def test_one_call_that_took_long_decides_nothing() -> None:
    trial = EarlyWakeup()
    for number in range(2 * TRIES):
        early = trial.next()
        trial.took(early, 1.0 if number == 3 else 80e-6 if early else 100e-6)
    assert trial.next()
