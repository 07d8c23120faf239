"""What publications cost that no peer has asked for."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..parties import Place
from ..process import megabytes
from . import bare, ends
from .crowd import Control, Member, together

NUMBERS = (1, 16, 64, 256)


@dataclass(frozen=True)
class Idle:
    middleware: str
    party: str
    number: int
    megabytes: float
    """Of the whole process, with Python and its libraries: its share of what it has in common with others."""
    descriptors: int
    """Those that it has more than before."""
    seconds: float
    """From opening the first one until all are there."""
    part: str = "idle"


def measure(middleware: str, place: Place, numbers: Sequence[int]) -> Iterator[Idle]:
    for number in numbers:
        for party in ends.PARTIES:
            if party == ends.OURS or middleware in bare.IDLE:
                member = Member(_publish, party, middleware, place, number, fresh=True)
                with together(member):
                    yield Idle(middleware, party, number, *member.told())


def _publish(control: Control, party: str, middleware: str, place: Place, number: int) -> None:
    end = ends.of(party)
    with end.publications(middleware, place, 1):  # imports what it needs
        pass
    before = _descriptors()
    begun = time.perf_counter()
    with end.publications(middleware, place, number):
        taken = time.perf_counter() - begun
        control.send((megabytes(os.getpid()), _descriptors() - before, taken))
        control.recv()


def _descriptors() -> int:
    return len(os.listdir("/dev/fd"))
