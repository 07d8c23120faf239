"""What Ice survives: the faults that every transport must."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, cast

import pytest

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport

from .icestorm import icestorm, open_ice

pytestmark = pytest.mark.tool


@pytest.fixture(autouse=True, scope="module")
def storm() -> Iterator[str]:
    with icestorm() as proxy:
        yield proxy


class TestIce(TransportFaults):
    def open_transport(self) -> Transport:
        return open_ice()

    def open_as_another_user(self) -> Transport:
        """IceStorm is shared by all who are told of it, so another user has another one."""
        return cast(Transport, _WithItsOwnIceStorm())


class _WithItsOwnIceStorm:
    def __init__(self) -> None:
        self._storm = contextlib.ExitStack()
        self._storm.enter_context(icestorm())
        self._transport = open_ice()
        self._storm.callback(self._transport.close)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def close(self) -> None:
        self._storm.close()
