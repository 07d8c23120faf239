"""Repeated requests and their replies: a client repeats a request of an idempotent operation if it may not have
arrived.

    client    uses one number for a request, however often it is sent (`Numbered`)
    server    a new request: executes it and keeps the reply; one that is being executed: sends the reply to the latest
              repetition; one that has a reply: sends the kept reply again
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
"""Maximum number of replies that are kept per client."""

CLIENTS = 1024

OCTETS = 16 * 1024 * 1024
"""Maximum octets of all replies. Without its reply a repeated request is executed again, which is harmless."""

LARGEST = 1024 * 1024
"""A larger reply is not kept."""

_UNDER_WAY = 10_000

Answer = Callable[[Reply], object]

RequestId = tuple[int, int]
"""A client, and its number for the request."""


class Replies:
    """The replies of one server. Safe to use from any thread."""

    def __init__(self, kept: int = KEPT, octets: int = OCTETS) -> None:
        self._most, self._most_octets = kept, octets
        self._lock = threading.Lock()
        self._kept: OrderedDict[int, OrderedDict[int, Reply]] = OrderedDict()
        """By client; the one that got the latest reply is the last."""
        self._octets = 0
        self._under_way: OrderedDict[RequestId, Answer] = OrderedDict()

    def begin(self, request: RequestId, answer: Answer) -> Answer:
        """Note that a request will be executed; returns the function to call with its reply."""
        with self._lock:
            self._under_way[request] = answer
            if len(self._under_way) > _UNDER_WAY:  # some never get a reply
                self._under_way.popitem(last=False)

        def keep_and_answer(reply: Reply) -> None:
            self.keep(request, reply)  # first, so that a repetition at this moment finds the request or its reply
            with self._lock:
                latest = self._under_way.pop(request, answer)
            latest(reply)

        return keep_and_answer

    def repeat(self, request: RequestId, answer: Answer) -> Callable[[], object] | None:
        """What to do about a repeated request; None if it is not known any more."""
        with self._lock:
            if request in self._under_way:
                self._under_way[request] = answer
                return _nothing
        reply = self.find(request)
        return None if reply is None else lambda: answer(reply)

    def keep(self, request: RequestId, reply: Reply) -> None:
        client, number = request
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

    def find(self, request: RequestId) -> Reply | None:
        client, number = request
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
    """A `Question` of a caller that numbers its requests."""

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
