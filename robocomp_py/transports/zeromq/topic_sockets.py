"""The sockets by which topics are published, and what their subscribers have subscribed to.

A component with many publications has a few sockets for all of them on this host. Publications which share a socket
have the same depth. A socket has a queue for each connection, and a subscriber connects for each topic, so a slow
subscriber delays no other topic. But threads wait for each other while they send by the same socket. Therefore the
first publications have a socket of their own, and only further ones share. Three rules follow:

    Each publication has its own path, a symbolic link to the file of the socket. Subscribers notice nothing.
    A socket carries a channel once. A second publication of it, even after the end of the first, gets another socket:
    subscribers of both would receive each message twice.
    The last publication that ends closes the socket. The next one opens a new socket, at another path.

A latched topic never shares, since a late subscriber does not say of which topic it missed messages. Neither does a
topic for other hosts, since each of their connections is admitted to one topic.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import zmq

from ...errors import TransportError
from ..leader_followers import Job
from .frames import OWN_TOPIC_BYTES, is_welcome
from .sockets import Socket, as_transport_error

if TYPE_CHECKING:
    from ..membership import Membership
    from .reactor import Reactor

_MOST_WELCOMED = 10_000
"""Maximum number of connected subscribers of a topic that a publisher remembers."""

_UNSHARED = 16
"""Sockets which a transport opens before publications share them."""

_MOST_CARRIED = 1000
"""Channels that a socket carries at most in its life, since it remembers them."""

_TOGETHER, _BREATH = 16, 0.002
"""Subscriptions handled at once, and seconds until the next ones. So the guard has time to notice a flood of them, and
other input is hardly delayed."""

Latecomer = Callable[[Socket, bytes], None]
"""Called with the own topic of a late subscriber, under the lock of the socket."""

Open = Callable[[Callable[[Socket], list[Job]]], Socket]
"""Opens a socket whose input goes to that function."""


class TopicSocket:
    """A publisher's socket."""

    def __init__(
        self,
        reactor: Reactor,
        open_socket: Open,
        topics: Iterable[bytes] = (),
        on_latecomer: Latecomer | None = None,
    ) -> None:
        self.topics = set(topics)
        """The topics of publications that use or have used this socket. Set before the publication is announced."""
        self.subscribed: set[bytes] = set()
        """Those of them that have a subscriber."""
        self.welcomed: set[bytes] = set()
        """The welcome topics of connected subscribers: they subscribe to them to learn that they are connected."""
        self._reactor, self._on_latecomer = reactor, on_latecomer
        self.socket = open_socket(self._on_subscription)

    def count(self) -> None:
        """Handle subscriptions now, even if none was reported."""
        if self.take_subscriptions():
            self._reactor.attend(self.socket)

    def take_subscriptions(self) -> bool:
        """Handle some subscriptions; whether there may be more."""
        return self._take(self.socket)

    def close(self) -> None:
        self._reactor.forget(self.socket)

    def _on_subscription(self, socket: Socket) -> list[Job]:
        if self._take(socket):
            self._reactor.rest(socket, _BREATH)
        return []

    def _take(self, socket: Socket) -> bool:
        with socket.lock:
            for _ in range(_TOGETHER):
                frame = socket.receive_subscription()
                if frame is None:
                    return False
                self._note(socket, frame)
            return not socket.closed

    def _note(self, socket: Socket, frame: zmq.Frame) -> None:
        octets = frame.bytes
        begins, named = octets[:1] == b"\1", octets[1:]
        if not begins and _comes_from_far(frame):
            return
        if named in self.topics:
            (self.subscribed.add if begins else self.subscribed.discard)(named)
        elif not begins:
            self.welcomed.discard(named)
        elif named[:1] == b"\0" and len(named) == OWN_TOPIC_BYTES:
            if self._on_latecomer:
                self._on_latecomer(socket, named)
        elif is_welcome(named) and len(self.welcomed) < _MOST_WELCOMED * len(self.topics):
            self.welcomed.add(named)
            socket.send([named])


@dataclass
class _Use:
    """How a socket is used."""

    depth: int
    file: Path
    paths: set[Path] = field(default_factory=set)
    """Those of its publications."""


class SharedSockets:
    """The sockets on this host that publications share. Safe to use from any thread."""

    def __init__(self, reactor: Reactor, member: Membership) -> None:
        self._reactor, self._member = reactor, member
        self._lock = threading.Lock()
        self._uses: dict[TopicSocket, _Use] = {}
        self._numbers = itertools.count(1)

    def join(self, topic: bytes, depth: int, path: Path) -> TopicSocket:
        """A socket with queues of that depth for a topic, reached at `path`. Opens one if no other fits."""
        with self._lock:
            shared = self._fitting(topic, depth) or self._open(depth)
            use = self._uses[shared]
            try:
                path.symlink_to(use.file.name)
            except OSError as exc:
                self._close_if_unused(shared)
                raise TransportError(f"zeromq: binding {path}: {exc.strerror}") from exc
            shared.topics.add(topic)
            use.paths.add(path)
            return shared

    def leave(self, shared: TopicSocket, path: Path) -> None:
        """The publication at that path has ended. The last one closes the socket."""
        with self._lock:
            remove(path)
            self._uses[shared].paths.discard(path)
            self._close_if_unused(shared)

    def _fitting(self, topic: bytes, depth: int) -> TopicSocket | None:
        """The socket with the fewest publications that may carry this one, too."""
        if len(self._uses) < _UNSHARED:
            return None
        fitting = [
            each
            for each, use in self._uses.items()
            if use.depth == depth and topic not in each.topics and len(each.topics) < _MOST_CARRIED
        ]
        return min(fitting, key=lambda each: len(self._uses[each].paths), default=None)

    def _open(self, depth: int) -> TopicSocket:
        # The name is no ending of a publication: those have six hexadecimal digits.
        file = self._member.address(f"t{next(self._numbers):x}")
        shared = TopicSocket(self._reactor, partial(open_here, self._reactor, file, depth))
        self._uses[shared] = _Use(depth, file)
        return shared

    def _close_if_unused(self, shared: TopicSocket) -> None:
        if not self._uses[shared].paths:
            remove(self._uses.pop(shared).file)
            shared.close()


def open_here(
    reactor: Reactor,
    path: Path,
    depth: int,
    on_input: Callable[[Socket], list[Job]],
    *,
    watched: bool = False,
) -> Socket:
    """A publisher's socket on this host.

    Its descriptor also reports sent messages, which costs time. Only a latched topic must notice a subscription at
    once, so only its socket is `watched`.
    """
    socket = reactor.socket(zmq.XPUB, on_input, None, watched, **publishing(depth))
    try:
        with as_transport_error(f"binding {path}"), socket.lock:
            socket.raw.bind(f"ipc://{path}")
    except BaseException:
        reactor.forget(socket)
        raise
    return socket


def remove(path: Path) -> None:
    """Remove the path of a publication or socket, which the library leaves."""
    with contextlib.suppress(OSError):  # it is removed with the other files of this member, or is already
        path.unlink()


def publishing(depth: int) -> dict[str, int]:
    """The options of a publisher's socket."""
    return {"SNDHWM": depth, "XPUB_VERBOSE": 1, "XPUB_NODROP": 1}


def _comes_from_far(ends: zmq.Frame) -> bool:
    """Whether the end of a subscription was sent by another host. Otherwise, its last connection is gone.

    ZeroMQ passes on what a host sends, even if that connection had no such subscription and others still have it.
    """
    try:
        return bool(ends.get("Peer-Address"))
    except zmq.ZMQError:
        return False
