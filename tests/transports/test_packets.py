"""The transport of the guide that derives from `PollingTransport` keeps the contract, and survives faults."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator

import pytest

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig

from .packets import PacketTransport


@pytest.fixture(autouse=True, scope="module")
def own_folder() -> Iterator[None]:
    """Nothing else writes to the run-time folder while it is examined."""
    with tempfile.TemporaryDirectory(prefix="rc-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOCOMP_RUNTIME_DIR", folder)
        yield


class TestPackets(TransportConformance):
    def open_transport(self) -> Transport:
        return PacketTransport(TransportConfig())


@pytest.mark.tool  # needs nothing but time
class TestPacketsFaults(TransportFaults):
    def open_transport(self) -> Transport:
        return PacketTransport(TransportConfig(owner="test"))
