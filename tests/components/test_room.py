from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from world2d.room import VICTIM_RADIUS_M, Room, read_room

from .conftest import COMPONENTS
from .rooms import EAST, NORTH, SOUTH, WEST, empty_room

inside = st.floats(0.5, 9.0)


def distance(room: Room, x: float, z: float, heading: float, reach: float = 20.0) -> float:
    return float(room.distances((x, z), np.array([heading]), reach)[0])


@pytest.mark.parametrize(("heading", "expected"), [(NORTH, 3.0), (EAST, 6.0), (SOUTH, 7.0), (WEST, 4.0)])
def test_a_beam_ends_at_the_wall_it_points_at(heading: float, expected: float) -> None:
    assert distance(empty_room(), 4.0, 7.0, heading) == pytest.approx(expected)


def test_a_slanting_beam_is_longer() -> None:
    assert distance(empty_room(), 5.0, 8.0, np.pi / 4) == pytest.approx(2.0 * np.sqrt(2))


def test_beams_end_where_the_laser_cannot_reach_farther() -> None:
    assert distance(empty_room(), 5.0, 5.0, NORTH, reach=3.0) == 3.0


def test_a_beam_passes_beside_the_end_of_a_wall_and_not_through_it() -> None:
    room = replace(empty_room(), walls=(*empty_room().walls, ((4.0, 7.0), (6.0, 7.0))))
    assert distance(room, 5.9, 5.0, NORTH) == pytest.approx(2.0)
    assert distance(room, 6.1, 5.0, NORTH) == pytest.approx(5.0)


def test_a_beam_along_a_wall_is_not_stopped_by_it() -> None:
    room = replace(empty_room(), walls=(*empty_room().walls, ((5.0, 6.0), (5.0, 7.0))))
    assert distance(room, 5.01, 5.0, NORTH) == pytest.approx(5.0)


def test_a_beam_ends_at_the_near_side_of_a_pillar() -> None:
    room = replace(empty_room(), pillars=((5.0, 8.0, 0.5),))
    assert distance(room, 5.0, 5.0, NORTH) == pytest.approx(2.5)


def test_a_beam_does_not_see_what_is_behind() -> None:
    room = replace(empty_room(), pillars=((5.0, 2.0, 0.5),))
    assert distance(room, 5.0, 5.0, NORTH) == pytest.approx(5.0)


def test_furniture_stops_beams_on_all_its_sides() -> None:
    room = replace(empty_room(), furniture=(((4.0, 4.0), (6.0, 4.0), (6.0, 6.0), (4.0, 6.0)),))
    assert distance(room, 1.0, 5.0, EAST) == pytest.approx(3.0)
    assert distance(room, 9.0, 5.0, WEST) == pytest.approx(3.0)
    assert distance(room, 5.0, 1.0, NORTH) == pytest.approx(3.0)


def test_the_victim_stops_beams() -> None:
    assert distance(empty_room(), 9.5, 5.0, NORTH) == pytest.approx(4.5 - VICTIM_RADIUS_M)


@given(inside, inside)
def test_nothing_is_nearer_than_the_clearance(x: float, z: float) -> None:
    room = replace(empty_room(), furniture=(((4.0, 4.0), (6.0, 4.5), (5.0, 6.0)),), pillars=((2.0, 7.0, 0.4),))
    nearest = room.distances((x, z), np.linspace(-np.pi, np.pi, 3600), 20.0).min()
    if room.clearance((x, z)) > 0:
        assert room.clearance((x, z)) == pytest.approx(nearest, abs=0.02)


def test_the_shipped_house_has_room_for_the_robot_where_it_starts_and_charges() -> None:
    house = read_room(COMPONENTS / "house.toml")
    assert house.clearance(house.start[:2]) > 0.4
    assert house.clearance(house.charger) > 0.4
