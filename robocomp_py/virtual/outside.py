"""What acts on a simulated network without being one of its components: it calls operations and hears topics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

from ..contract.component import Component, Port
from ..contract.interface import Operation, Pattern
from ..runtime.calls import Call, type_of
from ..runtime.settings import DEADLINE, Settings
from ..spelling import unknown
from ..transports.base import Channel, Transport
from ..wire import names
from ..wire.codec import Payload

Hear = Callable[[tuple[Any, ...]], object]
"""Takes the values of a message."""


class Provider(Protocol):
    """A component that provides operations."""

    @property
    def component(self) -> Component: ...

    @property
    def middleware(self) -> str:
        """The one that it is generated for."""
        ...

    @property
    def settings(self) -> Settings: ...


class Provided(NamedTuple):
    """An operation that a component of the network provides."""

    owner: str
    """The instance of the component."""
    port: Port
    named: str
    """The named instance that provides it; "" if that is the component itself."""
    operation: Operation[Any]
    pattern: Pattern
    middleware: str


def provided(network: Iterable[Provider]) -> dict[str, Provided]:
    """All operations of a network by the names of their channels: `world/Laser/getLaserData`."""
    return {name: each for provider in network for name, each in _of(provider)}


def goals(network: Iterable[Provider]) -> set[str]:
    """The names of all actions of a network, `base/Navigation/goTo`: they are begun, and not called."""
    return {
        names.channel(each.settings.namespace, each.settings.instance, port.label, action.name)
        for each in network
        for port, action in each.component.actions()
    }


def _of(provider: Provider) -> Iterator[tuple[str, Provided]]:
    settings = provider.settings
    for port in provider.component.ports:
        if not port.verb.provides:
            continue
        for named in sorted(settings.offered(port) or ()) if port.each else [""]:
            chosen = settings.of(named) if named else settings
            for operation, pattern in port.interface.under(port.verb):
                name = names.channel(settings.namespace, chosen.instance, port.label, operation.name)
                carrier, *_ = chosen.middlewares(port, operation.name, provider.middleware)
                yield name, Provided(settings.instance, port, named, operation, pattern, carrier)


def found(name: str, among: Mapping[str, Provided]) -> Provided:
    """An operation by its name. Raises KeyError, which names the most similar one."""
    if name not in among:
        raise KeyError(unknown("operation", name, among))
    return among[name]


class Outside:
    """Calls and hears the operations of a network. Its functions may be called in events of the network only."""

    def __init__(self, network: Mapping[str, Provided], opened: Callable[[str], Transport]) -> None:
        """`opened` opens the transport that stands in for a middleware."""
        self._network, self._opened = network, opened
        self._transports: dict[str, Transport] = {}

    def asks(self, name: str) -> Callable[..., Any]:
        """A function that calls an operation, by its inputs in their order, as the method of a proxy does.

        Raises KeyError for an unknown operation, and ValueError for a topic. The function raises what a call by a
        component raises.
        """
        each = found(name, self._network)
        if each.pattern is Pattern.PUBLISH:
            raise ValueError(f"{name} is a topic: it is heard, and not called")
        transport = self._transport(each.middleware)
        call, channel = Call(each.operation, transport.codec), self._channel(name, each)
        if each.pattern is Pattern.COMMAND:
            outlet = transport.outlet(channel)
            return lambda *inputs: outlet.send(call.encode(inputs))
        caller = transport.caller(channel)
        return lambda *inputs: call.result(caller.ask(call.encode(inputs), DEADLINE))

    def hears(self, name: str, hear: Hear) -> None:
        """Let a function take the messages of a topic. Raises KeyError for an unknown one, ValueError for a call."""
        each = found(name, self._network)
        if each.pattern is not Pattern.PUBLISH:
            raise ValueError(f"{name} is called, and not heard")
        transport = self._transport(each.middleware)
        decode = transport.codec.decoder(each.operation.request)

        def take(payload: Payload) -> None:
            hear(decode(payload))

        transport.inlet(self._channel(name, each), take)

    def close(self) -> None:
        """Idempotent."""
        while self._transports:
            self._transports.popitem()[1].close()

    def _transport(self, middleware: str) -> Transport:
        if middleware not in self._transports:
            self._transports[middleware] = self._opened(middleware)
        return self._transports[middleware]

    def _channel(self, name: str, each: Provided) -> Channel:
        return Channel(
            name, each.pattern, type_of(each.operation, each.pattern), each.port.qos, each.operation.idempotent
        )
