"""Watches the TCP connections of ZeroMQ's sockets, and closes those that exceed a bound; see `bounds`.

A monitor of each socket reports connections that come and go, with their descriptors. The kernel reports how much each
has received (`TCP_INFO`). An edge-triggered `epoll` reports when there is more, so a quiet connection costs nothing.
`shutdown` tells ZeroMQ that a connection has ended, and ZeroMQ frees its memory.

When the guard uses a descriptor, it may already belong to another file. So the guard uses a copy and first checks its
peer. The copy always has the same number, reserved beforehand, so it needs no free descriptor.
"""

from __future__ import annotations

import contextlib
import logging
import os
import resource
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import zmq

from ...errors import TransportError
from ...threads import NO_THREAD, start_thread
from ..leader_followers import belongs
from ..sparing import Repeats, Sparing
from .bounds import HEAD, PROBATION, Connection, Descriptors, Kind, too_large, too_many
from .frames import Frames

log = logging.getLogger("robocomp.transport.zeromq")

PERIOD = 0.010
"""Seconds between two looks while there is traffic."""

_EVENTS = int(zmq.EVENT_ACCEPTED | zmq.EVENT_CONNECTED | zmq.EVENT_DISCONNECTED | zmq.EVENT_CLOSED)
_COMES, _GOES = (
    {int(zmq.EVENT_ACCEPTED), int(zmq.EVENT_CONNECTED)},
    {int(zmq.EVENT_DISCONNECTED), int(zmq.EVENT_CLOSED)},
)
_EVENT = struct.Struct("=Hi")
_SRCFD = int(zmq.SRCFD)

_TCP_INFO, _RECEIVED = 136, struct.Struct("=Q")
"""Octets of the kernel's record up to `tcpi_bytes_received`, which is the last of these."""

_TAKEN, _TAKES = 256 * 1024, 64
"""Octets that one call discards, and the number of calls: the kernel holds a few megabytes at most."""

_RESET = struct.pack("ii", 1, 0)
"""Closing tells the other side at once, even if it waits for room."""

_DATA = select.EPOLLIN | select.EPOLLET

Told = Callable[[list[bytes]], object]
"""Takes an event other than those for connections that come or go."""


class Watched:
    """A socket that the guard watches."""

    def __init__(
        self, raw: zmq.Socket[Any], kind: Kind, queue: int, told: Told | None, events: zmq.Socket[Any]
    ) -> None:
        self.raw, self.kind, self.events, self._told = raw, kind, events, told
        self.connections: dict[int, Connection] = {}
        """By descriptor."""
        self.newest: Connection | None = None
        """The newest connection; the only one of a socket that connects itself."""
        self._queue, self._largest = queue, 0

    def took(self, frames: Frames, last: zmq.Frame | None = None) -> None:
        """Note that a message was received; `last` is one of its frames if the socket has several connections."""
        if self.kind is Kind.SUBSCRIPTIONS:
            return  # subscriptions stay in the socket
        size = sum(map(len, frames)) + HEAD * len(frames)
        if last is not None:
            try:
                connection = self.connections.get(int(last.get(_SRCFD)))
            except zmq.ZMQError:
                return  # it came from this process
        else:
            connection = self.newest
        if connection:
            connection.delivered += size
            if self._queue and size > self._largest:
                self._largest = size
                connection.queued = self._queue * size

    def tell(self, event: list[bytes]) -> None:
        if self._told:
            self._told(event)


class Guard:
    """One thread that watches all sockets of a transport with connections to other hosts."""

    def __init__(self, context: zmq.Context[Any], owner: str) -> None:
        self._context, self._owner = context, owner
        self._watched: list[Watched] = []
        self._lock = threading.Lock()
        """Held while a socket comes or goes, and during a look."""
        self._probation: dict[str, float] = {}
        """By address: until when it has a lower bound."""
        self._told, self._failing = Repeats(), Sparing()
        self._closing = threading.Event()
        with contextlib.ExitStack() as undo:
            try:
                self._probe, self._nothing = (undo.enter_context(socket.socket()) for _ in range(2))
                self._epoll = undo.enter_context(select.epoll())
                self._wake_in, self._wake_out = (undo.enter_context(each) for each in socket.socketpair())
            except OSError as exc:
                raise TransportError(f"zeromq: watching connections: {exc.strerror}") from exc
            self._wake_in.setblocking(False)
            self._wake_out.setblocking(False)
            self._epoll.register(self._wake_out, select.EPOLLIN)
            self._thread = threading.Thread(target=self._run, name="zeromq-guard", daemon=False)
            belongs(self._thread)
            if not start_thread(self._thread):
                raise TransportError(f"zeromq: watching connections: {NO_THREAD}")
            self._files = undo.pop_all()

    def watch(
        self, raw: zmq.Socket[Any], kind: Kind, queue: int = 0, told: Told | None = None, also: int = 0
    ) -> Watched:
        """Watch a socket that is not bound or connected yet; `also` are further events, for `told`.

        `queue` is the maximum number of whole messages that wait in the socket.
        """
        address = f"inproc://guard of {id(raw)} since {time.monotonic_ns()}"
        events: zmq.Socket[Any] = self._context.socket(zmq.PAIR)
        try:
            events.setsockopt(zmq.LINGER, 0)
            events.setsockopt(zmq.RCVHWM, 0)  # otherwise a slow guard would stop ZeroMQ's thread
            raw.monitor(address, _EVENTS | also)
            events.connect(address)
        except zmq.ZMQError as exc:
            events.close()
            raise TransportError(f"zeromq: watching a socket: {exc}") from exc
        watched = Watched(raw, kind, queue, told, events)
        with self._lock:
            if self._closing.is_set():  # its socket would be left open, and the context could not be closed
                events.close()
                raise TransportError("zeromq: the transport is closed")
            self._watched.append(watched)
            self._epoll.register(int(events.FD), select.EPOLLIN)
        self._wake()  # an operation on a socket may consume the report of input
        return watched

    def forget(self, watched: Watched) -> None:
        """Stop watching its socket, which may be closed before or after this. Idempotent."""
        with self._lock:
            if watched in self._watched:
                self._watched.remove(watched)
                self._epoll.unregister(int(watched.events.FD))
                if not watched.raw.closed:
                    watched.raw.disable_monitor()
                watched.events.close()

    def close(self) -> None:
        with self._lock:  # no sockets are added from now on
            self._closing.set()
        self._wake()
        self._thread.join()
        for watched in list(self._watched):
            self.forget(watched)
        self._files.close()

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._wake_in.send(b"!")

    def _run(self) -> None:
        again = False
        while not self._closing.wait(PERIOD):  # a pause, so that several events are handled together
            try:
                ready = {descriptor for descriptor, _ in self._epoll.poll(PERIOD if again else None)}
                with contextlib.suppress(BlockingIOError):
                    self._wake_out.recv(4096)
                with self._lock:
                    again = self._look(ready, time.monotonic())
            except Exception:
                if self._failing.may_tell():
                    log.exception("watching connections; trying again")

    # With the lock.

    def _look(self, ready: set[int], now: float) -> bool:
        """Note new, closed and busy connections, and close those over a bound; whether to look again soon."""
        highest = max((self._take_events(watched, now) for watched in self._watched), default=0)
        again = False
        for watched in self._watched:
            for descriptor, connection in list(watched.connections.items()):
                if descriptor in ready or connection.urgent:
                    if (received := self._received(descriptor, connection)) is None:
                        del watched.connections[descriptor]
                    else:
                        connection.look(received, now)
                        again = again or connection.urgent
        self._probation = {address: end for address, end in self._probation.items() if now < end}
        everything = [each for watched in self._watched for each in watched.connections.values()]
        for connection, why in too_large(everything, frozenset(self._probation)):
            if connection.kind is Kind.MESSAGES:
                self._probation[connection.address] = now + PROBATION
            self._close(connection, why)
        if highest:
            descriptors = Descriptors(resource.getrlimit(resource.RLIMIT_NOFILE)[0])
            for connection, why in too_many(everything, descriptors, highest):
                self._close(connection, why)
        return again

    def _take_events(self, watched: Watched, now: float) -> int:
        """Note connections that came and went; returns the highest descriptor of new ones."""
        highest = 0
        while True:
            try:
                event = watched.events.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return highest
            kind, descriptor = _EVENT.unpack(event[0])
            if kind in _COMES:
                self._meet(watched, descriptor, event[1], kind == zmq.EVENT_ACCEPTED, now)
                highest = max(highest, descriptor if kind == zmq.EVENT_ACCEPTED else 0)
            elif kind in _GOES:
                watched.connections.pop(descriptor, None)
            else:
                watched.tell(event)

    def _meet(self, watched: Watched, descriptor: int, endpoint: bytes, accepted: bool, now: float) -> None:
        """Note a new connection; `endpoint` is the address of the socket, or of the peer it connected to."""
        with self._held(descriptor) as there:
            if there:
                ours, theirs = self._probe.getsockname(), self._probe.getpeername()
                if (ours if accepted else theirs)[1] == int(endpoint.rpartition(b":")[2]):
                    try:
                        self._epoll.register(descriptor, _DATA)
                    except FileExistsError:  # an earlier connection had the same descriptor
                        self._epoll.modify(descriptor, _DATA)
                    address, port = theirs[:2]
                    watched.newest = Connection(watched.kind, address, port, now, accepted)
                    watched.connections[descriptor] = watched.newest

    def _received(self, descriptor: int, connection: Connection) -> int | None:
        """The octets received by a connection; None if it is gone."""
        with self._held(descriptor) as there:
            if there and self._probe.getpeername()[:2] == (connection.address, connection.port):
                info = self._probe.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO)
                return int(_RECEIVED.unpack_from(info, _TCP_INFO - _RECEIVED.size)[0])
        return None

    def _close(self, connection: Connection, why: str) -> None:
        for watched in self._watched:
            for descriptor, each in list(watched.connections.items()):
                if each is connection:
                    del watched.connections[descriptor]
                    with self._held(descriptor) as there:
                        if there and self._probe.getpeername()[:2] == (connection.address, connection.port):
                            self._probe.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
                            self._probe.shutdown(socket.SHUT_RDWR)
                            self._discard()
        untold = self._told.untold((connection.address, why))
        if untold is not None:
            more = f" ({untold} more like it since the last such message)" if untold else ""
            log.warning("%s: closed a connection of %s: %s%s", self._owner or "zeromq", connection.address, why, more)

    def _discard(self) -> None:
        """Discard what the kernel holds of a connection that was shut down, so that ZeroMQ does not read it."""
        room = bytearray(_TAKEN)
        for _ in range(_TAKES):
            if not self._probe.recv_into(room, _TAKEN, socket.MSG_DONTWAIT | socket.MSG_TRUNC):
                return

    @contextlib.contextmanager
    def _held(self, descriptor: int) -> Iterator[bool]:
        """Make `_probe` a copy of that descriptor for a while, so that the file stays the same meanwhile."""
        try:
            os.dup2(descriptor, self._probe.fileno(), inheritable=False)
        except OSError:
            yield False  # it was closed
            return
        try:
            yield True
        except OSError:
            pass  # no connection any more, or another kind of file by now
        finally:
            os.dup2(self._nothing.fileno(), self._probe.fileno(), inheritable=False)
