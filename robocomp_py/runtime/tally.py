"""Counts the messages that each middleware carried for a component, if $ROBOCOMP_TALLY names a folder.

When a component ends, it writes `<namespace>.<instance>.json`, a list of objects: instance, port, operation, middleware
and number of messages. For required interfaces, answered calls and sent commands are counted; for subscriptions,
received messages. Without the variable, nothing is counted.
"""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from ..contract.component import Port
from ..contract.interface import Verb
from .introspection import Bound
from .ports import Proxy, wrap

FOLDER = "ROBOCOMP_TALLY"

log = logging.getLogger("robocomp.worker")


class Counted:
    """A bound operation that counts its successful calls."""

    def __init__(self, inner: Any) -> None:
        self._inner, self._lock, self.number = inner, threading.Lock(), 0

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        answer = self._inner.ask(arguments, deadline)
        self._count()
        return answer

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Future[Any]:
        answer: Future[Any] = self._inner.ask_async(arguments, deadline)
        Future.add_done_callback(answer, self._answered)  # an Answer's own method would run it inside the monitor
        return answer

    def send(self, arguments: tuple[Any, ...], deadline: float | None) -> None:
        self._inner.send(arguments, deadline)
        self._count()

    def _answered(self, answer: Future[Any]) -> None:
        if not answer.cancelled() and answer.exception(0) is None:
            self._count()

    def _count(self) -> None:
        with self._lock:
            self.number += 1


class Tally:
    """The counts of one component. Does nothing unless $ROBOCOMP_TALLY names a folder."""

    def __init__(self, namespace: str, instance: str) -> None:
        folder = os.environ.get(FOLDER)
        name = "/".join(filter(None, (namespace, instance)))
        self._file = Path(folder, f"{name.replace('/', '.')}.json") if folder else None
        self._instance = instance
        self._counted: dict[str, dict[str, Counted]] = {}

    def watch(self, port: Port, proxy: Proxy) -> None:
        """Count calls through a proxy from now on."""
        if self._file and port.verb is Verb.REQUIRES:
            self._counted[port.name] = wrap(proxy, Counted)

    def write(self, bound: Sequence[Bound]) -> None:
        if self._file is None:
            return
        try:
            self._file.write_text(json.dumps([row for each in bound for row in self._rows(each)]), encoding="utf-8")
        except OSError as exc:
            log.warning("%s: cannot be written: %s", self._file, exc.strerror)

    def _rows(self, bound: Bound) -> Iterator[dict[str, Any]]:
        operations = [operation.name for operation, _ in bound.port.interface.under(bound.port.verb)]
        links = iter(bound.links)
        for operation, route in zip(operations, bound.routes, strict=False):  # those of actions come last
            if bound.port.verb is Verb.REQUIRES:
                yield self._row(bound, operation, route.middleware, self._counted[bound.port.name][operation].number)
            elif bound.port.verb is Verb.SUBSCRIBES:
                for each, link in zip(route.all, links, strict=False):
                    yield self._row(bound, operation, each.middleware, link.stats.received)

    def _row(self, bound: Bound, operation: str, middleware: str, messages: int) -> dict[str, Any]:
        return {
            "instance": self._instance,
            "port": bound.port.label,
            "operation": operation,
            "middleware": middleware,
            "messages": messages,
        }
