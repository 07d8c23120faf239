"""Which promises a history breaks. Pure.

once        no command, and no query that is not idempotent, is executed twice; an idempotent one is executed once
            in one life of a server
ok          what ended well was executed, by the server that answered
expired     what ended as expired was not executed
late        nothing is executed after its deadline, and what a fault may add to that
one end     each call ends, once, unless its client was killed
commands    each that was sent was executed, or is counted as lost
order       a subscriber hears nothing twice, and each publisher in its order
losses      what a subscriber says that it lost is what it lost
nobody left
"""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from .history import Asked, Counted, Ended, Event, Executed, Heard, Left, Published


class Violation(NamedTuple):
    rule: str
    what: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.what}"


@dataclass(frozen=True)
class Allowed:
    """What the faults of a run may do: `late` seconds beyond its deadline a request may have been on its way."""

    late: float = 0.1
    killed: frozenset[str] = frozenset()
    """Clients, by what their calls begin with, whose calls need not have ended."""


@dataclass
class _Sorted:
    asked: dict[str, Asked] = field(default_factory=dict)
    ended: dict[str, list[Ended]] = field(default_factory=lambda: defaultdict(list))
    executed: dict[str, list[Executed]] = field(default_factory=lambda: defaultdict(list))
    published: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    heard: dict[tuple[str, str], list[int]] = field(default_factory=lambda: defaultdict(list))
    counted: dict[str, int] = field(default_factory=dict)
    left: list[Left] = field(default_factory=list)


def check(history: Iterable[Event], allowed: Allowed = Allowed()) -> list[Violation]:
    """All violations; none, if every promise was kept."""
    known = _sorted(history)
    return [*_once(known), *_ok(known), *_late(known, allowed), *_ends(known, allowed), *_topics(known), *_left(known)]


def check_commands(history: Iterable[Event], receiver: str) -> list[Violation]:
    """For commands of one server that lived all the time, and heard the last one: none is missing without a count.

    A command whose sending failed may have been executed, or be counted, or neither.
    """
    known = _sorted(history)
    sent = [call for call, asked in known.asked.items() if asked.kind == "command"]
    well = [call for call in sent if any(end.outcome == "ok" for end in known.ended[call])]
    missing = sum(call not in known.executed for call in well)
    never = sum(call not in known.executed for call in sent)
    counted = known.counted.get(receiver)
    if counted is None:
        return [Violation("commands", f"{receiver} did not say what it lost")]
    if not missing <= counted <= never:
        text = f"{missing} sent well and {never - missing} others were not executed, {counted} are counted as lost"
        return [Violation("commands", text)]
    return []


def _sorted(history: Iterable[Event]) -> _Sorted:
    known = _Sorted()
    for event in history:
        match event:
            case Asked():
                known.asked[event.call] = event
            case Ended():
                known.ended[event.call].append(event)
            case Executed():
                known.executed[event.call].append(event)
            case Published():
                known.published[event.source] = max(known.published[event.source], event.number)
            case Heard():
                known.heard[event.subscriber, event.source].append(event.number)
            case Counted():
                known.counted[event.receiver] = event.lost
            case Left():
                known.left.append(event)
    return known


def _once(known: _Sorted) -> Iterable[Violation]:
    for call, executed in known.executed.items():
        asked = known.asked.get(call)
        if asked is None:
            yield Violation("once", f"{call} was executed, and nobody asked for it")
        elif asked.kind != "idempotent" and len(executed) > 1:
            yield Violation("once", f"{call} ({asked.kind}) was executed {len(executed)} times")
        else:
            for server, times in Counter(each.server for each in executed).items():
                if times > 1:
                    yield Violation("once", f"{call} was executed {times} times by {server}")


def _ok(known: _Sorted) -> Iterable[Violation]:
    for call, ends in known.ended.items():
        by = {each.server for each in known.executed.get(call, ())}
        for end in ends:
            asked = known.asked.get(call)
            if end.outcome == "ok" and asked and asked.kind != "command" and end.server not in by:
                yield Violation("ok", f"{call} was answered by {end.server or 'nobody'}, which did not execute it")
            if end.outcome == "expired" and by:
                yield Violation("expired", f"{call} was executed by {', '.join(sorted(by))}, and ended as expired")


def _late(known: _Sorted, allowed: Allowed) -> Iterable[Violation]:
    for call, executed in known.executed.items():
        asked = known.asked.get(call)
        for each in executed if asked else ():
            assert asked
            late = each.at - asked.at - asked.deadline
            if late > allowed.late:
                yield Violation("late", f"{call} was executed {late:.3f} s after its deadline of {asked.deadline:g} s")


def _ends(known: _Sorted, allowed: Allowed) -> Iterable[Violation]:
    for call in known.asked:
        times = len(known.ended.get(call, ()))
        if times > 1:
            yield Violation("one end", f"{call} ended {times} times")
        if times == 0 and not any(call.startswith(client) for client in allowed.killed):
            yield Violation("one end", f"{call} never ended")
    for call in known.ended.keys() - known.asked.keys():
        yield Violation("one end", f"{call} ended, and was never asked")


def _topics(known: _Sorted) -> Iterable[Violation]:
    lost: Counter[str] = Counter()
    for (subscriber, source), numbers in known.heard.items():
        if any(later <= earlier for earlier, later in itertools.pairwise(numbers)):
            yield Violation("order", f"{subscriber} heard {source} twice, or not in order")
        if max(numbers) > known.published[source]:
            yield Violation("order", f"{subscriber} heard of {source} what that did not publish")
        lost[subscriber] += max(numbers) - min(numbers) + 1 - len(set(numbers))
    for subscriber in {subscriber for subscriber, _ in known.heard}:
        counted = known.counted.get(subscriber)
        if counted is None:
            continue  # it was killed, or nobody asked it
        if counted != lost[subscriber]:
            yield Violation("losses", f"{subscriber} lost {lost[subscriber]}, and counted {counted}")


def _left(known: _Sorted) -> Iterable[Violation]:
    for each in known.left:
        yield Violation("nobody left", f"process {each.pid} is still there: {each.what}")
