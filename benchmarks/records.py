"""Measures points as records: a query with 100,000 points of 20 bytes and the same reply, beside an array of bytes.

The same points as a list of objects show the gain of records.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Verb
from robocomp_py.contract.types import FLOAT32, INT32, UINT8, Field, Sequence, Struct, Type
from robocomp_py.runtime import ports
from robocomp_py.runtime.api import dtype_of, objects_of
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.transports.base import Link

from .goals import Finding
from .ours import connected, route
from .pair import Pair, place
from .parties import PATIENCE, Array, Hear, Party, Place
from .query import Tell
from .rounds import Effort, by_turns, how_many, ratio, seconds_of, times
from .tables import Table, times_as_much, us

GOAL = 1.5
POINTS = 100_000


@dataclass(slots=True)
class Point:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    intensity: int = 0
    ring: int = 0

    __contract__: ClassVar[Struct]


Point.__contract__ = Struct(
    "Benchmark::Point",
    (
        *(Field(name, FLOAT32) for name in ("x", "y", "z")),
        *(Field(name, INT32) for name in ("intensity", "ring")),
    ),
    Point,
)


def _echo(name: str, kind: Type) -> Operation[Any]:
    return Operation("Benchmark::Points", name, (Field("data", kind),), (Field("ret", kind),))


ECHOES = {
    "bytes": _echo("bytes", Sequence(UINT8)),
    "records": _echo("records", Sequence(Point.__contract__, records=True)),
    "list": _echo("list", Sequence(Point.__contract__)),
}
INTERFACE = Interface("Benchmark::Points", tuple(ECHOES.values()))
REQUIRES, IMPLEMENTS = Port(Verb.REQUIRES, INTERFACE, proxy=ports.Proxy), Port(Verb.IMPLEMENTS, INTERFACE)


@dataclass(frozen=True)
class Row:
    """In µs, for each query; `ratio` is records ÷ bytes."""

    middleware: str
    octets: float
    records: float
    objects: float
    ratio: float


class Far:
    def __init__(self, middleware: str, where: Place, hear: Hear) -> None:
        self._transport, self._monitor = connected(middleware, where), Monitor()
        self._links: list[Link] = []
        try:
            router = route(self._transport, where.depth)
            self._links += ports.bind_handlers(IMPLEMENTS, _Handlers(), router, self._monitor)
        except BaseException:
            self.close()
            raise
        self._monitor.open()

    def close(self) -> None:
        self._monitor.turn_away()
        ports.close_all(self._links)
        self._monitor.close()
        self._transport.close()


class _Handlers:
    def __init__(self) -> None:
        self.Points_bytes = self.Points_records = self.Points_list = lambda data: data


class Near:
    def __init__(self, middleware: str, where: Place) -> None:
        self._transport, self._monitor = connected(middleware, where), Monitor()
        self._proxy, self._links = ports.bind_proxy(REQUIRES, route(self._transport, where.depth), self._monitor)
        if not all(link.wait_peer(PATIENCE) for link in self._links):
            raise TimeoutError(f"{middleware}: the two ends did not find each other within {PATIENCE:g} s")
        self._monitor.open()
        self._monitor.enter()

    def echo(self, name: str, data: Any) -> Any:
        return self._proxy._ask(ECHOES[name], (data,), None)

    def ask(self, data: Array) -> Array:
        answer: Array = self.echo("bytes", data)
        return answer

    def publish(self, data: Array) -> None:
        raise NotImplementedError("there is no topic")

    def close(self) -> None:
        self._monitor.leave()
        self._monitor.turn_away()
        ports.close_all(self._links)
        self._monitor.close()
        self._transport.close()


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    points = np.ones(POINTS, dtype_of(Point))
    values = {"bytes": points.view(np.uint8), "records": points, "list": list(objects_of(points, Point))}
    rows = []
    for middleware in middlewares:
        tell(f"records · {middleware}")
        party = Party(partial(Far, middleware), partial(Near, middleware), apart=middleware != "inproc")
        with place() as here, Pair(party, here) as pair:
            near = pair.near
            assert isinstance(near, Near)
            calls: list[Callable[[], object]] = [partial(near.echo, name, value) for name, value in values.items()]
            measures = [partial(_measured, call, effort.seconds) for call in calls]
            octets, records, objects = by_turns(measures, effort.rounds)
        as_octets, as_records, as_objects = (times(each).p50 for each in (octets, records, objects))
        rows.append(Row(middleware, as_octets, as_records, as_objects, ratio(records, octets)))
    return rows


def _measured(call: Callable[[], object], seconds: float) -> list[float]:
    return seconds_of(call, how_many(call, seconds))


def table(rows: list[Row]) -> Table:
    head = ("", "bytes", "records", "ratio", "goal", "list of objects")
    cells = [
        (
            row.middleware,
            us(row.octets),
            us(row.records),
            times_as_much(row.ratio),
            f"≤ {GOAL:g} ×: {'met' if row.ratio <= GOAL else 'missed'}",
            us(row.objects),
        )
        for row in rows
    ]
    return Table("records", "query: 100,000 points of 20 bytes there and back", head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        Finding("records", row.middleware, "", times_as_much(row.ratio), row.ratio <= GOAL, row.ratio) for row in rows
    ]
