"""Listens to topics of a running network, at no cost of its publishers."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import FrameType
from typing import Any, NamedTuple

from ..errors import DecodeError
from ..threads import start_thread
from ..wire import json
from ..wire.codec import Codec, Decoder, Payload
from .access import Access
from .network import Channel

DEPTH = 100
"""Messages of a topic that may wait to be printed."""

OCTETS = 64 * 1024 * 1024
"""Octets of all messages that may wait."""

ARRIVALS = 100_000
"""Arrivals of messages that may wait to be counted."""

_LOOK = 0.1
"""Seconds between two looks at the clock and at signals."""


class Message(NamedTuple):
    time: float
    """When it arrived, in seconds since 1970."""
    channel: str
    message: Any
    """As JSON; a text that says why, if it cannot be decoded."""
    dropped: int
    """Messages that arrived since the last one and did not fit."""


class _Arrived(NamedTuple):
    time: float
    channel: str
    payload: Payload
    octets: int


class _Inbox:
    """Messages that wait, bounded in number and octets. It never holds up the thread that receives."""

    def __init__(self, most: int) -> None:
        self._waiting: queue.Queue[_Arrived] = queue.Queue(most)
        self._lock = threading.Lock()
        self._octets = 0
        self._dropped = 0

    def put(self, channel: str, payload: Payload) -> None:
        size = _size(payload)
        with self._lock:
            if self._octets + size <= OCTETS or not self._octets:
                with contextlib.suppress(queue.Full):
                    self._waiting.put_nowait(_Arrived(time.time(), channel, payload, size))
                    self._octets += size
                    return
            self._dropped += 1

    def get(self, timeout: float) -> tuple[_Arrived, int] | None:
        """The next message, and the number of messages dropped since the last one; None if no message comes in time."""
        try:
            arrived = self._waiting.get(timeout=timeout)
        except queue.Empty:
            return None
        with self._lock:
            self._octets -= arrived.octets
            dropped, self._dropped = self._dropped, 0
        return arrived, dropped


def tapped(topics: Sequence[Channel], *, first: float, whole: float | None) -> Iterator[Message]:
    """The messages of these topics, for `whole` seconds or for ever; none if the `first` one does not come in time."""
    inbox, span = _Inbox(DEPTH * len(topics)), _Span(first, whole)
    decoders: dict[str, Decoder] = {}
    with _listening(topics, inbox.put, decoders) as check:
        while span.goes_on():
            check()
            if found := inbox.get(_LOOK):
                span.heard = True
                arrived, dropped = found
                yield Message(arrived.time, arrived.channel, _decoded(topics, decoders, arrived), dropped)


class Arrival(NamedTuple):
    channel: str
    at: float
    """`time.monotonic()`."""
    octets: int


def arrivals(topics: Sequence[Channel], *, first: float, whole: float | None) -> Iterator[Arrival | None]:
    """The arrivals of messages, as long as `tapped`; None whenever a while passes without one.

    While the caller does not take them, at most `ARRIVALS` wait; further ones are not counted.
    """
    waiting: queue.Queue[Arrival] = queue.Queue(ARRIVALS)
    span = _Span(first, whole)

    def note(channel: str, payload: Payload) -> None:
        with contextlib.suppress(queue.Full):
            waiting.put_nowait(Arrival(channel, time.monotonic(), _size(payload)))

    with _listening(topics, note, {}) as check:
        while span.goes_on():
            check()
            try:
                arrival = waiting.get(timeout=_LOOK)
            except queue.Empty:
                yield None
            else:
                span.heard = True
                yield arrival


class _Span:
    """How long to listen: `whole` seconds, or for ever unless nothing is heard in the `first` seconds."""

    def __init__(self, first: float, whole: float | None) -> None:
        self._end = time.monotonic() + (whole or first)
        self._is_endless = whole is None
        self.heard = False

    def goes_on(self) -> bool:
        return (self._is_endless and self.heard) or time.monotonic() < self._end


@contextlib.contextmanager
def _listening(
    topics: Sequence[Channel], take: Callable[[str, Payload], None], decoders: dict[str, Decoder]
) -> Iterator[Callable[[], None]]:
    """Subscriptions to these topics. The yielded function raises what has gone wrong with them meanwhile.

    When the user stops this process (Ctrl-Z), it first closes them: otherwise publishers could have to wait for it. A
    thread does so, because the main thread may be writing to a pipe that takes nothing.
    """
    subscriptions = _Subscriptions(topics, take, decoders)
    in_main = threading.current_thread() is threading.main_thread()
    try:
        before = signal.signal(signal.SIGTSTP, subscriptions.stop) if in_main else None
        subscriptions.open()
        yield subscriptions.check
    finally:
        subscriptions.close()
        if in_main:
            signal.signal(signal.SIGTSTP, before or signal.SIG_DFL)


class _Subscriptions:
    def __init__(
        self, topics: Sequence[Channel], take: Callable[[str, Payload], None], decoders: dict[str, Decoder]
    ) -> None:
        self._topics, self._take, self._decoders = topics, take, decoders
        self._access: Access | None = None
        self._wanted = threading.Event()
        """Set when this process is to stop, or the subscriptions are to end."""
        self._is_over = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._pause, name="pause", daemon=True)

    def open(self) -> None:
        self._listen()
        start_thread(self._thread)

    def stop(self, number: int, frame: FrameType | None) -> None:
        """The handler of a signal."""
        self._wanted.set()

    def check(self) -> None:
        if self._error:
            raise self._error

    def close(self) -> None:
        self._is_over = True
        self._wanted.set()
        if self._thread.ident:
            self._thread.join()
        self._silence()

    def _pause(self) -> None:
        while self._wanted.wait() and not self._is_over:
            self._wanted.clear()
            self._silence()
            os.kill(os.getpid(), signal.SIGSTOP)
            try:
                self._listen()
            except Exception as exc:  # for `check`
                self._error = exc
                return

    def _listen(self) -> None:
        self._access = access = Access()
        for topic in self._topics:
            heard = access.hear(topic, partial(self._take, topic.name), DEPTH)
            self._decoders[topic.name] = _decoder(topic, heard.codec)

    def _silence(self) -> None:
        if self._access:
            self._access.__exit__()
            self._access = None


def _decoder(topic: Channel, codec: Codec) -> Decoder:
    return codec.decoder(topic.operation.request)


def _decoded(topics: Sequence[Channel], decoders: dict[str, Decoder], arrived: _Arrived) -> Any:
    topic = next(each for each in topics if each.name == arrived.channel)
    try:
        return json.shown(topic.operation.inputs, decoders[arrived.channel](arrived.payload))
    except DecodeError as exc:
        return f"not understood: {exc}"


def _size(payload: Payload) -> int:
    if isinstance(payload, list):
        return sum(map(_size, payload))
    return memoryview(payload).nbytes if payload is not None else 0
