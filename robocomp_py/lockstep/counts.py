"""Counts what a component sends and handles, so that the leader of its clock knows whether messages are under way.

Publishes, Sends     messages sent so far
Hears, Takes         messages handled so far
Calls, Serves        calls in progress, at the client and at the server
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import wraps
from typing import Any

from ..contract.component import Port
from ..contract.interface import Pattern
from ..runtime.loans import Loans, Memory
from ..runtime.ports import Proxy, wrap
from ..runtime.route import Route
from .clock import Followed
from .RoboCompLockstep import Counter, Way

_WAYS = {
    (Pattern.PUBLISH, True): Way.Publishes,
    (Pattern.PUBLISH, False): Way.Hears,
    (Pattern.COMMAND, True): Way.Sends,
    (Pattern.COMMAND, False): Way.Takes,
    (Pattern.QUERY, True): Way.Calls,
    (Pattern.QUERY, False): Way.Serves,
}
"""By pattern, and by whether the component sends the messages."""


class Counts:
    """The counters of one component. Safe to use from any thread."""

    def __init__(self, clock: Followed) -> None:
        self.clock = clock
        self.counters: list[Counter] = []
        self.version = secrets.randbits(30)
        """Increases when a counter is added or dropped. It begins at random: a restarted component has another one."""
        self.calls = 0
        """Number of calls of others for whose end this component waits."""
        self.made = 0
        """Number of calls of others that it has made so far."""
        self._numbers: list[int] = []
        self._lock = threading.Lock()

    def numbers(self) -> tuple[int, ...]:
        """The numbers now, in the order of the counters."""
        return tuple(self._numbers)  # without the lock: no other thread runs meanwhile

    def proxy(self, port: Port, proxy: Proxy, routes: Sequence[Route]) -> list[int]:
        """Count what goes through a proxy. Returns the numbers of its counters."""
        names = [operation.name for operation, _ in port.interface.under(port.verb)]
        added = self._add_all(port, routes)
        numbers = dict(zip(names, added, strict=True))
        by_bound = {id(bound): numbers[name] for name, bound in proxy._bound.items()}
        wrap(proxy, lambda bound: CountedProxy(self, by_bound[id(bound)], bound))
        return added

    def handlers(self, port: Port, worker: object) -> CountedHandlers:
        """The handlers of a port, which count. Their `routes` must be called once the port is bound."""
        return CountedHandlers(self, port, worker)

    def drop(self, numbers: Sequence[int]) -> None:
        """Stop waiting for these counters."""
        with self._lock:
            for number in numbers:
                self.counters[number] = Counter(self.counters[number].way, [])
            self.version += 1

    def add(self, number: int, by: int) -> None:
        with self._lock:
            self._numbers[number] += by

    def add_call(self, number: int, by: int) -> None:
        """Count a call of another component that begins (1) or ends (-1)."""
        with self._lock:
            self._numbers[number] += by
            self.calls += by
            self.made += by > 0

    def _add_all(self, port: Port, routes: Sequence[Route]) -> list[int]:
        """Add a counter for each operation of a port."""
        numbers = []
        for (_, pattern), route in zip(port.interface.under(port.verb), routes, strict=True):
            way = _WAYS[pattern, port.verb.has_proxy]
            channels = dict.fromkeys(each.channel for each in (route.all if way is Way.Hears else (route,)))
            with self._lock:
                numbers.append(len(self.counters))
                self.counters.append(Counter(way, list(channels)))
                self._numbers.append(0)
                self.version += 1
        return numbers


class CountedProxy:
    """A bound operation of a proxy that counts its messages, or its calls in progress."""

    def __init__(self, counts: Counts, number: int, bound: Any) -> None:
        self._counts, self._number, self._bound = counts, number, bound

    @property
    def loans(self) -> Loans:
        loans: Loans = self._bound.loans
        return loans

    @property
    def has_subscribers(self) -> bool:
        told: bool = self._bound.has_subscribers
        return told

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        counts = self._counts
        counts.add_call(self._number, 1)
        try:
            with counts.clock.away():
                return self._bound.ask(arguments, deadline)
        finally:
            counts.add_call(self._number, -1)

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Future[Any]:
        self._counts.add_call(self._number, 1)
        try:
            answer: Future[Any] = self._bound.ask_async(arguments, deadline)
        except BaseException:
            self._counts.add_call(self._number, -1)
            raise
        Future.add_done_callback(answer, lambda _: self._counts.add_call(self._number, -1))
        return answer

    def send(self, arguments: tuple[Any, ...], deadline: float | None, memory: Memory | None = None) -> None:
        self._counts.add(self._number, 1)  # before it is sent, since it may be handled at once
        try:
            if memory is None:
                self._bound.send(arguments, deadline)
            else:
                self._bound.send(arguments, deadline, memory)
        except BaseException:
            self._counts.add(self._number, -1)
            raise


class CountedHandlers:
    """The handlers of one port. Each attribute is a method of the worker that counts its calls."""

    def __init__(self, counts: Counts, port: Port, worker: object) -> None:
        self._counts, self._port, self._worker = counts, port, worker
        self._numbers: dict[str, int] = {}
        self._patterns = {port.handler(op.name): pattern for op, pattern in port.interface.under(port.verb)}

    def routes(self, routes: Sequence[Route]) -> list[int]:
        """Tell the channels, in the order of the operations. Returns the numbers of the counters."""
        added = self._counts._add_all(self._port, routes)
        self._numbers = dict(zip(self._patterns, added, strict=True))
        return added

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method: Callable[..., Any] = getattr(self._worker, name)
        is_query = self._patterns[name] is Pattern.QUERY

        @wraps(method)
        def counted(*arguments: Any) -> Any:
            number = self._numbers.get(name)
            if number is None:  # a message that comes before all ports are bound
                return method(*arguments)
            if is_query:
                self._counts.add(number, 1)
                try:
                    return method(*arguments)
                finally:
                    self._counts.add(number, -1)
            try:
                return method(*arguments)
            finally:
                self._counts.add(number, 1)

        return counted
