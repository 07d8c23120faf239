"""The base of all links and transports, independent of how a transport finds its peers.

    BaseTransport   opens links by the four verbs, serves them on its receiving thread, and closes them
    BaseLink        one end of a channel: it waits for peers, compares contracts, and closes once

The strategy that finds peers is two methods of the transport, `find` and `is_own`. They read a directory of the
run-time folder (`directory_transport.py`), the endpoints that DDS has discovered, or the liveliness tokens of Zenoh.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable
from functools import partial
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from ..contract.interface import Pattern
from ..errors import Closed, ContractMismatch, Timeout, TransportError
from .base import (
    Caller,
    Channel,
    Link,
    Outlet,
    Reply,
    Service,
    Sink,
    Statistics,
    Status,
    SupportsConnected,
    TypeRef,
    about_to_block,
    mismatch,
)
from .leader_followers import Job, abandoned
from .limits import STRANGERS
from .sparing import Sparing

log = logging.getLogger("robocomp.transport")

LEAVING = 2.0
"""Maximum seconds between the end of a peer and its detection."""

_FIRST_PAUSE, _LONGEST_PAUSE, _GROWTH = 0.002, 0.05, 1.5
"""Seconds between two looks for a peer: the first pause, the longest one, and the factor between two pauses."""

_FIRST_ATTEMPT, _SHORT_PAUSE, _LONG_PAUSE = 0.0001, 0.0005, 0.005
"""Seconds between two attempts to send: the first pause, and the longest ones up to `_SHORTLY` and after it."""

_SHORTLY = 0.1


class Peer(Protocol):
    """The other end of a channel, as far as links compare it with themselves."""

    @property
    def channel(self) -> str: ...

    @property
    def fingerprint(self) -> int: ...

    @property
    def text(self) -> str:
        """The contract behind its fingerprint; "" if it is not known yet."""
        ...

    @property
    def key(self) -> Hashable:
        """Identifies it in reports, each of which is logged once."""
        ...


P = TypeVar("P", bound=Peer)
L = TypeVar("L", bound="BaseLink[Any, Any]")
R = TypeVar("R")


class Ends(NamedTuple):
    """The classes of a transport's links. Each is called with the transport, the channel, and a sink or service."""

    publisher: Callable[..., Any]
    command_outlet: Callable[..., Any]
    subscriber: Callable[..., Any]
    command_inlet: Callable[..., Any]
    caller: Callable[..., Any]
    server: Callable[..., Any]


class BaseTransport(ABC, Generic[P]):
    """A transport whose links derive from `BaseLink`."""

    ends: ClassVar[Ends]
    owner: str
    gone = ""
    """Why the transport was closed, if a user did not close it."""

    def __init__(self) -> None:
        self.closed = False
        self._lock = threading.RLock()
        self._links: list[BaseLink[Any, P]] = []
        self._last: dict[object, str] = {}
        """By method of a link: its last error, so that it is logged once."""
        self._hindered_since: dict[object, float] = {}
        """By method of a link: since when it fails."""

    # The four verbs.

    def outlet(self, channel: Channel) -> Outlet:
        topic = channel.pattern is Pattern.PUBLISH
        outlet: Outlet = self._open(partial(self.ends.publisher if topic else self.ends.command_outlet, self, channel))
        return outlet

    def inlet(self, channel: Channel, sink: Sink) -> Link:
        topic = channel.pattern is Pattern.PUBLISH
        kind = self.ends.subscriber if topic else self.ends.command_inlet
        inlet: Link = self._open(partial(kind, self, channel, sink))
        return inlet

    def caller(self, channel: Channel) -> Caller:
        caller: Caller = self._open(partial(self.ends.caller, self, channel))
        return caller

    def server(self, channel: Channel, service: Service) -> Link:
        server: Link = self._open(partial(self.ends.server, self, channel, service))
        return server

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            self.release(everything)
            for link in list(self._links):
                everything.callback(link.close)

    @abstractmethod
    def release(self, everything: contextlib.ExitStack) -> None:
        """Push what must be closed after the links; the last one pushed is closed first. Called once."""

    # How links find their peers.

    @abstractmethod
    def find(self, role: str, channel: str) -> Iterable[P]:
        """The links of a channel in that role; either channel may have `*` for its instance."""

    @abstractmethod
    def is_own(self, peer: P) -> bool:
        """Whether that link belongs to this transport."""

    # What links use.

    def opening(self, link: BaseLink[Any, P]) -> contextlib.AbstractContextManager[None]:
        """A context for opening a link, which may turn foreign exceptions into a TransportError."""
        return contextlib.nullcontext()

    @abstractmethod
    def do(self, job: Job) -> None:
        """Have a thread of this transport run that job."""

    def left(self, link: BaseLink[Any, P]) -> None:
        """A link was closed."""
        with self._lock:
            if link in self._links:
                self._links.remove(link)
            for work in (link.look, link.tick):
                self._last.pop(work, None)
                self._hindered_since.pop(work, None)

    def check_open(self) -> None:
        if self.closed:
            raise Closed(f"the transport is closed: {self.gone}" if self.gone else "the transport is closed")

    def _open(self, make: Callable[[], L]) -> L:
        self.check_open()
        link: L | None = None
        try:
            link = make()
            with self.opening(link):
                link.open()
                with self._lock:
                    self._links.append(link)  # only now: the receiving thread uses the links in the list
                link.opened()
            self.check_open()
        except BaseException as exc:
            try:
                if link:
                    link.close()
            finally:
                if isinstance(exc, TransportError):
                    self.check_open()  # an error after closing is reported as Closed
            raise
        return link

    # On the thread that receives.

    def look_at_peers(self) -> bool:
        """Have all links look for peers; whether all of them could."""
        return all([self._guarded(link.look, False) for link in list(self._links)])

    def tick_links(self) -> list[float]:
        """Have all links do what is due; the seconds after which links want to tick again."""
        waits = [self._guarded(link.tick, None) for link in list(self._links)]
        return [wait for wait in waits if wait is not None]

    def close_if_abandoned(self) -> bool:
        """Close this transport if the program has ended without doing so; whether that is the case."""
        if not abandoned():
            return False
        log.warning("%s: not closed at the end of the program; closing", self.owner or type(self).__name__)
        self.close()
        return True

    def _guarded(self, work: Callable[[], R], otherwise: R) -> R:
        """Run a method of a link on the receiving thread; an error does not affect other links."""
        try:
            result = work()
        except TransportError as exc:
            if not (self.closed and isinstance(exc, Closed)):
                self._hindered(work, exc)
            return otherwise
        except Exception as exc:
            if self._last.get(work) != repr(exc):
                self._last[work] = repr(exc)
                log.exception("a link failed; trying again")
            return otherwise
        self._last.pop(work, None)
        self._hindered_since.pop(work, None)
        return result

    def _hindered(self, work: object, exc: TransportError) -> None:
        """Log why a link cannot connect, but not before `LEAVING` seconds: its peer may just be leaving."""
        if time.monotonic() - self._hindered_since.setdefault(work, time.monotonic()) < LEAVING:
            log.debug("%s; trying again", exc)
        elif self._last.get(work) != str(exc):
            self._last[work] = str(exc)
            log.warning("%s; trying again", exc)


T = TypeVar("T", bound=BaseTransport[Any])


class BaseLink(SupportsConnected, Generic[T, P]):
    """One end of a channel. `role` names this end and `facing` the other one, in the transport's own words."""

    role: str
    facing: str

    def __init__(self, transport: T, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.stats = Statistics()
        self.closed = threading.Event()
        self._closing = threading.Lock()
        self._news = threading.Event()
        """Set when a peer came or went, and when the link is closed."""
        self._next_look = _FIRST_PAUSE
        """Seconds until the next look for a peer; it grows over all waits until a peer is found."""
        self._reporting = threading.Lock()
        self._reported: set[Hashable] = set()
        self._strangers: set[Hashable] = set()
        """Peers with another contract that have sent a message."""
        self._sparing = Sparing()

    # What adapters fill in.

    def open(self) -> None:
        """Open what the link needs. If it raises, the link is closed."""

    def opened(self) -> None:
        """Called once the receiving thread serves this link."""

    def tick(self) -> float | None:
        """Do what is due; the seconds until the next time, or None for the usual pause of the transport."""
        return None

    def look(self) -> bool:
        """Handle changes of the peers. Returns False if it has to be called again."""
        self.counterparts()
        return True

    def visible(self) -> bool:
        """Whether a peer is visible. Raises ContractMismatch if all visible ones have another contract."""
        return bool(self.counterparts(strict=True))

    def connected(self) -> bool:
        """Whether this end of a topic is connected to all visible ends of the other side."""
        return True

    def withdraw(self) -> None:
        """Tell peers that this end is gone; called once."""

    def release(self) -> None:
        """Release what this link holds; called once, also if it was opened only in part."""

    # The contract of `base.Link`.

    def wait_peer(self, timeout: float) -> bool:
        return self.wait_until(self.visible, timeout)

    def wait_connected(self, timeout: float) -> bool:
        """See `base.SupportsConnected`."""
        return self.wait_until(self.connected, timeout)

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        self._news.set()
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self.release)
            everything.callback(self.withdraw)
            everything.callback(self.transport.left, self)

    # What adapters use.

    def lose(self) -> None:
        """Mark this link as closed, in a forked process."""
        self.closed = threading.Event()  # threads that are missing may hold the old one's lock
        self.closed.set()

    @property
    def longest_pause(self) -> float:
        """Seconds between two looks for a peer that has not come for a while."""
        return _LONGEST_PAUSE

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait at most `timeout` seconds for a condition that peers fulfil. Raises Closed."""
        end = time.monotonic() + timeout
        while True:
            self.check_open()
            self._news.clear()  # before the look, so that later news are not missed
            if condition():
                self._next_look = _FIRST_PAUSE
                return True
            if time.monotonic() >= end:
                return False
            self.await_news(end)

    def await_news(self, end: float) -> None:
        """Wait until a peer comes or goes, or until it is time to look again."""
        self._news.wait(min(self._next_look, max(0.0, end - time.monotonic())))
        self._next_look = min(_GROWTH * self._next_look, self.longest_pause)

    def has_news(self) -> None:
        """A peer came or went: waiting threads look now, and then again at short intervals."""
        self._next_look = _FIRST_PAUSE
        self._news.set()

    def take_turn(self, order: threading.Lock, deadline: float) -> None:
        """Take the lock that threads hold while they send. Raises Timeout."""
        if not order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: {self.transport.gone or 'the link is closed'}")

    def faced(self) -> list[P]:
        """The peers whose channel matches this one."""
        return self.matching(self.facing)

    def matching(self, role: str) -> list[P]:
        """The links of that role whose channel matches this one; for one with `*`, not those of the same transport."""
        name, transport = self.channel.name, self.transport
        found = transport.find(role, name)
        return [peer for peer in found if peer.channel == name or not transport.is_own(peer)]

    def usable(self, peers: list[P]) -> list[P]:
        """The peers that this link can use."""
        return peers

    def counterparts(self, *, strict: bool = False) -> list[P]:
        """The peers with the same contract; the others are reported, once each.

        With `strict`, raises ContractMismatch if there are only others.
        """
        named, mine = self.usable(self.faced()), self.channel.type.fingerprint
        same = [peer for peer in named if peer.fingerprint == mine]
        if len(same) < len(named):
            others = [peer for peer in named if peer.fingerprint != mine]
            for peer in others:
                self.report_mismatch(peer.key, peer.fingerprint, peer.text)
            if strict and not same:
                raise ContractMismatch(mismatch(self.channel, self._type_of(others[0])))
        return same

    def definition_of(self, key: Hashable) -> str:
        """The contract of a peer that does not announce it; "" if it is not known. May wait for a reply of the peer."""
        return ""

    def meet_stranger(self, key: Hashable, fingerprint: int) -> None:
        """Have another thread report, once for each key, a peer with another contract that has sent a message.

        A message may arrive before its sender is visible, and only then is the contract of the sender known.
        """
        if key not in self._strangers and len(self._strangers) < STRANGERS:
            self._strangers.add(key)
            self.transport.do(partial(self._report_stranger, key, fingerprint))

    def _report_stranger(self, key: Hashable, fingerprint: int) -> None:
        if self.closed.is_set():
            return
        self.counterparts()  # reports those that are visible, with their contracts
        if all(peer.fingerprint != fingerprint for peer in self.faced()):
            self.report_mismatch(key, fingerprint)

    def report_mismatch(self, key: Hashable, fingerprint: int, text: str = "") -> None:
        """Count and log, once for each key, that a peer has another contract."""
        with self._reporting:
            if key in self._reported or len(self._reported) >= STRANGERS:
                return
            self._reported.add(key)
        if self._sparing.may_tell():
            other = TypeRef("", fingerprint, text or self.definition_of(key))
            log.error("%s", mismatch(self.channel, other))
        self.stats.mismatched += 1  # after logging, so that the log explains the count

    def malformed(self, why: object) -> None:
        """Count a message that is not valid; the first one is logged."""
        if self.stats.malformed == 0:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)
        self.stats.malformed += 1

    def _type_of(self, peer: P) -> TypeRef:
        return TypeRef("", peer.fingerprint, peer.text or self.definition_of(peer.key))


def accepted(channel: Channel, reply: Reply) -> Reply:
    """A reply; raises ContractMismatch if the server refused the request for its contract."""
    if reply.status is Status.MISMATCH:
        payload = reply.payload or b""
        data = bytes(payload[0]) if isinstance(payload, list) else bytes(payload)
        raise ContractMismatch(mismatch(channel, TypeRef("", 0, data.decode(errors="replace"))))
    return reply


def persist(send: Callable[[], bool], end: float, still: Callable[[], object], closed: threading.Event) -> bool:
    """Try to send until `end`; `still` is called meanwhile, and may raise. For queues that do not report free space."""
    pause, patient = _FIRST_ATTEMPT, time.monotonic() + _SHORTLY
    while not send():
        left = end - time.monotonic()
        if left <= 0:
            return False
        still()
        if pause >= _SHORT_PAUSE:
            about_to_block()
        closed.wait(min(pause, left))
        pause = min(2 * pause, _SHORT_PAUSE if time.monotonic() < patient else _LONG_PAUSE)
    return True
