"""The ZeroMQ transport, with the classes of its links."""

from __future__ import annotations

from ..link import Ends
from ..server import CommandInlet, Server
from .client import Caller, CommandOutlet
from .core import ZeroMQCore
from .topics import Publisher, Subscriber


class ZeroMQTransport(ZeroMQCore):
    """Options:

    `bind`      TCP address at which other hosts also reach this transport, `tcp://127.0.0.1:5555`; topics get further
                ports of the same host.
    `connect`   table of the addresses of other transports that are used here, by names for them.
    `keys`, `curve_key`, `curve_admitted`, `curve_peers`: see `curve`; only for these addresses.
    """

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
