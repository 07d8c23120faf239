"""The four verbs of a CDSL, bound operation by operation to a transport."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import CancelledError, Future, InvalidStateError
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, ClassVar, Protocol, TypeVar, cast

from ..contract.component import MAX_SECONDS, Port
from ..contract.interface import Interface, Operation, Pattern
from ..contract.qos import QoS
from ..errors import Closed, DecodeError, RobocompError, TransportError
from ..threads import only_wakes_a_loop
from ..transports.base import (
    Caller,
    Channel,
    Link,
    Outlet,
    Reply,
    Statistics,
    Status,
    SupportsSubscribers,
    Transport,
    about_to_block,
    require,
)
from ..transports.senders import signing
from ..wire.codec import Payload
from .calls import Call, Handler, type_of
from .loans import Loans, Memory, Shape
from .monitor import Monitor
from .retries import Retrying
from .route import Route, Router
from .tally import Tally, Timing
from .watching import Watched

log = logging.getLogger("robocomp.worker")

_now = time.monotonic

R = TypeVar("R")
M = TypeVar("M")
W = TypeVar("W")

_AT_LEAST = 0.001
"""Seconds that each middleware of a publication has at least, even if others have used up the deadline."""

_LONG = 0.001
"""Seconds from which on a handler is long. The thread that receives lets another one receive before it runs such a
handler, so that handlers which may run beside it do not wait for it."""

_FADES = 0.8
"""What is left of the duration of an earlier call, after another one."""

_OK, _THROWN = Status.OK, Status.THROWN
"""Outcomes that are answers: an exception that the IDSL declares is one, too. Global names: to look up a member of an
enumeration takes longer than to read the clock."""

_TAKEN, _FAILED = Reply(Status.OK), Reply(Status.FAILED)
"""The outcomes of a command, as `watch` tells them."""


class Watches(Protocol):
    """Watches operations whose QoS needs it; see `Watching`."""

    def of(self, port: Port, operation: str, pattern: Pattern, qos: QoS) -> Watched | None: ...


class Proxy:
    """Base of the generated proxies. Operations are bound by name when the component starts."""

    interface: ClassVar[Interface]

    def __init__(self, bound: Mapping[str, BoundQuery | BoundSend | FanOut | WatchedSend]) -> None:
        self._bound = bound

    def _ask(self, operation: Operation[R], arguments: tuple[Any, ...], deadline: float | None) -> R:
        asked: Any = self._bound[operation.name]
        result: R = asked.ask(arguments, deadline)
        return result

    def _ask_async(self, operation: Operation[R], arguments: tuple[Any, ...], deadline: float | None) -> Future[R]:
        asked: Any = self._bound[operation.name]
        answer: Future[R] = asked.ask_async(arguments, deadline)
        if isinstance(answer, Answer):
            answer.end_with_component()
        return answer

    def _send(self, operation: Operation[None], arguments: tuple[Any, ...], deadline: float | None) -> None:
        sent: Any = self._bound[operation.name]
        sent.send(arguments, deadline)

    def _loan(
        self, operation: Operation[None], kind: type[M], shapes: tuple[Shape, ...], deadline: float | None
    ) -> AbstractContextManager[M]:
        if deadline is not None:
            _positive(deadline)  # here, so that a mistake is reported before the message is filled
        sent: Any = self._bound[operation.name]
        message: AbstractContextManager[M] = sent.loans.message(kind, shapes, partial(sent.send, deadline=deadline))
        return message


def wrap(proxy: Proxy, wrapper: Callable[[Any], W]) -> dict[str, W]:
    """Wrap every operation of a proxy; return the wrappers by the name of the operation."""
    wrapped = {name: wrapper(each) for name, each in proxy._bound.items()}
    proxy._bound = cast("Any", wrapped)
    return wrapped


def has_subscribers(proxy: Proxy) -> bool:
    """Whether a publication by a proxy may reach a subscriber. Fast enough to be asked before each message is made."""
    return any(getattr(each, "has_subscribers", False) for each in proxy._bound.values())


class Answer(Future[R]):
    """The Future of an asynchronous call, which is done within the deadline of the call, and at once with Closed if the
    component is asked to stop.

    While the worker waits for it, other handlers may run. Callbacks run like handlers: one at a time, never
    concurrently with other code of the worker, and not once the component is asked to stop. `asyncio.wrap_future` makes
    it awaitable, also in code that holds the worker.
    """

    def __init__(self, monitor: Monitor, call: Call[R]) -> None:
        super().__init__()
        self._monitor, self._call = monitor, call
        self._source: Future[Reply] | None = None
        self._began_late = monitor.closed
        """Whether the component had been asked to stop before."""

    def follow(self, source: Future[Reply]) -> None:
        self._source = source
        source.add_done_callback(self._answered)

    def end_with_component(self) -> None:
        """Let it end as soon as the component is asked to stop, and not only when the link is closed."""
        self._monitor.pending[self] = None
        if self.done():
            self._monitor.pending.pop(self, None)
        elif self._monitor.closed and not self._began_late:  # it was asked to stop meanwhile
            self.turn_away()

    def turn_away(self) -> None:
        with contextlib.suppress(InvalidStateError):  # it is done
            self.set_exception(Closed("the component is stopping"))

    def cancel(self) -> bool:
        cancelled = super().cancel()
        if cancelled and self._source:
            self._source.cancel()
        return cancelled

    def result(self, timeout: float | None = None) -> R:
        if not self.done():
            self._monitor.wait_for(self, timeout)
        return super().result(0)

    def exception(self, timeout: float | None = None) -> BaseException | None:
        if not self.done():
            self._monitor.wait_for(self, timeout)
        return super().exception(0)

    def add_done_callback(self, fn: Callable[[Future[R]], object]) -> None:
        if only_wakes_a_loop(fn):
            super().add_done_callback(fn)
        else:
            super().add_done_callback(lambda _: self._monitor.run(partial(fn, self)))

    def _answered(self, source: Future[Reply]) -> None:
        self._monitor.pending.pop(self, None)
        try:
            self._settle(source)
        except InvalidStateError:  # it was cancelled, or the component was asked to stop
            if self.cancelled():
                self.set_running_or_notify_cancel()  # for `concurrent.futures.wait`

    def _settle(self, source: Future[Reply]) -> None:
        try:
            value = self._call.result(source.result())
        except (RobocompError, CancelledError) as exc:
            self.set_exception(exc)
        else:
            self.set_result(value)


def bind_proxy(
    port: Port,
    router: Router,
    monitor: Monitor,
    watching: Watches | None = None,
    links: list[Link] | None = None,
    proxy: Proxy | None = None,
) -> tuple[Proxy, list[Link]]:
    """Connect a port that a worker calls or publishes to; return its proxy and the proxy's links.

    Links are appended to `links` as they are opened, so that the caller can close them if one cannot be opened.
    `proxy` is one that exists already.
    """
    bound: dict[str, BoundQuery | BoundSend | FanOut | WatchedSend] = {}
    links = [] if links is None else links
    for operation, pattern in port.interface.under(port.verb):
        route = router(port, operation)
        channel = checked_channel(route, operation, pattern)
        if pattern is Pattern.QUERY:
            call = Call(operation, route.transport.codec)
            caller = route.transport.caller(channel)
            if operation.idempotent:
                caller = Retrying(caller, ending=lambda: monitor.closed)
            tally = Tally(port, operation, pattern, route)
            bound[operation.name] = BoundQuery(call, caller, monitor, route.deadline, tally)
            links.append(caller)
            monitor.tallies.add(tally, caller)
        else:
            ways = []
            for each in route.all:
                outlet = each.transport.outlet(checked_channel(each, operation, pattern))
                links.append(outlet)
                tally = Tally(port, operation, pattern, each)
                monitor.tallies.add(tally, outlet)
                call = Call(operation, each.transport.codec, one_way=True)
                ways.append(BoundSend(call, outlet, route.deadline, tally))
            sent = ways[0] if len(ways) == 1 else FanOut(ways, route.deadline)
            watched = watching.of(port, operation.name, pattern, route.qos) if watching else None
            bound[operation.name] = WatchedSend(sent, watched, route.channel) if watched else sent
    if proxy is None:
        assert port.proxy is not None
        return port.proxy(bound), links
    proxy._bound = bound
    return proxy, links


def bind_handlers(
    port: Port,
    handlers: object,
    router: Router,
    monitor: Monitor,
    watching: Watches | None = None,
    *,
    lazy: bool = False,
    outside: bool = False,
    links: list[Link] | None = None,
    signed: bool = False,
    claimed: Iterable[str] = (),
) -> list[Link]:
    """Connect a port whose messages call a worker; return the links. About `links` see `bind_proxy`.

    If `lazy`, the interface is one of the framework, which is rarely called: codecs are compiled at first use, and
    messages are not counted. If `signed`, handlers may ask for their caller. Over the middlewares in `claimed`, the
    component has claimed its name already.

    If `outside`, handlers are not part of the component: they run at once, on the thread that receives, and call
    `about_to_block` before they wait.
    """
    links = [] if links is None else links
    claimed = set(claimed)
    kind: type[Handler] = Handler
    if signed:
        from .callers import SignedHandler as kind  # only components that ask for their callers need it
    for operation, pattern in port.interface.under(port.verb):
        routes = router(port, operation).all
        method = getattr(handlers, port.handler(operation.name))
        watched = watching.of(port, operation.name, pattern, routes[0].qos) if watching else None
        turn = threading.Lock() if len(routes) > 1 and pattern is Pattern.PUBLISH and not port.concurrent else None
        for route in routes:
            channel = checked_channel(route, operation, pattern)
            answering = kind(operation, route.transport.codec, method, monitor.tallies.note_failure)
            if not lazy:
                answering.compile()
            tally = Tally(port, operation, pattern, route)
            handling = BoundHandler(answering, monitor, tally, port.concurrent, turn, outside)
            if pattern is not Pattern.PUBLISH:  # the claim of an interface's first operation covers the others
                channel = replace(channel, exclusive=route.middleware not in claimed, lazy=lazy)
                claimed.add(route.middleware)
            link = _link_of(replace(channel, signed=True) if signed else channel, route.transport, handling, watched)
            handling.count_in(link.stats)
            links.append(link)
            if not lazy and not outside:
                monitor.tallies.add(tally, link)
    return links


def _link_of(channel: Channel, transport: Transport, handling: BoundHandler, watched: Watched | None) -> Link:
    """The link through which a transport calls a handler."""
    signed = channel.signed
    if channel.pattern is Pattern.QUERY:
        return transport.server(channel, signing(handling.serve) if signed else handling.serve)
    if watched:
        channel = replace(channel, on_receive=watched.heard)
    is_told = signed and channel.pattern is Pattern.COMMAND  # a subscription has its own way: see `Reception`
    link = transport.inlet(channel, signing(handling.receive) if is_told else handling.receive)
    if watched:
        watched.add(link)
    return link


def checked_channel(route: Route, operation: Operation[Any], pattern: Pattern) -> Channel:
    """The channel of an operation. Raises UnsupportedQoS if its transport cannot provide the QoS."""
    kind = type_of(operation, pattern)
    channel = Channel(route.channel, pattern, kind, route.qos, operation.idempotent)
    require(route.transport, route.middleware, channel)
    return channel


class BoundQuery:
    """A query that is connected to its server."""

    def __init__(self, call: Call[Any], caller: Caller, monitor: Monitor, deadline: float, tally: Tally) -> None:
        self._call, self._caller, self._monitor, self._deadline = call, caller, monitor, deadline
        self._tally = tally

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        limit = self._deadline if deadline is None else _positive(deadline)
        payload = self._call.encode(arguments)
        tally = self._tally
        tally.count = count = tally.count + 1
        timing = None if count < tally.due else tally.start(arguments)
        suspended = self._monitor.suspend()
        try:
            reply = self._caller.ask(payload, limit)
            if timing:
                timing.end(reply)
        except BaseException as exc:
            tally.failed += 1
            if timing:
                timing.tell(exc)
            raise
        finally:
            if suspended:
                self._monitor.resume(suspended)
        if reply.status is _OK:
            return self._call.value(reply.payload)
        if reply.status is not _THROWN:
            tally.failed += 1
        return self._call.result(reply)

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Future[Any]:
        limit = self._deadline if deadline is None else _positive(deadline)
        answer = Answer(self._monitor, self._call)
        payload, tally = self._call.encode(arguments), self._tally
        timing = tally.watch(arguments)
        source = self._caller.call(payload, limit)
        source.add_done_callback(partial(self._answered, timing))
        answer.follow(source)
        return answer

    def _answered(self, timing: Timing, source: Future[Reply]) -> None:
        if source.cancelled():
            timing.tell(CancelledError("the caller cancelled it"))
            return
        tally = self._tally
        tally.count = count = tally.count + 1
        if exc := source.exception():
            tally.failed += 1
            timing.tell(exc)
            return
        reply = source.result()
        if reply.status not in (_OK, _THROWN):
            tally.failed += 1
        if count < tally.due:
            timing.tell(reply)
        else:
            tally.take_turn()
            timing.end(reply)


class BoundSend:
    """A command or a publication that is connected over one middleware."""

    def __init__(self, call: Call[Any], outlet: Outlet, deadline: float, tally: Tally) -> None:
        self._call, self._encode, self._outlet, self._deadline = call, call.encode, outlet, deadline
        self._tally = tally
        self._tells = outlet if isinstance(outlet, SupportsSubscribers) else None

    @property
    def has_subscribers(self) -> bool:
        return self._tells is None or self._tells.has_subscribers

    @cached_property
    def loans(self) -> Loans:
        return Loans(self._call, self._outlet)

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        """`memory` holds the arguments if they were filled in place."""
        limit = self._deadline if deadline is None else _positive(deadline)
        tally = self._tally
        tally.count = count = tally.count + 1
        timing = None if count < tally.due else tally.start(arguments)
        try:
            if memory and self.lent(memory):
                memory.send(arguments, limit)
            else:
                self._outlet.send(self._encode(arguments), limit)
        except BaseException as exc:
            tally.failed += 1
            if timing:
                timing.tell(exc)
            raise
        if timing:
            timing.end(_TAKEN)

    def lent(self, memory: Memory | None) -> bool:
        return memory is not None and memory.loans is self.loans


class FanOut:
    """A publication over several middlewares, each with its own subscribers."""

    def __init__(self, ways: Sequence[BoundSend], deadline: float) -> None:
        self._ways, self._deadline = ways, deadline

    @property
    def loans(self) -> Loans:
        """The loans of a middleware that lends memory, if one in use does. The others copy from that memory."""
        ways = self._needed()
        return next((way.loans for way in ways if way.loans.in_place), ways[0].loans)

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        """Send over each middleware in use. One error does not stop the others; the first is raised at the end."""
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

    @property
    def has_subscribers(self) -> bool:
        return any(way.has_subscribers for way in self._ways)

    def _needed(self) -> list[BoundSend]:
        """The middlewares with subscribers, or the first if there are none."""
        return [way for way in self._ways if way.has_subscribers] or list(self._ways[:1])


class WatchedSend:
    """A publication whose QoS has a deadline or a manual lease, so that each message is noted."""

    def __init__(self, way: BoundSend | FanOut, watched: Watched, channel: str) -> None:
        self._way, self._heard, self._channel = way, watched.heard, channel
        watched.publishes(channel)

    @property
    def has_subscribers(self) -> bool:
        return self._way.has_subscribers

    @property
    def loans(self) -> Loans:
        return self._way.loans

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        self._way.send(arguments, deadline, memory)
        self._heard(self._channel)


class BoundHandler:
    """A handler that a transport calls. `turn` serializes messages of one subscription that come over several."""

    def __init__(
        self,
        answering: Handler,
        monitor: Monitor,
        tally: Tally,
        concurrent: bool,
        turn: threading.Lock | None = None,
        outside: bool = False,
    ) -> None:
        self._answering, self._monitor, self._concurrent, self._outside = answering, monitor, concurrent, outside
        self._turn = turn
        self._tally = tally
        self._takes = 0.0
        """Seconds that the handler takes: the longest of its latest timed calls, of which earlier ones count less."""
        self._stats = Statistics()

    def count_in(self, stats: Statistics) -> None:
        """Count in the statistics of this link, and add what was counted before this call."""
        stats.malformed += self._stats.malformed
        self._stats = stats

    def serve(self, payload: Payload, expires: float) -> Reply | Future[Reply]:
        try:
            arguments = self._answering.decode(payload)
        except DecodeError as exc:
            self._count_malformed(exc)
            return self._answering.failed(exc)
        if self._outside:
            return self._answering.answer(arguments)
        tally = self._tally
        tally.count = count = tally.count + 1
        timing = None if count < tally.due else tally.start(arguments)
        if self._concurrent or not self._monitor.try_enter():
            return self._serve_later(arguments, expires, timing)
        try:
            if timing and self._takes > _LONG:
                about_to_block()
            reply = self._answering.answer(arguments)
            if timing:
                self._end(timing, reply)
            if reply.status is not _OK and reply.status is not _THROWN:
                tally.failed += 1
            return reply
        finally:
            self._monitor.leave()

    def _serve_later(self, arguments: tuple[Any, ...], expires: float, timing: Timing | None) -> Reply | Future[Reply]:
        """Serve on a thread of the monitor. A method of its own: a function within `serve` would cost each call."""
        answer: Future[Reply] = Future()

        def job() -> Reply:
            if timing:
                timing.run()
            is_late = _now() >= expires
            reply = Reply(Status.EXPIRED) if is_late else self._answering.answer(arguments)
            if timing:
                self._end(timing, reply)
            self._judge(reply)
            return reply

        submit = self._monitor.submit_concurrent if self._concurrent else self._monitor.submit
        if submit(job, then=answer.set_result, refused=partial(answer.set_result, Reply(Status.REFUSED))):
            return answer
        refused = Reply(Status.REFUSED if self._monitor.closed else Status.BUSY)
        self._judge(refused)
        if timing:
            timing.tell(refused)
        return refused

    def receive(self, payload: Payload) -> None:
        try:
            arguments = self._answering.decode(payload)
        except DecodeError as exc:
            self._count_malformed(exc)
            return
        tally = self._tally
        tally.count = count = tally.count + 1
        timing = None if count < tally.due else tally.start(arguments)
        if self._concurrent:
            self._take_now(arguments, timing)
            return
        turn = self._turn
        if turn is None:
            self._take(arguments, timing)
            return
        if not turn.acquire(blocking=False):
            about_to_block()
            turn.acquire()
        try:
            self._take(arguments, timing)
        finally:
            turn.release()

    def _take(self, arguments: tuple[Any, ...], timing: Timing | None) -> None:
        if not self._monitor.try_enter():
            try:
                self._monitor.enter()
            except Closed:
                return  # the component is stopping
            if timing:
                timing.run()
        try:
            self._take_now(arguments, timing)
        finally:
            self._monitor.leave()

    def _take_now(self, arguments: tuple[Any, ...], timing: Timing | None) -> None:
        if timing and self._takes > _LONG:
            about_to_block()
        is_fine = self._answering.take(arguments)
        if not is_fine:
            self._tally.failed += 1
        if timing:
            self._end(timing, _TAKEN if is_fine else _FAILED)

    def _end(self, timing: Timing, outcome: Reply) -> None:
        self._takes = max(timing.end(outcome), _FADES * self._takes)
        if self._takes > _LONG:
            self._tally.time_each()  # whether a call is long is asked only of timed ones

    def _judge(self, reply: Reply) -> None:
        if reply.status not in (_OK, _THROWN):
            self._tally.failed += 1

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
    """Close links, the last first. An error of one is logged, and the others are closed, too."""
    while links:
        try:
            links.pop().close()
        except Closed:
            continue
        except Exception:  # of any transport
            log.exception("closing a link")
