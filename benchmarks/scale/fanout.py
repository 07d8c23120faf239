"""One publisher at 50 Hz and many subscribers, each in a process of its own."""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..parties import INT, PATIENCE, Array, Place, stamp
from . import bare, ends
from .crowd import Control, Member, together

NUMBERS = (1, 4, 16)
SIZES = (1024, 1_000_000)
RATE = 50.0

_LAST = 0.2
"""Seconds for the last message."""


@dataclass(frozen=True)
class Fanout:
    middleware: str
    party: str
    number: int
    size: int
    cpu: float
    """Per cent of a core for each subscriber, in its own process."""
    publishing: float
    """Per cent of a core for the publisher."""
    p99: float
    """µs, from sending to the handler, of all subscribers."""
    part: str = "fanout"


def measure(
    middleware: str, place: Place, numbers: Sequence[int], sizes: Sequence[int], seconds: float
) -> Iterator[Fanout]:
    for size in sizes:
        for number in numbers:
            for party in ends.PARTIES:
                if party == ends.OURS or middleware in bare.TOPICS:
                    yield _measured(middleware, party, place, number, size, seconds)


def _measured(middleware: str, party: str, place: Place, number: int, size: int, seconds: float) -> Fanout:
    publisher = Member(_publish, party, middleware, place, size, seconds)
    with together(publisher):
        publisher.told()
        subscribers = [Member(_subscribe, party, middleware, place) for _ in range(number)]
        with together(*subscribers):
            for each in subscribers:
                each.told()
            for each in subscribers:
                each.say("begin")
            publisher.say("begin")
            publishing = publisher.told(seconds + 3 * PATIENCE)
            time.sleep(_LAST)
            for each in subscribers:
                each.say("end")
            found = [each.told() for each in subscribers]
    latencies = sorted(value for _, values in found for value in values)
    if not latencies:
        raise RuntimeError(f"{middleware}: no subscriber heard anything")
    cpu = statistics.fmean(share for share, _ in found)
    return Fanout(
        middleware, party, number, size, 100 * cpu, 100 * publishing, latencies[int(len(latencies) * 0.99)] / 1e3
    )


def _publish(control: Control, party: str, middleware: str, place: Place, size: int, seconds: float) -> None:
    data = np.ones(size, np.uint8)
    with ends.of(party).publications(middleware, place, 1) as (publish,):
        control.send("ready")
        while not control.poll(1 / RATE):  # each subscriber waits for its first message
            stamp(data)
            publish(data)
        control.recv()
        begun, before = time.monotonic(), time.process_time()
        for number in range(1, max(2, int(seconds * RATE)) + 1):
            stamp(data)
            publish(data)
            time.sleep(max(0.0, begun + number / RATE - time.monotonic()))
        control.send((time.process_time() - before) / (time.monotonic() - begun))
        control.recv()


def _subscribe(control: Control, party: str, middleware: str, place: Place) -> None:
    heard, latencies = threading.Event(), list[int]()

    def hear(data: Array) -> None:
        latencies.append(time.monotonic_ns() - INT.unpack_from(data.data)[0])
        heard.set()

    with ends.of(party).subscriptions(middleware, place, [hear]):
        if not heard.wait(2 * PATIENCE):
            raise TimeoutError(f"{middleware}: nothing heard within {2 * PATIENCE:g} s")
        control.send("heard")
        control.recv()
        latencies.clear()
        begun, before = time.monotonic(), time.process_time()
        control.recv()
        control.send(((time.process_time() - before) / (time.monotonic() - begun), list(latencies)))
        control.recv()
