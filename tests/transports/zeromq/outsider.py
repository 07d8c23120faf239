"""A script without this library, which calls and hears components over ZeroMQ."""

from __future__ import annotations

from typing import Any

import zmq

from robocomp_py.contract.interface import Pattern
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Reply, Status, TypeRef
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
from robocomp_py.wire import header

DIVIDE = Channel("robot/calculator/Everything/divide", Pattern.QUERY, TypeRef("", e.divide.fingerprint, e.divide.text))
NAMED = DIVIDE.name.encode() + b"\0"


class Outsider:
    """A program that knows nothing of us but the protocol."""

    def __init__(self) -> None:
        self.context = zmq.Context()
        self.sockets: list[zmq.Socket[Any]] = []

    def socket(self, kind: int) -> zmq.Socket[Any]:
        socket = self.context.socket(kind)
        socket.setsockopt(zmq.RCVTIMEO, int(SOON * 1000))
        self.sockets.append(socket)
        return socket

    def dealer(self, address: str) -> zmq.Socket[Any]:
        socket = self.socket(zmq.DEALER)
        socket.connect(address)
        return socket

    def close(self) -> None:
        for socket in self.sockets:
            socket.close(linger=0)
        self.context.term()


def address_of(transport: ZeroMQTransport, role: str, channel: Channel) -> str:
    """The address of a server, as in the files of the directory."""
    wait_until(lambda: transport.directory.find(role, channel.name))
    return transport.directory.find(role, channel.name)[0][1].address


def reply_of(socket: zmq.Socket[Any]) -> tuple[header.ReplyHeader, bytes]:
    """The next reply: its header, and what follows."""
    reply = socket.recv()
    return header.read_reply(reply[: header.REPLY_BYTES]), reply[header.REPLY_BYTES :]


def serve_division(transport: ZeroMQTransport) -> Any:
    decode, encode = transport.codec.decoder(e.divide.request), transport.codec.encoder(e.divide.response)
    return transport.server(DIVIDE, lambda payload, _: Reply(Status.OK, encode(divmod(*decode(payload)))))
