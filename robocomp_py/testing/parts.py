"""Parts of the suites for transports: channels, payloads, inboxes, and a peer that can be killed."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any, Protocol

import pytest

from ..contract.interface import Pattern
from ..contract.qos import QoS
from ..contract.types import INT16, UINT8, Field, Sequence, Struct
from ..errors import Timeout
from ..transports.base import Caller, Capability, Channel, Outlet, Reply, Status, Transport, TypeRef
from ..wire.codec import Payload
from .patience import SCALE, SOON, wait_until

A_MOMENT = 0.3 * SCALE
"""How long a test delays work that others must not wait for."""

BLOB = Struct("Conformance::Blob", (Field("data", Sequence(UINT8)),))
_OTHER_BLOB = Struct("Conformance::Blob", (Field("data", Sequence(INT16)),))
_TEXT = "operation Conformance::Blob.send\nstruct Conformance::Blob\n  data sequence<{}>"
_TYPE = TypeRef("Conformance::Blob", 1, _TEXT.format("uint8"), BLOB, BLOB)
OTHER = TypeRef("Conformance::Blob", 2, _TEXT.format("int16"), _OTHER_BLOB, _OTHER_BLOB)
"""A different contract under the same name."""

Inbox = queue.Queue[bytes]


class TransportSuite(ABC):
    """The base of transport tests: two transports, and a new channel for each test."""

    @abstractmethod
    def open_transport(self) -> Transport:
        """A new transport, which reaches all others of its kind in this process and in processes started by it."""

    @pytest.fixture
    def here(self) -> Iterator[Transport]:
        transport = self.open_transport()
        yield transport
        transport.close()

    @pytest.fixture
    def there(self) -> Iterator[Transport]:
        transport = self.open_transport()
        yield transport
        transport.close()

    @pytest.fixture
    def name(self) -> str:
        return f"i{uuid.uuid4().hex[:12]}/Conformance/op"

    @pytest.fixture
    def pool(self) -> Iterator[ThreadPoolExecutor]:
        with ThreadPoolExecutor(16) as executor:
            yield executor


class ComponentSuite(ABC):
    """The base of tests with components. `open_transport` is all that a transport must fill in."""

    @abstractmethod
    def open_transport(self, owner: str = "test") -> Transport:
        """A new transport, which reaches all others of its kind in this process and in processes started by it."""

    @pytest.fixture
    def ending(self) -> Iterator[ExitStack]:
        with ExitStack() as stack:
            yield stack


def topic(name: str, qos: QoS = QoS()) -> Channel:  # noqa: B008 - frozen
    return Channel(name, Pattern.PUBLISH, _TYPE, qos)


def command(name: str) -> Channel:
    return Channel(name, Pattern.COMMAND, _TYPE)


def query(name: str) -> Channel:
    return Channel(name, Pattern.QUERY, _TYPE)


def blob(transport: Transport, data: bytes) -> Payload:
    """Bytes, encoded by the transport's codec."""
    return transport.codec.encoder(BLOB)((data,))


def unblob(transport: Transport, payload: Payload) -> bytes:
    (data,) = transport.codec.decoder(BLOB)(payload)
    return bytes(data.tobytes())


def in_time(reply: Reply) -> Reply:
    """The reply. Raises Timeout if it says that the call has expired."""
    if reply.status is Status.EXPIRED:
        raise Timeout("its server found that it had expired")
    return reply


def answering(transport: Transport, answer: Callable[[bytes], bytes]) -> Callable[[Payload, float], Reply]:
    """A service that applies a function to the bytes of each request."""
    return lambda payload, expires: Reply(Status.OK, blob(transport, answer(unblob(transport, payload))))


def answering_all_but(transport: Transport, unanswered: bytes) -> Callable[[Payload, float], Reply | Future[Reply]]:
    """A service that echoes requests, but never answers this one."""

    def service(payload: Payload, expires: float) -> Reply | Future[Reply]:
        data = unblob(transport, payload)
        return Future() if data == unanswered else Reply(Status.OK, blob(transport, data))

    return service


def asker(transport: Transport, caller: Caller, how: str, deadline: float = SOON) -> Callable[[bytes], bytes]:
    """A function that asks by `ask` or `call`, whichever `how` names, and returns the bytes of the reply."""

    def ask(data: bytes) -> bytes:
        payload = blob(transport, data)
        reply = caller.ask(payload, deadline) if how == "ask" else caller.call(payload, deadline).result(SOON * 3)
        assert in_time(reply).status is Status.OK
        return unblob(transport, reply.payload)

    return ask


def drain(inbox: Inbox) -> list[bytes]:
    return [inbox.get_nowait() for _ in range(inbox.qsize())]


def put(transport: Transport, inbox: Inbox) -> Callable[[Payload], None]:
    return lambda payload: inbox.put(unblob(transport, payload))


def subscribe(transport: Transport, channel: Channel) -> Inbox:
    inbox = Inbox()
    transport.inlet(channel, put(transport, inbox))
    return inbox


def greet(transport: Transport, outlet: Outlet, *inboxes: Inbox) -> None:
    """Send until every inbox has received a message, then empty them: all are connected, nothing is in flight."""
    assert outlet.wait_peer(SOON)

    def all_hear() -> bool:
        outlet.send(blob(transport, b"hello"))
        return not any(inbox.empty() for inbox in inboxes)

    wait_until(all_hear)
    outlet.send(blob(transport, b"go"))
    for inbox in inboxes:
        while inbox.get(timeout=SOON) != b"go":
            pass


processes = multiprocessing.get_context("forkserver")
"""Other processes are forked from one that has imported what all need, for that takes most of their time."""


def start_process(act: Callable[..., object], *arguments: object) -> Any:
    """Start another process, in the environment of this one."""
    processes.set_forkserver_preload(["robocomp_py.testing.conformance", "robocomp_py.testing.faults"])
    process = processes.Process(target=_act, args=(dict(os.environ), act, *arguments))
    process.start()
    return process


def _act(environment: dict[str, str], act: Callable[..., object], *arguments: object) -> None:
    os.environ.clear()  # the one it is forked from may be older than a variable
    os.environ.update(environment)
    act(*arguments)


class Suite(Protocol):
    def open_transport(self) -> Transport: ...


class Victim:
    """A peer that can be killed: another process, where the transport reaches one.

    By default a server that gets stuck in a call.
    """

    def __init__(
        self,
        suite: Suite,
        seen_from: Transport,
        name: str,
        act: Callable[[Transport, str, Any], None] | None = None,
    ) -> None:
        act = act or _serve_stuck
        self._stuck: Any
        if Capability.CROSS_PROCESS in seen_from.capabilities:
            self._stuck = processes.Event()
            self._process: Any = start_process(_be_victim, type(suite), name, self._stuck, act)
        else:
            self._stuck = threading.Event()
            transport = suite.open_transport()
            act(transport, name, self._stuck)
            self._transport: Transport = transport
            self._process = None

    def wait_until_stuck(self) -> None:
        assert self._stuck.wait(SOON)

    def hang(self) -> bool:
        """Stop the peer until `go_on`, as if it hung. Returns False if that is not possible."""
        if self._process is not None:
            os.kill(self._process.pid, signal.SIGSTOP)
        return self._process is not None

    def go_on(self) -> None:
        os.kill(self._process.pid, signal.SIGCONT)

    def kill(self) -> None:
        if self._process is None:
            self._transport.close()
        else:
            self._process.kill()
            self._process.join()


def _be_victim(suite: type[Suite], name: str, stuck: Any, act: Callable[[Transport, str, Any], None]) -> None:
    act(suite().open_transport(), name, stuck)
    time.sleep(SOON * 10)  # until killed


def publish_once(transport: Transport, name: str, stuck: Any) -> None:
    outlet = transport.outlet(topic(name))
    outlet.wait_peer(SOON)
    outlet.send(blob(transport, b"last words"))


def _serve_stuck(transport: Transport, name: str, stuck: Any) -> None:
    def service(payload: Payload, expires: float) -> Future[Reply]:
        stuck.set()
        return Future()

    transport.server(query(name), service)
