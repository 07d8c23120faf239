"""A handler that takes long does not keep others waiting that may run beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from robocomp_py.contract import types as t
from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Pattern, Verb
from robocomp_py.contract.qos import QoS
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.ports import bind_handlers, close_all
from robocomp_py.runtime.route import Route
from robocomp_py.runtime.tally import Tally
from robocomp_py.transports.base import Capability, Channel, Statistics, receives
from robocomp_py.wire.messagepack import MessagePack

work: Operation[None] = Operation("Test::Works", "work", (t.Field("seconds", t.FLOAT64),))
heard: Operation[None] = Operation("Test::News", "heard", work.inputs, pattern=Pattern.PUBLISH)
WORKS, NEWS = Interface("Test::Works", (work,)), Interface("Test::News", (heard,))


class Ends:
    """A transport with nothing but the functions that it would call."""

    def __init__(self) -> None:
        self.codec, self.capabilities = MessagePack(), Capability.RELIABLE
        self.called: Callable[..., object]

    def server(self, channel: Channel, service: Callable[..., object]) -> Any:
        return self.inlet(channel, lambda payload: service(payload, time.monotonic() + 60))

    def inlet(self, channel: Channel, sink: Callable[..., object]) -> Any:
        self.called = sink
        return SimpleNamespace(stats=Statistics(), close=lambda: None)


@pytest.fixture
def steps() -> Iterator[list[str]]:
    """What happens on this thread, which receives for a transport."""
    happened: list[str] = []
    receives(lambda: happened.append("another thread receives"))
    yield happened
    receives(None)


@contextmanager
def bound(port: Port, steps: list[str]) -> Iterator[tuple[Callable[[float], object], Tally]]:
    """Calls a handler that takes these seconds; and what is counted of it."""

    def handle(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            pass
        steps.append("handled")

    ends, monitor = Ends(), Monitor()
    transport: Any = ends
    handlers = SimpleNamespace(Works_work=handle, News_heard=handle)
    links = bind_handlers(port, handlers, lambda *_: Route(transport, "", "a/b/c", QoS(), 5.0), monitor)
    monitor.open()
    encode = ends.codec.encoder((work if port.interface is WORKS else heard).request)
    try:
        yield lambda seconds: ends.called(encode((seconds,))), monitor.tallies.every[0]
    finally:
        close_all(links)
        monitor.close()


PORTS = [Port(Verb.IMPLEMENTS, WORKS), Port(Verb.SUBSCRIBES, NEWS), Port(Verb.SUBSCRIBES, NEWS, concurrent=True)]


@pytest.mark.parametrize("port", PORTS)
def test_another_thread_receives_while_a_handler_runs_that_has_taken_long(port: Port, steps: list[str]) -> None:
    with bound(port, steps) as (call, _):
        call(0.01)
        call(0.0)
    assert steps[-2:] == ["another thread receives", "handled"]


@pytest.mark.parametrize("port", PORTS)
def test_another_thread_receives_also_if_few_of_the_frequent_calls_are_timed(port: Port, steps: list[str]) -> None:
    with bound(port, steps) as (call, tally):
        for _ in range(200):
            call(0.0)
        tally.time_next()
        call(0.01)
        call(0.0)
    assert steps[-2:] == ["another thread receives", "handled"]
