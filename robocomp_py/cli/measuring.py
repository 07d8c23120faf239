"""Shared by the commands that measure topics: `rc hz`, `rc bw` and `rc delay`."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from .common import UNREACHABLE, counted
from .hosts import add_hosts, code_of
from .live import add_topics, count, nothing_heard, seek_of, tell_found, tell_host

if TYPE_CHECKING:
    from ..tools.hosts import Hosts
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


def measure(
    options: argparse.Namespace, hosts: Hosts, topics: Sequence[Channel], words: Words, figures: Figures
) -> int:
    """Print a line of each topic and host once a second, as `add_measured` has it. `topics` are subscriptions.

    Raises Absent if nothing is heard.
    """
    from ..tools.tap import Back, Found, Lost, Resumed, arrivals
    from ..tools.traffic import Traffic

    heard: dict[tuple[str, str], Traffic] = {}
    subscribed: dict[tuple[str, str], list[Channel]] = {}

    def note(found: Sequence[Channel]) -> None:
        for each in found:
            subscribed.setdefault((each.name, each.host), []).append(each)

    def tell() -> None:
        now = time.monotonic()
        for (name, host), traffic in heard.items():
            (channel, *_), silent = (those := subscribed[name, host]), traffic.silence(now)
            over = ", ".join(dict.fromkeys(each.middlewares[0] for each in those))
            if options.json:
                about = {"channel": name, "host": host, "middleware": over, "messages": traffic.number}
                print(json.dumps(about | dict(figures(channel, traffic, bool(silent)))), flush=True)
                continue
            told = f"{name} over {over} of {host}" if host else f"{name} over {over}"
            if silent:
                print(f"{told}: nothing for {silent:.1f} s, {messages(traffic)}", flush=True)
            else:
                print(f"{told}: {words(channel, traffic) or messages(traffic)}", flush=True)

    note(topics)
    told, told_of, code = time.monotonic(), 0, code_of(hosts)
    for each in arrivals(topics, first=options.timeout, whole=options.seconds, seek=seek_of(options, hosts)):
        if isinstance(each, Resumed):
            for traffic in heard.values():
                traffic.resume(each.at)
        elif isinstance(each, Found):
            note(each.topics)
            tell_found(options, each)
        elif isinstance(each, Lost | Back):
            code = UNREACHABLE
            tell_host(options, each)
        elif each:
            heard.setdefault((each.channel, each.host), Traffic(options.window)).note(each)
        if time.monotonic() - told >= _TELL:
            told, told_of = time.monotonic(), _number(heard)
            tell()
    if not heard:
        raise nothing_heard(options)
    if options.seconds and _number(heard) > told_of:
        tell()
    return code


def _number(heard: Mapping[tuple[str, str], Traffic]) -> int:
    return sum(each.number for each in heard.values())


def messages(traffic: Traffic) -> str:
    return counted(traffic.number, "message")
