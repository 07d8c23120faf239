"""What ZeroMQ survives: the faults that every transport must, and those that speak half of its protocol, then hang."""

from __future__ import annotations

import contextlib
import socket as plain
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocomp_py.errors import Timeout, Unreachable
from robocomp_py.testing.conformance import answering, blob, query, topic, unblob
from robocomp_py.testing.faults import TransportFaults
from robocomp_py.testing.patience import SCALE, SOON, wait_until
from robocomp_py.transports.base import Channel, Transport, TransportConfig
from robocomp_py.transports.members import Entry
from robocomp_py.transports.zeromq.transport import ZeroMQTransport

GREETING = b"\xff\0\0\0\0\0\0\0\1\x7f\3\0NULL".ljust(64, b"\0")


def ready(kind: bytes) -> bytes:
    body = b"\5READY\x0bSocket-Type" + len(kind).to_bytes(4, "big") + kind + b"\x08Identity" + bytes(4)
    return bytes([4, len(body)]) + body


def beginnings(kind: bytes) -> dict[str, bytes]:
    """The first words of a peer that then hangs, for a socket of this kind."""
    return {
        "nothing": b"",
        "half a greeting": GREETING[:30],
        "a greeting": GREETING,
        "half a handshake": GREETING + ready(kind)[:20],
        "a handshake": GREETING + ready(kind),
        "half a message": GREETING + ready(kind) + b"\0\xc8a/b/c\0" + b"half",
        "the beginning of a large one": GREETING + ready(kind) + b"\2" + (2**27).to_bytes(8, "big") + b"a/b/c\0",
        "one larger than any": GREETING + ready(kind) + b"\2" + (2**62).to_bytes(8, "big") + b"a/b/c\0",
        "a first frame without a second": GREETING + ready(kind) + b"\1\6a/b/c\0",
        "another language": b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n" * 10,
    }


WORDS = list(beginnings(b""))
NONSENSE = ("one larger than any", "another language")


class TestZeroMQ(TransportFaults):
    def open_transport(self) -> Transport:
        return ZeroMQTransport(TransportConfig(owner="test"))


@pytest.fixture
def transport() -> Iterator[ZeroMQTransport]:
    opened = ZeroMQTransport(TransportConfig(owner="honest"))
    yield opened
    opened.close()


@pytest.fixture
def other() -> Iterator[ZeroMQTransport]:
    opened = ZeroMQTransport(TransportConfig(owner="other"))
    yield opened
    opened.close()


@pytest.fixture
def hanging() -> Iterator[Callable[[str, bytes], None]]:
    """Connects to a socket's file, says something, and hangs."""
    with contextlib.ExitStack() as connections:

        def hang(address: str, words: bytes) -> None:
            connection = connections.enter_context(plain.socket(plain.AF_UNIX))
            connection.connect(address.removeprefix("ipc://"))
            connection.sendall(words)

        yield hang


@pytest.fixture
def impostor(transport: ZeroMQTransport, tmp_path: Path) -> Iterator[Callable[[str, Channel, bytes], None]]:
    """Announces a foreign server: it greets each connection, sends something, and hangs."""
    with contextlib.ExitStack() as everything:

        def announce(role: str, channel: Channel, words: bytes) -> None:
            listener = everything.enter_context(plain.socket(plain.AF_UNIX))
            path = transport.folder / f"impostor-{len(str(tmp_path))}-{channel.name.replace('/', '.')}"
            listener.bind(str(path))
            everything.callback(path.unlink, missing_ok=True)
            listener.listen()
            open_connections: list[plain.socket] = []

            def serve() -> None:
                with contextlib.suppress(OSError):
                    while True:
                        connection, _ = listener.accept()
                        open_connections.append(connection)
                        connection.sendall(words)

            thread = threading.Thread(target=serve)
            thread.start()
            everything.callback(lambda: [each.close() for each in open_connections])
            everything.callback(thread.join)  # before that: it may just have accepted one
            everything.callback(listener.shutdown, plain.SHUT_RDWR)
            member = transport.directory.join("impostor")
            everything.callback(member.close)
            kind = channel.type
            member.add(Entry(role, channel.name, kind.fingerprint, kind.text, f"ipc://{path}"))

        yield announce


def test_clients_are_served_while_others_send_half_a_message_and_hang(
    transport: ZeroMQTransport, other: ZeroMQTransport, hanging: Callable[[str, bytes], None]
) -> None:
    transport.server(query("a/b/c"), answering(transport, bytes.upper))
    address = transport.routers()[0].address
    for words in beginnings(b"DEALER").values():
        hanging(address, words)
    caller = other.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    for number in range(20):
        data = b"%d" % number
        assert unblob(other, caller.ask(blob(other, data), SOON).payload) == data


def test_subscribers_hear_a_publisher_while_others_hang(
    transport: ZeroMQTransport, other: ZeroMQTransport, hanging: Callable[[str, bytes], None]
) -> None:
    outlet, heard = transport.outlet(topic("a/b/c")), list[bytes]()
    wait_until(lambda: transport.directory.find("publishes", "a/b/c"))
    address = transport.directory.find("publishes", "a/b/c")[0][1].address
    for words in beginnings(b"SUB").values():
        hanging(address, words)
    other.inlet(topic("a/b/c"), lambda payload: heard.append(unblob(other, payload)))
    assert outlet.wait_peer(SOON)
    wait_until(lambda: (outlet.send(blob(transport, b"news")), heard)[1])


@pytest.mark.parametrize("words", WORDS)
def test_a_subscriber_hears_others_while_a_publisher_says_half_of_something(
    transport: ZeroMQTransport, other: ZeroMQTransport, impostor: Callable[[str, Channel, bytes], None], words: str
) -> None:
    heard = list[bytes]()
    impostor("publishes", topic("a/b/c"), beginnings(b"XPUB")[words])
    link = transport.inlet(topic("a/b/c"), lambda payload: heard.append(unblob(transport, payload)))
    outlet = other.outlet(topic("a/b/c"))
    assert outlet.wait_peer(SOON)
    wait_until(lambda: (outlet.send(blob(other, b"news")), heard)[1])
    assert set(heard) == {b"news"}
    wait_until(lambda: link.stats.malformed == (words in NONSENSE))


@pytest.mark.parametrize("words", WORDS)
def test_a_call_to_a_server_that_sends_half_a_message_ends_at_its_deadline(
    transport: ZeroMQTransport, impostor: Callable[[str, Channel, bytes], None], words: str
) -> None:
    impostor("serves", query("a/b/c"), beginnings(b"ROUTER")[words])
    caller = transport.caller(query("a/b/c"))
    with pytest.raises(Unreachable if words in NONSENSE else Timeout):
        caller.ask(blob(transport, b"x"), 0.1 * SCALE)
    transport.server(query("a/b/d"), answering(transport, bytes.upper))
    assert unblob(transport, transport.caller(query("a/b/d")).ask(blob(transport, b"x"), SOON).payload) == b"X"
