"""Shared by the commands that measure topics: `rc hz`, `rc bw` and `rc delay`."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from .common import FINE
from .hosts import add_hosts
from .live import add_topics, count, nothing_heard

if TYPE_CHECKING:
    from ..tools.network import Channel
    from ..tools.traffic import Traffic

_TELL = 1.0
"""Seconds between two lines of a topic."""

Words = Callable[["Channel", "Traffic"], str]
"""What a line says of a topic, without its name; "" if there is nothing to tell yet."""

Figures = Callable[["Channel", "Traffic", bool], Mapping[str, object]]
"""The same for machines; the last argument is whether the topic is silent now."""


def add_measured(to: argparse.ArgumentParser, what: str, epilog: str) -> None:
    to.description = f"Measure {what}, until Ctrl-C. Messages are not decoded."
    to.epilog = epilog
    to.add_argument(
        "--window", type=count, default=100, metavar="COUNT", help="the last messages that count (default: 100)"
    )
    add_topics(to)
    add_hosts(to)


def measure(options: argparse.Namespace, topics: Sequence[Channel], words: Words, figures: Figures) -> int:
    """Print a line of each topic once a second, as `add_measured` has it. Raises Absent if nothing is heard."""
    from ..tools.tap import Resumed, arrivals
    from ..tools.traffic import Traffic

    heard: dict[str, Traffic] = {}
    channels = {each.name: each for each in topics}

    def tell() -> None:
        now = time.monotonic()
        for name, traffic in heard.items():
            channel, silent = channels[name], traffic.silence(now)
            over = channel.middlewares[0]
            if options.json:
                about = {"channel": name, "middleware": over, "messages": traffic.number}
                print(json.dumps(about | dict(figures(channel, traffic, bool(silent)))), flush=True)
            elif silent:
                print(f"{name} over {over}: nothing for {silent:.1f} s, {messages(traffic)}", flush=True)
            else:
                print(f"{name} over {over}: {words(channel, traffic) or messages(traffic)}", flush=True)

    told, told_of = time.monotonic(), 0
    for each in arrivals(topics, first=options.timeout, whole=options.seconds):
        if isinstance(each, Resumed):
            for traffic in heard.values():
                traffic.resume(each.at)
        elif each:
            heard.setdefault(each.channel, Traffic(options.window)).note(each)
        if time.monotonic() - told >= _TELL:
            told, told_of = time.monotonic(), _number(heard)
            tell()
    if not heard:
        raise nothing_heard(options)
    if options.seconds and _number(heard) > told_of:
        tell()
    return FINE


def _number(heard: Mapping[str, Traffic]) -> int:
    return sum(each.number for each in heard.values())


def messages(traffic: Traffic) -> str:
    return "1 message" if traffic.number == 1 else f"{traffic.number} messages"
