"""Who commands and who calls, and the objects they ask."""

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
from ...wire import names
from ...wire.codec import MAX_BYTES, Payload
from ...wire.header import Flag, clock, pack_request
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

IDLE_STREAMS = 8
"""Connections to one object that are kept for who asks next."""

_AGAIN = 0.2
"""Seconds between two questions whether somebody elsewhere is there."""

_PING = 1.0
"""Seconds within which that is answered."""

_TIMEOUTS = 64
"""So many proxies that differ in their timeout alone are kept."""

_USUAL_MOST = 1024 * 1024
"""Octets of a message: what Ice takes unless told otherwise."""

_SHORTLY = 0.002
"""Seconds between two attempts to call back who waits for an answer."""

_numbers = itertools.count(1)
"""Of proxies, since those with different numbers have different connections; and of calls."""


class Line:
    """A connection to an object: a proxy for each time after which who uses it gives up."""

    def __init__(self, proxy: Any) -> None:
        self._proxy = proxy.ice_connectionId(f"rc{next(_numbers)}")
        self._within: dict[int, Any] = {}
        self.connected = False
        """Whether it has ever been."""
        self.begun, self.heard = time.monotonic(), 0.0
        """When it was made, and when the last answer came by it, of those that nobody waited for."""

    def within(self, seconds: float) -> Any:
        """A proxy whose invocations end by then."""
        ms = max(1, int(seconds * 1000) + 1)
        proxy = self._within.get(ms)
        if proxy is None:
            if len(self._within) >= _TIMEOUTS:
                self._within.clear()
            proxy = self._within[ms] = self._proxy.ice_invocationTimeout(ms)
        return proxy

    def connect(self, wait: Callable[[], object], seconds: float) -> None:
        """`wait` is called meanwhile, and may raise. Raises Ice's exceptions."""
        asked = self.within(seconds).ice_getConnectionAsync()
        wait_for(asked, wait)
        asked.result()
        self.connected = True

    def close(self) -> None:
        """Whoever waits for an answer by it gets an exception of Ice's."""
        for proxy in list(self._within.values()):  # each knows the connection that it used, which is the same
            with contextlib.suppress(LocalException):
                connection = proxy.ice_getCachedConnection()
                if connection:
                    connection.close(FORCEFULLY)


class Peer:
    """An object that is asked: a connection for all who do not wait, and connections for those who do."""

    def __init__(self, transport: IceTransport, member_id: str, address: str) -> None:
        """`address` is its proxy, after the octets of the largest message that it takes, if these are known."""
        self.id, self.address, self._transport = member_id, address, transport
        self.key = member_id, address
        limit, _, named = address.partition(" ")
        known = limit.isdecimal()
        self.named = named if known else address
        self.limit = min(int(limit), transport.limit) if known else transport.limit
        self.flags = Flag.NONE
        """Of all requests."""
        self.closed = False
        self._told = ""
        with as_transport_error(f"the proxy {self.named!r}"):
            self._proxy = transport.communicator.stringToProxy(self.named)
        if self._proxy is None:
            raise ConfigurationError(f"the proxy {self.named!r} names no object")
        self._proxy = self._proxy.ice_twoway()
        self.identity: str = self._proxy.ice_getIdentity().name
        self.shared, self.oneway = Line(self._proxy), Line(self._proxy.ice_oneway())
        self._idle: list[Line] = []

    def alive(self) -> bool:
        return not self.closed and (not self.id or self._transport.directory.alive(self.id))

    def take(self, wait: Callable[[], object], seconds: float) -> Line:
        """A connection for the calling thread alone; it must `give` it back, or close it."""
        try:
            line = self._idle.pop()
        except IndexError:
            line = Line(self._proxy)
        if not line.connected:
            try:
                line.connect(wait, seconds)
            except InvocationTimeout:  # it is still attempted: who asks next waits for that, rather than begin another
                self.give(line)
                raise
        return line

    def give(self, line: Line) -> None:
        if len(self._idle) < IDLE_STREAMS:
            self._idle.append(line)
        else:
            line.close()
        if self.closed:
            self._close_idle()

    def doubt(self, line: Line, since: float) -> None:
        """Nothing came by that one in time: if nothing has come at all since then, ask by another one from now on.

        What had been asked before may be answered all the same. A host that was switched off closes no connection. One
        by which nothing has come ever may not be there yet: it has its time.
        """
        if self.shared is not line or line.heard >= since:
            return
        if line.heard or time.monotonic() - line.begun >= CONNECTING_MS / 1000:
            self.shared = Line(self._proxy)

    def answers(self, wait: Callable[[], object], seconds: float) -> bool:
        """Whether the object is there."""
        line, begun = self.shared, time.monotonic()
        asked = line.within(seconds).ice_pingAsync()
        try:
            wait_for(asked, wait)
            asked.result()
        except InvocationTimeout:
            self.doubt(line, begun)
            return False
        except LocalException as exc:
            self._tell(exc)
            return False
        return True

    def _tell(self, exc: Any) -> None:
        """Tell, once, why it will probably never be there: a name is wrong."""
        if isinstance(exc, NotServed):
            reason = f"who answers there has no object `{self.identity}`"
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
        """By whoever gets hold of each: more may be given back meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()


class AskingLink(FindingLink["IceTransport", Peer, str]):
    _flags = Flag.NONE

    def __init__(self, transport: IceTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._operation = names.operation(channel.name)
        self._mode = IDEMPOTENT if channel.idempotent else NORMAL
        self._elsewhere = transport.options.proxy_of(channel.name) or ""
        self._told = {} if transport.limit == MAX_BYTES else {RC_MAX: str(transport.limit)}

    def open(self) -> None:
        if self._elsewhere:
            self.transport.peer("", self._elsewhere)  # raises for what is no proxy
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
        return peer.answers(self.check_open, _PING)

    def wait_peer(self, timeout: float) -> bool:
        if not self._elsewhere:
            return super().wait_peer(timeout)
        end = time.monotonic() + timeout
        while True:
            peer, _ = self.server()
            if peer.answers(self.check_open, min(_PING, max(SLICE, end - time.monotonic()))):
                return True
            left = end - time.monotonic()
            if left <= 0:
                return False
            self.closed.wait(min(_AGAIN, left))

    def look(self) -> bool:
        return bool(self._elsewhere) or super().look()

    def refuses(self, peer: Peer, reply: Reply) -> bool:
        """Whether an object that does not know our operation is gone."""
        if self._elsewhere or not self.lost(peer):
            return False
        self.transport.drop(peer)
        return True

    def context(self, peer: Peer, remaining: float, number: int) -> dict[str, str]:
        flags = self._flags | peer.flags
        request = pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)
        return {RC: request.hex(), **self._told}

    def check_size(self, peer: Peer, payload: bytes, context: dict[str, str]) -> None:
        """Raise before Ice would, and the other side would close the connection."""
        size = len(payload) + request_head(peer.identity, self._operation, context)
        if size > peer.limit:
            raise TransportError(
                f"{self.channel.name}: a message of {size} octets is too large: {peer.named} and we take "
                f"{peer.limit}; raise `message_size_max` (Ice.MessageSizeMax) of both sides"
            )

    def outcome(self, peer: Peer, exc: Any, deadline: float, size: int) -> Reply:
        """What one of Ice's exceptions says about a request. Raises TransportError."""
        if isinstance(exc, NotServed):
            if not peer.id:  # an address that was given, behind which there may be any program
                raise Refused(f"{self.channel.name}: {peer.named} does not serve it") from exc
            return Reply(Status.REFUSED)
        if isinstance(exc, Unknown):
            return failure_told(exc.unknown)
        self.check_open()  # what goes wrong because we are closed is that
        if isinstance(exc, InvocationTimeout):
            raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s") from exc
        if kind_of(exc) is Unreachable:
            hint = ""
            if not peer.id and size > _USUAL_MOST:
                hint = f"; or it takes no message of {size} octets: see its Ice.MessageSizeMax"
            raise Unreachable(f"{self.channel.name}: {peer.named} is not there: {why(exc)}{hint}") from exc
        raise error(self.channel.name, exc) from exc

    def understood(self, ok: bool, payload: bytes) -> Reply:
        """What an answer says. Raises TransportError."""
        if ok:
            return Reply(Status.OK, payload)
        try:
            reply = reply_of(ok, payload)
        except DecodeError as exc:
            self.malformed(exc)
            raise TransportError(f"{self.channel.name}: not an answer of ours: {exc}") from exc
        if reply is None:
            raise Unreachable(f"{self.channel.name}: its server left")
        return accepted(self.channel, reply)


class CommandOutlet(CommandingLink["IceTransport", Peer, str], AskingLink):
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


class Caller(CallingLink["IceTransport", Peer, str], AskingLink):
    def __init__(self, transport: IceTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._asking: set[Line] = set()
        """On which somebody waits."""

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
        line, begun = peer.shared, time.monotonic()
        try:
            asked = line.within(deadline).ice_invokeAsync(self._operation, self._mode, payload, context)
        except LocalException as exc:
            future.cancel()
            raise error(self.channel.name, exc) from exc
        future.add_done_callback(lambda _: _forget(asked))
        ended = partial(self._ended, key, peer, line, asked, begun, deadline, len(payload))
        asked.add_done_callback(lambda _: self.transport.do(ended))
        return future

    def release(self) -> None:
        super().release()
        end = time.monotonic() + STUCK
        while self._asking and time.monotonic() < end:  # some may have been about to begin
            for line in list(self._asking):
                line.close()
            time.sleep(_SHORTLY)

    def ask_peer(self, peer: Peer, where: str, payload: bytes, number: int, end: float, deadline: float) -> Reply:
        number = number or next(self._sequence)
        try:
            line = peer.take(self.check_open, end - time.monotonic())
        except LocalException as exc:
            return self.outcome(peer, exc, deadline, 0)
        self._asking.add(line)
        try:
            self.check_open()
            left = end - time.monotonic()
            context = self.context(peer, left, number)
            self.check_size(peer, payload, context)
            proxy = line.within(left)
            ok, answer = proxy.ice_invoke(self._operation, self._mode, payload, context)
        except LocalException as exc:
            if isinstance(exc, (NotServed, Unknown)):  # which is an answer
                peer.give(line)
            else:
                line.close()
            return self.outcome(peer, exc, deadline, len(payload))
        except BaseException:
            line.close()
            raise
        finally:
            self._asking.discard(line)
        peer.give(line)
        return self.understood(ok, answer)

    def _ended(
        self, key: Hashable, peer: Peer, line: Line, asked: Any, begun: float, deadline: float, size: int
    ) -> None:
        """On a thread of the crew: what became of a call."""
        try:
            try:
                ok, answer = asked.result()
                line.heard = time.monotonic()
                reply = self.understood(ok, answer)
            except LocalException as exc:
                if isinstance(exc, InvocationTimeout):
                    peer.doubt(line, begun)
                reply = self.outcome(peer, exc, deadline, size)
            if reply.status is Status.REFUSED and self.refuses(peer, reply):
                raise self._left()
        except TransportError as exc:
            self._pending.fail(key, exc)
        else:
            self._pending.settle(key, reply)


def _forget(asked: Any) -> None:
    """Nobody waits for that answer any more; what was asked is sent all the same."""
    if not asked.done():
        asked.add_sent_callback(lambda *_: asked.cancel())
