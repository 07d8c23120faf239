"""`rc hz`: how often something is published."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from .hosts import hosts_of
from .live import EXIT_STATUS, awaited_topics, reported
from .measuring import add_measured, measure, messages

if TYPE_CHECKING:
    from ..tools.network import Channel
    from ..tools.traffic import Traffic

NAME = "hz"

_EXAMPLES = f"""\
examples:
  rc hz LaserPub                     once a second: rate, shortest and longest interval, missing messages
  rc hz LaserPub CameraSimplePub     several topics
  rc hz LaserPub --for 5 --json      for machines

A gap is one or more messages in a row that were sent and did not arrive here; the numbers of messages tell.
Rate and intervals are those of the last messages (--window). Ctrl-Z and `fg` begin them again.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    add_measured(to, "the rate of topics", _EXAMPLES)


def run(options: argparse.Namespace) -> int:
    with reported("rc hz") as code, hosts_of(options) as hosts:
        return measure(options, hosts, awaited_topics(options, hosts), words, figures)
    return code()


def words(channel: Channel, traffic: Traffic) -> str:
    rate = traffic.rate()
    if rate is None:
        return ""
    said = [f"{rate.hz:.2f} Hz", f"{rate.shortest * 1e3:.1f} to {rate.longest * 1e3:.1f} ms", messages(traffic)]
    if traffic.gaps:
        said.append(f"{traffic.missing} missing in {traffic.gaps} {'gap' if traffic.gaps == 1 else 'gaps'}")
    elif traffic.is_numbered:
        said.append("no gap")
    return ", ".join(said)


def figures(channel: Channel, traffic: Traffic, is_silent: bool) -> Mapping[str, object]:
    rate = traffic.rate()
    return {
        "hz": 0.0 if is_silent else rate and rate.hz,
        "shortest_s": rate and rate.shortest,
        "longest_s": rate and rate.longest,
        "missing": traffic.missing if traffic.is_numbered else None,
        "gaps": traffic.gaps if traffic.is_numbered else None,
    }
