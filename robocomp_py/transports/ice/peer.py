"""An object of another process, as the links of its clients invoke it."""

from __future__ import annotations

import contextlib
import itertools
import logging
import time
from collections.abc import Callable
from typing import Any

from ...errors import (
    ConfigurationError,
)
from ...wire.header import Flag
from ..directory import Directory
from .library import (
    CONNECTING_MS,
    FORCEFULLY,
    InvocationTimeout,
    LocalException,
    NoSuchHost,
    NotServed,
    as_transport_error,
    wait_for,
    why,
)

log = logging.getLogger("robocomp.transport.ice")

IDLE_CONNECTIONS = 8
"""Maximum number of idle connections to one object that are kept for later calls."""

_MOST_PROXIES = 64
"""Maximum number of cached proxies that differ only in their timeout."""

_numbers = itertools.count(1)
"""Numbers for proxies, which get different connections by them."""


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

    def __init__(self, communicator: Any, limit: int, directory: Directory, member_id: str, address: str) -> None:
        """`limit` is our maximum size of a message. `address` is the proxy of the object, preceded by its maximum size
        of a message, if that is known."""
        self.id, self.address, self._directory = member_id, address, directory
        self.key = member_id, address
        theirs, _, named = address.partition(" ")
        known = theirs.isdecimal()
        self.named = named if known else address
        self.limit = min(int(theirs), limit) if known else limit
        self.flags = Flag.NONE
        """Flags of all requests to it."""
        self.closed = False
        self._told = ""
        with as_transport_error(f"the proxy {self.named!r}"):
            self._proxy = communicator.stringToProxy(self.named)
        if self._proxy is None:
            raise ConfigurationError(f"the proxy {self.named!r} names no object")
        self._proxy = self._proxy.ice_twoway()
        self.identity: str = self._proxy.ice_getIdentity().name
        self.shared, self.oneway = Connection(self._proxy), Connection(self._proxy.ice_oneway())
        self._idle: list[Connection] = []

    def alive(self) -> bool:
        return not self.closed and (not self.id or self._directory.alive(self.id))

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
