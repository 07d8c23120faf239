"""One server with a quick operation and one that takes 5 ms: what a call of the quick one takes, with and without it.

The slow handler is one of an ordinary interface, of which one runs at a time; the quick one is declared `concurrent`.
The bare server has a pool of threads. Rounds with and without calls of the slow one follow each other, so that other
programs disturb both.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..parties import Place
from . import bare, ends
from .crowd import Control, Member, together

NUMBERS = (1, 4)
SIZE = 64
_WARM = 20


@dataclass(frozen=True)
class Mixed:
    middleware: str
    party: str
    number: int
    """Clients of the slow operation."""
    alone: float
    """µs: p99 of a call of the quick one, while the slow one is not called."""
    beside: float
    """µs: the same, while it is called all the time."""
    factor: float
    """`beside` ÷ `alone`: the median of the rounds."""
    part: str = "mixed"


def measure(middleware: str, place: Place, numbers: Sequence[int], rounds: int, seconds: float) -> Iterator[Mixed]:
    for party in ends.PARTIES:
        if party == ends.OURS or middleware in bare.CLIENTS:
            yield from _measured(middleware, party, place, numbers, rounds, seconds)


def _measured(
    middleware: str, party: str, place: Place, numbers: Sequence[int], rounds: int, seconds: float
) -> Iterator[Mixed]:
    server = Member(_serve, party, middleware, place)
    with together(server):
        server.told()
        quick, *slow = (Member(_ask, party, middleware, place, each > 0) for each in range(max(numbers) + 1))
        with together(quick, *slow):
            for each in (quick, *slow):
                each.told()
            found = [[_late(quick, slow[:number], seconds) for number in (0, *numbers)] for _ in range(rounds)]
    alone, *beside = (list(each) for each in zip(*found, strict=True))
    for number, late in zip(numbers, beside, strict=True):
        factor = statistics.median(one / other for one, other in zip(late, alone, strict=True))
        yield Mixed(middleware, party, number, statistics.median(alone), statistics.median(late), factor)


def _late(quick: Member, slow: Sequence[Member], seconds: float) -> float:
    """The p99 of calls of the quick operation while these call the slow one, in µs."""
    asking = (*slow, quick)
    for each in asking:
        each.say(seconds)
    taken = [each.told() for each in asking][-1]
    return float(sorted(taken)[int(len(taken) * 0.99)] * 1e6)


def _serve(control: Control, party: str, middleware: str, place: Place) -> None:
    with ends.of(party).mixed_server(middleware, place):
        control.send("ready")
        control.recv()


def _ask(control: Control, party: str, middleware: str, place: Place, is_slow: bool) -> None:
    data = np.full(SIZE, is_slow, np.uint8)  # which tells the bare server
    with ends.of(party).mixed_client(middleware, place, is_slow) as ask:
        for _ in range(_WARM):
            ask(data)
        control.send("ready")
        now = time.perf_counter
        while True:
            seconds, taken = control.recv(), list[float]()
            end = now() + seconds
            while (begun := now()) < end:
                ask(data)
                taken.append(now() - begun)
            control.send(taken)
