"""The Ice transport, with the classes of its links."""

from __future__ import annotations

from ..link import Ends
from .client import Caller, CommandOutlet
from .core import IceCore
from .server import CommandInlet, Server
from .topics import Publisher, Subscriber


class IceTransport(IceCore):
    """Options: see `iceoptions`. Messages larger than `message_size_max` are neither sent nor accepted."""

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
