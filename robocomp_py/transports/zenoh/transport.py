"""The transport: its links, its session, and its thread."""

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
from typing import Any

import zenoh

from ...errors import ConfigurationError, TransportError
from ...wire.cdr import Cdr
from ...wire.codec import Codec, Payload
from ...wire.header import (
    random_id,
)
from ..base import (
    ANY_QOS,
    Capability,
    SupportsHost,
    TransportConfig,
    options_of,
)
from ..directory import runtime_dir
from ..exclusive import is_claimed
from ..keyfiles import Rights
from ..leader_followers import Job, LeaderFollowers
from ..limits import QUERIES_WAITING
from ..link import BaseLink, BaseTransport, Ends
from ..memory import keep_memory
from .client import Caller, CommandOutlet
from .link import IDLE_TICK, TICK, Link
from .messages import BLOCK, DATA, NO_CONSOLIDATION, SMALL, URGENT, Inbox, Message, Query, direct
from .reaching import Reaching
from .refusal import why_refused
from .server import CommandInlet, Server
from .session import HERE, Network, as_transport_error, named_router, shared_router
from .table import Table, Token
from .tls import NUMBER_BITS, checked, client_settings, number, rights
from .topics import Publisher, Subscriber
from .watching import INQUIRY, PROVIDING, Watching

log = logging.getLogger("robocomp.transport.zenoh")

_ACK = struct.Struct("<QQ")  # who took it · sequence
_GONE = b"gone"
"""What a transport answers about a link that it does not have, or not any more."""
_Cancellation: Any = zenoh.CancellationToken  # its stub lacks types


class ZenohTransport(BaseTransport[Token], SupportsHost):
    """Options:

    `connect`   the endpoint of a router to use instead of the one of this run-time folder, as Zenoh
                writes it: `tcp/192.168.1.5:7447`. Only this reaches other hosts.
                `here/NAME` is the one that somebody runs under that name in this run-time folder.
    `domain`    a number from 0. Those of different domains share the router, but do not meet.
    `keys`      folder with our certificate, for a router that asks for one (`tls/192.168.1.5:7447`):
                `rcdeploy keys` makes it.
    `router`    for who runs `here/NAME` for others (see `host`): more settings of that router, in Zenoh's own words

    While the router hangs, which is noticed after 2 s (after 10 s, where it is run for all), and then
    logged, all that waits keeps its deadline, except for what is larger than the queue to the router
    (about 1 MB): handing it over may take up to 2 s longer; a best-effort one is dropped after 1 s.
    """

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
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
        self._reaching = Reaching(self._ask_for_a_word, self.table.holds, self._reach, self.due)
        self._work: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._looking = False
        self._next_tick = 0.0
        self._inquiries, self._giving_up = Inbox(QUERIES_WAITING), _Cancellation()
        self.lines: dict[int, Link] = {}
        """By number: the links, which also have numbers beside their own."""
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
        try:
            self._threads.start()
        except TransportError:
            self.close()
            raise

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `base.SupportsHost`: run the router, unless it is one elsewhere, or somebody runs it."""
        connect, _ = _options(config)
        kind, _, name = connect.partition("/")
        router = config.options.get("router")
        if kind == HERE and router is not None:
            return named_router(name, router)
        return contextlib.nullcontext() if connect else shared_router(config.owner)

    def release(self, everything: contextlib.ExitStack) -> None:
        everything.callback(self._network.close)
        everything.callback(self._threads.close)
        everything.callback(self._giving_up.cancel)

    # What links use.

    def do(self, job: Job) -> None:
        """Have a thread of ours run this."""
        self._work.put(job)

    def new_id(self) -> int:
        return self._id << 24 | next(self._numbers)

    def has_left(self, channel: str) -> bool:
        """Whether a channel is not served any more on this host; its server's token may still tell that it is."""
        return not (self._elsewhere or is_claimed(self.claims, channel))

    def find(self, role: str, channel: str) -> list[Token]:
        return self.table.find(role, channel)

    def is_own(self, peer: Token) -> bool:
        return peer.link >> 24 == self._id

    def may_use(self, token: Token) -> bool:
        """Whether our keys let us use what a link provides. The router silently drops what they do not allow."""
        if not self._keyed or token.role not in PROVIDING:
            return True
        of_our_process = token.link >> (64 - NUMBER_BITS) == self._id >> (40 - NUMBER_BITS)
        return of_our_process or self._rights.allow(token.channel)

    def reaches(self, token: Token) -> bool:
        """Whether what is sent to a link gets there; if that is not known, it will be soon."""
        if token.reached or not self._elsewhere or self.is_own(token):
            return True
        self._reaching.seek(token)
        return False

    def key(self, kind: str, *parts: object) -> str:
        return "/".join(map(str, (kind, self.domain, *parts)))

    def address(self, kind: str, link: int) -> str:
        """The key of that kind at which a link is reached."""
        return f"{kind}/{self.domain}/{link >> 24:010x}/{link & 0xFFFFFF:06x}"

    def requests(self, link: int, channel: str) -> str:
        """The key at which a server takes requests. A router that knows who may use what looks at the channel."""
        address = self.address("rc_to", link)
        return f"{address}/{channel}" if self._keyed else address

    def inquire(self, link: int, what: str, channel: str = "") -> tuple[list[Message], bool]:
        """What another link answers, and whether that is all: nothing is all of one that has gone.

        `channel` is its own, unless everybody may ask.
        """
        with contextlib.suppress(zenoh.ZError):
            replies = self._inquire(link, what, channel)
            answers = [Message(reply.ok.attachment, reply.ok.payload) for reply in replies if reply.ok]
            return answers, len(answers) == len(replies)
        return [], True

    def _inquire(self, link: int, what: str, channel: str = "") -> list[zenoh.Reply]:
        """All replies, also that there was none in time. Raises ZError."""
        key = f"{self.address('rc_ask', link)}/{what}"
        if self._keyed and channel:
            key = f"{key}/{channel}"
        return list(
            self.session.get(key, timeout=INQUIRY, cancellation_token=self._giving_up, consolidation=NO_CONSOLIDATION)
        )

    def confirm(self, token: Token) -> None:
        """Forget a token if its link has gone.

        Zenoh may tell who joins of a token that goes just then, and never that it went. It may find it, too, if it is
        asked for it, so its transport is asked first; only of links that nobody speaks for the token itself has to do.
        """
        key = self.key("rc_lv", token.key_expr())
        with contextlib.suppress(zenoh.ZError):
            replies = self._inquire(token.link, "text")
            gone = any(_is_gone(reply) for reply in replies)
            if not replies:
                gone = not list(self.session.liveliness().get(key, timeout=INQUIRY))  # no error, either
            if gone:
                self._news(key, False)

    def put(self, key: str, header: bytes | None, payload: Payload) -> None:
        """Send what must arrive, what is small before what is large. Raises ZError."""
        priority = URGENT if len(payload) <= SMALL else DATA
        self.session.put(key, payload, attachment=header, congestion_control=BLOCK, priority=priority, express=True)

    def acknowledge(self, taken: dict[int, int], by: int) -> None:
        """Tell senders that their messages up to a number were taken."""
        for sender, sequence in taken.items():
            with contextlib.suppress(zenoh.ZError):  # closed meanwhile: nobody waits for it
                self.put(self.address("rc_ack", sender), None, _ACK.pack(by, sequence))

    def due(self, when: float) -> None:
        """Tick at that time, or before."""
        if when < self._next_tick:
            self.do(self._forget_the_clock)

    def left(self, link: BaseLink[Any, Token]) -> None:
        super().left(link)
        with self._lock:
            for number in [number for number, owner in list(self.lines.items()) if owner is link]:
                del self.lines[number]

    # Callbacks: on threads of Zenoh.

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._news(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _news(self, token: str, there: bool) -> None:
        if self.table.hear(token, there):
            self._look_soon()

    def _on_ack(self, sample: zenoh.Sample) -> None:
        link, data = self._meant(str(sample.key_expr).split("/")[-1]), sample.payload.to_bytes()
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

    # On threads of ours.

    def _ask_for_a_word(self, token: Token, answered: Callable[[], None], over: Callable[[], None]) -> None:
        key = f"{self.address('rc_ask', token.link)}/text"
        handler = direct(lambda reply: answered() if reply.ok and not _is_gone(reply) else None, over)
        with contextlib.suppress(zenoh.ZError):  # closed
            self.session.get(
                key, handler, timeout=INQUIRY, cancellation_token=self._giving_up, consolidation=NO_CONSOLIDATION
            )

    def _join(self) -> None:
        session, mine = self.session, f"{self._id:010x}"
        session.declare_subscriber(self.key("rc_ack", mine, "*"), direct(self._on_ack))
        session.declare_queryable(self.key("rc_ask", mine, "*", "*", "**"), direct(self._on_inquiry), complete=True)

    def _receive(self) -> Iterable[Job]:
        wait = self._next_tick - time.monotonic()
        if wait <= 0:
            self._next_tick, wait = inf, TICK  # what becomes due while we look is not missed
            try:
                wait = self._tick()
            finally:
                self._next_tick = time.monotonic() + wait
        try:
            return (self._work.get(timeout=wait),)
        except queue.Empty:
            return ()

    def _forget_the_clock(self) -> None:
        self._next_tick = 0.0
        self._work.put(_nothing)  # another thread may have begun to wait meanwhile

    def _tick(self) -> float:
        """Do what is due; seconds until the next time.

        On the thread that receives for everybody: nothing may stop it.
        """
        try:
            if self.close_if_abandoned():
                return TICK
            self._network.tick()
        except Exception:
            log.exception("housekeeping")
        waits = [self._reaching.tick(time.monotonic()), *self.tick_links()]
        usual = IDLE_TICK if self._network.settled else TICK
        return min([usual, *(wait for wait in waits if wait is not None)])

    def _look(self) -> None:
        self._looking = False
        self.look_at_peers()

    def _answer(self) -> None:
        query = self._inquiries.get()
        _, _, _, number, what, *channel = str(query.key_expr).split("/")
        link = self._meant(number)
        if link and self._keyed and what != "text" and "/".join(channel) != link.channel.name:
            link = None  # what was asked for by a right to something else
        with contextlib.suppress(zenoh.ZError), contextlib.closing(Query(query)) as asked:
            answers = link.answer(what) if link else [(_GONE, b"")] if what == "text" else ()
            for header, payload in answers:
                asked.reply(header, payload)

    def _meant(self, number: str) -> Link | None:
        try:
            id_ = self._id << 24 | int(number, 16)
        except ValueError:
            return None
        return self.lines.get(id_)

    @contextlib.contextmanager
    def opening(self, link: BaseLink[Any, Token]) -> Iterator[None]:
        with as_transport_error(f"{link.channel.name}: opening"):
            self.watching.watch(link.role, link.channel.name)
            yield


def _is_gone(reply: zenoh.Reply) -> bool:
    """Whether the transport of a link answers that it has it no more."""
    attachment = reply.ok.attachment if reply.ok else None
    return attachment is not None and attachment.to_bytes() == _GONE


def _nothing() -> None: ...


def _options(config: TransportConfig) -> tuple[str, int]:
    options = options_of(config, connect="", domain=0, keys="", router=None)
    connect, domain = options["connect"], options["domain"]
    if type(connect) is not str or not re.fullmatch(r"([\w-]+/\S+)?", connect):
        raise ConfigurationError(
            f"transport option `connect` is an endpoint like tcp/192.168.1.5:7447, not {connect!r}"
        )
    if type(domain) is not int or domain < 0:
        raise ConfigurationError(f"transport option `domain` is a number from 0, not {domain!r}")
    return connect, domain


def _claims(connect: str, domain: int) -> Path:
    """The folder for claims of those who can meet."""
    where = hashlib.sha256(connect.encode()).hexdigest()[:8] if connect else "here"
    return runtime_dir("zenoh", f"served-{domain}-{where}")
