"""A router that no longer sends to a client is noticed after a reconnection, and the client connects again."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocomp_py.errors import Timeout, Unreachable
from robocomp_py.testing.conformance import A_MOMENT, answering, blob, query, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.zenoh import unsafe
from robocomp_py.transports.zenoh.session import open_router
from robocomp_py.transports.zenoh.transport import ZenohTransport

HANDSHAKE = 2
"""The number of frames that a router sends to open a connection."""
LONG_LEASE = {"transport/link/tx/lease": 600_000}
"""Far longer than a test: the client does not notice by itself that its router is silent."""


class Relay:
    """Stands between a client and its router, at a socket of its own."""

    def __init__(self, path: Path, router: Path) -> None:
        self.path, self._router = path, router
        self.connections = 0
        self.silent = False
        """Whether new connections forward only the handshake to the client."""
        self._open: list[socket.socket] = []
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen()
        threading.Thread(target=self._accept).start()

    def cut(self) -> None:
        """End all connections; the client makes new ones."""
        for each in list(self._open):
            with contextlib.suppress(OSError):  # ended already
                each.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self.cut()

    def _accept(self) -> None:
        with self._listener, contextlib.suppress(OSError):  # closed
            while True:
                client, router = self._listener.accept()[0], socket.socket(socket.AF_UNIX)
                router.connect(str(self._router))
                self.connections += 1
                self._open += [client, router]
                frames = HANDSHAKE if self.silent else None
                threading.Thread(target=_forward, args=(client, router, None)).start()
                threading.Thread(target=_forward, args=(router, client, frames)).start()


def _forward(source: socket.socket, target: socket.socket, frames: int | None) -> None:
    """Forward what one side sends until it ends: all of it, or the first frames."""
    with source, target, contextlib.suppress(OSError, EOFError):
        while True:
            size = _exactly(source, 2)
            frame = _exactly(source, int.from_bytes(size, "little"))
            if frames != 0:
                target.sendall(size + frame)
                frames = None if frames is None else frames - 1


def _exactly(source: socket.socket, size: int) -> bytes:
    data = source.recv(size, socket.MSG_WAITALL)
    if len(data) < size:
        raise EOFError
    return data


@pytest.fixture
def router(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "router.sock"
    session = open_router(f"unixsock-stream/{path}", LONG_LEASE)
    yield path
    session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


@pytest.fixture
def relay(router: Path, tmp_path: Path) -> Iterator[Relay]:
    with contextlib.closing(Relay(tmp_path / "relay.sock", router)) as relay:
        yield relay


@pytest.fixture
def is_answered(router: Path, relay: Relay) -> Iterator[Callable[[], bool]]:
    """Whether a server behind the relay answers a client of the router."""
    with (
        contextlib.closing(ZenohTransport(_at(router, "caller"))) as here,
        contextlib.closing(ZenohTransport(_at(relay.path, "server"))) as there,
    ):
        there.server(query("a/b/c"), answering(there, lambda data: data))
        caller = here.caller(query("a/b/c"))
        assert caller.wait_peer(SOON)

        def ask() -> bool:
            with contextlib.suppress(Timeout, Unreachable):  # the old connection may still count
                return unblob(here, caller.ask(blob(here, b"hello"), A_MOMENT).payload) == b"hello"
            return False

        yield ask


def test_a_client_to_which_its_router_no_longer_sends_connects_again(
    relay: Relay, is_answered: Callable[[], bool], caplog: pytest.LogCaptureFixture
) -> None:
    relay.silent = True
    relay.cut()
    wait_until(lambda: "does not answer; connecting again" in caplog.text)
    relay.silent = False
    wait_until(is_answered)


def test_a_client_that_its_router_answers_stays_connected(
    relay: Relay, is_answered: Callable[[], bool], caplog: pytest.LogCaptureFixture
) -> None:
    relay.cut()
    wait_until(lambda: relay.connections > 1)
    wait_until(is_answered)
    assert "does not answer" not in caplog.text


@pytest.mark.parametrize("family", [socket.AF_UNIX, socket.AF_INET, socket.AF_INET6])
def test_only_connections_to_the_given_address_are_shut_down(family: socket.AddressFamily, tmp_path: Path) -> None:
    loopback = {socket.AF_INET: "127.0.0.1", socket.AF_INET6: "::1"}
    ends = []
    for number in range(2):
        listener = socket.socket(family)
        listener.bind((loopback[family], 0) if family in loopback else str(tmp_path / f"{number}.sock"))
        listener.listen()
        client = socket.socket(family)
        client.connect(listener.getsockname())
        ends += [listener, client, listener.accept()[0]]
    first, client, _, _, other, answering_end = ends
    name = first.getsockname()
    text = name if isinstance(name, str) else f"[{name[0]}]:{name[1]}" if ":" in name[0] else f"{name[0]}:{name[1]}"
    assert unsafe.shut_down([f"any/{text}?option=1"]) == 1
    assert client.recv(1) == b""
    other.sendall(b"x")
    assert answering_end.recv(1) == b"x"
    for each in ends:
        each.close()


def test_without_a_list_of_descriptors_nothing_is_shut_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unsafe, "_DESCRIPTORS", tmp_path / "missing")
    assert unsafe.shut_down(["unixsock-stream/nowhere"]) == 0


def _at(socket_path: Path, owner: str) -> TransportConfig:
    return TransportConfig(owner=owner, options={"connect": f"unixsock-stream/{socket_path}"})
