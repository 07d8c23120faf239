"""Our framework, as a component uses it: a proxy like a generated one, and a handler in the other process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Verb
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.contract.types import UINT8, Field, Sequence
from robocomp_py.errors import Timeout
from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.route import Route, Router
from robocomp_py.transports.base import Link, Transport, TransportConfig, find_transport

from .parties import PATIENCE, Array, Hear, Place, stamp

BYTES = (Field("data", Sequence(UINT8)),)
echo: Operation[Any] = Operation("Benchmark::Echo", "echo", BYTES, (Field("ret", Sequence(UINT8)),))
news: Operation[None] = Operation("Benchmark::Topic", "news", BYTES)
ECHO, TOPIC = Interface("Benchmark::Echo", (echo,)), Interface("Benchmark::Topic", (news,))

REQUIRES, IMPLEMENTS = Port(Verb.REQUIRES, ECHO, proxy=ports.Proxy), Port(Verb.IMPLEMENTS, ECHO)
PUBLISHES, SUBSCRIBES = Port(Verb.PUBLISHES, TOPIC, proxy=ports.Proxy), Port(Verb.SUBSCRIBES, TOPIC)


class Handlers:
    """The handlers that a user writes."""

    def __init__(self, hear: Hear) -> None:
        self.Topic_news = hear

    def Echo_echo(self, data: Array) -> Array:
        return data


@dataclass
class News:
    """The message of the topic, to be filled in place."""

    data: Array = field(default_factory=lambda: np.empty(0, np.uint8))


class Far:
    def __init__(
        self,
        middleware: str,
        place: Place,
        hear: Hear,
        through: Callable[[Transport], Transport] | None = None,
        within: str = "benchmark",
    ) -> None:
        """`through` puts something between the transport and what is bound to it. `within` is the instance."""
        self._transport, self._monitor = connected(middleware, place), Monitor()
        if through:
            self._transport = through(self._transport)
        self._links: list[Link] = []
        try:
            for port in (IMPLEMENTS, SUBSCRIBES):
                router = route(self._transport, place.depth, within)
                self._links += ports.bind_handlers(port, Handlers(hear), router, self._monitor)
        except BaseException:
            self.close()  # otherwise its threads would keep this process alive, and its parent would wait for ever
            raise
        self._monitor.open()

    def close(self) -> None:
        self._monitor.turn_away()
        ports.close_all(self._links)
        self._monitor.close()
        self._transport.close()


class Near:
    """Calls from inside the worker, as `compute` does: its other handlers could run while it waits."""

    def __init__(self, middleware: str, place: Place, within: str = "benchmark") -> None:
        self._transport, self._monitor = connected(middleware, place), Monitor()
        router = route(self._transport, place.depth, within)
        self._asking, asking = ports.bind_proxy(REQUIRES, router, self._monitor)
        self._publishing, publishing = ports.bind_proxy(PUBLISHES, router, self._monitor)
        self._links = [*asking, *publishing]
        if not all(link.wait_peer(PATIENCE) for link in self._links):
            raise TimeoutError(f"{middleware}: the two ends did not find each other within {PATIENCE:g} s")
        self._monitor.open()
        self._monitor.enter()

    def ask(self, data: Array) -> Array:
        answer: Array = self._asking._ask(echo, (data,), None)
        return answer

    def publish(self, data: Array) -> None:
        try:
            self._publishing._send(news, (data,), None)
        except Timeout as exc:
            raise TimeoutError(exc) from exc

    def lend(self, data: Array) -> None:
        """Publish the data by a loan: fill the message, then stamp it with the time."""
        with self._publishing._loan(news, News, (data.shape,), None) as message:
            message.data[:] = data
            stamp(message.data)

    def close(self) -> None:
        self._monitor.leave()
        self._monitor.turn_away()
        ports.close_all(self._links)
        self._monitor.close()
        self._transport.close()


def route(transport: Transport, depth: int, within: str = "benchmark") -> Router:
    qos = QoS(Reliability.RELIABLE, depth=depth)
    return lambda port, operation: Route(
        transport, "", f"{within}/{port.interface.short}/{operation.name}", qos, PATIENCE
    )


def connected(middleware: str, place: Place) -> Transport:
    return find_transport(middleware)(TransportConfig(options(middleware, place)))


def options(middleware: str, place: Place) -> dict[str, Any]:
    match middleware:
        case "dds":
            return {"domain": place.domain}
        case "ice":
            return {"storm": f"IceStorm/TopicManager:tcp -h 127.0.0.1 -p {_FIRST_PORT + 2 * place.domain}"}
    return {}


_FIRST_PORT = 20_000
"""From here on, below those that the kernel gives away, IceStorm listens for a place, and the bare library after it."""
