"""What DDS survives: the faults that every transport must."""

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.dds.transport import DDSTransport

from .domains import ANOTHER_DOMAIN, DOMAIN


class TestDDS(TransportFaults):
    def open_transport(self) -> Transport:
        return DDSTransport(TransportConfig({"domain": DOMAIN}, "test"))

    def open_as_another_user(self) -> Transport:
        return DDSTransport(TransportConfig({"domain": ANOTHER_DOMAIN}, "test"))
