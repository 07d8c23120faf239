"""`rc plot`: pictures of recordings."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .bag import add_span, span_of, time_of
from .common import FINE, counted
from .completing import What, completed
from .live import RECORDING, add_json, reported

if TYPE_CHECKING:
    from ..tools.recording.reader import Recording

NAME = "plot"

_EXAMPLES = """\
examples:
  rc plot run1 LaserPub.scan[0].dist -o dist.svg         a number of each message, over time
  rc plot run1 ArmPub.pose BatteryPub -o both.png        all numbers of a struct, and below them all of a topic
  rc plot run1 ArmPub --start 5 --for 10 -o part.svg     ten seconds of it
  rc plot run1 --latency -o latency.svg                  from sent to recorded: a histogram for each topic
  rc plot run1 LaserPub --latency --json -o l.svg        ... of one topic; p50, p99 and the longest also as JSON

Each NAME is a part of the picture with an axis of its own. Numbers, booleans (0, 1) and members of enumerations (their
numbers) are drawn. If a message has too few items for scan[9], its curve has a gap. Latencies are differences between
clocks if a message came from another host. This needs matplotlib: pip install 'robocomp-py[record,plot]'.

exit status: 0 done, 1 the recording is broken or has nothing to draw, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Draw numbers of recorded messages over time, or histograms of latencies."
    to.epilog = _EXAMPLES
    recording = to.add_argument("recording", type=Path, metavar="RECORDING", help=RECORDING)
    completed(recording, ".mcap")
    names = to.add_argument(
        "names",
        nargs="*",
        metavar="NAME[.FIELD]",
        help="a topic or a part of its name, and a path in its messages: world/LaserPub.scan[0].dist",
    )
    completed(names, What.RECORDED)
    to.add_argument(
        "-o",
        dest="output",
        type=Path,
        required=True,
        metavar="PICTURE",
        help="a .svg, .png or .pdf; one that exists is replaced",
    )
    to.add_argument("--latency", action="store_true", help="draw how long messages were on their way")
    add_span(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    from ..errors import ConfigurationError
    from ..tools.drawing import ENDINGS, need_matplotlib
    from ..tools.recording.bag import RecordingError
    from ..tools.recording.reader import Recording

    with reported("rc plot") as code:
        if options.output.suffix.lower() not in ENDINGS:
            raise ConfigurationError(
                f"{options.output}: pictures are written as {', '.join(ENDINGS)}; use one of these"
            )
        need_matplotlib()
        with Recording(options.recording) as recording:
            if not options.names and not options.latency:
                known = ", ".join(recording.topics) or "none"
                raise ConfigurationError(f"name the topics to draw, or use --latency; {recording.path} has {known}")
            try:
                found = _latency(recording, options) if options.latency else _curves(recording, options)
            except OSError as exc:
                raise RecordingError(f"{options.output}: {exc.strerror or exc}") from exc
        for each in found:
            print(json.dumps(each) if options.json else f"{options.output}: {_sentence(each)}")
        return FINE
    return code()


def _curves(recording: Recording, options: argparse.Namespace) -> list[dict[str, Any]]:
    import numpy as np

    from ..tools.drawing import Line, draw_curves
    from ..tools.recording.bag import RecordingError
    from ..tools.recording.series import curves

    groups = curves(recording, options.names, *span_of(options, recording))
    told = []
    for each in (each for group in groups for each in group):
        known = each.values[np.isfinite(each.values)]
        if not len(known):
            raise RecordingError(f"{recording.path}: no message of {each.topic} has a number at `{each.path}`")
        figures = {"least": float(known.min()), "most": float(known.max()), "mean": float(known.mean())}
        told.append({"topic": each.topic, "field": each.path, "values": len(known), **figures})
    parts = []
    for group in groups:
        title = group[0].topic if len(group) > 1 else f"{group[0].topic} {group[0].path}"
        parts.append((title, [Line(each.path, each.times, each.values) for each in group]))
    draw_curves(parts, time_of(recording.start), options.output)
    return told


def _latency(recording: Recording, options: argparse.Namespace) -> list[dict[str, Any]]:
    from ..tools.drawing import draw_delays
    from ..tools.measure import milliseconds, percentile
    from ..tools.recording.bag import RecordingError
    from ..tools.recording.reader import named
    from ..tools.recording.series import delays

    names = [each for name in options.names for each in named(recording, name)] if options.names else None
    found = delays(recording, names, *span_of(options, recording))
    told, notes = [], {}
    for topic, seconds in found.items():
        if not len(seconds):
            print(f"rc plot: {topic}: no message tells when it was sent, so it is left out", file=sys.stderr)
            continue
        each = seconds.tolist()
        figures = {"p50_s": percentile(each, 0.5), "p99_s": percentile(each, 0.99), "longest_s": max(each)}
        told.append({"topic": topic, "messages": len(each), **figures})
        p50, p99, longest = map(milliseconds, figures.values())
        notes[topic] = f"{counted(len(seconds), 'message')}, p50 {p50} ms, p99 {p99} ms, longest {longest} ms"
    if not told:
        raise RecordingError(f"{recording.path}: it has no message that tells when it was sent")
    draw_delays({topic: found[topic] for topic in notes}, notes, options.output)
    return told


def _sentence(told: dict[str, Any]) -> str:
    from ..tools.measure import milliseconds

    if "field" in told:
        span = f"{told['least']:g} to {told['most']:g}, mean {told['mean']:g}"
        return f"{told['topic']} {told['field']}: {counted(told['values'], 'value')}, {span}"
    p50, p99, longest = (milliseconds(told[name]) for name in ("p50_s", "p99_s", "longest_s"))
    return f"{told['topic']}: {counted(told['messages'], 'message')}, p50 {p50} ms, p99 {p99} ms, longest {longest} ms"
