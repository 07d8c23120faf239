"""Measures the cost of handing a message over to another thread before its handler runs.

Normally the thread that received a message runs its handler. Here a second party puts messages into a queue, from
which another thread takes them. Everything else is the same.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from queue import SimpleQueue
from typing import Any

from robocomp_py.transports.base import Channel, Reply, Service, Sink, Transport

from . import ours
from .pair import Pair, place
from .parties import Party, Place
from .publish import latency_of
from .query import Tell, some
from .rounds import Effort, Times, by_turns, difference, how_many, seconds_of, times
from .tables import Table, octets, us

log = logging.getLogger("benchmarks")

CASES = (("query", 64), ("query", 1_000_000), ("publish", 64))


@dataclass(frozen=True)
class Row:
    middleware: str
    what: str
    size: int
    here: Times
    """When the receiving thread runs the handler."""
    handed: Times
    more: float
    """µs that the other way takes longer."""


class HandedOver:
    """A transport whose sinks and services are called by a separate thread."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._jobs: SimpleQueue[partial[None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="handlers")
        self._thread.start()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def server(self, channel: Channel, service: Service) -> Any:
        def take(payload: Any, expires: float) -> Future[Reply]:
            reply: Future[Reply] = Future()
            self._jobs.put(partial(_answer, service, payload, expires, reply))
            return reply

        return self._transport.server(channel, take)

    def inlet(self, channel: Channel, sink: Sink) -> Any:
        return self._transport.inlet(channel, lambda payload: self._jobs.put(partial(_hear, sink, payload)))

    def close(self) -> None:
        self._transport.close()
        self._jobs.put(None)
        self._thread.join()

    def _run(self) -> None:
        while job := self._jobs.get():
            try:
                job()
            except Exception:
                log.exception("a handler raised")


def _answer(service: Service, payload: Any, expires: float, reply: Future[Reply]) -> None:
    found = service(payload, expires)
    if isinstance(found, Reply):
        reply.set_result(found)
    else:
        found.add_done_callback(lambda done: reply.set_result(done.result()))


def _hear(sink: Sink, payload: Any) -> None:
    sink(payload)


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for middleware in middlewares:
        if middleware == "inproc":
            continue  # inproc runs the handler in the calling thread
        parties = [
            Party(partial(ours.Far, middleware, through=through), partial(ours.Near, middleware))
            for through in (None, HandedOver)
        ]
        with place() as one, Pair(parties[0], one) as here, _elsewhere() as other, Pair(parties[1], other) as handed:
            for what, size in CASES:
                tell(f"threads · {middleware} · {what} · {octets(size)}")
                measures = [_measure(pair, what, size, effort.seconds) for pair in (here, handed)]
                first, second = by_turns(measures, effort.rounds)
                rows.append(Row(middleware, what, size, times(first), times(second), difference(second, first)))
    return rows


@contextlib.contextmanager
def _elsewhere() -> Iterator[Place]:
    """A separate place for the second pair, which serves the same operation."""
    with place() as here:
        yield replace(here, domain=here.domain + 1)


def _measure(pair: Pair, what: str, size: int, seconds: float) -> Any:
    if what == "publish":
        return latency_of(pair, pair.near.publish, some(size), seconds)
    ask = partial(pair.near.ask, some(size))
    return partial(seconds_of, ask, how_many(ask, seconds))


def table(rows: list[Row]) -> Table:
    head = ("", "", "array", "by who received it", "p99", "handed over", "p99", "difference")
    cells = [
        (
            *(row.middleware, row.what, octets(row.size), us(row.here.p50), us(row.here.p99)),
            *(us(row.handed.p50), us(row.handed.p99), f"{row.more:+.1f} µs"),
        )
        for row in rows
    ]
    return Table("threads", "who runs the handler", head, cells, labels=3)
