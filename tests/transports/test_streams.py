"""Transports over connections: that of the guide keeps the contract, and what the base protects it from."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import pytest

from robocomp_py.errors import ConfigurationError, TransportError
from robocomp_py.testing.conformance import TransportConformance, blob, query, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Status, Transport, TransportConfig
from robocomp_py.transports.link import Ends
from robocomp_py.transports.streams import Caller, Connection, Message, Process

from .tcp import TcpTransport

Pair = tuple[Connection, Connection]


class TestTcp(TransportConformance):
    def open_transport(self) -> Transport:
        return TcpTransport(TransportConfig())


@pytest.fixture
def pair() -> Iterator[Pair]:
    one, other = socket.socketpair()
    with one, other:
        yield Connection(one), Connection(other)


@pytest.fixture
def opened(own_runtime_folder: object) -> Iterator[Callable[[], TcpTransport]]:
    made: list[TcpTransport] = []

    def open_one() -> TcpTransport:
        made.append(TcpTransport(TransportConfig(owner="test")))
        return made[-1]

    yield open_one
    for each in made:
        each.close()


def test_a_message_may_arrive_in_pieces(pair: Pair) -> None:
    sender, receiver = pair
    data = struct.pack("<QII", 7, 2, 3) + b"hdpay"
    for number in range(len(data)):
        assert receiver.receive() is None
        sender.socket.send(data[number : number + 1])
    assert receiver.receive() == Message(7, b"hd", memoryview(b"pay"))


def test_messages_do_not_run_into_each_other(pair: Pair) -> None:
    sender, receiver = pair
    for number in range(3):
        sender.send(Message(number, b"h" * number, None), SOON)
    received = [receiver.receive() for _ in range(3)]
    assert [each.header for each in received if each] == [b"", b"h", b"hh"]
    assert receiver.receive() is None


def test_a_receiver_that_stops_in_the_middle_is_given_up(pair: Pair) -> None:
    sender, receiver = pair
    with pytest.raises(TimeoutError):
        sender.send(Message(1, b"", bytes(10_000_000)), 0.0)
    with pytest.raises(OSError, match="Broken pipe"):
        sender.send(Message(1, b"", b""), 0.0)
    with pytest.raises(ConnectionResetError):
        receiver.receive()


def test_a_sender_waits_for_nothing_that_began_before_it(pair: Pair) -> None:
    sender, _ = pair
    with sender._sending, pytest.raises(TimeoutError):
        sender.send(Message(1, b"", b""), 0.0)


@pytest.mark.parametrize("lengths", [(5000, 0), (0, 2**32 - 1)])
def test_a_message_that_is_too_long_is_refused_before_it_takes_memory(pair: Pair, lengths: tuple[int, int]) -> None:
    sender, receiver = pair
    sender.socket.send(struct.pack("<QII", 1, *lengths))
    with pytest.raises(ConnectionAbortedError, match="octets"):
        receiver.receive()


def test_a_program_without_the_token_is_not_heard(opened: Callable[[], TcpTransport]) -> None:
    server, client = opened(), opened()
    link = server.server(query("a/B/c"), lambda payload, expires: Reply(Status.OK, payload))
    (_, entry), *_ = client.find("serves", "a/B/c")
    with client.connect(entry.address.rpartition(" ")[2]) as stranger:
        stranger.send(bytes(16))
        stranger.settimeout(SOON)
        assert stranger.recv(1) == b""
    assert not link.stats.malformed


def test_a_connection_that_breaks_ends_its_calls_and_is_made_again(opened: Callable[[], TcpTransport]) -> None:
    server, client = opened(), opened()
    arrived: list[object] = []

    def service(payload: object, expires: float) -> Reply:
        arrived.append(payload)
        if len(arrived) == 1:
            (peer,) = client.known_peers()
            assert isinstance(peer, Process)
            peer.connection.shut()
        return Reply(Status.OK, payload)  # type: ignore[arg-type]  # what came in

    server.server(query("a/B/c"), service)
    caller = client.caller(query("a/B/c"))
    assert caller.wait_peer(SOON)
    with pytest.raises(TransportError):
        caller.ask(blob(client, b"first"), SOON)
    wait_until(lambda: not client.known_peers())
    assert unblob(client, caller.ask(blob(client, b"second"), SOON).payload) == b"second"


def test_a_port_that_connects_to_itself_is_no_peer(opened: Callable[[], TcpTransport]) -> None:
    class Selfish(TcpTransport):
        def connect(self, place: str) -> socket.socket:
            one = socket.socket()
            one.bind(("127.0.0.1", 0))
            one.connect(one.getsockname())
            return one

    server = opened()
    server.server(query("a/B/c"), lambda payload, expires: Reply(Status.OK, payload))
    client = Selfish(TransportConfig(owner="test"))
    try:
        assert not client.caller(query("a/B/c")).wait_peer(0.2)
        assert not client.known_peers()
    finally:
        client.close()


def test_a_port_that_is_wrong_or_taken_is_told_and_leaves_nothing_behind(opened: Callable[[], TcpTransport]) -> None:
    other = opened()
    before = sorted(other.folder.rglob("*"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        for port in (taken.getsockname()[1], -1, "http"):
            with pytest.raises(ConfigurationError, match=f"port = {port!r}"):
                TcpTransport(TransportConfig({"port": port}))
    assert sorted(other.folder.rglob("*")) == before


def test_a_transport_that_does_not_say_whether_it_sent_a_request_is_told_at_once(
    opened: Callable[[], TcpTransport],
) -> None:
    class Silent(Caller):
        def post(self, *request: Any) -> bool:
            super().post(*request)
            return None  # type: ignore[return-value]  # the mistake

    class Mistaken(TcpTransport):
        ends = Ends(*TcpTransport.ends[:4], Silent, TcpTransport.ends.server)

    opened().server(query("a/B/c"), lambda payload, expires: Reply(Status.OK, payload))
    with contextlib.closing(Mistaken(TransportConfig(owner="test"))) as client:
        caller = client.caller(query("a/B/c"))
        assert caller.wait_peer(SOON)
        for ask in (caller.ask, caller.call):
            with pytest.raises(TypeError, match=r"Silent\.post must return whether"):
                ask(blob(client, b"x"), SOON)


def test_connections_get_equal_shares_if_each_asks_again_a_moment_after_its_answer(
    opened: Callable[[], TcpTransport],
) -> None:
    transport, lock, enough = opened(), threading.Lock(), threading.Event()
    pairs = [socket.socketpair() for _ in range(3)]
    shares, answered = Counter[int](), [0]

    def ask(number: int) -> None:
        pairs[number][0].send(b"?")

    def serve(number: int) -> None:
        with lock:
            if sum(shares.values()) == 300:
                enough.set()
                return
            shares[number] += 1
            answered.append(number)
            ask(answered.pop(0))  # the one before

    def take(number: int) -> Iterable[Callable[[], object]]:
        pairs[number][1].recv(1)
        return [partial(serve, number)]

    for number, (_, served) in enumerate(pairs):
        transport.watch(served, partial(take, number), bool)
    with lock:  # both ask before either is served
        ask(1)
        ask(2)
    assert enough.wait(SOON)
    for client, _ in pairs:
        client.close()
    assert min(shares.values()) >= 90, shares
