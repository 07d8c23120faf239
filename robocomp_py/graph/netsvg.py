"""Networks as SVG: components within hosts, systems and processes, and arrows in the colour of what carries them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ..transports.deployment import deployment_of
from .layers import Arrow, Box, Layout, Point, Route, layered, turned
from .network import Around, Edge, Graph, Group, Mark, Node
from .svg import curve, document, escaped, marker, moved

_LETTER, _SMALL, _LINE = 8.2, 6.3, 13.0
"""The average width of a letter of a name and of a label, at most, and the height of a label's line, in pixels."""

_MARGIN, _PADDING, _TITLE, _BOX = 16.0, 16.0, 26.0, 46.0
_LEGEND = 34.0
_END = 9.0
"""The size of the open end of an arrow."""

_MOST = 5
"""Maximum number of interfaces at an arrow; the rest is counted."""

_ROOM = 25
"""Letters for which figures get room, so that a picture keeps its form while they change."""

_UNKNOWN = "#51657b"
_MARKED = {Mark.MISSING: "#e0002b", Mark.UNDECLARED: "#8793a0"}
_NAMED = {Mark.MISSING: "missing", Mark.UNDECLARED: "not in the model"}

_STYLE = """\
  text { font: 13px "DejaVu Sans", Verdana, Arial, sans-serif; fill: #16283c; text-anchor: middle }
  text.name, text.title { font-weight: bold }
  text.title { text-anchor: start; font-size: 12px }
  text.kind { font-weight: normal; fill: #5b6d80 }
  text.component, text.label, text.legend { font-size: 10.5px; fill: #3d5166 }
  text.legend { text-anchor: start }
  rect { fill: #e9f1fa; stroke: #47699a; stroke-width: 1.3 }
  rect.label { fill: #fcfdfe; fill-opacity: 0.85; stroke: none }
  rect.host { fill: #f6f8fb; stroke: #7f93a8 }
  rect.system { fill: none; stroke: #7f93a8; stroke-dasharray: 7 4 }
  rect.process { fill: #fdf8ec; stroke: #c0a45b }
  rect.behind { stroke: none; fill-opacity: 0.85 }
  rect.behind.system { fill: #fff }
  path { fill: none; stroke-width: 1.5 }
  path.topic { stroke-dasharray: 5 4 }
"""

_LIVE_STYLE = f"""\
  circle.end {{ fill: none; stroke-width: 1.5 }}
  text.figures {{ font-size: 10px; fill: #2d3e50 }}
  rect.missing {{ fill: #fdecec; stroke: {_MARKED[Mark.MISSING]}; stroke-width: 2 }}
  path.missing {{ stroke-width: 2.5 }}
  text.missing {{ fill: {_MARKED[Mark.MISSING]}; font-weight: bold }}
  rect.undeclared {{ fill: #f3f4f6; stroke: {_MARKED[Mark.UNDECLARED]}; stroke-dasharray: 2 3 }}
  path.undeclared {{ stroke-dasharray: 2 3 }}
  path.strained, rect.strained {{ stroke-width: 3.5 }}
"""


def draw(graph: Graph) -> str:
    """The picture of a network."""
    return _Drawing(graph).svg()


@dataclass(frozen=True, slots=True)
class _Exit:
    """Where one end of an arrow crosses the border of a group."""

    edge: Edge
    end: int
    """0 for its source, 1 for its target."""
    top: bool


@dataclass(eq=False)
class _Area:
    """The size and the position of a group or an instance, with all that it contains.

    The open end of an arrow has one, too: that of an edge.
    """

    what: Group | Node | Edge
    size: Point = (0.0, 0.0)
    inner: dict[str, _Area] = field(default_factory=dict)
    places: Mapping[str, Point] = field(default_factory=dict)
    routes: dict[Edge, Route] = field(default_factory=dict)
    """The ends of arrows that stay within it, but not within one of its parts."""
    exits: dict[tuple[Edge, int], tuple[Route, Point]] = field(default_factory=dict)
    """What arrows pass between one of those in it and its border, and where that is."""
    corner: Point = (0.0, 0.0)


class _Drawing:
    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._areas: dict[str, tuple[_Area, ...]] = {}
        """An instance, and the groups around it, the innermost first."""
        self._paths: dict[str, tuple[str, ...]] = {}
        """The keys of the areas around an instance and its own, outermost first."""
        self._numbers = {node: number for number, node in enumerate(graph.root.nodes())}
        self._root = self._area(graph.root, (), ())
        self._open = {edge: f"end {number}" for number, edge in enumerate(graph.edges) if not edge.target}
        """The names of open ends, which stand beside the sources of their arrows."""
        for edge, name in self._open.items():
            self._add_open(edge, name)

    def _area(self, what: Group | Node, path: tuple[str, ...], around: tuple[_Area, ...]) -> _Area:
        area = _Area(what)
        if isinstance(what, Node):
            self._areas[what.name] = (area, *around)
            self._paths[what.name] = path
            return area
        for number, each in enumerate(what.inner):
            key = str(number)
            area.inner[key] = self._area(each, (*path, key), (area, *around))
        return area

    def _add_open(self, edge: Edge, name: str) -> None:
        around, area = self._areas[edge.source][1:], _Area(edge)
        around[0].inner[name] = area
        self._areas[name] = (area, *around)
        self._paths[name] = (*self._paths[edge.source][:-1], name)

    def _names(self, edge: Edge) -> tuple[str, str]:
        """What is at its ends."""
        return edge.source, edge.target or self._open[edge]

    def svg(self) -> str:
        self._arrange(self._root, (), [])
        self._put(self._root, (_MARGIN, _MARGIN))
        self._tips = self._fanned()
        carried = list(
            dict.fromkeys(edge.middleware for edge in self._graph.edges if edge.middleware and not edge.mark)
        )
        shown: list[Edge | Node] = [*self._graph.edges, *self._numbers]
        marks = list(dict.fromkeys(each.mark for each in shown if each.mark))
        legend = list(self._legend(carried, marks))
        told = [*carried, *(_NAMED[mark] for mark in marks)]
        width = max(self._root.size[0], sum(len(each) * _SMALL + 56 for each in told) + 180 if legend else 0)
        height = self._root.size[1] + (_LEGEND if legend else 0)
        body = [*self._boxes(self._root), *(self._arrow(number) for number in range(len(self._graph.edges)))]
        body += [*self._titles(self._root), *self._labels(self._root), *legend]
        colours = [*map(_colour, carried), *(_MARKED[mark] for mark in marks)]
        tips = "".join(marker(_tip(colour), colour) for colour in dict.fromkeys(colours))
        live = any(each.mark or each.figures for each in shown)
        return document(
            self._graph.name, _STYLE + _LIVE_STYLE * live, (width + 2 * _MARGIN, height + 2 * _MARGIN), body, tips
        )

    # Sizes and places.

    def _arrange(self, area: _Area, path: tuple[str, ...], leaving: Sequence[_Exit]) -> None:
        """Place everything in it. `leaving` are the ends of arrows that must reach its border."""
        if isinstance(area.what, Edge):
            area.size = (_END, _END + _PADDING / 2)  # it does not touch a border below
            return
        if isinstance(area.what, Node):
            texts = len(area.what.short) * _LETTER, len(area.what.component) * _SMALL
            figures = [_ROOM * _SMALL] if area.what.figures else []
            size = (
                max(84.0, max(*texts, *figures) + 24),
                _BOX + (_LINE * len(area.what.figures) + 4) * bool(area.what.figures),
            )
            area.size = size
            return
        edges = [edge for edge in self._graph.edges if self._around(edge) == path]
        arrows = [Arrow(*self._ends(edge, len(path)), _label_size(edge)) for edge in edges]
        up = turned(list(area.inner), arrows)
        inside: dict[str, list[_Exit]] = {key: [] for key in area.inner}
        for number, edge in enumerate(edges):
            for end, key in enumerate(self._ends(edge, len(path))):
                inside[key].append(_Exit(edge, end, (number in up) == (end == 0)))
        for each in leaving:
            inside[self._ends(each.edge, len(path))[each.end]].append(each)
        for key, inner in area.inner.items():
            self._arrange(inner, (*path, key), inside[key])
        boxes = {key: Box(*inner.size) for key, inner in area.inner.items()}
        names = [f"exit {number}" for number in range(len(leaving))]
        for name, each in zip(names, leaving, strict=True):
            key = self._ends(each.edge, len(path))[each.end]
            boxes[name] = Box(0.0, 0.0)
            arrows.append(Arrow(name, key) if each.top else Arrow(key, name))
        last = [name for name, each in zip(names, leaving, strict=True) if not each.top]
        self._take(area, layered(boxes, arrows, last), edges, leaving, names)

    def _take(
        self, area: _Area, layout: Layout, edges: Sequence[Edge], leaving: Sequence[_Exit], names: Sequence[str]
    ) -> None:
        framed = isinstance(area.what, Group) and area.what.kind is not Around.NETWORK
        title, padding = (_TITLE, _PADDING) if framed else (0.0, 0.0)
        least = len(_heading(area.what)) * _LETTER + 24 if isinstance(area.what, Group) and framed else 0.0
        wide = max(layout.size[0], least - 2 * padding)
        left = padding + (wide - layout.size[0]) / 2
        down = title + (0.0 if any(each.top for each in leaving) else padding)  # nothing else is up there
        below = 0.0 if any(not each.top for each in leaving) else padding
        area.places = {key: (x + left, y + down) for key, (x, y) in layout.corners.items()}
        area.size = (wide + 2 * padding, layout.size[1] + down + below)
        routes = [moved(route, left, down) for route in layout.routes]
        area.routes = dict(zip(edges, routes, strict=False))
        for each, name, route in zip(leaving, names, routes[len(edges) :], strict=True):
            border = 0.0 if each.top else area.size[1]
            area.exits[each.edge, each.end] = route, (area.places[name][0], border)

    def _ends(self, edge: Edge, depth: int) -> tuple[str, str]:
        """In what of a group, so deep inside of others, the ends of an arrow are; nothing for one that is elsewhere."""
        one, other = ((*self._paths[name], "")[depth : depth + 1] for name in self._names(edge))
        return "".join(one), "".join(other)

    def _around(self, edge: Edge) -> tuple[str, ...]:
        """The path of the innermost group that has both ends in it."""
        common: list[str] = []
        source, target = self._names(edge)
        for one, other in zip(self._paths[source][:-1], self._paths[target][:-1], strict=False):
            if one != other:
                break
            common.append(one)
        return tuple(common)

    def _put(self, area: _Area, corner: Point) -> None:
        area.corner = corner
        for key, inner in area.inner.items():
            x, y = area.places[key]
            self._put(inner, (corner[0] + x, corner[1] + y))

    # Arrows.

    def _fanned(self) -> dict[tuple[Edge, int], Point]:
        """Where arrows begin and end: side by side on the borders of boxes, in the order in which they come."""
        meeting: dict[tuple[str, bool], list[tuple[float, int, Edge, int]]] = {}
        for number, edge in enumerate(self._graph.edges):
            for end, name in enumerate(self._names(edge)):
                group = self._areas[name][1]
                if edge in group.routes:
                    route = group.routes[edge]
                    point, bottom = route.points[-end], (end == 0) != route.up
                else:
                    route, (_, border) = group.exits[edge, end]
                    bottom = border > 0
                    point = route.points[0 if bottom else -1]
                meeting.setdefault((name, bottom), []).append((group.corner[0] + point[0], number, edge, end))
        found: dict[tuple[Edge, int], Point] = {}
        for (name, bottom), met in meeting.items():
            box = self._areas[name][0]
            (x, y), (width, height) = box.corner, box.size
            near = min(1.0, 44 * (len(met) + 1) / width)
            for place, (_, _, edge, end) in enumerate(sorted(met, key=lambda each: each[:2])):
                share = 0.5 + ((place + 1) / (len(met) + 1) - 0.5) * near
                found[edge, end] = (x + width * share, y + height if bottom else y)
        return found

    def _arrow(self, number: int) -> str:
        edge = self._graph.edges[number]
        (out, common), (into, _) = self._leg(edge, 0), self._leg(edge, 1)
        route = moved(common.routes[edge], *common.corner)
        beside = (out[-1][0], route.borders[0]), (into[-1][0], route.borders[1])
        points = [*out, beside[0], *route.points, beside[1], *reversed(into)]
        classes = _classes("topic" * edge.topic, edge)
        colour = _colour_of(edge)
        return (
            f'<path{classes}{_id("edge", number, edge)} d="{curve(points)}"'
            f' stroke="{colour}" marker-end="url(#{_tip(colour)})">'
            f"<title>{escaped(_tooltip(edge))}</title></path>"
        )

    def _leg(self, edge: Edge, end: int) -> tuple[list[Point], _Area]:
        """From a box through all groups to the one that has the other end in it, too; and that one."""
        points = [self._tips[edge, end]]
        for area in self._areas[self._names(edge)[end]][1:]:
            if edge in area.routes:
                return points, area
            route, (x, y) = area.exits[edge, end]
            placed = moved(route, *area.corner)
            downwards = y > 0
            near, far = placed.borders if downwards else placed.borders[::-1]
            passed = placed.points if downwards else placed.points[::-1]
            out = x + area.corner[0]
            points += [(points[-1][0], near), *passed, (out, far), (out, y + area.corner[1])]
        raise AssertionError("both ends are in the network")

    # Drawing.

    def _boxes(self, area: _Area) -> Iterator[str]:
        (x, y), (width, height), what = area.corner, area.size, area.what
        if isinstance(what, Edge):
            circle = f'cx="{x + width / 2:.1f}" cy="{y + width / 2:.1f}" r="{width / 2:.1f}"'
            yield f'<circle class="end" {circle} stroke="{_colour_of(what)}"/>'
            return
        place = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'
        if isinstance(what, Node):
            middle, alone = x + width / 2, what.component.lower() == what.short.lower()
            number = self._numbers[what]
            shape = f"{_classes('', what)}{_id('node', number, what)}".lstrip()
            shape += " " * bool(shape)
            yield f'<rect {shape}{place} rx="7"><title>{escaped(what.name)}</title></rect>'
            line = y + (28 if alone else 20)
            yield f'<text class="name" x="{middle:.1f}" y="{line:.1f}">{escaped(what.short)}</text>'
            if not alone:
                said = escaped(what.component)
                yield f'<text class="component" x="{middle:.1f}" y="{y + 36:.1f}">{said}</text>'
            for at, text in enumerate(what.figures):
                yield _figures(f"node-{number}-{at}", what.mark, middle, y + _BOX + 4 + _LINE * at, text)
            return
        if what.kind is not Around.NETWORK:
            yield f'<rect class="{what.kind}" {place} rx="9"/>'
        for inner in area.inner.values():
            yield from self._boxes(inner)

    def _titles(self, root: _Area) -> Iterator[str]:
        for area in _every(root):
            (x, y), group = area.corner, area.what
            if not isinstance(group, Group) or group.kind is Around.NETWORK:
                continue
            width = len(_heading(group)) * _LETTER * 0.93
            kind = f'<tspan class="kind" style="font-weight:normal;fill:#5b6d80">{group.kind}</tspan>'
            yield f'<rect class="behind {group.kind}" x="{x + 8:.1f}" y="{y + 6:.1f}" width="{width:.1f}" height="16"/>'
            yield f'<text class="title" x="{x + 12:.1f}" y="{y + 18:.1f}">{kind} {escaped(group.title)}</text>'

    def _labels(self, root: _Area) -> Iterator[str]:
        numbers = {edge: number for number, edge in enumerate(self._graph.edges)}
        for area in _every(root):
            for edge, route in area.routes.items():
                x, y = route.label[0] + area.corner[0], route.label[1] + area.corner[1]
                width, height = _label_size(edge)
                yield (
                    f'<rect class="label" x="{x - width / 2:.1f}" y="{y - height / 2:.1f}" width="{width:.1f}"'
                    f' height="{height:.1f}"/>'
                )
                lines = _label(edge)
                for line, text in enumerate(lines):
                    down = y - height / 2 + _LINE * (line + 0.8)
                    yield f'<text class="label" x="{x:.1f}" y="{down:.1f}">{escaped(text)}</text>'
                for line, text in enumerate(edge.figures):
                    down = y - height / 2 + _LINE * (len(lines) + line + 0.8)
                    yield _figures(f"edge-{numbers[edge]}-{line}", edge.mark, x, down, text)

    def _legend(self, carried: list[str], marks: list[Mark]) -> Iterator[str]:
        if not self._graph.edges:
            return
        x, y = _MARGIN, _MARGIN + self._root.size[1] + _LEGEND - 4
        entries = [("calls", "", _UNKNOWN), ("topic", ' class="topic"', _UNKNOWN)]
        entries += [(name, "", _colour(name)) for name in carried]
        entries += [(_NAMED[mark], f' class="{mark}"', _MARKED[mark]) for mark in marks]
        for text, kind, colour in entries:
            yield (
                f'<path{kind} d="M{x:.1f} {y - 4:.1f} h26" stroke="{colour}"'
                f' marker-end="url(#{_tip(colour)})"/><text class="legend" x="{x + 32:.1f}" y="{y:.1f}">{text}</text>'
            )
            x += 32 + len(text) * _SMALL + 24


def _every(area: _Area) -> Iterator[_Area]:
    yield area
    for inner in area.inner.values():
        yield from _every(inner)


def _heading(group: Group) -> str:
    return f"{group.kind} {group.title}"


def _label(edge: Edge) -> list[str]:
    more = len(edge.interfaces) - _MOST
    return [*edge.interfaces[:_MOST], *([f"and {more} more"] if more > 0 else [])]


def _label_size(edge: Edge) -> Point:
    lines = _label(edge)
    letters = max(max(map(len, lines)), _ROOM if edge.figures else 0)
    return letters * _SMALL, _LINE * (len(lines) + len(edge.figures)) + 2


def _tooltip(edge: Edge) -> str:
    verb = "calls" if not edge.topic else "publishes to" if edge.target else "publishes, without a subscriber"
    over = f", over {edge.middleware}" if edge.middleware else ""
    mark = f" ({_NAMED[edge.mark]})" if edge.mark else ""
    return f"{edge.source} {verb}{edge.target and f' {edge.target}'}: {', '.join(edge.interfaces)}{over}{mark}"


def _colour(middleware: str) -> str:
    return deployment_of(middleware).colour if middleware else _UNKNOWN


def _colour_of(edge: Edge) -> str:
    return _MARKED[edge.mark] if edge.mark else _colour(edge.middleware)


def _classes(kind: str, what: Edge | Node) -> str:
    words = [word for word in (kind, str(what.mark), "strained" * what.is_strained) if word]
    return f' class="{" ".join(words)}"' if words else ""


def _id(kind: str, number: int, what: Edge | Node) -> str:
    """By which a page finds what it changes in the picture; nothing if it changes nothing."""
    return f' id="{kind}-{number}"' if what.figures else ""


def _figures(name: str, mark: Mark, x: float, y: float, text: str) -> str:
    words = f"figures {mark}".rstrip()
    return f'<text class="{words}" id="{name}" x="{x:.1f}" y="{y:.1f}">{escaped(text)}</text>'


def _tip(colour: str) -> str:
    return "tip" if colour == _UNKNOWN else f"tip-{colour.removeprefix('#')}"
