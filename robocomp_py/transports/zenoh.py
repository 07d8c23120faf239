"""Transport `zenoh`: every component is a client of one router (see `zenoh_session`).

    rc/<domain>/<channel>                 publications and commands: payload in CDR, our header as the attachment
    rc_to/<domain>/<transport>/<number>   the same, to one link: a request to its server, an answer to who asked
    rc_lv/<domain>/…/<link>/<channel>     a liveliness token for each link: who is there (`Token`)
    rc_ack/<domain>/<transport>/<number>  to a link: "this message of yours was taken"
    rc_ask/<domain>/<transport>/<number>  of a link: `/text`, its contract; `/history`, its latched messages

A link's id, which is also the client or source of its headers, is 40 bits of its transport and 24
of its own number, so whoever has got a message from it knows where to answer, to acknowledge and
to ask. Calls are two such messages, which is quicker than a query of Zenoh's; for programs that
know only those, `rc/<domain>/<channel>` of a server answers them, too.

Zenoh drops messages, or closes the connection, where a reader is slow. What must not be lost
(reliable publications, commands) is therefore sent only to readers that have room for it: they
acknowledge what they took, and a sender is at most so many messages ahead (`Credit`).

Threads. Callbacks run on Zenoh's own threads, and one that is slow delays everybody. So they only
queue what came in, and a `Crew` does the rest. They must not log either: `logging` would have
`threading` take them for ours.
"""

from __future__ import annotations

import contextlib
import ctypes
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
from .exclusive import Claim, claim, is_claimed
from .ledger import Ledger
from .pending import Pending
from .zenoh_session import Network, as_transport_error, shared_router
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

_LONGEST_WAIT = 3600.0
"""Seconds that one wait may take; Python refuses to wait for ever so long."""

L = TypeVar("L", bound="_Link")
_ACK = struct.Struct("<QQ")  # who took it · sequence


class ZenohTransport:
    """Options:

    `connect`   the endpoint of a router to use instead of the one of this run-time folder, as Zenoh
                writes it: `tcp/192.168.1.5:7447`. Only this reaches other hosts.
    `domain`    a number from 0. Those of different domains share the router, but do not meet.

    While the router hangs, which is noticed after 2 s, and then logged, all that waits keeps its
    deadline, except for what is larger than the queue to the router (about 1 MB): handing it over
    may take up to 2 s longer; a best-effort one is dropped after 1 s.
    """

    def __init__(self, config: TransportConfig) -> None:
        connect, self.domain = _options(config)
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
        self.lines: dict[int, _Link] = {}
        """Whose the numbers are that are no link's own."""
        self.claims, self._elsewhere = _claims(connect, self.domain), bool(connect)
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

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `base.hosting`: run the router, unless it is one elsewhere, or somebody runs it."""
        connect, _ = _options(config)
        return contextlib.nullcontext() if connect else shared_router(config.owner)

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

    def has_left(self, channel: str) -> bool:
        """Whether a channel is not served any more on this host; its server's token may still tell that it is."""
        return not (self._elsewhere or is_claimed(self.claims, channel))

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

    def put(self, key: zenoh.KeyExpr | str, header: bytes | None, payload: Payload) -> None:
        """Send what must arrive. Raises ZError."""
        self.session.put(key, payload, attachment=header, congestion_control=_BLOCK, express=True)

    def acknowledge(self, taken: dict[int, int], by: int) -> None:
        """Tell senders that their messages up to a number were taken."""
        for sender, sequence in taken.items():
            with contextlib.suppress(zenoh.ZError):  # closed meanwhile: nobody waits for it
                self.put(self.key("rc_ack", *_halves(sender)), None, _ACK.pack(by, sequence))

    def tick_soon(self) -> None:
        """Something is due earlier than the next tick may be."""
        self.do(self._forget_the_clock)

    def left(self, link: _Link) -> None:
        with self._lock:
            self._links.pop(link.id, None)
            for number in [number for number, owner in list(self.lines.items()) if owner is link]:
                del self.lines[number]

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
            wait = self._tick()
            self._next_tick = time.monotonic() + wait
        try:
            return (self._work.get(timeout=wait),)
        except queue.Empty:
            return ()

    def _forget_the_clock(self) -> None:
        self._next_tick = 0.0

    def _tick(self) -> float:
        """Do what is due; seconds until the next time.

        On the thread that receives for everybody: nothing may stop it.
        """
        try:
            if abandoned():
                log.warning("%s: not closed at the end of the program; closing", self.owner or "zenoh")
                self.close()
                return TICK
            self._network.tick()
        except Exception:
            log.exception("housekeeping")
        waits = [link.tick() for link in list(self._links.values())]
        return min([TICK, *(wait for wait in waits if wait is not None)])

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
            id_ = self._id << 24 | int(number, 16)
        except ValueError:
            return None
        return self._links.get(id_) or self.lines.get(id_)

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


def _options(config: TransportConfig) -> tuple[str, int]:
    options = options_of(config, connect="", domain=0)
    connect, domain = options["connect"], options["domain"]
    if not isinstance(connect, str) or not isinstance(domain, int) or domain < 0:
        raise ConfigurationError("options of zenoh: `connect` is an endpoint, `domain` a number from 0")
    return connect, domain


def _claims(connect: str, domain: int) -> Path:
    """The folder for claims of those who can meet."""
    where = hashlib.sha256(connect.encode()).hexdigest()[:8] if connect else "here"
    return runtime_dir() / "zenoh" / f"served-{domain}-{where}"


_BLOCK, _DROP = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
_NO_CONSOLIDATION = zenoh.ConsolidationMode.NONE
_Cancellation: Any = zenoh.CancellationToken  # its stub lacks types


def _direct(callback: Callable[[Any], object]) -> Any:
    """A callback that Zenoh calls itself, without a thread of Python's for each."""

    def call(message: Any) -> None:
        if not hasattr(_thread_state, "kept"):
            _thread_state.kept = ctypes.pythonapi.PyGILState_Ensure()
        callback(message)

    return zenoh.handlers.Callback(call, indirect=False)


_thread_state = threading.local()
"""Python does not know Zenoh's threads, and would make a state for them at each callback, and destroy it afterwards,
mapping and unmapping memory: 25 µs. Entered once more than left, a thread keeps the one it has."""


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


class _Sender:
    """Who asked by a message, and gets the answer as one."""

    def __init__(self, transport: ZenohTransport, line: int) -> None:
        self._transport, self._line = transport, line

    def reply(self, header: bytes, payload: Payload) -> None:
        self._transport.put(self._transport.key("rc_to", *_halves(self._line)), header, payload or b"")

    def close(self) -> None: ...


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

    def tick(self) -> float | None:
        """Do what is due; seconds until the next time, if not a tick."""
        return None

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
        self._readers: tuple[int, dict[int, int]] = -1, {}
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
            if not self._credit.wait(end, self.check_open, len(payload)):
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

    def _reliable_readers(self) -> dict[int, int]:
        if not self._lossless:
            return {}
        version = self.transport.table.version
        if self._readers[0] != version:
            self._readers = version, {token.link: token.since for token in self._same() if "r" in token.traits}
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
        self._taken: dict[int, int] = {}
        """Of each sender the number up to which it has to be told that its messages were taken."""

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
        with self._taking:
            while len(self._inbox) and not self.lane.full:
                done = self._take(self._inbox.get())
                if done:
                    if not self._taken:
                        self.transport.do(self._acknowledge)  # after this, or meanwhile if the sink is slow
                    self._taken[done[0]] = done[1]
        self.lane.drain()
        if len(self._inbox) and not self.lane.full:
            self.schedule()

    def _acknowledge(self) -> None:
        with self._taking:
            taken, self._taken = self._taken, {}
        self.transport.acknowledge(taken, self.id)

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
            found = self._found = version, token, zenoh.KeyExpr(self.address(token))
        return found[1:]

    def address(self, server: Token) -> str:
        return self.transport.key("rc", server.channel)


class _CommandOutlet(_Asking):
    role, facing = "commands", "receives"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._credit = Credit(COMMANDS_AHEAD, self._reader)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        with _within(self._order, self._too_slow(deadline), end):
            self.check_open()
            if not self._credit.wait(end, self.check_open, len(payload)):
                raise self._too_slow(deadline)
            fingerprint, left = self.channel.type.fingerprint, end - time.monotonic()
            header = pack_request(Flag.ONEWAY, fingerprint, self.id, self._credit.sent, left)
            with as_transport_error(self.channel.name):
                self.transport.put(self.server()[1], header, payload)

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _reader(self) -> dict[int, int]:
        server, _ = self.server()
        if self.transport.has_left(server.channel):
            raise Unreachable(f"{self.channel.name}: its server left")
        return {server.link: server.since}

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")


class _Line:
    """Questions numbered on their own, and where their answers come in."""

    def __init__(self, link: _Link, heard: Callable[[zenoh.Sample], object]) -> None:
        """`heard` is called on a thread of Zenoh."""
        self.id = link.transport.new_id()
        self.numbers = itertools.count(1)
        link.transport.lines[self.id] = link
        key = link.transport.key("rc_to", *_halves(self.id))
        link.declare(link.transport.session.declare_subscriber(key, _direct(heard)))

    def over(self, number: int, error: TransportError) -> None:
        """There will be no answer to that question."""
        raise NotImplementedError


class _Over(NamedTuple):
    number: int
    error: TransportError


class _OwnLine(_Line):
    """Has one question at a time, and the thread that asked waits here itself."""

    def __init__(self, link: _Link) -> None:
        self._box: queue.SimpleQueue[zenoh.Sample | _Over] = queue.SimpleQueue()
        super().__init__(link, self._box.put)

    def over(self, number: int, error: TransportError) -> None:
        self._box.put(_Over(number, error))

    def receive(self, number: int, end: float) -> zenoh.Sample | None:
        """What came in, or None if nothing did until `end`. Raises what the question is `over` by."""
        while (left := end - time.monotonic()) > 0:
            try:
                got = self._box.get(timeout=min(left, _LONGEST_WAIT))
            except queue.Empty:
                continue
            if not isinstance(got, _Over):
                return got
            if got.number == number:
                raise got.error
        return None

    def empty(self) -> None:
        """Forget what nobody waits for."""
        while not self._box.empty():
            self._box.get()


class _SharedLine(_Line):
    """Has many questions, and the crew attends to their answers."""

    def __init__(self, link: _Link, pending: Pending, settle: Callable[[_Line, zenoh.Sample], None]) -> None:
        self._do, self._pending = link.transport.do, pending
        super().__init__(link, lambda answer: self._do(partial(settle, self, answer)))

    def over(self, number: int, error: TransportError) -> None:
        self._do(partial(self._pending.fail, number, error))


class _Caller(_Asking):
    role, facing = "calls", "serves"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._lock = threading.Lock()
        self._idle: list[_OwnLine] = []
        self._shared: _SharedLine | None = None
        self._pending = Pending(channel.name)
        self._under_way: dict[tuple[_Line, int], int] = {}
        """Of each question the link that it was put to."""

    def address(self, server: Token) -> str:
        return self.transport.key("rc_to", *_halves(server.link))

    def ask(self, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        self.check_open()
        line = self._take()
        number = next(line.numbers)
        try:
            self._put(line, number, payload, end)
            while (answer := line.receive(number, end)) is not None:
                found = self._understood(line, answer)
                if found and found[0] == number:
                    return self._accepted(found[1])
        finally:
            self._under_way.pop((line, number), None)
            self._idle.append(line)
        raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        end = time.monotonic() + deadline
        self.check_open()
        line = self._common_line()
        number = next(line.numbers)
        future = self._pending.add(number, deadline)
        future.add_done_callback(lambda _: self._under_way.pop((line, number), None))
        try:
            self._put(line, number, payload, end)
        except BaseException:
            future.cancel()
            raise
        finally:
            if future.done():  # perhaps before it was noted as under way
                self._under_way.pop((line, number), None)
        if deadline < TICK:
            self.transport.tick_soon()
        return future

    def look(self) -> None:
        there = {token.link for token in self.counterparts()}
        for (line, number), server in list(self._under_way.items()):
            if server not in there:
                line.over(number, Unreachable(f"{self.channel.name}: its server left"))

    def tick(self) -> float | None:
        with self._lock:
            for line in self._idle:
                line.empty()
        return self._pending.expire(self.transport.do)

    def release(self) -> None:
        closed = Closed(f"{self.channel.name}: the link is closed")
        for line, number in list(self._under_way):
            line.over(number, closed)
        self._pending.close(closed)

    def _take(self) -> _OwnLine:
        with self._lock:
            if self._idle:
                return self._idle.pop()
        with as_transport_error(self.channel.name):
            return _OwnLine(self)

    def _common_line(self) -> _SharedLine:
        with self._lock, as_transport_error(self.channel.name):
            if self._shared is None:
                self._shared = _SharedLine(self, self._pending, self._settle)
            return self._shared

    def _put(self, line: _Line, number: int, payload: Payload, end: float) -> None:
        server, key = self.server()
        while self._under_way.get((line, number)) != server.link:
            self._under_way[line, number] = server.link  # from now on its end is told if that server leaves
            server, key = self.server()  # unless it has left
        self.check_open()
        left = end - time.monotonic()
        header = pack_request(self._flags, self.channel.type.fingerprint, line.id, number, left)
        with as_transport_error(self.channel.name):
            self.transport.put(key, header, payload)

    def _understood(self, line: _Line, answer: zenoh.Sample) -> tuple[int, Reply] | None:
        """The number of a question, and what was answered to it; None if that was nothing of ours."""
        try:
            header = read_reply(_bytes(answer.attachment))
            reply = Reply(Status(header.status), answer.payload.to_bytes())
        except ValueError as exc:
            self.malformed(exc)
            return None
        if header.client != line.id:
            self.malformed("the answer to somebody else's question")
            return None
        return header.sequence, reply

    def _accepted(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH:
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, reply.payload.decode(errors="replace"))))
        return reply

    def _settle(self, line: _Line, answer: zenoh.Sample) -> None:
        found = self._understood(line, answer)
        if found is None:
            return
        number, reply = found
        try:
            self._pending.settle(number, self._accepted(reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)


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
        self._under_way: dict[tuple[int, int], tuple[_Query | _Sender, float]] = {}

    def open(self) -> None:
        self._claim = _claim(self)
        session, mine = self.transport.session, self.transport.key("rc_to", *_halves(self.id))
        self.declare(session.declare_subscriber(mine, _direct(self._hear)))
        self.declare(session.declare_queryable(self.key, _direct(self._hear), complete=True))

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

    def _hear(self, question: zenoh.Sample | zenoh.Query) -> None:
        if self._waiting.put((question, time.monotonic())):
            self.transport.do(self._next)
        else:
            self.stats.dropped += 1
            if isinstance(question, zenoh.Query):
                question.drop()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it

    def _next(self) -> None:
        question, arrived = self._waiting.get()
        query = _Query(question) if isinstance(question, zenoh.Query) else None
        try:
            request = read_request(_bytes(question.attachment))
        except DecodeError as exc:
            self.malformed(exc)
            if query:
                query.close()
            return
        asked = query or _Sender(self.transport, request.client)
        expires = _expires(request, arrived)
        refusal = self._admit(request, asked, expires)
        if refusal is None:
            payload = question.payload
            self._serve(request, payload.to_bytes() if payload is not None else b"", expires)
            return
        if refusal.status is not Status.OK:
            self._send(asked, request, refusal)
        asked.close()

    def _admit(self, request: Request, asked: _Query | _Sender, expires: float) -> Reply | None:
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

    def _send(self, asked: _Query | _Sender, request: Request, reply: Reply) -> None:
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
