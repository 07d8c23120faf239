"""Base classes of the links: a liveliness token announces a link, and the table lists its peers."""

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
    Channel,
)
from ..exclusive import Claim
from ..leader_followers import STUCK, CommandLane
from ..ledger import Ledger
from ..limits import STRANGERS
from ..link import BaseLink
from ..senders import From
from .messages import BoundedQueue, Message, direct
from .table import USING, Token, owned, same_transport

if TYPE_CHECKING:
    from .core import ZenohCore

log = logging.getLogger("robocomp.transport.zenoh")

INBOX = 10_000
"""Maximum number of messages that wait at one inlet; further ones are dropped."""


class Link(BaseLink["ZenohCore", Token]):
    """One end of a channel: a liveliness token announces it, and the table lists its peers."""

    traits = "-"

    def __init__(self, transport: ZenohCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.id = transport.new_id()
        self.key = transport.key("rc", channel.name)
        self._token: zenoh.LivelinessToken | None = None
        self._claim: Claim | None = None
        self._declared: list[Any] = []
        self._knows_earlier = False
        self._texts: dict[Hashable, str] = {}

    def opened(self) -> None:
        self.transport.links_by_id[self.id] = self  # before the token: peers answer it at once
        traits = owned(self.transport.owner.rpartition("/")[2]) if self.role in USING else self.traits
        token = Token(self.role, traits, self.channel.type.fingerprint, os.getpid(), self.id, self.channel.name)
        self._token = self.transport.session.liveliness().declare_token(self.transport.key("rc_lv", token.key_expr()))
        self.look()

    def signed(self, client: int, payload: Any) -> Any:
        """The payload of a request, with its sender if the channel wants that."""
        return From(partial(self._owner_of, client), payload) if self.channel.signed else payload

    def _owner_of(self, client: int) -> str:
        """The instance that opened a client; "" if it is not ours."""
        found = self.transport.table.find(self.facing, self.channel.name)
        return next((token.owner for token in found if same_transport(token.link, client)), "")

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        """The reply to an inquiry of a peer."""
        return [(b"", self.channel.type.text.encode())] if what == "text" else []

    def acknowledged(self, by: int, sequence: int) -> None:
        """A peer took our messages up to that number. Called on a Zenoh thread."""

    def withdraw(self) -> None:
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            for declared in reversed((self._token, *self._declared)):
                if declared:
                    everything.callback(self._undeclare, declared)

    def _undeclare(self, declared: Any) -> None:
        """Retry while another thread uses the object, which Zenoh refuses. No use begins after the link is closed."""
        end = time.monotonic() + STUCK
        while True:
            try:
                return declared.undeclare()  # type: ignore[no-any-return]  # None
            except zenoh.ZError:  # the session may be closed already
                return None
            except RuntimeError as exc:
                if time.monotonic() >= end:
                    log.warning("%s: still in use after %g s; not undeclared: %s", self.channel.name, STUCK, exc)
                    return None
                time.sleep(0.001)

    def declare(self, declared: Any) -> Any:
        """Have `withdraw` undeclare this."""
        self._declared.append(declared)
        return declared

    def wait_for_earlier(self) -> None:
        """Wait, the first time, until the table has every link that was announced before this one."""
        if not self._knows_earlier:
            with self.using_the_session():
                self.transport.watching.wait_for_earlier(self.role, self.channel.name)
            self._knows_earlier = True

    def counterparts(self, *, strict: bool = False) -> list[Token]:
        """As in the base class; with `strict`, also raises Refused if our keys allow none of the visible peers."""
        if strict:
            faced = self.faced()
            if faced and not any(map(self.transport.may_use, faced)):
                self._report_refused(faced)
                raise Refused(_refused(faced[0].channel))
        return super().counterparts(strict=strict)

    def usable(self, peers: list[Token]) -> list[Token]:
        """The peers that our keys allow and that can be reached."""
        allowed = [token for token in peers if self.transport.may_use(token)]
        if len(allowed) < len(peers):
            self._report_refused([token for token in peers if token not in allowed])
        return [token for token in allowed if self.transport.reaches(token)]

    def _report_refused(self, tokens: Iterable[Token]) -> None:
        """Log, once for each link, that our keys do not allow it."""
        with self._reporting:
            new = [token for token in tokens if token.link not in self._reported][: STRANGERS - len(self._reported)]
            self._reported.update(token.link for token in new)
        for token in new:
            log.error("%s", _refused(token.channel))

    @contextlib.contextmanager
    def using_the_session(self) -> Iterator[None]:
        """Turn Zenoh's errors into a TransportError, or into Closed if the link or the transport is closed."""
        try:
            yield
        except zenoh.ZError as exc:
            raise self.failed(exc) from exc

    def failed(self, why: Exception) -> TransportError:
        """The exception for an error of the session."""
        if self.closed.is_set() or self.transport.closed:
            return Closed(f"{self.channel.name}: the link is closed")
        return TransportError(f"zenoh: {self.channel.name}: {why}")

    def definition_of(self, key: Hashable) -> str:
        """The contract of a link, asked from the link itself."""
        if not self._texts.get(key) and isinstance(key, int):
            self._texts[key] = self.transport.contract(key)
        return self._texts.get(key, "")


def _refused(channel: str) -> str:
    return (
        f"{channel}: the keys of this process do not allow it, so the router drops its messages; "
        "connect the two components in the network file, or for a tool list the operation there as in "
        f"`allow {channel};`, then make the keys again: rcdeploy keys"
    )


class Receiving(Link):
    """An inlet. Messages go from the inbox to the sink's queue when it has room, and are then acknowledged."""

    lane: CommandLane
    _ledger: Ledger

    def __init__(self, transport: ZenohCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._inbox = BoundedQueue(INBOX)
        self._taking = threading.Lock()
        self._scheduled = False
        self._taken: dict[int, int] = {}
        """For each sender, the sequence number to acknowledge next."""

    def open(self) -> None:
        origin = zenoh.Locality.REMOTE if ANY in self.channel.name else zenoh.Locality.ANY
        subscribe = self.transport.session.declare_subscriber
        self.declare(subscribe(self.key, direct(self._on_sample), allowed_origin=origin))

    def take(self, message: Message) -> tuple[int, int] | None:
        """Queue a message for the sink; there is room. Returns the sender and sequence number to acknowledge."""
        raise NotImplementedError

    def release(self) -> None:
        self.lane.close()

    def _on_sample(self, sample: zenoh.Sample) -> None:
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
                        self.transport.do(self._acknowledge)  # runs after this job, or during it if the sink is slow
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
