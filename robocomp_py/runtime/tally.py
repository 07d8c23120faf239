"""Counts the calls and messages of a component. Each costs an increment, and at times two readings of the clock.

A tally belongs to one operation over one middleware, at one end. Its numbers only grow; for rates, a tool takes
differences. They are exact, also if several threads call at once: CPython 3.11 to 3.13 switch threads where a function
is called or begins and where a loop repeats, so never within `tally.count = count = tally.count + 1`. A lock would cost
more than all the rest. The free-threaded builds of CPython would need one.

Calls are timed, too. Of an operation with more than 2,000 calls a second, only every 64th is: that is enough for a
percentile, and timing each would make a call within one process a third longer. The choice does not depend on how long
a call takes.

When a component ends, and $ROBOCOMP_TALLY names a folder, it writes `<namespace>.<instance>.json` there: a list of
objects with instance, port, operation, middleware and number of messages. For required interfaces, answered calls and
sent commands are counted; for subscriptions, received messages.
"""

from __future__ import annotations

import json
import logging
import os
import time
from array import array
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..contract.interface import Operation, Pattern, Verb
from ..wire import names

if TYPE_CHECKING:
    from ..contract.component import Port
    from ..transports.base import Link, Reply
    from .route import Route

FOLDER = "ROBOCOMP_TALLY"

MOST_KEPT = 256
"""Number of durations that a tally keeps."""

_EACH = 64
"""One of this number of calls is timed if they are frequent."""

_FREQUENT = 0.0005
"""Seconds from one call to the next, on average, below which they are."""

log = logging.getLogger("robocomp.worker")

_now = time.monotonic

Finish = Callable[["Reply | BaseException"], object]
"""Takes the outcome of a call: its reply, or what it raised. For a command, a reply without a payload."""

Begin = Callable[["Tally", tuple[Any, ...]], Finish]
"""Takes a call that begins, with its arguments."""

NoteFailure = Callable[[str, BaseException], object]
"""Takes the name of a method, and what it raised."""


class Timing:
    """A call that is timed, and told of while a tool watches."""

    __slots__ = ("_begun", "_finish", "_tally", "_waited")

    def __init__(self, tally: Tally, finish: Finish | None) -> None:
        self._tally, self._finish = tally, finish
        self._begun, self._waited = _now(), 0.0

    def run(self) -> None:
        """The handler runs only now: until now, the call waited."""
        self._waited = _now() - self._begun

    def end(self, outcome: Reply) -> float:
        """The call has ended now. Returns the seconds that it took, without the wait."""
        took = _now() - self._begun - self._waited
        self._tally.time(self._begun, took, self._waited)
        self.tell(outcome)
        return took

    def tell(self, outcome: Reply | BaseException) -> None:
        """Tell of the outcome only, if a tool watches: the duration is not noted."""
        if self._finish:
            self._finish(outcome)


class Tally:
    """What was counted of one operation over one middleware. Written where the message is sent or handled."""

    __slots__ = (
        "_decided",
        "_decided_at",
        "_each",
        "_handles",
        "_latest",
        "_waited",
        "begin",
        "count",
        "due",
        "failed",
        "link",
        "operation",
        "pattern",
        "port",
        "route",
        "taken",
        "timed",
    )

    def __init__(self, port: Port, operation: Operation[Any], pattern: Pattern, route: Route) -> None:
        self.port, self.operation, self.pattern, self.route = port, operation, pattern, route
        self.link: Link | None = None
        self.count = 0
        """Messages and calls, also those that failed or have not ended."""
        self.failed = 0
        """Of these; an exception that the IDSL declares is an answer."""
        self._latest, self._waited = array("f"), array("f")  # a deque of floats takes eight times as much memory
        self.timed = 0
        """How many calls were timed."""
        self.due = 0
        """A call is neither timed nor told of if `count` is less: the test that each call pays for."""
        self.taken = 0, 0
        """`count` and `timed` when `Tallies.take` was called last."""
        self.begin: Begin | None = None
        """Called for each query and command while a tool watches them; else None."""
        self._each = 0
        """From one timed call to the next; 0 if each is timed."""
        self._decided, self._decided_at = 0, 0.0
        """The count and the time at the last decision about `_each`."""
        self._handles = port.verb in (Verb.IMPLEMENTS, Verb.SUBSCRIBES)

    def tell(self, begin: Begin | None) -> None:
        self.begin, self._each, self.due = begin, 0, 0

    def time_next(self) -> None:
        """Time the next call in any case: calls may have become rare."""
        self.due = 0

    def time_each(self) -> None:
        """Time every call, at least until the next decision."""
        self._each = self.due = 0

    def start(self, arguments: tuple[Any, ...]) -> Timing:
        """Time this call, whose turn it is."""
        self.take_turn()
        return self.watch(arguments)

    def take_turn(self) -> None:
        """Let the calls after this one wait for their turn to be timed."""
        self.due = self.count + self._each

    def watch(self, arguments: tuple[Any, ...]) -> Timing:
        """Begin to time a call, which may be told of without being timed."""
        return Timing(self, self.begin(self, arguments) if self.begin else None)

    def time(self, begun: float, took: float, waited: float) -> None:
        """Note the seconds that a call took and, at a handler, waited before; `begun` is when it began."""
        at = self.timed % MOST_KEPT
        self.timed += 1
        _put(self._latest, at, took)
        if self._handles:
            _put(self._waited, at, waited)
        new = self.count - self._decided
        if new >= _EACH and not self.begin:
            # A pause makes frequent calls look rare once. `due` stays, so the next call in turn decides again.
            self._each = _EACH if begun - self._decided_at < new * _FREQUENT else 0
            self._decided, self._decided_at = self.count, begun

    @property
    def latest(self) -> list[float]:
        """Seconds that the latest timed ones took, the oldest first: the round trip of a caller, the run of a handler,
        the sending of a message. Calls without a reply are not among them."""
        return self._in_order(self._latest)

    @property
    def waited(self) -> list[float]:
        """Seconds that each of these waited until its handler ran; empty unless this is a handler."""
        return self._in_order(self._waited)

    def _in_order(self, kept: array[float]) -> list[float]:
        oldest = self.timed % MOST_KEPT if len(kept) == MOST_KEPT else 0
        return [*kept[oldest:], *kept[:oldest]]

    @property
    def label(self) -> str:
        """Its port: as the CDSL has it, and after the name of a named instance if it belongs to one."""
        named = names.instance(self.route.channel) if self.port.each else ""
        return names.within(named, self.port.label)

    @property
    def handler(self) -> str:
        """The method that handles its messages."""
        return f"{self.port.label}_{self.operation.name}"


def _put(kept: array[float], at: int, seconds: float) -> None:
    if at < len(kept):
        kept[at] = seconds
    else:
        kept.append(seconds)


class Tallies:
    """All tallies of a component. Safe to use from any thread."""

    def __init__(self) -> None:
        self._every: list[Tally] = []
        self._begin: Begin | None = None
        self.on_failure: NoteFailure | None = None
        """Called for each exception of the component's code."""

    def note_failure(self, method: str, exc: BaseException) -> None:
        """Tell of an exception that a method of the component raised."""
        if self.on_failure:
            self.on_failure(method, exc)

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
            tally.tell(self._begin)

    def drop(self, links: Collection[Link]) -> None:
        """Forget those of links that are closed while the component goes on."""
        gone = {id(each) for each in links}
        self._every = [each for each in self._every if id(each.link) not in gone]

    @property
    def every(self) -> Sequence[Tally]:
        return tuple(self._every)

    def slowest_handler(self) -> tuple[float, str]:
        """The longest of the latest runs of handlers, in seconds, and the method that it was; 0 and "" before any."""
        handlers = (each for each in self.every if each.port.verb in _HANDLED and each.latest)
        return max(((max(each.latest), each.handler) for each in handlers), default=(0.0, ""))

    def take(self) -> tuple[int, float]:
        """The number of requests answered since the last call of this method, and the seconds from the arrival of the
        slowest timed one until it was answered."""
        answered, slowest = 0, 0.0
        for each in self.every:
            (count, timed), each.taken = each.taken, (each.count, each.timed)
            each.time_next()
            if each.port.verb is Verb.IMPLEMENTS and each.pattern is Pattern.QUERY:
                answered += each.taken[0] - count
                times = list(zip(each.waited, each.latest, strict=False))
                newest = times[max(0, len(times) - (each.taken[1] - timed)) :]
                slowest = max([slowest, *(waited + took for waited, took in newest)])
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
_HANDLED = (Verb.IMPLEMENTS, Verb.SUBSCRIBES)


def _row(tally: Tally, instance: str) -> dict[str, Any]:
    received = tally.link.stats.received if tally.link else 0
    return {
        "instance": instance,
        "port": tally.label,
        "operation": tally.operation.name,
        "middleware": tally.route.middleware,
        "messages": received if tally.port.verb is Verb.SUBSCRIBES else tally.count - tally.failed,
    }
