"""The modules `Ice` and `IceStorm` of one component: exceptions to catch, and functions without effect.

Exceptions of our proxies are also exceptions of Ice, so `except Ice.Exception` and
`except Ice.ConnectionRefusedException` work as before. If ZeroC Ice is installed, its own classes and all its other
names are used; otherwise the exception classes are made here.
"""

from __future__ import annotations

import importlib
import logging
import re
from collections.abc import Callable
from types import ModuleType
from typing import Any

from ...errors import (
    AlreadyServed,
    Busy,
    Closed,
    CodecError,
    ContractMismatch,
    DeclaredError,
    Refused,
    RemoteFailure,
    RobocompError,
    Timeout,
    TransportError,
    Unreachable,
)

log = logging.getLogger("robocomp.worker")

_BASES = {
    "Exception": "",
    "UserException": "Exception",
    "LocalException": "Exception",
    "UnknownException": "LocalException",
    "UnknownLocalException": "UnknownException",
    "UnknownUserException": "UnknownException",
    "RequestFailedException": "LocalException",
    "ObjectNotExistException": "RequestFailedException",
    "FacetNotExistException": "RequestFailedException",
    "OperationNotExistException": "RequestFailedException",
    "SyscallException": "LocalException",
    "SocketException": "SyscallException",
    "ConnectFailedException": "SocketException",
    "ConnectionRefusedException": "ConnectFailedException",
    "ConnectionLostException": "SocketException",
    "DNSException": "LocalException",
    "TimeoutException": "LocalException",
    "ConnectTimeoutException": "TimeoutException",
    "ConnectionTimeoutException": "TimeoutException",
    "InvocationTimeoutException": "TimeoutException",
    "InvocationCanceledException": "LocalException",
    "CommunicatorDestroyedException": "LocalException",
    "ObjectAdapterDeactivatedException": "LocalException",
    "NoEndpointException": "LocalException",
    "NotRegisteredException": "LocalException",
    "ProxyParseException": "LocalException",
    "EndpointParseException": "LocalException",
    "InitializationException": "LocalException",
    "ProtocolException": "LocalException",
    "MarshalException": "ProtocolException",
    "MemoryLimitException": "MarshalException",
    "CloseConnectionException": "ProtocolException",
}
"""Exceptions of Ice 3.7 that components catch by name, each with its base."""

_MEANS: tuple[tuple[type[RobocompError], str], ...] = (
    (Unreachable, "ConnectionRefusedException"),
    (Timeout, "InvocationTimeoutException"),
    (Closed, "CommunicatorDestroyedException"),
    (ContractMismatch, "OperationNotExistException"),
    (Refused, "OperationNotExistException"),
    (AlreadyServed, "LocalException"),
    (Busy, "ConnectTimeoutException"),
    (RemoteFailure, "UnknownException"),
    (CodecError, "MarshalException"),
    (TransportError, "LocalException"),
    (DeclaredError, "UserException"),
    (RobocompError, "Exception"),
)
"""Ice's exceptions for our errors; the first match counts."""


def uses_ice(text: str) -> bool:
    """Whether a file uses more of Ice than exceptions; only then ZeroC's module is imported, which takes time."""
    return any(name not in (*_BASES, "loadSlice") for name in re.findall(r"\bIce(?:Storm)?\.(\w+)", text))


def real(name: str) -> ModuleType | None:
    """ZeroC's module, if it is installed and can be used."""
    try:
        return importlib.import_module(name)
    except Exception as exc:
        if not isinstance(exc, ModuleNotFoundError):
            log.warning("%s is installed but cannot be imported: %s", name, exc)
        return None


class Ices:
    """The Ice modules of one component."""

    def __init__(self, package: str, find: Callable[[str], ModuleType | None]) -> None:
        """`find` returns a module of ZeroC's, or None."""
        self._real = find("Ice")
        self.ice = _Module(f"{package}.Ice", self._real, "Ice")
        for name, base in _BASES.items():
            own = getattr(self._real, name, None) if self._real else None
            parent = vars(self.ice)[base] if base else Exception
            setattr(self.ice, name, own or type(name, (parent,), {"__module__": "Ice"}))
        if self._real is None:
            for name in ("Object", "ObjectPrx", "Application", "Communicator", "CommunicatorI", "Current"):
                setattr(self.ice, name, type(name, (), {"__module__": "Ice"}))
        setattr(self.ice, "loadSlice", _load_nothing)  # noqa: B010 - of a module that is made here
        storm = find("IceStorm") if self._real else None
        self.storm = _Module(f"{package}.IceStorm", storm, "IceStorm")
        if storm is None:
            for name in ("NoSuchTopic", "TopicExists", "AlreadySubscribed", "BadQoS"):
                setattr(self.storm, name, type(name, (vars(self.ice)["UserException"],), {"__module__": "IceStorm"}))
        self._twins: dict[type[RobocompError], type[RobocompError]] = {}

    @property
    def user_exception(self) -> type[BaseException]:
        found: type[BaseException] = vars(self.ice)["UserException"]
        return found

    def raised(self, exc: RobocompError) -> RobocompError:
        """Make an error match Ice's classes, too."""
        kind = type(exc)
        if not isinstance(exc, vars(self.ice)["Exception"]):
            if kind not in self._twins:
                self._twins[kind] = self._twin(kind)
            exc.__class__ = self._twins[kind]
        return exc

    def _twin(self, kind: type[RobocompError]) -> type[RobocompError]:
        other = vars(self.ice)[next(name for ours, name in _MEANS if issubclass(kind, ours))]
        namespace = {
            "__module__": kind.__module__,
            "__qualname__": kind.__qualname__,
            "__str__": kind.__str__,
            "__repr__": kind.__repr__,
            "unknown": property(str),  # of Ice.UnknownException
            "error": 0,  # of Ice.SyscallException
            "reason": property(lambda self: self.__dict__.get("reason", str(self)), _set_reason),
        }
        return type(kind.__name__, (kind, other), namespace)


def _set_reason(exc: Any, value: str) -> None:
    exc.__dict__["reason"] = value


class _Module(ModuleType):
    """A module whose own attributes hide those of the real one."""

    def __init__(self, name: str, real: ModuleType | None, called: str) -> None:
        super().__init__(name)
        self.__dict__.update(_behind=real, _called=called)

    def __getattr__(self, name: str) -> Any:
        behind, called = self.__dict__["_behind"], self.__dict__["_called"]
        if behind is not None:
            return getattr(behind, name)
        if name.startswith("__"):
            raise AttributeError(name)
        raise AttributeError(
            f"{called}.{name} needs ZeroC Ice, which is not installed (pip install 'robocomp-py[ice]', or Debian's "
            "python3-zeroc-ice); what the .cdsl names is connected without it"
        )


def _load_nothing(*arguments: Any, **named: Any) -> None:
    """No effect: `import RoboCompLaser` works without Slice files."""
