"""Takes part in a running network as one more client, without generated code."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from ..contract.interface import Operation, Pattern
from ..contract.qos import DEFAULT_QOS, QoS, Reliability
from ..contract.types import LINEAGE, ExceptionType, thrown
from ..errors import RemoteFailure, RobocompError
from ..runtime.calls import Call
from ..transports import base
from ..transports.base import Link, Outlet, Reply, Sink, Status, Transport, TransportConfig, TypeRef, find_transport
from ..wire.codec import Codec
from .network import Channel

OWNER = "rc"
"""How others see a tool."""


class ThrownError(RobocompError):
    """The server raised an exception that the operation declares."""

    def __init__(self, kind: ExceptionType, values: Sequence[Any]) -> None:
        super().__init__(kind.name)
        self.kind, self.values = kind, tuple(values)


@dataclass(frozen=True)
class Heard:
    """A subscription of a tool."""

    link: Link
    codec: Codec
    """That of the payloads that the sink gets."""


class Access:
    """The links of a tool. Each middleware is opened when it is first used. Closing it closes all links."""

    def __init__(self) -> None:
        self._transports: dict[str, Transport] = {}
        self._end = contextlib.ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end.close()

    def hear(self, channel: Channel, sink: Sink, depth: int) -> Heard:
        """Subscribe to a topic; `sink` gets payloads, on a thread of the transport, and must not take long.

        No publisher waits for a tool. Raises ValueError if the contract is not understood, and TransportError.
        """
        transport = self._transport(channel.middlewares[0])
        qos = QoS(Reliability.BEST_EFFORT, channel.qos.durability, depth=depth)
        return Heard(transport.inlet(_path(channel, qos), sink), transport.codec)

    def ask(self, channel: Channel, values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
        """Call a query; returns its outputs. `values` are those of the request, as `wire.json` makes them.

        Raises ThrownError, and what any call raises.
        """
        transport = self._transport(channel.middlewares[0])
        call = Call(channel.operation, transport.codec)
        caller = transport.caller(_path(channel))
        try:
            caller.wait_peer(deadline)
            reply = caller.ask(call.encode(values), deadline)
        finally:
            caller.close()
        if reply.status is Status.THROWN:
            raise _thrown(channel.operation, transport.codec, reply)
        result = call.result(reply)
        outputs = len(channel.operation.outputs)
        return result if outputs > 1 else (result,) * outputs

    def outlet(self, channel: Channel) -> tuple[Outlet, Call[Any]]:
        """A link that sends commands or publications, and what encodes them. Publications reach the visible subscribers
        once `base.wait_connected` has returned."""
        transport = self._transport(channel.middlewares[0])
        return transport.outlet(_path(channel, channel.qos)), Call(channel.operation, transport.codec)

    def _transport(self, middleware: str) -> Transport:
        if middleware not in self._transports:
            self._transports[middleware] = transport = find_transport(middleware)(TransportConfig(owner=OWNER))
            self._end.callback(transport.close)
        return self._transports[middleware]


def _path(channel: Channel, qos: QoS | None = None) -> base.Channel:
    operation = channel.operation
    response = operation.response if channel.pattern is Pattern.QUERY else None
    kind = TypeRef(operation.request.name, operation.fingerprint, operation.text, operation.request, response)
    return base.Channel(channel.name, channel.pattern, kind, qos or DEFAULT_QOS)


def _thrown(operation: Operation[Any], codec: Codec, reply: Reply) -> ThrownError | RemoteFailure:
    """The exception of a reply, of the first declared kind in its lineage."""
    (lineage,) = codec.decoder(thrown(), prefix=True)(reply.payload)
    declared = {each.name: each for each in operation.raises}
    for name in lineage.split(LINEAGE):
        if kind := declared.get(name):
            _, *values = codec.decoder(thrown(kind), prefix=True)(reply.payload)
            return ThrownError(kind, values)
    return RemoteFailure(operation.name, lineage.split(LINEAGE)[0], "the operation does not declare this exception")
