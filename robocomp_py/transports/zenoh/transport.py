"""The Zenoh transport, with the classes of its links."""

from __future__ import annotations

from ..link import Ends
from .client import Caller, CommandOutlet
from .core import ZenohCore
from .server import CommandInlet, Server
from .topics import Publisher, Subscriber


class ZenohTransport(ZenohCore):
    """Options:

    `connect`   the endpoint of a router, as Zenoh writes it: `tcp/192.168.1.5:7447`. The default is the
                shared router of the run-time folder, which reaches only this host.
                `here/NAME` is a router that runs under that name in the run-time folder.
    `domain`    an integer >= 0. Components of different domains share the router, but do not meet.
    `keys`      the folder with our certificate, for a router that requires one
                (`tls/192.168.1.5:7447`): `rcdeploy keys` makes it.
    `router`    further settings, in Zenoh's format, of the router `here/NAME` (see `host`)

    A router that hangs is noticed, and logged, after 2 s (10 s for a dedicated one). Until then, calls
    keep their deadlines. But sending a message larger than the queue to the router (about 1 MB) may
    take until the router is given up, and at most 5 s; if it is best-effort, it is dropped after 1 s.
    """

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
