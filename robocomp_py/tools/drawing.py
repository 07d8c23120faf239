"""Draws curves and histograms with matplotlib, an extra, into files. No display is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".png", ".pdf")

Numbers = np.ndarray[Any, np.dtype[np.float64]]

_WIDTH, _HEIGHT = 9.0, 2.6
"""Inches, of a picture and of each of its parts."""

_FINEST = 4000
"""Points of a curve. Of more, the smallest and the largest of neighbours are drawn."""

_FEW = 50
"""Maximum number of points of which each is marked."""

_BARS = 60


def need_matplotlib() -> None:
    """Raise ConfigurationError if the extra is missing."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as exc:
        raise ConfigurationError("plots need matplotlib: pip install 'robocomp-py[plot]'") from exc


class Line(NamedTuple):
    label: str
    times: Numbers
    """In seconds."""
    values: Numbers


def draw_curves(parts: Sequence[tuple[str, Sequence[Line]]], since: str, path: Path) -> None:
    """A part of the picture for each title and its curves. `since` says when second 0 was.

    Raises ConfigurationError and OSError.
    """
    figure, every = _figure(len(parts), sharex=True)
    for axes, (title, lines) in zip(every, parts, strict=True):
        for each in lines:
            few = "." if len(each.times) <= _FEW else ""
            axes.plot(*thinned(each.times, each.values), label=each.label, marker=few, linewidth=1.2)
        if len(lines) > 1:
            axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
        axes.set_title(title, fontsize="medium", loc="left", parse_math=False)
        axes.grid(alpha=0.3)
    every[-1].set_xlabel(f"seconds since {since}")
    _save(figure, path)


def draw_delays(parts: Mapping[str, Numbers], notes: Mapping[str, str], path: Path) -> None:
    """A histogram for each title, of seconds; `notes` are written beside the titles.

    Raises ConfigurationError and OSError.
    """
    figure, every = _figure(len(parts), sharex=False)
    from matplotlib.ticker import LogFormatter

    for axes, (title, seconds) in zip(every, parts.items(), strict=True):
        low, high = 1e3 * float(seconds.min()), 1e3 * float(seconds.max())
        is_wide = low > 0 and high > 10 * low
        bins = np.geomspace(low, high, _BARS + 1) if is_wide else np.linspace(low, max(high, low + 1e-6), _BARS + 1)
        axes.hist(1e3 * seconds, bins=bins)
        if is_wide:
            axes.set_xscale("log")
            for ticks in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
                ticks(LogFormatter(labelOnlyBase=False))
        axes.set_title(f"{title}: {notes[title]}", fontsize="medium", loc="left", parse_math=False)
        axes.set_ylabel("messages")
        axes.grid(alpha=0.3)
    every[-1].set_xlabel("milliseconds from sent to recorded")
    _save(figure, path)


def thinned(times: Numbers, values: Numbers, most: int = _FINEST) -> tuple[Numbers, Numbers]:
    """At most about `most` points that look the same: of neighbours the smallest and the largest, in their order."""
    if len(times) <= most:
        return times, values
    chosen: list[int] = []
    edges = np.linspace(0, len(times), most // 2 + 1).astype(int)
    for begin, end in pairwise(edges):
        part = values[begin:end]
        if np.isnan(part).all():
            chosen.append(begin)
        else:
            chosen += sorted({begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))})
    return times[chosen], values[chosen]


def _figure(parts: int, *, sharex: bool) -> tuple[Figure, list[Any]]:
    need_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, _HEIGHT * parts + 0.4), layout="constrained")
    return figure, list(figure.subplots(parts, squeeze=False, sharex=sharex)[:, 0])


def _save(figure: Figure, path: Path) -> None:
    """The same curves always make the same file."""
    from matplotlib import rc_context

    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix.lower(), {})
    with rc_context({"svg.hashsalt": "robocomp_py", "svg.fonttype": "none"}):
        figure.savefig(path, metadata=metadata, dpi=120)
