"""Transport `zenoh`: every component is a client of one router (see `zenoh_session`).

    rc/<domain>/<channel>                 messages: payload in CDR, our header as the attachment
    rc_lv/<domain>/…/<link>/<channel>     a liveliness token for each link: who is there (`Token`)
    rc_ack/<domain>/<transport>/<number>  to a link: "this message of yours was taken"
    rc_ask/<domain>/<transport>/<number>  of a link: `/text`, its contract; `/history`, its latched messages

A link's id, which is also the client or source of its headers, is 40 bits of its transport and 24
of its own number, so whoever has got a message from it knows where to acknowledge and to ask.

Zenoh drops messages, or closes the connection, where a reader is slow. What must not be lost
(reliable publications, commands) is therefore sent only to readers that have room for it: they
acknowledge what they took, and a sender is at most so many messages ahead (`Credit`).

Threads. Callbacks run on Zenoh's own threads, and one that is slow delays everybody. So they only
queue what came in, and a `Crew` does the rest. They must not log either: `logging` would have
`threading` take them for ours.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import logging
import os
import queue
import secrets
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import zenoh

from ..contract.interface import Pattern
from ..contract.qos import History
from ..errors import Closed, ConfigurationError, ContractMismatch, DecodeError, Timeout, TransportError, Unreachable
from ..wire.cdr import Cdr
from ..wire.codec import Codec, Payload
from ..wire.header import (
    NO_DEADLINE,
    Flag,
    Publication,
    Request,
    pack_publication,
    pack_reply,
    pack_request,
    random_id,
    read_publication,
    read_reply,
    read_request,
)
from ..wire.names import ANY
from .base import (
    Capability,
    Channel,
    Reply,
    Service,
    Sink,
    Statistics,
    Status,
    TransportConfig,
    TypeRef,
    mismatch,
    options_of,
    serve,
)
from .credit import Credit
from .crew import Crew, Gate, Job, Lane, abandoned
from .directory import runtime_dir
from .exclusive import Claim, claim
from .ledger import Ledger
from .pending import Pending
from .zenoh_session import Network, as_transport_error
from .zenoh_table import Table, Token

log = logging.getLogger("robocomp.transport.zenoh")

TICK = 0.1
"""Seconds between two looks at what is overdue, and whether the router needs a new home."""

INQUIRY = 2.0
"""Seconds for which a link is asked for its contract or its history."""

SETTLED = 1.0
"""Seconds for which a server that is leaving may still be seen when the next one begins."""

KEEP_ALL_DEPTH = 10_000
COMMANDS_AHEAD = 64
"""Commands that one sender may have on their way."""

COMMANDS_WAITING = 1000
QUERIES_WAITING = 1000
"""Requests that may wait at one server, or be under way there; more are turned away."""

STRANGERS = 100
"""So many that mean something else by a channel's name are told about; the others are ignored."""

INBOX = 10_000
"""Messages that may wait for the crew at one inlet; more are dropped."""

L = TypeVar("L", bound="_Link")
_ACK = struct.Struct("<QQ")  # who took it · sequence


class ZenohTransport:
    """Options: `connect`, the endpoint of a router to use instead of one on this host; `domain`, a number:
    those of different domains do not meet."""

    def __init__(self, config: TransportConfig) -> None:
        options = options_of(config, connect="", domain=0)
        connect, self.domain = options["connect"], options["domain"]
        if not isinstance(connect, str) or not isinstance(self.domain, int) or self.domain < 0:
            raise ConfigurationError("options of zenoh: `connect` is an endpoint, `domain` a number from 0")
        self.codec: Codec = Cdr()
        self.capabilities = Capability.RELIABLE | Capability.LATCHED | Capability.CROSS_PROCESS
        if connect and not connect.startswith("unix"):
            self.capabilities |= Capability.CROSS_HOST
        self.owner, self.incarnation = config.owner, random_id()
        self.closed = False
        self.table = Table()
        self._id, self._numbers = secrets.randbits(40), itertools.count(1)
        self._links: dict[int, _Link] = {}
        self._lock = threading.RLock()
        self._work: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._looking = False
        self._next_tick = 0.0
        self._inquiries, self._giving_up = _Inbox(QUERIES_WAITING), _Cancellation()
        self.claims = _claims(connect, self.domain)
        self._network = Network(connect, config.owner)
        self.session = self._network.session
        try:
            with as_transport_error("joining"):
                self._join()
        except BaseException:
            self._network.close()
            raise
        self._crew = Crew("zenoh", self._receive, wake=lambda: self._work.put(_nothing))
        self._crew.start()

    def outlet(self, channel: Channel) -> _Publisher | _CommandOutlet:
        kind = _Publisher if channel.pattern is Pattern.PUBLISH else _CommandOutlet
        return self._open(kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> _Subscriber | _CommandInlet:
        kind = _Subscriber if channel.pattern is Pattern.PUBLISH else _CommandInlet
        return self._open(kind(self, channel, sink))

    def caller(self, channel: Channel) -> _Caller:
        return self._open(_Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> _Server:
        return self._open(_Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        for link in reversed(list(self._links.values())):
            link.close()
        self._giving_up.cancel()
        self._crew.close()
        self._network.close()

    # What links use.

    def do(self, job: Job) -> None:
        """Have a thread of ours run this."""
        self._work.put(job)

    def new_id(self) -> int:
        return self._id << 24 | next(self._numbers)

    def owns(self, link: int) -> bool:
        """Whether a link of that number is one of ours."""
        return link >> 24 == self._id

    def key(self, kind: str, *parts: object) -> str:
        return "/".join(map(str, (kind, self.domain, *parts)))

    def inquire(self, link: int, what: str) -> list[_Message]:
        """What another link answers; nothing, if it has gone or is too busy."""
        key = self.key("rc_ask", *_halves(link), what)
        with contextlib.suppress(zenoh.ZError):
            replies = self.session.get(
                key, timeout=INQUIRY, cancellation_token=self._giving_up, consolidation=_NO_CONSOLIDATION
            )
            return [_Message(reply.ok.attachment, reply.ok.payload) for reply in replies if reply.ok]
        return []

    def acknowledge(self, taken: dict[int, int], by: int) -> None:
        """Tell senders that their messages up to a number were taken."""
        for sender, sequence in taken.items():
            with contextlib.suppress(zenoh.ZError):  # closed meanwhile: nobody waits for it
                key = self.key("rc_ack", *_halves(sender))
                self.session.put(key, _ACK.pack(by, sequence), congestion_control=_BLOCK, express=True)

    def left(self, link: _Link) -> None:
        with self._lock:
            self._links.pop(link.id, None)

    # Callbacks: on threads of Zenoh.

    def _on_token(self, sample: zenoh.Sample) -> None:
        if self.table.hear(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT) and not self._looking:
            self._looking = True
            self._work.put(self._look)

    def _on_ack(self, sample: zenoh.Sample) -> None:
        link, data = self._meant(str(sample.key_expr).split("/")[-1]), sample.payload.to_bytes()
        if link and len(data) == _ACK.size:
            link.acknowledged(*_ACK.unpack(data))

    def _on_inquiry(self, query: zenoh.Query) -> None:
        if self._inquiries.put(query):
            self._work.put(self._answer)

    # On threads of ours.

    def _join(self) -> None:
        session, mine = self.session, f"{self._id:010x}"
        session.declare_subscriber(self.key("rc_ack", mine, "*"), _direct(self._on_ack))
        session.declare_queryable(self.key("rc_ask", mine, "*", "*"), _direct(self._on_inquiry), complete=True)
        everybody = self.key("rc_lv", "**")
        session.liveliness().declare_subscriber(everybody, _direct(self._on_token), history=True)
        for _ in session.liveliness().get(everybody, timeout=INQUIRY):
            pass  # what is told to the subscriber comes first: once this has ended, we know who is there

    def _receive(self) -> Iterable[Job]:
        wait = self._next_tick - time.monotonic()
        if wait <= 0:
            self._next_tick = time.monotonic() + TICK
            self._tick()
            wait = TICK
        try:
            return (self._work.get(timeout=wait),)
        except queue.Empty:
            return ()

    def _tick(self) -> None:
        """On the thread that receives for everybody: nothing may stop it."""
        try:
            if abandoned():
                log.warning("%s: not closed at the end of the program; closing", self.owner or "zenoh")
                self.close()
                return
            self._network.tick()
        except Exception:
            log.exception("housekeeping")
        for link in list(self._links.values()):
            link.tick()

    def _look(self) -> None:
        self._looking = False
        for link in list(self._links.values()):
            try:
                link.look()
            except Exception:
                log.exception("%s: looking who is there", link.channel.name)

    def _answer(self) -> None:
        query = self._inquiries.get()
        *_, number, what = str(query.key_expr).split("/")
        link = self._meant(number)
        with contextlib.suppress(zenoh.ZError), contextlib.closing(_Query(query)) as asked:
            for header, payload in link.answer(what) if link else ():
                asked.reply(header, payload)

    def _meant(self, number: str) -> _Link | None:
        try:
            return self._links.get(self._id << 24 | int(number, 16))
        except ValueError:
            return None

    def _open(self, link: L) -> L:
        if self.closed:
            raise Closed("the transport is closed")
        with self._lock:
            self._links[link.id] = link
        try:
            with as_transport_error(f"{link.channel.name}: opening"):
                link.open()
                link.announce()
            if self.closed:
                raise Closed("the transport is closed")
            link.look()
        except BaseException:
            link.close()
            raise
        return link


def _nothing() -> None: ...


def _claims(connect: str, domain: int) -> Path:
    """The folder for claims of those who can meet."""
    where = hashlib.sha256(connect.encode()).hexdigest()[:8] if connect else "here"
    return runtime_dir() / "zenoh" / f"served-{domain}-{where}"


_BLOCK, _DROP = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
_NO_CONSOLIDATION = zenoh.ConsolidationMode.NONE
_Cancellation: Any = zenoh.CancellationToken  # its stub lacks types


def _direct(callback: Callable[[Any], None], drop: Callable[[], None] | None = None) -> Any:
    """A callback that Zenoh calls itself, without a thread of Python's for each."""
    return zenoh.handlers.Callback(callback, drop, indirect=False)


def _halves(link: int) -> tuple[str, str]:
    return f"{link >> 24:010x}", f"{link & 0xFFFFFF:06x}"


class _Message(NamedTuple):
    header: Any
    payload: Any
    arrived: float = 0.0


class _Inbox:
    """What callbacks leave for the crew, bounded."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: deque[Any] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, item: Any) -> bool:
        """Whether there was room."""
        if len(self._waiting) >= self._capacity:
            return False
        self._waiting.append(item)
        return True

    def put_back(self, items: list[Any]) -> None:
        """Let these come first."""
        self._waiting.extendleft(reversed(items))

    def get(self) -> Any:
        return self._waiting.popleft()


class _Query:
    """A question of Zenoh's, answered at most until it is closed."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query

    def reply(self, header: bytes, payload: Payload) -> None:
        self._query.reply(self._query.key_expr, payload or b"", attachment=header)

    def close(self) -> None:
        """Tell who asked that nothing more will come."""
        self._query.drop()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


# -- links --------------------------------------------------------------------


class _Link:
    """One end of a channel: announced by a token, and looking in the table for those it faces."""

    role: str
    facing: str
    traits = "-"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.id = transport.new_id()
        self.key = transport.key("rc", channel.name)
        self.stats = Statistics()
        self.closed = threading.Event()
        self._closing = threading.Lock()
        self._token: zenoh.LivelinessToken | None = None
        self._claim: Claim | None = None
        self._declared: list[Any] = []
        self._reported: set[int] = set()
        self._texts: dict[int, str] = {}

    def open(self) -> None:
        """Become ready; others see this link only afterwards."""

    def tick(self) -> None:
        """Do what is due."""

    def look(self) -> None:
        """Links came or went."""
        self.counterparts()

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        """What this link tells others who ask for it."""
        return [(b"", self.channel.type.text.encode())] if what == "text" else []

    def acknowledged(self, by: int, sequence: int) -> None:
        """On a thread of Zenoh: a message of ours was taken."""

    def wait_peer(self, timeout: float) -> bool:
        end, changed = time.monotonic() + timeout, self.transport.table.changed
        while True:
            self.check_open()
            if self.visible():
                return True
            left = end - time.monotonic()
            if left <= 0:
                return False
            with changed:
                changed.wait(min(left, 0.02))  # what else we wait for does not tell

    def visible(self) -> bool:
        """Whether the other side is there. Raises ContractMismatch if only others are."""
        return bool(self.counterparts(strict=True))

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        self.transport.left(self)
        for declared in (self._token, *self._declared):
            with contextlib.suppress(zenoh.ZError):  # the session may have been closed under us
                if declared:
                    declared.undeclare()
        self.release()

    def release(self) -> None:
        """Let go of what this link holds; called once, when it is closed."""

    def declare(self, declared: Any) -> Any:
        """Undeclare this at the end."""
        self._declared.append(declared)
        return declared

    def announce(self) -> None:
        token = Token(self.role, self.traits, self.channel.type.fingerprint, os.getpid(), self.id, self.channel.name)
        self._token = self.transport.session.liveliness().declare_token(self.transport.key("rc_lv", token.key()))

    def counterparts(self, *, strict: bool = False) -> list[Token]:
        """Those we face who mean the same by the name; the others are reported, once each.

        With `strict`, raises ContractMismatch if there are only others.
        """
        named = [
            token
            for token in self.transport.table.find(self.facing, self.channel.name)
            if token.channel == self.channel.name or not self.transport.owns(token.link)
        ]
        same = [token for token in named if token.fingerprint == self.channel.type.fingerprint]
        if len(same) == len(named):
            return same
        others = [token for token in named if token.fingerprint != self.channel.type.fingerprint]
        for token in others:
            self.report_mismatch(token.link, token.fingerprint)
        if strict and not same:
            raise ContractMismatch(mismatch(self.channel, self._type_of(others[0].link, others[0].fingerprint)))
        return same

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: the link is closed")

    def report_mismatch(self, link: int, fingerprint: int) -> None:
        """Count and log, once, that another link means something else. May wait for its answer."""
        with self._closing:
            if link in self._reported or len(self._reported) >= STRANGERS:
                return
            self._reported.add(link)
        log.error("%s", mismatch(self.channel, self._type_of(link, fingerprint)))
        self.stats.mismatched += 1

    def meet_stranger(self, link: int, fingerprint: int) -> None:
        """The same, without waiting."""
        if link not in self._reported and len(self._reported) < STRANGERS:
            self.transport.do(partial(self.report_mismatch, link, fingerprint))

    def malformed(self, why: object) -> None:
        """Count a message that is none of ours; the first one is logged."""
        self.stats.malformed += 1
        if self.stats.malformed == 1:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)

    def _type_of(self, link: int, fingerprint: int) -> TypeRef:
        """What another link means by the name, in its own words."""
        if not self._texts.get(link):
            answers = self.transport.inquire(link, "text")
            self._texts[link] = answers[0].payload.to_bytes().decode(errors="replace") if answers else ""
        return TypeRef("", fingerprint, self._texts[link])


# -- topics -------------------------------------------------------------------


class _Publisher(_Link):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        lossless = qos.reliable or qos.history is History.KEEP_ALL
        self.traits = "".join(("r" * lossless, "l" * qos.latched)) or "-"
        self._lossless = lossless
        self._readers: tuple[int, set[int]] = -1, set()
        self._credit = Credit(_depth(channel), self._reliable_readers)
        self._history: deque[tuple[bytes, Payload]] = deque(maxlen=qos.depth if qos.latched else 0)
        self._order = threading.Lock()

    def open(self) -> None:
        congestion = _BLOCK if self._lossless else _DROP
        publisher = self.transport.session.declare_publisher(
            self.key, congestion_control=congestion, reliability=zenoh.Reliability.RELIABLE
        )
        self._publisher: zenoh.Publisher = self.declare(publisher)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        with _within(self._order, self._too_slow(deadline), end):
            self.check_open()
            if not self._credit.wait(end, self.check_open):
                raise self._too_slow(deadline)
            fingerprint = self.channel.type.fingerprint
            header = pack_publication(fingerprint, self.id, self._credit.sent, time.time_ns())
            if self._history.maxlen:
                self._history.append((header, payload))  # first: who asks for it now may not hear the other one
            with as_transport_error(self.channel.name):
                self._publisher.put(payload, attachment=header)

    def visible(self) -> bool:
        status: Any = self._publisher.matching_status  # its stub says bool, which it is not
        return bool(self.counterparts(strict=True)) and bool(status.matching)

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        return list(self._history) if what == "history" else super().answer(what)

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _reliable_readers(self) -> set[int]:
        if not self._lossless:
            return set()
        version = self.transport.table.version
        if self._readers[0] != version:
            self._readers = version, {token.link for token in self._same() if "r" in token.traits}
        return self._readers[1]

    def _same(self) -> Iterator[Token]:
        fingerprint = self.channel.type.fingerprint
        found = self.transport.table.find(self.facing, self.channel.name)
        return (token for token in found if token.fingerprint == fingerprint)

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")


@contextlib.contextmanager
def _within(lock: threading.Lock, late: Timeout, end: float) -> Iterator[None]:
    """Hold a lock; raises `late` if that cannot be had until `end`."""
    if not lock.acquire(timeout=max(0.0, end - time.monotonic())):
        raise late
    try:
        yield
    finally:
        lock.release()


def _depth(channel: Channel) -> int:
    return KEEP_ALL_DEPTH if channel.qos.history is History.KEEP_ALL else channel.qos.depth


class _Receiving(_Link):
    """An inlet: messages go from the inbox into the lane as it has room, and are acknowledged then."""

    lane: Lane
    _ledger: Ledger

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._inbox = _Inbox(INBOX)
        self._taking = threading.Lock()
        self._scheduled = False

    def open(self) -> None:
        from_whom = zenoh.Locality.REMOTE if ANY in self.channel.name else zenoh.Locality.ANY
        subscribe = self.transport.session.declare_subscriber
        self.declare(subscribe(self.key, _direct(self._hear), allowed_origin=from_whom))

    def take(self, message: _Message) -> tuple[int, int] | None:
        """Put a message into the lane, which is not full; its sender and number, once it need not come again."""
        raise NotImplementedError

    def release(self) -> None:
        self.lane.close()

    def _hear(self, sample: zenoh.Sample) -> None:
        if not self._inbox.put(_Message(sample.attachment, sample.payload, time.monotonic())):
            self.stats.dropped += 1
        self.schedule()

    def schedule(self) -> None:
        if not self._scheduled:
            self._scheduled = True
            self.transport.do(self._work)

    def _work(self) -> None:
        self._scheduled = False
        taken: dict[int, int] = {}
        with self._taking:
            while len(self._inbox) and not self.lane.full:
                done = self._take(self._inbox.get())
                if done:
                    taken[done[0]] = done[1]
        self.transport.acknowledge(taken, self.id)
        self.lane.drain()
        if len(self._inbox) and not self.lane.full:
            self.schedule()

    def _take(self, message: _Message) -> tuple[int, int] | None:
        try:
            return self.take(message)
        except DecodeError as exc:
            self.malformed(exc)
            return None


def _bytes(attachment: Any) -> bytes:
    return attachment.to_bytes() if attachment is not None else b""


class _Subscriber(_Receiving):
    role, facing = "subscribes", "publishes"

    def __init__(self, transport: ZenohTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self._lossless = qos.reliable or qos.history is History.KEEP_ALL
        self.traits = "".join(("r" * self._lossless, "l" * qos.latched)) or "-"
        self._ledger = Ledger(self.stats, ordered=True)
        self.lane = Lane(
            channel.name, lambda p: sink(p.to_bytes()), _depth(channel), lossy=not self._lossless, stats=self.stats
        )
        self._catching_up: dict[int, list[_Message]] = {}
        self._caught_up: set[int] = set()
        self._heard: dict[int, int] = {}

    def look(self) -> None:
        there = {token.link for token in self.counterparts()}
        if self.channel.qos.latched:
            with self._taking:
                self._caught_up &= there
                for source in there:
                    self._catch_up(source)

    def take(self, message: _Message) -> tuple[int, int] | None:
        header = read_publication(_bytes(message.header))
        if header.fingerprint != self.channel.type.fingerprint:
            self.meet_stranger(header.source, header.fingerprint)
            return None
        if self.channel.qos.latched and not self._is_next(header, message):
            return None
        if self._ledger.admit(header.source, header.sequence):
            self.lane.put(message.payload)
        return (header.source, header.sequence) if self._lossless else None

    def _is_next(self, header: Publication, message: _Message) -> bool:
        """Whether all that precedes a latched message was heard, and itself was not."""
        source = header.source
        if source not in self._caught_up:
            self._catch_up(source)
            self._catching_up[source].append(message)
            return False
        new = header.sequence > self._heard.get(source, 0)
        if new:
            self._heard[source] = header.sequence
        return new

    def _catch_up(self, source: int) -> None:
        """Have a publisher's history fetched; what else comes from it has to wait until it is there."""
        if source not in self._caught_up and source not in self._catching_up:
            self._catching_up[source] = []
            self.transport.do(partial(self._fetch, source))

    def _fetch(self, source: int) -> None:
        missed = self.transport.inquire(source, "history")
        with self._taking:
            self._caught_up.add(source)
            self._inbox.put_back([*missed, *self._catching_up.pop(source, ())])
        self.schedule()


# -- commands and queries, the asking side ------------------------------------


class _Asking(_Link):
    """A link that finds the one that serves its channel."""

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._found: tuple[int, Token, zenoh.KeyExpr] | None = None

    def server(self) -> tuple[Token, zenoh.KeyExpr]:
        """Who serves this channel, and the key to reach it. Raises Unreachable."""
        found, version = self._found, self.transport.table.version
        if found is None or found[0] != version:
            serving = self.counterparts(strict=True)
            if not serving:
                raise Unreachable(f"{self.channel.name}: nobody serves it")
            before = [token for token in serving if found and token.channel == found[1].channel]
            token = (before or serving)[-1]  # the one that came last: the other may be leaving
            found = self._found = version, token, zenoh.KeyExpr(self.transport.key("rc", token.channel))
        return found[1:]


class _CommandOutlet(_Asking):
    role, facing = "commands", "receives"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._credit = Credit(COMMANDS_AHEAD, lambda: {self.server()[0].link})

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        with _within(self._order, self._too_slow(deadline), end):
            self.check_open()
            if not self._credit.wait(end, self.check_open):
                raise self._too_slow(deadline)
            fingerprint, left = self.channel.type.fingerprint, end - time.monotonic()
            header = pack_request(Flag.ONEWAY, fingerprint, self.id, self._credit.sent, left)
            with as_transport_error(self.channel.name):
                key, put = self.server()[1], self.transport.session.put
                put(key, payload, attachment=header, congestion_control=_BLOCK, express=True)

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")


class _Caller(_Asking):
    role, facing = "calls", "serves"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._numbers = itertools.count(1)
        self._pending = Pending(channel.name)
        self._under_way: dict[int, tuple[int, Any]] = {}

    def ask(self, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        number, key, options = self._begin(deadline)
        try:
            with as_transport_error(self.channel.name):
                answers = self.transport.session.get(key, payload=payload, **options)
            while True:
                reply = self._understood(number, answers.recv())  # quicker than iterating
                if reply:
                    return reply
        except zenoh.ZError:  # that was all
            raise self._unanswered(end, deadline) from None
        finally:
            del self._under_way[number]

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        end = time.monotonic() + deadline
        number, key, options = self._begin(deadline)
        future = self._pending.add(number, deadline)
        future.add_done_callback(partial(self._ended, number))
        answered: list[bool] = []

        def answer(reply: zenoh.Reply) -> None:
            if self._is_ours(number, reply):
                answered.append(True)
            self.transport.do(partial(self._settle, number, reply))

        def no_more() -> None:
            if not answered:
                self.transport.do(lambda: self._pending.fail(number, self._unanswered(end, deadline)))

        try:
            with as_transport_error(self.channel.name):
                self.transport.session.get(key, _direct(answer, no_more), payload=payload, **options)
        except TransportError:
            future.cancel()
            raise
        return future

    def look(self) -> None:
        there = {token.link for token in self.counterparts()}
        for server, token in list(self._under_way.values()):
            if server not in there:  # Zenoh tells of a server that is lost, but not if the router is lost
                token.cancel()

    def tick(self) -> None:
        self._pending.expire()

    def release(self) -> None:
        for _, token in list(self._under_way.values()):
            token.cancel()
        self._pending.fail_all(Closed(f"{self.channel.name}: the link is closed"))

    def _begin(self, deadline: float) -> tuple[int, zenoh.KeyExpr, dict[str, Any]]:
        self.check_open()
        server, key = self.server()
        number, token = next(self._numbers), _Cancellation()
        self._under_way[number] = server.link, token
        if self.closed.is_set():
            token.cancel()
        header = pack_request(self._flags, self.channel.type.fingerprint, self.id, number, deadline)
        return (
            number,
            key,
            {
                "attachment": header,
                "timeout": max(deadline, 0.001),
                "cancellation_token": token,
                "consolidation": _NO_CONSOLIDATION,
                "congestion_control": _BLOCK,
                "express": True,
            },
        )

    def _is_ours(self, number: int, answer: zenoh.Reply) -> bool:
        try:
            header = read_reply(_bytes(answer.ok.attachment) if answer.ok else b"")
            return (header.client, header.sequence, Status(header.status)) == (self.id, number, header.status)
        except ValueError:
            return False

    def _understood(self, number: int, answer: zenoh.Reply) -> Reply | None:
        """What was answered; None if that was nothing of ours."""
        sample = answer.ok
        if sample is None:
            return None  # an error of Zenoh's own: it is over, and why is known to us
        try:
            header = read_reply(_bytes(sample.attachment))
            reply = Reply(Status(header.status), sample.payload.to_bytes())
        except ValueError as exc:
            self.malformed(exc)
            return None
        if (header.client, header.sequence) != (self.id, number):
            self.malformed("the answer to another question")
            return None
        if reply.status is Status.MISMATCH:
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, reply.payload.decode(errors="replace"))))
        return reply

    def _unanswered(self, end: float, deadline: float) -> TransportError:
        if self.closed.is_set():
            return Closed(f"{self.channel.name}: the link is closed")
        if time.monotonic() >= end - 0.001:  # timers may be so early
            return Timeout(f"{self.channel.name}: no answer in {deadline:g} s")
        return Unreachable(f"{self.channel.name}: its server left")

    def _settle(self, number: int, answer: zenoh.Reply) -> None:
        try:
            reply = self._understood(number, answer)
        except ContractMismatch as exc:
            self._pending.fail(number, exc)
            return
        if reply:
            self._pending.settle(number, reply)

    def _ended(self, number: int, future: Future[Reply]) -> None:
        _, token = self._under_way.pop(number)
        if future.cancelled() or future.exception():
            token.cancel()


# -- commands and queries, the serving side -----------------------------------


class _CommandInlet(_Receiving):
    role, facing = "receives", "commands"

    def __init__(self, transport: ZenohTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._sink = sink
        self._ledger = Ledger(self.stats, ordered=True)
        self.lane = Lane(channel.name, self._execute, COMMANDS_WAITING, lossy=False, stats=self.stats)

    def open(self) -> None:
        self._claim = _claim(self)
        super().open()

    def take(self, message: _Message) -> tuple[int, int] | None:
        request = read_request(_bytes(message.header))
        if request.fingerprint != self.channel.type.fingerprint:
            self.meet_stranger(request.client, request.fingerprint)
            return None
        if self._ledger.admit(request.client, request.sequence):
            self.lane.put((_expires(request, message.arrived), message.payload))
        return request.client, request.sequence

    def release(self) -> None:
        if self._claim:
            self._claim.close()
        super().release()

    def _execute(self, waiting: tuple[float, Any]) -> None:
        expires, payload = waiting
        if time.monotonic() >= expires:
            self.stats.expired += 1
        else:
            self._sink(payload.to_bytes())


class _Server(_Link):
    role, facing = "serves", "calls"

    def __init__(self, transport: ZenohTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._service = service
        self._gate = Gate(channel.name)
        self._ledger = Ledger(self.stats, ordered=False)
        self._lock = threading.Lock()
        self._waiting = _Inbox(INBOX)
        self._under_way: dict[tuple[int, int], tuple[_Query, float]] = {}

    def open(self) -> None:
        self._claim = _claim(self)
        queryable = self.transport.session.declare_queryable(self.key, _direct(self._hear), complete=True)
        self.declare(queryable)

    def tick(self) -> None:
        now = time.monotonic()
        with self._lock:
            over = [key for key, (_, expires) in self._under_way.items() if expires <= now]
        for key in over:
            self._forget(*key)

    def release(self) -> None:
        if self._claim:
            self._claim.close()
        self._gate.close()
        for key in list(self._under_way):
            self._forget(*key)

    def _hear(self, query: zenoh.Query) -> None:
        if self._waiting.put((query, time.monotonic())):
            self.transport.do(self._next)
        else:
            self.stats.dropped += 1
            query.drop()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it

    def _next(self) -> None:
        query, arrived = self._waiting.get()
        asked = _Query(query)
        try:
            request = read_request(_bytes(query.attachment))
        except DecodeError as exc:
            self.malformed(exc)
            asked.close()
            return
        expires = _expires(request, arrived)
        refusal = self._admit(request, asked, expires)
        if refusal is None:
            payload = query.payload
            self._serve(request, payload.to_bytes() if payload is not None else b"", expires)
            return
        if refusal.status is not Status.OK:
            self._send(asked, request, refusal)
        asked.close()

    def _admit(self, request: Request, asked: _Query, expires: float) -> Reply | None:
        """Note that a request is under way, or say how to refuse it; OK means without a word."""
        mine = self.channel.type
        if request.fingerprint != mine.fingerprint:
            self.meet_stranger(request.client, request.fingerprint)
            return Reply(Status.MISMATCH, mine.text.encode())
        with self._lock:
            if not self._ledger.admit(request.client, request.sequence):
                return Reply(Status.OK)
            if len(self._under_way) >= QUERIES_WAITING or len(self._waiting) >= QUERIES_WAITING:
                self.stats.dropped += 1
                return Reply(Status.BUSY)
            self._under_way[request.client, request.sequence] = asked, expires
        return None

    def _serve(self, request: Request, payload: bytes, expires: float) -> None:
        answer = partial(self._answer, request)
        if not self._gate.enter():
            answer(Reply(Status.REFUSED))
            return
        try:
            if time.monotonic() >= expires:
                self.stats.expired += 1
                answer(Reply(Status.EXPIRED))
                return
            self.stats.received += 1
            serve(self._service, payload, expires, answer)
        finally:
            self._gate.leave()

    def _answer(self, request: Request, reply: Reply) -> None:
        with self._lock:
            asked, _ = self._under_way.pop((request.client, request.sequence), (None, 0.0))
        if asked:
            self._send(asked, request, reply)
            asked.close()

    def _send(self, asked: _Query, request: Request, reply: Reply) -> None:
        try:
            asked.reply(self._header(reply.status, request), reply.payload)
        except zenoh.ZError as exc:
            log.debug("%s: a reply was not sent: %s", self.channel.name, exc)

    def _forget(self, client: int, sequence: int) -> None:
        with self._lock:
            asked, _ = self._under_way.pop((client, sequence), (None, 0.0))
        if asked:
            asked.close()

    def _header(self, status: Status, request: Request) -> bytes:
        return pack_reply(status, request.client, request.sequence, self.transport.incarnation)


def _expires(request: Request, arrived: float) -> float:
    remaining = float("inf") if request.remaining_ms == NO_DEADLINE else request.remaining_ms / 1000
    return arrived + remaining


def _claim(link: _Link) -> Claim:
    """Make sure that nobody else serves a channel, on this host or elsewhere."""
    transport, name = link.transport, link.channel.name
    claimed = claim(transport.claims, name, transport.owner)
    end, changed = time.monotonic() + SETTLED, transport.table.changed
    while others := transport.table.find(link.role, name):
        if time.monotonic() >= end:
            claimed.close()
            raise TransportError(f"{name}: already served from another host, by pid {others[0].pid} there")
        with changed:
            changed.wait(0.02)
    return claimed
