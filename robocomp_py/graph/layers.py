"""Boxes and arrows between them in layers from top to bottom, after Sugiyama. Sizes in, places out; all in pixels.

1  arrows that would close a circle are turned around
2  each box comes into the layer below all those that lead to it
3  every layer between two boxes gets a place for the arrow that passes it, one of them wide enough for its label
4  layers are sorted, so that few arrows cross
5  everything is moved as near to what it is connected with as its neighbours let it
"""

from __future__ import annotations

import bisect
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

_BESIDE, _BETWEEN = 26.0, 20.0
"""Pixels between boxes of a layer, and between layers."""

_SWEEPS, _SHIFTS = 24, 80
"""Number of times that layers are sorted, and moved."""

_STRAIGHT = 8.0
"""The weight of straight arrows between layers, relative to arrows at a box."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """Its size, and the width of what stands out at its right; arrows come to the middle of the box itself."""

    width: float
    height: float
    beside: float = 0.0


@dataclass(frozen=True)
class Arrow:
    """From one box to another one; `label` is the size of what is written beside it."""

    source: str
    target: str
    label: Point = (0.0, 0.0)


@dataclass(frozen=True)
class Route:
    """What an arrow passes, from its source to its target, without its ends; and the middle of its label."""

    points: tuple[Point, ...]
    label: Point
    up: bool
    """Whether it leaves its source at the top and comes to its target from below."""
    borders: tuple[float, float]
    """How far down it has left the layer of its source, and comes into that of its target."""


@dataclass(frozen=True)
class Layout:
    size: Point
    corners: Mapping[str, Point]
    """The upper left ones of the boxes."""
    routes: Sequence[Route]


def layered(boxes: Mapping[str, Box], arrows: Sequence[Arrow], last: Collection[str] = ()) -> Layout:
    """Where boxes of these sizes and the arrows between different ones come. The first box comes first.

    Those in `last`, which no arrow leaves, come into the last layer, however near what leads to them is.
    """
    return _Layers(boxes, arrows, last).layout()


def turned(names: Sequence[str], arrows: Sequence[Arrow]) -> set[int]:
    """The numbers of the arrows that will point upwards, whatever the sizes of the boxes."""
    return _closing(list(names), arrows)


@dataclass(eq=False)
class _Cell:
    """A box, or the place where an arrow passes a layer."""

    box: Box
    layer: int
    passing: bool = False
    x: float = 0.0
    """Of the middle of the box."""
    place: int = 0
    """In its layer."""
    above: list[_Cell] = field(default_factory=list)
    below: list[_Cell] = field(default_factory=list)

    @property
    def left(self) -> float:
        return self.x - self.box.width / 2

    @property
    def right(self) -> float:
        return self.x + self.box.width / 2 + self.box.beside

    def tendency(self, down: bool) -> float:
        """Which place in its layer what is above, or below, wants it to have."""
        beside = self.above if down else self.below
        return sum(each.place for each in beside) / len(beside) if beside else self.place

    def pull(self) -> tuple[float, float]:
        """Where what it is connected with wants it to be, and how strongly."""
        beside = [*self.above, *self.below]
        pulls = [_STRAIGHT if self.passing and each.passing else 1.0 for each in beside]
        total = sum(pulls)
        return (
            (sum(pull * each.x for pull, each in zip(pulls, beside, strict=True)) / total, total)
            if pulls
            else (self.x, 1.0)
        )


class _Layers:
    def __init__(self, boxes: Mapping[str, Box], arrows: Sequence[Arrow], last: Collection[str]) -> None:
        self._arrows = arrows
        self._turned = turned(list(boxes), arrows)
        ranks = self._ranks(list(boxes))
        ranks |= dict.fromkeys(last, max(ranks.values(), default=0))
        self._cells = {name: _Cell(box, 2 * ranks[name]) for name, box in boxes.items()}
        self._layers: list[list[_Cell]] = [[] for _ in range(2 * max(ranks.values(), default=0) + 1)]
        for cell in self._cells.values():
            self._layers[cell.layer].append(cell)
        self._chains = [self._chain(arrow, number in self._turned) for number, arrow in enumerate(arrows)]
        for layer in self._layers:
            _number(layer)

    def layout(self) -> Layout:
        self._sort()
        self._place()
        left = min((cell.left for layer in self._layers for cell in layer), default=0.0)
        right = max((cell.right for layer in self._layers for cell in layer), default=0.0)
        tops, y = list[float](), 0.0
        heights = [max((cell.box.height for cell in layer), default=0.0) for layer in self._layers]
        for height in heights:
            tops.append(y)
            y += height + _BETWEEN
        corners = {
            name: (cell.left - left, tops[cell.layer] + (heights[cell.layer] - cell.box.height) / 2)
            for name, cell in self._cells.items()
        }
        routes = []
        for number, chain in enumerate(self._chains):
            points: list[Point] = []
            for cell in chain:
                x, top, height = cell.x - left, tops[cell.layer], heights[cell.layer]
                points += [(x, top), (x, top + height)] if cell.layer % 2 == 0 else [(x, top + height / 2)]
            middle = chain[_middle(len(chain))]
            up = number in self._turned
            label = (middle.x - left, tops[middle.layer] + heights[middle.layer] / 2)
            upper, lower = (self._cells[end].layer for end in self._ends(number))
            out, into = tops[upper] + heights[upper], tops[lower]
            borders = (into, out) if up else (out, into)
            routes.append(Route(tuple(points[::-1] if up else points), label, up, borders))
        return Layout((right - left, max(0.0, y - _BETWEEN)), corners, routes)

    def _ends(self, number: int) -> tuple[str, str]:
        """The upper and the lower end of an arrow."""
        arrow = self._arrows[number]
        return (arrow.target, arrow.source) if number in self._turned else (arrow.source, arrow.target)

    def _ranks(self, names: list[str]) -> dict[str, int]:
        ranks = dict.fromkeys(names, 0)
        ends = [self._ends(number) for number in range(len(self._arrows))]
        while late := [(upper, lower) for upper, lower in ends if ranks[lower] <= ranks[upper]]:
            for upper, lower in late:
                ranks[lower] = max(ranks[lower], ranks[upper] + 1)
        return ranks

    def _chain(self, arrow: Arrow, turned: bool) -> list[_Cell]:
        """The cells of an arrow, from its upper to its lower end."""
        first, last = self._cells[arrow.source], self._cells[arrow.target]
        upper, lower = (last, first) if turned else (first, last)
        cells = [_Cell(Box(10.0, 0.0), layer, True) for layer in range(upper.layer + 1, lower.layer)]
        cells[_middle(len(cells))].box = Box(arrow.label[0] + 8, arrow.label[1])
        before = upper
        for cell in (*cells, lower):
            before.below.append(cell)
            cell.above.append(before)
            before = cell
        for cell in cells:
            self._layers[cell.layer].append(cell)
        return cells

    def _sort(self) -> None:
        best, fewest = [list(layer) for layer in self._layers], self._crossings()
        for sweep in range(_SWEEPS):
            down = sweep % 2 == 0
            for layer in self._layers if down else self._layers[::-1]:
                layer.sort(key=lambda cell: cell.tendency(down))
                _number(layer)
            crossings = self._crossings()
            if crossings < fewest:
                best, fewest = [list(layer) for layer in self._layers], crossings
        self._layers = best

    def _crossings(self) -> int:
        found = 0
        for layer in self._layers:
            passed: list[int] = []
            for _, place in sorted((cell.place, below.place) for cell in layer for below in cell.below):
                found += len(passed) - bisect.bisect_right(passed, place)
                bisect.insort(passed, place)
        return found

    def _place(self) -> None:
        for layer in self._layers:
            _push_apart(layer, [(0.0, 1.0)] * len(layer))
        for sweep in range(_SHIFTS):
            for layer in self._layers if sweep % 2 == 0 else self._layers[::-1]:
                _push_apart(layer, [cell.pull() for cell in layer])


def _closing(names: list[str], arrows: Sequence[Arrow]) -> set[int]:
    """The numbers of arrows that lead back to where one comes from, by following arrows from the first box on."""
    leaving: dict[str, list[int]] = {name: [] for name in names}
    for number, arrow in enumerate(arrows):
        leaving[arrow.source].append(number)
    found: set[int] = set()
    seen: set[str] = set()
    for root in names:
        way, path = [(root, iter(leaving[root]))] if root not in seen else [], {root}
        seen.add(root)
        while way:
            name, rest = way[-1]
            number = next(rest, -1)
            if number < 0:
                path.discard(name)
                way.pop()
            elif arrows[number].target in path:
                found.add(number)
            elif arrows[number].target not in seen:
                target = arrows[number].target
                seen.add(target)
                path.add(target)
                way.append((target, iter(leaving[target])))
    return found


def _push_apart(layer: list[_Cell], wanted: list[tuple[float, float]]) -> None:
    """Put cells as near to their wanted places as possible without overlap; cells that would overlap move together.

    This reduces the sum of the squares of sideways distances, so it converges.
    """
    offsets, offset = list[float](), 0.0
    for before, cell in zip([None, *layer], layer, strict=False):
        if before:
            gap = _BESIDE / 2 if before.passing or cell.passing else _BESIDE
            offset += (before.right - before.x) + (cell.x - cell.left) + gap
        offsets.append(offset)
    groups: list[tuple[float, float, int]] = []  # where it wants to be, its weight, how many there are in it
    for (want, pull), offset in zip(wanted, offsets, strict=True):
        group = (want - offset, pull, 1)
        while groups and groups[-1][0] > group[0]:
            at, weight, count = groups.pop()
            total = weight + group[1]
            group = ((at * weight + group[0] * group[1]) / total, total, count + group[2])
        groups.append(group)
    starts = [at for at, _, count in groups for _ in range(count)]
    for cell, start, offset in zip(layer, starts, offsets, strict=True):
        cell.x = start + offset


def _middle(count: int) -> int:
    """Which cell of an arrow has its label: one between two layers of boxes, as near to the middle as there is."""
    return count // 4 * 2


def _number(layer: list[_Cell]) -> None:
    for place, cell in enumerate(layer):
        cell.place = place
