"""`rc pub`: publishes to a topic."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from .common import FINE, USAGE
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import (
    EXIT_STATUS,
    TOPIC,
    add_definitions,
    add_json,
    add_middleware,
    add_request,
    add_waiting,
    add_yes,
    allowed,
    awaited,
    count,
    positive,
    reported,
    request_of,
    topic_to_publish,
)

if TYPE_CHECKING:
    from ..tools.network import Channel, Network

NAME = "pub"

_EXAMPLES = f"""\
examples:
  rc pub world/BatteryStatusPub battery.percentage=20 ...    one message; `rc pub NAME` shows what it takes
  rc pub LaserPub @scan.json --rate 20                       20 times a second, until Ctrl-C
  rc pub LaserPub @scan.json --rate 20 -n 100                ... a hundred times
  rc pub MapPub @map.json --latch                            until Ctrl-C, also to those that subscribe later

The messages appear as those of the instance in the name of the topic.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Publish a message to a topic, once it has a subscriber."
    to.epilog = _EXAMPLES
    completed(to.add_argument("topic", metavar="NAME", help=TOPIC), What.TOPIC)
    add_request(to)
    to.add_argument("--rate", type=positive, metavar="HZ", help="messages a second, until Ctrl-C or -n (default: 1)")
    to.add_argument("-n", "--count", dest="most", type=count, metavar="COUNT", help="how many messages (default: one)")
    to.add_argument(
        "--latch",
        action="store_true",
        help="keep the last message, until Ctrl-C, for subscribers that come later and ask for transient_local",
    )
    add_yes(to)
    add_definitions(to)
    add_waiting(to)
    add_hosts(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc pub") as code, hosts_of(options) as hosts:

        def pick(network: Network) -> tuple[Network, Channel]:
            channel = topic_to_publish(network, options.topic)
            wanted = options.arguments and not options.latch
            if hosts.posts and wanted and not channel.users:  # it may get one on any host
                raise ValueError(f"nothing subscribes to {channel.name}")
            return network, channel

        network, channel = awaited(options, pick, hosts)
        hosts.check_publishing(channel)
        return _publish(network, channel, options)
    return code()


def _publish(network: Network, channel: Channel, options: argparse.Namespace) -> int:
    from ..tools import asking
    from ..tools.access import Access
    from ..tools.publishing import publish

    with Access() as access:
        told = asking.about(access, network, channel)
        taken = request_of(channel.name, channel.operation.inputs, options.arguments, "rc pub", told)
        if taken is None:
            return USAGE
        if refused := allowed(channel, told, "rc pub", yes=options.yes):
            return refused
        most = options.most or (None if options.rate else 1)
        publish(access, channel, taken, options.timeout, rate=options.rate, most=most, latched=options.latch)
        if options.json:
            print(json.dumps({"channel": channel.name, "messages": most}))
        return FINE
