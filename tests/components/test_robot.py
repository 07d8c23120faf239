from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world2d.robot import COMMAND_LASTS_S, DRIVING, RADIUS_M, Base, Battery, Pose
from world2d.room import read_room

from .conftest import COMPONENTS
from .rooms import EAST, NORTH, empty_room

HOUSE = read_room(COMPONENTS / "house.toml")


def base(*, heading: float = NORTH, max_adv: float = 2.0, max_rot: float = 3.0) -> Base:
    return Base(empty_room(start=(5.0, 5.0, heading)), max_adv, max_rot)


def test_driving_moves_it_along_its_heading() -> None:
    robot = base(heading=EAST)
    robot.command(1.0, 0.0)
    assert robot.step(0.5) == (0.5, 0.0)
    assert robot.pose.place == pytest.approx((5.5, 5.0))


def test_turning_right_makes_the_heading_grow() -> None:
    robot = base()
    robot.command(0.0, 1.0)
    robot.step(0.5)
    assert robot.pose == Pose(5.0, 5.0, 0.5)


def test_driving_and_turning_right_leads_to_the_right() -> None:
    robot = base()
    robot.command(1.0, 1.0)
    robot.step(0.5)
    assert robot.pose.x > 5.0


def test_speeds_are_limited() -> None:
    robot = base(max_adv=1.0, max_rot=2.0)
    robot.command(9.0, -9.0)
    assert (robot.adv, robot.rot) == (1.0, -2.0)


def test_it_stops_without_commands_for_a_while() -> None:
    robot = base()
    robot.command(0.1, 0.0)
    for _ in range(4):
        robot.step(COMMAND_LASTS_S / 4)
    assert robot.moving
    robot.step(0.1)
    assert not robot.moving


def test_every_command_lets_it_go_on() -> None:
    robot = base()
    for _ in range(8):
        robot.command(0.1, 0.0)
        robot.step(COMMAND_LASTS_S / 2)
    assert robot.moving


def test_it_stops_where_it_touches_the_wall() -> None:
    robot = base()
    robot.command(2.0, 0.0)
    robot.step(20.0)
    assert robot.pose.z == pytest.approx(10.0 - RADIUS_M, abs=0.001)


def test_it_can_drive_away_from_a_wall() -> None:
    robot = base()
    robot.command(2.0, 0.0)
    robot.step(20.0)
    robot.command(-1.0, 0.0)
    assert robot.step(0.5)[0] == pytest.approx(0.5)


commands = st.tuples(st.floats(-3, 3), st.floats(-4, 4), st.floats(0.01, 1.5))


@given(st.lists(commands, max_size=40))
@settings(max_examples=60)
def test_it_never_gets_into_anything(history: list[tuple[float, float, float]]) -> None:
    robot = Base(HOUSE, 3.0, 4.0)
    for adv, rot, seconds in history:
        robot.command(adv, rot)
        robot.step(seconds)
        assert HOUSE.clearance(robot.pose.place) >= RADIUS_M
        assert 0 < robot.pose.x < 12
        assert 0 < robot.pose.z < 8


@given(st.lists(commands, max_size=20))
def test_an_untouched_odometer_knows_where_it_is(history: list[tuple[float, float, float]]) -> None:
    robot = base()
    for adv, rot, seconds in history:
        robot.command(adv, rot)
        robot.step(seconds)
    assert robot.odometer == robot.pose == robot.best


def test_an_odometer_that_was_set_goes_on_from_there() -> None:
    robot = base()
    robot.odometer = Pose(0.0, 0.0, EAST)
    robot.command(1.0, 0.0)
    robot.step(1.0)
    assert robot.odometer.place == pytest.approx((1.0, 0.0))
    assert robot.pose.place == pytest.approx((5.0, 6.0))


def test_headings_stay_within_half_a_turn() -> None:
    assert Pose(0.0, 0.0, 3.0).moved(0.0, 1.0).heading == pytest.approx(4.0 - math.tau)


def test_driving_takes_from_the_battery_by_the_metre() -> None:
    near, far = Battery(50.0), Battery(50.0)
    near.step(1.0, 1.0, 0.0, charging=False)
    far.step(1.0, 2.0, 0.0, charging=False)
    assert near.percent - far.percent == pytest.approx(DRIVING)


def test_standing_and_turning_take_something_too() -> None:
    standing, turning = Battery(50.0), Battery(50.0)
    standing.step(1.0, 0.0, 0.0, charging=False)
    turning.step(1.0, 0.0, 1.0, charging=False)
    assert turning.percent < standing.percent < 50.0


def test_a_battery_that_holds_more_lasts_longer() -> None:
    small, large = Battery(50.0, 1.0), Battery(50.0, 10.0)
    small.step(1.0, 1.0, 1.0, charging=False)
    large.step(1.0, 1.0, 1.0, charging=False)
    assert 50.0 - small.percent == pytest.approx(10 * (50.0 - large.percent))
    assert small.power == pytest.approx(large.power)


def test_at_the_charger_it_fills() -> None:
    battery = Battery(50.0)
    battery.step(1.0, 0.0, 0.0, charging=True)
    assert battery.percent > 50.0
    assert battery.power > 0
    assert battery.seconds_to_go == pytest.approx((100 - battery.percent) / battery.rate)


def test_the_time_to_go_is_until_it_is_empty() -> None:
    battery = Battery(50.0)
    battery.step(1.0, 1.0, 0.0, charging=False)
    assert battery.seconds_to_go == pytest.approx(battery.percent / -battery.rate)


Step = tuple[float, float, float, bool]
steps = st.tuples(st.floats(0.001, 60), st.floats(0, 10), st.floats(0, 10), st.booleans())


@given(st.floats(0, 100), st.lists(steps))
def test_a_battery_holds_between_nothing_and_all(percent: float, history: list[Step]) -> None:
    battery = Battery(percent)
    for seconds, driven, turned, charging in history:
        before = battery.percent
        battery.step(seconds, driven, turned, charging=charging)
        assert 0 <= battery.percent <= 100
        assert charging or battery.percent <= before


def test_obstacles_do_not_cost_what_was_not_driven() -> None:
    robot = Base(replace(empty_room(), start=(5.0, 9.0, NORTH)), 2.0, 3.0)
    robot.command(2.0, 0.0)
    driven, _ = robot.step(1.0)
    assert driven == pytest.approx(1.0 - RADIUS_M, abs=0.001)
