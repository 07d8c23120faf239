"""The DDS transport, with the classes of its links."""

from __future__ import annotations

from ..link import Ends
from .client import Caller, CommandOutlet
from .core import DDSCore
from .server import CommandInlet, Server
from .topics import Publisher, Subscriber


class DDSTransport(DDSCore):
    """Options:

    `domain`      an integer; the default is the user's own domain on this host only, otherwise 0
    `interface`   name or IPv4 address of a network interface: "lo" is this host only; "" lets Cyclone DDS choose
    `peers`       addresses of all hosts, this one included; without it, hosts are discovered by multicast
    `many`        whether more than a few dozen processes use the domain; `rcdeploy` sets it

    and those of `limits.Limits`.
    """

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
