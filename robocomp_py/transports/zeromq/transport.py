"""The transport: its links, its sockets, its thread."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

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
from ..announced import AnnouncedLink, Announcing
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
from ..inotify import FolderWatch
from ..memory import keep_memory
from ..served import CommandInlet, Server, ServingLink
from .asking import Caller, CommandOutlet, Peer
from .curve import ZAP, Curve, configured, why_not
from .link import TICK
from .serving import Router
from .sockets import Attended, Loop, Socket, Subscription, as_transport_error, new_socket
from .topics import Publisher, Subscriber
from .zmtp import Feed

log = logging.getLogger("robocomp.transport.zeromq")

IDLE_TICK = 0.5
"""Seconds between two looks at what should be as it was."""

_MOMENT = 0.01
"""Seconds between two looks into a directory that keeps changing."""

L = TypeVar("L", bound=AnnouncedLink[Any])


class ZeroMQTransport(Announcing):
    """Option `bind`: TCP address at which operations are served as well, `tcp://127.0.0.1:5555`; `curve_key` and
    `curve_admitted`: see `curve`."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        options = options_of(config, bind="", curve_key="", curve_admitted="")
        self._bind, self._curve = options["bind"], configured(options)
        if self._curve and not self._bind:
            raise ConfigurationError("zeromq: `curve_key` is for the address that `bind` names, and there is none")
        self._told_at = 0.0
        self.codec: Codec = MessagePack()
        self.incarnation = random_id()
        self.owner, self.folder = config.owner, _short_enough(runtime_dir() / "zeromq")
        self.served = self.folder / "served"
        self._peers: dict[str, Peer] = {}
        self._routers: list[Router] = []
        self.directory = Directory(self.folder)
        self.member = self.directory.join(config.owner)
        try:
            self._loop = Loop(self._tick)
        except OSError as exc:
            self.member.close()
            raise TransportError(f"zeromq: cannot be opened: {exc.strerror}") from exc
        self._watch = FolderWatch(self.folder)
        keep_memory()
        self.context = zmq.Context()
        if self._watch.fileno >= 0:
            self._loop.add(_Changes(self._watch, self._loop))
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
            everything.callback(self._watch.close)
            everything.callback(self._loop.close)
            everything.callback(self.context.term)
            everything.callback(self._close_sockets)
            everything.callback(self._crew.close)
            everything.callback(self._close_routers)
            everything.callback(self.member.close)
            for link in list(self._links):
                everything.callback(link.close)

    def _close_routers(self) -> None:
        for router in self._routers:
            router.close()

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
        socket = Socket(new_socket(self.context, kind, None, **options), on_input, self._loop.attend)
        self._loop.add(socket)
        return socket

    def subscription(self, feed: Feed, on_input: Callable[[Subscription], list[Job]]) -> Subscription:
        """A feed, whose input the crew attends to from now on."""
        subscription = Subscription(feed, on_input)
        self._loop.add(subscription)
        return subscription

    def forget(self, socket: Socket | Subscription) -> None:
        with socket.lock:
            self._loop.remove(socket)
            socket.close()

    def attend(self, socket: Attended) -> None:
        self._loop.attend(socket)

    def mute(self, subscription: Subscription) -> None:
        """Nobody attends to it, until it is heard again."""
        with subscription.lock:
            self._loop.mute(subscription)

    def hear(self, subscription: Subscription) -> None:
        with subscription.lock:
            if not subscription.closed:
                self._loop.add(subscription)

    def wake(self) -> None:
        self._loop.wake()

    def within(self, seconds: float) -> None:
        """Have links tick soon; for what is called when there is input."""
        self._loop.within(seconds)

    def do(self, job: Job) -> None:
        """Have the crew run this."""
        self._loop.do(job)

    def routers(self) -> list[Router]:
        """The one for this host, and a guarded one for others."""
        with self._lock:
            if not self._routers:
                here = f"ipc://{self.member.address('router')}"
                if self._curve is None:
                    self._routers = [Router(self, [here, *filter(None, [self._bind])])]
                else:
                    guarded = self._guarded_router(self._curve)
                    self._routers = [guarded]  # to be closed whatever happens to the other one
                    self._routers = [Router(self, [here]), guarded]
            return self._routers

    def enlist(self, link: ServingLink) -> str:
        routers = self.routers()
        for router in routers:
            router.add(link)
        return routers[0].address

    def delist(self, link: ServingLink) -> None:
        for router in self._routers:
            router.remove(link)

    def _guarded_router(self, curve: Curve) -> Router:
        monitor = "inproc://monitor"
        asked, told = self.socket(zmq.REP, partial(self._judge, curve)), self.socket(zmq.PAIR, self._tell)
        try:
            with as_transport_error(f"guarding {self._bind}"), asked.lock:
                asked.raw.bind(ZAP)
                asked.look()  # what is done with a socket may swallow that there is input
            router = Router(self, [self._bind], curve.serve, monitor)
            with as_transport_error(f"guarding {self._bind}"), told.lock:
                told.raw.connect(monitor)
                told.look()
        except BaseException:
            self.forget(asked)
            self.forget(told)
            raise
        return router

    def _judge(self, curve: Curve, socket: Socket) -> list[Job]:
        while (frames := socket.receive()) is not None:
            socket.send(curve.judge(frames))
        return []

    def _tell(self, socket: Socket) -> list[Job]:
        """Who is not let in, and why; at most once in a second."""
        while (event := socket.receive()) is not None:
            if time.monotonic() >= self._told_at + 1:
                self._told_at = time.monotonic()
                log.warning("%s: somebody was not let in: %s", self._bind, why_not(event))
        return []

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

    def _drop_the_dead(self) -> None:
        """Let go of what we hold for processes that have ended, whether or not anybody asks them again."""
        with self._lock:
            peers = list(self._peers.values())
        for peer in peers:
            if not peer.alive():
                self.drop(peer)

    def _open(self, link: L) -> L:
        super()._open(link)
        self._loop.wake()
        return link

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        if not self._watch.working:
            self._watch.renew()
        version = self.directory.version()
        if version != self._known:
            self._drop_the_dead()
        waits = self._look_after(version)
        usual = IDLE_TICK if self._watch.working and self._known == version else TICK
        return min([usual, *waits])


class _Changes:
    """What the loop attends to when the directory changes."""

    awaited = False

    def __init__(self, watch: FolderWatch, loop: Loop) -> None:
        self.fileno, self._watch, self._loop = watch.fileno, watch, loop

    def on_input(self, _: object) -> list[Job]:
        self._watch.read()
        self._loop.within(_MOMENT)
        return []

    def look(self) -> None:
        """Nothing is missed."""

    def close(self) -> None:
        self._watch.close()


def _short_enough(folder: Path) -> Path:
    """The folder, if the paths of sockets in it are not too long for the kernel."""
    longest = len(os.fsencode(folder / "4194304-01234567-router"))
    if longest > 107:
        raise ConfigurationError(
            f"run-time folder {folder}: paths of sockets in it would have {longest} bytes, and 107 is the limit; "
            "set ROBOCOMP_RUNTIME_DIR to a shorter path"
        )
    return folder
