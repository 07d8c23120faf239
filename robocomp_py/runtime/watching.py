"""The watches of one component, and the thread that checks them. Without a watched port, there is no thread.

All times are of the component's clock. An executor that drives the component calls `due` and `look` instead of `begin`.

A port of a topic is watched if its QoS has a `deadline` or a `lease`. A subscription watches incoming messages and
their publishers; a publisher watches the messages that it sends.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Mapping

from ..contract.component import Port
from ..contract.interface import Pattern
from ..contract.qos import Liveliness, QoS
from ..errors import ComponentError
from ..threads import NO_THREAD, start_thread
from ..transports.base import Link, SupportsSources
from .clock import NEVER, SECOND, Clock, Real, ns
from .watch import Lost, Missed, Watch

log = logging.getLogger("robocomp.worker")

_STUCK = 5.0
"""Seconds that closing waits for a running hook."""

_AFTER = 1000
"""Nanoseconds from the end of a deadline until it is looked at, so that a message at its very end is in time."""

Tell = Callable[[Port, str, "Missed | Lost"], object]
"""Called with an event on an operation of a port. May wait for the monitor."""


class Watched:
    """The watch of one operation of a port, over all its links."""

    def __init__(
        self, port: Port, operation: str, qos: QoS, wake: Callable[[], object], clock: Callable[[], float]
    ) -> None:
        self.port, self.operation, self.qos = port, operation, qos
        self._wake, self._clock = wake, clock
        self._lock = threading.Lock()
        self._watch = Watch(qos)
        self._links: list[Link] = []
        self._own: dict[str, QoS] = {}

    def add(self, link: Link) -> None:
        """Watch the messages that come in by this link."""
        self._links.append(link)

    def publishes(self, channel: str) -> None:
        """Watch the messages that this component sends on a channel; call `heard` for each."""
        self._own[channel] = self.qos

    def heard(self, channel: str) -> None:
        """Note a message that came in or went out. May be called from any thread."""
        with self._lock:
            news = self._watch.heard(channel, self._clock())
        if news:
            self._wake()

    def due(self) -> float:
        with self._lock:
            return self._watch.due()

    def look(self) -> list[Missed | Lost]:
        there = self._sources()  # without our lock: a transport may call `heard` while it holds its own
        with self._lock:
            return self._watch.look(self._clock(), lambda: there)

    def alive(self) -> list[str]:
        """The channels whose publishers were alive at the last check."""
        with self._lock:
            return self._watch.alive()

    def totals(self) -> tuple[int, int]:
        """The number of missed deadlines, and how often a publisher was lost."""
        with self._lock:
            return self._watch.missed, self._watch.lost

    def _sources(self) -> Mapping[str, QoS]:
        there = dict(self._own)
        for link in self._links:
            if isinstance(link, SupportsSources):
                there |= dict(link.sources())
        return there


class Watching:
    def __init__(self, name: str, tell: Tell, clock: Clock | None = None) -> None:
        self._name, self._tell = name, tell
        self._clock = clock or Real()
        self._begun = self._clock.now()
        self._watched: list[Watched] = []
        self._news = threading.Event()
        self._has_begun = False
        self._closed = False
        self._thread: threading.Thread | None = None

    def of(self, port: Port, operation: str, pattern: Pattern, qos: QoS) -> Watched | None:
        """Add a watch for an operation; None if its QoS needs none."""
        is_alive = port.verb.has_proxy and qos.liveliness is Liveliness.AUTOMATIC  # as long as this process lives
        if pattern is not Pattern.PUBLISH or (qos.deadline is None and (qos.lease is None or is_alive)):
            return None
        watched = Watched(port, operation, qos, self._news.set, self._now)
        self._watched.append(watched)
        if self._has_begun:
            self.begin()
            self._news.set()
        return watched

    def leave(self, watched: Watched) -> None:
        """Watch an operation no longer."""
        self._watched = [each for each in self._watched if each is not watched]

    @property
    def all(self) -> tuple[Watched, ...]:
        return tuple(self._watched)

    def begin(self) -> None:
        """Start to check, now or with the first watch. Raises ComponentError if the system cannot start a thread."""
        self._has_begun = True
        if self._watched and self._thread is None and not self._closed:
            thread = threading.Thread(target=self._run, name=f"{self._name}-watch")
            self._clock.wait(self._news, self._clock.reached())  # so that a clock that others move knows of the thread
            if not start_thread(thread):
                raise ComponentError(f"the QoS of its topics cannot be watched: {NO_THREAD}")
            self._thread = thread

    def end(self) -> None:
        """Stop checking."""
        self._closed = True
        self._news.set()

    def close(self) -> None:
        """Stop checking, and wait for a running hook."""
        self.end()
        if self._thread and self._thread is not threading.current_thread():
            self._thread.join(_STUCK)
            if self._thread.is_alive():
                log.warning("%s: still in a handler after %g s; not waiting any longer", self._thread.name, _STUCK)
        for each in self._watched:
            missed, lost = each.totals()
            if missed or lost:
                what = f"{each.port.label}.{each.operation}"
                log.info("%s: %d deadlines were missed, publishers lost %d times", what, missed, lost)
        self._watched = []

    def due(self) -> int:
        """The time of the clock at which `look` should be called next."""
        if not self._watched:
            return NEVER
        due = min((each.due() for each in self._watched), default=math.inf)
        if due == math.inf:
            return NEVER
        return self._begun + ns(due) + _AFTER if due > 0 else self._begun

    def look(self) -> None:
        """Check what is due, and tell what is found."""
        for each in list(self._watched):
            self._look(each)

    def _now(self) -> float:
        """Seconds by the clock since this was made: as a float, that is finer than the time since 1970."""
        return (self._clock.now() - self._begun) / SECOND

    def _run(self) -> None:
        while not self._closed:
            due = self.due()
            if due > self._clock.reached():
                if self._clock.wait(self._news, due):
                    self._news.clear()
                continue
            self.look()

    def _look(self, each: Watched) -> None:
        if each.due() > self._now():
            return
        try:
            found = each.look()
        except Exception:
            if not self._closed:
                log.exception("%s.%s: finding the publishers failed", each.port.label, each.operation)
                self._news.clear()
                self._news.wait(1.0)  # rather than again at once
            return
        for event in found:
            self._tell(each.port, each.operation, event)
