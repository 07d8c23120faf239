"""Who is commanded and who is called: the operations of one object."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ...wire import names
from ...wire.codec import Payload
from ...wire.header import NO_DEADLINE, Request
from ..base import Reply, Status
from ..leader_followers import Job
from ..server import CommandInlet as _CommandInlet
from ..server import Server as _Server
from ..server import ServingLink
from ..turns import Turns
from .messages import NOTHING, OBJECT, header
from .objects import OCTETS_WAITING, REQUESTS_WAITING, Arrived, Port

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


class Requests:
    """Begins the requests of all servers of a transport one after the other, the clients by turns.

    Between two of them what has come in is read. What was read waits here, within the same bounds as what was not:
    else no bound would hold while handlers are slow.
    """

    def __init__(self, do: Callable[[Job], object]) -> None:
        """`do` has a job run by the crew."""
        self._do = do
        self._waiting: Turns[tuple[Job, int]] = Turns(itemgetter(1))
        """With the size of each request."""
        self._beginning = False
        """Whether a thread will call `_begin`."""

    @property
    def is_full(self) -> bool:
        return len(self._waiting) >= REQUESTS_WAITING or self._waiting.octets >= OCTETS_WAITING

    def add(self, client: int, job: Job, octets: int) -> Job:
        """Have a request begun when it is its turn. What is returned has to be run."""
        self._waiting.add(client, (job, octets))
        if self._beginning:
            return _nothing
        self._beginning = True
        return self._begin

    def _begin(self) -> None:
        try:
            job, _ = self._waiting.take()
        except IndexError:  # another thread was quicker
            return
        finally:
            self._beginning = False  # before looking for more: a thread that adds some later sees this
            if self._waiting and not self._beginning:
                self._beginning = True
                self._do(self._begin)
        job()


def _nothing() -> None: ...


class Server(_Held, _Server):
    def take(self, request: Request, payload: Payload, expires: float, answer: Any) -> Job | None:
        requests = self.transport.requests
        if requests.is_full:
            self.stats.dropped += 1
            answer(Reply(Status.BUSY))
            return _nothing
        job = super().take(request, payload, expires, answer)
        return job and requests.add(request.client, job, len(payload))


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
