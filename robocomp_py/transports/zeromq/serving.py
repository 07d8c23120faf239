"""Who is commanded and who is called, behind one socket."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zmq

from ...errors import (
    AlreadyServed,
    DecodeError,
    TransportError,
)
from ...wire.codec import Payload
from ...wire.header import (
    NO_DEADLINE,
    Flag,
    Request,
    pack_reply,
    read_request,
)
from ..base import (
    Channel,
    Reply,
    Service,
    Sink,
    Status,
    TypeRef,
)
from ..crew import Job, Lane, Servant
from ..exclusive import Claim, claim
from ..ledger import Ledger
from .link import Link
from .sockets import Frames, Socket, as_transport_error

if TYPE_CHECKING:
    from .transport import ZeroMQTransport

log = logging.getLogger("robocomp.transport.zeromq")

COMMANDS_WAITING = 1000


class Router:
    """The socket behind which everything is served that this transport serves."""

    def __init__(self, transport: ZeroMQTransport, bind: str) -> None:
        self._transport = transport
        self._routes: dict[bytes, ServingLink] = {}
        self.socket = transport.socket(zmq.ROUTER, self._on_request, ROUTER_MANDATORY=1, ROUTER_HANDOVER=1)
        path = transport.member.address("router")
        self.address = f"ipc://{path}"
        try:
            for address in filter(None, (self.address, bind)):
                with as_transport_error(f"binding {address}"), self.socket.lock:
                    self.socket.raw.bind(address)
        except TransportError:
            transport.forget(self.socket)
            raise

    def add(self, link: ServingLink) -> None:
        self._routes[link.channel.name.encode()] = link

    def remove(self, link: ServingLink) -> None:
        name = link.channel.name.encode()
        if self._routes.get(name) is link:
            del self._routes[name]

    def reply(self, identity: bytes, request: Request, status: Status, payload: Payload = ()) -> None:
        header = pack_reply(status, request.client, request.sequence, self._transport.incarnation)
        try:
            sent = self.socket.send([identity, header, *(payload or ())])
        except zmq.ZMQError:
            return  # who asked has gone
        if not sent:
            log.warning("a reply was dropped: who asked does not take it")

    def _on_request(self, socket: Socket) -> list[Job]:
        frames = socket.receive()
        if frames is None:
            return []
        job = self._accept(frames)  # whether there is more is found out after this one was answered
        return [job] if job else []

    def _accept(self, frames: Frames) -> Job | None:
        identity, channel, head, *payload = [*frames, b"", b""] if len(frames) < 3 else frames
        link = self._routes.get(channel)
        try:
            request = read_request(head)
        except DecodeError as exc:
            self._malformed(link, exc)
            return None
        if link is None:
            if not request.flags & Flag.ONEWAY:
                self.reply(identity, request, Status.REFUSED)
            return None
        if request.fingerprint != link.channel.type.fingerprint:
            link.refuse_stranger(request)
            self.reply(identity, request, Status.MISMATCH, [link.channel.type.text.encode()])
            return None
        if not link.ledger.admit(request.client, request.sequence):
            return None
        remaining = float("inf") if request.remaining_ms == NO_DEADLINE else request.remaining_ms / 1000
        return link.accept(payload, time.monotonic() + remaining, partial(self._answer, identity, request))

    def _answer(self, identity: bytes, request: Request, reply: Reply) -> None:
        self.reply(identity, request, reply.status, reply.payload)

    def _malformed(self, link: ServingLink | None, why: DecodeError) -> None:
        if link:
            link.malformed(why)
        else:
            log.warning("dropped a malformed request: %s", why)


class ServingLink(Link):
    ordered: bool
    _router: Router | None = None
    _claim: Claim | None = None

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.ledger = Ledger(self.stats, ordered=self.ordered)

    def open(self) -> None:
        for member, entry in self.transport.directory.find(self.role, self.channel.name):
            other = entry.channel != self.channel.name  # one that has `*` in its name, or ours has
            if other and self.transport.directory.alive(member.id):
                raise AlreadyServed(f"{self.channel.name}: already served by {member.owner} (pid {member.pid})")
        self._claim = claim(self.transport.folder / "served", self.channel.name, self.transport.owner)
        self._router = self.transport.router()
        self._router.add(self)
        self.announce(self._router.address)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        """Take a request; what is left to do about it."""
        raise NotImplementedError

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
            if self._router:
                everything.callback(self._router.remove, self)

    def finish(self) -> None:
        """Let nothing begin any more, and wait for what runs."""
        raise NotImplementedError


class CommandInlet(ServingLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: ZeroMQTransport, channel: Channel, sink: Sink) -> None:
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

    def __init__(self, transport: ZeroMQTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._servant = Servant(channel.name, service, self.stats)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        return partial(self._serve, payload, expires, answer)

    def finish(self) -> None:
        self._servant.close()

    def _serve(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> None:
        if not self._servant.serve(payload, expires, answer):
            answer(Reply(Status.REFUSED))
