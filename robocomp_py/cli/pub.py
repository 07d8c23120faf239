"""`rc pub`: publishes to a topic."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from .common import FINE, USAGE
from .completing import What, completed
from .live import (
    EXIT_STATUS,
    TOPIC,
    Absent,
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
)

if TYPE_CHECKING:
    from ..tools.network import Channel, Network

NAME = "pub"
HELP = "publish to those who subscribe to a topic"

_EXAMPLES = f"""\
examples:
  rc pub world/BatteryStatusPub battery.percentage=20 ...    one message; `rc pub NAME` shows what it takes
  rc pub LaserPub @scan.json --rate 20                       20 times a second, until Ctrl-C
  rc pub LaserPub @scan.json --rate 20 -n 100                ... a hundred times

The messages appear as those of the instance in the name of the topic.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Publish a message to a topic, once it has a subscriber."
    to.epilog = _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    completed(to.add_argument("topic", metavar="NAME", help=TOPIC), What.TOPIC)
    add_request(to)
    to.add_argument("--rate", type=positive, metavar="HZ", help="publish so often a second, until Ctrl-C or -n")
    to.add_argument("-n", dest="most", type=count, metavar="COUNT", help="how many messages (default: one)")
    add_yes(to)
    add_waiting(to)
    add_middleware(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc pub") as code:

        def pick(network: Network) -> tuple[Network, Channel]:
            return network, network.topic(options.topic)

        return _publish(*awaited(options, pick), options)
    return code()


def _publish(network: Network, channel: Channel, options: argparse.Namespace) -> int:
    from ..tools import asking
    from ..tools.access import Access
    from ..transports.base import wait_connected

    with Access() as access:
        told = asking.about(access, network, channel)
        taken = request_of(channel, options.arguments, "rc pub", told)
        if taken is None:
            return USAGE
        if refused := allowed(channel, told, "rc pub", yes=options.yes):
            return refused
        outlet, call = access.outlet(channel)
        if not outlet.wait_peer(options.timeout):
            raise Absent(f"nothing subscribes to {channel.name}")
        if not wait_connected(outlet, options.timeout):
            raise Absent(f"the subscribers of {channel.name} could not be reached in {options.timeout:g} s")
        most = options.most or (None if options.rate else 1)
        begun, sent = time.monotonic(), 0
        while True:
            outlet.send(call.encode(taken))
            sent += 1
            if sent == most:
                return FINE
            time.sleep(max(0.0, begun + sent / (options.rate or 1.0) - time.monotonic()))
