"""Sets up Ice for Python and exports the parts that we use. No other module of this folder imports `Ice`."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ...errors import Closed, ConfigurationError, TransportError, Unreachable
from ..iceoptions import FIXED, IceOptions
from ..unsafe import keep_thread_state, release_thread_state
from .unsafe import free

try:
    import Ice
except ImportError as exc:
    raise ImportError(
        f"Ice for Python is not installed ({exc}): `pip install 'robocomp-py[ice]'`, "
        "or Debian's package python3-zeroc-ice"
    ) from exc

log = logging.getLogger("robocomp.transport.ice")

if Ice.intVersion() // 100 != 307:
    raise ImportError(f"Ice 3.7 is required, but Ice for Python {Ice.stringVersion()} is installed")

NORMAL, IDEMPOTENT = Ice.OperationMode.Normal, Ice.OperationMode.Idempotent
FORCEFULLY = Ice.ConnectionClose.Forcefully

BlobjectAsync: Any = Ice.BlobjectAsync
LocalException: Any = Ice.LocalException
InvocationTimeout: Any = Ice.InvocationTimeoutException
AnyTimeout: Any = Ice.TimeoutException
"""Also raised by waiting for a future."""
NotServed: Any = Ice.RequestFailedException
"""There is no such object, facet or operation."""
NoSuchObject: Any = Ice.ObjectNotExistException
NoSuchOperation: Any = Ice.OperationNotExistException
NoSuchHost: Any = Ice.DNSException
Unknown: Any = Ice.UnknownException
"""The server raised an exception that its operation does not declare."""

CONNECTING_MS = 5000
"""Time limit for establishing a connection."""

STALLED_MS = 10_000
"""A connection without progress in the middle of a message is closed after this time."""

SLICE = 0.1
"""Seconds between two checks, while waiting for Ice, whether to go on waiting."""

_MORE_KB = 64
"""Ice's own limit is this much higher than ours, because message headers differ in length."""

_DEFAULTS = {
    "Ice.Default.Timeout": STALLED_MS,
    "Ice.Override.ConnectTimeout": CONNECTING_MS,
    "Ice.Override.CloseTimeout": 500,
    # A server sends heartbeats while it executes a request; idle connections are closed after a while.
    # A long call is never cut off: only its deadline ends it.
    "Ice.ACM.Client.Timeout": 60,
    "Ice.ACM.Client.Close": 1,
    "Ice.ACM.Client.Heartbeat": 0,
    "Ice.ACM.Server.Timeout": 30,
    "Ice.ACM.Server.Close": 1,
    "Ice.ACM.Server.Heartbeat": 1,
}
"""Default settings of Ice; options may override them."""


def communicator(options: IceOptions, limit: int, tell: Callable[[int, str], object]) -> Any:
    """A new communicator, with `limit` as the maximum size of a message in bytes.

    `tell` gets Ice's log messages, each with its level. Ice may call it on any thread, so it must not log.
    """
    size = {"Ice.Default.Host": options.host, "Ice.MessageSizeMax": limit // 1024 + _MORE_KB}
    properties = Ice.createProperties()
    for key, value in (_DEFAULTS | dict(options.properties) | dict(FIXED) | size).items():
        properties.setProperty(key, str(value))
    data = Ice.InitializationData()
    data.properties, data.logger, data.threadHook = properties, _Logger(tell), _ThreadHook()
    with as_transport_error("opening"):
        return Ice.initialize(data)


class _Logger(Ice.Logger):  # type: ignore[misc]  # Ice has no types
    def __init__(self, tell: Callable[[int, str], object], prefix: str = "") -> None:
        self._tell, self._prefix = tell, prefix

    def _print(self, message: str) -> None:
        self._tell(logging.INFO, message)

    def trace(self, category: str, message: str) -> None:
        self._tell(logging.DEBUG, f"{category}: {message}")

    def warning(self, message: str) -> None:
        self._tell(logging.WARNING, message)

    def error(self, message: str) -> None:
        self._tell(logging.ERROR, message)

    def getPrefix(self) -> str:
        return self._prefix

    def cloneWithPrefix(self, prefix: str) -> _Logger:
        return _Logger(self._tell, prefix)


class _ThreadHook(Ice.ThreadNotification):  # type: ignore[misc]  # Ice has no types
    """Keeps the Python state of Ice's threads, which Python would otherwise create and destroy at each callback."""

    def start(self) -> None:
        keep_thread_state()

    def stop(self) -> None:
        release_thread_state()


def gone(sending: Any) -> bool:
    """Whether a one-way request was sent at once; then its memory is freed."""
    if not sending.is_sent_synchronously():
        return False
    free(sending)
    return True


def wait_for(asked: Any, wait: Callable[[], object]) -> None:
    """Wait until a future of Ice is done; calls `wait` repeatedly, which may raise."""
    if asked.done():
        return
    done = threading.Event()
    asked.add_done_callback(lambda _: done.set())
    while not done.wait(SLICE):
        wait()


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    """Turn Ice's exceptions into ours."""
    try:
        yield
    except Ice.Exception as exc:
        raise error(doing, exc) from exc


def error(doing: str, exc: Any) -> TransportError | ConfigurationError:
    """Our exception for one of Ice that stands neither for a reply nor for a deadline."""
    return kind_of(exc)(f"{doing}: {why(exc)}")


def kind_of(exc: Any) -> type[TransportError] | type[ConfigurationError]:
    for kinds, ours in _MEANINGS:
        if isinstance(exc, kinds):
            return ours
    return TransportError


_MEANINGS: tuple[tuple[Any, type[TransportError] | type[ConfigurationError]], ...] = (
    ((Ice.CommunicatorDestroyedException, Ice.ObjectAdapterDeactivatedException), Closed),
    (
        (
            Ice.EndpointParseException,
            Ice.ProxyParseException,
            Ice.IdentityParseException,
            Ice.ObjectAdapterIdInUseException,
            Ice.NoEndpointException,
            Ice.InitializationException,
        ),
        ConfigurationError,
    ),
    (
        (
            Ice.SocketException,  # refused, lost
            Ice.TimeoutException,  # of connecting, closing, or in the middle of a message
            Ice.DNSException,
            Ice.CloseConnectionException,
            Ice.ConnectionManuallyClosedException,
            Ice.NotRegisteredException,
        ),
        Unreachable,
    ),
)


def why(exc: Any) -> str:
    """The message of an Ice exception."""
    told = [str(value) for name in _DETAILS if (value := getattr(exc, name, None))]
    if isinstance(exc, Ice.SyscallException) and exc.error:
        told.append(os.strerror(exc.error))
    name = type(exc).__name__.removesuffix("Exception")
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()
    return ": ".join(filter(None, (_WORDS.get(name, words), *told))) or words


_DETAILS = ("str", "reason", "unknown", "kindOfObject", "host", "proxy")
_WORDS: Mapping[str, str] = {
    "ConnectionLost": "the connection was lost",
    "ConnectionRefused": "",  # the error that follows says the same
    "DNS": "host not found",
    "Socket": "",
    "MemoryLimit": "it is larger than `message_size_max` allows",
}
