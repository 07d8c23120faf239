"""ZeroMQ seen from outside: a plain pyzmq and msgpack program, a hostile one, and the files left behind."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket as plain
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.errors import AlreadyServed, ConfigurationError, TransportError, Unreachable
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import answering, blob, command, query, topic
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Status, TransportConfig, TypeRef
from robocomp_py.transports.members import Entry
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.zeromq.topics import Subscriber
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
from robocomp_py.wire import header
from tests.freeports import free_port

from .outsider import DIVIDE, NAMED, Outsider, address_of, reply_of, serve_division

NEWS = Channel("robot/calculator/Everything/news", Pattern.PUBLISH, TypeRef("", e.news.fingerprint, e.news.text))

pytestmark = pytest.mark.usefixtures("own_runtime_folder")  # a failed test may leave `a/b/c` served


@pytest.fixture
def transport() -> Iterator[ZeroMQTransport]:
    opened = ZeroMQTransport(TransportConfig(owner="calculator"))
    yield opened
    opened.close()


@pytest.fixture
def outsider() -> Iterator[Outsider]:
    opened = Outsider()
    yield opened
    opened.close()


def test_a_script_can_call_a_query(transport: ZeroMQTransport, outsider: Outsider) -> None:
    serve_division(transport)
    socket = outsider.dealer(address_of(transport, "serves", DIVIDE))
    head = header.pack_request(0, e.divide.fingerprint, 77, 1, 5.0)
    socket.send(NAMED + head + msgpack.packb([17, 5]))
    reply, body = reply_of(socket)
    assert (reply.status, reply.client) == (Status.OK, 77)
    assert msgpack.unpackb(body) == [3, 2]


def test_a_script_can_listen_to_a_topic(transport: ZeroMQTransport, outsider: Outsider) -> None:
    outlet = transport.outlet(NEWS)
    socket = outsider.socket(zmq.SUB)
    named = NEWS.name.encode() + b"\0"
    socket.subscribe(named)
    socket.connect(address_of(transport, "publishes", NEWS))
    assert outlet.wait_peer(SOON)
    outlet.send(transport.codec.encoder(e.news.request)((1, "hello")))
    message = socket.recv()
    begin = len(named) + header.PUBLICATION_BYTES
    assert (message[: len(named)], msgpack.unpackb(message[begin:])) == (named, [1, "hello"])
    assert header.read_publication(message[len(named) : begin]).sequence == 1


def test_operations_are_served_over_tcp_where_the_configuration_says_so(outsider: Outsider) -> None:
    port = free_port()
    transport = ZeroMQTransport(TransportConfig({"bind": f"tcp://127.0.0.1:{port}"}, "calculator"))
    try:
        serve_division(transport)
        socket = outsider.dealer(f"tcp://127.0.0.1:{port}")
        head = header.pack_request(0, e.divide.fingerprint, 1, 1, None)
        socket.send(NAMED + head + msgpack.packb([7, 2]))
        assert msgpack.unpackb(reply_of(socket)[1]) == [3, 1]
    finally:
        transport.close()


def test_a_taken_tcp_address_is_an_error_that_names_it(outsider: Outsider) -> None:
    taken = outsider.socket(zmq.ROUTER)
    port = taken.bind_to_random_port("tcp://127.0.0.1")
    transport = ZeroMQTransport(TransportConfig({"bind": f"tcp://127.0.0.1:{port}"}))
    try:
        with pytest.raises(TransportError, match=rf"127\.0\.0\.1:{port}.*in use"):
            serve_division(transport)
    finally:
        transport.close()


def test_what_is_not_served_is_refused(transport: ZeroMQTransport, outsider: Outsider) -> None:
    serve_division(transport)
    socket = outsider.dealer(address_of(transport, "serves", DIVIDE))
    socket.send(b"no/such/Interface/op\0" + header.pack_request(0, 1, 2, 3, 1.0) + b"\x90")
    assert reply_of(socket)[0].status == Status.REFUSED


def test_a_call_under_another_contract_gets_ours(transport: ZeroMQTransport, outsider: Outsider) -> None:
    link = serve_division(transport)
    socket = outsider.dealer(address_of(transport, "serves", DIVIDE))
    socket.send(NAMED + header.pack_request(0, 12345, 2, 3, 1.0) + msgpack.packb([1, 1]))
    reply, text = reply_of(socket)
    assert reply.status == Status.MISMATCH
    assert text.decode() == e.divide.text
    wait_until(lambda: link.stats.mismatched == 1)


def test_a_repeated_request_is_not_executed_again(transport: ZeroMQTransport, outsider: Outsider) -> None:
    link = serve_division(transport)
    socket = outsider.dealer(address_of(transport, "serves", DIVIDE))
    for sequence in (1, 1, 1, 2):
        head = header.pack_request(0, e.divide.fingerprint, 9, sequence, 1.0)
        socket.send(NAMED + head + msgpack.packb([9, sequence]))
    assert [msgpack.unpackb(reply_of(socket)[1]) for _ in range(2)] == [[9, 0], [4, 1]]
    assert (link.stats.repeated, link.stats.received) == (2, 2)


def test_an_expired_request_is_not_executed(transport: ZeroMQTransport, outsider: Outsider) -> None:
    link = serve_division(transport)
    socket = outsider.dealer(address_of(transport, "serves", DIVIDE))
    head = header.pack_request(0, e.divide.fingerprint, 9, 1, 0.0)
    socket.send(NAMED + head + msgpack.packb([9, 1]))
    assert reply_of(socket)[0].status == Status.EXPIRED
    assert (link.stats.expired, link.stats.received) == (1, 0)


def test_garbage_does_no_harm(transport: ZeroMQTransport, outsider: Outsider, caplog: pytest.LogCaptureFixture) -> None:
    link = serve_division(transport)
    socket = outsider.dealer(address_of(transport, "serves", DIVIDE))
    good = header.pack_request(0, e.divide.fingerprint, 5, 1, 5.0)
    for number in range(300):
        noise = b"\xff" + secrets.token_bytes(number)  # no version of ours
        for frames in ([noise], [NAMED + noise], [NAMED, noise, noise], [noise, NAMED + good, noise], [b"", b"", b""]):
            socket.send_multipart(frames)
    socket.send(NAMED + good + msgpack.packb([8, 3]))
    while (answer := reply_of(socket))[0].status != Status.OK:
        pass
    assert msgpack.unpackb(answer[1]) == [2, 2]
    assert link.stats.malformed >= 300
    assert sum(DIVIDE.name in record.message for record in caplog.records) == 1


def test_garbage_on_a_topic_is_dropped_and_counted(
    transport: ZeroMQTransport, outsider: Outsider, tmp_path: Path
) -> None:
    heard: list[Any] = []
    channel = topic("a/b/c")
    publisher = outsider.socket(zmq.XPUB)
    address = f"ipc://{runtime_dir()}/forger"
    publisher.bind(address)
    forger = transport.directory.join("forger")
    forger.add(Entry("publishes", channel.name, channel.type.fingerprint, channel.type.text, address))
    link, outlet = transport.inlet(channel, heard.append), transport.outlet(channel)
    publisher.recv()
    for number in range(200):
        publisher.send_multipart([b"a/b/c\0" + secrets.token_bytes(number % 33), b"x"])
        publisher.send(b"a/b/c\0")
    wait_until(lambda: link.stats.malformed == 400)
    assert outlet.wait_peer(SOON)
    outlet.send(blob(transport, b"good"))
    wait_until(lambda: len(heard) == 1)
    forger.close()


def test_a_hostile_stream_of_bytes_does_not_stop_the_server(outsider: Outsider) -> None:
    """Not even ZeroMQ's own protocol is spoken."""
    port = free_port()
    transport = ZeroMQTransport(TransportConfig({"bind": f"tcp://127.0.0.1:{port}"}))
    try:
        serve_division(transport)
        for _ in range(50):
            with plain.create_connection(("127.0.0.1", port)) as connection:
                connection.sendall(secrets.token_bytes(200))
        asking = outsider.dealer(f"tcp://127.0.0.1:{port}")
        head = header.pack_request(0, e.divide.fingerprint, 1, 1, None)
        asking.send(NAMED + head + msgpack.packb([7, 2]))
        assert msgpack.unpackb(reply_of(asking)[1]) == [3, 1]
    finally:
        transport.close()


def test_commands_that_waited_too_long_are_dropped(transport: ZeroMQTransport) -> None:
    heard: list[bytes] = []
    entered, release = threading.Event(), threading.Event()

    def sink(payload: Any) -> None:
        heard.append(payload)
        entered.set()
        release.wait(SOON)

    link = transport.inlet(command("a/b/c"), sink)
    outlet = transport.outlet(command("a/b/c"))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(transport, b"first"))
    assert entered.wait(SOON)
    outlet.send(blob(transport, b"stale"), 0.01)
    wait_until(lambda: link._lane._waiting)  # type: ignore[attr-defined]
    threading.Event().wait(0.02)  # its deadline passes while it waits for its turn
    release.set()
    wait_until(lambda: link.stats.expired == 1)
    assert len(heard) == 1


def test_networks_with_different_run_time_folders_do_not_meet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = ZeroMQTransport(TransportConfig())
    ours.server(query("a/b/c"), answering(ours, bytes.upper))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path))
        theirs = ZeroMQTransport(TransportConfig())
    caller = theirs.caller(query("a/b/c"))
    assert not caller.wait_peer(0.2)
    theirs.close()
    ours.close()


def test_a_run_time_folder_too_deep_for_sockets_is_an_error_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / ("x" * 100)))
    with pytest.raises(ConfigurationError, match="ROBOCOMP_RUNTIME_DIR"):
        ZeroMQTransport(TransportConfig())


def test_an_unknown_option_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigurationError, match="unknown transport option 'port'"):
        ZeroMQTransport(TransportConfig({"port": 5555}))


def test_nothing_is_left_behind(transport: ZeroMQTransport) -> None:
    folder = runtime_dir() / "zeromq"
    other = ZeroMQTransport(TransportConfig())
    other.server(query("a/b/c"), answering(other, bytes.upper))
    other.outlet(topic("a/b/d"))
    mine = {name for name in os.listdir(folder) if name.startswith(other.member.id)}
    assert len(mine) >= 4
    other.close()
    assert not {name for name in os.listdir(folder) if name.startswith(other.member.id)}
    assert not list((folder / "served").glob("a.b.c*"))


def test_of_two_servers_that_come_at_the_same_moment_one_is_refused(transport: ZeroMQTransport) -> None:
    other = ZeroMQTransport(TransportConfig(owner="other"))
    for number in range(30):
        channel, together = query(f"a/b/c{number}"), threading.Barrier(2)
        served: list[Any] = []
        refused: list[AlreadyServed] = []

        def come(mine: ZeroMQTransport) -> None:
            together.wait(SOON)  # noqa: B023 - both threads end within the round
            try:
                served.append(mine.server(channel, answering(mine, bytes.upper)))  # noqa: B023
            except AlreadyServed as exc:
                refused.append(exc)  # noqa: B023

        threads = [threading.Thread(target=come, args=(each,)) for each in (transport, other)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert (len(served), len(refused)) == (1, 1)
        assert f"(pid {os.getpid()})" in str(refused[0])
        served[0].close()
    other.close()


def test_a_publisher_that_comes_while_a_subscription_is_opened_is_heard(
    transport: ZeroMQTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes after the subscriber has looked, and the receiving thread sees it before it knows the subscriber."""
    other = ZeroMQTransport(TransportConfig())
    outlets: list[Any] = []
    announce = Subscriber.announce

    def interrupted(self: Subscriber, address: str = "") -> None:
        announce(self, address)
        outlets.append(other.outlet(topic("a/b/c")))
        version = transport.directory.version()
        wait_until(lambda: transport._known >= version)

    monkeypatch.setattr(Subscriber, "announce", interrupted)
    link = transport.inlet(topic("a/b/c"), lambda _: None)
    assert outlets[0].wait_peer(SOON)
    assert link.wait_peer(SOON)
    other.close()


def _remove(folder: Path) -> None:
    """At once: removing one file after the other would race with the transport."""
    folder.rename(folder.with_name(f"gone-{secrets.token_hex(4)}"))


def test_a_link_that_cannot_be_opened_says_why(transport: ZeroMQTransport) -> None:
    _remove(runtime_dir() / "zeromq")
    for opening in (
        lambda: transport.outlet(topic("a/b/c")),
        lambda: transport.inlet(topic("a/b/c"), lambda _: None),
        lambda: transport.server(query("a/b/d"), answering(transport, bytes.upper)),
    ):
        with pytest.raises(TransportError, match="No such file"):
            opening()
    assert transport._links == []


def test_a_run_time_folder_that_was_removed_ends_calls_and_hinders_no_closing(transport: ZeroMQTransport) -> None:
    other = ZeroMQTransport(TransportConfig())
    transport.server(query("a/b/c"), answering(transport, bytes.upper))
    caller = other.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    _remove(runtime_dir() / "zeromq")
    wait_until(lambda: not caller.wait_peer(0.0))
    with pytest.raises(Unreachable):
        caller.ask(blob(other, b"x"), SOON)
    before = set(threading.enumerate())
    other.close()
    assert len(before - set(threading.enumerate())) >= 2  # the one that receives, and the lookout


def test_whatever_fails_in_closing_everything_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    before = set(threading.enumerate())
    transport = ZeroMQTransport(TransportConfig())
    first, second = transport.outlet(topic("a/b/c")), transport.outlet(topic("a/b/d"))

    def fail() -> None:
        raise RuntimeError("on purpose")

    monkeypatch.setattr(second, "release", fail)
    with pytest.raises(RuntimeError, match="on purpose"):
        transport.close()
    assert first.closed.is_set()
    assert set(threading.enumerate()) <= before  # others may end
    assert transport.reactor.context.closed


def test_what_was_published_before_a_publisher_left_is_heard(transport: ZeroMQTransport) -> None:
    channel, begin, heard = topic("a/b/c", QoS(Reliability.RELIABLE, depth=1000)), threading.Event(), list[Any]()
    link = transport.inlet(channel, lambda payload: (begin.wait(SOON), heard.append(payload)))
    publishing = ZeroMQTransport(TransportConfig())
    outlet = publishing.outlet(channel)
    assert outlet.wait_peer(SOON)
    for _ in range(1050):
        outlet.send(blob(publishing, bytes(200)), SOON)
    publishing.close()
    wait_until(lambda: not transport.directory.find("publishes", "a/b/c"))
    begin.set()
    wait_until(lambda: len(heard) == 1050)
    assert link.stats.lost == 0
    assert isinstance(link, Subscriber)
    wait_until(lambda: not link._feeds)


def test_clients_keep_no_descriptors_of_servers_that_have_gone(transport: ZeroMQTransport) -> None:
    caller, inlet = transport.caller(query("a/b/c")), transport.inlet(topic("a/b/d"), lambda payload: None)

    def life() -> int:
        with contextlib.closing(ZeroMQTransport(TransportConfig())) as other:
            other.server(query("a/b/c"), answering(other, bytes.upper))
            other.outlet(topic("a/b/d"))
            assert caller.wait_peer(SOON)
            assert inlet.wait_peer(SOON)
            assert caller.ask(blob(transport, b"x"), SOON).status is Status.OK
        wait_until(lambda: not transport._peers)
        return len(os.listdir("/dev/fd"))

    first = life()
    wait_until(lambda: life() <= first)


def test_a_transport_outlives_a_time_without_file_descriptors() -> None:
    """In a process of its own, since everything in it needs them."""
    code = """
import os, resource
from robocomp_py.errors import TransportError
from robocomp_py.testing.conformance import answering, blob, query, topic, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
here, there = ZeroMQTransport(TransportConfig()), ZeroMQTransport(TransportConfig())
here.server(query("a/b/c"), answering(here, bytes.upper))
caller = there.caller(query("a/b/c"))
assert caller.wait_peer(SOON)
assert caller.ask(blob(there, b"x"), SOON)
resource.setrlimit(resource.RLIMIT_NOFILE, (256, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
held = []
try:
    while True:
        held.append(os.open("/dev/null", 0))
except OSError:
    pass
os.utime(here.folder / "by" / "a.b")
wait_until(lambda: here.directory._unreadable and there.directory._unreadable)
for opening in (lambda: ZeroMQTransport(TransportConfig()), lambda: there.outlet(topic("a/b/d"))):
    try:
        opening()
    except TransportError as exc:
        assert "Too many open files" in str(exc)
    else:
        raise AssertionError("opened without descriptors")
for each in held:
    os.close(each)
print(unblob(there, caller.call(blob(there, b"later"), SOON).result(SOON).payload).decode())
there.close()
here.close()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=SOON * 6)
    assert (done.stdout, done.returncode) == ("LATER\n", 0), done.stderr
