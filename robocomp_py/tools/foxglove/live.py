"""Serves topics to Foxglove over a websocket on this host: each as it is recorded, and beside it what panels draw."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import foxglove

from ...closing import Closing
from ...errors import DecodeError, EncodeError, TransportError
from ...threads import start_thread
from ...wire.cdr import Cdr
from ...wire.codec import Payload
from ..recording.layout import Topic
from .convert import converters, frame_of

log = logging.getLogger("robocomp.tools")

HOST = "127.0.0.1"

WAITING = 200
"""Messages that may wait to be sent; those of a topic beyond that are dropped, and counted."""


class Track:
    """A topic that is shown. `put` may be called by any thread, and never waits."""

    def __init__(self, bridge: Bridge, topic: Topic, convert: Callable[[Payload], bytes | memoryview]) -> None:
        self.topic, self.convert, self._bridge = topic, convert, bridge
        self.received = self.dropped = self.malformed = self.written = 0
        self.channel = bridge.advertise(topic)
        self._decode = Cdr().decoder(topic.operation.request)
        self._converters = list(converters(topic.operation))
        self._frame = frame_of(topic.name)
        self._shown = {kind: self._advertised(kind) for _, each in self._converters for kind in each.kinds}

    def put(self, payload: Payload, stamp: int = 0, sequence: int = 0) -> None:
        """A message has arrived. `stamp` is when it was sent, in ns since 1970; 0 if that is not known."""
        self.received += 1
        self._bridge.put(_Waiting(self, payload, stamp or time.time_ns()))

    def show(self, payload: Payload, stamp: int) -> None:
        """Publish it to its subscribers, on the thread that calls."""
        try:
            data = bytes(self.convert(payload))
            values = self._decode(data) if self._converters else ()
        except (DecodeError, EncodeError):
            self.malformed += 1
            return
        self.channel.log(data, log_time=stamp)
        for number, each in self._converters:
            if (message := each.convert(values[number], stamp, self._frame)) is not None:
                self._shown[type(message)].log(message.encode(), log_time=stamp)
        self.written += 1

    def _advertised(self, kind: Any) -> foxglove.Channel:
        """At once, and not with the first message: a client that subscribes within milliseconds would be refused."""
        return self._bridge.channel(f"{self.topic.in_file}/{kind.__name__}", "protobuf", kind.get_schema())


class _Waiting(NamedTuple):
    track: Track
    payload: Payload
    stamp: int


class Bridge(Closing):
    """A server for Foxglove, and the thread that feeds it. Closing it ends both."""

    def __init__(self, name: str, port: int) -> None:
        """Serves on loopback at this port, 0 for any. Raises TransportError if it is taken."""
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(name=name, host=HOST, port=port, context=self._context)
        except (OSError, RuntimeError, ValueError) as exc:
            raise TransportError(f"port {port} of {HOST} cannot be served: {exc}; choose another one") from exc
        self._channels: list[foxglove.Channel] = []
        self._waiting: queue.Queue[_Waiting] = queue.Queue(WAITING)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="foxglove", daemon=True)
        start_thread(self._thread)

    @property
    def address(self) -> str:
        return f"ws://{HOST}:{self._server.port}"

    def track(self, topic: Topic, convert: Callable[[Payload], bytes | memoryview]) -> Track:
        """A further topic. `convert` makes standard CDR of its payloads; the thread that sends calls it."""
        return Track(self, topic, convert)

    def advertise(self, topic: Topic) -> foxglove.Channel:
        schema = topic.schema("ros2msg")
        made = foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.text.encode())
        return self.channel(topic.in_file, "cdr", made)

    def channel(self, topic: str, encoding: str, schema: foxglove.Schema) -> foxglove.Channel:
        made = foxglove.Channel(topic, schema=schema, message_encoding=encoding, context=self._context)
        self._channels.append(made)
        return made

    def put(self, message: _Waiting) -> None:
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(message)
            return
        message.track.dropped += 1

    def close(self) -> None:
        """Idempotent. Messages that wait are discarded."""
        self._is_over.set()
        if self._thread.ident:
            self._thread.join()
        while self._channels:
            self._channels.pop().close()
        with contextlib.suppress(RuntimeError):  # it has ended already
            self._server.stop()

    def _run(self) -> None:
        while not self._is_over.is_set():
            try:
                message = self._waiting.get(timeout=0.1)
            except queue.Empty:
                continue
            try:
                message.track.show(message.payload, message.stamp)
            except Exception:
                log.exception("%s cannot be shown", message.track.topic.name)
