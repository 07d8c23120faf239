"""The contract of a transport: payloads in, payloads out, on named channels.

Three patterns, two function types, four verbs:

    publish  1:n    Sink     outlet -> inlet
    command  n:1    Sink     outlet -> inlet
    query    n:1    Service  caller -> server

A transport never sees a type, a declared exception or a component. It calls sinks and services
from its own threads, holding no lock, and delivers the messages of one inlet one after the other.
Sinks and services may take long and may use the same transport; it keeps receiving meanwhile.
A transport raises only `TransportError`; exceptions of its middleware are converted. It declares
what it can do (`capabilities`), and `require` refuses a channel that needs more.
`robocomp_py.testing.conformance` tests all of this; every transport must pass it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from enum import Flag, IntEnum, auto
from functools import partial
from typing import Any, NamedTuple, Protocol, runtime_checkable

from .. import installed
from ..contract.interface import Pattern, differences
from ..contract.qos import DEFAULT_QOS, History, Liveliness, QoS
from ..contract.types import Struct
from ..errors import ConfigurationError, UnsupportedQoS
from ..spelling import unknown
from ..wire.codec import Codec, Payload

log = logging.getLogger("robocomp.transport")


class Status(IntEnum):
    """How a call ended, on the wire."""

    OK = 0  # payload: the response
    THROWN = 1  # payload: a declared exception
    FAILED = 2  # payload: type, message and traceback of any other exception
    EXPIRED = 3  # not executed: its deadline had passed
    MISMATCH = 4  # payload: the server's contract, as UTF-8 text
    BUSY = 5  # not executed: too many calls wait
    REFUSED = 6  # not executed: this process does not serve the operation


STATUSES = {status.value: status for status in Status}
"""By number; faster than `Status(number)`."""


class Reply(NamedTuple):
    status: Status
    payload: Payload = None


answered: Callable[[tuple[Status, Payload]], Reply] = partial(tuple.__new__, Reply)
"""`Reply(*pair)`, but faster, since it runs at every call: it skips the constructor in Python."""

Sink = Callable[[Payload], object]
"""Takes one message."""


class Heard(NamedTuple):
    """A message of a topic with what its header says: what the sink of a `headed` channel gets.

    A message without our header, from a publisher of another program, has 0 for source, sequence and stamp.
    """

    channel: str
    """That of its publisher, also if the inlet has `*`; that of the inlet if the publisher is not known yet."""
    source: int
    """A random number of the publisher's link; a restarted publisher has another one."""
    sequence: int
    """Counts the messages of the source from 1 without gaps."""
    stamp: int
    """When it was sent, by the clock of the sender's host: nanoseconds since the Unix epoch."""
    payload: Payload


Service = Callable[[Payload, float], "Reply | Future[Reply]"]
"""Answers one request, at once or later; the second argument is when the request expires (`time.monotonic`).

It should not raise. If it or its Future raises, the call ends as FAILED without a payload."""


class Capability(Flag):
    """What a transport can do beyond the four verbs."""

    NONE = 0
    RELIABLE = auto()  # a reliable publication waits instead of being lost
    LATCHED = auto()  # late subscribers get the last `depth` messages
    CROSS_PROCESS = auto()
    CROSS_HOST = auto()
    DEADLINE = auto()
    LIFESPAN = auto()
    LIVELINESS = auto()


ANY_QOS = Capability.RELIABLE | Capability.LATCHED | Capability.DEADLINE | Capability.LIFESPAN | Capability.LIVELINESS


@dataclass(frozen=True, slots=True)
class TypeRef:
    """The type of a channel's messages, as a transport sees it: compared, and shown if two sides differ.

    `text` is the contract behind the fingerprint; two sides that differ show it to each other.
    `request`, and `response` of a query, are for middleware with visible types of its own;
    without them its messages are plain octets.
    """

    name: str
    fingerprint: int = 0
    text: str = ""
    request: Struct | None = field(default=None, compare=False, repr=False)
    response: Struct | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Channel:
    """The path of one operation through a transport. `name`: see `wire.names`; its instance may be `*`.

    `*` is any instance but the transport's own ones: a component does not receive its own publications.
    """

    name: str
    pattern: Pattern
    type: TypeRef
    qos: QoS = DEFAULT_QOS
    idempotent: bool = False
    on_receive: Callable[[str], object] | None = field(default=None, compare=False, repr=False)
    """For an inlet of a topic: called with the name of the channel when a message arrives, before it waits in a
    queue."""
    exclusive: bool = field(default=True, compare=False, repr=False)
    """For a served channel: whether it needs a claim of its own, which also stops a server that starts at the same
    moment. False if another claim of the same component covers it. A channel that is already served is refused in
    either case."""
    signed: bool = field(default=False, compare=False, repr=False)
    """For an inlet or a served channel: whether messages are passed with their senders; see `senders`. A transport that
    does not know them may pass plain payloads."""
    tap: bool = field(default=False, compare=False, repr=False)
    """For a best-effort inlet of a topic: whether it must not hold up its publishers, even if its process is
    stopped; it loses messages instead. A transport whose publishers never wait for best-effort inlets needs to do
    nothing."""
    headed: bool = field(default=False, compare=False, repr=False)
    """For an inlet of a topic: whether its sink gets each message as a `Heard`."""
    lazy: bool = field(default=False, compare=False, repr=False)
    """For a served channel: whether it is rarely called, so that its resources may be created at the first call."""


@dataclass
class Statistics:
    """Counters of a link. They only grow, and are exact while no message is in flight."""

    received: int = 0
    malformed: int = 0  # dropped: not a valid message
    mismatched: int = 0  # dropped or refused: another contract under the same name
    expired: int = 0  # not executed, or not delivered: too late
    repeated: int = 0  # not executed again
    lost: int = 0  # missing from the sequence of a sender
    dropped: int = 0  # discarded here: a queue was full


class Link(Protocol):
    """One end of a channel."""

    @property
    def stats(self) -> Statistics: ...

    def wait_peer(self, timeout: float) -> bool:
        """Wait until the other side is visible, at most `timeout` seconds.

        With many possible peers, one suffices. Raises ContractMismatch if all visible peers have
        another contract, and Closed.
        """
        ...

    def close(self) -> None:
        """Stop. Idempotent. After it returns no sink or service of this link is called again, and
        every waiting call has ended with `Closed`. May be called from a sink."""
        ...


class Outlet(Link, Protocol):
    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        """Send one message, from any thread.

        A publication needs no subscriber. A best-effort one never waits; a reliable one waits for
        slow subscribers at most `deadline` seconds, then raises Timeout. A command without a server
        raises Unreachable. A command is never sent twice.
        """
        ...


class Caller(Link, Protocol):
    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        """Send a request without waiting. The Future ends within `deadline` seconds, with a Reply or
        a TransportError; cancelling it leaves nothing behind."""
        ...

    def ask(self, payload: Payload, deadline: float) -> Reply:
        """Send a request and wait for its reply, at most `deadline` seconds: the fast path, without a Future."""
        ...


class Transport(Protocol):
    @property
    def capabilities(self) -> Capability: ...

    @property
    def codec(self) -> Codec: ...

    def outlet(self, channel: Channel) -> Outlet: ...

    def inlet(self, channel: Channel, sink: Sink) -> Link: ...

    def caller(self, channel: Channel) -> Caller: ...

    def server(self, channel: Channel, service: Service) -> Link: ...

    def close(self) -> None:
        """Close every link, then everything else. Idempotent; no thread or socket of the transport is left."""
        ...


@dataclass(frozen=True)
class TransportConfig:
    """What a transport is opened with.

    `options` is its table of the configuration, `[transports.<name>]`; `owner` is the component
    that opens it, with its namespace: `robot1/world`. It is announced to others, and named in
    messages to people. While the transport or a link must wait for another process before it can
    open, it polls `wanted`; once that returns False, it raises `Closed`.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    owner: str = ""
    wanted: Callable[[], bool] = field(default=lambda: True, compare=False, repr=False)


TransportFactory = Callable[[TransportConfig], Transport]
"""The target of an entry point, usually a class. Its `capabilities` are read before anything is opened. A second entry
point declares what a deployment needs: see `deployment`."""


def find_transport(name: str) -> TransportFactory:
    """The installed transport of that name; raises ConfigurationError, which lists the installed ones."""
    try:
        factory: TransportFactory | None = installed.find(installed.TRANSPORTS, name)
    except ImportError as exc:
        raise ConfigurationError(f"middleware {name!r} is not usable here: {exc}") from exc
    if factory is None:
        raise ConfigurationError(unknown("middleware", name, installed.transports()))
    return factory


# The optional parts of the contract. A link, a transport or a factory offers a part by having its methods; a class of
# ours derives from the part, so that mypy compares the two.


class Source(NamedTuple):
    """A publisher that an inlet hears."""

    channel: str
    qos: QoS


class Loan(Protocol):
    """Memory of a message that is written where it will be read. Every loan ends, by `send` or by `close`."""

    @property
    def data(self) -> memoryview:
        """The bytes, to be written. They begin at a multiple of 8 in memory, and are not zeros."""
        ...

    def send(self, begin: int, end: int, deadline: float = 5.0) -> None:
        """Send `data[begin:end]` as a payload, as `Outlet.send` does, without copying it."""
        ...

    def close(self) -> None:
        """Give the memory back unsent. Idempotent; without effect after `send`."""
        ...


class Question(Protocol):
    """A request that may be sent again if it may not have arrived. One run of a server executes it once.

    Its `ask` and `call` are those of the caller, and may be repeated one after the other. Every question must be
    closed.
    """

    def ask(self, deadline: float) -> Reply: ...

    def call(self, deadline: float) -> Future[Reply]: ...

    def close(self) -> None: ...


@runtime_checkable
class SupportsConnected(Protocol):
    def wait_connected(self, timeout: float) -> bool:
        """Wait until a link of a topic is connected to all visible links of the other side, at most `timeout` seconds.

        Once it has returned True, an inlet receives all that those publishers send from then on, and all that an
        outlet sends from then on reaches those subscribers. Of a publisher and a subscriber, the one that became
        visible later sees the other. So if both have waited here, no later publication is missed. Raises Closed.
        """
        ...


@runtime_checkable
class SupportsSubscribers(Protocol):
    @property
    def has_subscribers(self) -> bool:
        """Whether a message of this outlet may reach a peer, now or later. Must be fast: it is read before each message
        that could go by several transports."""
        ...


@runtime_checkable
class SupportsLoan(Protocol):
    def loan(self, size: int) -> Loan:
        """Memory for a message. Raises what `send` raises, and TransportError if there is no memory of that size."""
        ...


@runtime_checkable
class SupportsSources(Protocol):
    def sources(self) -> list[Source]:
        """The publishers of a topic that are alive now."""
        ...


@runtime_checkable
class SupportsQuestion(Protocol):
    def question(self, payload: Payload) -> Question:
        """A request that keeps its number, however often it is sent."""
        ...


@runtime_checkable
class SupportsGathering(Protocol):
    def gathering(self) -> AbstractContextManager[None]:
        """A context in which opened and closed links need not become visible to peers; at its end, all do at once.

        Leaving it may raise TransportError.
        """
        ...


@runtime_checkable
class SupportsHost(Protocol):
    def host(self, config: TransportConfig) -> AbstractContextManager[None]:
        """A context in which this process runs what the components of this host share (a router, a broker).

        It may be entered at any time, also while another process runs the same. The components of one host must work
        without it; those of several hosts may need it. Of a class, it is a static or class method: no transport is
        made. `config` has the options of the helper, or none. Entering may raise TransportError.
        """
        ...


class OptionalPart(NamedTuple):
    protocol: type
    offered_by: str
    without: str
    """What happens if it is missing."""


OPTIONAL_PARTS = (
    OptionalPart(SupportsConnected, "an outlet or inlet of a topic", "it counts as connected once it is open"),
    OptionalPart(SupportsSubscribers, "an outlet", "each message is sent"),
    OptionalPart(SupportsLoan, "an outlet", "a message is filled in other memory, and copied"),
    OptionalPart(SupportsSources, "an inlet of a topic", "the transport cannot declare LIVELINESS"),
    OptionalPart(SupportsQuestion, "a caller", "a repeated request may be executed twice"),
    OptionalPart(SupportsGathering, "a transport", "each link becomes visible when it is opened"),
    OptionalPart(SupportsHost, "a factory", "components run the shared process themselves"),
)


def wait_connected(link: Link, timeout: float) -> bool:
    """See `SupportsConnected`."""
    return link.wait_connected(timeout) if isinstance(link, SupportsConnected) else True


def gathering(transport: Transport) -> AbstractContextManager[None]:
    """See `SupportsGathering`."""
    return transport.gathering() if isinstance(transport, SupportsGathering) else nullcontext()


def hosting(name: str, config: TransportConfig) -> AbstractContextManager[None]:
    """See `SupportsHost`. Raises ConfigurationError if there is no such transport."""
    factory = find_transport(name)
    return factory.host(config) if isinstance(factory, SupportsHost) else nullcontext()


def require(transport: Transport, name: str, channel: Channel) -> None:
    """Raise UnsupportedQoS if the QoS of the channel needs what the transport does not offer."""
    missing = needs(channel) & ~transport.capabilities
    if missing:
        wanted = ", ".join(str(each.name).lower() for each in missing)
        raise UnsupportedQoS(f"{channel.name}: {name} does not offer {wanted}; ask for less in its `qos`")


def needs(channel: Channel) -> Capability:
    """What the QoS of a channel demands of its transport."""
    qos = channel.qos
    if channel.pattern is not Pattern.PUBLISH:
        return Capability.NONE
    wanted = {
        Capability.RELIABLE: qos.reliable,
        Capability.LATCHED: qos.latched,
        Capability.DEADLINE: qos.deadline is not None,
        Capability.LIFESPAN: qos.lifespan is not None,
        Capability.LIVELINESS: qos.lease is not None or qos.liveliness is not Liveliness.AUTOMATIC,
    }
    result = Capability.NONE
    for capability, asked in wanted.items():
        result |= capability if asked else Capability.NONE
    return result


KEEP_ALL_DEPTH = 10_000
"""Queue length under KEEP_ALL: memory is bounded."""


def depth_of(qos: QoS) -> int:
    """Maximum number of waiting messages."""
    return KEEP_ALL_DEPTH if qos.history is History.KEEP_ALL else qos.depth


def options_of(config: TransportConfig, **defaults: Any) -> dict[str, Any]:
    """The options with defaults filled in; raises ConfigurationError for one that is not known."""
    unknown = sorted(set(config.options) - set(defaults))
    if unknown:
        raise ConfigurationError(f"unknown transport option {unknown[0]!r}; known: {', '.join(defaults) or 'none'}")
    return defaults | dict(config.options)


def reply_of(service: Service, payload: Payload, expires: float) -> Reply | Future[Reply]:
    """Run a service; FAILED if it raises."""
    try:
        return service(payload, expires)
    except KeyboardInterrupt:
        raise  # meant for the main thread, which runs the service itself in `inproc`
    except BaseException:  # also SystemExit, which would only end a thread of the transport
        log.exception("a service raised")
        return Reply(Status.FAILED)


def pass_on(reply: Future[Reply], answer: Callable[[Reply], object]) -> None:
    """Pass on the reply of a Future once it is done; FAILED if the Future failed or was cancelled."""

    def finished(done: Future[Reply]) -> None:
        error = None if done.cancelled() else done.exception()
        if error:
            log.error("a service failed", exc_info=error)
        answer(Reply(Status.FAILED) if error or done.cancelled() else done.result())

    reply.add_done_callback(finished)


LONGEST_CONTRACT = 64 * 1024
"""Maximum characters of a contract. Longer ones are not compared: the other side may be hostile."""

_MOST_DIFFERENCES = 2000
"""Maximum characters of a list of differences."""


def mismatch(channel: Channel, other: TypeRef) -> str:
    """Both fingerprints and what differs, for a log or an error."""
    mine = channel.type
    if not other.text:
        what = "the other side does not send its contract"
    elif len(other.text) > LONGEST_CONTRACT:
        what = f"the other side describes it in more than {LONGEST_CONTRACT} characters"
    else:
        what = "; ".join(differences(mine.text, other.text))[:_MOST_DIFFERENCES]
        what = "".join(char if char.isprintable() else " " for char in what)
    return (
        f"{channel.name}: the other side was generated from another definition "
        f"({mine.fingerprint:016x} here, {other.fingerprint:016x} there): {what}"
    )


# A sink or service may make a blocking call, or take long, on a thread of the transport. It announces this by
# `about_to_block`, and another thread of the transport receives meanwhile.


class _Receiving(threading.local):
    hand_over: Callable[[], None] | None = None  # on the class: a failed attribute lookup takes a microsecond


_receiving = _Receiving()


def about_to_block() -> None:
    """Announce that this thread is about to wait, or to take long. Costs nothing on a thread that does not receive."""
    hand_over = _receiving.hand_over
    if hand_over:
        hand_over()


def receives(hand_over: Callable[[], None] | None) -> None:
    """For transports: on this thread, `about_to_block` means `hand_over`."""
    _receiving.hand_over = hand_over
