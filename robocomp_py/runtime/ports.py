"""The four verbs of a CDSL, bound operation by operation to a transport."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, TypeVar, cast

from ..contract.component import MAX_SECONDS, Port
from ..contract.interface import Interface, Operation, Pattern
from ..contract.qos import QoS
from ..errors import Closed, DecodeError, RobocompError, TransportError
from ..transports.base import (
    Caller,
    Channel,
    Link,
    Outlet,
    Reply,
    Statistics,
    Status,
    SupportsHeard,
    Transport,
    TypeRef,
    about_to_block,
    require,
)
from ..wire.codec import Payload
from .calls import Answering, Call
from .loans import Loans, Memory, Shape
from .monitor import Monitor
from .retries import Retrying
from .watching import Watched, Watching

log = logging.getLogger("robocomp.worker")

R = TypeVar("R")
M = TypeVar("M")
W = TypeVar("W")

_AT_LEAST = 0.001
"""Seconds that a way to send by has, whatever the others have taken."""


@dataclass(frozen=True)
class Route:
    """Where one operation of one port travels."""

    transport: Transport
    middleware: str
    channel: str
    qos: QoS
    deadline: float
    also: tuple[Route, ...] = ()
    """Further ways: of what is provided, and to further publishers of what is subscribed to."""

    @property
    def all(self) -> tuple[Route, ...]:
        return (self, *self.also)


Router = Callable[[Port, Operation[Any]], Route]


class Proxy:
    """Base of the generated proxies: what they call is bound by name when the component starts."""

    interface: ClassVar[Interface]

    def __init__(self, bound: Mapping[str, _Asked | _Sent | _FanOut | _SentWatched]) -> None:
        self._bound = bound

    def _ask(self, operation: Operation[R], arguments: tuple[Any, ...], deadline: float | None) -> R:
        asked: Any = self._bound[operation.name]
        result: R = asked.ask(arguments, deadline)
        return result

    def _ask_async(self, operation: Operation[R], arguments: tuple[Any, ...], deadline: float | None) -> Future[R]:
        asked: Any = self._bound[operation.name]
        answer: Future[R] = asked.ask_async(arguments, deadline)
        return answer

    def _send(self, operation: Operation[None], arguments: tuple[Any, ...], deadline: float | None) -> None:
        sent: Any = self._bound[operation.name]
        sent.send(arguments, deadline)

    def _loan(
        self, operation: Operation[None], kind: type[M], shapes: tuple[Shape, ...], deadline: float | None
    ) -> AbstractContextManager[M]:
        if deadline is not None:
            _positive(deadline)  # not only when everything is filled
        sent: Any = self._bound[operation.name]
        message: AbstractContextManager[M] = sent.loans.message(kind, shapes, partial(sent.send, deadline=deadline))
        return message


def wrap(proxy: Proxy, wrapper: Callable[[Any], W]) -> dict[str, W]:
    """Put something around every operation of a proxy; return what was put there, by operation."""
    wrapped = {name: wrapper(each) for name, each in proxy._bound.items()}
    proxy._bound = cast("Any", wrapped)
    return wrapped


class Answer(Future[R]):
    """What an asynchronous call will return or raise, within its deadline.

    Waiting for it inside the worker lets other handlers in, as any wait does. Callbacks run as
    handlers do: never beside other code of the worker. `asyncio.wrap_future` makes it awaitable.
    """

    def __init__(self, monitor: Monitor, call: Call[R]) -> None:
        super().__init__()
        self._monitor, self._call = monitor, call
        self._source: Future[Reply] | None = None

    def follow(self, source: Future[Reply]) -> None:
        self._source = source
        source.add_done_callback(self._answered)

    def cancel(self) -> bool:
        cancelled = super().cancel()
        if cancelled and self._source:
            self._source.cancel()
        return cancelled

    def result(self, timeout: float | None = None) -> R:
        if self.done():
            return super().result()
        with self._monitor.released():
            return super().result(timeout)

    def exception(self, timeout: float | None = None) -> BaseException | None:
        if self.done():
            return super().exception()
        with self._monitor.released():
            return super().exception(timeout)

    def add_done_callback(self, fn: Callable[[Future[R]], object]) -> None:
        super().add_done_callback(lambda _: self._monitor.run(partial(fn, self)))

    def _answered(self, source: Future[Reply]) -> None:
        if source.cancelled() or not self.set_running_or_notify_cancel():
            return
        try:
            self.set_result(self._call.result(source.result()))
        except RobocompError as exc:
            self.set_exception(exc)


def bind_proxy(
    port: Port, router: Router, monitor: Monitor, watching: Watching | None = None
) -> tuple[Proxy, list[Link]]:
    """Connect what a worker calls; return its proxy and the links under it."""
    bound: dict[str, _Asked | _Sent | _FanOut | _SentWatched] = {}
    links: list[Link] = []
    for operation, pattern in port.interface.under(port.verb):
        route = router(port, operation)
        channel = checked_channel(route, operation, pattern)
        call = Call(operation, route.transport.codec)
        if pattern is Pattern.QUERY:
            caller = route.transport.caller(channel)
            if operation.idempotent:
                caller = Retrying(caller, ending=lambda: monitor.closed)
            bound[operation.name] = _Asked(call, caller, monitor, route.deadline)
            links.append(caller)
        else:
            ways = []
            for each in route.all:
                outlet = each.transport.outlet(checked_channel(each, operation, pattern))
                links.append(outlet)
                ways.append(_Sent(Call(operation, each.transport.codec), outlet, route.deadline))
            sent = ways[0] if len(ways) == 1 else _FanOut(ways, route.deadline)
            watched = watching.of(port, operation.name, pattern, route.qos) if watching else None
            bound[operation.name] = _SentWatched(sent, watched, route.channel) if watched else sent
    assert port.proxy is not None
    return port.proxy(bound), links


def bind_handlers(
    port: Port,
    handlers: object,
    router: Router,
    monitor: Monitor,
    watching: Watching | None = None,
    *,
    lazy: bool = False,
) -> list[Link]:
    """Connect what calls a worker; return the links. What is called `lazy` is compiled when it is."""
    links: list[Link] = []
    claimed: set[str] = set()
    for operation, pattern in port.interface.under(port.verb):
        routes = router(port, operation).all
        method = getattr(handlers, port.handler(operation.name))
        watched = watching.of(port, operation.name, pattern, routes[0].qos) if watching else None
        turn = threading.Lock() if len(routes) > 1 and pattern is Pattern.PUBLISH and not port.concurrent else None
        for route in routes:
            channel = checked_channel(route, operation, pattern)
            answering = Answering(operation, route.transport.codec, method)
            if not lazy:
                answering.compile()
            handling = _Handling(answering, monitor, port.concurrent, turn)
            if pattern is not Pattern.PUBLISH:  # who serves the first operation of an interface serves the others
                channel = replace(channel, exclusive=route.middleware not in claimed, lazy=lazy)
                claimed.add(route.middleware)
            if pattern is Pattern.QUERY:
                link = route.transport.server(channel, handling.serve)
            else:
                channel = replace(channel, on_receive=watched.heard) if watched else channel
                link = route.transport.inlet(channel, handling.receive)
                if watched:
                    watched.add(link)
            handling.count_in(link.stats)
            links.append(link)
    return links


def checked_channel(route: Route, operation: Operation[Any], pattern: Pattern) -> Channel:
    """The channel of an operation; raises UnsupportedQoS if its transport cannot keep what it asks for."""
    kind = type_of(operation, pattern)
    channel = Channel(route.channel, pattern, kind, route.qos, operation.idempotent)
    require(route.transport, route.middleware, channel)
    return channel


def type_of(operation: Operation[Any], pattern: Pattern) -> TypeRef:
    """The messages of an operation, as transports know them."""
    response = operation.response if pattern is Pattern.QUERY else None
    return TypeRef(operation.request.name, operation.fingerprint, operation.text, operation.request, response)


class _Asked:
    """A query, ready to be called."""

    def __init__(self, call: Call[Any], caller: Caller, monitor: Monitor, deadline: float) -> None:
        self._call, self._caller, self._monitor, self._deadline = call, caller, monitor, deadline

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        limit = self._deadline if deadline is None else _positive(deadline)
        payload = self._call.encode(arguments)
        stepped_out = self._monitor.step_out()
        try:
            reply = self._caller.ask(payload, limit)
        finally:
            if stepped_out:
                self._monitor.step_in(stepped_out)
        return self._call.result(reply)

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Future[Any]:
        limit = self._deadline if deadline is None else _positive(deadline)
        answer = Answer(self._monitor, self._call)
        answer.follow(self._caller.call(self._call.encode(arguments), limit))
        return answer


class _Sent:
    """A command or a publication, ready to be sent."""

    def __init__(self, call: Call[Any], outlet: Outlet, deadline: float) -> None:
        self._call, self._encode, self._outlet, self._deadline = call, call.encode, outlet, deadline
        self._tells = outlet if isinstance(outlet, SupportsHeard) else None

    @property
    def heard(self) -> bool:
        return self._tells is None or self._tells.heard

    @cached_property
    def loans(self) -> Loans:
        return Loans(self._call, self._outlet)

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        """`memory` is where the arguments were filled, if somewhere."""
        limit = self._deadline if deadline is None else _positive(deadline)
        if memory and self.lent(memory):
            memory.send(arguments, limit)
        else:
            self._outlet.send(self._encode(arguments), limit)

    def lent(self, memory: Memory | None) -> bool:
        return memory is not None and memory.loans is self.loans


class _FanOut:
    """A publication over several middlewares: each has subscribers of its own, or none at the moment."""

    def __init__(self, ways: Sequence[_Sent], deadline: float) -> None:
        self._ways, self._deadline = ways, deadline

    @property
    def loans(self) -> Loans:
        """Of a way that lends memory, if one is needed that does. The others copy from it before it is sent."""
        ways = self._needed()
        return next((way.loans for way in ways if way.loans.in_place), ways[0].loans)

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        """A way that fails does not keep the others from it; the first error is raised in the end."""
        end = time.monotonic() + (self._deadline if deadline is None else _positive(deadline))
        failed: TransportError | None = None
        ways = self._needed()
        if memory:
            ways.sort(key=lambda way: way.lent(memory))
        for way in ways:
            try:
                way.send(arguments, max(_AT_LEAST, end - time.monotonic()), memory)
            except TransportError as exc:
                failed = failed or exc
        if failed:
            raise failed

    def _needed(self) -> list[_Sent]:
        """The ways by which somebody hears, or one of those by which nobody does."""
        return [way for way in self._ways if way.heard] or list(self._ways[:1])


class _SentWatched:
    """A publication that has a deadline, or has to be made for others to know that we live."""

    def __init__(self, way: _Sent | _FanOut, watched: Watched, channel: str) -> None:
        self._way, self._heard, self._channel = way, watched.heard, channel
        watched.publishes(channel)

    @property
    def loans(self) -> Loans:
        return self._way.loans

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        self._way.send(arguments, deadline, memory)
        self._heard(self._channel)


class _Handling:
    """A handler, ready to be called by a transport; `turn` is for messages of one subscription that come by several."""

    def __init__(
        self, answering: Answering, monitor: Monitor, concurrent: bool, turn: threading.Lock | None = None
    ) -> None:
        self._answering, self._monitor, self._concurrent = answering, monitor, concurrent
        self._turn = turn
        self._stats = Statistics()

    def count_in(self, stats: Statistics) -> None:
        """The statistics of the link through which messages come; some may have come before this call."""
        stats.malformed += self._stats.malformed
        self._stats = stats

    def serve(self, payload: Payload, expires: float) -> Reply | Future[Reply]:
        try:
            arguments = self._answering.decode(payload)
        except DecodeError as exc:
            self._count_malformed(exc)
            return self._answering.failed(exc)
        begun = time.monotonic()
        if not self._concurrent and self._monitor.try_enter():
            try:
                return self._answering.answer(arguments)
            finally:
                self._monitor.gauge.note(time.monotonic() - begun)
                self._monitor.leave()
        reply: Future[Reply] = Future()

        def job() -> Reply:
            if time.monotonic() >= expires:
                return Reply(Status.EXPIRED)
            try:
                return self._answering.answer(arguments)
            finally:
                self._monitor.gauge.note(time.monotonic() - begun)

        submit = self._monitor.submit_beside if self._concurrent else self._monitor.submit
        if submit(job, then=reply.set_result, away=partial(reply.set_result, Reply(Status.REFUSED))):
            return reply
        return Reply(Status.REFUSED if self._monitor.closed else Status.BUSY)

    def receive(self, payload: Payload) -> None:
        try:
            arguments = self._answering.decode(payload)
        except DecodeError as exc:
            self._count_malformed(exc)
            return
        if self._concurrent:
            self._answering.take(arguments)
            return
        turn = self._turn
        if turn is None:
            self._take(arguments)
            return
        if not turn.acquire(blocking=False):
            about_to_block()
            turn.acquire()
        try:
            self._take(arguments)
        finally:
            turn.release()

    def _take(self, arguments: tuple[Any, ...]) -> None:
        try:
            self._monitor.enter()
        except Closed:
            return  # the component ends: what comes in now has no one to go to
        try:
            self._answering.take(arguments)
        finally:
            self._monitor.leave()

    def _count_malformed(self, why: DecodeError) -> None:
        if self._stats.malformed == 0:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self._name, why)
        self._stats.malformed += 1

    @property
    def _name(self) -> str:
        return f"{self._answering.operation.interface}.{self._answering.operation.name}"


def _positive(deadline: float) -> float:
    if not isinstance(deadline, int | float) or not 0 < deadline <= MAX_SECONDS:
        raise ValueError(f"a deadline is a positive number of seconds, at most {MAX_SECONDS:g}, not {deadline!r}")
    return deadline


def close_all(links: list[Link]) -> None:
    """Close links, the last first. One that fails does not keep the others open."""
    while links:
        try:
            links.pop().close()
        except Closed:
            continue
        except Exception:  # whatever one of them raises, the others are to be closed
            log.exception("closing a link")
