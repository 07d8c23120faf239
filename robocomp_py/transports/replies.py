"""Requests that are repeated, and what was answered to them: those of idempotent operations, which are asked again
when it is not known whether they arrived.

    client    one number for a question, however often it is asked (`Numbered`)
    server    new: executed, its reply is kept; under way: the reply goes to where it was last asked for; answered
              before: answered from what was kept
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol

from ..wire.codec import Payload
from .base import Reply

KEPT = 256
"""The last replies to a client that are kept."""

CLIENTS = 1024

OCTETS = 16 * 1024 * 1024
"""Of all replies together. What is forgotten is executed again when it is asked again, which does no harm."""

LARGEST = 1024 * 1024
"""A larger reply is not kept."""

_UNDER_WAY = 10_000

Answer = Callable[[Reply], object]

Asked = tuple[int, int]
"""A client, and its number for the question."""


class Replies:
    """Of one server. Safe to use from any thread."""

    def __init__(self, kept: int = KEPT, octets: int = OCTETS) -> None:
        self._most, self._most_octets = kept, octets
        self._lock = threading.Lock()
        self._kept: OrderedDict[int, OrderedDict[int, Reply]] = OrderedDict()
        """By client; who was answered last stands last."""
        self._octets = 0
        self._under_way: OrderedDict[Asked, Answer] = OrderedDict()

    def begun(self, asked: Asked, answer: Answer) -> Answer:
        """A request is going to be executed; what is to be called with its reply."""
        with self._lock:
            self._under_way[asked] = answer
            if len(self._under_way) > _UNDER_WAY:  # some are never answered
                self._under_way.popitem(last=False)

        def answered(reply: Reply) -> None:
            self.keep(asked, reply)  # first: who asks again just now finds it under way, or answered
            with self._lock:
                where = self._under_way.pop(asked, answer)
            where(reply)

        return answered

    def again(self, asked: Asked, answer: Answer) -> Callable[[], object] | None:
        """A request was repeated: what is to be done about it. None if nothing is known of it any more."""
        with self._lock:
            if asked in self._under_way:
                self._under_way[asked] = answer
                return _nothing
        reply = self.find(asked)
        return None if reply is None else lambda: answer(reply)

    def keep(self, asked: Asked, reply: Reply) -> None:
        client, number = asked
        size = _size(reply.payload)
        if size > LARGEST:
            return
        with self._lock:
            replies = self._kept.setdefault(client, OrderedDict())
            self._kept.move_to_end(client)
            before = replies.pop(number, None)  # it was executed twice
            replies[number] = reply
            self._octets += size - (_size(before.payload) if before else 0)
            if len(replies) > self._most:
                self._forget(replies)
            while len(self._kept) > CLIENTS or self._octets > self._most_octets:
                oldest = next(iter(self._kept))
                self._forget(self._kept[oldest])
                if not self._kept[oldest]:
                    del self._kept[oldest]

    def find(self, asked: Asked) -> Reply | None:
        client, number = asked
        with self._lock:
            replies = self._kept.get(client)
            return replies.get(number) if replies else None

    def _forget(self, replies: OrderedDict[int, Reply]) -> None:
        _, reply = replies.popitem(last=False)
        self._octets -= _size(reply.payload)


class _Numbering(Protocol):
    def ask(self, payload: Payload, deadline: float, number: int) -> Reply: ...

    def call(self, payload: Payload, deadline: float, number: int) -> Future[Reply]: ...


class Numbered:
    """A `Question` of a caller whose questions are known by a number."""

    def __init__(self, caller: _Numbering, payload: Payload, number: int) -> None:
        self._caller, self._payload, self._number = caller, payload, number

    def ask(self, deadline: float) -> Reply:
        return self._caller.ask(self._payload, deadline, self._number)

    def call(self, deadline: float) -> Future[Reply]:
        return self._caller.call(self._payload, deadline, self._number)

    def close(self) -> None: ...


def _size(payload: Payload) -> int:
    if payload is None:
        return 0
    if isinstance(payload, list):
        return sum(map(len, payload))
    size = getattr(payload, "size", None)
    return size if isinstance(size, int) else len(payload)


def _nothing() -> None: ...
