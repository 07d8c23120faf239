"""The transport: its links, its sockets, its thread."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import zmq

from ...contract.interface import Pattern
from ...errors import (
    Closed,
    ConfigurationError,
    TransportError,
)
from ...wire.codec import Codec
from ...wire.header import (
    random_id,
)
from ...wire.messagepack import MessagePack
from ..base import (
    ANY_QOS,
    Capability,
    Channel,
    Service,
    Sink,
    TransportConfig,
    options_of,
)
from ..crew import Crew, Job
from ..directory import Directory, Member, runtime_dir
from ..memory import keep_memory
from .asking import Caller, CommandOutlet, Peer
from .link import Link
from .serving import CommandInlet, Router, Server
from .sockets import Loop, Socket, new_socket
from .topics import Publisher, Subscriber

log = logging.getLogger("robocomp.transport.zeromq")

TICK = 0.05
"""Seconds between two looks into the directory, and at those we wait for."""

L = TypeVar("L", bound=Link)
T = TypeVar("T")


class ZeroMQTransport:
    """Option `bind`: TCP address at which operations are served as well, `tcp://127.0.0.1:5555`."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        self._bind = options_of(config, bind="")["bind"]
        self.codec: Codec = MessagePack()
        self.incarnation = random_id()
        self.owner, self.folder = config.owner, _short_enough(runtime_dir() / "zeromq")
        self.closed = False
        self._lock = threading.RLock()
        self._links: list[Link] = []
        self._peers: dict[str, Peer] = {}
        self._router: Router | None = None
        self._known = -1
        """The version of the directory that all links have seen."""
        self._last: dict[object, str] = {}
        """What last went wrong on the receiving thread, so that it is not told at every tick."""
        self.directory = Directory(self.folder)
        self.member = self.directory.join(config.owner)
        try:
            self._loop = Loop(self._tick)
        except OSError as exc:
            self.member.close()
            raise TransportError(f"zeromq: cannot be opened: {exc.strerror}") from exc
        keep_memory()
        self.context = zmq.Context()
        self._crew = Crew("zeromq", self._loop.receive, self._loop.wake)
        self._crew.start()

    def outlet(self, channel: Channel) -> Publisher | CommandOutlet:
        kind = Publisher if channel.pattern is Pattern.PUBLISH else CommandOutlet
        return self._open(kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> Subscriber | CommandInlet:
        kind = Subscriber if channel.pattern is Pattern.PUBLISH else CommandInlet
        return self._open(kind(self, channel, sink))

    def caller(self, channel: Channel) -> Caller:
        return self._open(Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> Server:
        return self._open(Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self._loop.close)
            everything.callback(self.context.term)
            everything.callback(self._close_sockets)
            everything.callback(self._crew.close)
            everything.callback(self._close_router)
            everything.callback(self.member.close)
            for link in list(self._links):
                everything.callback(link.close)

    def _close_router(self) -> None:
        if self._router:
            self._router.close()

    def _close_sockets(self) -> None:
        with self._lock:
            peers = list(self._peers.values())
        with contextlib.ExitStack() as everything:
            for socket in self._loop.sockets():  # those of links that could not be closed
                everything.callback(socket.close)
            for peer in peers:
                everything.callback(peer.close)

    # What links use.

    def socket(self, kind: int, on_input: Callable[[Socket], list[Job]], **options: int) -> Socket:
        """A shared socket, whose input the crew attends to from now on."""
        socket = Socket(new_socket(self.context, kind, **options), on_input, self._loop.attend)
        self._loop.add(socket)
        return socket

    def forget(self, socket: Socket) -> None:
        self._loop.remove(socket)
        socket.close()

    def attend(self, socket: Socket) -> None:
        self._loop.attend(socket)

    def wake(self) -> None:
        self._loop.wake()

    def do(self, job: Job) -> None:
        """Have the crew run this."""
        self._loop.do(job)

    def router(self) -> Router:
        with self._lock:
            if self._router is None:
                self._router = Router(self, self._bind)
            return self._router

    def peer(self, member: Member, address: str) -> Peer:
        with self._lock:
            if self.closed:
                raise Closed("the transport is closed")
            if member.id not in self._peers:
                self._peers[member.id] = Peer(self, member.id, address)
            return self._peers[member.id]

    def drop(self, peer: Peer) -> None:
        """Its process is dead: nobody we wait for there will answer."""
        with self._lock:
            self._peers.pop(peer.id, None)
        peer.close()

    def left(self, link: Link) -> None:
        with self._lock:
            if link in self._links:
                self._links.remove(link)
            for work in (link.look, link.tick):
                self._last.pop(work, None)

    def _guarded(self, work: Callable[[], T], otherwise: T) -> T:
        """What a link does on the thread that receives for everybody: if it fails, the others go on."""
        try:
            result = work()
        except Exception as exc:
            if self._last.get(work) != repr(exc):
                self._last[work] = repr(exc)
                log.exception("looking after a link; trying again")
            return otherwise
        self._last.pop(work, None)
        return result

    def _open(self, link: L) -> L:
        if self.closed:
            raise Closed("the transport is closed")
        try:
            link.open()
        except BaseException:
            link.close()
            raise
        with self._lock:
            self._links.append(link)  # only now: those in the list are looked after by the receiving thread
            closed = self.closed
        if closed:
            link.close()
            raise Closed("the transport is closed")
        if not self._guarded(link.look, False):  # who came after it was opened, and before it was in the list
            self._known = -1
        return link

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        version = self.directory.version()
        links = list(self._links)
        if version != self._known and all([self._guarded(link.look, False) for link in links]):
            self._known = version
        waits = [self._guarded(link.tick, None) for link in links]
        return min([TICK, *(wait for wait in waits if wait is not None)])


def _short_enough(folder: Path) -> Path:
    """The folder, if the paths of sockets in it are not too long for the kernel."""
    longest = len(os.fsencode(folder / "4194304-01234567-router"))
    if longest > 107:
        raise ConfigurationError(
            f"run-time folder {folder}: paths of sockets in it would have {longest} bytes, and 107 is the limit; "
            "set ROBOCOMP_RUNTIME_DIR to a shorter path"
        )
    return folder
