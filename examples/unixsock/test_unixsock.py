from unixsock import UnixSocketTransport

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.transports.base import Transport, TransportConfig


class TestUnixSocket(TransportConformance):
    def open_transport(self) -> Transport:
        return UnixSocketTransport(TransportConfig())
