"""The client's links: a command outlet and a caller."""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Hashable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

from ...errors import (
    DecodeError,
    Refused,
    Timeout,
    TransportError,
    Unreachable,
)
from ...wire.codec import MAX_BYTES, Payload
from ...wire.header import Flag, clock, pack_request
from .. import iceoptions
from ..base import Channel, Reply, Status
from ..client import CallingLink, CommandingLink, FindingLink
from ..leader_followers import STUCK
from ..link import accepted
from ..members import Entry, Member
from .library import (
    IDEMPOTENT,
    NORMAL,
    SLICE,
    InvocationTimeout,
    LocalException,
    NotServed,
    Unknown,
    error,
    gone,
    kind_of,
    wait_for,
    why,
)
from .messages import RC, RC_MAX, failure_told, reply_of, request_head
from .peer import Connection, Peer

if TYPE_CHECKING:
    from .core import IceCore

log = logging.getLogger("robocomp.transport.ice")

_PING_PAUSE = 0.2
"""Seconds between two pings of a configured object."""

_PING_TIMEOUT = 1.0
"""Seconds to wait for the answer to a ping."""

_DEFAULT_LIMIT = 1024 * 1024
"""Ice's default for the maximum size of a message, in bytes."""

_SHORTLY = 0.002
"""Seconds between two attempts to end blocking calls."""

_numbers = itertools.count(1)
"""Numbers for calls."""


class ClientLink(FindingLink["IceCore", Peer, str]):
    _flags = Flag.NONE

    def __init__(self, transport: IceCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._operation = iceoptions.operation_of(channel.name)
        self._mode = IDEMPOTENT if channel.idempotent else NORMAL
        self._elsewhere = transport.options.proxy_of(channel.name) or ""
        self._told = {} if transport.limit == MAX_BYTES else {RC_MAX: str(transport.limit)}

    def open(self) -> None:
        if self._elsewhere:
            self.transport.peer("", self._elsewhere)  # raises if it is not a proxy
        super().open()

    def reach(self, member: Member, entry: Entry) -> Peer:
        peer = self.transport.peer(member.id, entry.address)
        peer.flags = Flag.SENT if entry.traits == clock() else Flag.NONE
        return peer

    def where(self, entry: Entry) -> str:
        return entry.address

    def server(self, *, fresh: bool = False) -> tuple[Peer, str]:
        if self._elsewhere:
            self.check_open()
            return self.transport.peer("", self._elsewhere), self._elsewhere
        return super().server(fresh=fresh)

    def visible(self) -> bool:
        if not self._elsewhere:
            return super().visible()
        peer, _ = self.server()
        return peer.is_there(self.check_open, _PING_TIMEOUT)

    def wait_peer(self, timeout: float) -> bool:
        if not self._elsewhere:
            return super().wait_peer(timeout)
        end = time.monotonic() + timeout
        while True:
            peer, _ = self.server()
            if peer.is_there(self.check_open, min(_PING_TIMEOUT, max(SLICE, end - time.monotonic()))):
                return True
            left = end - time.monotonic()
            if left <= 0:
                return False
            self.closed.wait(min(_PING_PAUSE, left))

    def look(self) -> bool:
        return bool(self._elsewhere) or super().look()

    def refuses(self, peer: Peer, reply: Reply) -> bool:
        """Whether the object refused our operation because its server has left."""
        if self._elsewhere or not self.lost(peer):
            return False
        self.transport.drop(peer)
        return True

    def context(self, peer: Peer, remaining: float, number: int) -> dict[str, str]:
        flags = self._flags | peer.flags
        request = pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)
        return {RC: request.hex(), **self._told}

    def check_size(self, peer: Peer, payload: bytes, context: dict[str, str]) -> None:
        """Raise if a message is too large. Otherwise the server would close the connection."""
        size = len(payload) + request_head(peer.identity, self._operation, context)
        if size > peer.limit:
            raise TransportError(
                f"{self.channel.name}: a message of {size} bytes is too large: {peer.named} and we allow "
                f"{peer.limit}; raise `message_size_max` (Ice.MessageSizeMax) of both sides"
            )

    def outcome(self, peer: Peer, exc: Any, deadline: float, size: int) -> Reply:
        """The reply that an exception of Ice stands for. Raises TransportError if it does not stand for one."""
        if isinstance(exc, NotServed):
            if not peer.id:  # a configured address, which may be that of any program
                raise Refused(f"{self.channel.name}: {peer.named} does not serve it") from exc
            return Reply(Status.REFUSED)
        if isinstance(exc, Unknown):
            return failure_told(exc.unknown)
        self.check_open()  # Closed, if that is the cause
        if isinstance(exc, InvocationTimeout):
            raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s") from exc
        if kind_of(exc) is Unreachable:
            hint = ""
            if not peer.id and size > _DEFAULT_LIMIT:
                hint = f"; or it does not accept a message of {size} bytes: see its Ice.MessageSizeMax"
            raise Unreachable(f"{self.channel.name}: {peer.named} is not there: {why(exc)}{hint}") from exc
        raise error(self.channel.name, exc) from exc

    def decoded(self, ok: bool, payload: bytes) -> Reply:
        """The reply in an Ice answer. Raises TransportError."""
        if ok:
            return Reply(Status.OK, payload)
        try:
            reply = reply_of(ok, payload)
        except DecodeError as exc:
            self.malformed(exc)
            raise TransportError(f"{self.channel.name}: malformed reply: {exc}") from exc
        if reply is None:
            raise Unreachable(f"{self.channel.name}: its server left")
        return accepted(self.channel, reply)


class CommandOutlet(CommandingLink["IceCore", Peer, str], ClientLink):
    _flags = Flag.ONEWAY

    def command(self, peer: Peer, where: str, payload: Payload, end: float, deadline: float) -> None:
        context = self.context(peer, deadline, next(self._sequence))
        self.check_size(peer, payload, context)
        try:
            proxy = peer.oneway.within(max(0.0, end - time.monotonic()))
            sending = proxy.ice_invokeAsync(self._operation, self._mode, payload, context)
            if not gone(sending):
                wait_for(sending, partial(self._still, peer, sending))
                sending.result()
        except LocalException as exc:
            self.outcome(peer, exc, deadline, len(payload))

    def _still(self, peer: Peer, sending: Any) -> None:
        try:
            self.still(peer)
        except TransportError:
            sending.cancel()
            raise


class Caller(CallingLink["IceCore", Peer, str], ClientLink):
    def __init__(self, transport: IceCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._waiting_on: set[Connection] = set()
        """The connections on which blocking calls wait."""

    def met(self, peer: Peer) -> None:
        """Ice reports the end of each call, so the peer need not be watched."""

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        self.check_open()
        peer, _ = self.server()
        number = number or next(self._sequence)
        context = self.context(peer, deadline, number)
        self.check_size(peer, payload, context)
        key = next(_numbers)
        future = self._pending.add(key, deadline)
        connection, begun = peer.shared, time.monotonic()
        try:
            invocation = connection.within(deadline).ice_invokeAsync(self._operation, self._mode, payload, context)
        except LocalException as exc:
            future.cancel()
            raise error(self.channel.name, exc) from exc
        future.add_done_callback(lambda _: _forget(invocation))
        ended = partial(self._ended, key, peer, connection, invocation, begun, deadline, len(payload))
        invocation.add_done_callback(lambda _: self.transport.do(ended))
        return future

    def release(self) -> None:
        super().release()
        end = time.monotonic() + STUCK
        while self._waiting_on and time.monotonic() < end:  # repeat: calls may just be starting
            for connection in list(self._waiting_on):
                connection.close()
            time.sleep(_SHORTLY)

    def ask_peer(self, peer: Peer, where: str, payload: bytes, number: int, end: float, deadline: float) -> Reply:
        number = number or next(self._sequence)
        try:
            connection = peer.take(self.check_open, end - time.monotonic())
        except LocalException as exc:
            return self.outcome(peer, exc, deadline, 0)
        self._waiting_on.add(connection)
        try:
            self.check_open()
            left = end - time.monotonic()
            context = self.context(peer, left, number)
            self.check_size(peer, payload, context)
            proxy = connection.within(left)
            ok, answer = proxy.ice_invoke(self._operation, self._mode, payload, context)
        except LocalException as exc:
            if isinstance(exc, (NotServed, Unknown)):  # the connection works
                peer.give(connection)
            else:
                connection.close()
            return self.outcome(peer, exc, deadline, len(payload))
        except BaseException:
            connection.close()
            raise
        finally:
            self._waiting_on.discard(connection)
        peer.give(connection)
        return self.decoded(ok, answer)

    def _ended(
        self,
        key: Hashable,
        peer: Peer,
        connection: Connection,
        invocation: Any,
        begun: float,
        deadline: float,
        size: int,
    ) -> None:
        """Settle an asynchronous call. Runs on one of our threads."""
        try:
            try:
                ok, answer = invocation.result()
                connection.heard = time.monotonic()
                reply = self.decoded(ok, answer)
            except LocalException as exc:
                if isinstance(exc, InvocationTimeout):
                    peer.replace_if_silent(connection, begun)
                reply = self.outcome(peer, exc, deadline, size)
            if reply.status is Status.REFUSED and self.refuses(peer, reply):
                raise self._left()
        except TransportError as exc:
            self._pending.fail(key, exc)
        else:
            self._pending.settle(key, reply)


def _forget(invocation: Any) -> None:
    """Drop the reply to a call that ended. The request is still sent."""
    if not invocation.done():
        invocation.add_sent_callback(lambda *_: invocation.cancel())
