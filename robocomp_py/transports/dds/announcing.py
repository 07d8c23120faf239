"""Announces links that have no DDS reader or writer yet.

These are lazy servers without a client, and clients with `*` for the instance. Such a client makes readers and writers
only for peers with its contract; peers with another contract see it here, so that both sides report the mismatch.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Hashable, Iterator

from .bus import Bus, Writer
from .endpoints import TOPIC, Said, announced_data
from .qos import KEEP_ALL, endpoint_qos

NAME = f"{TOPIC}announcements"


class Announcing:
    """Writers that send no samples: their USER_DATA holds the descriptions of the announced links.

    There is one, unless the descriptions are too long for it.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._lock = threading.Lock()
        self._descriptions: dict[Hashable, Said] = {}
        self._writers: list[Writer] = []
        self._gathering = 0
        self._changed = False

    def add(self, id: Hashable, said: Said) -> None:
        with self._lock:
            self._descriptions[id] = said
            self._announce()

    def remove(self, id: Hashable) -> None:
        with self._lock:
            if self._descriptions.pop(id, None):
                self._announce()

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """Announce all changes within this once, at its end."""
        with self._lock:
            self._gathering += 1
        try:
            yield
        finally:
            with self._lock:
                self._gathering -= 1
                if self._changed:
                    self._announce()

    def _announce(self) -> None:
        """Replace the writers; called with the lock."""
        self._changed = self._gathering > 0
        if self._changed:
            return
        from .types import announcement_type  # a census announces nothing

        with contextlib.ExitStack() as replaced:
            new = []
            for data in announced_data(list(self._descriptions.values())):
                new.append(self._bus.writer(NAME, announcement_type(), endpoint_qos(KEEP_ALL, data)))
                replaced.callback(new[-1].close)
            replaced.pop_all()
            for each in self._writers:
                replaced.callback(each.close)  # after the new ones exist, so that no announcement disappears
            self._writers = new
