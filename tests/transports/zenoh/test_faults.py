"""Zenoh survives what every transport must: processes that are killed or hang, and floods."""

from __future__ import annotations

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.zenoh.transport import ZenohTransport


class TestZenohFaults(TransportFaults):
    def open_transport(self) -> Transport:
        return ZenohTransport(TransportConfig(owner="test"))
