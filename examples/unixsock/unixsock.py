"""Transport `unixsock`: each process listens at a Unix socket, which others find in the directory."""

from __future__ import annotations

import contextlib
import socket

from unixsock_hosts import relaying

from robocomp_py.transports.base import TransportConfig, options_of
from robocomp_py.transports.streams import StreamTransport


class UnixSocketTransport(StreamTransport):
    """Has no options. Promises nothing beyond the four verbs: whatever else a QoS demands is refused."""

    name = "unixsock"

    def __init__(self, config: TransportConfig) -> None:
        options_of(config, relay=None)
        super().__init__(config)
        path = str(self.member.address("socket"))
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(path)
        listener.listen(1000)
        self.listen(listener, path)
        self.start()

    def connect(self, place: str) -> socket.socket:
        connected = socket.socket(socket.AF_UNIX)
        try:
            connected.settimeout(1.0)
            connected.connect(place)
        except OSError:
            connected.close()
            raise
        return connected

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `SupportsHost`: the relay to other hosts, where `rcdeploy` says that one is needed."""
        relay = options_of(config, relay=None)["relay"]
        return relaying(relay) if relay else contextlib.nullcontext()
