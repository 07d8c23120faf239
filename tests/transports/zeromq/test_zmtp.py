"""Our side of ZMTP, against the library's, and against one that sends it octet by octet."""

from __future__ import annotations

import contextlib
import os
import socket as plain
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq

from robocomp_py.contract.types import FLOAT64, UINT8, Field, Sequence, Struct
from robocomp_py.testing.conformance import query, topic
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Status, SupportsSubscribers, TransportConfig
from robocomp_py.transports.zeromq import peer
from robocomp_py.transports.zeromq.frames import Frames
from robocomp_py.transports.zeromq.sockets import Subscription
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
from robocomp_py.transports.zeromq.zmtp import Feed, Garbled, Gone, Stream
from robocomp_py.wire.arrays import snapshot

from .test_faults import GREETING, ready

SIZES = (0, 1, 253, 254, 255, 256, 257, 8191, 8193, 16_384, 65_535, 65_536, 70_000, 3_000_000)
ARRAYS = Struct("Arrays", (Field("octets", Sequence(UINT8)), Field("numbers", Sequence(FLOAT64))))


def patience() -> Callable[[], None]:
    """To be called when nothing happened for a while; does not let that happen for ever."""
    left = iter(range(int(SOON * 20)))
    return lambda: None if next(left, None) is not None else pytest.fail("nothing came")


def received(stream: Stream | Feed) -> Frames:
    wait = patience()
    while True:
        try:
            return stream.receive()
        except BlockingIOError:
            wait()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "socket"


@pytest.fixture
def router(path: Path) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.RCVTIMEO, int(SOON * 1000))
        socket.bind(f"ipc://{path}")
        yield socket


@pytest.fixture
def raw(path: Path) -> Iterator[Callable[[], plain.socket]]:
    """The other side of the next connection, in octets."""
    with contextlib.ExitStack() as opened:
        listener = opened.enter_context(plain.socket(plain.AF_UNIX))
        listener.bind(str(path))
        listener.listen()
        yield lambda: opened.enter_context(listener.accept()[0])


def hear_out(other: plain.socket, kind: bytes = b"DEALER") -> None:
    """Read the greeting that every peer sends first."""
    left = len(GREETING + ready(kind))
    while left:
        left -= len(other.recv(left))


def test_messages_of_any_size_and_number_of_frames_pass(path: Path, router: zmq.Socket[bytes]) -> None:
    stream = Stream(str(path), patience())
    for size in SIZES:
        data = os.urandom(size)
        for sent in ([data], [b"first", data], [data, b"", data], [b"a", np.arange(size // 8, dtype=np.float64).data]):
            echo = threading.Thread(target=lambda: router.send_multipart(router.recv_multipart()))
            echo.start()
            stream.send(sent, patience())
            assert [bytes(frame) for frame in received(stream)] == [bytes(frame) for frame in sent]
            echo.join()
    stream.close()


def test_a_message_may_come_octet_by_octet(path: Path, raw: Callable[[], plain.socket]) -> None:
    done = threading.Event()

    def serve() -> None:
        other = raw()
        message = b"\1\5first\2" + (300).to_bytes(8, "big") + bytes(300)
        for octet in GREETING + ready(b"ROUTER") + message:
            other.sendall(bytes([octet]))
        done.wait(SOON)

    thread = threading.Thread(target=serve)
    thread.start()
    stream = Stream(str(path), patience())
    assert received(stream) == [b"first", bytes(300)]
    done.set()
    thread.join()
    stream.close()


def test_a_subscription_may_be_greeted_octet_by_octet(path: Path, raw: Callable[[], plain.socket]) -> None:
    feed = Feed(str(path), [b"a/b\0", b"c"])
    other = raw()
    hear_out(other, b"SUB")
    news: Frames = []
    for octet in GREETING + ready(b"XPUB") + b"\1\5a/b\0x" + b"\2" + (9000).to_bytes(8, "big") + bytes(9000):
        assert not news
        other.sendall(bytes([octet]))
        with contextlib.suppress(BlockingIOError):
            news = feed.receive()
    assert [bytes(frame) for frame in news] == [b"a/b\0x", bytes(9000)]
    assert other.recv(100) == b"\0\5\1a/b\0" + b"\0\2\1c"
    feed.close()


def test_a_ping_is_answered(path: Path, raw: Callable[[], plain.socket]) -> None:
    answered: list[bytes] = []

    def serve() -> None:
        other = raw()
        other.sendall(GREETING + ready(b"ROUTER") + b"\4\x0b\4PING\0\x0aseen" + b"\0\4news")
        hear_out(other)
        answered.append(other.recv(100))

    thread = threading.Thread(target=serve)
    thread.start()
    stream = Stream(str(path), patience())
    assert received(stream) == [b"news"]
    thread.join()
    assert answered == [b"\4\x09\4PONGseen"]
    stream.close()


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (b"\0\4ha", Gone),
        (b"\2" + (2**40).to_bytes(8, "big"), Garbled),
        (b"\4\x0a\5ERROR\3bad", Garbled),
        (b"", Gone),
    ],
)
def test_the_end_of_a_connection_is_reported(
    path: Path, raw: Callable[[], plain.socket], words: bytes, kind: type[Gone]
) -> None:
    def serve() -> None:
        with raw() as other:
            hear_out(other)
            other.sendall(GREETING + ready(b"ROUTER") + words)

    thread = threading.Thread(target=serve)
    thread.start()
    stream = Stream(str(path), patience())
    with pytest.raises(Gone) as caught:
        received(stream)
    assert caught.type is kind
    thread.join()
    stream.close()


@pytest.mark.parametrize("words", [b"", b"\4\x07\4PING\0\0"], ids=["nothing", "a ping"])
def test_a_publisher_that_goes_before_it_is_answered_has_gone(
    path: Path, raw: Callable[[], plain.socket], words: bytes
) -> None:
    feed = Feed(str(path), [b"a"])
    with raw() as other:
        other.sendall(GREETING + ready(b"XPUB"))
        if words:
            with contextlib.suppress(BlockingIOError):
                feed.receive()
            other.sendall(words)
    with pytest.raises(Gone):
        feed.receive()
    feed.close()


def test_pings_may_go_on_for_ever(path: Path, raw: Callable[[], plain.socket]) -> None:
    feed = Feed(str(path), [b"a"])
    with raw() as other:
        other.sendall(GREETING + ready(b"XPUB"))
        for _ in range(700):  # more than a message may have frames
            other.sendall(b"\4\x07\4PING\0\0" * 100)
            with pytest.raises(BlockingIOError):
                feed.receive()
        other.sendall(b"\0\4news")
        assert feed.receive() == [b"news"]
    feed.close()


@pytest.mark.parametrize(("begin", "drop"), [(b"\2" + (10**6).to_bytes(8, "big"), b"x"), (b"", b"\1\0")])
def test_the_wait_function_is_called_however_slowly_a_message_arrives(
    path: Path, raw: Callable[[], plain.socket], begin: bytes, drop: bytes
) -> None:
    asked, ended = threading.Event(), list[bool]()

    def serve() -> None:
        other = raw()
        other.sendall(GREETING + ready(b"ROUTER") + begin)
        for _ in range(int(SOON * 100)):
            if asked.wait(0.01):
                return
            other.sendall(drop)
        ended.append(True)

    thread = threading.Thread(target=serve)
    thread.start()
    stream = Stream(str(path), patience())
    with pytest.raises(BlockingIOError):
        stream.receive()
    asked.set()
    thread.join()
    assert not ended
    stream.close()


def test_there_is_no_more_when_half_a_message_is_there_or_the_subscription_was_closed(
    path: Path, raw: Callable[[], plain.socket]
) -> None:
    subscription = Subscription(Feed(str(path), [b"a"]), lambda _: [])
    other = raw()
    other.sendall(GREETING + ready(b"XPUB") + b"\0\1a\0\1b\0\5half")
    assert (subscription.receive(1), subscription.more) == ([[b"a"]], True)
    assert (subscription.receive(9), subscription.more) == ([[b"b"]], False)
    assert (subscription.receive(9), subscription.more) == ([], False)
    other.sendall(b"!\0\1a")
    assert (subscription.receive(1), subscription.more) == ([[b"half!"]], True)
    subscription.close()
    assert (subscription.receive(1), subscription.more) == ([], False)


def test_messages_that_came_at_once_are_received_in_order_and_no_more_than_are_wanted(
    path: Path, raw: Callable[[], plain.socket]
) -> None:
    subscription = Subscription(Feed(str(path), [b"a"]), lambda _: [])
    other = raw()
    long = b"\2" + (300).to_bytes(8, "big") + bytes(300)
    two_frames, ping = b"\1\1x\0\1y", b"\4\7\4PING\0\0"
    other.sendall(GREETING + ready(b"XPUB") + b"\0\1a\0\0" + long + b"\0\1b" + two_frames + ping + b"\0\1c" + long)
    assert (subscription.receive(2), subscription.more) == ([[b"a"], [b""]], True)
    assert (subscription.receive(9), subscription.more) == (
        [[bytes(300)], [b"b"], [b"x", b"y"], [b"c"], [bytes(300)]],
        False,
    )
    subscription.close()


def test_the_rest_of_a_large_frame_may_be_late(path: Path, raw: Callable[[], plain.socket]) -> None:
    feed = Feed(str(path), [b"a"])
    other = raw()
    half = bytes(range(200)) * 100
    other.sendall(GREETING + ready(b"XPUB") + b"\2" + (2 * len(half)).to_bytes(8, "big") + half)
    for _ in range(3):
        with pytest.raises(BlockingIOError):
            feed.receive()
    other.sendall(half + b"\0\1a")
    assert [bytes(frame) for frame in feed.receive()] == [2 * half]
    assert feed.receive() == [b"a"]
    feed.close()


def test_many_small_frames_without_an_end_are_not_collected(path: Path, raw: Callable[[], plain.socket]) -> None:
    def serve() -> None:
        other = raw()
        with contextlib.suppress(OSError):
            other.sendall(GREETING + ready(b"ROUTER"))
            while True:
                other.sendall(b"\1\0" * 100_000)

    thread = threading.Thread(target=serve)
    thread.start()
    stream = Stream(str(path), patience())
    with pytest.raises(Garbled):
        received(stream)
    stream.close()
    thread.join()


@pytest.fixture
def transports() -> Iterator[tuple[ZeroMQTransport, ZeroMQTransport]]:
    both = ZeroMQTransport(TransportConfig()), ZeroMQTransport(TransportConfig())
    yield both
    for each in both:
        each.close()


def test_large_arrays_are_received_without_being_copied(transports: tuple[ZeroMQTransport, ZeroMQTransport]) -> None:
    here, there = transports
    seen: list[Frames] = []
    values = np.arange(1_000_000, dtype=np.uint8), np.linspace(0, 1, 100_000)
    encode, decode = here.codec.encoder(ARRAYS), here.codec.decoder(ARRAYS)

    def service(payload: Frames, expires: float) -> Reply:
        seen.append(payload)
        return Reply(Status.OK, encode(decode(payload)))

    here.server(query("a/b/c"), service)
    caller, outlet = there.caller(query("a/b/c")), there.outlet(topic("a/b/t"))
    here.inlet(topic("a/b/t"), seen.append)
    assert caller.wait_peer(SOON)
    assert outlet.wait_peer(SOON)
    seen.append(caller.ask(encode(values), SOON).payload)
    outlet.send(encode(values))
    wait_until(lambda: len(seen) == 3)
    for payload in seen:
        for frame, array, value in zip(payload[1:], decode(payload), values, strict=True):
            assert np.shares_memory(array, np.frombuffer(frame, np.uint8))
            assert np.array_equal(array, value)
            assert not array.flags.writeable
            assert np.shares_memory(snapshot(array, array.dtype), array), "it is copied to be sent on"


def test_a_publisher_notices_that_its_last_subscriber_has_gone(
    transports: tuple[ZeroMQTransport, ZeroMQTransport],
) -> None:
    here, there = transports
    outlet = there.outlet(topic("a/b/t"))
    inlet = here.inlet(topic("a/b/t"), lambda _: None)
    assert outlet.wait_peer(SOON)
    assert isinstance(outlet, SupportsSubscribers)
    assert outlet.has_subscribers
    inlet.close()
    wait_until(lambda: not outlet.has_subscribers)


def test_a_slow_greeting_that_the_server_rejected_is_repeated(
    transports: tuple[ZeroMQTransport, ZeroMQTransport], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = transports
    here.server(query("a/b/c"), lambda payload, expires: Reply(Status.OK, payload))
    caller, greeted = there.caller(query("a/b/c")), list[str]()
    assert caller.wait_peer(SOON)

    def greet(path: str, wait: Callable[[], None]) -> Stream:
        greeted.append(path)
        if len(greeted) == 1:
            raise Gone("it has closed the connection")
        return Stream(path, wait)

    monkeypatch.setattr(peer, "Stream", greet)
    assert caller.ask([b"?"], SOON).status is Status.OK
    assert len(greeted) == 2
