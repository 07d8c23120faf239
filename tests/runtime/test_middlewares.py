"""The same classes over every middleware, and over several of them at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import Timeout
from robocomp_py.runtime.lifecycle import State
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import Channel, Transport, TransportConfig, TransportFactory, find_transport

from .components import MIDDLEWARES, RELIABLE, Diary, EverythingProxy, EverythingPublisher, Station
from .running import make, running


class Visitor(Diary):
    """Asks everything there is to ask, pokes, and listens."""

    component = Component(
        "visitor",
        (
            Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
            Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),
        ),
        period=0.005,
    )
    everything_proxy: EverythingProxy

    def compute(self) -> None:
        arrays = e.Arrays(floats=np.linspace(0, 1, 300_000, dtype=np.float32))
        answered = self.everything_proxy._ask(e.echo_arrays, (arrays,), None)
        np.testing.assert_array_equal(answered.floats, arrays.floats)
        nested = e.Nested(by_name={"here": e.Point(1.0, 2.0)}, rows=[[e.Point(3.0, 4.0)]])
        assert self.everything_proxy._ask(e.echo_nested, (nested,), None) == nested
        with pytest.raises(e.Failed, match="division by zero"):
            self.everything_proxy.divide(7, 0)
        self.entries += [str(self.everything_proxy.divide(7, 2)), self.everything_proxy.work("done")]
        self.everything_proxy.poke(self.entries.count("done"))

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"{text} {number}")

    def has_all(self) -> bool:
        return {"(3, 1)", "done", "poked 1", "poked 2", "poked 3"} <= set(self.entries)


class Noting:
    """Has transports note which operations they carry."""

    def __init__(self) -> None:
        self.carried: set[tuple[str, str]] = set()

    def find(self, name: str) -> TransportFactory:
        def open_it(config: TransportConfig) -> Transport:
            transport: Any = find_transport(name)(config)
            for verb in ("outlet", "inlet", "caller", "server"):
                setattr(transport, verb, self._noting(name, getattr(transport, verb)))
            return transport  # type: ignore[no-any-return]

        return open_it

    def _noting(self, name: str, verb: Callable[..., Any]) -> Callable[..., Any]:
        def noted(channel: Channel, *rest: Any) -> Any:
            self.carried.add((channel.name.rsplit("/", 2)[1] + "." + channel.name.rsplit("/", 1)[1], name))
            return verb(channel, *rest)

        return noted


@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_the_same_classes_do_the_same_over_every_middleware(middleware: str) -> None:
    chosen = f"middleware={middleware}"
    with (
        running(make(Station, find_transport, chosen)) as station,
        running(make(Visitor, find_transport, chosen)) as visitor,
    ):
        wait_until(visitor.has_all)
    assert (station.outcome, visitor.outcome) == (True, True)


def test_one_component_uses_all_middlewares_at_once_by_port_and_by_operation() -> None:
    """Most of the interface goes one way, two operations and the news others; both ends agree by configuration."""
    noting = Noting()
    ways = {"": "zeromq", ".divide": "dds", ".poke": "zenoh"}
    served = [f"ports.Everything{operation}.middleware={way}" for operation, way in ways.items()]
    asked = [f"ports.everything{operation}.middleware={way}" for operation, way in ways.items()]
    station = make(Station, noting.find, "middleware=inproc", *served, "ports.everything.middleware=dds")
    visitor = make(Visitor, noting.find, "middleware=inproc", *asked, "ports.Everything.middleware=dds")
    with running(station), running(visitor) as worker:
        wait_until(worker.has_all)
    ours = {each for each in noting.carried if each[0].startswith("Everything.")}
    assert ours == {
        ("Everything.echo_nested", "zeromq"),
        ("Everything.echo_arrays", "zeromq"),
        ("Everything.work", "zeromq"),
        ("Everything.divide", "dds"),
        ("Everything.poke", "zenoh"),
        ("Everything.news", "dds"),
    }
    assert {way for name, way in noting.carried - ours} == {"inproc"}, "CommonBehavior goes where nothing else is said"


def test_a_client_on_another_middleware_finds_no_server() -> None:
    lost = make(Visitor, find_transport, "middleware=inproc", "component.startup_timeout=0.2")
    with running(
        station := make(Station, find_transport, "middleware=inproc", "ports.Everything.divide.middleware=dds")
    ):
        assert not lost.run()
    assert station.state is State.ENDED


class Herald(Diary):
    """Publishes a number with each compute, under its own name."""

    component = Component(
        "herald", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=RELIABLE),), period=0.005
    )
    everything_proxy: EverythingPublisher

    def compute(self) -> None:
        self.entries.append("compute")
        self.everything_proxy.news(self.entries.count("compute"), self.log.name)


class Reader(Diary):
    component = Component("reader", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),), period=0.005)

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"{text} {number}")

    def heard(self, herald: str) -> list[int]:
        return [int(each.split()[1]) for each in list(self.entries) if each.startswith(f"{herald} ")]


def test_a_publisher_serves_subscribers_on_several_middlewares_each_once() -> None:
    herald = make(Herald, find_transport, "middleware=zeromq", 'ports.everything.also=["inproc", "zenoh"]')
    near = make(Reader, find_transport, "middleware=inproc", name="near")
    far = make(Reader, find_transport, "middleware=zenoh", name="far")
    with running(near) as by_inproc, running(far) as by_zenoh, running(herald):
        wait_until(lambda: min(len(by_inproc.heard("herald")), len(by_zenoh.heard("herald"))) > 5)
    for reader in (by_inproc, by_zenoh):
        numbers = reader.heard("herald")
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_a_server_serves_callers_on_several_middlewares() -> None:
    station = make(Station, find_transport, "middleware=dds", 'ports.Everything.also=["inproc"]')
    visitor = make(
        Visitor, find_transport, "middleware=dds", "ports.everything.middleware=inproc", "ports.Everything.from=station"
    )
    with running(station), running(visitor) as worker:
        wait_until(worker.has_all)


def test_a_subscription_hears_publishers_on_several_middlewares() -> None:
    reader = make(
        Reader,
        find_transport,
        "middleware=zeromq",
        "ports.Everything.from=one",
        'ports.Everything.also=[{ from = "two", middleware = "inproc" }]',
    )
    one = make(Herald, find_transport, "middleware=zeromq", name="one")
    two = make(Herald, find_transport, "middleware=inproc", name="two")
    with running(reader) as worker, running(one), running(two):
        wait_until(lambda: min(len(worker.heard("one")), len(worker.heard("two"))) > 5)


def test_a_way_that_fails_does_not_keep_a_publication_from_the_others() -> None:
    herald = make(Herald, find_transport, "middleware=zeromq", 'ports.everything.also=["inproc"]')
    reader = make(Reader, find_transport, "middleware=inproc")
    with running(reader) as worker, running(herald) as speaker:
        wait_until(lambda: worker.heard("herald"))
        ways: Any = speaker.everything_proxy._bound["news"]

        class Broken:
            has_subscribers = True

            def send(self, *_: Any) -> None:
                raise Timeout("nobody takes it")

        ways._ways.insert(0, Broken())
        since = len(worker.heard("herald"))
        wait_until(lambda: len(worker.heard("herald")) > since + 5)
        with pytest.raises(Timeout, match="nobody takes it"):
            speaker.everything_proxy.news(0, "herald")
