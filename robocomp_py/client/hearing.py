"""Subscriptions of scripts. No publisher waits for them, and each queue is bounded."""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections import deque
from typing import TYPE_CHECKING, Any, Self

from ..contract.interface import Operation
from ..contract.qos import QoS, Reliability
from ..errors import Closed, RobocompError, Timeout
from ..tools.far import FarLink
from ..tools.network import Channel
from ..wire.codec import Payload
from .values import record

if TYPE_CHECKING:
    from .session import Session

DEPTH = 100
"""Messages that may wait in one queue."""

_OCTETS = 64 * 1024 * 1024
"""Octets that may wait in one queue."""

_LOOK = 0.2
"""Seconds between two looks at whether the connection is closed."""


class Hearing:
    """The subscription to one topic, shared by all that listen to it. It lasts as long as the connection."""

    def __init__(self, session: Session, channel: Channel, operation: Operation[Any]) -> None:
        self._session, self.name = session, channel.name
        self._decode = session.codec(channel).decoder(operation.request)
        self._message = record(operation.request.name, operation.inputs) if len(operation.inputs) != 1 else None
        self.arrived = threading.Condition()
        self._newest: tuple[float, Payload] | None = None
        self._queues: weakref.WeakSet[Listening] = weakref.WeakSet()
        qos = QoS(Reliability.BEST_EFFORT, channel.qos.durability, depth=DEPTH)
        self._link = session.hear(channel, operation, qos, self._take)

    @property
    def error(self) -> RobocompError | None:
        """Why no further message comes: the host of the publisher is lost."""
        return self._link.error if isinstance(self._link, FarLink) else None

    def latest(self, timeout: float, newer_than: float | None) -> Any:
        begun = time.monotonic()
        oldest = -math.inf if newer_than is None else begun - newer_than
        with self.arrived:
            while self._newest is None or self._newest[0] < oldest:
                self.wait(begun + timeout, timeout)
            payload = self._newest[1]
        return self.decoded(payload)

    def listen(self, timeout: float | None, depth: int | None) -> Listening:
        made = Listening(self, timeout, DEPTH if depth is None else max(1, depth))
        with self.arrived:
            self._queues.add(made)
        return made

    def decoded(self, payload: Payload) -> Any:
        """Raises DecodeError."""
        values = self._decode(payload)
        if self._message is None:
            return values[0]
        assert self._message.python is not None
        return self._message.python(*values)

    def wait(self, end: float | None, timeout: float | None) -> None:
        """Wait for a message for a while, with the lock of `arrived`.

        Raises Timeout after `end`, Closed, and HostUnreachable if the host of the publisher is lost.
        """
        self._session.check_open()
        if error := self.error:
            raise error
        left = _LOOK if end is None else min(_LOOK, end - time.monotonic())
        if left <= 0:
            raise Timeout(f"{self.name}: no message came in {timeout:g} s")
        self.arrived.wait(left)

    def forget(self, queue: Listening) -> None:
        with self.arrived:
            self._queues.discard(queue)

    def _take(self, payload: Payload) -> None:
        """On a thread of the transport."""
        with self.arrived:
            self._newest = time.monotonic(), payload
            for each in self._queues:
                each.put(payload)
            self.arrived.notify_all()


class Listening:
    """The messages of a topic, one after the other. `dropped` counts those that came too fast.

    It may be used as a context manager; one that is not used any more costs nothing.
    """

    def __init__(self, hearing: Hearing, timeout: float | None, depth: int) -> None:
        self._hearing, self._timeout, self._depth = hearing, timeout, depth
        self._waiting: deque[Payload] = deque()
        self._octets = 0
        self.dropped = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._hearing.forget(self)

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Any:
        hearing = self._hearing
        end = None if self._timeout is None else time.monotonic() + self._timeout
        with hearing.arrived:
            while not self._waiting:
                try:
                    hearing.wait(end, self._timeout)
                except Closed:
                    raise StopIteration from None
            payload = self._waiting.popleft()
            self._octets -= size_of(payload)
        return hearing.decoded(payload)

    def __repr__(self) -> str:
        return f"<messages of {self._hearing.name}: {len(self._waiting)} wait, {self.dropped} dropped>"

    def put(self, payload: Payload) -> None:
        """With the lock of `arrived`."""
        self._waiting.append(payload)
        self._octets += size_of(payload)
        while len(self._waiting) > self._depth or (self._octets > _OCTETS and len(self._waiting) > 1):
            self._octets -= size_of(self._waiting.popleft())
            self.dropped += 1


def size_of(payload: Payload) -> int:
    if isinstance(payload, list):
        return sum(map(size_of, payload))
    return memoryview(payload).nbytes if payload is not None else 0
