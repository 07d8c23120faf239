from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from wander.steering import LEFT, RIGHT, Course, Scan, Way, along_wall, free_m, speeds
from world2d.robot import RADIUS_M, Base
from world2d.room import Room, read_room

from .conftest import COMPONENTS
from .rooms import EAST, NORTH, WEST, empty_room

DIRECTIONS = np.radians(np.linspace(-135, 135, 91))


def scan_at(room: Room, x: float, z: float, heading: float) -> Scan:
    return Scan(DIRECTIONS, room.distances((x, z), heading + DIRECTIONS, 5.0))


def drive(room: Room, choose: Callable[[Scan, Base], Way], seconds: float) -> list[tuple[float, float]]:
    """The places it comes to, ten decisions a second, without ever touching anything."""
    base = Base(room, 1.5, 2.5)
    places = []
    for _ in range(round(seconds * 10)):
        base.command(*speeds(choose(scan_at(room, *base.pose.place, base.pose.heading), base), 1.2))
        base.step(0.1)
        assert room.clearance(base.pose.place) > RADIUS_M + 0.05
        places.append(base.pose.place)
    return places


def test_a_direction_is_free_up_to_what_comes_too_near() -> None:
    scan = scan_at(empty_room(), 5.0, 8.0, NORTH)
    ahead, beside = free_m(scan, np.array([0.0, math.pi / 2]))
    assert ahead == pytest.approx(2.0 - 0.4, abs=0.05)
    assert beside > 4.0


@pytest.mark.parametrize(("hand", "x", "heading"), [(LEFT, 0.5, NORTH), (RIGHT, 9.5, NORTH), (RIGHT, 0.5, math.pi)])
def test_along_a_wall_at_its_hand_it_goes_nearly_straight(hand: int, x: float, heading: float) -> None:
    way = along_wall(scan_at(empty_room(), x, 5.0, heading), hand)
    assert abs(way.direction) < 0.3
    assert way.ahead_m > 1.0


def test_before_a_wall_it_turns_away_from_its_hand() -> None:
    scan = scan_at(empty_room(), 5.0, 9.3, NORTH)
    assert along_wall(scan, LEFT).direction > 0.8
    assert along_wall(scan, RIGHT).direction < -0.8


def test_with_nothing_near_it_goes_straight_on() -> None:
    assert along_wall(scan_at(empty_room(), 5.0, 5.0, NORTH), LEFT).direction == pytest.approx(0.0)


def test_in_a_dead_end_it_turns_on_the_spot() -> None:
    scan = Scan(DIRECTIONS, np.full(DIRECTIONS.size, 0.45))
    way = along_wall(scan, LEFT)
    assert way.direction > 0
    assert speeds(way, 1.0)[0] == 0.0


def test_it_drives_slower_the_more_it_has_to_turn_and_the_less_room_it_has() -> None:
    straight, turning, close = (speeds(way, 1.0)[0] for way in (Way(0.0, 9.0), Way(0.5, 9.0), Way(0.0, 0.3)))
    assert straight == 1.0
    assert turning < straight
    assert close < straight


@pytest.mark.parametrize("hand", [LEFT, RIGHT])
def test_following_the_walls_leads_through_the_whole_house_without_touching(hand: int) -> None:
    house = read_room(COMPONENTS / "house.toml")
    places = drive(house, lambda scan, base: along_wall(scan, hand), 90.0)
    for corner in ((1.0, 1.0), (1.0, 7.0), (6.0, 7.0), (11.0, 7.0), (11.0, 1.0), (6.0, 1.5)):
        assert min(math.dist(corner, place) for place in places) < 1.2


def heading_for(target: tuple[float, float]) -> Callable[[Scan, Base], Way]:
    course = Course()

    def choose(scan: Scan, base: Base) -> Way:
        dx, dz = target[0] - base.pose.x, target[1] - base.pose.z
        bearing = math.remainder(math.atan2(dx, dz) - base.pose.heading, math.tau)
        return course.way(scan, bearing, math.hypot(dx, dz))

    return choose


def test_it_first_turns_to_where_it_wants_to_go() -> None:
    way = Course().way(scan_at(empty_room(), 5.0, 5.0, NORTH), 2.0, 3.0)
    assert (way.direction, speeds(way, 1.0)[0]) == (2.0, 0.0)


def test_a_free_way_is_a_straight_way() -> None:
    places = drive(empty_room(start=(2.0, 5.0, EAST)), heading_for((7.0, 5.0)), 6.0)
    assert min(math.dist(place, (7.0, 5.0)) for place in places) < 0.3
    assert all(abs(z - 5.0) < 0.05 for _, z in places)


@pytest.mark.parametrize("length", [1.0, 2.5, 3.5])
def test_it_gets_round_a_wall_that_stands_between(length: float) -> None:
    wall = ((5.0, 5.0 - length), (5.0, 5.0 + length * 0.8))
    room = replace(empty_room(start=(2.0, 5.0, EAST)), walls=(*empty_room().walls, wall))
    places = drive(room, heading_for((8.0, 5.0)), 30.0)
    assert min(math.dist(place, (8.0, 5.0)) for place in places) < 0.3


def test_it_gets_out_of_a_pocket() -> None:
    pocket = ((4.0, 6.5), (6.0, 6.5), (6.0, 3.5), (4.0, 3.5))
    room = replace(empty_room(start=(3.0, 5.2, EAST)), walls=(*empty_room().walls, pocket))
    places = drive(room, heading_for((8.0, 5.0)), 40.0)
    assert min(math.dist(place, (8.0, 5.0)) for place in places) < 0.3


def test_from_everywhere_in_the_house_it_finds_home() -> None:
    house = read_room(COMPONENTS / "house.toml")
    for start in ((6.5, 7.4, EAST), (11.0, 7.0, WEST), (11.0, 2.0, NORTH), (6.0, 1.5, EAST), (2.5, 1.0, EAST)):
        places = drive(replace(house, start=start), heading_for(house.charger), 40.0)
        assert min(math.dist(place, house.charger) for place in places) < 0.3, start
