"""Who is commanded and who is called: the operations of one object."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from ...wire import names
from ...wire.codec import Payload
from ...wire.header import NO_DEADLINE
from ..base import Reply, Status
from ..crew import Job
from ..served import CommandInlet as _CommandInlet
from ..served import Server as _Server
from ..served import ServingLink
from .messages import NOTHING, OBJECT, header
from .objects import Arrived, Port

if TYPE_CHECKING:
    from .transport import IceTransport


class _Held(ServingLink):
    """Part of an object until nothing of it runs any more."""

    transport: IceTransport

    def release(self) -> None:
        try:
            super().release()
        finally:
            self.transport.let_go(self)


class Server(_Held, _Server):
    pass


class CommandInlet(_Held, _CommandInlet):
    def accept(self, payload: Payload, expires: float, answer: Any) -> Job | None:
        """Also those of programs that wait for an answer: they get it when the command has its place in the queue."""
        job = super().accept(payload, expires, answer)
        answer(Reply(Status.OK, NOTHING) if job else Reply(Status.BUSY))
        return job


class Offer:
    """What is served as one object: its operations, which come and go one by one."""

    def __init__(self) -> None:
        self.port: Port | None = None
        self.held: set[ServingLink] = set()
        """Links that were not let go of yet; some are not served any more."""
        self._links: dict[str, ServingLink] = {}
        self._left: set[str] = set()
        """Operations that are not served any more."""
        self._asked: dict[tuple[int, int], Arrived] = {}
        """By client and number, what was not answered yet."""

    def add(self, link: ServingLink) -> None:
        self.held.add(link)
        operation = names.operation(link.channel.name)
        self._links[operation] = link
        self._left.discard(operation)

    def remove(self, link: ServingLink) -> None:
        operation = names.operation(link.channel.name)
        if self._links.get(operation) is link:
            self._left.add(operation)  # first: who finds no link looks there
            del self._links[operation]

    def ids(self) -> Iterable[str]:
        """The interfaces that it has, as Ice names them."""
        return {interface_id(link.channel.type.text) for link in list(self._links.values())}

    def take(self, arrived: Arrived) -> Iterable[Job]:
        link = self._links.get(arrived.operation)
        if link is None:
            if arrived.operation in self._left:
                arrived.leave()
            else:
                arrived.not_served()
            return ()
        job = self._accept(link, arrived)
        return (job,) if job else ()

    def _accept(self, link: ServingLink, arrived: Arrived) -> Job | None:
        request = header(arrived.context)
        if request is None:
            return link.accept(arrived.payload, math.inf, arrived.reply)
        if request.fingerprint != link.channel.type.fingerprint:
            link.refuse_stranger(request)
            arrived.reply(Reply(Status.MISMATCH, link.channel.type.text.encode()))
            return None
        remaining = math.inf if request.remaining_ms == NO_DEADLINE else request.remaining_ms / 1000
        asked = request.client, request.sequence
        if not arrived.oneway:
            before = self._asked.pop(asked, None)
            self._asked[asked] = arrived
            if before:
                before.leave()  # nobody waits for that answer any more: this one has been asked instead
        answer = partial(self._answer, asked, arrived)
        job = link.take(request, arrived.payload, time.monotonic() + remaining, answer)
        if job is None:  # it was seen before
            self._asked.pop(asked, None)
            arrived.leave()
        return job

    def _answer(self, asked: tuple[int, int], arrived: Arrived, reply: Reply) -> None:
        if self._asked.get(asked) is arrived:
            self._asked.pop(asked, None)
        arrived.reply(reply)


def interface_id(text: str) -> str:
    """The Slice type of the interface whose operation a contract's text is about."""
    first, _, _ = text.partition("\n")
    kind, _, name = first.partition(" ")
    interface, dot, _ = name.rpartition(".")
    return f"::{interface}" if kind == "operation" and dot else OBJECT
