"""The figures of a growing network: cost over number, ours and bare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ..figures import COLOURS, Chart, Point, Series, sizes, svg
from ..tables import us

Stored = Mapping[str, Any]
"""A row as it is stored."""

_LEAST = 0.1
"""What is nothing is drawn so: the axis is logarithmic."""


def drawn(rows: Iterable[Stored]) -> dict[str, str]:
    """The figures, by the name of their file; none without rows."""
    return {f"performance-scale-{name}.svg": svg(chart) for name, chart in charts(rows).items() if chart.series}


def charts(rows: Iterable[Stored]) -> dict[str, Chart]:
    """The charts, by their name."""
    rows = list(rows)

    def of(part: str, key: str, title: str, below: str, label: Callable[[float], str], **only: Any) -> Chart:
        chosen = [row for row in rows if row.get("part") == part and all(row[name] == it for name, it in only.items())]
        return _chart(title, below, label, [(row, row[key]) for row in chosen])

    return {
        "memory": of("idle", "megabytes", "Idle publications: memory", "publications", lambda y: f"{y:g} MB"),
        "descriptors": of("idle", "descriptors", "Idle publications: descriptors", "publications", lambda y: f"{y:g}"),
        "ready": of(
            "idle", "seconds", "Idle publications: time until they are there", "publications", lambda y: us(y * 1e6)
        ),
        "clients": of("clients", "rate", "One server: calls a second of all clients", "clients", lambda y: f"{y:,g}/s"),
        "clients-p99": of("clients", "p99", "One server: p99 of a call", "clients", us),
        "mixed": of(
            "mixed",
            "factor",
            "p99 of quick calls beside slow ones, ÷ without them",
            "clients of the slow one",
            "{:g} ×".format,
        ),
        "fanout": of(
            "fanout",
            "cpu",
            "1 KB at 50 Hz: processor time of a subscriber",
            "subscribers",
            lambda y: f"{y:g} %",
            size=1024,
        ),
        "fanout-large": of(
            "fanout",
            "cpu",
            "1 MB at 50 Hz: processor time of a subscriber",
            "subscribers",
            lambda y: f"{y:g} %",
            size=1_000_000,
        ),
        "sizes": sizes("There and back, median", [row for row in rows if "ratio" in row]),
        "arrivals": of(
            "arrivals",
            "undiscovered",
            "Topics at 10 Hz, published at once: not discovered",
            "topics",
            lambda y: f"{y:g}",
            waits=False,
        ),
    }


def _chart(title: str, below: str, label: Callable[[float], str], found: Iterable[tuple[Stored, float]]) -> Chart:
    lines: dict[tuple[str, str], list[Point]] = {}
    for row, height in found:
        lines.setdefault((row["middleware"], row["party"]), []).append(
            (row["number"], height if height > 0 else _LEAST)
        )
    series = [
        Series(f"{name}, {party}", points, COLOURS[name], dashed=party == "raw")
        for (name, party), points in lines.items()
    ]
    return Chart(
        title, below, {x: f"{x:g}" for x in sorted({x for each in series for x, _ in each.points})}, series, label=label
    )
