"""One server and many clients, each of which asks again at once: 64 bytes there and back."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..parties import Place
from . import bare, ends
from .crowd import Control, Member, together

NUMBERS = (1, 2, 8, 32)
SIZE = 64
_WARM = 20


@dataclass(frozen=True)
class Clients:
    middleware: str
    party: str
    number: int
    rate: float
    """Calls a second of all clients."""
    p99: float
    """µs, of all calls."""
    fairness: float
    """Jain's index of the numbers of calls: 1 if all clients have as many."""
    part: str = "clients"


def measure(middleware: str, place: Place, numbers: Sequence[int], seconds: float) -> Iterator[Clients]:
    for number in numbers:
        for party in ends.PARTIES:
            if party == ends.OURS or middleware in bare.CLIENTS:
                yield _measured(middleware, party, place, number, seconds)


def _measured(middleware: str, party: str, place: Place, number: int, seconds: float) -> Clients:
    server = Member(_serve, party, middleware, place)
    with together(server):
        server.told()
        clients = [Member(_ask, party, middleware, place, each) for each in range(number)]
        with together(*clients):
            for each in clients:
                each.told()
            for each in clients:
                each.say(seconds)
            taken = [each.told() for each in clients]
    every = sorted(value for each in taken for value in each)
    counts = [len(each) for each in taken]
    return Clients(
        middleware, party, number, sum(counts) / seconds, every[int(len(every) * 0.99)] * 1e6, fairness(counts)
    )


def fairness(counts: Sequence[float]) -> float:
    """Jain's index: 1 if all are equal, 1 ÷ n if all but one are nothing."""
    squares = statistics.fmean(each * each for each in counts)
    return statistics.fmean(counts) ** 2 / squares if squares else 0.0


def _serve(control: Control, party: str, middleware: str, place: Place) -> None:
    with ends.of(party).server(middleware, place):
        control.send("ready")
        control.recv()


def _ask(control: Control, party: str, middleware: str, place: Place, number: int) -> None:
    data = np.ones(SIZE, np.uint8)
    with ends.of(party).client(middleware, place, number) as ask:
        for _ in range(_WARM):
            ask(data)
        control.send("ready")
        seconds = control.recv()
        taken, now = [], time.perf_counter
        end = now() + seconds
        while (begun := now()) < end:
            ask(data)
            taken.append(now() - begun)
        control.send(taken)
        control.recv()
