"""A transport over TCP between the processes of one host."""

import socket

from robocomp_py.transports.base import TransportConfig, options_of
from robocomp_py.transports.streams import StreamTransport


class TcpTransport(StreamTransport):
    name = "tcp"

    def __init__(self, config: TransportConfig) -> None:
        options_of(config)  # there are none
        super().__init__(config)
        listener = socket.create_server(("127.0.0.1", 0), backlog=1000)
        self.listen(listener, str(listener.getsockname()[1]))
        self.start()

    def connect(self, place: str) -> socket.socket:
        return socket.create_connection(("127.0.0.1", int(place)), timeout=1.0)
