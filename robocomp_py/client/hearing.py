"""Subscriptions of scripts. No publisher waits for them, and each queue is bounded."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from ..contract.interface import Operation
from ..contract.qos import QoS, Reliability
from ..errors import Closed, HostUnreachable, RobocompError, Timeout
from ..tools.absent import Absent
from ..tools.access import Subscription
from ..tools.far import FarLink
from ..tools.network import Channel
from ..wire.codec import Decoder, Payload
from .values import record

if TYPE_CHECKING:
    from .session import Session

log = logging.getLogger("robocomp.client")

DEPTH = 100
"""Messages that may wait in one queue."""

_OCTETS = 64 * 1024 * 1024
"""Octets that may wait in one queue."""

_AGAIN = 2.0
"""Seconds between two attempts to hear a lost host."""

_LOOK = 0.2
"""Seconds between two looks at whether the connection is closed."""


class Hearing:
    """The subscription to one topic, shared by all that listen to it. It lasts as long as the connection."""

    def __init__(self, session: Session, channel: Channel) -> None:
        """Raises NotUnderstood, and what opening a link raises, unless a host is lost and another one is heard."""
        self._session, self.name = session, channel.name
        self.arrived = threading.Condition()
        self._newest: tuple[float, _Arrived] | None = None
        self._queues: weakref.WeakSet[Listening] = weakref.WeakSet()
        self._links: list[Subscription] = []
        self._again = 0.0
        """When to try lost hosts again, by `time.monotonic()`."""
        self._reported: set[str] = set()
        """The lost hosts of which a warning was logged, and from which nothing has come since then."""
        self._absent = Absent(session.lost)
        """The hosts that could not be asked when this was made, and that may publish it."""
        failed: list[HostUnreachable] = []
        for each in channel.each_way():
            try:
                self._links.append(self._opened(each))
            except HostUnreachable as exc:
                failed.append(exc)
                self._absent.add(each.host)
        if failed and not self._links:
            raise failed[0]
        for error in failed:
            self._warn(error)

    @property
    def error(self) -> RobocompError | None:
        """Why no further message comes: the hosts of all publishers are lost."""
        errors = [each.error for each in self._links if isinstance(each, FarLink) and each.error]
        return errors[0] if len(errors) == len(self._links) else None

    def latest(self, timeout: float, newer_than: float | None) -> Any:
        begun = time.monotonic()
        oldest = -math.inf if newer_than is None else begun - newer_than
        while True:
            self.try_again()
            with self.arrived:
                if self._newest is not None and self._newest[0] >= oldest:
                    payload, read = self._newest[1]
                    break
                self.wait(begun + timeout, timeout)
        return read(payload)

    def listen(self, timeout: float | None, depth: int | None) -> Listening:
        if timeout is not None and not timeout >= 0:
            raise ValueError(f"{self.name}: timeout={timeout!r} must be a number of seconds, or None")
        made = Listening(self, timeout, DEPTH if depth is None else max(1, depth))
        with self.arrived:
            self._queues.add(made)
        return made

    def wait(self, end: float | None, timeout: float | None) -> None:
        """Wait for a message for a while, with the lock of `arrived`.

        Raises Timeout after `end`, Closed, and HostUnreachable if the hosts of all publishers are lost.
        """
        self._session.check_open()
        if error := self.error:
            raise error
        for each in self._links:
            if isinstance(each, FarLink) and each.error and each.host not in self._reported:
                self._reported.add(each.host)
                self._warn(each.error)
        left = _LOOK if end is None else min(_LOOK, end - time.monotonic())
        if left <= 0:
            raise Timeout(f"{self.name}: no message came in {timeout:g} s")
        self.arrived.wait(left)

    def try_again(self) -> None:
        """Hear lost hosts again, from time to time, while others are heard."""
        if self._absent and self._absent.is_due():
            self._look_aside()
        lost = [each for each in self._links if isinstance(each, FarLink) and each.error]
        if not lost or len(lost) == len(self._links):
            return
        with self.arrived:
            if time.monotonic() < self._again or self._session.is_closed:
                return
            self._again = time.monotonic() + _AGAIN
        for each in lost:
            with contextlib.suppress(RobocompError):  # it is still lost
                each.open()

    def _look_aside(self) -> None:
        try:
            self._session.aside(self._look, f"looking for {self.name}")
        except RobocompError:  # closed, or there is no thread now
            self._absent.looked()

    def _look(self) -> None:
        """Hear the hosts that were out of reach at first, if they can be asked now."""
        lost: Collection[str] | None = None
        try:
            known = self._session.census().channels.get(self.name)
            for each in known.each_way(lambda way: way.host not in self._absent) if known else ():
                link = self._opened(each)
                with self.arrived:
                    self._links.append(link)
                self._absent.found(each.host)
            lost = self._session.lost
        except RobocompError as exc:
            log.debug("%s: %s", self.name, exc)  # it is tried again
        finally:
            self._absent.looked(lost)

    def forget(self, queue: Listening) -> None:
        with self.arrived:
            self._queues.discard(queue)

    def _opened(self, channel: Channel) -> Subscription:
        session, operation = self._session, self._session.types.operation(channel.operation)
        read = _reader(session.codec(channel).decoder(operation.request), operation)
        qos = QoS(Reliability.BEST_EFFORT, channel.qos.durability, depth=DEPTH)
        return session.hear(channel, operation, qos, lambda payload: self._take(_Arrived(payload, read), channel.host))

    def _take(self, arrived: _Arrived, host: str) -> None:
        """On a thread of the transport."""
        with self.arrived:
            self._newest = time.monotonic(), arrived
            self._reported.discard(host)
            for each in self._queues:
                each.put(arrived)
            self.arrived.notify_all()

    def _warn(self, error: RobocompError) -> None:
        log.warning("%s: %s; the others are heard", self.name, error)


class _Arrived(NamedTuple):
    payload: Payload
    read: Callable[[Payload], Any]
    """Makes a message of the payload. Raises DecodeError."""


def _reader(decode: Decoder, operation: Operation[Any]) -> Callable[[Payload], Any]:
    if len(operation.inputs) == 1:
        return lambda payload: decode(payload)[0]
    python = record(operation.request.name, operation.inputs).python
    assert python is not None
    return lambda payload: python(*decode(payload))


class Listening:
    """The messages of a topic, one after the other. `dropped` counts those that came too fast.

    It may be used as a context manager; one that is not used any more costs nothing.
    """

    def __init__(self, hearing: Hearing, timeout: float | None, depth: int) -> None:
        self._hearing, self._timeout, self._depth = hearing, timeout, depth
        self._waiting: deque[_Arrived] = deque()
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
        while True:
            hearing.try_again()
            with hearing.arrived:
                if self._waiting:
                    payload, read = self._waiting.popleft()
                    self._octets -= size_of(payload)
                    break
                try:
                    hearing.wait(end, self._timeout)
                except Closed:
                    raise StopIteration from None
        return read(payload)

    def __repr__(self) -> str:
        return f"<messages of {self._hearing.name}: {len(self._waiting)} wait, {self.dropped} dropped>"

    def put(self, arrived: _Arrived) -> None:
        """With the lock of `arrived`."""
        self._waiting.append(arrived)
        self._octets += size_of(arrived.payload)
        while len(self._waiting) > self._depth or (self._octets > _OCTETS and len(self._waiting) > 1):
            self._octets -= size_of(self._waiting.popleft().payload)
            self.dropped += 1


def size_of(payload: Payload) -> int:
    if isinstance(payload, list):
        return sum(map(size_of, payload))
    return memoryview(payload).nbytes if payload is not None else 0
