"""When the leader of a clock goes on: speed, pauses and steps."""

from __future__ import annotations

import math

import pytest

from robocomp_py.lockstep.pace import Pace, Stand
from robocomp_py.runtime.clock import NEVER, SECOND


class Machine:
    """Its time passes only when a test says so."""

    def __init__(self) -> None:
        self.seconds = 100.0

    def __call__(self) -> float:
        return self.seconds


def pace(speed: float = 1.0) -> tuple[Pace, Machine]:
    machine = Machine()
    made = Pace(speed, machine)
    made.begin(0)
    return made, machine


def reached(made: Pace, *instants: int) -> list[int | None]:
    return [made.wait(each) for each in instants]


def test_at_full_speed_every_instant_comes_at_once() -> None:
    made, _ = pace(0)
    assert reached(made, 0, SECOND, 10 * SECOND) == [0, SECOND, 10 * SECOND]


def test_an_instant_comes_when_its_time_has_passed_at_the_speed() -> None:
    made, machine = pace(2.0)
    assert reached(made, 0, SECOND) == [0, None]
    machine.seconds += 0.5
    assert reached(made, SECOND, 2 * SECOND) == [SECOND, None]


def test_an_instant_that_is_never_due_does_not_come() -> None:
    made, _ = pace(0)
    assert made.wait(NEVER) is None


def test_a_pause_takes_no_time_of_the_clock() -> None:
    made, machine = pace()
    made.wait(0)
    machine.seconds += 0.6
    made.pause()
    machine.seconds += 60.0
    assert made.wait(SECOND) is None
    assert made.stand == Stand(1.0, True)
    made.resume()
    assert made.wait(SECOND) is None
    machine.seconds += 0.41
    assert made.wait(SECOND) == SECOND


def test_another_speed_counts_from_now_on() -> None:
    made, machine = pace()
    made.wait(0)
    machine.seconds += 0.5
    made.set_speed(0.1)
    machine.seconds += 4.0
    assert made.wait(SECOND) is None
    machine.seconds += 1.1
    assert made.wait(SECOND) == SECOND


def test_from_full_speed_to_real_time_the_clock_goes_on_from_its_instant() -> None:
    made, machine = pace(0)
    reached(made, 0, 500 * SECOND)
    made.set_speed(1.0)
    assert made.wait(501 * SECOND) is None
    machine.seconds += 1.01
    assert made.wait(501 * SECOND) == 501 * SECOND


def test_a_step_passes_at_once_and_ends_between_two_instants() -> None:
    made, machine = pace()
    made.pause()
    assert made.step(2.5) == 5 * SECOND // 2
    assert made.stand.paused is False
    assert reached(made, 0, SECOND, 2 * SECOND, 3 * SECOND) == [0, SECOND, 2 * SECOND, 5 * SECOND // 2]
    assert made.stand.paused is False, "what is due at that instant is not done yet"
    machine.seconds += 60.0
    assert made.wait(3 * SECOND) is None
    assert made.stand.paused is True
    made.resume()
    machine.seconds += 0.51
    assert made.wait(3 * SECOND) == 3 * SECOND


def test_a_step_lets_time_pass_although_nothing_is_due() -> None:
    made, _ = pace()
    made.step(1.0)
    assert reached(made, NEVER, NEVER) == [SECOND, None]


def test_a_step_during_a_step_is_added_to_it() -> None:
    made, _ = pace()
    assert [made.step(1.0), made.step(1.0)] == [SECOND, 2 * SECOND]


@pytest.mark.parametrize("seconds", [0.0, -1.0, math.nan, math.inf])
def test_a_step_of_no_positive_duration_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="a step takes a positive number of seconds"):
        pace()[0].step(seconds)


@pytest.mark.parametrize("speed", [-1.0, math.nan, math.inf])
def test_a_wrong_speed_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="a speed is a number from 0"):
        pace()[0].set_speed(speed)


def test_closing_ends_a_wait() -> None:
    made, _ = pace()
    made.close()
    assert made.wait(SECOND) is None
