"""Objects that others invoke: what comes in, and how it is answered."""

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
"""Of requests that nobody has taken yet; further ones are turned away."""

BATCH = 256
"""So many are taken before anything is done about them."""

Input = Callable[[], Iterable[Job]]
"""Takes what came in, and tells what is left to be done about it."""


class Intake:
    """What Ice's threads leave for the crew: in order, and bounded."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[Input, int]] = SimpleQueue()
        self._came = self._taken = 0
        """Octets. The first is counted by one thread, the second by another, so neither needs a lock."""

    def put(self, take: Input, octets: int = 0) -> bool:
        """Whether there was room. What has no octets always finds some."""
        if octets:
            crowded = self._waiting.qsize() >= REQUESTS_WAITING or self._came - self._taken >= OCTETS_WAITING
            if crowded:
                return False
            self._came += octets
        self._waiting.put((take, octets))
        return True

    def receive(self, timeout: float) -> list[Job]:
        """What is left to be done about what has come in: all of it, since of topics what is old is to be given up."""
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
            log.exception("taking what came in")  # the rest is taken all the same


class Answer:
    """What a request is going to be answered: a future, as Ice for Python wants it. Ended once, by any thread."""

    __slots__ = ("_ended", "_error", "_lock", "_outstanding", "_result", "_told", "ours")

    def __init__(self, ours: bool, outstanding: set[Answer]) -> None:
        """`ours` is whether one of ours waits for it."""
        self.ours = ours
        self._lock = threading.Lock()
        self._ended = False
        self._error: Any = None
        self._result: tuple[bool, bytes] | None = None
        self._told: Callable[[Answer], object] | None = None
        self._outstanding = outstanding
        outstanding.add(self)

    def give(self, ok: bool, payload: bytes) -> None:
        self._end((ok, payload), None)

    def fail(self, error: Any) -> None:
        """By one of Ice's exceptions."""
        self._end(None, error)

    def leave(self) -> None:
        """It is not going to be answered: by who leaves."""
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

    # By Ice, which passes on what it is told.

    def add_done_callback(self, told: Callable[[Answer], object]) -> None:
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


class Arrived:
    """An invocation that came in."""

    __slots__ = ("_answer", "_limit", "context", "operation", "payload")

    def __init__(
        self, operation: str, payload: bytes, context: Mapping[str, str], answer: Answer | None, limit: int
    ) -> None:
        self.operation, self.payload, self.context = operation, payload, context
        self._answer, self._limit = answer, limit

    @property
    def oneway(self) -> bool:
        """Whether nobody waits for an answer."""
        return self._answer is None

    def reply(self, reply: Reply) -> None:
        """Answer it, in the way in which those who sent it understand. Without effect if it was answered."""
        if self._answer is None:
            return
        status, payload = reply
        if payload and len(payload) > (most := room(self.context, self._limit) - REPLY_HEAD):
            status, payload = failed("TransportError", f"the answer has {len(payload)} octets; {most} are allowed")
        if status is Status.OK or status is Status.THROWN:
            self._answer.give(status is Status.OK, payload)
        elif self._answer.ours:
            self._answer.give(False, refusal(status, payload or b""))
        elif status is Status.FAILED:
            self._answer.fail(Unknown(failure_text(payload)))
        elif status is Status.REFUSED:
            self._answer.fail(NoSuchObject())
        else:
            self._answer.fail(Unknown(_PLAINLY[status]))

    def not_served(self) -> None:
        """There is no such operation here."""
        if self._answer is not None:
            self._answer.fail(NoSuchOperation())

    def leave(self) -> None:
        """It will not be answered any more."""
        if self._answer is not None:
            self._answer.leave()


_PLAINLY = {
    Status.BUSY: "too many calls wait here",
    Status.EXPIRED: "its deadline was over before it was executed",
    Status.MISMATCH: "this was generated from another definition of the operation",
}


Take = Callable[[Arrived], Iterable[Job]]
"""Called on the thread that receives, for one invocation after the other, as they came in."""


class Port:
    """An object, and the adapter through which it is reached."""

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
        """`name` is the adapter's, and nobody else's. No `endpoints` is where there is room. `ids` tells which
        interfaces the object has, as Ice names them."""
        self._outstanding: set[Answer] = set()
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
        """Stop listening, whatever was not answered is told so. Not on one of Ice's threads."""
        self._adapter.deactivate()  # first: nothing comes in any more
        for answer in list(self._outstanding):
            answer.leave()
        with contextlib.suppress(LocalException):  # the communicator is destroyed already
            self._adapter.destroy()


class _Servant(BlobjectAsync):  # type: ignore[misc]  # Ice has no types
    """Called on a thread of Ice's: passes on what came in, and does nothing about it."""

    def __init__(
        self,
        identity: tuple[str, str],
        ids: Callable[[], Iterable[str]],
        intake: Intake,
        limit: int,
        take: Take,
        outstanding: set[Answer],
    ) -> None:
        self.identity = identity
        self._ids, self._intake, self._limit, self._take, self._outstanding = ids, intake, limit, take, outstanding

    def ice_invoke(self, payload: bytes, current: Any) -> Answer | tuple[bool, bytes]:
        operation: str = current.operation
        if operation.startswith("ice_"):
            return self._about_itself(operation, payload)
        context: Mapping[str, str] = current.ctx
        answer = Answer(is_ours(context), self._outstanding) if current.requestId else None
        arrived = Arrived(operation, payload, context, answer, self._limit)
        if not self._intake.put(lambda: self._take(arrived), len(payload)):
            arrived.reply(Reply(Status.BUSY))
        return answer or (True, NOTHING)

    def _about_itself(self, operation: str, payload: bytes) -> tuple[bool, bytes]:
        """What all objects are asked by Ice itself."""
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
    """What has another name than the object, or names a facet of it: an object of ours is the same by any facet."""

    def __init__(self, servant: _Servant) -> None:
        self._servant = servant

    def ice_invoke(self, payload: bytes, current: Any) -> Answer | tuple[bool, bytes]:
        if (current.id.category, current.id.name) != self._servant.identity:
            raise NoSuchObject()
        return self._servant.ice_invoke(payload, current)
