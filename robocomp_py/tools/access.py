"""Takes part in a running network as one more client, without generated code."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

from ..closing import Closing
from ..contract.interface import Operation, Pattern
from ..contract.qos import DEFAULT_QOS, Durability, QoS, Reliability
from ..contract.types import LINEAGE, thrown
from ..errors import RemoteFailure, RobocompError, Timeout, Unreachable
from ..runtime.calls import Call, Handler, type_of
from ..transports import base
from ..transports.base import (
    Caller,
    Link,
    Outlet,
    Reply,
    Sink,
    Statistics,
    Status,
    Transport,
    TransportConfig,
    find_transport,
)
from ..wire.codec import Codec, Payload
from . import far
from .network import TOOL, Channel, Way
from .thrown import ThrownError as ThrownError

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

AT_ONCE = 64
"""Components that are asked at the same time."""

MOST_KEPT = 100
"""Links to topics that stay open between messages."""


class Subscription(Protocol):
    """A link that receives, or what stands for one on another host."""

    @property
    def stats(self) -> Statistics: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Heard:
    """A subscription of a tool."""

    link: Subscription
    codec: Codec
    """That of the payloads that the sink gets."""


class Access(Closing):
    """The links of a tool, for any number of threads. Each middleware is opened when it is first used."""

    def __init__(self) -> None:
        self._transports: dict[tuple[str, str], Transport] = {}
        """By the middleware and its options."""
        self._opening = threading.Lock()
        self._kept: dict[tuple[str, str, int], tuple[Caller, Call[Any]]] = {}
        """Links of queries that are called again; closed with their transports."""
        self._sending: dict[Hashable, tuple[Outlet, Call[Any]]] = {}
        """Links of topics that are published to again, the least recently used first."""
        self._end = contextlib.ExitStack()

    @cached_property
    def threads(self) -> ThreadPoolExecutor:
        """Threads that ask several components at the same time. They stay, since tools ask every second or so."""
        from concurrent.futures import ThreadPoolExecutor  # most tools ask one component at a time

        pool = ThreadPoolExecutor(AT_ONCE, "asking")
        self._end.callback(pool.shutdown)
        return pool

    def close(self) -> None:
        """Close all links, and the middlewares."""
        self._end.close()

    def hear(self, channel: Channel, sink: Sink, depth: int, *, headed: bool = False, latched: bool = True) -> Heard:
        """Subscribe to a topic; `sink` gets payloads, on a thread of the transport, and must not take long.

        With `headed`, it gets `transports.base.Heard` instead. Unless `latched`, it gets no message that was sent
        before.

        No publisher waits for a tool. On another host, `depth` and `latched` are up to its scout, and messages that the
        connection cannot take are lost.

        Raises ValueError if the contract is not understood, and TransportError; HostUnreachable if it is on another
        host.
        """
        if channel.via:
            link = far.FarLink(channel, sink if headed else lambda heard: sink(heard.payload))
            self._end.callback(link.close)
            return Heard(link, self.codec(channel))
        transport = self._of(channel)
        durability = channel.qos.durability if latched else Durability.VOLATILE
        qos = QoS(Reliability.BEST_EFFORT, durability, depth=depth)
        path = replace(_path(channel, qos), tap=True, headed=headed)
        return Heard(transport.inlet(path, sink), transport.codec)

    def codec(self, channel: Channel) -> Codec:
        """That of the payloads which `hear` would pass on."""
        if channel.via:
            from ..wire.cdr import Cdr

            return Cdr()
        return self._of(channel).codec

    def ask(self, channel: Channel, values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
        """Call a query; returns its outputs. `values` are those of the request, as `wire.json` makes them.

        Raises ThrownError, and what any call raises; ScoutError and HostUnreachable if it is on another host.
        """
        if channel.via:
            return far.asked(channel, values, deadline)
        caller, call = self._caller(channel)
        try:
            return _answer(caller, call, values, deadline)
        finally:
            caller.close()

    def ask_again(self, channel: Channel, values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
        """The same for a query that is called again and again: its link stays open, until a call fails. That a server
        does not answer in time is no failure."""
        if channel.via:
            return far.asked(channel, values, deadline)
        key = _key(channel)
        with self._opening:
            kept = self._kept.pop(key, None)  # one thread uses it at a time
        caller, call = kept or self._caller(channel)
        try:
            result = _answer(caller, call, values, deadline)
        except Timeout:
            self._keep(key, caller, call)
            raise
        except BaseException:  # also Ctrl-C: nothing else would close a link that is not kept
            caller.close()
            raise
        self._keep(key, caller, call)
        return result

    def keep(self, channels: Iterable[Channel]) -> None:
        """Open the links of queries for `ask_again`, and announce them together: each announcement makes every
        component look. What cannot be opened now is tried again when it is asked."""
        with self._opening:
            missing = {_key(each): each for each in channels if not each.via and _key(each) not in self._kept}
        with contextlib.ExitStack() as together:
            gathering: set[int] = set()
            for key, channel in missing.items():
                with contextlib.suppress(RobocompError, ValueError):
                    transport = self._of(channel)
                    if id(transport) not in gathering:
                        gathering.add(id(transport))
                        together.enter_context(base.gathering(transport))
                    self._keep(key, *self._caller(channel))

    def _keep(self, key: tuple[str, str, int], caller: Caller, call: Call[Any]) -> None:
        with self._opening:
            before, self._kept[key] = self._kept.get(key), (caller, call)
        if before:
            before[0].close()

    def send(self, channel: Channel, values: tuple[Any, ...], timeout: float, deadline: float) -> None:
        """Send a command, once a server is visible, which it must be within `timeout` seconds.

        Raises Unreachable, and what sending raises; ScoutError and HostUnreachable if the server is on another host.
        """
        if channel.via:
            far.asked(channel, values, deadline)
            return
        outlet, call = self.outlet(channel)
        try:
            if not outlet.wait_peer(timeout):
                raise Unreachable(f"no component serves {channel.name}")
            outlet.send(call.encode(values), deadline)
        finally:
            outlet.close()

    def outlet(self, channel: Channel, way: Way | None = None, qos: QoS | None = None) -> tuple[Outlet, Call[Any]]:
        """A link that sends commands or publications, and what encodes them. Publications reach the visible subscribers
        once `base.wait_connected` has returned."""
        transport = self._transport(way.middleware, way.options) if way else self._of(channel)
        path = _path(channel, qos or channel.qos)
        if way and qos:
            base.require(transport, way.middleware, path)
        return transport.outlet(path), Call(channel.operation, transport.codec)

    @contextlib.contextmanager
    def outlet_again(self, channel: Channel, way: Way, qos: QoS | None = None) -> Iterator[tuple[Outlet, Call[Any]]]:
        """As `outlet`, for a topic that is published to again and again: the link stays open until sending fails, or
        until more than `MOST_KEPT` other ones are open."""
        key = (channel.name, next(iter(channel.texts)), way.middleware, str(qos), _spelled(way.options))
        with self._opening:
            kept = self._sending.pop(key, None)  # one thread uses it at a time
        outlet, call = kept or self.outlet(channel, way, qos)
        try:
            yield outlet, call
        except BaseException:  # also Ctrl-C: nothing else would close a link that is not kept
            outlet.close()
            raise
        with self._opening:
            old = [self._sending.pop(key, None)]
            self._sending[key] = outlet, call
            if len(self._sending) > MOST_KEPT:
                old.append(self._sending.pop(next(iter(self._sending))))
        for each in filter(None, old):
            each[0].close()

    def sender(
        self, middleware: str, name: str, pattern: Pattern, operation: Operation[Any], qos: QoS
    ) -> tuple[Outlet, Codec]:
        """A link that sends under a name, also of a channel that has no other end; and the codec of its payloads.

        Raises TransportError, and UnsupportedQoS if the middleware does not offer this QoS.
        """
        transport = self._transport(middleware)
        path = base.Channel(name, pattern, type_of(operation, pattern), qos)
        base.require(transport, middleware, path)
        return transport.outlet(path), transport.codec

    def server(
        self, middleware: str, name: str, operation: Operation[Any], answer: Callable[[], tuple[Any, ...]]
    ) -> Link:
        """Serve a query under a name. `answer` is called on any thread, and returns the outputs; its RobocompErrors are
        failures of the call.

        Raises TransportError.
        """
        transport = self._transport(middleware)
        encode, handler = transport.codec.encoder(operation.response), Handler(operation, transport.codec, answer)

        def serve(request: Payload, expires: float) -> Reply:
            try:
                return Reply(Status.OK, encode(answer()))
            except RobocompError as exc:
                return handler.failed(exc)

        path = base.Channel(name, Pattern.QUERY, type_of(operation, Pattern.QUERY), DEFAULT_QOS)
        return transport.server(path, serve)

    def receiver(self, middleware: str, name: str, operation: Operation[Any], sink: Sink) -> Link:
        """Receive commands under a name. Raises TransportError."""
        path = base.Channel(name, Pattern.COMMAND, type_of(operation, Pattern.COMMAND), DEFAULT_QOS)
        return self._transport(middleware).inlet(path, sink)

    def transport(self, middleware: str) -> Transport:
        """A middleware, which is closed with this object. Raises ConfigurationError and TransportError."""
        return self._transport(middleware)

    def _caller(self, channel: Channel) -> tuple[Caller, Call[Any]]:
        transport = self._of(channel)
        return transport.caller(_path(channel)), Call(channel.operation, transport.codec)

    def _of(self, channel: Channel) -> Transport:
        return self._transport(channel.middlewares[0], channel.options)

    def _transport(self, middleware: str, options: Mapping[str, Any] | None = None) -> Transport:
        key = middleware, _spelled(options or {})
        with self._opening:
            if key not in self._transports:
                config = TransportConfig(options or {}, owner=TOOL)
                self._transports[key] = transport = find_transport(middleware)(config)
                self._end.callback(transport.close)
            return self._transports[key]


def _spelled(options: Mapping[str, Any]) -> str:
    return json.dumps(options, sort_keys=True, default=str)


def _key(channel: Channel) -> tuple[str, str, int]:
    return channel.middlewares[0], channel.name, next(iter(channel.texts))


def _answer(caller: Caller, call: Call[Any], values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
    caller.wait_peer(deadline)
    reply = caller.ask(call.encode(values), deadline)
    if reply.status is Status.THROWN:
        raise _thrown(call.operation, call.codec, reply)
    result = call.result(reply)
    outputs = len(call.operation.outputs)
    return result if outputs > 1 else (result,) * outputs


def _path(channel: Channel, qos: QoS | None = None) -> base.Channel:
    kind = type_of(channel.operation, channel.pattern)
    return base.Channel(channel.name, channel.pattern, kind, qos or DEFAULT_QOS, channel.operation.idempotent)


def _thrown(operation: Operation[Any], codec: Codec, reply: Reply) -> ThrownError | RemoteFailure:
    """The exception of a reply, of the first declared kind in its lineage."""
    (lineage,) = codec.decoder(thrown(), prefix=True)(reply.payload)
    declared = {each.name: each for each in operation.raises}
    for name in lineage.split(LINEAGE):
        if kind := declared.get(name):
            _, *values = codec.decoder(thrown(kind), prefix=True)(reply.payload)
            return ThrownError(kind, values)
    return RemoteFailure(operation.name, lineage.split(LINEAGE)[0], "the operation does not declare this exception")
