"""The compared parties: each carries arrays between two processes, by our framework or by a bare library.

Its far end, in a separate process, answers every query with the received array, and subscribes to a topic. Its near
end, in the measuring process, calls and publishes.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from subprocess import SubprocessError
from typing import Any, Protocol, runtime_checkable

import numpy as np

from robocomp_py.errors import RobocompError

Array = np.ndarray[Any, np.dtype[np.uint8]]
Hear = Callable[[Array], object]
Act = Callable[[Array], Any]
"""Publishes an array, or calls with it."""

MIDDLEWARES = ("zeromq", "dds", "zenoh", "shm", "inproc")

BY_NAME = ("ice",)
"""Those that are measured only if they are named: what they need is not there as a rule."""

BROKERED = ("ice",)
"""Where something stands between the two ends, ours and those of the bare library, that is neither of them. Zenoh's
router is none of that: it is the far end's own session, in both; run apart, as by `rcdeploy`, it makes each way longer.
"""

FAILURES = (RobocompError, OSError, RuntimeError, ValueError, SubprocessError)
"""Errors that stop the measurement of one party, but not of the others."""

TAKES = 0.005
"""Seconds that a slow handler takes."""

PATIENCE = 10.0
"""Seconds for an answer, and until both ends have found each other; then the measurement fails."""


INT = struct.Struct("=q")
"""A time in the first octets of a message."""


def stamp(data: Array) -> None:
    """Write the time of sending into a message."""
    INT.pack_into(data.data, 0, time.monotonic_ns())


@dataclass(frozen=True)
class Place:
    """The run-time folder where two ends meet, without other programs."""

    folder: str
    domain: int
    """Of DDS: ours is this one, the bare library's the next."""
    depth: int
    """How many messages of the topic may wait for a slow reader, where that can be chosen."""


class Far(Protocol):
    def close(self) -> None: ...


class Near(Protocol):
    def ask(self, data: Array) -> Array: ...

    def publish(self, data: Array) -> None:
        """Returns when the array may be changed again; waits rather than lose a message.

        May raise TimeoutError, if it waited long.
        """
        ...

    def close(self) -> None: ...


@runtime_checkable
class Lender(Near, Protocol):
    """A party whose messages can be filled in place."""

    def lend(self, data: Array) -> None:
        """Publish a message that is filled with this data, and then stamped."""
        ...


@dataclass(frozen=True)
class Party:
    far: Callable[[Place, Hear], Far]
    """Returns when it is ready. Called in the other process, so it is something that can be pickled."""
    near: Callable[[Place], Near]
    """Returns when both ends have found each other."""
    encode: Callable[[Array], Any] | None = None
    """What `ask` does before anything is sent, and `decode` after it was received, for those who can tell."""
    decode: Callable[[Any], Array] | None = None
    apart: bool = True
    """Whether the far end is in another process."""
