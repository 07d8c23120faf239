"""Draws the view from a place in the house, column by column.

Units are m and rad, with the axes of the map: x to the right, z up the page, headings
from z towards x. All things stand upright, so one ray for each column of the picture
is enough; nearer things hide those behind them.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

EYE_M = 0.9


@dataclass(frozen=True)
class Things:
    """Upright things of one height and colour: flat ones and round ones."""

    height_m: float
    colour: Colour
    edges: Floats
    """Rows of x, z of the beginning of an edge, and x, z of its end."""
    posts: Floats
    """Rows of x, z, radius."""


@dataclass(frozen=True)
class House:
    """All visible things."""

    things: tuple[Things, ...]
    victim: tuple[float, float]


@dataclass(frozen=True)
class Lens:
    """The size of the pictures, and their field of view."""

    width: int
    height: int
    field_of_view: float
    """rad from the left edge to the right one."""

    @property
    def focal(self) -> float:
        """The height in pixels of 1 m at a distance of 1 m."""
        return self.width / 2 / math.tan(self.field_of_view / 2)


def read_house(path: Path) -> House:
    """Read the house from a map, with its furniture."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    no_posts = np.empty((0, 3))
    walls = Things(2.4, WALL, _edges(data["walls"], closed=False), no_posts)
    furniture = Things(
        1.0, WOOD, _edges(data.get("furniture", []), closed=True), no_posts
    )
    pillars = np.array(data.get("pillars", []), dtype=float).reshape(-1, 3)
    posts = Things(2.4, WOOD, np.empty((0, 4)), pillars)
    x, z = data["victim"]
    return House((walls, furniture, posts), (x, z))


def render(house: House, lens: Lens, x: float, z: float, heading: float) -> Pixels:
    """The picture of a camera at this place: rows of pixels of red, green and blue."""
    columns = np.arange(lens.width) - (lens.width - 1) / 2
    rows = np.arange(lens.height, dtype=float) - (lens.height - 1) / 2
    aside = np.arctan(columns / lens.focal)
    canvas = _Canvas(lens, rows[:, None])
    canvas.fill_ground(np.array([x, z]), heading + aside, 1 / np.cos(aside))
    for things in house.things:
        distance, light = _nearest(things, np.array([x, z]), heading + aside)
        canvas.draw_columns(things, distance * np.cos(aside), light)
    canvas.draw_figure(*_relative(house.victim, x, z, heading))
    return canvas.pixels


class _Canvas:
    """Pixels, and the distance of the thing that each shows."""

    def __init__(self, lens: Lens, rows: Floats) -> None:
        self.pixels = np.empty((lens.height, lens.width, 3), np.uint8)
        self._whole = _whole(self.pixels)
        self._depth = np.full((lens.height, lens.width), np.inf)
        self._lens, self._rows = lens, rows

    def fill_ground(self, at: Floats, headings: Floats, stretch: Floats) -> None:
        """Draw a tiled floor below the horizon, and a plain ceiling above."""
        horizon = np.count_nonzero(self._rows < 0)
        depth = EYE_M * self._lens.focal / np.maximum(self._rows[horizon:], 0.5)
        reach = depth * stretch
        tiles = np.floor((at[0] + reach * np.sin(headings)) * 2)
        tiles += np.floor((at[1] + reach * np.cos(headings)) * 2)
        is_light = tiles != 2 * np.floor(tiles / 2)  # `%` takes several times as long
        light, dark = (_whole(share * _fade(depth) * FLOOR) for share in (1.0, 0.88))
        self.pixels[:horizon] = CEILING
        self._whole[horizon:] = np.where(is_light, light[:, None], dark[:, None])

    def draw_columns(self, things: Things, depth: Floats, light: Floats) -> None:
        """Draw things at this distance in each column."""
        scale = self._lens.focal / depth
        top = (EYE_M - things.height_m) * scale
        bottom = EYE_M * scale
        hit = (self._rows >= top) & (self._rows <= bottom) & (depth < self._depth)
        colour = (light * _fade(depth))[:, None] * things.colour
        np.copyto(self._whole, _whole(colour), where=hit)
        np.copyto(self._depth, depth, where=hit)

    def draw_figure(self, ahead: float, aside: float) -> None:
        """Draw the victim, in red and waving, this far ahead and to the right."""
        if ahead < 0.1:
            return
        scale = self._lens.focal / ahead
        high, wide = FIGURE.shape
        pixel_m = FIGURE_M / high
        columns = np.arange(self._lens.width) - (self._lens.width - 1) / 2
        across = np.floor((columns / scale - aside) / pixel_m + wide / 2).astype(int)
        down = np.floor((self._rows[:, 0] / scale - EYE_M) / pixel_m).astype(int) + high
        inside_columns = (across >= 0) & (across < wide)
        inside_rows = (down >= 0) & (down < high)
        part = FIGURE[np.clip(down, 0, high - 1)][:, np.clip(across, 0, wide - 1)]
        shown = (part > 0) & (ahead < self._depth)
        shown &= inside_rows[:, None] & inside_columns
        self.pixels[shown] = FIGURE_COLOURS[part[shown]]
        self._depth[shown] = ahead


def _whole(colours: NDArray[Any]) -> NDArray[np.void]:
    """Each colour as one element: it is copied at once, several times as fast."""
    return colours.astype(np.uint8, copy=False).view("V3")[..., 0]


def _nearest(things: Things, at: Floats, headings: Floats) -> tuple[Floats, Floats]:
    """The distance to the nearest of these things, and its brightness."""
    ray = np.stack([np.sin(headings), np.cos(headings)])[:, :, None]
    start = (things.edges[:, :2] - at).T[:, None]
    along = (things.edges[:, 2:] - things.edges[:, :2]).T[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel: never met
        turning = _cross(ray, along)
        flat = _cross(start, along) / turning
        share = _cross(start, ray) / turning
    flat[~((flat > 0) & (share >= 0) & (share <= 1))] = np.inf

    centre = (things.posts[:, :2] - at).T[:, None]
    inside = things.posts[:, 2] ** 2 - _cross(ray, centre) ** 2
    round_ = (ray * centre).sum(axis=0) - np.sqrt(np.maximum(inside, 0.0))
    round_[(inside < 0) | (round_ <= 0)] = np.inf

    slant = np.abs(along[0, 0]) / np.maximum(np.hypot(*along[:, 0]), 0.001)
    posts_light = np.full(len(things.posts), 0.9)
    light = np.concatenate([0.8 + 0.2 * slant, posts_light, [1.0]])
    nothing = np.full((len(headings), 1), np.inf)
    distance = np.concatenate([flat, round_, nothing], axis=1)
    first = distance.argmin(axis=1)
    nearest: Floats = distance[np.arange(len(headings)), first]
    return nearest, light[first]


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a[0] * b[1] - a[1] * b[0]
    return product


def _fade(depth: Floats) -> Floats:
    """The brightness at a distance: less light comes from farther away."""
    fading: Floats = 1 / (1 + 0.09 * depth)
    return fading


def _relative(
    place: tuple[float, float], x: float, z: float, heading: float
) -> tuple[float, float]:
    """A place, relative to the camera: how far ahead, and how far to the right."""
    dx, dz = place[0] - x, place[1] - z
    sin, cos = math.sin(heading), math.cos(heading)
    return dx * sin + dz * cos, dx * cos - dz * sin


def _edges(lines: Sequence[Sequence[Sequence[float]]], *, closed: bool) -> Floats:
    rows = [
        (*begin, *end)
        for line in lines
        for begin, end in zip(
            line, [*line[1:], *(line[:1] if closed else [])], strict=False
        )
    ]
    return np.array(rows, dtype=float).reshape(-1, 4)


WALL: Colour = (226, 219, 205)
WOOD: Colour = (168, 122, 74)
FLOOR = np.array([176.0, 168.0, 158.0])
CEILING: Colour = (236, 238, 240)

FIGURE_M = 1.1
FIGURE = np.array(
    [
        [" rs".index(sign) for sign in row]
        for row in (
            "ss    sss    ss",
            "rr   sssss   rr",
            "rr   sssss   rr",
            "rrr  sssss  rrr",
            " rrr  sss  rrr ",
            "  rrrrrrrrrrr  ",
            "   rrrrrrrrr   ",
            "     rrrrr     ",
            "     rrrrr     ",
            "     rrrrr     ",
            "     rrrrr     ",
            "    rrrrrrr    ",
            "  rrrrrrrrrrr  ",
            " rrrrr   rrrrr ",
            "rrrr       rrrr",
        )
    ]
)
"""The victim, who sits on the floor and waves, from the front: red, and skin."""
FIGURE_COLOURS = np.array([(0, 0, 0), (205, 35, 45), (236, 188, 150)], np.uint8)
