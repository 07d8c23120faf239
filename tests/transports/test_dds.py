"""DDS keeps the contract, and shows itself to others."""

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.dds import DDSTransport


class TestDDS(TransportConformance):
    def open_transport(self) -> Transport:
        return DDSTransport(TransportConfig(owner="test"))
