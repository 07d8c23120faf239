"""Zenoh keeps the contract."""

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.zenoh import ZenohTransport


class TestZenoh(TransportConformance):
    def open_transport(self) -> Transport:
        return ZenohTransport(TransportConfig(owner="test"))
