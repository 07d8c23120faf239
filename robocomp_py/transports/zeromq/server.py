"""Who is commanded and who is called, behind one socket."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import zmq

from ...errors import (
    DecodeError,
    TransportError,
)
from ...wire.header import (
    Flag,
    Request,
    pack_reply,
)
from ..base import (
    Reply,
    Status,
)
from ..leader_followers import Job, LeaderFollowers
from ..server import ServingLink, dispatch
from ..sparing import Sparing
from .bounds import Kind
from .curve import WATCHED, Gate, Secure
from .frames import Frames, joined, read_request_frames, topic, topic_of
from .remote import DIRECTORY, SILENT, at_far
from .sockets import as_transport_error, lend_frames, new_socket, receive_frames, receive_watched

if TYPE_CHECKING:
    from .guard import Guard
    from .transport import ZeroMQTransport

log = logging.getLogger("robocomp.transport.zeromq")

REPLIES_WAITING = 10_000
"""So many replies may wait to be sent by the thread that receives."""

_LOOK_MS = 4000
"""Who waits for requests looks this often whether it is to stop, though it is told."""

_FORBIDDEN_TOLD, _ACQUAINTED = 100, 1000

_NOBLOCK = int(zmq.NOBLOCK)


class Router:
    """The socket behind which everything is served that this transport serves, and the threads that take turns at it.

    One of them waits inside the socket, so that nothing lies between a request and its handler; that handler's reply is
    sent on the same thread, when nobody is inside. Replies that come later, from other threads, are left to whoever
    waits there, who is called out by a bell: an empty message from within this process.
    """

    def __init__(
        self,
        transport: ZeroMQTransport,
        addresses: Sequence[str],
        secure: Secure | None = None,
        introduce: Callable[[bytes, str], bytes] | None = None,
        gate: Gate | None = None,
        guard: Guard | None = None,
    ) -> None:
        """`introduce` answers clients that introduce themselves; `gate` knows what each may use. `guard` watches the
        connections of other hosts."""
        self._transport, self._introduce, self._gate, self._guard = transport, introduce, gate, guard
        self._routes: dict[bytes, ServingLink] = {}
        self._inside = threading.Lock()
        """Held by whoever uses the socket, also while it waits there."""
        self._ringing = threading.Lock()
        self._telling = threading.Lock()
        """Held while somebody is told who we are: so that nobody is told later what was so before."""
        self._late: deque[Frames] = deque()
        self._closed = False
        self._sparing = Sparing()
        self._told = False
        """Whether it was said that there are malformed requests."""
        self._acquainted: dict[bytes, tuple[Request, str, float]] = {}
        """Who told us who they are, by what question, and when."""
        self._forbidden: set[str] = set()
        """Those of whom it was said that they wanted what they have no right to."""
        self.address = addresses[0]
        bell = f"inproc://bell of {self.address}"
        with contextlib.ExitStack() as undo:
            options = {"ROUTER_MANDATORY": 1, "RCVTIMEO": _LOOK_MS} | (at_far(addresses[0]) if introduce else {})
            self._socket = new_socket(transport.context, zmq.ROUTER, secure, **options)
            undo.callback(self._socket.close)
            self._watched = None
            if guard:
                self._watched = guard.watch(
                    self._socket, Kind.MESSAGES, told=transport.tell, also=WATCHED if gate else 0
                )
                undo.callback(guard.forget, self._watched)
            for address in (*addresses, bell):
                with as_transport_error(f"binding {address}"):
                    self._socket.bind(address)
            self._bell = new_socket(transport.context, zmq.DEALER, LINGER=0)
            undo.callback(self._bell.close)
            with as_transport_error("opening a socket"):
                self._bell.connect(bell)
            undo.pop_all()
        self._threads = LeaderFollowers("zeromq-serving", self._receive, self._ring)
        try:
            self._threads.start()
        except TransportError:
            self.close()
            raise

    def add(self, link: ServingLink) -> None:
        self._routes[topic(link.channel.name)] = link

    def remove(self, link: ServingLink) -> None:
        named = topic(link.channel.name)
        if self._routes.get(named) is link:
            del self._routes[named]

    def close(self) -> None:
        """Stop, and wait for the threads. Replies that come later are forgotten."""
        self._threads.close()
        with self._inside, self._ringing:
            self._send_late()  # what came after the last thread had looked
            self._closed = True
            if self._guard and self._watched:
                self._guard.forget(self._watched)
            self._socket.close()
            self._bell.close()

    def reply(self, identity: bytes, request: Request, reply: Reply) -> None:
        header = pack_reply(reply.status, request.client, request.sequence, self._transport.incarnation)
        payload = reply.payload if isinstance(reply.payload, list) else [reply.payload] if reply.payload else []
        frames = [identity, *joined(header, payload)]
        if self._inside.acquire(blocking=False):
            try:
                self._send_late()
                self._send(frames)
            finally:
                self._inside.release()
        elif len(self._late) < REPLIES_WAITING:
            self._late.append(frames)
            self._ring()
        elif self._sparing.may_tell():
            log.warning("a reply was dropped: %d wait to be sent", REPLIES_WAITING)

    def tell(self, news: Callable[[str], bytes]) -> None:
        """What those who ask who we are would be answered now, without waiting for their next question."""
        now = time.monotonic()
        for identity, (request, user, when) in list(self._acquainted.items()):
            if now - when > SILENT:
                self._acquainted.pop(identity, None)
            else:
                with self._telling:
                    self.reply(identity, request, Reply(Status.OK, [news(user)]))

    # By whoever is inside.

    def _send_late(self) -> None:
        while self._late:
            self._send(self._late.popleft())

    def _send(self, frames: Frames) -> None:
        if self._closed:
            return
        try:
            lend_frames(self._socket, frames, _NOBLOCK)  # replies are snapshots
        except zmq.Again:
            if self._sparing.may_tell():
                log.warning("a reply was dropped: who asked does not take it")
        except zmq.ZMQError:
            return  # who asked has gone

    def _ring(self) -> None:
        """Call out whoever waits inside."""
        with self._ringing:
            if not self._closed:
                with contextlib.suppress(zmq.Again):  # so many calls wait there that this one is not needed
                    self._bell.send(b"", _NOBLOCK)

    def _receive(self) -> list[Job]:
        with self._inside:
            self._send_late()
            user = ""
            try:
                if self._watched:
                    user, frames = receive_watched(self._socket, self._watched, self._gate is not None)
                else:
                    frames = receive_frames(self._socket)
            except zmq.Again:
                return []
        identity, *message = frames
        if not message or not message[0]:
            return []  # the bell
        job = self._accept(identity, message, user)  # whether there is more is found out after this one was answered
        return [job] if job else []

    def _accept(self, identity: bytes, frames: Frames, user: str) -> Job | None:
        try:
            named, request, payload = read_request_frames(frames)
            if named == DIRECTORY and self._introduce:
                self._note(identity, request, user)
                with self._telling:
                    told = self._introduce(bytes(payload[0]) if payload else b"", user)
                    self.reply(identity, request, Reply(Status.OK, [told]))
                return None
        except DecodeError as exc:
            self._malformed(frames, exc)
            return None
        if self._gate and not self._gate.rights(user).allow(named[:-1].decode(errors="replace")):
            self._forbid(named, user)
            if not request.flags & Flag.ONEWAY:
                self.reply(identity, request, Reply(Status.REFUSED))
            return None
        answer = partial(self.reply, identity, request)
        return dispatch(self._routes.get(named), request, payload, time.monotonic(), answer)

    def _note(self, identity: bytes, request: Request, user: str) -> None:
        """That somebody wants to know who we are."""
        now = time.monotonic()
        if len(self._acquainted) >= _ACQUAINTED:
            self._acquainted = {who: known for who, known in self._acquainted.items() if now - known[2] <= SILENT}
        if len(self._acquainted) < _ACQUAINTED:
            self._acquainted[identity] = request, user, now

    def _forbid(self, named: bytes, user: str) -> None:
        if user not in self._forbidden and len(self._forbidden) < _FORBIDDEN_TOLD:
            self._forbidden.add(user)
            channel = named[:-1].decode(errors="replace")
            log.warning(
                "refused %r to who has the key %s: it has no right to it (told once for each key)", channel, user
            )

    def _malformed(self, frames: Frames, why: DecodeError) -> None:
        link = self._routes.get(topic_of(frames[0]))
        if link:
            link.malformed(why)
        elif not self._told:
            self._told = True
            log.warning("dropped a malformed request (further ones are dropped silently): %s", why)
