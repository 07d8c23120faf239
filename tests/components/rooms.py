"""Rooms and robots to test with."""

from __future__ import annotations

from world2d.room import Room

WALLS = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0), (0.0, 0.0))

NORTH, EAST, SOUTH, WEST = 0.0, 1.5707963267948966, 3.141592653589793, -1.5707963267948966


def empty_room(*, start: tuple[float, float, float] = (5.0, 5.0, NORTH)) -> Room:
    """10 m by 10 m, empty except for a victim in the north-east corner."""
    return Room(start=start, charger=(1.0, 1.0), victim=(9.5, 9.5), walls=(WALLS,))
