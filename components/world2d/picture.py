"""Draws the story as an SVG: the house, the part that was seen, the way, the battery.

The floor is lit where the laser has been; the way has the colour of the battery.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from .robot import RADIUS_M, Pose
from .room import VICTIM_RADIUS_M, Point, Room


@dataclass(frozen=True, slots=True)
class Moment:
    """The pose of the robot, and the charge of its battery."""

    time_s: float
    pose: Pose
    percent: float


class Story:
    """The data for the picture. It is bounded, so a simulation may run for days."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.driven_m = 0.0
        self.moments: deque[Moment] = deque(maxlen=20_000)
        self.views: deque[Sequence[Point]] = deque(maxlen=1_000)
        self._viewed_m = -math.inf

    def note(
        self, seconds: float, pose: Pose, percent: float, seen: Sequence[Point]
    ) -> None:
        """Add the pose and the visible places after this number of seconds."""
        self.time_s += seconds
        if self.moments:
            self.driven_m += math.dist(self.moments[-1].pose.place, pose.place)
        self.moments.append(Moment(self.time_s, pose, percent))
        if self.driven_m - self._viewed_m > VIEW_EVERY_M:
            self._viewed_m = self.driven_m
            self.views.append((pose.place, *seen))


def draw(room: Room, story: Story) -> str:
    """The picture, as the text of an SVG file."""
    return "\n".join(_lines(_Paper(room), room, story)) + "\n"


class _Paper:
    """Converts places of the house to pixels."""

    def __init__(self, room: Room) -> None:
        corners = [corner for line in room.walls for corner in line]
        self.west = min(x for x, _ in corners)
        self.north = max(z for _, z in corners)
        self.house_width = (max(x for x, _ in corners) - self.west) * PIXELS
        self.house_height = (self.north - min(z for _, z in corners)) * PIXELS
        self.width = self.house_width + 2 * MARGIN
        self.bottom = HEAD + self.house_height
        self.height = self.bottom + FOOT

    def at(self, place: Point) -> Point:
        x, z = place
        return MARGIN + (x - self.west) * PIXELS, HEAD + (self.north - z) * PIXELS

    def corners(self, places: Iterable[Point]) -> str:
        """Places as the value of `points`."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self.at, places))


def _lines(paper: _Paper, room: Room, story: Story) -> Iterator[str]:
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" font-family="Helvetica, Arial, '
        f'sans-serif" viewBox="0 0 {paper.width:g} {paper.height:g}" '
        f'width="{paper.width:g}" height="{paper.height:g}">'
    )
    yield _tag("rect", width="100%", height="100%", fill=PAPER)
    yield from _title(paper, story)
    yield from _floor(paper, story)
    yield from _charger(paper, room)
    yield from _furniture(paper, room)
    if story.moments:
        yield from _way(paper, room, list(story.moments))
    yield from _victim(paper, room)
    if story.moments:
        yield from _robot(paper, story.moments[-1].pose)
        yield from _chart(paper, list(story.moments))
    yield "</svg>"


def _title(paper: _Paper, story: Story) -> Iterator[str]:
    yield _text("A robot looks for a victim", MARGIN, 40, size=26, weight="bold")
    told = f"{story.driven_m:.1f} m driven in {story.time_s:.0f} s"
    yield _text(told, MARGIN, 64, size=15, fill=FAINT)
    right = MARGIN + paper.house_width
    for number, (fill, label) in enumerate(((DARK, "never seen"), (LIT, "seen"))):
        x = right - 110 - 90 * number
        yield _tag(
            "rect", x=x, y=52, width=14, height=14, rx=3, fill=fill, stroke=FAINT
        )
        yield _text(label, x + 20, 64, size=13, fill=FAINT)


def _floor(paper: _Paper, story: Story) -> Iterator[str]:
    """The floor: dark, and lit where the laser has been."""
    house: dict[str, float] = {
        "x": MARGIN,
        "y": HEAD,
        "width": paper.house_width,
        "height": paper.house_height,
    }
    yield f'<clipPath id="house">{_tag("rect", **house)}</clipPath>'
    yield _tag("rect", fill=DARK, **house)
    yield f'<g clip-path="url(#house)" fill="{LIT}" fill-opacity="0.35">'
    for view in story.views:
        yield _tag("polygon", points=paper.corners(view))
    yield "</g>"


def _charger(paper: _Paper, room: Room) -> Iterator[str]:
    x, y = paper.at(room.charger)
    side = 0.9 * PIXELS
    yield _tag(
        "rect",
        x=x - side / 2,
        y=y - side / 2,
        width=side,
        height=side,
        rx=10,
        fill="#d5efd9",
        stroke=FULL,
        stroke_width=2.5,
        stroke_dasharray="7 4",
    )
    bolt = ((5, -22), (-12, 4), (-1, 4), (-5, 22), (12, -5), (1, -5))
    points = " ".join(f"{x + dx:.1f},{y + dy:.1f}" for dx, dy in bolt)
    yield _tag("polygon", points=points, fill=FULL, opacity=0.75)
    label = "charging station"
    beside = x + side / 2 + 8, y + side / 2 - 4
    yield _text(label, *beside, size=13, fill=FULL, halo=True)


def _furniture(paper: _Paper, room: Room) -> Iterator[str]:
    wood: dict[str, str | float] = {
        "fill": "#cfae82",
        "stroke": "#8d6c43",
        "stroke_width": 2.5,
    }
    for area in room.furniture:
        yield _tag(
            "polygon", points=paper.corners(area), stroke_linejoin="round", **wood
        )
    for px, pz, radius in room.pillars:
        x, y = paper.at((px, pz))
        yield _tag("circle", cx=x, cy=y, r=radius * PIXELS, **wood)
    for wall in room.walls:
        yield _tag(
            "polyline",
            points=paper.corners(wall),
            fill="none",
            stroke=INK,
            stroke_width=9,
            stroke_linejoin="round",
            stroke_linecap="round",
        )


def _way(paper: _Paper, room: Room, moments: Sequence[Moment]) -> Iterator[str]:
    """The way: a line in the battery's colours, with a mark every ten seconds."""
    line: dict[str, str | float] = {
        "fill": "none",
        "stroke_linejoin": "round",
        "stroke_linecap": "round",
    }
    places = [moment.pose.place for moment in moments]
    yield _tag(
        "polyline",
        points=paper.corners(places),
        stroke="white",
        stroke_width=10,
        opacity=0.8,
        **line,
    )
    for colour, part in _by_colour(moments):
        points = paper.corners(moment.pose.place for moment in part)
        yield _tag("polyline", points=points, stroke=colour, stroke_width=5, **line)
    x, y = paper.at(places[0])
    yield _tag("circle", cx=x, cy=y, r=7, fill="white", stroke=INK, stroke_width=3)
    yield _text("start", x + 14, y + 5, size=13, halo=True)
    for before, moment in pairwise(moments):
        tens = math.floor(moment.time_s / MARK_EVERY_S)
        if tens > before.time_s / MARK_EVERY_S:
            x, y = paper.at(moment.pose.place)
            yield _tag("circle", cx=x, cy=y, r=4, fill="white", stroke=INK)
            sides = [moment.pose.ahead(0.3, side * math.pi / 2) for side in (-1, 1)]
            x, y = paper.at(max(sides, key=room.clearance))
            label = f"{tens * MARK_EVERY_S} s"
            yield _text(label, x, y + 4, size=12, anchor="middle", halo=True)


def _by_colour(moments: Sequence[Moment]) -> Iterator[tuple[str, Sequence[Moment]]]:
    """Parts of the way with one colour; each begins at the end of the previous one."""
    begin = 0
    for index in range(1, len(moments) + 1):
        colour = battery_colour(moments[begin].percent)
        if index == len(moments) or battery_colour(moments[index].percent) != colour:
            yield colour, moments[begin : index + 1]
            begin = index


def battery_colour(percent: float) -> str:
    """Red when empty, amber at half, green when full, in steps of 2 %."""
    share = round(percent / 2) / 50
    low, high = (AMBER, FULL) if share >= 0.5 else (EMPTY, AMBER)
    along = (share - 0.5) * 2 if share >= 0.5 else share * 2
    mixed = (
        round(a + (b - a) * along)
        for a, b in zip(_channels(low), _channels(high), strict=True)
    )
    return "#" + "".join(f"{channel:02x}" for channel in mixed)


def _channels(colour: str) -> list[int]:
    return [int(colour[at : at + 2], 16) for at in (1, 3, 5)]


def _victim(paper: _Paper, room: Room) -> Iterator[str]:
    x, y = paper.at(room.victim)
    radius = VICTIM_RADIUS_M * PIXELS
    for times, opacity in ((2.2, 0.12), (1.6, 0.2)):
        yield _tag("circle", cx=x, cy=y, r=radius * times, fill=VICTIM, opacity=opacity)
    yield _tag("circle", cx=x, cy=y, r=radius, fill=VICTIM)
    yield _tag("circle", cx=x, cy=y, r=radius * 0.45, fill="#f6d3b3")
    yield _text("victim", x + radius * 1.8, y + 5, size=14, fill=VICTIM, halo=True)


def _robot(paper: _Paper, pose: Pose) -> Iterator[str]:
    x, y = paper.at(pose.place)
    radius = RADIUS_M * PIXELS
    yield _tag(
        "circle", cx=x, cy=y, r=radius, fill=ROBOT, stroke="white", stroke_width=2
    )
    nose = paper.corners(
        pose.ahead(RADIUS_M * reach, aside)
        for reach, aside in ((0.85, 0.0), (0.6, 2.4), (0.6, -2.4))
    )
    yield _tag("polygon", points=nose, fill="white")


def _chart(paper: _Paper, moments: Sequence[Moment]) -> Iterator[str]:
    """The battery over time, in the colours of the way."""
    top, height = paper.bottom + 44, FOOT - 88
    end = max(moments[-1].time_s, 1.0)

    def at(time_s: float, percent: float) -> Point:
        share = time_s / end
        return MARGIN + share * paper.house_width, top + height * (1 - percent / 100)

    yield _text("battery", MARGIN, top - 10, size=14, weight="bold")
    for colour, part in _by_colour(moments):
        edge = [at(moment.time_s, moment.percent) for moment in part]
        area = [(edge[0][0], top + height), *edge, (edge[-1][0], top + height)]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in area)
        yield _tag("polygon", points=points, fill=colour, stroke=colour)
    right = MARGIN + paper.house_width
    for percent in (0, 50, 100):
        _, y = at(0, percent)
        yield _tag("line", x1=MARGIN, x2=right, y1=y, y2=y, stroke=INK, opacity=0.25)
        yield _text(f"{percent} %", right + 6, y + 4, size=11, fill=FAINT)
    for tens in range(0, math.floor(end) + 1, MARK_EVERY_S):
        x, y = at(tens, 0)
        yield _tag("line", x1=x, x2=x, y1=y, y2=y + 5, stroke=INK)
        yield _text(f"{tens} s", x, y + 19, size=12, fill=FAINT, anchor="middle")


def _text(
    text: str,
    x: float,
    y: float,
    *,
    size: int,
    fill: str = "",
    weight: str = "normal",
    anchor: str = "start",
    halo: bool = False,
) -> str:
    """A text; with a halo it can be read on any background."""
    tag = _tag("text", x=x, y=y, font_size=size, font_weight=weight, text_anchor=anchor)
    words = f'{tag[:-2]} fill="{fill or INK}">{text}</text>'
    if halo:
        glow = f'fill="{LIT}" stroke="{LIT}" stroke-width="4" stroke-linejoin="round"'
        return f"{tag[:-2]} {glow}>{text}</text>{words}"
    return words


def _tag(name: str, **attributes: str | float) -> str:
    """An element without content."""
    words = [
        f'{key.replace("_", "-")}="{value:.5g}"'
        if isinstance(value, float)
        else f'{key.replace("_", "-")}="{value}"'
        for key, value in attributes.items()
    ]
    return f"<{name} {' '.join(words)}/>"


PIXELS = 80
"""In a metre."""

MARGIN = 48
HEAD = 84
FOOT = 190

MARK_EVERY_S = 10
VIEW_EVERY_M = 0.4

PAPER, INK, FAINT = "#faf7f1", "#2f3136", "#70747d"
DARK, LIT = "#b9bfca", "#fffdf7"
FULL, AMBER, EMPTY = "#1f9d55", "#f0b429", "#d64541"
VICTIM, ROBOT = "#d7263d", "#28527a"
