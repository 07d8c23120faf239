"""The in-process transport keeps the contract."""

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.inproc import InprocTransport


class TestInproc(TransportConformance):
    def open_transport(self) -> Transport:
        return InprocTransport(TransportConfig())
