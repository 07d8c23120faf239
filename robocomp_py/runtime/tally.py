"""Counts what goes through the ports of a component: always, since it costs two clock reads and an increment.

A tally belongs to one operation over one middleware, at one end. Its numbers only grow; for rates, a tool takes
differences. They may lag behind while two threads of the user's own call at once.

When a component ends, and $ROBOCOMP_TALLY names a folder, it writes `<namespace>.<instance>.json` there: a list of
objects with instance, port, operation, middleware and number of messages. For required interfaces, answered calls and
sent commands are counted; for subscriptions, received messages.
"""

from __future__ import annotations

import json
import logging
import os
from collections import deque
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..contract.component import Port
from ..contract.interface import Operation, Pattern, Verb
from ..wire import names

if TYPE_CHECKING:
    from ..transports.base import Link, Reply
    from .route import Route

FOLDER = "ROBOCOMP_TALLY"

MOST_KEPT = 256
"""Number of durations that a tally keeps."""

log = logging.getLogger("robocomp.worker")

Finish = Callable[["Reply | BaseException"], object]
"""Takes the outcome of a call: its reply, or what it raised. For a command, a reply without a payload."""

Begin = Callable[["Tally", tuple[Any, ...]], Finish]
"""Takes a call that begins, with its arguments."""


class Tally:
    """What was counted of one operation over one middleware. Written where the message is sent or handled."""

    __slots__ = (
        "begin",
        "count",
        "failed",
        "latest",
        "link",
        "operation",
        "pattern",
        "port",
        "route",
        "taken",
        "waited",
    )

    def __init__(self, port: Port, operation: Operation[Any], pattern: Pattern, route: Route) -> None:
        self.port, self.operation, self.pattern, self.route = port, operation, pattern, route
        self.link: Link | None = None
        self.count = 0
        """Messages and calls, also those that failed."""
        self.failed = 0
        """Of these; an exception that the IDSL declares is an answer."""
        self.latest: deque[float] = deque(maxlen=MOST_KEPT)
        """Seconds that the latest took: the round trip of a caller, the run of a handler, the sending of a message.

        Calls without a reply are not among them.
        """
        self.waited: deque[float] = deque(maxlen=MOST_KEPT)
        """Seconds that each of these waited until its handler ran; empty unless this is a handler."""
        self.taken = 0
        """The count when `Tallies.take` was called last."""
        self.begin: Begin | None = None
        """Called for each query and command while a tool watches them; else None."""

    @property
    def label(self) -> str:
        """Its port: as the CDSL has it, and after the name of a named instance if it belongs to one."""
        named = names.instance(self.route.channel) if self.port.each else ""
        return names.within(named, self.port.label)


class Tallies:
    """All tallies of a component. Safe to use from any thread."""

    def __init__(self) -> None:
        self._every: list[Tally] = []
        self._begin: Begin | None = None

    def add(self, tally: Tally, link: Link) -> None:
        """Take part from now on: its link is open."""
        tally.link = link
        self._every.append(tally)
        self._set_begin(tally)

    def tell(self, begin: Begin | None) -> None:
        """Tell this function of each query and command from now on; None ends it."""
        self._begin = begin
        for each in self.every:
            self._set_begin(each)

    def _set_begin(self, tally: Tally) -> None:
        if tally.pattern is not Pattern.PUBLISH:
            tally.begin = self._begin

    def drop(self, links: Collection[Link]) -> None:
        """Forget those of links that are closed while the component goes on."""
        gone = {id(each) for each in links}
        self._every = [each for each in self._every if id(each.link) not in gone]

    @property
    def every(self) -> Sequence[Tally]:
        return tuple(self._every)

    def take(self) -> tuple[int, float]:
        """The number of requests answered since the last call of this method, and the seconds from the arrival of the
        slowest until it was answered."""
        answered, slowest = 0, 0.0
        for each in self.every:
            new, each.taken = each.count - each.taken, each.count
            if new and each.port.verb is Verb.IMPLEMENTS and each.pattern is Pattern.QUERY:
                answered += new
                newest = list(zip(each.waited, each.latest, strict=False))[-new:]
                slowest = max(slowest, *(waited + took for waited, took in newest), 0.0)
        return answered, slowest


def write(tallies: Tallies, ports: Sequence[Port], namespace: str, instance: str) -> None:
    """Write the counts of the component's own ports, if $ROBOCOMP_TALLY names a folder."""
    folder = os.environ.get(FOLDER)
    if not folder:
        return
    name = "/".join(filter(None, (namespace, instance)))
    file = Path(folder, f"{name.replace('/', '.')}.json")
    rows = [_row(each, instance) for each in tallies.every if each.port in ports and each.port.verb in _WRITTEN]
    try:
        file.write_text(json.dumps(rows), encoding="utf-8")
    except OSError as exc:
        log.warning("%s: cannot be written: %s", file, exc.strerror)


_WRITTEN = (Verb.REQUIRES, Verb.SUBSCRIBES)


def _row(tally: Tally, instance: str) -> dict[str, Any]:
    received = tally.link.stats.received if tally.link else 0
    return {
        "instance": instance,
        "port": tally.label,
        "operation": tally.operation.name,
        "middleware": tally.route.middleware,
        "messages": received if tally.port.verb is Verb.SUBSCRIBES else tally.count - tally.failed,
    }
