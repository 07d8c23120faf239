"""Tells of calls and log records, on topics that exist only while a tool holds a lease on them.

A call or a log record is only put into a bounded queue, and a thread of each topic publishes it. What does not fit is
counted. A component imports this module with the first lease.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError
from dataclasses import asdict
from functools import partial
from typing import Any, Protocol

import numpy as np

from ..contract.component import Port
from ..contract.interface import Interface, Verb
from ..contract.types import ExceptionType
from ..errors import (
    Busy,
    Closed,
    ConfigurationError,
    ContractMismatch,
    DeclaredError,
    EncodeError,
    Refused,
    RemoteFailure,
    RobocompError,
    Timeout,
    Unreachable,
)
from ..threads import NO_THREAD, start_thread
from ..transports.base import Reply, Status
from ..wire import json as values
from ..wire import names
from ..wire.cdr import Cdr
from ..wire.codec import Encoder
from . import calls
from .ports import Proxy
from .records import RecordFormatter, read
from .RoboCompIntrospection import INTROSPECTIONPUB_INTERFACE, Call, Record
from .tally import Finish, Tallies, Tally

LONGEST_LEASE = 60.0
"""Seconds."""

WAITING = 1000
"""Maximum number of calls, or of records, that wait to be published."""

OCTETS = 16 * 1024 * 1024
"""Maximum number of octets of their requests and responses; a single larger call is told nevertheless."""

_DEADLINE = 1.0
"""Seconds that one publication may take."""

Publish = Callable[[Port], tuple[Any, Callable[[], None]]]
"""Opens a topic: returns a proxy, and what closes its links."""

Told = Call | Record

log = logging.getLogger("robocomp.worker")


def _port(operation: str) -> Port:
    whole = INTROSPECTIONPUB_INTERFACE
    one = Interface(whole.name, tuple(each for each in whole.operations if each.name == operation))
    return Port(Verb.PUBLISHES, one, proxy=Proxy)


CALLED, LOGGED = _port("called"), _port("logged")


class Telling:
    """What one component tells. Safe to use from any thread."""

    def __init__(self, publish: Publish, tallies: Tallies, instance: str, namespace: str) -> None:
        self._publish = publish
        self._changing = threading.Lock()
        self._is_closed = False
        self._watches: dict[str, Callable[[_Topic], _Watch]] = {
            "calls": partial(_Calls, tallies, names.whole(instance, namespace)[1:]),
            "logs": partial(_Logs, instance),
        }
        self._topics: dict[str, _Topic] = {}

    def watch(self, calls: bool, logs: bool, lease: float) -> None:
        """Tell for `lease` seconds from now. Raises ConfigurationError, Closed, and TransportError if a topic cannot be
        opened."""
        if not 0 < lease <= LONGEST_LEASE:
            raise ConfigurationError(f"a lease lasts at most {LONGEST_LEASE:g} s, and more than 0, not {lease:g}")
        until = time.monotonic() + lease
        with self._changing:
            if self._is_closed:
                raise Closed("the component is stopping")
            for name, port, is_wanted in (("calls", CALLED, calls), ("logs", LOGGED, logs)):
                topic = self._topics.get(name)
                if is_wanted and topic and not topic.is_over:
                    topic.until = max(topic.until, until)
                elif is_wanted:
                    self._topics[name] = self._opened(name, port, until)

    def close(self) -> None:
        """Stop, and wait until the topics are closed. Idempotent."""
        with self._changing:
            self._is_closed = True
        for topic in self._topics.values():
            topic.close()

    def _opened(self, name: str, port: Port, until: float) -> _Topic:
        topic = _Topic(name, port, self._publish, until, self._changing)
        topic.begin(self._watches[name](topic))
        return topic


class _Watch(Protocol):
    """Notices calls or records, from `begin` to `end`."""

    def begin(self) -> None: ...

    def end(self) -> None: ...


class _Topic:
    """One topic, from its first lease until none is left; then its thread closes it."""

    def __init__(self, name: str, port: Port, publish: Publish, until: float, changing: threading.Lock) -> None:
        self._proxy, self._close_links = publish(port)
        (self._operation,) = port.interface.operations
        self.until = until
        self.is_over = False
        self._changing = changing
        self._waiting: deque[tuple[Told, int]] = deque()
        self._octets = self._dropped = 0
        self._changed = threading.Condition()
        self._is_stopped = False
        self._thread = threading.Thread(target=self._run, name=f"telling-{name}")
        self._watch: _Watch | None = None

    @property
    def in_own_thread(self) -> bool:
        """Whether the calling thread is the one that publishes."""
        return threading.current_thread() is self._thread

    def begin(self, watch: _Watch) -> None:
        self._watch = watch
        watch.begin()
        if not start_thread(self._thread):
            self._end()
            raise ConfigurationError(NO_THREAD)

    def put(self, told: Told, octets: int = 0) -> None:
        """Publish it soon, unless too much waits already."""
        with self._changed:
            is_full = len(self._waiting) >= WAITING or (self._octets > 0 and self._octets + octets > OCTETS)
            if is_full or self._is_stopped:
                self._dropped += 1
                return
            told.dropped, self._dropped = self._dropped, 0
            self._octets += octets
            self._waiting.append((told, octets))
            self._changed.notify()

    def lose(self) -> None:
        """Count one that could not be published."""
        with self._changed:
            self._dropped += 1

    def close(self) -> None:
        with self._changed:
            self._is_stopped = True
            self._changed.notify()
        if self._thread.ident:
            self._thread.join()

    def _run(self) -> None:
        while not self._closed_if_over():
            told = self._next()
            if told is None:
                continue
            try:
                self._proxy._send(self._operation, (told,), _DEADLINE)
            except RobocompError as exc:
                self.lose()
                log.debug("telling: %s", exc)  # not told itself, as it comes from this thread

    def _next(self) -> Told | None:
        with self._changed:
            if not self._waiting and not self._is_stopped:
                self._changed.wait(max(0.0, self.until - time.monotonic()))
            if not self._waiting:
                return None
            told, octets = self._waiting.popleft()
            self._octets -= octets
            return told

    def _closed_if_over(self) -> bool:
        """Close the topic if its last lease is over; returns whether it is."""
        if time.monotonic() < self.until and not self._is_stopped:
            return False
        with self._changing:
            if time.monotonic() < self.until and not self._is_stopped:
                return False
            self._end()
            return True

    def _end(self) -> None:
        self.is_over = True
        if self._watch:
            self._watch.end()
        self._close_links()


class _Calls:
    """Tells of the queries and commands of a component, as their two hooks begin and end."""

    def __init__(self, tallies: Tallies, instance: str, topic: _Topic) -> None:
        self._tallies, self._instance, self._topic = tallies, instance, topic
        self._translations: dict[Tally, _Translation] = {}

    def begin(self) -> None:
        self._tallies.tell(self._begun)

    def end(self) -> None:
        self._tallies.tell(None)

    def _begun(self, tally: Tally, arguments: tuple[Any, ...]) -> Finish:
        translation = self._translations.get(tally)
        if translation is None:
            translation = self._translations[tally] = _Translation(tally)
        request = translation.request(arguments)
        return partial(self._ended, tally, translation, request, time.time_ns(), time.monotonic())

    def _ended(
        self,
        tally: Tally,
        translation: _Translation,
        request: bytes,
        at: int,
        begun: float,
        outcome: Reply | BaseException,
    ) -> None:
        took = time.monotonic() - begun
        status, error, response = translation.outcome(outcome)
        made = Call(
            caller=self._instance if tally.port.verb is Verb.REQUIRES else "",
            channel=tally.route.channel,
            middleware=tally.route.middleware,
            begun=at,
            took=took,
            status=status,
            error=_plain(error),
            request=np.frombuffer(request, np.uint8),
            response=np.frombuffer(response, np.uint8),
        )
        self._topic.put(made, len(request) + len(response))


class _Translation:
    """From the messages of one operation over one middleware to CDR and words."""

    def __init__(self, tally: Tally) -> None:
        operation = tally.operation
        self._call = calls.Call(operation, tally.route.transport.codec)
        self._request, self._response = Cdr().encoder(operation.request), Cdr().encoder(operation.response)
        self._outputs = len(operation.outputs)

    def request(self, arguments: tuple[Any, ...]) -> bytes:
        """Empty if CDR has no form of them."""
        return _encoded(self._request, arguments)

    def outcome(self, outcome: Reply | BaseException) -> tuple[str, str, bytes]:
        """The status, the error, and the response if there is one."""
        try:
            if isinstance(outcome, BaseException):
                raise outcome
            if outcome.payload is None and outcome.status is Status.OK:  # a command
                return "ok", "", b""
            if outcome.payload is None and outcome.status is Status.FAILED:  # without a reason: a command, too
                return "failed", "", b""
            result = self._call.result(outcome)
            outputs = result if self._outputs > 1 else (result,) * self._outputs
            return "ok", "", _encoded(self._response, outputs)
        except BaseException as exc:  # it becomes part of the message; the call itself raises it to its caller
            return _status(exc), _reason(exc), b""


def _encoded(encode: Encoder, values: tuple[Any, ...]) -> bytes:
    try:
        return bytes(encode(values))
    except EncodeError as exc:
        log.debug("telling: %s", exc)
        return b""


_STATUS: dict[type[BaseException], str] = {
    DeclaredError: "thrown",
    RemoteFailure: "failed",
    Timeout: "timeout",
    Busy: "busy",
    ContractMismatch: "mismatch",
    Closed: "closed",
    Unreachable: "unreachable",
    CancelledError: "cancelled",
    Refused: "refused",
}


def _status(exc: BaseException) -> str:
    return next((word for kind, word in _STATUS.items() if isinstance(exc, kind)), "failed")


def _reason(exc: BaseException) -> str:
    match exc:
        case DeclaredError():
            contract: ExceptionType = exc.__contract__  # type: ignore[attr-defined]  # of every generated class
            fields = contract.all_fields
            shown = values.show_fields(fields, [getattr(exc, each.attribute) for each in fields])
            return f"{contract.name.replace('::', '.')}: {json.dumps(shown)}"
        case RemoteFailure():
            return f"{exc.kind}: {exc.reason}" if exc.kind else exc.reason
        case _:
            return str(exc)


def _plain(text: str) -> str:
    """The text without what some middleware cannot carry: half a surrogate pair, and NUL."""
    return text.encode(errors="backslashreplace").decode().replace("\0", "\ufffd")


class _Logs(logging.Handler):
    """Tells what a component logs; of a shared process, also what belongs to no component."""

    def __init__(self, instance: str, topic: _Topic) -> None:
        super().__init__()
        self._instance, self._topic = instance, topic
        self.setFormatter(RecordFormatter(self._speaker))

    def begin(self) -> None:
        logging.getLogger().addHandler(self)

    def end(self) -> None:
        logging.getLogger().removeHandler(self)
        self.close()

    def _speaker(self, record: logging.LogRecord) -> str:
        return getattr(record, "instance", self._instance)  # which a shared process has found out already

    def emit(self, record: logging.LogRecord) -> None:
        if self._topic.in_own_thread or self._speaker(record) not in ("", self._instance):
            return
        try:
            found = read(self.format(record))
        except Exception:  # formatting runs code of the arguments; `logging` reports it, as for its own handlers
            self.handleError(record)
            return
        if found:
            facts: dict[str, Any] = asdict(found)
            facts |= {name: _plain(each) for name, each in facts.items() if isinstance(each, str)}
            self._topic.put(Record(at=round(facts.pop("time") * 1e9), **facts))
