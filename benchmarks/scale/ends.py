"""Our ends of many channels, each as a component has it. `bare` has those of the libraries.

Topics are best-effort with a depth of ten, as by default.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Verb
from robocomp_py.contract.qos import QoS
from robocomp_py.contract.types import UINT8, Field, Sequence
from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.route import Route, Router
from robocomp_py.transports.base import Link, Transport, gathering, wait_connected

from ..ours import BYTES, IMPLEMENTS, PUBLISHES, REQUIRES, SUBSCRIBES, Handlers, echo, news
from ..ours import connected as opened
from ..parties import PATIENCE, TAKES, Act, Array, Hear, Place

quick: Operation[Any] = Operation("Benchmark::Quick", "quick", BYTES, (Field("ret", Sequence(UINT8)),))
slow: Operation[Any] = Operation("Benchmark::Slow", "slow", BYTES)
QUICK, SLOW = Interface("Benchmark::Quick", (quick,)), Interface("Benchmark::Slow", (slow,))

OURS, RAW = "ours", "raw"
PARTIES = (OURS, RAW)


def of(party: str) -> ModuleType:
    """The module with the ends of a party."""
    if party == OURS:
        return sys.modules[__name__]
    from . import bare

    return bare


@contextlib.contextmanager
def publications(middleware: str, place: Place, number: int, connected: float = 0.0) -> Iterator[list[Act]]:
    """So many topics; functions that publish on them. Waits up to `connected` seconds for their subscribers."""
    with _component(middleware, place) as (transport, monitor, links):
        proxies = []
        with gathering(transport):
            for each in range(number):
                proxy, more = ports.bind_proxy(PUBLISHES, _route(transport, each), monitor)
                links += more
                proxies.append(proxy)
        if connected:
            for link in links:
                if not (link.wait_peer(connected) and wait_connected(link, connected)):
                    raise TimeoutError(f"{middleware}: not connected within {connected:g} s")
        monitor.open()
        with _inside(monitor):
            yield [_publishing(proxy) for proxy in proxies]


@contextlib.contextmanager
def subscriptions(middleware: str, place: Place, hears: list[Hear]) -> Iterator[list[Link]]:
    """A subscription for each of these functions, to the topics from the first one on."""
    with _component(middleware, place) as (transport, monitor, links):
        with gathering(transport):
            for number, hear in enumerate(hears):
                links += ports.bind_handlers(SUBSCRIBES, Handlers(hear), _route(transport, number), monitor)
        monitor.open()
        yield links


@contextlib.contextmanager
def server(middleware: str, place: Place) -> Iterator[None]:
    with _component(middleware, place) as (transport, monitor, links):
        links += ports.bind_handlers(IMPLEMENTS, Handlers(_ignore), _route(transport, 0), monitor)
        monitor.open()
        yield


@contextlib.contextmanager
def client(middleware: str, place: Place, number: int) -> Iterator[Act]:
    with _component(middleware, place) as ends, _calling(REQUIRES, echo, *ends) as ask:
        yield ask


class Mixed:
    """Handlers of both operations."""

    def Quick_quick(self, data: Array) -> Array:
        return data

    def Slow_slow(self, data: Array) -> None:
        time.sleep(TAKES)


@contextlib.contextmanager
def mixed_server(middleware: str, place: Place) -> Iterator[None]:
    """Serves `quick`, which may run beside other handlers, and `slow`."""
    with _component(middleware, place) as (transport, monitor, links):
        for port in (Port(Verb.IMPLEMENTS, QUICK, concurrent=True), Port(Verb.IMPLEMENTS, SLOW)):
            links += ports.bind_handlers(port, Mixed(), _route(transport, 0), monitor)
        monitor.open()
        yield


@contextlib.contextmanager
def mixed_client(middleware: str, place: Place, is_slow: bool) -> Iterator[Act]:
    interface, operation = (SLOW, slow) if is_slow else (QUICK, quick)
    port = Port(Verb.REQUIRES, interface, proxy=ports.Proxy)
    with _component(middleware, place) as ends, _calling(port, operation, *ends) as ask:
        yield ask


@contextlib.contextmanager
def _calling(
    port: Port, operation: Operation[Any], transport: Transport, monitor: Monitor, links: list[Link]
) -> Iterator[Act]:
    proxy, more = ports.bind_proxy(port, _route(transport, 0), monitor)
    links += more
    if not all(link.wait_peer(PATIENCE) for link in links):
        raise TimeoutError(f"{port.interface.short}: no server within {PATIENCE:g} s")
    monitor.open()
    with _inside(monitor):
        yield lambda data: proxy._ask(operation, (data,), None)


@contextlib.contextmanager
def _component(middleware: str, place: Place) -> Iterator[tuple[Transport, Monitor, list[Link]]]:
    transport, monitor, links = opened(middleware, place), Monitor(), list[Link]()
    try:
        yield transport, monitor, links
    finally:
        monitor.turn_away()
        ports.close_all(links)
        monitor.close()
        transport.close()


@contextlib.contextmanager
def _inside(monitor: Monitor) -> Iterator[None]:
    """As `compute` runs."""
    monitor.enter()
    try:
        yield
    finally:
        monitor.leave()


def _route(transport: Transport, number: int) -> Router:
    return lambda port, operation: Route(
        transport, "", f"benchmark/c{number}/{port.interface.short}/{operation.name}", QoS(), PATIENCE
    )


def _publishing(proxy: Any) -> Act:
    return lambda data: proxy._send(news, (data,), None)


def _ignore(data: Array) -> None:
    """Hears nothing."""
