"""Publishers and subscribers."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections import deque
from functools import partial
from typing import TYPE_CHECKING

import zmq

from ...contract.qos import History, from_traits
from ...errors import (
    DecodeError,
    Timeout,
)
from ...wire.codec import Payload
from ...wire.header import (
    pack_publication,
    random_id,
)
from ..base import (
    Channel,
    Sink,
    Source,
    TypeRef,
)
from ..crew import Job, Lane
from ..ledger import Ledger
from ..reception import Reception
from .frames import OWN_TOPIC_BYTES, Frames, joined, read_publication_frames, topic
from .link import Link
from .sockets import Socket, as_transport_error, persist

if TYPE_CHECKING:
    from .transport import ZeroMQTransport


BATCH = 32
"""Messages taken from one socket before the others have their turn."""

KEEP_ALL_DEPTH = 10_000


class Publisher(Link):
    role, facing = "publishes", "subscribes"
    _socket: Socket | None = None

    def open(self) -> None:
        qos = self.channel.qos
        depth = KEEP_ALL_DEPTH if qos.history is History.KEEP_ALL else max(qos.depth, 8)
        self._topic = topic(self.channel.name)
        self._source, self._sequence = random_id(), itertools.count(1)
        self._history: deque[Frames] = deque(maxlen=qos.depth if qos.latched else 0)
        self._subscribers = 0
        self._order = threading.Lock()
        self._socket = self.transport.socket(
            zmq.XPUB, self._on_subscription, SNDHWM=depth, XPUB_VERBOSER=1, XPUB_NODROP=int(qos.reliable)
        )
        path = self.transport.member.address(_ending(self._source))
        with as_transport_error(f"binding {path}"), self._socket.lock:
            self._socket.raw.bind(f"ipc://{path}")
        self.announce(f"ipc://{path}")

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        if not self._order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")
        try:
            self.check_open()
            header = pack_publication(self.channel.type.fingerprint, self._source, next(self._sequence), time.time_ns())
            frames = joined(self._topic + header, payload)
            with as_transport_error(f"publishing {self.channel.name}"):
                sent = self._send(frames) or persist(partial(self._send, frames), end, self.check_open, self.closed)
            if not sent:
                self.check_open()
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
        finally:
            self._order.release()

    def visible(self) -> bool:
        self.counterparts(strict=True)
        return self._subscribers > 0

    @property
    def heard(self) -> bool:
        return self._subscribers > 0 or bool(self._history.maxlen)

    def release(self) -> None:
        if self._socket:
            self.transport.forget(self._socket)

    def _send(self, frames: Frames) -> bool:
        assert self._socket
        if not self._history.maxlen:
            return self._socket.send(frames)
        with self._socket.lock:  # in one go: a subscriber that comes now gets this one as news or as history
            self._on_subscription(self._socket)
            sent = self._socket.send(frames)
            if sent:
                first, *arrays = frames
                self._history.append([first[len(self._topic) :], *map(bytes, arrays)])
            return sent

    def _on_subscription(self, socket: Socket) -> list[Job]:
        with socket.lock:
            while (frames := socket.receive()) is not None:
                begins, named = frames[0][:1] == b"\1", frames[0][1:]
                if named == self._topic:
                    self._subscribers += 1 if begins else -1
                elif begins and named[:1] == b"\0" and len(named) == OWN_TOPIC_BYTES:
                    for first, *arrays in self._history:
                        socket.send([named + first, *arrays])
        return []


class Subscriber(Link):
    role, facing = "subscribes", "publishes"
    _socket: Socket | None = None

    def __init__(self, transport: ZeroMQTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self._depth = KEEP_ALL_DEPTH if qos.history is History.KEEP_ALL else qos.depth
        self._lane = Lane(channel.name, sink, self._depth, lossy=not qos.reliable, stats=self.stats)
        self._reception = Reception(channel, self.stats, self._lane.through)
        self._ledger = Ledger(self.stats, ordered=True)
        self._connected: dict[str, str] = {}
        self._channels: dict[str, str] = {}
        """By what the address of a publisher ends with."""
        self._paused = False

    def open(self) -> None:
        self._socket = self.transport.socket(
            zmq.SUB, self._on_message, RCVHWM=max(self._depth, 8), RECONNECT_IVL=-1, LINGER=0
        )
        self.look()
        self.announce()

    def look(self) -> bool:
        assert self._socket
        with self._socket.lock:  # also while looking: of two who look, the later one must not connect the earlier
            found = self.counterparts()
            there = {entry.address: entry.channel for _, entry in found}
            self._channels = {address[-6:]: channel for address, channel in there.items()}
            self._reception.meet(Source(entry.channel, from_traits(entry.traits)) for _, entry in found)
            if self._socket.closed:
                return True
            for address in self._connected.keys() - there.keys():
                del self._connected[address]
                with contextlib.suppress(zmq.ZMQError):  # it has gone, and its endpoint with it
                    self._socket.raw.disconnect(address)
            for address in there.keys() - self._connected.keys():
                with as_transport_error(f"connecting to {address}"):
                    self._socket.raw.subscribe(topic(there[address]))
                    if self.channel.qos.latched:
                        self._socket.raw.subscribe(b"\0" + random_id().to_bytes(8, "little"))
                    self._socket.raw.connect(address)
                self._connected[address] = there[address]
        self.transport.attend(self._socket)
        return True

    def sources(self) -> list[Source]:
        alive = self.transport.directory.alive
        return [Source(e.channel, from_traits(e.traits)) for m, e in self.counterparts() if alive(m.id)]

    def visible(self) -> bool:
        publishers = self.counterparts(strict=True)
        return any(e.address in self._connected and self.transport.directory.alive(m.id) for m, e in publishers)

    def release(self) -> None:
        try:
            self._lane.close()
        finally:
            if self._socket:
                self.transport.forget(self._socket)

    def _on_message(self, socket: Socket) -> list[Job]:
        taken = 0
        for _ in range(BATCH):
            self._paused = True  # before looking: whoever makes room later sees this, and has us go on
            self._paused = self._lane.full
            frames = None if self._paused else socket.receive()
            if frames is None:
                break
            taken += self._take(frames)
        else:
            self.transport.attend(socket)
        return [self._drain] if taken else []

    def _take(self, frames: Frames) -> bool:
        try:
            header, payload = read_publication_frames(frames)
        except DecodeError as exc:
            self.malformed(exc)
            return False
        if header.fingerprint != self.channel.type.fingerprint:
            self.report_mismatch(header.source, TypeRef("", header.fingerprint))
            return False
        if not self._ledger.admit(header.source, header.sequence):
            return False
        if self._reception.on:
            name = self._channels.get(_ending(header.source), self.channel.name)
            payload = self._reception.admit(name, header.stamp, payload)
        return self._lane.put(payload)

    def _drain(self) -> None:
        self._lane.drain()
        if self._paused and self._socket:
            self.transport.attend(self._socket)


def _ending(source: int) -> str:
    """What the address of a publisher ends with."""
    return f"{source & 0xFFFFFF:06x}"
