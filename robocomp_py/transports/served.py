"""Who is commanded and who is called, of transports whose ends find each other in the directory."""

from __future__ import annotations

import contextlib
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial

from ..errors import AlreadyServed
from ..wire.codec import Payload
from ..wire.header import Flag, Request
from .announced import AnnouncedLink, Announcing
from .base import Channel, Reply, Service, Sink, Status, TypeRef
from .crew import Job, Lane, Servant
from .exclusive import Claim, claim
from .ledger import Ledger
from .replies import Replies

log = logging.getLogger("robocomp.transport")

COMMANDS_WAITING = 1000
"""Commands that may wait at one server; more are dropped."""


class ServingLink(AnnouncedLink[Announcing], ABC):
    ordered: bool
    address = ""
    """Where its requests come in; "" until they do."""
    _claim: Claim | None = None

    def __init__(self, transport: Announcing, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.ledger = Ledger(self.stats, ordered=self.ordered)

    def open(self) -> None:
        self._have_alone()
        self.address = self.transport.enlist(self)
        self.announce(self.address)

    def _have_alone(self) -> None:
        directory = self.transport.directory
        for member, entry in directory.find(self.role, self.channel.name):
            other = entry.channel != self.channel.name  # one that has `*` in its name, or ours has
            # One of the same name has a claim, which tells of it sooner, or another one that stands for it.
            if directory.alive(member.id) if other else directory.still_has(member.id, entry):
                raise AlreadyServed(f"{self.channel.name}: already served by {member.owner} (pid {member.pid})")
        if self.channel.claims:
            self._claim = claim(self.transport.served, self.channel.name, self.transport.owner)

    @abstractmethod
    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        """Take a request; what is left to do about it."""

    def take(self, request: Request, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        """Take a request that means what we mean, unless it was taken before; what is left to do about it."""
        if not self.ledger.admit(request.client, request.sequence):
            return None
        return self.accept(payload, expires, answer)

    def refuse_stranger(self, request: Request) -> None:
        texts = [
            e.text
            for _, e in self.transport.directory.find(self.facing, self.channel.name)
            if e.fingerprint == request.fingerprint
        ]
        self.report_mismatch(request.fingerprint, TypeRef("", request.fingerprint, next(iter(texts), "")))

    def release(self) -> None:
        with contextlib.ExitStack() as everything:
            if self._claim:
                everything.callback(self._claim.close)
            everything.callback(self.finish)
            everything.callback(self.transport.delist, self)

    @abstractmethod
    def finish(self) -> None:
        """Let nothing begin any more, and wait for what runs."""


class CommandInlet(ServingLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: Announcing, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._sink = sink
        self._lane = Lane(channel.name, self._execute, COMMANDS_WAITING, lossy=False, stats=self.stats)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        if self._lane.put((expires, payload)):
            return self._lane.drain
        self.stats.dropped += 1
        if self.stats.dropped == 1:
            log.warning("%s: %d commands wait; dropping more", self.channel.name, COMMANDS_WAITING)
        return None

    def finish(self) -> None:
        self._lane.close()

    def _execute(self, waiting: tuple[float, Payload]) -> None:
        expires, payload = waiting
        if time.monotonic() >= expires:
            self.stats.expired += 1
        else:
            self._sink(payload)


class Server(ServingLink):
    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: Announcing, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._servant = Servant(channel.name, service, self.stats)
        self._replies = Replies()

    def take(self, request: Request, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        new = self.ledger.admit(request.client, request.sequence)
        if not (request.flags & Flag.IDEMPOTENT and self.channel.idempotent):
            return self.accept(payload, expires, answer) if new else None
        asked = request.client, request.sequence
        known = None if new else self._replies.again(asked, answer)
        return known or self.accept(payload, expires, self._replies.begun(asked, answer))

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> Job | None:
        return partial(self._serve, payload, expires, answer)

    def finish(self) -> None:
        self._servant.close()

    def _serve(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> None:
        if not self._servant.serve(payload, expires, answer):
            answer(Reply(Status.REFUSED))
