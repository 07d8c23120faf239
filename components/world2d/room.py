"""A house seen from above: its obstacles, and the distances to them.

Units are m, x to the right and z up the page. Headings are in rad: 0 is along z, and
they grow towards x.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Point = tuple[float, float]
Line = tuple[Point, ...]
"""Corners, joined by straight walls."""

VICTIM_RADIUS_M = 0.25


@dataclass(frozen=True)
class Room:
    """Walls and furniture, and the places that matter."""

    start: tuple[float, float, float]
    charger: Point
    victim: Point
    walls: tuple[Line, ...]
    furniture: tuple[Line, ...] = ()
    pillars: tuple[tuple[float, float, float], ...] = ()

    def distances(self, at: Point, headings: Floats, reach: float) -> Floats:
        """The distance to the nearest thing in each heading, at most `reach`."""
        rays = np.stack([np.sin(headings), np.cos(headings)], axis=1)
        straight = _to_walls(rays, self._from - at, self._along)
        round_ = _to_circles(rays, self._centres - at, self._radii)
        return np.minimum(np.minimum(straight, round_), reach)

    def clearance(self, at: Point) -> float:
        """The distance to the nearest thing."""
        to_start = self._from - at
        lengths = np.einsum("ij,ij->i", self._along, self._along)
        share = -np.einsum("ij,ij->i", to_start, self._along) / lengths
        nearest = to_start + np.clip(share, 0.0, 1.0)[:, None] * self._along
        straight = np.hypot(nearest[:, 0], nearest[:, 1]).min()
        centres = self._centres - at
        round_ = (np.hypot(centres[:, 0], centres[:, 1]) - self._radii).min()
        return float(min(straight, round_))

    @cached_property
    def _corners(self) -> Floats:
        """The two ends of each wall and of each edge of furniture."""
        lines = [*self.walls, *((*area, area[0]) for area in self.furniture)]
        pairs = [pair for line in lines for pair in pairwise(line)]
        return np.array(pairs, dtype=float)

    @cached_property
    def _from(self) -> Floats:
        return self._corners[:, 0]

    @cached_property
    def _along(self) -> Floats:
        along: Floats = self._corners[:, 1] - self._corners[:, 0]
        return along

    @cached_property
    def _circles(self) -> Floats:
        return np.array([*self.pillars, (*self.victim, VICTIM_RADIUS_M)])

    @cached_property
    def _centres(self) -> Floats:
        return self._circles[:, :2]

    @cached_property
    def _radii(self) -> Floats:
        return self._circles[:, 2]


def read_room(path: Path) -> Room:
    """The house in a TOML file."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    x, z, heading = data["start"]
    return Room(
        start=(x, z, heading),
        charger=_point(data["charger"]),
        victim=_point(data["victim"]),
        walls=_lines(data["walls"]),
        furniture=_lines(data.get("furniture", [])),
        pillars=tuple((x, z, radius) for x, z, radius in data.get("pillars", [])),
    )


def _lines(data: Sequence[Sequence[Sequence[float]]]) -> tuple[Line, ...]:
    return tuple(tuple(_point(corner) for corner in line) for line in data)


def _point(data: Sequence[float]) -> Point:
    x, z = data
    return x, z


def _to_walls(rays: Floats, starts: Floats, along: Floats) -> Floats:
    """The distance at which each ray meets a wall: ray * t = start + along * share."""
    turning = _cross(rays[:, None], along[None])
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel: no meeting
        t = _cross(starts, along)[None] / turning
        share = _cross(starts[None], rays[:, None]) / turning
    t[~((t >= 0) & (share >= 0) & (share <= 1))] = np.inf
    nearest: Floats = t.min(axis=1, initial=np.inf)
    return nearest


def _to_circles(rays: Floats, centres: Floats, radii: Floats) -> Floats:
    """The distance at which each ray meets a circle."""
    ahead = rays @ centres.T
    aside = _cross(rays[:, None], centres[None])
    inside = radii**2 - aside**2
    t = ahead - np.sqrt(np.maximum(inside, 0.0))
    t[(inside < 0) | (t < 0)] = np.inf
    nearest: Floats = t.min(axis=1, initial=np.inf)
    return nearest


def _cross(a: Floats, b: Floats) -> Floats:
    """The z of the cross product, over the last axis."""
    product: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
