"""`rc hz`: how often something is published."""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from collections import defaultdict, deque
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from .common import FINE
from .live import EXIT_STATUS, add_topics, awaited_topics, count, nothing_heard, reported

if TYPE_CHECKING:
    from ..tools.tap import Arrival

NAME = "hz"
HELP = "measure how often topics are published, and how much"

_EXAMPLES = f"""\
examples:
  rc hz LaserPub                     once a second: rate, shortest and longest interval, octets
  rc hz LaserPub CameraSimplePub     several topics
  rc hz LaserPub --for 5 --json      for machines

{EXIT_STATUS}
"""

_TELL = 1.0
"""Seconds between two lines of a topic."""

_SILENT = 1.0
"""A topic whose last message is older than this, in seconds, may count as silent."""

_GAPS = 3.0
"""It does if that is also longer than this number of its longest intervals."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Measure the rate of topics and their octets per second, until Ctrl-C. Messages are not decoded."
    to.epilog = _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    to.add_argument(
        "--window", type=count, default=100, metavar="COUNT", help="the last messages that count (default: 100)"
    )
    add_topics(to)


def run(options: argparse.Namespace) -> int:
    from ..tools.tap import arrivals

    with reported("rc hz") as code:
        topics = awaited_topics(options)
        seen: dict[str, deque[Arrival]] = defaultdict(lambda: deque(maxlen=options.window + 1))
        numbers: dict[str, int] = defaultdict(int)
        told = time.monotonic()
        for each in arrivals(topics, first=options.timeout, whole=options.seconds):
            if each:
                seen[each.channel].append(each)
                numbers[each.channel] += 1
            if time.monotonic() - told >= _TELL:
                told = time.monotonic()
                for channel, found in seen.items():
                    _tell(channel, numbers[channel], list(found), as_json=options.json)
        if not seen:
            raise nothing_heard(options)
        if options.seconds and time.monotonic() - told > _TELL / 10:
            for channel, found in seen.items():
                _tell(channel, numbers[channel], list(found), as_json=options.json)
        return FINE
    return code()


def _tell(channel: str, number: int, found: Sequence[Arrival], *, as_json: bool) -> None:
    gaps = [later.at - earlier.at for earlier, later in pairwise(found)]
    silent = time.monotonic() - found[-1].at
    is_silent = silent > _SILENT and silent > _GAPS * max(gaps, default=0.0)
    rate = 1 / statistics.fmean(gaps) if gaps and sum(gaps) else math.nan
    shortest, longest = (min(gaps), max(gaps)) if gaps else (math.nan, math.nan)
    octets = statistics.fmean(each.octets for each in found) * rate
    if as_json:
        figures = {
            "hz": 0.0 if is_silent else rate,
            "shortest_s": shortest,
            "longest_s": longest,
            "octets_per_s": 0.0 if is_silent else octets,
        }
        known = {name: None if math.isnan(figure) else figure for name, figure in figures.items()}
        print(json.dumps({"channel": channel, "messages": number, **known}), flush=True)
    elif is_silent:
        print(f"{channel}: nothing for {silent:.1f} s, {number} messages", flush=True)
    elif gaps:
        print(
            f"{channel}: {rate:.2f} Hz, {shortest * 1e3:.1f} to {longest * 1e3:.1f} ms, {_octets(octets)}/s, "
            f"{number} messages",
            flush=True,
        )
    else:
        print(f"{channel}: one message", flush=True)


def _octets(number: float) -> str:
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if number >= size:
            return f"{number / size:.1f} {unit}"
    return f"{number:.0f} B"
