"""What all of this transport needs of Cyclone DDS: limits, a lock, exceptions."""

from __future__ import annotations

import threading

from cyclonedds.core import DDSException, Entity, InstanceState, SampleState, ViewState

from ...errors import TransportError
from ..border import translating

BLOCKING_MS = 2
"""Maximum time in ms that the library waits for room before a write fails."""

LARGE = 32 * 1024
"""Samples of at least this many bytes are written without Python's global lock."""

ANY = SampleState.Any | ViewState.Any | InstanceState.Any
TIMEOUT = DDSException.DDS_RETCODE_TIMEOUT
FOREVER = 2**63 - 1


POLICIES = {2: "durability", 4: "deadline", 8: "liveliness", 11: "reliability"}
"""Names of QoS policies, by the library's numbers."""


class _Creating:
    """A lock for making entities: the library's Python classes keep state in class variables."""

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *exc: object) -> None:
        self._lock.release()

    def renew(self) -> None:
        """In a forked process, where a thread that is missing may have held the lock."""
        self._lock = threading.RLock()


creating = _Creating()


as_transport_error = translating("dds", DDSException)


def checked(code: int, doing: str) -> int:
    if code < 0:
        raise TransportError(f"dds: {doing}: {DDSException(code)}")
    return code


def forget(entity: Entity) -> None:
    """Delete an entity now, instead of when its last reference goes. The Python object becomes inert."""
    entity.__del__()
