"""`rc delay`: how old messages are when they arrive."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from .hosts import hosts_of
from .live import EXIT_STATUS, awaited, reported, subscriptions_of, topics_of, understood
from .measuring import add_measured, measure, messages

if TYPE_CHECKING:
    from ..tools.network import Channel, Network
    from ..tools.traffic import Traffic

NAME = "delay"

_EXAMPLES = f"""\
examples:
  rc delay CameraSimplePub               once a second: the median age, and the age that 99 % do not exceed
  rc delay LaserPub --window 1000        of more messages
  rc delay LaserPub --for 5 --json       for machines

The age is the time from the publisher's `send` until the message is here, by the clocks of both hosts. The scout of
another host measures it there. `(one clock)` says that both are known to be on one host. Otherwise, `rc doctor`
compares the clocks.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    add_measured(to, "the age of messages on arrival", _EXAMPLES)


def run(options: argparse.Namespace) -> int:
    from ..tools.access import Access
    from ..tools.asking import have_one_clock

    def pick(network: Network) -> tuple[Network, list[Channel]]:
        return network, topics_of(network, options.topics)

    with reported("rc delay") as code, hosts_of(options) as hosts:
        network, named = awaited(options, pick, hosts)
        topics = subscriptions_of(understood(options, named))
        with Access() as access:
            near = {(each.name, each.host) for each in topics if have_one_clock(access, network, each)}

        def words(channel: Channel, traffic: Traffic) -> str:
            ages = traffic.ages()
            if ages is None:
                return f"its messages do not tell when they were sent, {messages(traffic)}"
            said = f"{ages.median * 1e3:.2f} ms, 99 % within {ages.p99 * 1e3:.2f}, {messages(traffic)}"
            return f"{said} (one clock)" if (channel.name, channel.host) in near else said

        def figures(channel: Channel, traffic: Traffic, is_silent: bool) -> Mapping[str, object]:
            ages = traffic.ages()
            return {
                "median_s": ages and ages.median,
                "p99_s": ages and ages.p99,
                "one_clock": (channel.name, channel.host) in near,
            }

        return measure(options, hosts, topics, words, figures)
    return code()
