"""Tells others of links that have no reader or writer there.

Those are servers that no client has asked yet, and clients with `*` for the instance. The latter make readers and
writers only for peers of their contract. Other peers learn of them here, so that both sides report the difference.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Hashable, Iterator

from .bus import Bus, Writer
from .endpoints import TOPIC, Said, user_data
from .link import KEEP_ALL, endpoint_qos
from .types import announcement_type

NAME = f"{TOPIC}announcements"


class Announcing:
    """One writer, which writes nothing; what it says of itself is what others would say of themselves."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._lock = threading.Lock()
        self._told: dict[Hashable, Said] = {}
        self._writer: Writer | None = None
        self._gathering = 0
        self._changed = False

    def add(self, id: Hashable, said: Said) -> None:
        with self._lock:
            self._told[id] = said
            self._tell()

    def remove(self, id: Hashable) -> None:
        with self._lock:
            if self._told.pop(id, None):
                self._tell()

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """What changes while this is entered is told once, at its end."""
        with self._lock:
            self._gathering += 1
        try:
            yield
        finally:
            with self._lock:
                self._gathering -= 1
                if self._changed:
                    self._tell()

    def _tell(self) -> None:
        """With the lock."""
        self._changed = self._gathering > 0
        if self._changed:
            return
        former, new = self._writer, None
        if self._told:
            about = user_data(list(self._told.values()))
            new = self._bus.writer(NAME, announcement_type(), endpoint_qos(KEEP_ALL, about))
        self._writer = new
        if former:
            former.close()  # afterwards: what is told by both does not go away meanwhile
