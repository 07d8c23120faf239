"""What we need of Cyclone DDS: a domain per process, readers and writers of bytes, waiting, and who is there.

Samples go through the library as the bytes they are on the wire. Listeners are never used (they run
on the library's threads and may wait for the interpreter's lock holding one of their own); one
thread waits for everything in `Loop.receive`. No call here waits while it holds the interpreter,
except a small sample written to a writer that is full, for `BLOCKING_MS`.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from math import inf
from time import monotonic
from typing import Any

from cyclonedds._clayer import (  # type: ignore[import-not-found]  # compiled, without types
    ddspy_take,
    ddspy_write,
)
from cyclonedds.core import DDSException, Entity, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic

from ...errors import TransportError
from ..leader_followers import Job
from .domain import any_open, close_domain, open_domain
from .endpoints import Endpoints
from .library import (
    ANY,
    FOREVER,
    LARGE,
    POLICIES,
    TIMEOUT,
    Container,
    IncompatibleQos,
    LivelinessChanged,
    as_transport_error,
    checked,
    creating,
    dds_create_guardcondition,
    dds_create_readcondition,
    dds_create_waitset,
    dds_delete,
    dds_dispose,
    dds_get_liveliness_changed_status,
    dds_get_matched_publications,
    dds_get_matched_subscriptions,
    dds_get_offered_incompatible_qos_status,
    dds_get_requested_incompatible_qos_status,
    dds_set_guardcondition,
    dds_waitset_attach,
    dds_waitset_detach,
    dds_waitset_wait,
    dds_write,
    forget,
)
from .types import DdsType

log = logging.getLogger("robocomp.transport.dds")


class Bus:
    """A participant: what one transport has of the library. `close` leaves nothing of it."""

    def __init__(self, domain: int, interface: str, peers: tuple[str, ...] = (), many: bool = False) -> None:
        self._domain = domain
        self.lost = False
        """Whether it belongs to the process we were forked from."""
        self.on_loss: Callable[[], None] = lambda: None
        _check_that_we_were_not_forked()
        open_domain(domain, interface, peers, many)
        with contextlib.ExitStack() as undo:
            undo.callback(close_domain, domain)
            with creating, as_transport_error("joining the domain"):
                self.participant = DomainParticipant(domain)
            undo.callback(forget, self.participant)
            self.loop = Loop(self.participant._ref)
            undo.callback(self.loop.close)
            self.endpoints = Endpoints(self.participant, self.loop)
            undo.pop_all()
        _buses.add(self)

    def writer(self, topic: str, kind: DdsType, qos: Qos, partition: str = "") -> Writer:
        with creating, as_transport_error(f"writing {topic}"):
            made = Topic(self.participant, topic, kind)
            parent = Publisher(self.participant, _partition(partition)) if partition else self.participant
            return Writer(DataWriter(parent, made, qos), parent if partition else None, made)

    def reader(self, topic: str, kind: DdsType, qos: Qos, partition: str = "") -> Reader:
        with creating, as_transport_error(f"reading {topic}"):
            made = Topic(self.participant, topic, kind)
            parent = Subscriber(self.participant, _partition(partition)) if partition else self.participant
            return Reader(DataReader(parent, made, qos), parent if partition else None, made)

    def waiting(self) -> Waiting:
        return Waiting(self.participant._ref)

    def lose(self) -> None:
        self.lost = True
        self.on_loss()

    def close(self) -> None:
        if self.lost:
            return
        self.loop.close()
        forget(self.participant)
        close_domain(self._domain)


def _partition(name: str) -> Qos:
    return Qos(Policy.Partition((name,)))


class _End:
    """A reader or writer."""

    _matched: Callable[..., int]
    _incompatible: Callable[..., int]

    def __init__(self, entity: Entity, parent: Entity | None, topic: Topic[Any]) -> None:
        self._entity, self._parent, self._topic = entity, parent, topic
        self._status = IncompatibleQos()
        self.ref = entity._ref

    def matched(self) -> set[int]:
        """The handles of those on the other side that hear or are heard by us."""
        room = 16
        while True:
            found = (ctypes.c_uint64 * room)()
            count = type(self)._matched(self.ref, found, room)
            if count <= room:
                return set(found[: max(count, 0)])
            room = count * 2

    def unmet(self) -> str:
        """The policy for which another one on the other side, whoever it is, does not hear or is not heard; or ""."""
        status = self._status
        if type(self)._incompatible(self.ref, ctypes.byref(status)) or status.change <= 0:
            return ""
        return POLICIES.get(status.policy, f"QoS policy {status.policy}")

    def close(self) -> None:
        forget(self._entity)
        if self._parent is not None:
            forget(self._parent)
        forget(self._topic)


class Writer(_End):
    """What is sent. Small samples are written holding the interpreter, since that is quicker than to let it go."""

    _matched = staticmethod(dds_get_matched_subscriptions)
    _incompatible = staticmethod(dds_get_offered_incompatible_qos_status)

    def write(self, sample: bytearray | bytes | memoryview) -> bool:
        """Whether it was written; if not, there is no room now. Safe to use from any thread."""
        code = ddspy_write(self.ref, sample) if len(sample) < LARGE else self._write_aside(sample)
        return not code or self._written(code)

    def write_within(self, sample: bytearray | bytes | memoryview, end: float, still: Callable[[], None]) -> bool:
        """Write, trying until `end`; `still` is called meanwhile, and may raise."""
        while not self._written(self._write_aside(sample)):
            still()
            if time.monotonic() >= end:
                return False
            time.sleep(0.002)
        return True

    def greet(self, sample: bytes) -> bool:
        """Send no data, only the news that the topic's one instance was disposed of; whether there was room for it.

        The content of the sample does not matter. A reader is told which writer that was.
        """
        held = ctypes.c_char_p(sample)
        container = Container(ctypes.cast(held, ctypes.c_void_p), len(sample))
        return self._written(dds_dispose(self.ref, ctypes.byref(container)))

    def _written(self, code: int) -> bool:
        if code and code != TIMEOUT:
            raise TransportError(f"dds: writing: {DDSException(code)}")
        return not code

    def _write_aside(self, sample: bytearray | bytes | memoryview) -> int:
        """Write while other threads run."""
        size = len(sample)
        if memoryview(sample).readonly:
            held: Any = ctypes.c_char_p(bytes(sample))
            container = Container(ctypes.cast(held, ctypes.c_void_p), size)
        else:
            held = (ctypes.c_char * size).from_buffer(sample)
            container = Container(ctypes.addressof(held), size)
        code = dds_write(self.ref, ctypes.byref(container))
        del held
        return code


class Reader(_End):
    _matched = staticmethod(dds_get_matched_publications)
    _incompatible = staticmethod(dds_get_requested_incompatible_qos_status)

    def __init__(self, entity: Entity, parent: Entity | None, topic: Topic[Any]) -> None:
        super().__init__(entity, parent, topic)
        self.condition = checked(dds_create_readcondition(self.ref, ANY), "waiting for samples")
        self._liveliness = LivelinessChanged()

    def alive(self) -> bool:
        """Whether a writer that is heard has shown in time that it lives."""
        status = self._liveliness
        return dds_get_liveliness_changed_status(self.ref, ctypes.byref(status)) == 0 and status.alive > 0

    def take(self, most: int) -> list[tuple[bytes, Any]]:
        """What came in, at most so many samples, each with what the library says about it.

        Among that is `valid_data`, without which it is no sample but the news that a writer left.
        """
        taken: list[tuple[bytes, Any]] | int = ddspy_take(self.ref, ANY, most)
        return taken if type(taken) is list else []  # a number if the reader was closed

    def close(self) -> None:
        dds_delete(self.condition)
        super().close()


class Waiting:
    """Waits for conditions; any thread may end that by `wake`."""

    MOST = 64

    def __init__(self, participant: int) -> None:
        self._set = checked(dds_create_waitset(participant), "waiting")
        self._guard = checked(dds_create_guardcondition(participant), "waiting")
        checked(dds_waitset_attach(self._set, self._guard, self._guard), "waiting")
        self._found = (ctypes.c_ssize_t * self.MOST)()
        self._timeout = ctypes.c_int64()
        # Made once, for to convert them at each call takes as long as all the rest of it.
        self._arguments = (
            ctypes.c_int32(self._set),
            ctypes.c_void_p(ctypes.addressof(self._found)),
            ctypes.c_size_t(self.MOST),
            self._timeout,
        )
        self.closed = False

    def attach(self, condition: int) -> None:
        dds_waitset_attach(self._set, condition, condition)

    def detach(self, condition: int) -> None:
        dds_waitset_detach(self._set, condition)

    def wake(self) -> None:
        dds_set_guardcondition(self._guard, True)

    def wait(self, timeout: float) -> Sequence[int]:
        """The conditions that hold, at the latest after `timeout` seconds. For one thread at a time."""
        self._timeout.value = int(timeout * 1e9) if timeout < 1e9 else FOREVER
        count = dds_waitset_wait(*self._arguments)
        if count == 1:
            first = self._found[0]
            if first != self._guard:
                return (first,)
        if count <= 0:
            if count < 0 and not self.closed:
                raise TransportError(f"dds: waiting: {DDSException(count)}")
            return ()
        found = self._found[: min(count, self.MOST)]
        if self._guard in found:
            dds_set_guardcondition(self._guard, False)
            found.remove(self._guard)
        return found

    def close(self) -> None:
        self.closed = True
        dds_delete(self._set)
        dds_delete(self._guard)


class Loop:
    """Waits for samples on all readers at once, and for what is due. `receive` is for one thread at a time."""

    def __init__(self, participant: int) -> None:
        self._waiting = Waiting(participant)
        self._inputs: dict[int, Callable[[], Iterable[Job]]] = {}
        self._jobs: deque[Job] = deque()
        self._next_tick, self._woken, self._sleeping = 0.0, False, False
        self.tick: Callable[[], float] = lambda: float("inf")
        """Does what is due; returns the time of the next one."""

    def attach(self, condition: int, on_input: Callable[[], Iterable[Job]]) -> None:
        self._inputs[condition] = on_input
        self._waiting.attach(condition)

    def detach(self, condition: int) -> None:
        if self._inputs.pop(condition, None):
            self._waiting.detach(condition)

    def do(self, job: Job) -> None:
        """Return this job next. From any thread."""
        self._jobs.append(job)
        if self._sleeping:
            self._waiting.wake()

    def wake(self) -> None:
        """Tick now."""
        self._woken = True
        self._waiting.wake()

    def due(self, when: float) -> None:
        """Tick at that time, or before."""
        if when < self._next_tick:
            self.wake()

    def receive(self) -> Iterable[Job]:
        now = monotonic()
        if self._woken or now >= self._next_tick:
            self._woken, self._next_tick = False, inf  # before looking: what becomes due while we look is not missed
            self._next_tick = self.tick()
        added = self._jobs
        self._sleeping = True  # before looking at the jobs: whoever adds one later sees this, and wakes us
        patience = self._next_tick - now
        ready = self._waiting.wait(0.0 if added or patience < 0.0 else patience)
        self._sleeping = False
        jobs: list[Job] = []
        for condition in ready:
            on_input = self._inputs.get(condition)
            if on_input:
                try:
                    jobs += on_input()
                except Exception:
                    log.exception("taking input")  # of one reader; the others have theirs taken
        while added:
            jobs.append(added.popleft())
        return jobs

    def close(self) -> None:
        self._waiting.close()


# The library has threads, which a forked process lacks; whatever waits for them there waits for ever.

_buses: weakref.WeakSet[Bus] = weakref.WeakSet()
_forked = False


def _check_that_we_were_not_forked() -> None:
    if _forked:
        raise TransportError(
            "dds: Cyclone DDS was in use when this process was forked, and cannot be used in it: start processes "
            "by `spawn` or `forkserver`, or fork before a transport is opened"
        )


def _in_forked_process() -> None:
    global _forked
    creating.renew()
    if not any_open():
        return
    _forked = True
    for entity in list(Entity._entities.values()):
        _disown(entity)
    for bus in list(_buses):
        bus.lose()


def _disown(entity: Entity) -> None:
    """Have an entity forget what it stands for."""
    Entity._entities.pop(entity._ref, None)


os.register_at_fork(after_in_child=_in_forked_process)
