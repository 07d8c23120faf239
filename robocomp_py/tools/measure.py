"""Rates and durations, from what components have counted. Pure.

A component counts since its start, so everything here is a difference of two answers of one component. Of a component
that was asked once, or that was restarted in between, everything since its start counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.RoboCompIntrospection import Description, Measure, Measures

Durations = NDArray[np.floating[Any]]
"""In seconds."""


@dataclass(frozen=True)
class Operation:
    """One operation of a component over one middleware. Durations are in seconds, NaN if there was none."""

    port: str
    verb: str
    operation: str
    channel: str
    middleware: str
    count: int
    """Messages or calls since the start."""
    rate: float
    """Of these per second."""
    p50: float
    p99: float
    longest: float
    waited: float
    """Longest time in which a message or call waited for its handler."""
    failed: int
    """Since the start, as all numbers below. An exception that the IDSL declares is an answer."""
    lost: int
    """Missing, or discarded since a queue was full."""
    refused: int
    """Malformed, of another contract, or too late."""
    is_heard: bool = True
    """Of a topic: whether a subscriber is known. A component may publish only what is heard."""

    @property
    def is_quiet(self) -> bool:
        return not (self.rate or self.failed or self.lost or self.refused)


@dataclass(frozen=True)
class Load:
    """One component between two answers."""

    component: str
    state: str
    host: str
    pid: int
    processor: float
    """Cores that its process used: 0.5 is half of one. NaN if it is not known."""
    memory: int
    """Octets of its process; 0 if they are not known."""
    computes: float
    """Calls of `compute` per second."""
    period: float
    overruns: int
    """Since the start."""
    queued: int
    suspended: int
    operations: tuple[Operation, ...] = field(default=(), repr=False)

    @property
    def calls(self) -> float:
        """Messages and calls per second, of all operations."""
        return sum(each.rate for each in self.operations)

    @property
    def failed(self) -> int:
        return sum(each.failed for each in self.operations)

    @property
    def lost(self) -> int:
        return sum(each.lost for each in self.operations)


def load(component: str, now: Measures, before: Measures | None = None, about: Description | None = None) -> Load:
    """What a component did since an earlier answer; `about` tells where it runs."""
    if before is not None and not 0 < before.awake < now.awake:
        before = None  # it was restarted
    seconds = now.awake - (before.awake if before else 0.0)
    known = {_key(each): each for each in before.operations} if before else {}
    return Load(
        component=component,
        state=now.state,
        host=about.host if about else "",
        pid=about.pid if about else 0,
        processor=_rate(now.processor - (before.processor if before else 0.0), seconds),
        memory=now.memory,
        computes=_rate(now.computes - (before.computes if before else 0), seconds),
        period=now.period,
        overruns=now.overruns,
        queued=now.queued,
        suspended=now.suspended,
        operations=tuple(_operation(each, known.get(_key(each)), seconds) for each in now.operations),
    )


def percentile(durations: Sequence[float] | Durations, part: float) -> float:
    """The smallest of these that at least this part of them do not exceed; NaN without values."""
    return _nearest(np.sort(np.asarray(durations, float)), part)


def _nearest(ordered: Durations, part: float) -> float:
    return float(ordered[max(0, math.ceil(part * len(ordered)) - 1)]) if len(ordered) else math.nan


def milliseconds(seconds: float) -> str:
    """For people, with three digits at most; "" if it is NaN."""
    if math.isnan(seconds):
        return ""
    value = seconds * 1000
    return f"{value:.3f}" if value < 0.1 else f"{value:.2f}" if value < 10 else f"{value:.0f}"


def _operation(now: Measure, before: Measure | None, seconds: float) -> Operation:
    if before and now.count < before.count:
        before = None
    new, timed = (now.count - before.count, now.timed - before.timed) if before else (now.count, now.timed)
    latest, waited = _newest(now.latest, timed), _newest(now.waited, timed)
    if latest.size > 1:
        latest = np.sort(latest)
    return Operation(
        port=now.port,
        verb=now.verb,
        operation=now.operation,
        channel=now.channel,
        middleware=now.middleware,
        count=now.count,
        rate=_rate(new, seconds),
        p50=_nearest(latest, 0.5),
        p99=_nearest(latest, 0.99),
        longest=_nearest(latest, 1.0),
        waited=float(waited.max()) if len(waited) else math.nan,
        failed=now.failed,
        lost=now.lost + now.dropped,
        refused=now.malformed + now.mismatched + now.expired,
    )


def _newest(durations: Sequence[float] | Durations, number: int) -> Durations:
    if not number or not len(durations):
        return _NONE
    found = np.asarray(durations[-number:], np.float64)
    return found[np.isfinite(found)]


_NONE: Durations = np.empty(0)


def _rate(number: float, seconds: float) -> float:
    return number / seconds if seconds > 0 else math.nan


def _key(each: Measure) -> tuple[str, ...]:
    return each.port, each.verb, each.operation, each.channel, each.middleware
