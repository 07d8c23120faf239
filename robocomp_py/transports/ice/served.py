"""The served objects, and the queue of their requests."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from functools import partial
from operator import itemgetter

from ...wire.header import NO_DEADLINE
from .. import iceoptions
from ..base import Reply, Status
from ..leader_followers import Job
from ..server import ServingLink
from ..turns import Turns
from .messages import OBJECT, header
from .objects import OCTETS_WAITING, REQUESTS_WAITING, Invocation, Port


class RequestQueue:
    """Starts the requests of all servers of a transport, one at a time, the clients in turn.

    New input is read between two requests, and waits here. This queue has the same limits as unread input, so that
    the limits hold even if handlers are slow.
    """

    def __init__(self, do: Callable[[Job], object]) -> None:
        """`do` runs a job on one of the transport's threads."""
        self._do = do
        self._waiting: Turns[tuple[Job, int]] = Turns(itemgetter(1))
        """The waiting requests, each with its size."""
        self._beginning = False
        """Whether a job for `_begin` is queued."""

    @property
    def is_full(self) -> bool:
        return len(self._waiting) >= REQUESTS_WAITING or self._waiting.octets >= OCTETS_WAITING

    def add(self, client: int, job: Job, octets: int) -> Job:
        """Queue a request. The caller must run the returned job."""
        self._waiting.add(client, (job, octets))
        if self._beginning:
            return nothing
        self._beginning = True
        return self._begin

    def _begin(self) -> None:
        try:
            job, _ = self._waiting.take()
        except IndexError:  # another thread has taken it
            return
        finally:
            self._beginning = False  # before the check: a thread that adds one later sees this
            if self._waiting and not self._beginning:
                self._beginning = True
                self._do(self._begin)
        job()


def nothing() -> None: ...


class ServedObject:
    """The operations that are served as one object; they come and go one by one."""

    def __init__(self) -> None:
        self.port: Port | None = None
        self.held: set[ServingLink] = set()
        """Links with running handlers; some are not served any more."""
        self._links: dict[str, ServingLink] = {}
        self._left: set[str] = set()
        """Operations that are not served any more."""
        self._asked: dict[tuple[int, int], Invocation] = {}
        """Unanswered invocations by client and number."""

    def add(self, link: ServingLink) -> None:
        self.held.add(link)
        operation = iceoptions.operation_of(link.channel.name)
        self._links[operation] = link
        self._left.discard(operation)

    def remove(self, link: ServingLink) -> None:
        operation = iceoptions.operation_of(link.channel.name)
        if self._links.get(operation) is link:
            self._left.add(operation)  # first: an invocation that finds no link checks this
            del self._links[operation]

    def ids(self) -> Iterable[str]:
        """The object's interfaces, as Ice names them."""
        return {interface_id(link.channel.type.text) for link in list(self._links.values())}

    def take(self, invocation: Invocation) -> Iterable[Job]:
        link = self._links.get(invocation.operation)
        if link is None:
            if invocation.operation in self._left:
                invocation.leave()
            else:
                invocation.not_served()
            return ()
        job = self._accept(link, invocation)
        return (job,) if job else ()

    def _accept(self, link: ServingLink, invocation: Invocation) -> Job | None:
        request = header(invocation.context)
        if request is None:
            return link.accept(invocation.payload, math.inf, invocation.reply)
        if request.fingerprint != link.channel.type.fingerprint:
            link.meet_stranger(request.client, request.fingerprint)
            invocation.reply(Reply(Status.MISMATCH, link.channel.type.text.encode()))
            return None
        remaining = math.inf if request.remaining_ms == NO_DEADLINE else request.remaining_ms / 1000
        asked = request.client, request.sequence
        if not invocation.oneway:
            before = self._asked.pop(asked, None)
            self._asked[asked] = invocation
            if before:
                before.leave()  # the retry replaces the earlier invocation
        answer = partial(self._answer, asked, invocation)
        job = link.take(request, invocation.payload, time.monotonic() + remaining, answer)
        if job is None:  # a repeated request
            self._asked.pop(asked, None)
            invocation.leave()
        return job

    def _answer(self, asked: tuple[int, int], invocation: Invocation, reply: Reply) -> None:
        if self._asked.get(asked) is invocation:
            self._asked.pop(asked, None)
        invocation.reply(reply)


def interface_id(text: str) -> str:
    """The Slice type of the interface to which a contract's operation belongs."""
    first, _, _ = text.partition("\n")
    kind, _, name = first.partition(" ")
    interface, dot, _ = name.rpartition(".")
    return f"::{interface}" if kind == "operation" and dot else OBJECT
