"""The one socket for all served channels of a transport."""

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
    from .reactor import Reactor

log = logging.getLogger("robocomp.transport.zeromq")

REPLIES_WAITING = 10_000
"""Maximum number of replies that wait until the receiving thread sends them."""

_LOOK_MS = 4000
"""Milliseconds after which a waiting thread checks whether it has to stop, in case a wake-up is lost."""

_FORBIDDEN_TOLD, _ACQUAINTED = 100, 1000

_NOBLOCK = int(zmq.NOBLOCK)


class Router:
    """The socket for all requests to this transport, and the threads that take turns to receive from it.

    One thread waits in the socket, and runs the handler of the request that it receives. It sends the reply itself if
    no other thread uses the socket then. Replies from other threads are left to the thread that waits in the socket.
    An empty message from within this process wakes it up.
    """

    def __init__(
        self,
        reactor: Reactor,
        incarnation: int,
        addresses: Sequence[str],
        refused: Callable[[list[bytes]], object],
        secure: Secure | None = None,
        introduce: Callable[[bytes, str], bytes] | None = None,
        gate: Gate | None = None,
    ) -> None:
        """`introduce` answers requests of other hosts for the directory. `gate` knows the rights of each client, and
        `refused` gets the events of connections that were not let in."""
        self._incarnation, self._introduce, self._gate = incarnation, introduce, gate
        self._guard = guard = reactor.guard if introduce else None
        self._routes: dict[bytes, ServingLink] = {}
        self._inside = threading.Lock()
        """Held by the thread that uses the socket, also while it waits there."""
        self._ringing = threading.Lock()
        self._telling = threading.Lock()
        """Held while a directory record is sent, so that no client gets an older record after a newer one."""
        self._late: deque[Frames] = deque()
        self._closed = False
        self._sparing = Sparing()
        self._told = False
        """Whether a malformed request was logged."""
        self._acquainted: dict[bytes, tuple[Request, str, float]] = {}
        """By identity: the last request for the directory, its user, and when it came."""
        self._forbidden: set[str] = set()
        """Users whose refused request was logged."""
        self.address = addresses[0]
        wakeup = f"inproc://wake-up of {self.address}"
        with contextlib.ExitStack() as undo:
            options = {"ROUTER_MANDATORY": 1, "RCVTIMEO": _LOOK_MS} | (at_far(addresses[0]) if introduce else {})
            self._socket = new_socket(reactor.context, zmq.ROUTER, secure, **options)
            undo.callback(self._socket.close)
            self._watched = None
            if guard:
                self._watched = guard.watch(self._socket, Kind.MESSAGES, told=refused, also=WATCHED if gate else 0)
                undo.callback(guard.forget, self._watched)
            for address in (*addresses, wakeup):
                with as_transport_error(f"binding {address}"):
                    self._socket.bind(address)
            self._waker = new_socket(reactor.context, zmq.DEALER, LINGER=0)
            undo.callback(self._waker.close)
            with as_transport_error("opening a socket"):
                self._waker.connect(wakeup)
            undo.pop_all()
        self._threads = LeaderFollowers("zeromq-serving", self._receive, self._ring)
        self._threads.start(self.close)

    def add(self, link: ServingLink) -> None:
        self._routes[topic(link.channel.name)] = link

    def remove(self, link: ServingLink) -> None:
        named = topic(link.channel.name)
        if self._routes.get(named) is link:
            del self._routes[named]

    def close(self) -> None:
        """Stop, and wait for the threads. Later replies are discarded."""
        self._threads.close()
        with self._inside, self._ringing:
            self._send_late()  # replies that came after the last look
            self._closed = True
            if self._guard and self._watched:
                self._guard.forget(self._watched)
            self._socket.close()
            self._waker.close()

    def reply(self, identity: bytes, request: Request, reply: Reply) -> None:
        header = pack_reply(reply.status, request.client, request.sequence, self._incarnation)
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
        """Send the current directory record to all clients that asked for it lately."""
        now = time.monotonic()
        for identity, (request, user, when) in list(self._acquainted.items()):
            if now - when > SILENT:
                self._acquainted.pop(identity, None)
            else:
                with self._telling:
                    self.reply(identity, request, Reply(Status.OK, [news(user)]))

    # On the thread that holds `_inside`.

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
                log.warning("a reply was dropped: the client does not receive")
        except zmq.ZMQError:
            return  # the client has gone

    def _ring(self) -> None:
        """Wake the thread that waits in the socket."""
        with self._ringing:
            if not self._closed:
                with contextlib.suppress(zmq.Again):  # enough wake-ups wait there already
                    self._waker.send(b"", _NOBLOCK)

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
            return []  # a wake-up
        job = self._accept(identity, message, user)  # further requests are received after this one was handled
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
        """Remember a client that requests the directory record."""
        now = time.monotonic()
        if len(self._acquainted) >= _ACQUAINTED:
            recent = {each: known for each, known in self._acquainted.items() if now - known[2] <= SILENT}
            self._acquainted = recent
        if len(self._acquainted) < _ACQUAINTED:
            self._acquainted[identity] = request, user, now

    def _forbid(self, named: bytes, user: str) -> None:
        if user not in self._forbidden and len(self._forbidden) < _FORBIDDEN_TOLD:
            self._forbidden.add(user)
            channel = named[:-1].decode(errors="replace")
            log.warning(
                "refused %r to the user of key %s: it has no right to it (logged once for each key)", channel, user
            )

    def _malformed(self, frames: Frames, why: DecodeError) -> None:
        link = self._routes.get(topic_of(frames[0]))
        if link:
            link.malformed(why)
        elif not self._told:
            self._told = True
            log.warning("dropped a malformed request (further ones are dropped silently): %s", why)
