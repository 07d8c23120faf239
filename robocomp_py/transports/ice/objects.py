"""Objects that clients invoke: they queue invocations and send replies."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from queue import Empty, SimpleQueue
from typing import Any

from ..base import Reply, Status
from ..leader_followers import Job
from .library import BlobjectAsync, LocalException, NoSuchObject, NoSuchOperation, Unknown, as_transport_error
from .messages import (
    LEFT,
    NOTHING,
    OBJECT,
    REPLY_HEAD,
    failed,
    failure_text,
    flag,
    is_ours,
    refusal,
    room,
    text,
    text_of,
    texts,
)

log = logging.getLogger("robocomp.transport.ice")

REQUESTS_WAITING = 10_000
OCTETS_WAITING = 256 * 1024 * 1024
"""Limits of the requests that wait to be read; further ones are refused."""

BATCH = 256
"""Maximum number of inputs that are read before their jobs run."""

Input = Callable[[], Iterable[Job]]
"""Reads one input; returns the jobs that remain."""


class Intake:
    """The queue from Ice's threads to ours: in order, and bounded."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[Input, int]] = SimpleQueue()
        self._came = self._taken = 0
        """Total bytes put and taken. Each is counted by one thread only, so neither needs a lock."""

    def put(self, take: Input, octets: int = 0) -> bool:
        """Append an input; False if the queue is full. An input with `octets` 0 is always accepted."""
        if octets:
            crowded = self._waiting.qsize() >= REQUESTS_WAITING or self._came - self._taken >= OCTETS_WAITING
            if crowded:
                return False
            self._came += octets
        self._waiting.put((take, octets))
        return True

    def receive(self, timeout: float) -> list[Job]:
        """Read all inputs; returns the jobs that remain. Reading all lets topics drop their oldest messages."""
        jobs: list[Job] = []
        try:
            take, octets = self._waiting.get(timeout=timeout)
            for left in reversed(range(BATCH)):
                self._taken += octets
                self._accept(take, jobs)
                if left:
                    take, octets = self._waiting.get_nowait()
        except Empty:
            pass
        return jobs

    def _accept(self, take: Input, jobs: list[Job]) -> None:
        try:
            jobs.extend(take())
        except Exception:
            log.exception("taking what came in")  # the other inputs are still read


class PendingReply:
    """The future reply to a request, in the form that Ice for Python expects. Any thread may end it, once."""

    __slots__ = ("_ended", "_error", "_lock", "_outstanding", "_result", "_told", "ours")

    def __init__(self, ours: bool, outstanding: set[PendingReply]) -> None:
        """`ours`: whether the client uses this package."""
        self.ours = ours
        self._lock = threading.Lock()
        self._ended = False
        self._error: Any = None
        self._result: tuple[bool, bytes] | None = None
        self._told: Callable[[PendingReply], object] | None = None
        self._outstanding = outstanding
        outstanding.add(self)

    def give(self, ok: bool, payload: bytes) -> None:
        self._end((ok, payload), None)

    def fail(self, error: Any) -> None:
        """End with an exception of Ice."""
        self._end(None, error)

    def leave(self) -> None:
        """End because the server leaves before it has answered."""
        if self.ours:
            self.give(False, refusal(LEFT, b""))
        else:
            self.fail(Unknown("its server left before it had answered"))

    def _end(self, result: tuple[bool, bytes] | None, error: Any) -> None:
        with self._lock:
            if self._ended:
                return
            self._ended, self._result, self._error = True, result, error
            told = self._told
        self._outstanding.discard(self)
        if told:
            told(self)

    # Called by Ice.

    def add_done_callback(self, told: Callable[[PendingReply], object]) -> None:
        with self._lock:
            if not self._ended:
                self._told = told
                return
        told(self)

    def result(self) -> tuple[bool, bytes]:
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result


class Invocation:
    """An invocation that has arrived."""

    __slots__ = ("_answer", "_limit", "context", "operation", "payload")

    def __init__(
        self, operation: str, payload: bytes, context: Mapping[str, str], answer: PendingReply | None, limit: int
    ) -> None:
        self.operation, self.payload, self.context = operation, payload, context
        self._answer, self._limit = answer, limit

    @property
    def oneway(self) -> bool:
        """Whether the client expects no reply."""
        return self._answer is None

    def reply(self, reply: Reply) -> None:
        """Send the reply in the form that the client understands. Without effect if it was answered already."""
        if self._answer is None:
            return
        status, payload = reply
        if payload and len(payload) > (most := room(self.context, self._limit) - REPLY_HEAD):
            status, payload = failed("TransportError", f"the reply has {len(payload)} bytes; the client accepts {most}")
        if status is Status.OK or status is Status.THROWN:
            self._answer.give(status is Status.OK, payload)
        elif self._answer.ours:
            self._answer.give(False, refusal(status, payload or b""))
        elif status is Status.FAILED:
            self._answer.fail(Unknown(failure_text(payload)))
        elif status is Status.REFUSED:
            self._answer.fail(NoSuchObject())
        else:
            self._answer.fail(Unknown(_WORDS[status]))

    def not_served(self) -> None:
        """Report that this object has no such operation."""
        if self._answer is not None:
            self._answer.fail(NoSuchOperation())

    def leave(self) -> None:
        """Report that the server leaves before it has answered."""
        if self._answer is not None:
            self._answer.leave()


_WORDS = {
    Status.BUSY: "too many requests wait",
    Status.EXPIRED: "the deadline passed before the request was executed",
    Status.MISMATCH: "client and server have different contracts of the operation",
}


Take = Callable[[Invocation], Iterable[Job]]
"""Called on the receiving thread, for one invocation after the other, in order."""


class Port:
    """An object, and the adapter that makes it reachable."""

    def __init__(
        self,
        communicator: Any,
        name: str,
        identity: str,
        endpoints: str,
        ids: Callable[[], Iterable[str]],
        intake: Intake,
        limit: int,
        take: Take,
    ) -> None:
        """`name` is the adapter's, and unique. Without `endpoints`, the system chooses a port. `ids` returns the
        object's interfaces, as Ice names them."""
        self._outstanding: set[PendingReply] = set()
        endpoints = endpoints or "tcp"
        host = communicator.getProperties().getProperty("Ice.Default.Host")
        where = f"listening at {endpoints!r}{'' if '-h ' in endpoints else f' of {host}'} for {identity}"
        with as_transport_error(where):
            self._adapter = communicator.createObjectAdapterWithEndpoints(name, endpoints)
        try:
            with as_transport_error(where):
                named = communicator.stringToIdentity(identity)
                servant = _Servant((named.category, named.name), ids, intake, limit, take, self._outstanding)
                self._adapter.add(servant, named)
                self._adapter.addDefaultServant(_ByAnyFacet(servant), "")
                self._adapter.activate()
                self.proxy: str = communicator.proxyToString(self._adapter.createProxy(named))
        except BaseException:
            self._adapter.destroy()
            raise

    def close(self) -> None:
        """Stop listening, and end all unanswered requests. Must not be called on one of Ice's threads."""
        self._adapter.deactivate()  # first, so that no more invocations arrive
        for answer in list(self._outstanding):
            answer.leave()
        with contextlib.suppress(LocalException):  # the communicator is destroyed already
            self._adapter.destroy()


class _Servant(BlobjectAsync):  # type: ignore[misc]  # Ice has no types
    """Queues invocations. Called on Ice's threads."""

    def __init__(
        self,
        identity: tuple[str, str],
        ids: Callable[[], Iterable[str]],
        intake: Intake,
        limit: int,
        take: Take,
        outstanding: set[PendingReply],
    ) -> None:
        self.identity = identity
        self._ids, self._intake, self._limit, self._take, self._outstanding = ids, intake, limit, take, outstanding

    def ice_invoke(self, payload: bytes, current: Any) -> PendingReply | tuple[bool, bytes]:
        operation: str = current.operation
        if operation.startswith("ice_"):
            return self._about_itself(operation, payload)
        context: Mapping[str, str] = current.ctx
        answer = PendingReply(is_ours(context), self._outstanding) if current.requestId else None
        invocation = Invocation(operation, payload, context, answer, self._limit)
        if not self._intake.put(lambda: self._take(invocation), len(payload)):
            invocation.reply(Reply(Status.BUSY))
        return answer or (True, NOTHING)

    def _about_itself(self, operation: str, payload: bytes) -> tuple[bool, bytes]:
        """Answer the operations that every Ice object has."""
        ids = sorted({*self._ids(), OBJECT})
        match operation:
            case "ice_ping":
                return True, NOTHING
            case "ice_isA":
                return True, flag(text_of(payload) in ids)
            case "ice_id":
                return True, text(next((each for each in ids if each != OBJECT), OBJECT))
            case "ice_ids":
                return True, texts(ids)
        raise NoSuchOperation()


class _ByAnyFacet(BlobjectAsync):  # type: ignore[misc]  # Ice has no types
    """Receives invocations with another identity or with a facet; our objects ignore facets."""

    def __init__(self, servant: _Servant) -> None:
        self._servant = servant

    def ice_invoke(self, payload: bytes, current: Any) -> PendingReply | tuple[bool, bytes]:
        if (current.id.category, current.id.name) != self._servant.identity:
            raise NoSuchObject()
        return self._servant.ice_invoke(payload, current)
