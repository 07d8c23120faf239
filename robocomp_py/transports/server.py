"""Servers and command inlets of transports whose links find each other in the directory."""

from __future__ import annotations

import contextlib
import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial

from ..errors import AlreadyServed
from ..wire.codec import Payload
from ..wire.header import NO_DEADLINE, Flag, Request
from .base import Channel, Reply, Service, Sink, Status
from .client import client_mark
from .directory_transport import DirectoryLink, DirectoryTransport
from .exclusive import Claim, claim
from .leader_followers import CommandLane, Job, Servant
from .ledger import Ledger
from .replies import Replies
from .senders import From

log = logging.getLogger("robocomp.transport")


class ServingTransport(DirectoryTransport):
    """A transport that delivers requests to links that serve."""

    @abstractmethod
    def enlist(self, link: ServingLink) -> str:
        """Start to deliver requests to a link; returns the address for them."""

    @abstractmethod
    def delist(self, link: ServingLink) -> None:
        """Stop to deliver requests to it."""


class ServingLink(DirectoryLink[ServingTransport], ABC):
    ordered: bool
    address = ""
    """The address for its requests; "" until it is open."""
    _claim: Claim | None = None

    def __init__(self, transport: ServingTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.ledger = Ledger(self.stats, ordered=self.ordered)

    def open(self) -> None:
        self._claim_channel()
        self.address = self.transport.enlist(self)
        self.announce(self.address)

    def _claim_channel(self) -> None:
        directory = self.transport.directory
        for member, entry in directory.find(self.role, self.channel.name):
            other = entry.channel != self.channel.name  # one of the two has `*` for its instance
            # A claim protects a server with the same name, so its entry counts only if it is still there now.
            if directory.alive(member.id) if other else directory.still_has(member.id, entry):
                raise AlreadyServed.by(self.channel.name, f"{member.owner} (pid {member.pid})")
        if self.channel.exclusive:
            self._claim = claim(self.transport.served, self.channel.name, self.transport.owner)

    @abstractmethod
    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> Job | None:
        """Take a request; returns the job that remains."""

    def take(self, request: Request, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> Job | None:
        """Take a request with the right contract, unless it was taken before; returns the job that remains."""
        if not self.ledger.admit(request.client, request.sequence):
            return None
        return self.accept(self.signed(request, payload), expires, answer)

    def signed(self, request: Request, payload: Payload) -> Payload:
        """The payload of a request, with its sender if the channel wants that."""
        return From(partial(self._owner_of, request.client), payload) if self.channel.signed else payload

    def _owner_of(self, client: int) -> str:
        """The instance that opened a client; "" if the directory does not have it, as for those on other hosts."""
        mark = client_mark(client)
        found = self.transport.directory.find(self.facing, self.channel.name)
        return next((member.owner for member, entry in found if entry.traits.endswith(mark)), "")

    def release(self) -> None:
        with contextlib.ExitStack() as everything:
            if self._claim:
                everything.callback(self._claim.close)
            everything.callback(self.finish)
            everything.callback(self.transport.delist, self)

    @abstractmethod
    def finish(self) -> None:
        """Start no more handlers, and wait for the running ones."""


def dispatch(
    link: ServingLink | None, request: Request, payload: Payload, arrived: float, answer: Callable[[Reply], object]
) -> Job | None:
    """Give a request to its link, or refuse it if there is none; returns the job that remains."""
    if link is None:
        return None if request.flags & Flag.ONEWAY else partial(answer, Reply(Status.REFUSED))
    if request.fingerprint != link.channel.type.fingerprint:
        link.meet_stranger(request.client, request.fingerprint)
        return partial(answer, Reply(Status.MISMATCH, link.channel.type.text.encode()))
    limited = request.remaining_ms != NO_DEADLINE
    return link.take(request, payload, arrived + request.remaining_ms / 1000 if limited else math.inf, answer)


class CommandInlet(ServingLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: ServingTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._lane = CommandLane(channel.name, sink, self.stats)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> Job | None:
        return self._lane.drain if self._lane.take(payload, expires) else None

    def finish(self) -> None:
        self._lane.close()


class Server(ServingLink):
    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: ServingTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._servant = Servant(channel.name, service, self.stats)
        self._replies = Replies()

    def take(self, request: Request, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> Job | None:
        new, payload = self.ledger.admit(request.client, request.sequence), self.signed(request, payload)
        if not (request.flags & Flag.IDEMPOTENT and self.channel.idempotent):
            return self.accept(payload, expires, answer) if new else None
        asked = request.client, request.sequence
        known = None if new else self._replies.repeat(asked, answer)
        return known or self.accept(payload, expires, self._replies.begin(asked, answer))

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> Job | None:
        return partial(self._serve, payload, expires, answer)

    def finish(self) -> None:
        self._servant.close()

    def _serve(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> None:
        if not self._servant.serve(payload, expires, answer):
            answer(Reply(Status.REFUSED))
