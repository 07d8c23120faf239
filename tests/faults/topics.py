"""Rows about topics: subscribers that are slow or stopped, floods, and who means something else."""

from __future__ import annotations

import contextlib
import re
import time

from .checker import Violation
from .history import Event, Heard
from .laboratory import PATIENCE, Laboratory, Remote, until
from .rows import HERE, Figure, Result, Row, Run

_CHANNEL = "faults/Conformance/topic"

_SIZE = 20_000

_TAPPED_SIZE = 1_000_000


def _flooded(run: Run) -> Result:
    """One subscriber keeps up, one takes 5 ms for each message, one is stopped for most of the time."""
    count = run.rounds(10_000, 500)
    with run.laboratory() as laboratory:
        publisher = laboratory.start("p")
        subscribers = {name: laboratory.start(name) for name in ("quick", "slow", "stopped")}
        subscribers["quick"].subscribe(channel=_CHANNEL, depth=1000)
        subscribers["slow"].subscribe(channel=_CHANNEL, depth=8, pause=0.005)
        subscribers["stopped"].subscribe(channel=_CHANNEL, depth=8)
        greet(publisher, subscribers.values())
        before = {name: each.usage()["memory"] for name, each in {"p": publisher, **subscribers}.items()}
        subscribers["stopped"].freeze()
        # at a pace that the quick one can follow, and a hundred times what the slow one can
        publisher.publish(channel=_CHANNEL, count=count, pace=0.002, size=_SIZE)
        paced = publisher.wait(channel=_CHANNEL, timeout=count * 0.05)
        run.tell("the quick one is to lose nothing until here")
        _until_quiet(laboratory, publisher, [subscribers["quick"]])
        quick = subscribers["quick"].stats(channel=_CHANNEL)
        publisher.publish(channel=_CHANNEL, count=count, pace=0.0, size=_SIZE)
        publisher.wait(channel=_CHANNEL, timeout=300.0)
        subscribers["stopped"].thaw()
        _until_quiet(laboratory, publisher, list(subscribers.values()))
        after = {name: each.usage()["memory"] for name, each in {"p": publisher, **subscribers}.items()}
        for each in subscribers.values():
            each.stats(channel=_CHANNEL, count=True)
        history = laboratory.end()
    lost = {name: _lost(history, name) for name in subscribers}
    figures = [
        Figure("publish p99", paced["p99"] * 1000, "ms", 5, timed=True),
        Figure("lost by the quick one", quick["lost"] + quick["dropped"], "", 0, timed=True),
        Figure("lost by the slow one", lost["slow"]),
        Figure("by the stopped one", lost["stopped"]),
        Figure("memory grew", max(after[name] - before[name] for name in before) / 1e6, "MB", 150),
    ]
    return Result(figures, run.check(history))


def greet(publisher: Remote, subscribers: object) -> None:
    """Until all hear it."""
    publisher.publish(channel=_CHANNEL, count=10**9, pace=0.02, depth=1000)
    for each in subscribers:  # type: ignore[attr-defined]
        until(lambda each=each: each.written() > 0, 20.0, f"{each.name} hears something")
    publisher.stop(channel=_CHANNEL)


def _until_quiet(laboratory: Laboratory, publisher: Remote, subscribers: list[Remote]) -> None:
    """Publish one by one until all have heard the newest: what they lost before shows by it."""
    end = time.monotonic() + PATIENCE
    while True:
        publisher.publish(channel=_CHANNEL, count=1)
        publisher.wait(channel=_CHANNEL)
        with contextlib.suppress(RuntimeError):  # it was lost, too, or a process is slow: then the next one
            until(lambda: all(last_heard(laboratory, each) == publisher.sent() for each in subscribers), 1.0, "")
        late = [each.name for each in subscribers if last_heard(laboratory, each) < publisher.sent()]
        if not late:
            return
        if time.monotonic() > end:
            raise RuntimeError(f"not in {PATIENCE:g} s: {', '.join(late)} hears the newest")


def last_heard(laboratory: Laboratory, subscriber: Remote) -> int:
    """The number of the message that it heard last."""
    with subscriber.journal.open("rb") as journal:
        journal.seek(max(0, journal.seek(0, 2) - 400))
        numbers = re.findall(rb'\["Heard",\{[^\n]*"number":(\d+)\}\]\n', journal.read())
    return int(numbers[-1]) if numbers else 0


def _lost(history: list[Event], subscriber: str) -> int:
    numbers = {event.number for event in history if isinstance(event, Heard) and event.subscriber == subscriber}
    return max(numbers) - min(numbers) + 1 - len(numbers)


def _tapped(run: Run, count: int = 1) -> Result:
    """`count` taps of a reliable topic are stopped at once for 10 s, and then killed."""
    seconds = run.rounds(10, 3)
    with run.laboratory() as laboratory:
        publisher, other = laboratory.start("p"), laboratory.start("other")
        taps = [laboratory.start(f"tap{number}") for number in range(count)]
        other.subscribe(channel=_CHANNEL, depth=100, reliable=True)
        for tap in taps:
            tap.subscribe(channel=_CHANNEL, tap=True)
        publisher.publish(channel=_CHANNEL, count=10**9, pace=0.02, depth=100, reliable=True)
        for each in (*taps, other):
            until(lambda each=each: each.written() > 0, 20.0, f"{each.name} hears something")  # type: ignore[misc]
        publisher.stop(channel=_CHANNEL)
        for tap in taps:
            tap.freeze()
        messages = seconds * 50
        publisher.publish(channel=_CHANNEL, count=messages, pace=0.02, size=_TAPPED_SIZE)
        stopped = publisher.wait(channel=_CHANNEL, timeout=seconds * 10)
        for tap in taps:
            tap.kill()
        publisher.publish(channel=_CHANNEL, count=messages, pace=0.02, size=_TAPPED_SIZE)
        killed = publisher.wait(channel=_CHANNEL, timeout=seconds * 10)
        _until_quiet(laboratory, publisher, [other])
        history = laboratory.end()
    most = 600.0 * count if run.transport == "zenoh" else 50.0  # zenoh cuts one connection after the other
    figures = [
        Figure("longest send, stopped", stopped["worst"] * 1000, "ms", most, timed=True),
        Figure("killed", killed["worst"] * 1000, "ms", 50, timed=True),
        Figure("lost by the other one", _lost(history, "other"), "", 0),
    ]
    return Result(figures, run.check(history))


def _mismatched(run: Run) -> Result:
    """A publisher and a subscriber that mean different things by one name."""
    with run.laboratory() as laboratory:
        publisher, other = laboratory.start("p"), laboratory.start("other")
        publisher.publish(channel=_CHANNEL, count=10**9, pace=0.01)
        begun = time.monotonic()
        other.subscribe_other(channel=_CHANNEL)
        told: dict[str, float] = {}
        while len(told) < 2 and time.monotonic() < begun + PATIENCE:
            for each in (publisher, other):
                if each.name not in told and _names_both(laboratory.log(each.name)):
                    told[each.name] = time.monotonic() - begun
            time.sleep(0.005)
        publisher.stop(channel=_CHANNEL)
        history = laboratory.end()
    delivered = [event for event in history if isinstance(event, Heard)]
    violations = [Violation("mismatch", f"{name} did not say so") for name in {"p", "other"} - set(told)]
    if delivered:
        violations.append(Violation("mismatch", f"{len(delivered)} messages were delivered"))
    figures = [
        Figure("both ends said so", max(told.values(), default=PATIENCE), "s", 2, timed=True),
        Figure("messages delivered", len(delivered), "", 0),
    ]
    return Result(figures, violations)


def _names_both(log: str) -> bool:
    """Whether it has both fingerprints, and the field that differs."""
    return bool(re.search(r"0{15}[12] here, 0{15}[12] there", log)) and "data" in log and "int16" in log


ROWS = [
    Row(
        "flood",
        "slow and stopped subscriber; flood",
        "`publish` p99 ≤ 5 ms, other subscribers lose nothing, memory bounded, drop counter exact",
        HERE,
        30,
        _flooded,
    ),
    Row(
        "tap",
        "tap of a reliable topic stopped 10 s, then killed",
        "no `send` > 50 ms (Zenoh: one of 0.5 s), other subscribers lose nothing",
        HERE,
        25,
        _tapped,
    ),
    Row(
        "taps",
        "three taps of a reliable topic stopped at once for 10 s, then killed",
        "no `send` > 50 ms (Zenoh: 0.5 s for each), other subscribers lose nothing",
        HERE,
        30,
        lambda run: _tapped(run, 3),
    ),
    Row(
        "contract",
        "contract mismatch",
        "both ends log both fingerprints and the differing fields ≤ 2 s; 0 samples delivered",
        HERE,
        1,
        _mismatched,
    ),
]
