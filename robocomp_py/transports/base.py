"""The contract of a transport: payloads in, payloads out, on named channels.

Three patterns, two function types, four verbs:

    publish  1:n    Sink     outlet -> inlet
    command  n:1    Sink     outlet -> inlet
    query    n:1    Service  caller -> server

A transport never sees a type, a declared exception or a component. It calls sinks and services
from its own threads, holding no lock, the messages of one inlet one after the other; they may
take long, and may use this transport themselves, and the transport keeps receiving meanwhile.
Foreign exceptions stop at its border: what it raises is a `TransportError`. What it cannot do it
declares (`capabilities`), and `require` refuses it by name. `robocomp_py.testing.conformance`
holds all of this as tests; a transport is what passes them.
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
    THROWN = 1  # payload: an exception the operation declares
    FAILED = 2  # payload: type, message and traceback of one it does not
    EXPIRED = 3  # its deadline was over before it was executed
    MISMATCH = 4  # payload: the server's contract, as UTF-8 text
    BUSY = 5  # not executed: too many calls wait there
    REFUSED = 6  # not executed: not served there


STATUSES = {status.value: status for status in Status}
"""By number; quicker than asking the enumeration."""


class Reply(NamedTuple):
    status: Status
    payload: Payload = None


answered: Callable[[tuple[Status, Payload]], Reply] = partial(tuple.__new__, Reply)
"""`Reply(…)` of a pair, without the detour through a constructor in Python: for what happens at every call."""

Sink = Callable[[Payload], object]
"""Takes one message."""

Service = Callable[[Payload, float], "Reply | Future[Reply]"]
"""Answers one request, at once or later; the second argument is when it expires (`time.monotonic`).

It should not raise; if it does, or its Future does, the call ends as FAILED without a payload."""


class Capability(Flag):
    """What a transport can do beyond the four verbs."""

    NONE = 0
    RELIABLE = auto()  # a reliable publication waits rather than lose
    LATCHED = auto()  # late subscribers get the last `depth` messages
    CROSS_PROCESS = auto()
    CROSS_HOST = auto()
    DEADLINE = auto()
    LIFESPAN = auto()
    LIVELINESS = auto()


ANY_QOS = Capability.RELIABLE | Capability.LATCHED | Capability.DEADLINE | Capability.LIFESPAN | Capability.LIVELINESS


@dataclass(frozen=True, slots=True)
class TypeRef:
    """The type of a channel's messages, as transports know it: compared, and shown where it differs.

    `text` is what the fingerprint stands for; two sides that differ show it to each other.
    `request`, and `response` of a query, are for middleware that has types of its own and shows
    them to others; without them its messages are octets there.
    """

    name: str
    fingerprint: int = 0
    text: str = ""
    request: Struct | None = field(default=None, compare=False, repr=False)
    response: Struct | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Channel:
    """One operation on its way. `name`: see `wire.names`; its instance may be `*`.

    `*` is any instance but the transport's own ones: who filters what it hears hears not itself.
    """

    name: str
    pattern: Pattern
    type: TypeRef
    qos: QoS = DEFAULT_QOS
    idempotent: bool = False
    on_receive: Callable[[str], object] | None = field(default=None, compare=False, repr=False)
    """Of an inlet of a topic: called with its channel for each message when it comes in, not when its turn has come."""
    exclusive: bool = field(default=True, compare=False, repr=False)
    """Of what is served: whether a claim of its own keeps others from it, also at the same moment. Else another one is
    opened by the same component that stands for it, too; and who is announced already is refused all the same."""
    lazy: bool = field(default=False, compare=False, repr=False)
    """Of what is served: whether hardly anybody asks for it, so that what it takes may be made when somebody does."""


@dataclass
class Statistics:
    """What a link met with. Counters only grow; they are exact when the link is quiet."""

    received: int = 0
    malformed: int = 0  # dropped: not a message of ours
    mismatched: int = 0  # dropped or refused: another contract under the same name
    expired: int = 0  # not executed, or not delivered: too late
    repeated: int = 0  # not executed again
    lost: int = 0  # messages of a sender we heard before and after, but not these
    dropped: int = 0  # given up by us: a queue was full


class Link(Protocol):
    """One end of a channel."""

    @property
    def stats(self) -> Statistics: ...

    def wait_peer(self, timeout: float) -> bool:
        """Wait until the other side is visible, at most `timeout` seconds.

        With many possible peers, one suffices. Raises ContractMismatch if all who are there mean
        something else, and Closed.
        """
        ...

    def close(self) -> None:
        """Stop. Idempotent. After it returns no sink or service of this link is called again, and
        whoever waited for an answer got `Closed`. May be called from a sink."""
        ...


class Outlet(Link, Protocol):
    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        """Send one message, from any thread.

        A publication to nobody is fine; a best-effort one never waits, a reliable one waits for
        slow readers at most `deadline` seconds, then raises Timeout. A command raises Unreachable
        if nobody serves it, and is never sent twice.
        """
        ...


class Caller(Link, Protocol):
    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        """Ask, and go on. The Future ends within `deadline` seconds, by a Reply or a
        TransportError; cancelling it leaves nothing behind."""
        ...

    def ask(self, payload: Payload, deadline: float) -> Reply:
        """Ask, and wait at most `deadline` seconds: the fast path, no Future involved."""
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
        """Close every link, then everything else. Idempotent; no thread or socket of ours is left."""
        ...


@dataclass(frozen=True)
class TransportConfig:
    """What a transport is opened with.

    `options` is its table of the configuration, `[transports.<name>]`; `owner` is who opens it,
    for messages to people. `wanted` is asked again and again while it, or a link of it, cannot be
    opened before somebody else is there: once it says no, waiting ends with `Closed`.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    owner: str = ""
    wanted: Callable[[], bool] = field(default=lambda: True, compare=False, repr=False)


TransportFactory = Callable[[TransportConfig], Transport]
"""What an entry point names, a class as a rule. Its `capabilities` are read before anything is opened. What else a
deployment has to know is declared beside it: see `deployment`."""


def find_transport(name: str) -> TransportFactory:
    """The installed transport of that name; raises ConfigurationError, naming those there are."""
    with installed.asked_once():
        known = installed.transports()
        if name not in known:
            raise ConfigurationError(unknown("middleware", name, known))
        try:
            factory: TransportFactory = installed.transport(name)
        except ImportError as exc:
            raise ConfigurationError(f"middleware {name!r} is not usable here: {exc}") from exc
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
    """A request that may be sent again if it is not known whether it arrived, and is executed once by a server's life.

    Its `ask` or its `call` do what those of the caller do, again and again, one after the other. Every question ends,
    by `close`.
    """

    def ask(self, deadline: float) -> Reply: ...

    def call(self, deadline: float) -> Future[Reply]: ...

    def close(self) -> None: ...


@runtime_checkable
class SupportsConnected(Protocol):
    def wait_connected(self, timeout: float) -> bool:
        """Wait until an end of a topic is connected to all visible ends of the other side, at most `timeout` seconds.

        Once it has returned True, an inlet hears what those publishers send from then on, and what an outlet sends
        from then on reaches those subscribers. Of a publisher and a subscriber, the one that became visible later sees
        the other. So if both have waited here, nothing that is published afterwards is missed. Raises Closed.
        """
        ...


@runtime_checkable
class SupportsHeard(Protocol):
    @property
    def heard(self) -> bool:
        """Whether a message of this outlet may be of use to a peer, now or later. Answers at once: it is asked before
        each message that could go by several transports."""
        ...


@runtime_checkable
class SupportsLoan(Protocol):
    def loan(self, size: int) -> Loan:
        """Memory for a message. Raises what `send` raises, and TransportError if there is no memory of that size."""
        ...


@runtime_checkable
class SupportsSources(Protocol):
    def sources(self) -> list[Source]:
        """The publishers of a topic that are there and alive at this moment."""
        ...


@runtime_checkable
class SupportsQuestion(Protocol):
    def question(self, payload: Payload) -> Question:
        """A request under one number, however often it is sent."""
        ...


@runtime_checkable
class SupportsGathering(Protocol):
    def gathering(self) -> AbstractContextManager[None]:
        """While it is entered, opened and closed links need not become visible to peers; at its end, all do at once.

        Leaving it may raise TransportError.
        """
        ...


@runtime_checkable
class SupportsHost(Protocol):
    def host(self, config: TransportConfig) -> AbstractContextManager[None]:
        """While it is entered, what the components of this host share (a router, a broker) runs here.

        It may be entered before, beside and after components, and while another process runs the same; components must
        do without it. Entering may raise TransportError.
        """
        ...


class OptionalPart(NamedTuple):
    protocol: type
    offered_by: str
    without: str
    """What happens if it is missing."""


OPTIONAL_PARTS = (
    OptionalPart(SupportsConnected, "an outlet or inlet of a topic", "it counts as connected once it is open"),
    OptionalPart(SupportsHeard, "an outlet", "each message is sent"),
    OptionalPart(SupportsLoan, "an outlet", "a message is filled elsewhere, and copied"),
    OptionalPart(SupportsSources, "an inlet of a topic", "the transport cannot declare LIVELINESS"),
    OptionalPart(SupportsQuestion, "a caller", "a repeated request may be executed twice"),
    OptionalPart(SupportsGathering, "a transport", "each link becomes visible when it is opened"),
    OptionalPart(SupportsHost, "a factory", "components run what they share themselves"),
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
    """Raise UnsupportedQoS if the channel asks for what the transport does not offer."""
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
"""All messages are as many as this: memory is bounded."""


def depth_of(qos: QoS) -> int:
    """How many messages may wait."""
    return KEEP_ALL_DEPTH if qos.history is History.KEEP_ALL else qos.depth


def options_of(config: TransportConfig, **defaults: Any) -> dict[str, Any]:
    """The options with defaults filled in; raises ConfigurationError for one that is not known."""
    unknown = sorted(set(config.options) - set(defaults))
    if unknown:
        raise ConfigurationError(f"unknown transport option {unknown[0]!r}; known: {', '.join(defaults) or 'none'}")
    return defaults | dict(config.options)


def reply_of(service: Service, payload: Payload, expires: float) -> Reply | Future[Reply]:
    """Run a service; what it returns, whatever it does."""
    try:
        return service(payload, expires)
    except KeyboardInterrupt:
        raise  # meant for the main thread, which may be the one that asks: of `inproc`
    except BaseException:  # also SystemExit, which would end a thread of the transport, and nothing else
        log.exception("a service raised")
        return Reply(Status.FAILED)


def pass_on(reply: Future[Reply], answer: Callable[[Reply], object]) -> None:
    """Pass a reply on that a service has promised, when there is one, whatever becomes of it."""

    def finished(done: Future[Reply]) -> None:
        error = None if done.cancelled() else done.exception()
        if error:
            log.error("a service failed", exc_info=error)
        answer(Reply(Status.FAILED) if error or done.cancelled() else done.result())

    reply.add_done_callback(finished)


LONGEST_CONTRACT = 64 * 1024
"""Characters of a contract. Longer ones are not compared: the other side may be hostile."""

_MOST_DIFFERENCES = 2000
"""Characters of what is said to differ."""


def mismatch(channel: Channel, other: TypeRef) -> str:
    """Both fingerprints and what differs, for a log or an error."""
    mine = channel.type
    if not other.text:
        what = "the other side does not say what"
    elif len(other.text) > LONGEST_CONTRACT:
        what = f"the other side describes it in more than {LONGEST_CONTRACT} characters"
    else:
        what = "; ".join(differences(mine.text, other.text))[:_MOST_DIFFERENCES]
        what = "".join(char if char.isprintable() else " " for char in what)
    return (
        f"{channel.name}: the other side was generated from another definition "
        f"({mine.fingerprint:016x} here, {other.fingerprint:016x} there): {what}"
    )


# A thread of a transport that runs a sink or service may be about to wait for an answer in it.
# It can say so, and the transport lets another of its threads receive meanwhile.


class _Receiving(threading.local):
    hand_over: Callable[[], None] | None = None  # of the class, since to look for what is not there takes a microsecond


_receiving = _Receiving()


def about_to_block() -> None:
    """Say that this thread is about to wait. Costs nothing on a thread that does not receive."""
    hand_over = _receiving.hand_over
    if hand_over:
        hand_over()


def receives(hand_over: Callable[[], None] | None) -> None:
    """For transports: on this thread, `about_to_block` means `hand_over`."""
    _receiving.hand_over = hand_over
