"""Rows about the machine: clocks that leap, and disks that are full."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from .checker import Violation
from .history import Asked, Ended, Event
from .laboratory import Laboratory, until
from .rows import HERE, Figure, Result, Row, Run
from .topics import greet, last_heard

_CALLS, _TOPIC = "faults/Conformance/op", "faults/Conformance/topic"
_HOUR = 3600
LEAPS = ("+1h", "+0", "-1h", "+0")
"""What is written to the file of `with_clock`, one after the other."""


def with_clock(file: Path) -> dict[str, str]:
    """The environment of processes whose clock is off by what a file says; their monotonic one is right."""
    found = sorted(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"))
    if not found:
        raise RuntimeError("there is no libfaketime here: apt-get install libfaketime")
    return {
        "LD_PRELOAD": str(found[0]),
        "FAKETIME_TIMESTAMP_FILE": str(file),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }


def _leaping(run: Run) -> Result:
    """The clock of all processes leaps by an hour, forward and back, while they talk."""
    leaps = run.rounds(20, 2)
    with run.laboratory() as laboratory:
        clock = laboratory.folder / "clock"
        clock.write_text("+0")
        laboratory.prefix = ("env", *(f"{name}={value}" for name, value in with_clock(clock).items()))
        server, client, publisher, subscriber = (laboratory.start(name) for name in ("s", "c", "p", "h"))
        server.serve(channel=_CALLS)
        subscriber.subscribe(channel=_TOPIC, depth=1000)
        greet(publisher, [subscriber])
        client.ask(channel=_CALLS, calls=10**9, deadline=5.0, pace=0.002)
        publisher.publish(channel=_TOPIC, count=10**9, pace=0.005)
        before = server.clock()
        for number in range(leaps):
            time.sleep(0.5)
            clock.write_text(LEAPS[number % len(LEAPS)])
            if number == 0:
                leapt = server.clock() - before
        time.sleep(0.5)
        publisher.stop(channel=_TOPIC)
        client.stop(channel=_CALLS)
        until(lambda: last_heard(laboratory, subscriber) == publisher.sent(), 20.0, "the last message is heard")
        lost = subscriber.stats(channel=_TOPIC, count=True)
        history = laboratory.end()
    violations = run.check(history)
    if leapt < 0.9 * _HOUR:
        violations.append(Violation("clock", f"it leapt by {leapt:.0f} s only: is libfaketime at work?"))
    others = _other_outcomes(history)
    slowest = max(_took(history))
    figures = [
        Figure("leaps", leaps),
        Figure("messages lost", lost["lost"] + lost["dropped"] + lost["expired"], "", 0),
        Figure("calls that did not end well", sum(others.values()), "", 0),
        *(Figure(f"as {outcome}", number) for outcome, number in sorted(others.items())),
        Figure("slowest call", slowest, "s", 1.0, timed=True),
    ]
    return Result(figures, violations)


def _full(run: Run) -> Result:
    """The disk on which the run-time folder lies is full, for a while."""
    seconds = run.rounds(10, 1)
    with run.laboratory() as laboratory, _small_disk(laboratory) as disk:
        server, client, publisher, subscriber = (laboratory.start(name) for name in ("s", "c", "p", "h"))
        server.serve(channel=_CALLS)
        subscriber.subscribe(channel=_TOPIC, depth=1000)
        greet(publisher, [subscriber])
        client.ask(channel=_CALLS, calls=10**9, deadline=5.0, pace=0.002)
        publisher.publish(channel=_TOPIC, count=10**9, pace=0.005)
        until(lambda: server.written() > 0, 20.0, "calls pass")  # the first one of a thread may need a file
        filled = _fill(disk)
        newcomer = laboratory.try_to_start("newcomer")
        if newcomer:
            with contextlib.suppress(RuntimeError):
                newcomer.serve(channel=_CALLS + "2")
            newcomer.end()
        time.sleep(seconds)
        filled.unlink()
        later = laboratory.start("later")
        later.serve(channel=_CALLS + "3")
        publisher.stop(channel=_TOPIC)
        client.stop(channel=_CALLS)
        until(lambda: last_heard(laboratory, subscriber) == publisher.sent(), 20.0, "the last message is heard")
        lost = subscriber.stats(channel=_TOPIC, count=True)
        history = laboratory.end()
    others = _other_outcomes(history)
    figures = [
        Figure("messages lost", lost["lost"] + lost["dropped"], "", 0),
        Figure("calls that did not end well", sum(others.values()), "", 0),
        *(Figure(f"as {outcome}", number) for outcome, number in sorted(others.items())),
    ]
    return Result(figures, run.check(history))


@contextlib.contextmanager
def _small_disk(laboratory: Laboratory) -> Iterator[Path]:
    where = laboratory.folder / "run"
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m,mode=0700", "tmpfs", str(where)], check=True)
    try:
        yield where
    finally:
        laboratory.kill_all()
        subprocess.run(["umount", "--lazy", str(where)], check=True)


def _fill(disk: Path) -> Path:
    """A file that takes all the room there is."""
    path = disk / "filled"
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))
    return path


def _other_outcomes(history: list[Event]) -> Counter[str]:
    return Counter(event.outcome for event in history if isinstance(event, Ended) and event.outcome != "ok")


def _took(history: list[Event]) -> list[float]:
    asked = {event.call: event.at for event in history if isinstance(event, Asked)}
    return [event.at - asked[event.call] for event in history if isinstance(event, Ended)]


ROWS = [
    Row(
        "clock",
        "clock jump ± 1 h",
        "nothing lost; connected peers go on",
        HERE,
        12,
        _leaping,
        root=True,
    ),
    Row("disk", "disk full", "nothing lost; the component runs on; later ones work", HERE, 11, _full, root=True),
]
