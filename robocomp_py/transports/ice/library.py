"""What we use of Ice for Python, and how it is set up. Nothing else here imports `Ice`."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ...errors import Closed, ConfigurationError, TransportError, Unreachable
from ..iceoptions import FIXED, IceOptions

try:
    import Ice
except ImportError as exc:
    raise ImportError(
        f"Ice for Python is not there ({exc}): `pip install 'robocomp-py[ice]'`, or Debian's package python3-zeroc-ice"
    ) from exc

log = logging.getLogger("robocomp.transport.ice")

if Ice.intVersion() // 100 != 307:
    raise ImportError(f"this speaks Ice 3.7, and Ice for Python {Ice.stringVersion()} is installed")

NORMAL, IDEMPOTENT = Ice.OperationMode.Normal, Ice.OperationMode.Idempotent
FORCEFULLY = Ice.ConnectionClose.Forcefully

BlobjectAsync: Any = Ice.BlobjectAsync
LocalException: Any = Ice.LocalException
InvocationTimeout: Any = Ice.InvocationTimeoutException
Late: Any = Ice.TimeoutException
"""Also what waiting for a future raises."""
NotServed: Any = Ice.RequestFailedException
"""There is no such object, facet or operation."""
NoSuchObject: Any = Ice.ObjectNotExistException
NoSuchOperation: Any = Ice.OperationNotExistException
NoSuchHost: Any = Ice.DNSException
Unknown: Any = Ice.UnknownException
"""What raised on the other side is no exception that its operation declares."""

CONNECTING_MS = 5000
"""A connection that is not there by then will not be."""

STALLED_MS = 10_000
"""A connection on which nothing moves for so long, in the middle of a message, is given up."""

SLICE = 0.1
"""Seconds after which who waits for Ice looks whether there is still a reason to."""

_MORE_KB = 64
"""Taken beyond the limit, so that what keeps it is never the last straw: heads are not all of one length."""

_USUAL = {
    "Ice.Default.Timeout": STALLED_MS,
    "Ice.Override.ConnectTimeout": CONNECTING_MS,
    "Ice.Override.CloseTimeout": 500,
    # While we execute something, who waits for it is told that we live; who asks nothing is let go after a while.
    # A call that takes long is never cut off: it has a deadline.
    "Ice.ACM.Client.Timeout": 60,
    "Ice.ACM.Client.Close": 1,
    "Ice.ACM.Client.Heartbeat": 0,
    "Ice.ACM.Server.Timeout": 30,
    "Ice.ACM.Server.Close": 1,
    "Ice.ACM.Server.Heartbeat": 1,
}
"""Unless the options say otherwise."""


def communicator(options: IceOptions, limit: int, tell: Callable[[int, str], object]) -> Any:
    """A new one, which takes messages of so many octets.

    `tell` gets what Ice has to say, with a level of logging: on any thread, so it must not log.
    """
    size = {"Ice.Default.Host": options.host, "Ice.MessageSizeMax": limit // 1024 + _MORE_KB}
    properties = Ice.createProperties()
    for key, value in (_USUAL | dict(options.properties) | dict(FIXED) | size).items():
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
    """Python does not know Ice's threads, and would make a state for them at each callback, and destroy it afterwards.

    Entered once more than left, a thread keeps the one it has; before it ends, that is made good.
    """

    def start(self) -> None:
        ctypes.pythonapi.PyGILState_Ensure()

    def stop(self) -> None:
        ctypes.pythonapi.PyGILState_Release(_HELD)


_HELD = 0
"""PyGILState_LOCKED: the lock is held by who calls, and stays so."""


def gone(sending: Any) -> bool:
    """Whether a one-way request was sent at once; nothing is left of it then.

    Ice for Python would keep it for ever, with its payload: the future of such a request and what Ice knows of it hold
    each other.
    """
    if not sending.is_sent_synchronously():
        return False
    sending._asyncResult = None
    return True


def wait_for(asked: Any, wait: Callable[[], object]) -> None:
    """Until a future of Ice's is done; `wait` is called meanwhile, and may raise."""
    if asked.done():
        return
    done = threading.Event()
    asked.add_done_callback(lambda _: done.set())
    while not done.wait(SLICE):
        wait()


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    """What Ice raises becomes ours."""
    try:
        yield
    except Ice.Exception as exc:
        raise error(doing, exc) from exc


def error(doing: str, exc: Any) -> TransportError | ConfigurationError:
    """What one of Ice's exceptions means, of those that tell neither of an answer nor of a deadline."""
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
    """In words."""
    told = [str(value) for name in _TELLING if (value := getattr(exc, name, None))]
    if isinstance(exc, Ice.SyscallException) and exc.error:
        told.append(os.strerror(exc.error))
    name = type(exc).__name__.removesuffix("Exception")
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()
    return ": ".join(filter(None, (_PLAINLY.get(name, words), *told))) or words


_TELLING = ("str", "reason", "unknown", "kindOfObject", "host", "proxy")
_PLAINLY: Mapping[str, str] = {
    "ConnectionLost": "the connection was lost",
    "ConnectionRefused": "",  # the error that follows says the same
    "DNS": "host not found",
    "Socket": "",
    "MemoryLimit": "it is larger than `message_size_max` allows",
}
