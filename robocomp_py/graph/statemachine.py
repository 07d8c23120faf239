"""State machines as SVG: states within states, dashed lines between regions, arrows labelled with their triggers."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from ..contract.statemachine import State, StateMachine, Transition
from .layers import Arrow, Box, Layout, Point, Route, layered
from .svg import curve, document, escaped, moved

_LETTER, _SMALL = 8.2, 6.3
"""The average width of a letter of a name and of a label, at most, in pixels."""

_MARGIN, _PADDING, _TITLE, _BOX = 16.0, 16.0, 28.0, 34.0
_LOOP = 26.0
"""Width of the arrow from a state to itself, in pixels."""
_LANE = 20.0
"""Height below the regions for one arrow between two of them, in pixels."""
_BEGIN = "*"
"""The mark from which an arrow leads to the initial state."""

_STYLE = """\
  text { font: 13px "DejaVu Sans", Verdana, Arial, sans-serif; fill: #16283c; text-anchor: middle }
  text.title { font-weight: bold }
  text.label { font-size: 10.5px; fill: #3d5166 }
  rect.label { fill: #fff; fill-opacity: 0.85; stroke: none }
  text.beside { text-anchor: start }
  rect { fill: #e9f1fa; stroke: #47699a; stroke-width: 1.3 }
  rect.around { fill: #fbfcfe }
  rect.end { fill: none }
  path { fill: none; stroke: #51657b; stroke-width: 1.3 }
  path.region { stroke: #47699a; stroke-dasharray: 6 5 }
  path.line { stroke: #47699a; stroke-width: 1 }
  circle { fill: #16283c }
"""


def draw(machine: StateMachine) -> str:
    """The picture of a machine."""
    return _Drawing(machine).svg()


def as_json(machine: StateMachine) -> str:
    """One object: the machine, its states, each before those in it, and its transitions."""
    parents = {inner.name: state.name for state in machine.every_state() for inner in state.states}
    states = [
        {
            "name": each.name,
            "within": parents.get(each.name, ""),
            "initial": each.initial,
            "parallel": each.parallel,
            "final": each.final,
        }
        for each in machine.every_state()
    ]
    transitions = [{"from": each.source, "to": each.target, "events": each.events} for each in machine.transitions]
    told = {"machine": machine.name, "initial": machine.initial, "states": states, "transitions": transitions}
    return json.dumps(told) + "\n"


@dataclass
class _Area:
    """The size of a state, and the positions of all that it contains."""

    state: State
    size: Point = (0.0, 0.0)
    """Of its box; the arrow to itself stands out at its right."""
    inner: dict[str, _Area] = field(default_factory=dict)
    places: Mapping[str, Point] = field(default_factory=dict)
    """Of what is inside, in the box."""
    routes: list[tuple[Transition | None, Route]] = field(default_factory=list)
    lanes: list[tuple[Transition, float]] = field(default_factory=list)
    """Arrows from region to region, and how far down they go."""
    dividers: list[float] = field(default_factory=list)
    loop: list[Transition] = field(default_factory=list)
    corner: Point = (0.0, 0.0)
    """Of its box, in the picture."""

    @property
    def box(self) -> Box:
        widest = max((_width(_label(each)) for each in self.loop), default=0.0)
        return Box(*self.size, _LOOP + 6 + widest if self.loop else 0.0)


class _Drawing:
    def __init__(self, machine: StateMachine) -> None:
        self._machine = machine
        self._areas: dict[str, _Area] = {}
        self._path: dict[str, tuple[str, ...]] = {"": ()}
        """The states around a state and itself, outermost first."""
        for state in machine.every_state():
            self._path.setdefault(state.name, (state.name,))
            for inner in state.states:
                self._path[inner.name] = (*self._path[state.name], inner.name)
        self._within: dict[str, list[Transition]] = {}
        """Transitions by the innermost state that is around both ends, or is one of them."""
        for each in _merged(machine.transitions):
            self._within.setdefault(self._around(each), []).append(each)

    def svg(self) -> str:
        root = self._arrange(State("", self._machine.states, self._machine.initial))
        self._put(root, (_MARGIN, _MARGIN))
        self._tips = self._fanned()
        width, height = root.size[0] + 2 * _MARGIN, root.size[1] + 2 * _MARGIN
        body = [*self._boxes(root), *self._arrows(root)]
        return document(self._machine.name, _STYLE, (width, height), body)

    def _around(self, transition: Transition) -> str:
        """The innermost state that has both ends in it; one of the ends if the other is in it."""
        source, target = self._path[transition.source], self._path[transition.target]
        if source == target:
            return transition.source
        common = [one for one, other in zip(source, target, strict=False) if one == other]
        return common[-1] if common else ""

    # Sizes and places.

    def _arrange(self, state: State) -> _Area:
        area = self._areas[state.name] = _Area(state)
        area.inner = {each.name: self._arrange(each) for each in state.states}
        area.loop = [each for each in self._within.get(state.name, []) if each.source == each.target]
        title = _TITLE if state.name else 0.0
        padding = _PADDING if state.name else 0.0
        least = max(64.0, len(state.label) * _LETTER + 24)
        if not state.states:
            area.size = (least, _BOX)
            return area
        width, height = self._regions(area) if state.parallel else self._layers(area)
        wide = max(width, least - 2 * padding)
        left = padding + (wide - width) / 2
        area.places = {name: (x + left, y + title + padding) for name, (x, y) in area.places.items()}
        area.routes = [(each, moved(route, left, title + padding)) for each, route in area.routes]
        area.lanes = [(each, y + title + padding) for each, y in area.lanes]
        area.dividers = [x + left for x in area.dividers]
        area.size = (wide + 2 * padding, height + title + 2 * padding)
        return area

    def _layers(self, area: _Area) -> Point:
        """Arrange what is in a composite state; the room that it takes."""
        depth = len(self._path[area.state.name])
        boxes = {_BEGIN: Box(12.0, 12.0)} | {name: inner.box for name, inner in area.inner.items()}
        arrows = [Arrow(_BEGIN, self._path[area.state.initial][depth])]
        carried: list[Transition | None] = [None]
        for each in self._within.get(area.state.name, []):
            ends = [self._path[end] for end in (each.source, each.target)]
            if all(len(end) > depth for end in ends):
                arrows.append(Arrow(ends[0][depth], ends[1][depth], (_width(_label(each)), 16.0)))
                carried.append(each)
        layout: Layout = layered(boxes, arrows)
        area.places = layout.corners
        area.routes = list(zip(carried, layout.routes, strict=True))
        return layout.size

    def _regions(self, area: _Area) -> Point:
        """Put regions side by side; the room that they take."""
        x, height, places = 0.0, max(inner.size[1] for inner in area.inner.values()), dict[str, Point]()
        for name, inner in area.inner.items():
            if x:
                area.dividers.append(x + _PADDING)
                x += 2 * _PADDING
            places[name] = (x, 0.0)
            x += inner.box.width + inner.box.beside
        area.places = places
        between = [each for each in self._within.get(area.state.name, []) if area.state.name not in _ends(each)]
        for number, each in enumerate(between):
            area.lanes.append((each, height + _LANE * (number + 0.9)))
        return x, height + _LANE * len(between) + (8 if between else 0)

    def _put(self, area: _Area, corner: Point) -> None:
        area.corner = corner
        for name, inner in area.inner.items():
            x, y = area.places[name]
            self._put(inner, (corner[0] + x, corner[1] + y))

    # Drawing.

    def _boxes(self, area: _Area) -> Iterator[str]:
        (x, y), (width, height), state = area.corner, area.size, area.state
        if state.name:
            kind = ' class="around"' if state.states else ""
            yield f'<rect{kind} x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="9"/>'
            title = ' class="title"' if state.states else ""
            down = 19 if state.states else 22
            yield f'<text{title} x="{x + width / 2:.1f}" y="{y + down:.1f}">{escaped(state.label)}</text>'
        if state.name and state.states:
            yield f'<path class="line" d="M{x:.1f} {y + _TITLE:.1f} h{width:.1f}"/>'
        if state.final:
            place = f'x="{x + 3.5:.1f}" y="{y + 3.5:.1f}" width="{width - 7:.1f}" height="{height - 7:.1f}"'
            yield f'<rect class="end" {place} rx="6"/>'
        for at in area.dividers:
            top, bottom = y + _TITLE, y + height - max((_LANE * len(area.lanes) + 8) if area.lanes else 0, 0)
            yield f'<path class="region" d="M{x + at:.1f} {top:.1f} V{bottom:.1f}"/>'
        for inner in area.inner.values():
            yield from self._boxes(inner)

    def _arrows(self, area: _Area) -> Iterator[str]:
        for inner in area.inner.values():
            yield from self._arrows(inner)
        for number, (transition, route) in enumerate(area.routes):
            placed = moved(route, *area.corner)
            first, last = (self._tips[area.state.name, number, end] for end in (0, 1))
            aside = (first[0], placed.borders[0]), (last[0], placed.borders[1])
            yield _path([first, aside[0], *placed.points, aside[1], last], transition)
        if area.routes:
            (x, y), _ = self._outline(f"{_BEGIN}{area.state.name}")
            yield f'<circle cx="{x + 6:.1f}" cy="{y + 6:.1f}" r="6"/>'
        for transition, route in area.routes:
            if transition:
                x, y = route.label[0] + area.corner[0], route.label[1] + area.corner[1]
                yield _text(_label(transition), x, y + 3.5)
        for transition, down in area.lanes:
            yield from self._lane(transition, area.corner[1] + down)
        for transition in area.loop:
            yield from _loop(area, transition)
        for transition in self._within.get(area.state.name, []):
            if area.state.name in _ends(transition) and transition not in area.loop:
                yield from self._inward(area, transition)

    def _fanned(self) -> dict[tuple[str, int, int], Point]:
        """Where arrows begin and end: side by side on the borders of boxes, in the order in which they come.

        By the state that they are in, their number there, and whether it is their end.
        """
        meeting: dict[tuple[str, bool], list[tuple[float, str, int, int]]] = {}
        for around, area in self._areas.items():
            for number, (transition, route) in enumerate(area.routes):
                names = _ends(transition) if transition else (f"{_BEGIN}{around}", area.state.initial)
                for end, name in enumerate(names):
                    x = area.corner[0] + route.points[-end][0]
                    meeting.setdefault((name, (end == 0) != route.up), []).append((x, around, number, end))
        found: dict[tuple[str, int, int], Point] = {}
        for (name, bottom), met in meeting.items():
            (x, y), (width, height) = self._outline(name)
            near = min(1.0, 44 * (len(met) + 1) / width)
            for place, (_, around, number, end) in enumerate(sorted(met)):
                share = 0.5 + ((place + 1) / (len(met) + 1) - 0.5) * near
                found[around, number, end] = (x + width * share, y + height if bottom else y)
        return found

    def _outline(self, name: str) -> tuple[Point, Point]:
        """Corner and size of a state's box, or of a mark's."""
        if not name.startswith(_BEGIN):
            return self._areas[name].corner, self._areas[name].size
        around = self._areas[name.removeprefix(_BEGIN)]
        x, y = around.places[_BEGIN]
        return (around.corner[0] + x, around.corner[1] + y), (12.0, 12.0)

    def _lane(self, transition: Transition, y: float) -> Iterator[str]:
        """An arrow from one region to another one: below them."""
        (x1, y1), (x2, y2) = (self._below(end, shift) for end, shift in zip(_ends(transition), (9, -9), strict=True))
        turn = 8.0 if x2 > x1 else -8.0
        yield (
            f'<path d="M{x1:.1f} {y1:.1f} V{y - 8:.1f} Q{x1:.1f} {y:.1f} {x1 + turn:.1f} {y:.1f}'
            f' H{x2 - turn:.1f} Q{x2:.1f} {y:.1f} {x2:.1f} {y - 8:.1f} V{y2:.1f}" marker-end="url(#tip)">'
            f"<title>{escaped(transition.trigger)}</title></path>"
        )
        yield _text(_label(transition), (x1 + x2) / 2, y + 3.5)

    def _below(self, name: str, shift: float) -> Point:
        area = self._areas[name]
        return area.corner[0] + area.size[0] / 2 + shift, area.corner[1] + area.size[1]

    def _inward(self, area: _Area, transition: Transition) -> Iterator[str]:
        """An arrow between a state and one inside of it: from border to border, on the left."""
        outward = transition.target == area.state.name
        inner = self._areas[transition.source if outward else transition.target]
        x, y = area.corner[0], inner.corner[1] + inner.size[1] / 2
        left = (x, y - 10), (inner.corner[0], y)
        first, last = left[::-1] if outward else left
        middle = (first[0] + last[0]) / 2
        yield (
            f'<path d="M{first[0]:.1f} {first[1]:.1f} C{middle:.1f} {first[1]:.1f} {middle:.1f} {last[1]:.1f}'
            f' {last[0]:.1f} {last[1]:.1f}" marker-end="url(#tip)"><title>{escaped(transition.trigger)}</title></path>'
        )
        yield _text(_label(transition), x + 4, y - 16, "label beside")


def _merged(transitions: Iterable[Transition]) -> list[Transition]:
    """One arrow for all that leads from one state to another."""
    found: dict[str, Transition] = {}
    for each in transitions:
        known = found.setdefault(each.trigger, each)
        if known is not each:
            found[each.trigger] = Transition(each.source, each.target, (*known.events, *each.events))
    return list(found.values())


def _ends(transition: Transition) -> tuple[str, str]:
    return transition.source, transition.target


def _label(transition: Transition) -> str:
    """The label of a transition: its events, or else what fires it."""
    return ", ".join(transition.events) or transition.trigger


def _width(label: str) -> float:
    return len(label) * _SMALL


def _path(points: list[Point], transition: Transition | None) -> str:
    title = f"<title>{escaped(transition.trigger)}</title>" if transition else ""
    return f'<path d="{curve(points)}" marker-end="url(#tip)">{title}</path>'


def _loop(area: _Area, transition: Transition) -> Iterator[str]:
    """The arrow of a state to itself: at its right."""
    x, y, height = area.corner[0] + area.size[0], area.corner[1] + (_TITLE / 2 if area.state.states else 0), _BOX
    top, bottom, out = y + height * 0.25, y + height * 0.75, x + _LOOP
    yield (
        f'<path d="M{x:.1f} {top:.1f} C{out:.1f} {top - 9:.1f} {out:.1f} {bottom + 9:.1f} {x:.1f} {bottom:.1f}"'
        f' marker-end="url(#tip)"><title>{escaped(transition.trigger)}</title></path>'
    )
    yield _text(_label(transition), x + _LOOP - 2, (top + bottom) / 2 + 3.5, "label beside")


def _text(text: str, x: float, y: float, kind: str = "label") -> str:
    width = _width(text) * 0.94
    left = x if kind != "label" else x - width / 2
    behind = f'<rect class="label" x="{left:.1f}" y="{y - 10:.1f}" width="{width:.1f}" height="13"/>'
    return f'{behind}<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{escaped(text)}</text>'
