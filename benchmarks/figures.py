"""Line charts of the stored results, as SVG: logarithmic axes, one line for each series.

Text and grid are grey, so that a chart is readable on a light and on a dark page.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from .tables import octets, us

WIDTH, HEIGHT = 760, 400
LEFT, RIGHT, TOP, BOTTOM = 70, 200, 40, 50
COLOURS = {"shm": "#0072b2", "zeromq": "#d55e00", "zenoh": "#009e73", "dds": "#cc79a7", "inproc": "#7f7f7f"}
OTHERS = ("#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f")

Point = tuple[float, float]


@dataclass(frozen=True)
class Series:
    name: str
    points: Sequence[Point]
    colour: str
    dashed: bool = False


@dataclass(frozen=True)
class Chart:
    """`ticks` are the places on the horizontal axis, with their labels. Heights are times in µs, or rates."""

    title: str
    below: str
    ticks: Mapping[float, str]
    series: Sequence[Series]
    rate: bool = False
    label: Callable[[float], str] | None = None
    """Writes a height, if it is neither."""


def drawn(results: Mapping[str, Any]) -> dict[str, str]:
    """Every figure of the page, by the name of its file."""
    query, publish, peers = results["query"], results["publish"], results["peers"]
    latency = [{**row, "ours": _part(row["ours"], "latency"), "raw": _part(row["raw"], "latency")} for row in publish]
    rate = [{**row, "ours": _rate(row["ours"]), "raw": _rate(row["raw"])} for row in publish]
    return {
        "performance-query.svg": svg(sizes("Query: round trip, median", query)),
        "performance-latency.svg": svg(sizes("Publication: one way, median", latency)),
        "performance-rate.svg": svg(sizes("Publication: messages per second", rate, rate=True)),
        "performance-peers.svg": svg(_peers(peers)),
        "performance-spread.svg": svg(_spread(query)),
    }


def _part(figures: Mapping[str, Any] | None, name: str) -> Any:
    return figures and figures[name]


def _rate(figures: Mapping[str, Any] | None) -> dict[str, float] | None:
    return {"p50": figures["rate"]} if figures else None


def sizes(title: str, rows: Iterable[Mapping[str, Any]], rate: bool = False) -> Chart:
    """Ours and the raw library over the size of the array."""
    lines: dict[tuple[str, str], list[Point]] = {}
    for row in rows:
        for party in ("ours", "raw"):
            if row[party]:
                lines.setdefault((row["middleware"], party), []).append((row["size"], row[party]["p50"]))
    series = [
        Series(f"{name}, {party}", points, COLOURS.get(name, "#7f7f7f"), dashed=party == "raw")
        for (name, party), points in lines.items()
    ]
    return Chart(title, "size of the array", _size_ticks(series), series, rate)


def _peers(rows: Iterable[Mapping[str, Any]]) -> Chart:
    measured = [row for row in rows if row["times"]]
    colours = (COLOURS["shm"], *OTHERS)
    series = [
        Series(row["name"], [(int(size), each["p50"]) for size, each in row["times"].items()], colour)
        for row, colour in zip(measured, colours, strict=False)
    ]
    return Chart("Query: round trip beside other frameworks, median", "size of the array", _size_ticks(series), series)


def _spread(rows: Iterable[Mapping[str, Any]]) -> Chart:
    """The distribution of the round trips of the smallest array; slower calls are further to the right."""
    rows = list(rows)
    smallest = min(row["size"] for row in rows)
    series = [
        Series(f"{row['middleware']}, {party}", _percentiles(row[party]), COLOURS[row["middleware"]], party == "raw")
        for row in rows
        for party in ("ours", "raw")
        if row["size"] == smallest and row[party] and row["middleware"] in COLOURS
    ]
    measured = {x for each in series for x, _ in each.points}
    ticks = {x: f"{100 - 100 / x:g} %" for x in sorted(measured)}
    return Chart(f"Query of {octets(smallest)}: share of calls that are quicker", "share of all calls", ticks, series)


def _percentiles(times: Mapping[str, Any]) -> list[Point]:
    """Pairs of a number and a time: one call in this number is slower than the time."""
    known = {50.0: times["p50"]} | {float(share): each for share, each in times.get("percentiles", ())}
    known[99.0] = times["p99"]
    return [(100 / (100 - share), each) for share, each in sorted(known.items())]


def _size_ticks(series: Iterable[Series]) -> dict[float, str]:
    return {x: octets(int(x)) for x in sorted({x for each in series for x, _ in each.points})}


def svg(chart: Chart) -> str:
    heights = [y for each in chart.series for _, y in each.points]
    low, high = _powers(min(heights), max(heights))
    x_low, x_high = math.log(min(chart.ticks)), math.log(max(chart.ticks))

    def place(point: Point) -> Point:
        x = LEFT + (math.log(point[0]) - x_low) / (x_high - x_low) * (WIDTH - LEFT - RIGHT)
        y = HEIGHT - BOTTOM - (math.log10(point[1]) - low) / (high - low) * (HEIGHT - TOP - BOTTOM)
        return x, y

    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    body = [_text(LEFT, 20, chart.title, 'font-weight="bold"')]
    for power in range(low, high + 1):
        _, y = place((min(chart.ticks), 10.0**power))
        body.append(f'<path d="M{LEFT} {y:.1f}H{right}" stroke="#808080" stroke-opacity="0.4"/>')
        label = f"{10**power:,}/s" if chart.rate else (chart.label or us)(10.0**power).replace(".0 ", " ")
        body.append(_text(LEFT - 8, y + 4, label, 'text-anchor="end"'))
    for tick, label in chart.ticks.items():
        x, _ = place((tick, 10.0**low))
        body.append(f'<path d="M{x:.1f} {TOP}V{bottom}" stroke="#808080" stroke-opacity="0.2"/>')
        body.append(_text(x, bottom + 18, label, 'text-anchor="middle"'))
    body.append(_text((LEFT + right) / 2, HEIGHT - 10, chart.below, 'text-anchor="middle"'))
    for number, each in enumerate(chart.series):
        placed = [place(point) for point in each.points]
        dashes = ' stroke-dasharray="5 4"' if each.dashed else ""
        stroke = f'fill="none" stroke="{each.colour}" stroke-width="2"{dashes}'
        line = "L".join(f"{x:.1f} {y:.1f}" for x, y in placed)
        body.append(f'<path d="M{line}" {stroke}/>')
        body += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{each.colour}"/>' for x, y in placed]
        y = TOP + 10 + 20 * number
        body.append(f'<path d="M{right + 16} {y}h28" {stroke}/>')
        body.append(_text(right + 50, y + 4, each.name))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img"'
            ' font-family="sans-serif" font-size="12" fill="#808080">',
            f"<title>{escape(chart.title)}</title>",
            *body,
            "</svg>\n",
        ]
    )


def _powers(least: float, most: float) -> tuple[int, int]:
    low, high = math.floor(math.log10(least)), math.ceil(math.log10(most))
    return low, max(high, low + 1)


def _text(x: float, y: float, text: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}"{" " if more else ""}{more}>{escape(text)}</text>'
