"""The transport through shared memory, with the classes of its links."""

from __future__ import annotations

from ..link import Ends
from ..server import CommandInlet, Server
from .client import Caller, CommandOutlet
from .core import ShmCore
from .topics import Publisher, Subscriber


class ShmTransport(ShmCore):
    """Takes no options."""

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
