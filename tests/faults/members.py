"""Components for the processes of a run.

A server, a relay that asks the server, and clients that ask the relay; a herald, which publishes, and a reader.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import RemoteFailure, RobocompError, Unreachable
from robocomp_py.runtime import settings
from robocomp_py.runtime.run import Running
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e

from ..runtime.components import EverythingProxy, EverythingPublisher
from .history import Asked, Ended, Executed, Journal

DEADLINE, ONWARD = 1.0, 0.5
"""Seconds that a client gives a call, and that the relay gives its own call of the server."""

_PAUSE = 0.02
"""Seconds that the server takes, so that handlers of the relay wait at the same time."""


class Member(Worker[None]):
    middleware = "zeromq"
    journal: Journal
    name: str


class Handler(Member):
    """Has the handlers that nothing is asked of here."""

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        return divmod(dividend, divisor)

    def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
        return value

    def Everything_echo_arrays(self, value: e.Arrays) -> e.Arrays:
        return value

    def Everything_poke(self, number: int) -> None: ...


class Server(Handler):
    component = Component(
        "server",
        (Port(Verb.IMPLEMENTS, e.EVERYTHING), Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher)),
        period=0.02,
    )
    everything_proxy: EverythingPublisher
    number = 0

    def compute(self) -> None:
        self.number += 1
        self.everything_proxy.news(self.number, "")

    def Everything_work(self, task: str) -> str:
        self.journal.note(Executed(task, self.name, time.monotonic()))
        time.sleep(_PAUSE)
        return self.name


class Relay(Handler):
    component = Component(
        "relay",
        (
            Port(Verb.IMPLEMENTS, e.EVERYTHING),
            Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
            Port(Verb.SUBSCRIBES, e.EVERYTHING),
        ),
        period=0.02,
    )
    everything_proxy: EverythingProxy
    heard = 0

    def Everything_work(self, task: str) -> str:
        return self.everything_proxy.work(task, deadline=ONWARD)

    def Everything_news(self, number: int, text: str) -> None:
        self.heard += 1


class Client(Member):
    component = Component("client", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.005)
    everything_proxy: EverythingProxy

    def __init__(self) -> None:
        self.asks, self.number = threading.Event(), 0
        self.outcomes: Counter[str] = Counter()

    def compute(self) -> None:
        if not self.asks.is_set():
            return
        self.number += 1
        call, server = f"{self.name}.{self.number}", ""
        # What the relay passes on may begin later, by the time that the relay gives it.
        self.journal.note(Asked(call, "query", DEADLINE + ONWARD, time.monotonic()))
        try:
            server, outcome = self.everything_proxy.work(call, deadline=DEADLINE), "ok"
        except RemoteFailure as exc:
            outcome = f"RemoteFailure ({exc.kind})"
        except RobocompError as exc:
            outcome = type(exc).__name__
        self.journal.note(Ended(call, outcome, time.monotonic(), server))
        self.outcomes[outcome] += 1


class Herald(Handler):
    """Publishes a number when it is told to, commanded or asked."""

    component = Component(
        "herald",
        (Port(Verb.IMPLEMENTS, e.EVERYTHING), Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher)),
        period=0.02,
    )
    everything_proxy: EverythingPublisher

    def __init__(self) -> None:
        self.published: list[tuple[int, str]] = []

    def publish(self, number: int, why: str) -> None:
        self.published.append((number, why))
        self.everything_proxy.news(number, why)

    def Everything_poke(self, number: int) -> None:
        self.publish(number, "commanded")

    def Everything_work(self, task: str) -> str:
        self.publish(int(task), "asked")
        return task


class Reader(Member):
    """Commands and asks a herald once for each number that it is given."""

    component = Component(
        "reader",
        (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy), Port(Verb.SUBSCRIBES, e.EVERYTHING)),
        period=0.005,
    )
    everything_proxy: EverythingProxy

    def __init__(self) -> None:
        self.heard: list[tuple[int, str]] = []
        self.number = 0

    def compute(self) -> None:
        if not self.number:
            return
        try:
            self.everything_proxy.poke(self.number, deadline=DEADLINE)
            self.everything_proxy.work(str(self.number), deadline=DEADLINE)
            self.number = 0
        except Unreachable:
            return  # the herald has not started again: once more in the next period

    def Everything_news(self, number: int, text: str) -> None:
        self.heard.append((number, text))


_KINDS: dict[str, type[Member]] = {
    "server": Server,
    "relay": Relay,
    "client": Client,
    "herald": Herald,
    "reader": Reader,
}


class Living:
    """One of them, from its start until `close`."""

    def __init__(
        self,
        kind: str,
        name: str,
        source: str,
        middleware: str,
        journal: Journal,
        options: Mapping[str, Any],
        qos: str = "",
    ) -> None:
        """`options` are those of its transport, `qos` a preset for its topics."""
        worker: Any = type(kind.capitalize(), (_KINDS[kind],), {"journal": journal, "name": name})
        document = settings.Document()
        for key, value in {
            "middleware": middleware,
            "component.startup_timeout": "30",
            "ports.everything.from": source,
            "ports.Everything.from": source if kind in ("relay", "reader") else "",
            "ports.everything.qos": qos if kind == "herald" else "",
            "ports.Everything.qos": qos if kind == "reader" else "",
            **dict(_flat(f"transports.{middleware}", options)),
        }.items():
            if value:
                settings.override(document, f"{key}={value}" if value.isdecimal() else f"{key}='{value}'")
        self._running = Running(worker, settings.check(worker.component, document, name), tell=lambda _: None)
        self.worker: Any = self._running.worker
        self._thread = threading.Thread(target=self._running.run, name=name)
        self._thread.start()

    def wait_until_ready(self) -> None:
        if not self._running.ready.wait(30):
            raise RobocompError(f"{self._thread.name} is not ready")

    @property
    def is_up(self) -> bool:
        return self._running.is_up

    def close(self) -> None:
        self._running.stop()
        self._thread.join(30)
        if self._thread.is_alive():
            raise RobocompError(f"{self._thread.name} does not end")


def _flat(key: str, options: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Options as assignments."""
    for name, value in options.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{key}.{name}", value)
        else:
            yield f"{key}.{name}", str(value)
