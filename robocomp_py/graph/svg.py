"""What pictures of boxes and arrows have in common, as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from ..printable import spaced
from .layers import Point, Route


def escaped(text: str) -> str:
    return escape(spaced(text))


def document(title: str, style: str, size: Point, body: Iterable[str], markers: str = "") -> str:
    """A picture on white. `tip` is the marker for the tip of an arrow; `markers` are more of them."""
    width, height = size
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}"'
            f' viewBox="0 0 {width:.0f} {height:.0f}" role="img">',
            f"<title>{escaped(title)}</title>",
            f"<style>\n{style}</style>",
            f"<defs>{marker('tip', '#51657b')}{markers}</defs>",
            f'<rect width="{width:.0f}" height="{height:.0f}" style="fill:#fff;stroke:none"/>',
            *body,
            "</svg>\n",
        ]
    )


def marker(name: str, colour: str) -> str:
    """The tip of arrows of one colour."""
    return (
        f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8"'
        f' orient="auto"><path d="M0 1 L9 5 L0 9 Z" style="fill:{colour};stroke:none"/></marker>'
    )


def curve(points: Sequence[Point]) -> str:
    """The data of a line that is vertical wherever it passes a layer."""
    (x, y), rest = points[0], points[1:]
    parts = [f"M{x:.1f} {y:.1f}"]
    for to_x, to_y in rest:
        if abs(to_x - x) < 0.5 and abs(to_y - y) < 0.5:
            continue  # nothing to draw, and no direction for the tip
        if abs(to_x - x) < 0.5:
            parts.append(f"L{to_x:.1f} {to_y:.1f}")
        else:
            middle = (y + to_y) / 2
            parts.append(f"C{x:.1f} {middle:.1f} {to_x:.1f} {middle:.1f} {to_x:.1f} {to_y:.1f}")
        x, y = to_x, to_y
    return " ".join(parts)


def moved(route: Route, x: float, y: float) -> Route:
    points = tuple((x + px, y + py) for px, py in route.points)
    borders = (route.borders[0] + y, route.borders[1] + y)
    return Route(points, (route.label[0] + x, route.label[1] + y), route.up, borders)
