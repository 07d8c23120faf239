"""Over TCP, only those talk to a component whose keys it admits; who is not let in is told, with the reason."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
import zmq
import zmq.auth

from robocomp_py.contract.interface import Pattern
from robocomp_py.errors import ConfigurationError
from robocomp_py.testing import everything
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, TransportConfig, TypeRef
from robocomp_py.transports.zeromq.curve import Curve, Secure, key_pair
from robocomp_py.transports.zeromq.sockets import new_socket
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
from robocomp_py.wire import header as head
from tests.freeports import free_port

from .outsider import DIVIDE, NAMED, Outsider, reply_of, serve_division


class Keys:
    """A server's key, and that of one client, admitted."""

    def __init__(self, folder: Path) -> None:
        (folder / "admitted").mkdir()
        self.folder, self.admitted = folder, folder / "admitted"
        self.server = self.make("server")
        self.client = self.make("client")
        (folder / "client.key").rename(self.admitted / "client.key")

    def make(self, name: str) -> Path:
        _, secret = zmq.auth.create_certificates(self.folder, name)
        Path(secret).chmod(0o600)
        return Path(secret)

    def options(self, port: int) -> dict[str, str]:
        return {
            "bind": f"tcp://127.0.0.1:{port}",
            "curve_key": str(self.server),
            "curve_admitted": str(self.admitted),
        }

    def of(self, client: Path) -> Secure:
        """How a client with this key connects to the server."""
        return Curve(*key_pair(client), self.admitted).ask(key_pair(self.server)[0])


@pytest.fixture
def keys(tmp_path: Path) -> Keys:
    return Keys(tmp_path)


@pytest.fixture
def outsider() -> Iterator[Outsider]:
    opened = Outsider()
    yield opened
    opened.close()


@pytest.fixture
def address(keys: Keys) -> Iterator[str]:
    """Of a component that divides."""
    options = keys.options(free_port())
    transport = ZeroMQTransport(TransportConfig(options, "calculator"))
    serve_division(transport)
    yield options["bind"]
    transport.close()


def asking(outsider: Outsider, address: str, secure: Secure | None, number: int = 1) -> zmq.Socket[bytes]:
    """A socket that has sent a request."""
    socket = new_socket(outsider.context, zmq.DEALER, secure, RCVTIMEO=int(SOON * 1000), LINGER=0)
    outsider.sockets.append(socket)
    socket.connect(address)
    request = head.pack_request(0, everything.divide.fingerprint, number, 1, None)
    with contextlib.suppress(zmq.Again):  # libzmq has already removed the connection if the server refused it
        socket.send(NAMED + request + msgpack.packb([17, 5]), zmq.NOBLOCK)
    return socket


def test_a_client_with_an_admitted_key_is_answered(keys: Keys, outsider: Outsider, address: str) -> None:
    assert msgpack.unpackb(reply_of(asking(outsider, address, keys.of(keys.client)))[1]) == [3, 2]


@pytest.mark.parametrize("who", ["no key", "a key that is not admitted", "a wrong key of the server"])
def test_a_client_without_an_admitted_key_is_refused_and_the_reason_is_logged(
    keys: Keys, outsider: Outsider, address: str, caplog: pytest.LogCaptureFixture, who: str
) -> None:
    stranger = keys.make("stranger")
    secure, reason = {
        "no key": (None, "does not use CURVE"),
        "a key that is not admitted": (keys.of(stranger), "its key is not admitted"),
        "a wrong key of the server": (
            Curve(*key_pair(keys.client), keys.admitted).ask(key_pair(stranger)[0]),
            "a wrong key of ours",
        ),
    }[who]
    socket = asking(outsider, address, secure, 1)
    wait_until(lambda: reason in caplog.text, what=caplog.text)
    friend = asking(outsider, address, keys.of(keys.client), 2)
    assert reply_of(friend)[0].client == 2
    assert not socket.poll(0)


def test_a_removed_key_admits_no_client(
    keys: Keys, outsider: Outsider, address: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert reply_of(asking(outsider, address, keys.of(keys.client)))[0].client == 1
    (keys.admitted / "client.key").unlink()
    socket = asking(outsider, address, keys.of(keys.client), 2)
    wait_until(lambda: "its key is not admitted" in caplog.text)
    assert not socket.poll(0)


def test_on_one_host_no_key_is_needed(keys: Keys, outsider: Outsider, address: str) -> None:
    other = ZeroMQTransport(TransportConfig())
    try:
        caller = other.caller(DIVIDE)
        assert caller.wait_peer(SOON)
        payload = other.codec.encoder(everything.divide.request)((17, 5))
        assert other.codec.decoder(everything.divide.response)(caller.ask(payload, SOON).payload) == (3, 2)
    finally:
        other.close()


def test_wrong_keys_are_reported_before_anything_is_opened(keys: Keys) -> None:
    good = keys.options(free_port())
    (keys.folder / "empty").write_text("")
    (keys.folder / "empty").chmod(0o600)
    open_to_others = keys.make("careless")
    open_to_others.chmod(0o644)
    for change, complaint in (
        ({"curve_key": ""}, "go together"),
        ({"curve_admitted": ""}, "go together"),
        ({"bind": ""}, "the addresses that `bind` and `connect` name"),
        ({"curve_admitted": str(keys.folder / "nowhere")}, "is not a folder"),
        ({"curve_key": str(keys.folder / "nowhere")}, "cannot be read"),
        ({"curve_key": str(keys.folder / "empty")}, "has no key pair"),
        ({"curve_key": str(open_to_others)}, f"chmod 600 {open_to_others}"),
    ):
        with pytest.raises(ConfigurationError, match=complaint):
            ZeroMQTransport(TransportConfig(good | change))


def test_a_topic_whose_name_is_too_long_to_be_protected_is_refused(keys: Keys) -> None:
    name = "r" * 240 + "/arm/Arm/moved"
    with contextlib.closing(ZeroMQTransport(TransportConfig(keys.options(free_port()), "arm"))) as transport:
        transport.outlet(Channel(name, Pattern.PUBLISH, TypeRef("", 1, ""))).close()
        with pytest.raises(ConfigurationError, match="may have 255 octets"):
            transport.outlet(Channel("ü" + name, Pattern.PUBLISH, TypeRef("", 1, "")))
