"""The client's links, a command outlet and a caller, and the objects that they invoke."""

from __future__ import annotations

import contextlib
import itertools
import logging
import time
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

from ...errors import (
    ConfigurationError,
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
from ..directory import Entry, Member
from ..leader_followers import STUCK
from ..link import accepted
from .library import (
    CONNECTING_MS,
    FORCEFULLY,
    IDEMPOTENT,
    NORMAL,
    SLICE,
    InvocationTimeout,
    LocalException,
    NoSuchHost,
    NotServed,
    Unknown,
    as_transport_error,
    error,
    gone,
    kind_of,
    wait_for,
    why,
)
from .messages import RC, RC_MAX, failure_told, reply_of, request_head

if TYPE_CHECKING:
    from .transport import IceTransport

log = logging.getLogger("robocomp.transport.ice")

IDLE_CONNECTIONS = 8
"""Maximum number of idle connections to one object that are kept for later calls."""

_PING_PAUSE = 0.2
"""Seconds between two pings of a configured object."""

_PING_TIMEOUT = 1.0
"""Seconds to wait for the answer to a ping."""

_MOST_PROXIES = 64
"""Maximum number of cached proxies that differ only in their timeout."""

_DEFAULT_LIMIT = 1024 * 1024
"""Ice's default for the maximum size of a message, in bytes."""

_SHORTLY = 0.002
"""Seconds between two attempts to end blocking calls."""

_numbers = itertools.count(1)
"""Numbers for proxies, which get different connections by them, and for calls."""


class Connection:
    """A connection to an object, with one proxy for each timeout."""

    def __init__(self, proxy: Any) -> None:
        self._proxy = proxy.ice_connectionId(f"rc{next(_numbers)}")
        self._within: dict[int, Any] = {}
        self.connected = False
        """Whether a connection was ever established."""
        self.begun, self.heard = time.monotonic(), 0.0
        """When it was made, and when the last reply to an asynchronous call came."""

    def within(self, seconds: float) -> Any:
        """A proxy with this timeout for its invocations."""
        ms = max(1, int(seconds * 1000) + 1)
        proxy = self._within.get(ms)
        if proxy is None:
            if len(self._within) >= _MOST_PROXIES:
                self._within.clear()
            proxy = self._within[ms] = self._proxy.ice_invocationTimeout(ms)
        return proxy

    def connect(self, wait: Callable[[], object], seconds: float) -> None:
        """Connect; calls `wait` repeatedly, which may raise. Raises Ice's exceptions."""
        invocation = self.within(seconds).ice_getConnectionAsync()
        wait_for(invocation, wait)
        invocation.result()
        self.connected = True

    def close(self) -> None:
        """Close; calls that wait on it get an exception of Ice."""
        for proxy in list(self._within.values()):  # all of them use the same connection
            with contextlib.suppress(LocalException):
                connection = proxy.ice_getCachedConnection()
                if connection:
                    connection.close(FORCEFULLY)


class Peer:
    """An object to invoke: a shared connection for asynchronous calls, and connections for blocking ones."""

    def __init__(self, transport: IceTransport, member_id: str, address: str) -> None:
        """`address` is its proxy, preceded by its maximum size of a message, if that is known."""
        self.id, self.address, self._transport = member_id, address, transport
        self.key = member_id, address
        limit, _, named = address.partition(" ")
        known = limit.isdecimal()
        self.named = named if known else address
        self.limit = min(int(limit), transport.limit) if known else transport.limit
        self.flags = Flag.NONE
        """Flags of all requests to it."""
        self.closed = False
        self._told = ""
        with as_transport_error(f"the proxy {self.named!r}"):
            self._proxy = transport.communicator.stringToProxy(self.named)
        if self._proxy is None:
            raise ConfigurationError(f"the proxy {self.named!r} names no object")
        self._proxy = self._proxy.ice_twoway()
        self.identity: str = self._proxy.ice_getIdentity().name
        self.shared, self.oneway = Connection(self._proxy), Connection(self._proxy.ice_oneway())
        self._idle: list[Connection] = []

    def alive(self) -> bool:
        return not self.closed and (not self.id or self._transport.directory.alive(self.id))

    def take(self, wait: Callable[[], object], seconds: float) -> Connection:
        """A connection for the calling thread only, which must `give` it back or close it."""
        try:
            connection = self._idle.pop()
        except IndexError:
            connection = Connection(self._proxy)
        if not connection.connected:
            try:
                connection.connect(wait, seconds)
            except InvocationTimeout:  # Ice goes on connecting: the next call waits for that
                self.give(connection)
                raise
        return connection

    def give(self, connection: Connection) -> None:
        if len(self._idle) < IDLE_CONNECTIONS:
            self._idle.append(connection)
        else:
            connection.close()
        if self.closed:
            self._close_idle()

    def replace_if_silent(self, connection: Connection, since: float) -> None:
        """Replace the shared connection after a timeout, if nothing has come since the call began.

        A host that was switched off does not close its connections. Earlier calls may still get replies by the old
        one. A connection that never had a reply may still be connecting, so it is kept for a while.
        """
        if self.shared is not connection or connection.heard >= since:
            return
        if connection.heard or time.monotonic() - connection.begun >= CONNECTING_MS / 1000:
            self.shared = Connection(self._proxy)

    def is_there(self, wait: Callable[[], object], seconds: float) -> bool:
        """Ping the object."""
        connection, begun = self.shared, time.monotonic()
        invocation = connection.within(seconds).ice_pingAsync()
        try:
            wait_for(invocation, wait)
            invocation.result()
        except InvocationTimeout:
            self.replace_if_silent(connection, begun)
            return False
        except LocalException as exc:
            self._log_reason(exc)
            return False
        return True

    def _log_reason(self, exc: Any) -> None:
        """Log, once, that a name is probably wrong."""
        if isinstance(exc, NotServed):
            reason = f"the program there has no object `{self.identity}`"
        elif isinstance(exc, NoSuchHost):
            reason = why(exc)
        else:
            return
        if reason != self._told:
            self._told = reason
            log.warning("%s: %s; waiting for it", self.named, reason)

    def close(self) -> None:
        self.closed = True
        self.shared.close()
        self.oneway.close()
        self._close_idle()

    def _close_idle(self) -> None:
        """Another thread may give back a connection, or close some, meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()


class ClientLink(FindingLink["IceTransport", Peer, str]):
    _flags = Flag.NONE

    def __init__(self, transport: IceTransport, channel: Channel) -> None:
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


class CommandOutlet(CommandingLink["IceTransport", Peer, str], ClientLink):
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


class Caller(CallingLink["IceTransport", Peer, str], ClientLink):
    def __init__(self, transport: IceTransport, channel: Channel) -> None:
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
