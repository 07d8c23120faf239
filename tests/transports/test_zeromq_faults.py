"""What ZeroMQ survives: the faults that every transport must, and connections that go wrong half-way."""

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.zeromq import ZeroMQTransport


class TestZeroMQ(TransportFaults):
    def open_transport(self) -> Transport:
        return ZeroMQTransport(TransportConfig(owner="test"))
