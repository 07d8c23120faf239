"""What all ends of channels have in common: announced by a token, and looking in the table for those they face."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Hashable, Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import zenoh

from ...errors import Closed, DecodeError, Refused, TransportError
from ...wire.codec import Payload
from ...wire.names import ANY
from ..base import (
    LONGEST_CONTRACT,
    Channel,
)
from ..exclusive import Claim
from ..leader_followers import STUCK, CommandLane
from ..ledger import Ledger
from ..limits import STRANGERS
from ..link import BaseLink
from .messages import Inbox, Message, direct
from .table import Token

if TYPE_CHECKING:
    from .transport import ZenohTransport

log = logging.getLogger("robocomp.transport.zenoh")

TICK = 0.1
"""Seconds between two looks at sinks that take long, and whether the router needs a new home."""

IDLE_TICK = 0.5
"""The same where nobody subscribes and the router has a home: there is neither. What is due is not kept waiting."""


INBOX = 10_000
"""Messages that may wait for the crew at one inlet; more are dropped."""


class Link(BaseLink["ZenohTransport", Token]):
    """One end of a channel: announced by a token, and looking in the table for those it faces."""

    traits = "-"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.id = transport.new_id()
        self.key = transport.key("rc", channel.name)
        self._token: zenoh.LivelinessToken | None = None
        self._claim: Claim | None = None
        self._declared: list[Any] = []
        self._met_earlier = False
        self._texts: dict[Hashable, str] = {}

    def opened(self) -> None:
        self.transport.lines[self.id] = self  # before others hear of it, and tell it what they have to
        token = Token(self.role, self.traits, self.channel.type.fingerprint, os.getpid(), self.id, self.channel.name)
        self._token = self.transport.session.liveliness().declare_token(self.transport.key("rc_lv", token.key_expr()))
        self.look()

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        """What this link tells others who ask for it."""
        return [(b"", self.channel.type.text.encode())] if what == "text" else []

    def acknowledged(self, by: int, sequence: int) -> None:
        """On a thread of Zenoh: a message of ours was taken."""

    def withdraw(self) -> None:
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            for declared in reversed((self._token, *self._declared)):
                if declared:
                    everything.callback(self._undeclare, declared)

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

    def declare(self, declared: Any) -> Any:
        """Undeclare this at the end."""
        self._declared.append(declared)
        return declared

    def meet_earlier(self) -> None:
        """Return once the table has all who were announced before this link was. Does so once."""
        if not self._met_earlier:
            with self.using_the_session():
                self.transport.watching.meet_earlier(self.role, self.channel.name)
            self._met_earlier = True

    def counterparts(self, *, strict: bool = False) -> list[Token]:
        """The same; with `strict`, also raises Refused if our keys are for none of those that are there."""
        if strict:
            faced = self.faced()
            if faced and not any(map(self.transport.may_use, faced)):
                self._report_refused(faced)
                raise Refused(_refused(faced[0].channel))
        return super().counterparts(strict=strict)

    def usable(self, peers: list[Token]) -> list[Token]:
        """Those that our keys let us use, and that can be reached."""
        allowed = [token for token in peers if self.transport.may_use(token)]
        if len(allowed) < len(peers):
            self._report_refused([token for token in peers if token not in allowed])
        return [token for token in allowed if self.transport.reaches(token)]

    def _report_refused(self, tokens: Iterable[Token]) -> None:
        """Log, once each, that our keys do not let us use what is there."""
        with self._reporting:
            new = [token for token in tokens if token.link not in self._reported][: STRANGERS - len(self._reported)]
            self._reported.update(token.link for token in new)
        for token in new:
            log.error("%s", _refused(token.channel))

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

    def meet_stranger(self, link: int, fingerprint: int) -> None:
        """Report a mismatch without waiting."""
        if link not in self._reported and len(self._reported) < STRANGERS:
            self.transport.do(partial(self.report_mismatch, link, fingerprint))

    def definition_of(self, key: Hashable) -> str:
        """What another link means by the name, in its own words."""
        if not self._texts.get(key) and isinstance(key, int):
            answers, _ = self.transport.inquire(key, "text")
            octets = answers[0].payload.to_bytes() if answers else b""
            self._texts[key] = octets[: LONGEST_CONTRACT + 1].decode(errors="replace")
        return self._texts.get(key, "")


def _refused(channel: str) -> str:
    return (
        f"{channel}: the keys of this process are not for it, so the router does not let it through; "
        "wire the two in the network's file, and make its keys again: rcdeploy keys"
    )


class Receiving(Link):
    """An inlet: messages go from the inbox into the lane as it has room, and are acknowledged then."""

    lane: CommandLane
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
