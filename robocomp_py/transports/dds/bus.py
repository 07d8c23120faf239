"""Our interface to Cyclone DDS: participants, readers and writers of bytes, and waiting.

Samples pass through the library in their wire format. Listeners are not used: they run on the
library's threads and may wait for Python's global lock while they hold a lock of the library.
Instead, one thread waits for everything in `Loop.receive`. No call here blocks while it holds the
global lock, except for a small sample to a full writer, which may take `BLOCKING_MS`.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSException, Entity, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic

from ...errors import TransportError
from ..leader_followers import Job
from .domain import any_open, close_domain, open_domain
from .endpoints import Endpoints
from .library import ANY, LARGE, POLICIES, TIMEOUT, as_transport_error, creating, forget
from .unsafe import (
    Waiting,
    delete,
    disown_all,
    dispose,
    matched_publications,
    matched_subscriptions,
    read_condition,
    reference,
    take,
    write,
    write_unlocked,
)

if TYPE_CHECKING:
    from .types import DdsType

log = logging.getLogger("robocomp.transport.dds")


class Bus:
    """The DDS participant of one transport. `close` frees all its entities."""

    def __init__(self, domain: int, interface: str, peers: tuple[str, ...] = (), many: bool = False) -> None:
        self._domain = domain
        self.lost = False
        """Whether this process was forked from the one that opened the bus: then it cannot be used."""
        self.on_loss: Callable[[], None] = lambda: None
        _check_that_we_were_not_forked()
        open_domain(domain, interface, peers, many)
        with contextlib.ExitStack() as undo:
            undo.callback(close_domain, domain)
            with creating, as_transport_error("joining the domain"):
                self.participant = DomainParticipant(domain)
            undo.callback(forget, self.participant)
            self.loop = Loop(reference(self.participant))
            undo.callback(self.loop.close)
            self.endpoints = Endpoints(self.participant, self.loop.attach)
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
        return Waiting(reference(self.participant))

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

    def __init__(self, entity: Any, parent: Entity | None, topic: Topic[Any]) -> None:
        self._entity, self._parent, self._topic = entity, parent, topic
        self.ref = reference(entity)

    def incompatible_policy(self) -> str:
        """The QoS policy because of which DDS does not connect some endpoint; "" if there is none."""
        try:
            status = self._incompatible()
        except DDSException:
            return ""
        if status.total_count_change <= 0:
            return ""
        return POLICIES.get(status.last_policy_id, f"QoS policy {status.last_policy_id}")

    def _incompatible(self) -> Any:
        """The library's status of endpoints with incompatible QoS. Raises DDSException if we are closed."""
        raise NotImplementedError

    def close(self) -> None:
        forget(self._entity)
        if self._parent is not None:
            forget(self._parent)
        forget(self._topic)


class Writer(_End):
    """Sends samples. Small ones are written under Python's global lock: that is faster than to release it."""

    def matched(self) -> set[int]:
        """The handles of the readers that DDS has connected with this one."""
        return matched_subscriptions(self.ref)

    def _incompatible(self) -> Any:
        return self._entity.get_offered_incompatible_qos_status()

    def write(self, sample: bytearray | bytes | memoryview) -> bool:
        """Write; False if there is no room now. Safe to use from any thread."""
        code = write(self.ref, sample) if len(sample) < LARGE else write_unlocked(self.ref, sample)
        return not code or self._written(code)

    def write_within(self, sample: bytearray | bytes | memoryview, end: float, pause: Callable[[], None]) -> bool:
        """Retry writing until `end`; calls `pause` before each retry, which may raise."""
        while not self._written(write_unlocked(self.ref, sample)):
            pause()
            if time.monotonic() >= end:
                return False
            time.sleep(0.002)
        return True

    def greet(self, sample: bytes) -> bool:
        """Send a sample without data (a "dispose"), by which readers notice this writer; False if there is no room.

        The content of `sample` does not matter.
        """
        return self._written(dispose(self.ref, sample))

    def _written(self, code: int) -> bool:
        if code and code != TIMEOUT:
            raise TransportError(f"dds: writing: {DDSException(code)}")
        return not code


class Reader(_End):
    def __init__(self, entity: Any, parent: Entity | None, topic: Topic[Any]) -> None:
        super().__init__(entity, parent, topic)
        self.condition = read_condition(self.ref, "waiting for samples")

    def matched(self) -> set[int]:
        """The handles of the writers that DDS has connected with this one."""
        return matched_publications(self.ref)

    def _incompatible(self) -> Any:
        return self._entity.get_requested_incompatible_qos_status()

    def alive(self) -> bool:
        """Whether a connected writer has kept its lease."""
        try:
            return bool(self._entity.get_liveliness_changed_status().alive_count > 0)
        except DDSException:  # it is closed
            return False

    def take(self, most: int) -> list[tuple[bytes, Any]]:
        """Up to `most` samples, each with the library's information about it.

        Without `valid_data`, it is not a sample but the news that a writer left, or its greeting.
        """
        taken = take(self.ref, ANY, most)
        return taken if type(taken) is list else []  # an error code if the reader was closed

    def close(self) -> None:
        delete(self.condition)
        super().close()


class Loop:
    """Waits for samples on all readers and for the next tick. `receive` is for one thread at a time."""

    def __init__(self, participant: int) -> None:
        self._waiting = Waiting(participant)
        self._inputs: dict[int, Callable[[], Iterable[Job]]] = {}
        self._jobs: deque[Job] = deque()
        self._next_tick, self._woken, self._sleeping = 0.0, False, False
        self.tick: Callable[[], float] = lambda: math.inf
        """Does what is due; returns the time of the next tick."""

    def attach(self, condition: int, on_input: Callable[[], Iterable[Job]]) -> None:
        self._inputs[condition] = on_input
        self._waiting.attach(condition)

    def detach(self, condition: int) -> None:
        if self._inputs.pop(condition, None):
            self._waiting.detach(condition)

    def do(self, job: Job) -> None:
        """Have `receive` return this job. Safe to use from any thread."""
        self._jobs.append(job)
        if self._sleeping:
            self._waiting.wake()

    def wake(self) -> None:
        """Tick now."""
        self._woken = True
        self._waiting.wake()

    def due(self, when: float) -> None:
        """Tick no later than that."""
        if when < self._next_tick:
            self.wake()

    def receive(self) -> Iterable[Job]:
        now = time.monotonic()
        if self._woken or now >= self._next_tick:
            self._woken, self._next_tick = False, math.inf  # before the tick: it may set an earlier time
            self._next_tick = self.tick()
        added = self._jobs
        self._sleeping = True  # before the jobs are checked: a thread that adds one now wakes us
        wait = self._next_tick - now
        ready = self._waiting.wait(0.0 if added or wait < 0.0 else wait)
        self._sleeping = False
        jobs: list[Job] = []
        for condition in ready:
            on_input = self._inputs.get(condition)
            if on_input:
                try:
                    jobs += on_input()
                except Exception:
                    log.exception("taking input")  # the other readers go on
        while added:
            jobs.append(added.popleft())
        return jobs

    def close(self) -> None:
        self._waiting.close()


# A forked process lacks the library's threads; a call that waits for them would never return.

_buses: weakref.WeakSet[Bus] = weakref.WeakSet()
_forked = False


def _check_that_we_were_not_forked() -> None:
    if _forked:
        raise TransportError(
            "dds: Cyclone DDS was in use when this process was forked, and does not work in the child: start processes "
            "by `spawn` or `forkserver`, or fork before a transport is opened"
        )


def _in_forked_process() -> None:
    global _forked
    creating.renew()
    if not any_open():
        return
    _forked = True
    disown_all()
    for bus in list(_buses):
        bus.lose()


os.register_at_fork(after_in_child=_in_forked_process)
