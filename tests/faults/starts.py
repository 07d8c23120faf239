"""A row about starts: components that are ready have found each other, so the first publication is heard."""

from __future__ import annotations

import contextlib
import os
import random
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

from tests.deploy.laboratory import Laboratory as Network
from tests.transports.ice.icestorm import icestorm

from .checker import Violation
from .laboratory import ROOT, Laboratory, Remote, running, until
from .network import OWN_CLOCK
from .rows import HERE, Figure, Result, Row, Run

_LOAD = 2
"""Busy processes for each core, beside everything."""

_LATE = 5.0
"""Seconds after which a publication counts as not heard."""

_NEW = ("reader", "herald", "both")
_WHY = ("ready", "commanded", "asked")
"""When the herald publishes: both are ready; a command, or a call, of the reader arrived."""

_PLACES = {
    "inproc": ("one process",),
    "shm": ("one process", "two processes"),
    "ice": ("one process", "two processes"),
}
_ALL_PLACES = ("one process", "two processes", "two hosts")


class _Pair(NamedTuple):
    herald: Remote
    reader: Remote
    options: tuple[dict[str, Any], dict[str, Any]]
    """Of the herald's transport, and of the reader's."""

    def start(self, name: str, qos: str) -> None:
        actor = self.herald if name == "herald" else self.reader
        options = self.options[name == "reader"]
        source = "herald" if name == "reader" else ""
        actor.live(kind=name, name=name, source=source, patient=False, options=options, qos=qos)

    def leave(self, name: str) -> None:
        (self.herald if name == "herald" else self.reader).leave(name=name)

    def both_up(self) -> bool:
        return bool(self.herald.is_up(name="herald") and self.reader.is_up(name="reader"))


def _first(run: Run) -> Result:
    """At each start the reader, the herald, or both are new, in any order; what is published first is to be heard."""
    starts = run.rounds(200, 6)
    figures: list[Figure] = []
    violations: list[Violation] = []
    for place in _PLACES.get(run.transport, _ALL_PLACES):
        missing: list[str] = []
        with _load(), _pair(run, place) as pair:
            for number, qos in ((number, ("", "services_default")[number > starts // 2]) for number in range(starts)):
                missing += _started(
                    pair, number, qos, first=number in (0, starts // 2 + 1), chance=_chance(run, number)
                )
        run.tell(f"{place}: {starts} starts, {len(missing)} publications not heard")
        figures += [Figure(f"starts in {place}", starts), Figure("publications not heard", len(missing), "", 0)]
        violations += [Violation("first", f"{place}: {each}") for each in missing]
    return Result(figures, violations)


def _chance(run: Run, number: int) -> random.Random:
    return random.Random(f"{run.seed} {number}")


def _started(pair: _Pair, number: int, qos: str, *, first: bool, chance: random.Random) -> list[str]:
    """Start what is to be new; what was published then and not heard."""
    new = "both" if first else chance.choice(_NEW)
    names = ["herald", "reader"] if new == "both" else [new]
    chance.shuffle(names)
    if number:
        for name in names:
            pair.leave(name)
    number += 1
    for name in names:
        pair.start(name, qos)
    pair.reader.demand(name="reader", number=number)
    until(pair.both_up, 60.0, f"start {number}: both are ready")
    pair.herald.proclaim(name="herald", number=number)
    expected = {(number, why) for why in _WHY}
    until(lambda: expected <= _news(pair.herald, "herald"), 60.0, f"start {number}: all is published")
    with contextlib.suppress(RuntimeError):  # told by what is missing
        until(lambda: expected <= _news(pair.reader, "reader"), _LATE, "all is heard")
    missing = sorted(why for _, why in expected - _news(pair.reader, "reader"))
    return [f"start {number}, new: {', '.join(names)}; qos: {qos or 'usual'}; published when {why}" for why in missing]


def _news(actor: Remote, name: str) -> set[tuple[int, str]]:
    return {(number, why) for number, why in actor.news(name=name)}


@contextlib.contextmanager
def _pair(run: Run, place: str) -> Iterator[_Pair]:
    """The processes, on the hosts."""
    with contextlib.ExitStack() as everything:
        if place == "two hosts":
            yield everything.enter_context(_far_apart(run))
            return
        options = {"storm": everything.enter_context(icestorm())} if run.transport == "ice" else {}
        laboratory = everything.enter_context(Laboratory(run.transport, options))
        herald = laboratory.start("a")
        reader = herald if place == "one process" else laboratory.start("b")
        yield _Pair(herald, reader, (options, options))


@contextlib.contextmanager
def _far_apart(run: Run) -> Iterator[_Pair]:
    with contextlib.ExitStack() as everything:
        network = everything.enter_context(Network())
        here, there = network.host("here"), network.host("there")
        own: dict[str, Any] = {}
        options: tuple[dict[str, Any], dict[str, Any]] = ({}, {})
        match run.transport:
            case "dds":
                own = {"interface": "eth0"}
                options = own, own
            case "zenoh":
                from robocomp_py.transports.zenoh.session import open_router

                own = {"connect": f"tcp/{network.address}:7447"}
                everything.callback(open_router(own["connect"]).close)
                options = own, own
            case "zeromq":
                address = f"tcp://{here.address}:5555"
                options = {"bind": address}, {"connect": {"herald": address}}
        laboratory = everything.enter_context(Laboratory(run.transport, {"connect": "-"}))
        herald = laboratory.start("a", prefix=tuple(here.command()), options=own, run="run-here")
        boot = laboratory.folder / "boot_id"
        boot.write_text("00000000-0000-0000-0000-000000000000\n")
        prefix = (*there.command(), *OWN_CLOCK, str(boot))
        yield _Pair(herald, laboratory.start("b", prefix=prefix, options=own, run="run-there"), options)


@contextlib.contextmanager
def _load() -> Iterator[None]:
    """Keep every core busy, so that threads run in an order that a quiet machine does not have."""
    with contextlib.ExitStack() as everything:
        for _ in range(_LOAD * len(os.sched_getaffinity(0))):
            everything.enter_context(running([sys.executable, "-c", "while True: pass"], cwd=ROOT))
        yield


ROWS = [
    Row(
        "first",
        "200 starts of a publisher, a subscriber or both, beside two busy processes a core",
        "publications after both are ready, or in reply to the subscriber, are heard",
        ("inproc", *HERE, "ice"),
        180,
        _first,
        root=True,
    ),
]
