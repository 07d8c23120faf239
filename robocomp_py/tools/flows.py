"""What goes along the connections of a network: rates, durations, failures, losses. Pure.

A query is measured by its client (the round trip), or if that does not tell, by its server (the run of the handler). Of
a topic, the publisher tells the rate, and the subscriber how long its handler runs and what it has lost.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from ..runtime.RoboCompIntrospection import Description, End
from ..wire import names
from .doctor.qos import asked_by
from .drift import Drift, Instance, Use
from .measure import Load, Operation

NEAR = 0.8
"""The part of a deadline from which on a connection is near it."""


@dataclass(frozen=True, slots=True)
class Flow:
    """What one use does. Durations are in seconds; NaN if they are not known."""

    rate: float = math.nan
    """Calls or messages per second."""
    p50: float = math.nan
    p99: float = math.nan
    failed: int = 0
    """Since the start, as `lost`."""
    lost: int = 0
    """Messages that are missing, were discarded, or came too late."""
    is_strained: bool = False
    """Whether it fails or loses now, or is near its deadline."""


@dataclass(frozen=True)
class Told:
    """What one component answered: now, the time before, and what it is."""

    now: Load
    before: Load | None = None
    about: Description | None = None


def flows(drift: Drift, told: Mapping[str, Told]) -> dict[Use, Flow]:
    """By use; `told` is by the whole names of components."""
    sides = {each.name: _Side(answers_of(each, told)) for each in drift.instances}
    every = (*drift.uses, *drift.unheard)
    return {each: _flow(each, sides.get(each.client, _SILENT), sides.get(each.provider, _SILENT)) for each in every}


def without_subscriber(drift: Drift, told: Mapping[str, Told]) -> Drift:
    """The same drift, without the topics to which a component subscribes within the process of their publisher."""
    ends = [
        (each.about.pid, end.channel)
        for each in told.values()
        if each.about
        for end in each.about.ends
        if end.verb == "subscribesTo" and end.channel
    ]
    alone = (
        each for each in drift.unheard if not any(each.pid == pid and _means(to, each.channel) for pid, to in ends)
    )
    return replace(drift, unheard=tuple(alone))


def answers_of(instance: Instance, told: Mapping[str, Told]) -> Told | None:
    """What this instance answered, if it did."""
    exact = told.get(instance.prefix)
    if exact is not None and _is_of(instance, exact):
        return exact
    short = instance.prefix.rpartition("/")[2]
    fitting = (each for name, each in told.items() if name.rpartition("/")[2] == short and _is_of(instance, each))
    return next(fitting, None) if instance.pids else None


def merged(every: Sequence[Flow]) -> Flow:
    """The sum of several: all rates, and the longest durations."""
    if len(every) == 1:
        return every[0]
    return Flow(
        _sum(each.rate for each in every),
        _longest(each.p50 for each in every),
        _longest(each.p99 for each in every),
        sum(each.failed for each in every),
        sum(each.lost for each in every),
        any(each.is_strained for each in every),
    )


class _Side:
    """What one component answered, sorted once for all of its uses."""

    def __init__(self, told: Told | None) -> None:
        self.ends: dict[str, list[End]] = {}
        """What it looks up, by operation, as all below: most uses are of another one."""
        for end in told.about.ends if told and told.about else ():
            if end.verb in _USERS and end.channel:
                self.ends.setdefault(names.operation(end.channel), []).append(end)
        before = {_key(each): each for each in told.before.operations} if told and told.before else {}
        self.users: dict[str, list[_Pair]] = {}
        self.servers: dict[str, list[_Pair]] = {}
        for each in told.now.operations if told else ():
            if each.channel and each.verb in _EITHER:
                side = self.users if each.verb in _USERS else self.servers
                side.setdefault(names.operation(each.channel), []).append((each, before.get(_key(each))))


_USERS, _SERVERS = frozenset(("requires", "subscribesTo")), frozenset(("implements", "publishes"))
_EITHER = _USERS | _SERVERS
_Pair = tuple[Operation, Operation | None]
"""What a component measured of an operation, with what it had measured before."""
_SILENT = _Side(None)


def _flow(use: Use, client: _Side, provider: _Side) -> Flow:
    users, servers = _operations(use, client.users), _operations(use, provider.servers)
    durations = users or ([] if use.is_topic else servers)
    counted = (servers or users) if use.is_topic else durations
    rate = _sum(each.rate for each, _ in counted)
    p99 = _longest(each.p99 for each, _ in durations)
    deadline = _deadline(use, client.ends)
    tight = 1 / rate if use.is_topic and rate else p99
    return Flow(
        rate,
        _longest(each.p50 for each, _ in durations),
        p99,
        sum(each.failed for each, _ in durations),
        sum(_lost(each) for each, _ in users),
        any(map(_worsened, durations)) or (deadline > 0 and tight > NEAR * deadline),
    )


def _operations(use: Use, measured: Mapping[str, Sequence[_Pair]]) -> list[_Pair]:
    """What a component measured of a use."""
    found = [each for each in measured.get(names.operation(use.channel), ()) if _means(each[0].channel, use.channel)]
    return [each for each in found if each[0].middleware == use.middleware] or found


def _deadline(use: Use, ends: Mapping[str, Sequence[End]]) -> float:
    """The deadline of a call, or between messages of a topic, in seconds; 0 without a deadline."""
    mine = [each for each in ends.get(names.operation(use.channel), ()) if _means(each.channel, use.channel)]
    if not use.is_topic:
        return min((each.deadline for each in mine if each.deadline > 0), default=0.0)
    asked = (asked_by(each) for each in mine)
    return min((each.deadline for each in asked if each and each.deadline and each.deadline > 0), default=0.0)


def _worsened(pair: _Pair) -> bool:
    now, before = pair
    return before is not None and (now.failed > before.failed or _lost(now) > _lost(before))


def _lost(each: Operation) -> int:
    return each.lost + each.refused


def _means(looked_up: str, channel: str) -> bool:
    return looked_up == channel or (looked_up.count("/") >= 2 and names.matches(looked_up, channel))


def _is_of(instance: Instance, told: Told) -> bool:
    return not instance.pids or not told.now.pid or told.now.pid in instance.pids


def _key(each: Operation) -> tuple[str, ...]:
    return each.port, each.verb, each.operation, each.channel, each.middleware


def _sum(values: Iterable[float]) -> float:
    known = [each for each in values if not math.isnan(each)]
    return sum(known) if known else math.nan


def _longest(values: Iterable[float]) -> float:
    return max((each for each in values if not math.isnan(each)), default=math.nan)
