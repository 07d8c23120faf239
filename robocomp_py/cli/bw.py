"""`rc bw`: how much is published."""

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

NAME = "bw"

_EXAMPLES = f"""\
examples:
  rc bw LaserPub                     once a second: octets a second; smallest, mean and largest message
  rc bw LaserPub CameraSimplePub     several topics
  rc bw LaserPub --for 5 --json      for machines

Sizes are those of encoded messages, without headers of the middleware.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    add_measured(to, "the octets of topics", _EXAMPLES)


def run(options: argparse.Namespace) -> int:
    with reported("rc bw") as code, hosts_of(options) as hosts:
        return measure(options, hosts, awaited_topics(options, hosts), words, figures)
    return code()


def words(channel: Channel, traffic: Traffic) -> str:
    sizes = traffic.sizes()
    if sizes is None:
        return ""
    each = f"{octets(sizes.smallest)} to {octets(sizes.largest)} a message, {octets(sizes.mean)} on average"
    if sizes.smallest == sizes.largest:
        each = f"{octets(sizes.mean)} a message"
    return f"{octets(sizes.per_second)}/s, {each}, {messages(traffic)}"


def figures(channel: Channel, traffic: Traffic, is_silent: bool) -> Mapping[str, object]:
    sizes = traffic.sizes()
    return {
        "octets_per_s": 0.0 if is_silent else sizes and sizes.per_second,
        "smallest": sizes and sizes.smallest,
        "mean": sizes and sizes.mean,
        "largest": sizes and sizes.largest,
    }


def octets(number: float) -> str:
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if number >= size:
            return f"{number / size:.1f} {unit}"
    return f"{number:.0f} B"
