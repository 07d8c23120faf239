"""What all ends of channels have in common: announced by a token, and looking in the table for those they face."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import zenoh

from ...errors import Closed, ContractMismatch, DecodeError, Timeout, TransportError
from ...wire.codec import Payload
from ...wire.names import ANY
from ..base import (
    Channel,
    Statistics,
    TypeRef,
    mismatch,
)
from ..crew import STUCK, Lane
from ..exclusive import Claim
from ..ledger import Ledger
from ..sparing import Sparing
from .messages import Inbox, Message, direct
from .table import Token

if TYPE_CHECKING:
    from .transport import ZenohTransport

log = logging.getLogger("robocomp.transport.zenoh")

TICK = 0.1
"""Seconds between two looks at sinks that take long, and whether the router needs a new home."""

IDLE_TICK = 0.5
"""The same where nobody subscribes and the router has a home: there is neither. What is due is not kept waiting."""


STRANGERS = 100
"""So many that mean something else by a channel's name are told about; the others are ignored."""

INBOX = 10_000
"""Messages that may wait for the crew at one inlet; more are dropped."""


class Link:
    """One end of a channel: announced by a token, and looking in the table for those it faces."""

    role: str
    facing: str
    traits = "-"
    glance = 0.2
    """Seconds after which who waits for the other side looks for what the table does not tell: that it is closed."""

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
        self._sparing = Sparing()
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
        end, table = time.monotonic() + timeout, self.transport.table
        while True:
            self.check_open()
            version = table.version
            if self.visible():
                return True
            left = end - time.monotonic()
            if left <= 0:
                return False
            with table.changed:
                if table.version == version:
                    table.changed.wait(min(left, self.glance))

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
            if declared:
                self._undeclare(declared)
        self.release()

    def _undeclare(self, declared: Any) -> None:
        """Zenoh refuses that while another thread uses the object; none begins to, once the link is closed."""
        end = time.monotonic() + STUCK
        while True:
            try:
                return declared.undeclare()  # type: ignore[no-any-return]  # None
            except zenoh.ZError:  # the session may have been closed under us
                return None
            except RuntimeError as exc:
                if time.monotonic() >= end:
                    log.warning("%s: still in use after %g s; left as it is: %s", self.channel.name, STUCK, exc)
                    return None
                time.sleep(0.001)

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
        named = [token for token in self.faced() if self.transport.reaches(token)]
        same = [token for token in named if token.fingerprint == self.channel.type.fingerprint]
        if len(same) == len(named):
            return same
        others = [token for token in named if token.fingerprint != self.channel.type.fingerprint]
        for token in others:
            self.report_mismatch(token.link, token.fingerprint)
        if strict and not same:
            raise ContractMismatch(mismatch(self.channel, self._type_of(others[0].link, others[0].fingerprint)))
        return same

    def faced(self) -> list[Token]:
        """Those whose channels meet ours. With `*`, none of our own transport: Zenoh tells them nothing of us."""
        return [
            token
            for token in self.transport.table.find(self.facing, self.channel.name)
            if token.channel == self.channel.name or not self.transport.owns(token.link)
        ]

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: the link is closed")

    @contextlib.contextmanager
    def using_the_session(self) -> Iterator[None]:
        """What goes wrong in it is a TransportError; or Closed, if it went wrong because of that."""
        try:
            yield
        except zenoh.ZError as exc:
            raise self.failed(exc) from exc

    def failed(self, why: Exception) -> TransportError:
        """What to raise when the session did."""
        if self.closed.is_set() or self.transport.closed:
            return Closed(f"{self.channel.name}: the link is closed")
        return TransportError(f"zenoh: {self.channel.name}: {why}")

    def report_mismatch(self, link: int, fingerprint: int) -> None:
        """Count and log, once, that another link means something else. May wait for its answer."""
        with self._closing:
            if link in self._reported or len(self._reported) >= STRANGERS:
                return
            self._reported.add(link)
        if self._sparing.may_tell():
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
            answers, _ = self.transport.inquire(link, "text")
            self._texts[link] = answers[0].payload.to_bytes().decode(errors="replace") if answers else ""
        return TypeRef("", fingerprint, self._texts[link])


@contextlib.contextmanager
def within(lock: threading.Lock, late: Timeout, end: float) -> Iterator[None]:
    """Hold a lock; raises `late` if that cannot be had until `end`."""
    if not lock.acquire(timeout=max(0.0, end - time.monotonic())):
        raise late
    try:
        yield
    finally:
        lock.release()


class Receiving(Link):
    """An inlet: messages go from the inbox into the lane as it has room, and are acknowledged then."""

    lane: Lane
    _ledger: Ledger

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._inbox = Inbox(INBOX)
        self._taking = threading.Lock()
        self._scheduled = False
        self._taken: dict[int, int] = {}
        """Of each sender the number up to which it has to be told that its messages were taken."""

    def open(self) -> None:
        from_whom = zenoh.Locality.REMOTE if ANY in self.channel.name else zenoh.Locality.ANY
        subscribe = self.transport.session.declare_subscriber
        self.declare(subscribe(self.key, direct(self._hear), allowed_origin=from_whom))

    def take(self, message: Message) -> tuple[int, int] | None:
        """Put a message into the lane, which is not full; its sender and number, once it need not come again."""
        raise NotImplementedError

    def release(self) -> None:
        self.lane.close()

    def _hear(self, sample: zenoh.Sample) -> None:
        if not self._inbox.put(Message(sample.attachment, sample.payload, time.monotonic())):
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

    def _take(self, message: Message) -> tuple[int, int] | None:
        try:
            return self.take(message)
        except DecodeError as exc:
            self.malformed(exc)
            return None
