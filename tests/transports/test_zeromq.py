"""ZeroMQ keeps the contract."""

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.zeromq import ZeroMQTransport


class TestZeroMQ(TransportConformance):
    def open_transport(self) -> Transport:
        return ZeroMQTransport(TransportConfig(owner="test"))
