"""What goes through Zenoh: messages, questions, and the callbacks that take them in."""

from __future__ import annotations

import ctypes
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import zenoh

from ...wire.codec import Payload

if TYPE_CHECKING:
    from .transport import ZenohTransport


BLOCK, DROP = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
SMALL = 32 * 1024
"""Up to so many bytes, calls and answers overtake what is larger, and publications: half a batch of Zenoh's."""

DATA, URGENT = zenoh.Priority.DATA, zenoh.Priority.INTERACTIVE_HIGH
NO_CONSOLIDATION = zenoh.ConsolidationMode.NONE


def direct(callback: Callable[[Any], object], over: Callable[[], object] | None = None) -> Any:
    """A callback that Zenoh calls itself, without a thread of Python's for each, and `over` when no more will come."""

    def call(message: Any) -> None:
        if not hasattr(_thread_state, "kept"):
            _thread_state.kept = ctypes.pythonapi.PyGILState_Ensure()
        callback(message)

    return zenoh.handlers.Callback(call, over, indirect=False)


_thread_state = threading.local()
"""Python does not know Zenoh's threads, and would make a state for them at each callback, and destroy it afterwards,
mapping and unmapping memory: 25 µs. Entered once more than left, a thread keeps the one it has."""


class Message(NamedTuple):
    attachment: Any
    payload: Any
    arrived: float = 0.0


class Way:
    """To one that is sent many messages, which must arrive: what is the same in all of them is declared once."""

    def __init__(self, transport: ZenohTransport, key: str) -> None:
        self._transport, self.key = transport, key
        declare = transport.session.declare_publisher
        self._publisher = declare(key, congestion_control=BLOCK, priority=URGENT, express=True)

    def put(self, header: bytes, payload: Payload, *, in_order: bool = False) -> None:
        """What is small before what is large, unless it has to stay in order. Raises ZError."""
        if in_order or len(payload) <= SMALL:
            self._publisher.put(payload, attachment=header)
        else:
            self._transport.put(self.key, header, payload)


class Inbox:
    """What callbacks leave for the crew, bounded."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: deque[Any] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, item: Any) -> bool:
        """Whether there was room."""
        if len(self._waiting) >= self._capacity:
            return False
        self._waiting.append(item)
        return True

    def put_back(self, items: list[Any]) -> None:
        """Let these come first."""
        self._waiting.extendleft(reversed(items))

    def get(self) -> Any:
        return self._waiting.popleft()


class Query:
    """A question of Zenoh's, answered at most until it is closed."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query

    def reply(self, header: bytes, payload: Payload) -> None:
        self._query.reply(self._query.key_expr, payload or b"", attachment=header)

    def close(self) -> None:
        """Tell who asked that nothing more will come."""
        self._query.drop()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


class Sender:
    """Who asked by a message, and gets the answer as one."""

    def __init__(self, transport: ZenohTransport, line: int) -> None:
        self._transport, self._line = transport, line

    def reply(self, header: bytes, payload: Payload) -> None:
        self._transport.put(self._transport.address("rc_to", self._line), header, payload or b"")

    def close(self) -> None: ...


def octets(attachment: Any) -> bytes:
    return attachment.to_bytes() if attachment is not None else b""
