"""A transport over TCP between the processes of one host."""

import socket

from robocomp_py.errors import ConfigurationError
from robocomp_py.transports.base import TransportConfig, options_of
from robocomp_py.transports.streams import StreamTransport


class TcpTransport(StreamTransport):
    """Option `port`: where it listens on loopback; 0 is any free port."""

    name = "tcp"

    def __init__(self, config: TransportConfig) -> None:
        port = options_of(config, port=0)["port"]
        if not isinstance(port, int) or not 0 <= port < 2**16:
            raise ConfigurationError(f"tcp: port = {port!r}; it is a number up to 65535, and 0 means any free one")
        super().__init__(config)
        try:
            listener = socket.create_server(("127.0.0.1", port), backlog=1000)
        except OSError as exc:
            self.close()
            raise ConfigurationError(f"tcp: port = {port}: {exc}") from exc
        self.listen(listener, str(listener.getsockname()[1]))
        self.start()

    def connect(self, place: str) -> socket.socket:
        return socket.create_connection(("127.0.0.1", int(place)), timeout=1.0)
