"""What a transport over connections survives."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator

import pytest

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig

from .tcp import TcpTransport


@pytest.fixture(autouse=True, scope="module")
def own_folder() -> Iterator[None]:
    """Nothing else writes to the run-time folder while it is examined."""
    with tempfile.TemporaryDirectory(prefix="rc-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOCOMP_RUNTIME_DIR", folder)
        yield


class TestTcpFaults(TransportFaults):
    def open_transport(self) -> Transport:
        return TcpTransport(TransportConfig(owner="test"))
