"""Sending and receiving through Zenoh: destinations, callbacks, the queue that they fill, and replies."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from ...wire.codec import Payload
from ..unsafe import keep_thread_state

BLOCK, DROP = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
SMALL = 32 * 1024
"""Bytes, half a Zenoh batch: requests and replies up to this size overtake larger ones and publications."""

DATA, URGENT = zenoh.Priority.DATA, zenoh.Priority.INTERACTIVE_HIGH
NO_CONSOLIDATION = zenoh.ConsolidationMode.NONE


def direct(callback: Callable[[Any], object], over: Callable[[], object] | None = None) -> Any:
    """A callback that runs on Zenoh's own thread; `over` is called when no more messages will come."""

    def call(message: Any) -> None:
        if not hasattr(_thread_state, "kept"):
            keep_thread_state()
            _thread_state.kept = True
        callback(message)

    return zenoh.handlers.Callback(call, over, indirect=False)


_thread_state = threading.local()
"""Whether a thread of Zenoh's keeps its Python state. Python would otherwise create and destroy it, with its memory, at
each callback (25 µs)."""


class Message(NamedTuple):
    attachment: Any
    payload: Any
    arrived: float = 0.0


def put(session: zenoh.Session, key: str, header: bytes | None, payload: Payload) -> None:
    """Send a message that must arrive; small ones overtake large ones. Raises ZError."""
    priority = URGENT if len(payload) <= SMALL else DATA
    session.put(key, payload, attachment=header, congestion_control=BLOCK, priority=priority, express=True)


class Destination:
    """A link that gets many messages, which must arrive: a publisher declared once sends them."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._session, self.key = session, key
        self._publisher = session.declare_publisher(key, congestion_control=BLOCK, priority=URGENT, express=True)

    def put(self, header: bytes, payload: Payload, *, in_order: bool = False) -> None:
        """Send; small messages overtake large ones unless `in_order`. Raises ZError."""
        if in_order or len(payload) <= SMALL:
            self._publisher.put(payload, attachment=header)
        else:
            put(self._session, self.key, header, payload)


class BoundedQueue:
    """Bounded queue from Zenoh's callbacks to our threads."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: deque[Any] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, item: Any) -> bool:
        """Append an item; False if the queue is full."""
        if len(self._waiting) >= self._capacity:
            return False
        self._waiting.append(item)
        return True

    def get(self) -> Any:
        return self._waiting.popleft()


class QueryReplier:
    """Replies to a Zenoh query, until it is closed."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query

    def reply(self, header: bytes, payload: Payload) -> None:
        self._query.reply(self._query.key_expr, payload or b"", attachment=header)

    def close(self) -> None:
        """Tell the client that no further reply will come."""
        self._query.drop()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


class MessageReplier:
    """Replies, by a message, to a request that came as a message."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._session, self._key = session, key

    def reply(self, header: bytes, payload: Payload) -> None:
        put(self._session, self._key, header, payload or b"")

    def close(self) -> None: ...


def octets(attachment: Any) -> bytes:
    return attachment.to_bytes() if attachment is not None else b""
