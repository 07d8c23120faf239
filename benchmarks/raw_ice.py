"""Bare Ice: `ice_invoke` and a servant that takes and gives octets; publications through the same IceStorm as ours.

Payloads are one array in an encapsulation. Requests are served on Ice's own thread, as Ice's users do.
"""

from __future__ import annotations

import contextlib
from typing import Any

import Ice
import IceStorm
import numpy as np

from .ours import options
from .parties import PATIENCE, Array, Hear, Place

_TOPIC = "raw"
_NORMAL = Ice.OperationMode.Normal
_HEAD = 11
"""Octets before the array: the size of it all, the encoding, and the size of the array."""


def encode(data: Array) -> bytes:
    size = data.size + _HEAD
    return b"".join((size.to_bytes(4, "little"), b"\1\1\xff", data.size.to_bytes(4, "little"), data.data))


def decode(payload: bytes) -> Array:
    return np.frombuffer(payload, np.uint8, len(payload) - _HEAD, _HEAD)


class _Echo(Ice.Blobject):  # type: ignore[misc]  # Ice has no types
    def ice_invoke(self, octets: bytes, current: Any) -> tuple[bool, bytes]:
        return True, encode(decode(octets))


class _Hearing(Ice.Blobject):  # type: ignore[misc]  # Ice has no types
    def __init__(self, hear: Hear) -> None:
        self._hear = hear

    def ice_invoke(self, octets: bytes, current: Any) -> tuple[bool, bytes]:
        self._hear(decode(octets))
        return True, b"\6\0\0\0\1\1"


class Far:
    def __init__(self, place: Place, hear: Hear) -> None:
        self._communicator = _communicator()
        adapter = self._communicator.createObjectAdapterWithEndpoints("raw", f"tcp -h 127.0.0.1 -p {_port(place)}")
        adapter.add(_Echo(), Ice.stringToIdentity("echo"))
        hearing = adapter.addWithUUID(_Hearing(hear))
        adapter.activate()
        _topic(self._communicator, place).subscribeAndGetPublisher({"reliability": "ordered"}, hearing)

    def close(self) -> None:
        self._communicator.destroy()


class Near:
    def __init__(self, place: Place) -> None:
        self._communicator = _communicator()
        echo = self._communicator.stringToProxy(f"echo:tcp -h 127.0.0.1 -p {_port(place)}")
        self._echo = echo.ice_invocationTimeout(int(PATIENCE * 1000))
        self._publisher = _topic(self._communicator, place).getPublisher()

    def ask(self, data: Array) -> Array:
        _, answer = self._echo.ice_invoke("echo", _NORMAL, encode(data))
        return decode(answer)

    def publish(self, data: Array) -> None:
        self._publisher.ice_invoke("news", _NORMAL, encode(data))

    def close(self) -> None:
        self._communicator.destroy()


def _communicator() -> Any:
    data = Ice.InitializationData()
    data.properties = Ice.createProperties()
    data.properties.setProperty("Ice.MessageSizeMax", "262144")
    return Ice.initialize(data)


def _port(place: Place) -> int:
    """The next one after that of IceStorm."""
    return int(options("ice", place)["storm"].rpartition(" ")[2]) + 1


def _topic(communicator: Any, place: Place) -> Any:
    manager = IceStorm.TopicManagerPrx.uncheckedCast(communicator.stringToProxy(options("ice", place)["storm"]))
    with contextlib.suppress(IceStorm.TopicExists):
        return manager.create(_TOPIC)
    return manager.retrieve(_TOPIC)
