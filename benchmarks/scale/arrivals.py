"""Many topics at 10 Hz between two components: what is sent, heard, counted as lost, and not yet discovered.

A message is not discovered if it was sent before the first one that its subscriber heard. What is missing beyond that
and is not counted as lost is not accounted for: there should be none.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..parties import INT, PATIENCE, Array, Place
from . import ends
from .crowd import Control, Member, together

NUMBERS = (16, 64, 256)
RATE = 10.0
_LAST = 0.5
"""Seconds for the last messages."""


@dataclass(frozen=True)
class Arrivals:
    middleware: str
    number: int
    waits: bool
    """Whether the publisher waits until its subscribers are connected, as a component does when it starts."""
    sent: int
    heard: int
    lost: int
    undiscovered: int
    party: str = ends.OURS
    part: str = "arrivals"

    @property
    def missing(self) -> int:
        """What is not accounted for."""
        return self.sent - self.heard - self.lost - self.undiscovered


def measure(middleware: str, place: Place, numbers: Sequence[int], seconds: float) -> Iterator[Arrivals]:
    for number in numbers:
        for waits in (False, True):
            yield _measured(middleware, place, number, waits, seconds)


def _measured(middleware: str, place: Place, number: int, waits: bool, seconds: float) -> Arrivals:
    subscriber = Member(_subscribe, middleware, place, number)
    publisher = Member(_publish, middleware, place, number, waits, seconds)
    with together(subscriber, publisher):
        subscriber.told()
        each_sent = publisher.told(seconds + 6 * PATIENCE)
        time.sleep(_LAST)
        subscriber.say("end")
        first, heard, lost = subscriber.told()
    undiscovered = sum(each - 1 if each else each_sent for each in first)
    return Arrivals(middleware, number, waits, each_sent * number, heard, lost, undiscovered)


def _publish(control: Control, middleware: str, place: Place, number: int, waits: bool, seconds: float) -> None:
    data, times = np.zeros(64, np.uint8), max(2, int(seconds * RATE))
    with ends.publications(middleware, place, number, connected=PATIENCE if waits else 0.0) as publishes:
        begun = time.monotonic()
        for each in range(1, times + 1):
            INT.pack_into(data.data, 0, each)
            for publish in publishes:
                publish(data)
            time.sleep(max(0.0, begun + each / RATE - time.monotonic()))
        control.send(times)
        control.recv()


def _subscribe(control: Control, middleware: str, place: Place, number: int) -> None:
    first, counts = [0] * number, [0] * number

    def hear(which: int, data: Array) -> None:
        first[which] = first[which] or INT.unpack_from(data.data)[0]
        counts[which] += 1

    with ends.subscriptions(middleware, place, [partial(hear, each) for each in range(number)]) as links:
        control.send("ready")
        control.recv()
        lost = sum(link.stats.lost + link.stats.dropped for link in links)
        control.send((first, sum(counts), lost))
        control.recv()
