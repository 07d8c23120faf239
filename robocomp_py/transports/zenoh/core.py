"""What the links of a Zenoh transport share: its options, its session, and its threads."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import logging
import queue
import re
import secrets
import struct
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, Protocol

import zenoh

from ...errors import ConfigurationError
from ...wire.cdr import Cdr
from ...wire.codec import Codec, Payload
from ...wire.header import (
    random_id,
)
from ..base import (
    ANY_QOS,
    LONGEST_CONTRACT,
    Capability,
    Channel,
    SupportsHost,
    TransportConfig,
    options_of,
)
from ..exclusive import is_claimed
from ..keyfiles import Rights
from ..leader_followers import Job, LeaderFollowers
from ..limits import QUERIES_WAITING
from ..link import BaseLink, BaseTransport
from ..memory import keep_memory
from ..runtime_folder import runtime_dir
from .messages import NO_CONSOLIDATION, BoundedQueue, Message, QueryReplier, direct, put
from .reachability import Reachability
from .refusal import why_refused
from .session import HERE, Network, as_transport_error, named_router, shared_router
from .table import LINK_BITS, Table, Token
from .telling import WHO, owner_of, who
from .tls import NUMBER_BITS, checked, client_settings, number, rights
from .watching import INQUIRY, PROVIDING, Watching

log = logging.getLogger("robocomp.transport.zenoh")

TICK = 0.1
"""Seconds between two checks for slow sinks and for a router that has stopped."""

IDLE_TICK = 0.5
"""The same if there is nothing to check: no slow sink, and a router that outlives us. Deadlines are still kept."""

_ACK = struct.Struct("<QQ")  # link that acknowledges · sequence number
_GONE = b"gone"
"""A transport's reply to an inquiry to a link that it does not have (any more)."""
_Cancellation: Any = zenoh.CancellationToken  # its stub lacks types


class Answering(Protocol):
    """A link, as peers ask it; see `link.Link`."""

    channel: Channel

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        """The reply to an inquiry of a peer."""
        ...

    def acknowledged(self, by: int, sequence: int) -> None:
        """A peer took messages of this link up to that number. Called on a Zenoh thread."""


class ZenohCore(BaseTransport[Token], SupportsHost):
    """The transport without the classes of its links."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        connect, self.domain = _options(config)
        self.codec: Codec = Cdr()
        if connect and not connect.startswith("unix"):
            self.capabilities |= Capability.CROSS_HOST
        self.owner, self.incarnation = config.owner, random_id()
        self.table = Table()
        keys = checked(config.options.get("keys", "")) if connect.startswith("tls/") else None
        self._id, self._numbers = secrets.randbits(40), itertools.count(1)
        self._keyed = keys is not None
        self._rights = rights(keys) if keys else Rights()
        if keys:  # the router's rules name its links by its number
            self._id = number(keys) << (40 - NUMBER_BITS) | secrets.randbits(40 - NUMBER_BITS)
        self._reachability = Reachability(self._send_probe, self.table.holds, self._reach, self.due)
        self._work: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._looking = False
        self._next_tick = 0.0
        self._inquiries, self._cancellation = BoundedQueue(QUERIES_WAITING), _Cancellation()
        self.links_by_id: dict[int, Answering] = {}
        """The link of each id: its own, and those of its reply inboxes."""
        self.claims, self._elsewhere = _claims(connect, self.domain), bool(connect)
        keep_memory()
        why = partial(why_refused, keys=keys)
        self._network = Network(connect, config.owner, client_settings(keys), config.wanted, why, self.do)
        self.session = self._network.session
        self.watching = Watching(self.session, self.domain, self._on_token)
        try:
            with as_transport_error("joining"):
                self._join()
        except BaseException:
            self._network.close()
            raise
        self._threads = LeaderFollowers("zenoh", self._receive, wake=lambda: self._work.put(_nothing))
        self._threads.start(self.close)

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `base.SupportsHost`: run the router, unless it is elsewhere or running already."""
        connect, _ = _options(config)
        kind, _, name = connect.partition("/")
        router = config.options.get("router")
        if kind == HERE and router is not None:
            return named_router(name, router)
        return contextlib.nullcontext() if connect else shared_router(config.owner)

    def release(self, everything: contextlib.ExitStack) -> None:
        everything.callback(self._network.close)
        everything.callback(self._threads.close)
        everything.callback(self._cancellation.cancel)

    # What links use.

    def do(self, job: Job) -> None:
        """Run a job on one of our threads."""
        self._work.put(job)

    def new_id(self) -> int:
        return self._id << LINK_BITS | next(self._numbers)

    def has_left(self, channel: str) -> bool:
        """Whether a server on this host has left though its token is still visible. False for routers elsewhere."""
        return not (self._elsewhere or is_claimed(self.claims, channel))

    def find(self, role: str, channel: str) -> list[Token]:
        return self.table.find(role, channel)

    def is_own(self, peer: Token) -> bool:
        return peer.link >> LINK_BITS == self._id

    def may_use(self, token: Token) -> bool:
        """Whether our keys allow this link. The router silently drops messages that they do not allow."""
        if not self._keyed or token.role not in PROVIDING:
            return True
        of_our_process = token.link >> (64 - NUMBER_BITS) == self._id >> (40 - NUMBER_BITS)
        return of_our_process or self._rights.allow(token.channel)

    def reaches(self, token: Token) -> bool:
        """Whether messages are known to reach a link; if not, a probe starts."""
        if token.reached or not self._elsewhere or self.is_own(token):
            return True
        self._reachability.probe(token)
        return False

    def key(self, kind: str, *parts: object) -> str:
        return "/".join(map(str, (kind, self.domain, *parts)))

    def address(self, kind: str, link: int) -> str:
        """The key of a link for that kind of message."""
        return f"{kind}/{self.domain}/{link >> 24:010x}/{link & 0xFFFFFF:06x}"

    def requests(self, link: int, channel: str) -> str:
        """The key of a server for requests. With keys, it contains the channel, which the router's rules need."""
        address = self.address("rc_to", link)
        return f"{address}/{channel}" if self._keyed else address

    def inquire(self, link: int, what: str, channel: str = "") -> tuple[list[Message], bool]:
        """A link's answers to an inquiry, and whether they are complete. Those of a link that has gone are: none.

        `channel` is the link's; it may be left out for inquiries that any component may make.
        """
        with contextlib.suppress(zenoh.ZError):
            replies = self._inquire(link, what, channel)
            answers = [Message(reply.ok.attachment, reply.ok.payload) for reply in replies if reply.ok]
            return answers, len(answers) == len(replies)
        return [], True

    def contract(self, link: int) -> str:
        """The contract of a link, asked from the link itself; "" if it does not answer."""
        answers, _ = self.inquire(link, "text")
        octets = answers[0].payload.to_bytes() if answers else b""
        return octets[: LONGEST_CONTRACT + 1].decode(errors="replace")

    def every_token(self) -> list[Token]:
        """The tokens of all links of the domain. Raises TransportError."""
        with as_transport_error("asking for all links"):
            replies = list(self.session.liveliness().get(self.key("rc_lv", "**"), timeout=INQUIRY))
        tokens = []
        for reply in replies:
            with contextlib.suppress(ValueError):  # another program's
                if reply.ok:
                    tokens.append(Token.parse(str(reply.ok.key_expr)))
        return sorted(tokens)

    def owners(self) -> dict[int, str]:
        """The owners of all transports of the domain that tell it, by the numbers of the transports."""
        found: dict[int, str] = {}
        with contextlib.suppress(zenoh.ZError):
            key = self.key("rc_ask", "*", "*", WHO)
            for reply in self.session.get(
                key, timeout=INQUIRY, cancellation_token=self._cancellation, consolidation=NO_CONSOLIDATION
            ):
                if reply.ok:
                    found |= owner_of(reply.ok.payload.to_bytes())
        return found

    def _inquire(self, link: int, what: str, channel: str = "") -> list[zenoh.Reply]:
        """All replies; a time-out is one of them. Raises ZError."""
        key = f"{self.address('rc_ask', link)}/{what}"
        if self._keyed and channel:
            key = f"{key}/{channel}"
        return list(
            self.session.get(
                key, timeout=INQUIRY, cancellation_token=self._cancellation, consolidation=NO_CONSOLIDATION
            )
        )

    def confirm(self, token: Token) -> None:
        """Forget a token if its link has gone.

        Zenoh may announce, to a session that joins, a token that is just being removed, and never report its removal.
        Zenoh may even find such a token in a query. So the link's transport is asked first, and Zenoh only if it
        does not answer.
        """
        key = self.key("rc_lv", token.key_expr())
        with contextlib.suppress(zenoh.ZError):
            replies = self._inquire(token.link, "text")
            gone = any(_is_gone(reply) for reply in replies)
            if not replies:
                gone = not list(self.session.liveliness().get(key, timeout=INQUIRY))  # an error counts as an answer
            if gone:
                self._update(key, False)

    def acknowledge(self, taken: dict[int, int], by: int) -> None:
        """Acknowledge, to each sender, its messages up to that number."""
        for sender, sequence in taken.items():
            with contextlib.suppress(zenoh.ZError):  # closed meanwhile
                put(self.session, self.address("rc_ack", sender), None, _ACK.pack(by, sequence))

    def due(self, when: float) -> None:
        """Have the next tick no later than that."""
        if when < self._next_tick:
            self.do(self._tick_now)

    def left(self, link: BaseLink[Any, Token]) -> None:
        super().left(link)
        gone: object = link
        with self._lock:
            for number in [number for number, owner in list(self.links_by_id.items()) if owner is gone]:
                del self.links_by_id[number]

    # Callbacks, on Zenoh's threads.

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._update(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _update(self, token: str, there: bool) -> None:
        if self.table.update(token, there):
            self._look_soon()

    def _on_ack(self, sample: zenoh.Sample) -> None:
        link, data = self._link(str(sample.key_expr).split("/")[-1]), sample.payload.to_bytes()
        if link and len(data) == _ACK.size:
            link.acknowledged(*_ACK.unpack(data))

    def _on_inquiry(self, query: zenoh.Query) -> None:
        if self._inquiries.put(query):
            self._work.put(self._answer)

    def _reach(self, token: Token) -> None:
        self.table.reach(token)
        self._look_soon()

    def _look_soon(self) -> None:
        if not self._looking:
            self._looking = True
            self._work.put(self._look)

    # On our own threads.

    def _send_probe(self, token: Token, answered: Callable[[], None], over: Callable[[], None]) -> None:
        key = f"{self.address('rc_ask', token.link)}/text"
        handler = direct(lambda reply: answered() if reply.ok and not _is_gone(reply) else None, over)
        with contextlib.suppress(zenoh.ZError):  # closed
            self.session.get(
                key, handler, timeout=INQUIRY, cancellation_token=self._cancellation, consolidation=NO_CONSOLIDATION
            )

    def _join(self) -> None:
        session, mine = self.session, f"{self._id:010x}"
        session.declare_subscriber(self.key("rc_ack", mine, "*"), direct(self._on_ack))
        session.declare_queryable(self.key("rc_ask", mine, "*", "*", "**"), direct(self._on_inquiry), complete=True)

    def _receive(self) -> Iterable[Job]:
        wait = self._next_tick - time.monotonic()
        if wait <= 0:
            self._next_tick, wait = inf, TICK  # `due` may set an earlier time during the tick
            try:
                wait = self._tick()
            finally:
                self._next_tick = min(self._next_tick, time.monotonic() + wait)
        try:
            return (self._work.get(timeout=wait),)
        except queue.Empty:
            return ()

    def _tick_now(self) -> None:
        self._next_tick = 0.0
        self._work.put(_nothing)  # wakes a thread that has begun to wait meanwhile

    def _tick(self) -> float:
        """Do what is due; returns the seconds until the next tick.

        Errors are logged: this runs on the thread that receives for all links.
        """
        try:
            if self.close_if_abandoned():
                return TICK
            self._network.tick()
        except Exception:
            log.exception("housekeeping")
        waits = [self._reachability.tick(time.monotonic()), *self.tick_links()]
        usual = IDLE_TICK if self._network.stable else TICK
        return min([usual, *(wait for wait in waits if wait is not None)])

    def _look(self) -> None:
        self._looking = False
        self.look_at_peers()

    def _answer(self) -> None:
        query = self._inquiries.get()
        _, _, _, number, what, *channel = str(query.key_expr).split("/")
        if what == WHO:
            with contextlib.suppress(zenoh.ZError), contextlib.closing(QueryReplier(query)) as asked:
                asked.reply(b"", who(self._id, self.owner))
            return
        link = self._link(number)
        if link and self._keyed and what != "text" and "/".join(channel) != link.channel.name:
            link = None  # the keys allowed the inquiry for another channel only
        with contextlib.suppress(zenoh.ZError), contextlib.closing(QueryReplier(query)) as asked:
            answers = link.answer(what) if link else [(_GONE, b"")] if what == "text" else ()
            for header, payload in answers:
                asked.reply(header, payload)

    def _link(self, number: str) -> Answering | None:
        try:
            id_ = self._id << 24 | int(number, 16)
        except ValueError:
            return None
        return self.links_by_id.get(id_)

    @contextlib.contextmanager
    def opening(self, link: BaseLink[Any, Token]) -> Iterator[None]:
        with as_transport_error(f"{link.channel.name}: opening"):
            self.watching.watch(link.role, link.channel.name)
            yield


def _is_gone(reply: zenoh.Reply) -> bool:
    """Whether a transport replies that it does not have the link any more."""
    attachment = reply.ok.attachment if reply.ok else None
    return attachment is not None and attachment.to_bytes() == _GONE


def _nothing() -> None: ...


def _options(config: TransportConfig) -> tuple[str, int]:
    options = options_of(config, connect="", domain=0, keys="", router=None)
    connect, domain = options["connect"], options["domain"]
    if type(connect) is not str or not re.fullmatch(r"([\w-]+/\S+)?", connect):
        raise ConfigurationError(
            f"transport option `connect` must be an endpoint like tcp/192.168.1.5:7447, not {connect!r}"
        )
    if type(domain) is not int or domain < 0:
        raise ConfigurationError(f"transport option `domain` must be an integer >= 0, not {domain!r}")
    return connect, domain


def _claims(connect: str, domain: int) -> Path:
    """The folder for claims; components that can meet use the same one."""
    where = hashlib.sha256(connect.encode()).hexdigest()[:8] if connect else "here"
    return runtime_dir("zenoh", f"served-{domain}-{where}")
