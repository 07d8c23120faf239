"""One connection of another host takes neither the memory of a component nor the place of others."""

from __future__ import annotations

import contextlib
import os
import queue
import socket
import threading
from dataclasses import replace
from typing import Any

import pytest
import zmq

from robocomp_py.errors import TransportError
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Status, SupportsSubscribers
from robocomp_py.transports.members import Entry, Member
from robocomp_py.transports.zeromq import guard, remote
from robocomp_py.transports.zeromq.bounds import SUBSCRIBED, UNFINISHED, Kind
from robocomp_py.transports.zeromq.frames import topic, welcome_topic
from robocomp_py.transports.zeromq.sockets import new_socket, send_frames
from robocomp_py.wire import header as head

from ... import strangers
from .hosts import DIVIDE, NEWS, Hosts, divide, news, quotient

MIB = strangers.MEBIBYTE

SLACK = 500 * MIB
"""What may arrive between two looks of a slow machine."""

CLOSED = "closed a connection of 127.0.0.1"


def port_of(address: str) -> int:
    return int(address.rpartition(":")[2].partition("#")[0])


def test_a_message_without_an_end_is_cut_off_and_others_are_served(
    hosts: Hosts, caplog: pytest.LogCaptureFixture
) -> None:
    divide(hosts.camera(with_keys=False))
    viewer = hosts.user("viewer", with_keys=False)
    assert quotient(viewer, 17, 5) == (3, 2)
    with contextlib.closing(strangers.connection(port_of(hosts.address))) as stranger:
        sent, closed = strangers.pour(stranger, lambda: strangers.PART_OF_A_MESSAGE, UNFINISHED + SLACK)
    assert closed, f"not after {sent // MIB} MiB"
    wait_until(lambda: "it sent a message of more than 256 MiB" in caplog.text)
    assert quotient(viewer, 19, 5) == (3, 4)


def test_a_key_that_is_admitted_makes_no_difference(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    divide(hosts.camera())
    viewer = hosts.user("viewer")
    secure, _ = viewer.secure_for("camera")
    stranger = new_socket(hosts.outsider.context, zmq.DEALER, secure, LINGER=0, SNDTIMEO=100, RECONNECT_IVL=-1)
    hosts.outsider.sockets.append(stranger)
    stranger.connect(hosts.address)
    frame = zmq.Frame(bytes(MIB), copy=False)
    with contextlib.suppress(zmq.Again):  # it is sent meanwhile, and then the connection is gone
        stranger.send_multipart([frame] * 1500, copy=False)
    wait_until(lambda: CLOSED in caplog.text)
    assert quotient(viewer, 17, 5) == (3, 2)


def test_a_guard_without_a_thread_is_an_error_and_leaves_nothing_open(
    hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    hosts.user("viewer", with_keys=False).close()  # whatever the first one opens for all that follow
    before = len(os.listdir("/proc/self/fd"))
    monkeypatch.setattr(guard, "start_thread", lambda thread: False)
    with pytest.raises(TransportError, match="no thread can be started"):
        hosts.user("viewer", with_keys=False)
    wait_until(lambda: len(os.listdir("/proc/self/fd")) <= before)  # fewer, if garbage of other tests was collected


def test_a_socket_that_comes_while_the_transport_closes_does_not_keep_the_context_open() -> None:
    context = zmq.Context()
    watching = guard.Guard(context, "late")
    watching.close()
    with context.socket(zmq.DEALER) as late, pytest.raises(TransportError, match="closed"):
        watching.watch(late, Kind.MESSAGES)
    ending = threading.Thread(target=context.term, daemon=True)
    ending.start()
    ending.join(SOON)
    assert not ending.is_alive()


def test_many_large_messages_are_no_reason_to_close_a_connection(
    hosts: Hosts, caplog: pytest.LogCaptureFixture
) -> None:
    divide(hosts.camera(with_keys=False))
    honest = hosts.outsider.dealer(hosts.address)
    large = bytes(64 * MIB)
    for number in range(1, 8):
        request = b"robot/nothing\0" + head.pack_request(0, 1, 5, number, None)
        send_frames(honest, [request, large])
        assert head.read_reply(honest.recv()[: head.REPLY_BYTES]).sequence == number
    assert CLOSED not in caplog.text


def test_a_server_that_sends_a_message_without_an_end_is_cut_off(
    hosts: Hosts, caplog: pytest.LogCaptureFixture
) -> None:
    ended: list[bool] = []

    def answer(opened: socket.socket) -> None:
        opened.sendall(strangers.GREETING + strangers.ready(b"ROUTER"))
        part = strangers.PART_OF_A_MESSAGE
        ended.append(strangers.pour(opened, lambda: part, UNFINISHED + SLACK)[1])

    with strangers.server(answer) as port:
        hosts.user("viewer", f"tcp://127.0.0.1:{port}", with_keys=False)
        wait_until(lambda: bool(ended))
    assert ended == [True]
    wait_until(lambda: "it sent a message of more than 256 MiB" in caplog.text)


def test_a_flood_of_subscriptions_is_cut_off_and_logged_once(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    camera, viewer = hosts.camera(with_keys=False), hosts.user("viewer", with_keys=False)
    outlet = camera.outlet(NEWS)
    got: list[object] = []
    viewer.inlet(NEWS, got.append)
    assert outlet.wait_peer(SOON)
    [(_, entry)] = viewer.directory.find("publishes", NEWS.name)
    told = f"it subscribed with more than {SUBSCRIBED // 1024} KiB"

    def is_told_of_a_flood() -> bool:
        with contextlib.closing(strangers.connection(port_of(entry.address), b"XSUB")) as stranger:
            sent, closed = strangers.pour(stranger, strangers.subscriptions, 64 * MIB)
        assert closed, f"not after {sent} octets"
        return told in caplog.text

    # on a busy machine, a connection may end before the guard has looked at it
    wait_until(is_told_of_a_flood, 6 * SOON)
    for _ in range(2):
        is_told_of_a_flood()
    assert caplog.text.count(told) == 1
    outlet.send([b"\x92\x01\xa5hello"])
    wait_until(lambda: bool(got))


def test_a_publisher_that_is_flooded_with_subscriptions_hears_others(hosts: Hosts) -> None:
    camera = hosts.camera(with_keys=False)
    camera.outlet(NEWS)
    port = port_of(next(iter(camera._topic_ports.values())))
    other = replace(NEWS, name="robot/other/Everything/news")
    heard = queue.Queue[Any]()
    outlet = camera.outlet(other)
    camera.inlet(other, heard.put)
    assert outlet.wait_peer(SOON)
    with strangers.flood(port):
        for number in range(1000):
            outlet.send(news(camera, number, ""))
            assert camera.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (number, "")


def test_unsubscribing_without_a_subscription_silences_no_other(hosts: Hosts) -> None:
    camera, viewer = hosts.camera(with_keys=False), hosts.user("viewer", with_keys=False)
    outlet = camera.outlet(NEWS)
    heard = queue.Queue[Any]()
    viewer.inlet(NEWS, heard.put)
    assert outlet.wait_peer(SOON)
    [(_, entry)] = viewer.directory.find("publishes", NEWS.name)
    named, mark = topic(NEWS.name), welcome_topic("57a9e2")
    with contextlib.closing(strangers.connection(port_of(entry.address), b"XSUB")) as stranger:
        stranger.settimeout(SOON)
        said = b""
        while b"READY" not in said:
            said += stranger.recv(4096)
        stranger.sendall(50 * (bytes([0, 1 + len(named), 0]) + named) + bytes([0, 1 + len(mark), 1]) + mark)
        while mark not in said:
            said += stranger.recv(4096)
        assert isinstance(outlet, SupportsSubscribers)
        assert outlet.has_subscribers
    outlet.send(news(camera, 1, "hello"))
    assert camera.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (1, "hello")


def test_a_reply_goes_to_its_client_and_not_to_an_impostor(hosts: Hosts) -> None:
    camera, asked, may_answer = hosts.camera(with_keys=False), threading.Event(), threading.Event()

    def service(payload: Any, _: float) -> Reply:
        asked.set()
        may_answer.wait(SOON)
        return Reply(Status.OK, payload)

    camera.server(DIVIDE, service)
    honest = hosts.outsider.socket(zmq.DEALER)
    honest.setsockopt(zmq.ROUTING_ID, b"honest")
    honest.connect(hosts.address)
    honest.send(topic(DIVIDE.name) + head.pack_request(0, DIVIDE.type.fingerprint, 5, 1, None))
    assert asked.wait(SOON)
    with contextlib.closing(strangers.connection(port_of(hosts.address), identity=b"honest")) as stranger:
        stranger.settimeout(SOON)
        said = b""
        while b"READY" not in said:
            said += stranger.recv(4096)
        later = hosts.outsider.dealer(hosts.address)
        later.send(topic("robot/nothing") + head.pack_request(0, 1, 6, 1, None))
        assert head.read_reply(later.recv()[: head.REPLY_BYTES]).status == Status.REFUSED  # so it has seen the stranger
        may_answer.set()
        assert head.read_reply(honest.recv()[: head.REPLY_BYTES]).client == 5


def test_silent_connections_make_room_for_others(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    divide(hosts.camera())
    with contextlib.ExitStack() as opened:
        silent = [
            opened.enter_context(socket.create_connection(("127.0.0.1", port_of(hosts.address)))) for _ in range(400)
        ]
        wait_until(lambda: "silent connections" in caplog.text)
        silent[0].settimeout(SOON)
        with contextlib.suppress(ConnectionResetError):
            while silent[0].recv(4096):
                pass
        assert quotient(hosts.user("viewer"), 17, 5) == (3, 2)


def test_what_others_tell_of_themselves_is_bounded_in_all(hosts: Hosts) -> None:
    directory = hosts.camera(with_keys=False).directory
    entries = tuple(Entry("calls", f"robot/{number}", 1, "") for number in range(remote.MOST_ENTRIES // 4))
    member = Member("a@tcp", "a", 1, entries)
    heard = [directory.hear(replace(member, id=f"{number}@tcp")) for number in range(6)]
    assert heard == [True] * 4 + [False] * 2
    assert not directory.hear(replace(member, id="0@tcp"))  # it is no news
    assert directory.hear(replace(member, id="0@tcp", entries=()))
    assert directory.hear(replace(member, id="5@tcp"))


def test_zeromq_sends_no_heartbeats_for_they_may_end_the_process(hosts: Hosts) -> None:
    """libzmq 4.3.5: "Assertion failed: !_io_error", if a peer goes whose messages wait."""
    socket = new_socket(hosts.outsider.context, zmq.SUB, None, **remote.to_far(hosts.address))
    hosts.outsider.sockets.append(socket)
    assert socket.getsockopt(zmq.HEARTBEAT_IVL) == 0
    assert socket.getsockopt(zmq.TCP_KEEPALIVE) == 1
