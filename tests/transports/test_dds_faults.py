"""What DDS survives: the faults that every transport must."""

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.dds import DDSTransport


class TestDDS(TransportFaults):
    def open_transport(self) -> Transport:
        return DDSTransport(TransportConfig(owner="test"))

    def open_as_another_user(self) -> Transport:
        return DDSTransport(TransportConfig({"domain": 1}, owner="test"))
