"""Components on several hosts meet over TCP; with keys, only along the edges of the graph."""

from __future__ import annotations

import contextlib
import queue
import shutil
import socket as plain
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zmq

from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.errors import ConfigurationError, Timeout, Unreachable
from robocomp_py.testing import everything as e
from robocomp_py.testing.parts import in_time
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Reply, Status, TypeRef, wait_connected
from robocomp_py.transports.keyfiles import Rights, read_public
from robocomp_py.transports.members import Entry
from robocomp_py.transports.senders import delivered, signing
from robocomp_py.transports.zeromq import remote
from robocomp_py.transports.zeromq.curve import Curve, key_pair
from robocomp_py.transports.zeromq.remote import DIRECTORY, host_of, mechanism_at, read_record, record
from robocomp_py.transports.zeromq.sockets import new_socket
from robocomp_py.wire import header as head

from .hosts import DIVIDE, MOVE, NEWS, Hosts, Tap, divide, news, quotient

# Over TCP.


@pytest.mark.parametrize("with_keys", [True, False])
def test_a_call_a_command_and_a_topic_reach_another_host(hosts: Hosts, with_keys: bool) -> None:
    camera, viewer = hosts.camera(with_keys=with_keys), hosts.user("viewer", with_keys=with_keys)
    moved, heard = queue.Queue[Any](), queue.Queue[Any]()
    divide(camera)
    camera.inlet(MOVE, moved.put)
    outlet = camera.outlet(NEWS)
    viewer.inlet(NEWS, heard.put)
    assert quotient(viewer, 17, 5) == (3, 2)
    command = viewer.outlet(MOVE)
    assert command.wait_peer(SOON)
    command.send([b"\x90"])
    assert bytes(moved.get(timeout=SOON)[0]) == b"\x90"
    assert outlet.wait_peer(SOON)
    outlet.send(news(camera, 1, "hello"))
    assert camera.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (1, "hello")


def test_a_server_knows_which_instance_on_another_host_called(hosts: Hosts) -> None:
    camera, viewer = hosts.camera(), hosts.user("viewer")
    callers = []

    def service(payload: Any, _: float) -> Reply:
        sender = delivered()
        callers.append(sender() if sender else "")
        return Reply(Status.REFUSED)

    camera.server(replace(DIVIDE, signed=True), signing(service))
    caller = viewer.caller(DIVIDE)
    assert caller.wait_peer(SOON)

    def is_known() -> bool:
        with contextlib.suppress(Unreachable):
            caller.ask(viewer.codec.encoder(e.divide.request)((1, 1)), SOON)
        return callers[-1] == "viewer"

    wait_until(is_known)


def test_a_restarted_server_is_found_and_calls_do_not_wait_for_the_old_one(hosts: Hosts) -> None:
    viewer = hosts.user("viewer")
    for _ in range(2):
        camera = hosts.camera()
        divide(camera)
        assert quotient(viewer, 7, 2) == (3, 1)
        camera.close()
        caller = viewer.caller(DIVIDE)
        wait_until(lambda: not caller.wait_peer(0))  # noqa: B023  # called before the next round
        with pytest.raises(Unreachable):
            caller.ask([], SOON)
        caller.close()


def test_a_subscriber_receives_the_first_message_of_a_restarted_publisher(hosts: Hosts) -> None:
    viewer, heard = hosts.user("viewer"), queue.Queue[Any]()
    viewer.inlet(NEWS, heard.put)
    for number in range(3):
        camera = hosts.camera()
        outlet = camera.outlet(NEWS)
        assert wait_connected(outlet, SOON)
        outlet.send(news(camera, number, "first"))
        assert camera.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (number, "first")
        camera.close()


def test_a_new_subscriber_receives_from_running_publishers(hosts: Hosts) -> None:
    camera = hosts.camera()
    outlet = camera.outlet(NEWS)
    for number in range(3):
        viewer, heard = hosts.user("viewer"), queue.Queue[Any]()
        assert wait_connected(viewer.inlet(NEWS, heard.put), SOON)
        outlet.send(news(camera, number, "next"))
        assert camera.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (number, "next")
        viewer.close()


def test_a_client_of_a_new_server_receives_what_its_call_makes_it_publish(hosts: Hosts) -> None:
    viewer, heard = hosts.user("viewer"), queue.Queue[Any]()
    viewer.inlet(NEWS, heard.put)
    asking = viewer.caller(DIVIDE)
    for number in range(5):
        camera = hosts.camera()
        outlet = camera.outlet(NEWS)

        def service(
            _payload: Any, _expires: float, outlet: Any = outlet, camera: Any = camera, n: int = number
        ) -> Reply:
            outlet.send(news(camera, n, "asked"))
            return Reply(Status.OK, [])

        camera.server(DIVIDE, service)
        assert asking.wait_peer(SOON)
        asking.ask([], SOON)
        assert camera.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (number, "asked")
        camera.close()
        wait_until(lambda: not asking.wait_peer(0))


def test_what_a_member_newly_serves_is_found_once_we_are_connected_to_its_topics(tmp_path: Path) -> None:
    neighbours = remote.Neighbours(tmp_path)

    def hear(*entries: Entry) -> None:
        neighbours.hear(read_record(record("7-1", "eve", 7, entries), "eve", at="tcp://10.0.0.2:7501", rights=Rights()))

    def found(name: str) -> bool:
        return bool(neighbours.find("serves", name))

    first, second = (Entry("serves", f"robot/camera/Everything/{name}", 1, "") for name in ("divide", "work"))
    topic = Entry("publishes", NEWS.name, 1, "", "tcp://*:41000#0a1b2c")
    hear(first, topic)
    assert neighbours.find("publishes", NEWS.name)
    assert not found(first.channel)
    assert neighbours.settle(lambda member_id: False)
    assert not found(first.channel)
    assert not neighbours.settle(lambda member_id: member_id == "eve@7-1")
    assert found(first.channel)
    hear(first, topic, second)
    assert (found(first.channel), found(second.channel)) == (True, False)


def test_a_late_subscriber_gets_latched_messages_and_a_reliable_one_loses_nothing(hosts: Hosts) -> None:
    latched = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)
    channel = Channel(NEWS.name, NEWS.pattern, NEWS.type, latched)
    camera, viewer = hosts.camera(), hosts.user("viewer")
    outlet = camera.outlet(channel)
    for number in range(3):
        outlet.send(news(camera, number, "old"))
    heard = queue.Queue[Any]()
    viewer.inlet(channel, heard.put)
    assert outlet.wait_peer(SOON)
    for number in range(3, 300):
        outlet.send(news(camera, number, "new"), SOON)
    decode = camera.codec.decoder(e.news.request)
    assert [decode(heard.get(timeout=SOON))[0] for _ in range(299)] == list(range(1, 300))


def test_another_contract_is_logged_on_both_sides(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    camera, viewer = hosts.camera(), hosts.user("viewer")
    divide(camera)
    other = Channel(DIVIDE.name, Pattern.QUERY, TypeRef("", 12345, "operation other"))
    caller = viewer.caller(other)
    wait_until(lambda: f"{12345:016x} here" in caplog.text)
    wait_until(lambda: f"{12345:016x} there" in caplog.text)
    caller.close()


def test_an_invalid_address_is_an_error_before_anything_is_opened(hosts: Hosts) -> None:
    for address in ("192.168.1.5:7501", "tcp://:7501", "tcp://*:7501", 7501):
        with pytest.raises(ConfigurationError, match=r"connect\.camera"):
            hosts.open("viewer", connect={"camera": address}, with_keys=False)
        shutil.rmtree(hosts._folder / "h0")


def test_listening_on_all_addresses_without_keys_is_a_warning(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    hosts.open("camera", bind="tcp://0.0.0.0:1", with_keys=False)  # nothing is served yet, so nothing is bound
    assert "listens at tcp://0.0.0.0:1 without keys" in caplog.text
    caplog.clear()
    hosts.open("camera", bind="tcp://0.0.0.0:1")
    hosts.open("camera", bind="tcp://127.0.0.1:1", with_keys=False)
    assert "without keys" not in caplog.text


# Who may come.


def tries(hosts: Hosts, secure: Callable[[Any], object] | None, channel: Channel = DIVIDE) -> zmq.Socket[Any]:
    """Somebody who has asked, by whatever means of its own."""
    socket = new_socket(hosts.outsider.context, zmq.DEALER, secure, LINGER=0, RCVTIMEO=int(SOON * 1000))
    hosts.outsider.sockets.append(socket)
    socket.connect(hosts.address)
    request = head.pack_request(0, channel.type.fingerprint, 5, 1, None)
    socket.send(channel.name.encode() + b"\0" + request + b"\x92\x11\x05")
    return socket


def key_of(hosts: Hosts, name: str, server: str = "camera") -> Callable[[Any], object]:
    public = read_public(hosts.keys / server / "curve.key")[0]
    return Curve(*key_pair(hosts.keys / name / "curve.key_secret")).ask(public)


def test_a_client_without_a_link_is_refused_despite_keys_of_the_network(
    hosts: Hosts, caplog: pytest.LogCaptureFixture
) -> None:
    executed: list[object] = []
    divide(hosts.camera(), executed)
    socket = tries(hosts, key_of(hosts, "stranger"))
    wait_until(lambda: "its key is not admitted" in caplog.text)
    assert quotient(hosts.user("viewer"), 9, 3) == (3, 0)
    assert not socket.poll(0)
    assert executed == [(9, 3)]


def test_a_client_with_another_link_is_refused_the_operations_outside_it(
    hosts: Hosts, caplog: pytest.LogCaptureFixture
) -> None:
    executed: list[object] = []
    divide(hosts.camera(), executed)
    reply = tries(hosts, key_of(hosts, "other")).recv()
    assert head.read_reply(reply[: head.REPLY_BYTES]).status == Status.REFUSED
    assert executed == []
    assert "it has no right to it" in caplog.text


def test_a_client_with_another_link_does_not_learn_of_operations_outside_it(hosts: Hosts) -> None:
    camera, other = hosts.camera(), hosts.user("other")
    divide(camera)
    count = Channel("robot/camera/Everything/count", Pattern.QUERY, TypeRef("", 3, "count"))
    camera.server(count, lambda _payload, _expires: Reply(Status.OK, []))
    caller = other.caller(count)
    assert caller.wait_peer(SOON)
    assert not other.directory.find("serves", DIVIDE.name)


def test_a_topic_is_heard_along_its_edges_alone(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    camera = hosts.camera()
    outlet = camera.outlet(NEWS)
    heard = queue.Queue[Any]()
    hosts.user("viewer").inlet(NEWS, heard.put)
    assert outlet.wait_peer(SOON)
    port = next(iter(camera._topic_ports.values())).rpartition(":")[2].partition("#")[0]
    listeners = []
    for secure in (key_of(hosts, "other"), key_of(hosts, "stranger"), None):
        socket = new_socket(hosts.outsider.context, zmq.SUB, secure, LINGER=0)
        hosts.outsider.sockets.append(socket)
        socket.subscribe(b"")
        socket.connect(f"tcp://127.0.0.1:{port}")
        listeners.append(socket)
    for number in range(20):
        outlet.send(news(camera, number, ""))
        heard.get(timeout=SOON)
    assert not any(socket.poll(0) for socket in listeners)


@pytest.mark.parametrize("who", ["a plain client", "one with a wrong key of the server", "one with a key of its own"])
def test_clients_outside_the_network_are_refused(hosts: Hosts, who: str) -> None:
    executed: list[object] = []
    divide(hosts.camera(), executed)
    unknown = Curve(*zmq.curve_keypair()).ask(read_public(hosts.keys / "camera" / "curve.key")[0])
    secure = {"a plain client": None, "one with a key of its own": unknown}.get(
        who, key_of(hosts, "viewer", server="stranger")
    )
    socket = tries(hosts, secure)
    assert quotient(hosts.user("viewer"), 9, 3) == (3, 0)
    assert not socket.poll(0)
    assert executed == [(9, 3)]


def test_a_server_that_has_not_the_key_we_know_is_not_talked_to(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    shutil.copytree(hosts.keys / "camera", hosts.keys / "impostor")
    for name in ("curve.key_secret", "curve.key"):
        shutil.copy(hosts.keys / "stranger" / name, hosts.keys / "impostor" / name)
    divide(hosts.open("impostor", bind=hosts.address))
    viewer = hosts.user("viewer")
    caller = viewer.caller(DIVIDE)
    wait_until(lambda: f"at {hosts.address} (camera)" in caplog.text)
    assert not caller.wait_peer(0)


def test_a_client_without_keys_gets_an_error_that_says_so(hosts: Hosts, caplog: pytest.LogCaptureFixture) -> None:
    divide(hosts.camera())
    caller = hosts.user("viewer", with_keys=False).caller(DIVIDE)
    told = f"viewer: this process has no keys, and needs some (start it with --keys FOLDER) at {hosts.address} (camera)"
    wait_until(lambda: told in caplog.text)
    assert not caller.wait_peer(0)


@pytest.mark.parametrize(("with_keys", "mechanism"), [(True, b"CURVE"), (False, b"NULL")])
def test_what_a_server_demands_is_known_before_it_closes_the_connection(
    hosts: Hosts, with_keys: bool, mechanism: bytes
) -> None:
    divide(hosts.camera(with_keys=with_keys))
    assert mechanism_at(hosts.address) == mechanism


def test_without_a_key_of_a_server_nothing_is_opened(hosts: Hosts) -> None:
    (hosts.keys / "viewer" / "peers" / "camera.key").unlink()
    with pytest.raises(ConfigurationError, match=r"no public key of `camera` in .*camera\.key; make keys again"):
        hosts.user("viewer")


def test_entries_that_a_server_has_no_right_to_are_ignored(hosts: Hosts) -> None:
    """The camera's keys are in wrong hands: they are good for the camera's channels, and for no others."""
    camera, viewer = hosts.camera(), hosts.user("viewer")
    gripper = Channel("robot/gripper/Everything/divide", Pattern.QUERY, DIVIDE.type)
    camera.server(gripper, lambda _payload, _expires: Reply(Status.OK, []))
    assert divide(camera)
    assert quotient(viewer, 4, 2) == (2, 0)
    assert not viewer.directory.find("serves", gripper.name)


def test_a_client_cannot_announce_a_server() -> None:
    told = record("7-1", "eve", 7, [Entry(role, DIVIDE.name, 1, "", "tcp://6.6.6.6:1") for role in ("serves", "calls")])
    member = read_record(told, "eve", at="", rights=Rights())
    assert [entry.role for entry in member.entries] == ["calls"]


def test_a_process_that_was_stopped_itself_does_not_count_others_as_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(remote, "time", SimpleNamespace(monotonic=lambda: now[0]))
    neighbours = remote.Neighbours(tmp_path)
    other = read_record(record("7-1", "eve", 7, []), "eve", at="", rights=Rights())
    neighbours.hear(other)
    now[0] += 60.0
    neighbours.listen()
    assert neighbours.alive(other.id)
    for _ in range(5):
        now[0] += 0.25
        neighbours.listen()
    assert neighbours.alive(other.id)
    now[0] += 0.25
    assert not neighbours.alive(other.id)


def test_addresses_of_topics_are_on_the_host_of_their_server() -> None:
    told = record("7-1", "eve", 7, [Entry("publishes", NEWS.name, 1, "", "tcp://6.6.6.6:41000#0a1b2c")])
    (entry,) = read_record(told, "eve", at="tcp://10.0.0.2:7501", rights=Rights()).entries
    assert entry.address == "tcp://10.0.0.2:41000#0a1b2c"
    assert host_of(entry.address) == "10.0.0.2"


# What was recorded, and who says nothing.


def test_what_was_recorded_of_an_encrypted_connection_is_worth_nothing(
    hosts: Hosts, caplog: pytest.LogCaptureFixture
) -> None:
    executed: list[object] = []
    divide(hosts.camera(), executed)
    port = int(hosts.address.rpartition(":")[2])
    tap = Tap(port)
    try:
        assert quotient(hosts.user("viewer", tap.address), 17, 5) == (3, 2)
        recorded = [bytes(each) for each in tap.said]
        assert len(recorded) >= 2  # one to find each other, one for the calling thread
    finally:
        tap.close()
    for each in recorded:
        with plain.create_connection(("127.0.0.1", port)) as again:
            again.settimeout(SOON)
            again.sendall(each)
            with contextlib.suppress(ConnectionResetError):
                while again.recv(65536):
                    pass  # its own greeting, and then it hangs up
    assert executed == [(17, 5)]


def test_a_command_that_is_sent_again_is_executed_once(hosts: Hosts) -> None:
    """By a process with the keys; without keys, any program can record and resend messages."""
    camera = hosts.camera(with_keys=False)
    moved = queue.Queue[Any]()
    inlet = camera.inlet(MOVE, moved.put)
    socket = hosts.outsider.dealer(hosts.address)
    frames = [MOVE.name.encode() + b"\0" + head.pack_request(1, 7, 5, number, None) + b"\x90" for number in (1, 2)]
    for frame in (frames[0], frames[0], frames[1], frames[0]):
        socket.send(frame)
    wait_until(lambda: inlet.stats.repeated == 2)
    assert moved.qsize() == 2


def test_four_hundred_silent_connections_do_not_block_others_and_are_closed(hosts: Hosts) -> None:
    divide(hosts.camera())
    where = "127.0.0.1", int(hosts.address.rpartition(":")[2])
    with contextlib.ExitStack() as opened:
        silent = [opened.enter_context(plain.create_connection(where)) for _ in range(400)]
        assert quotient(hosts.user("viewer"), 17, 5) == (3, 2)
        for each in silent:  # ZeroMQ gives them two seconds
            each.settimeout(SOON)
            with contextlib.suppress(ConnectionResetError):
                while each.recv(4096):
                    pass


@pytest.mark.parametrize(
    "told",
    [b"", b"[", b"{}", b"[1,2]", b'{"id":1,"owner":2,"pid":3,"entries":4}', b"[" * 100_000, b'{"id":"x"}', b"\xff\xfe"],
)
def test_garbage_sent_to_the_directory_does_no_harm(hosts: Hosts, told: bytes) -> None:
    camera = hosts.camera(with_keys=False)
    divide(camera)
    socket = hosts.outsider.dealer(hosts.address)
    socket.send(DIRECTORY + head.pack_request(0, 0, 5, 1, None) + told)
    assert quotient(hosts.user("viewer", with_keys=False), 17, 5) == (3, 2)
    assert {member.owner for member, _ in camera.directory._far.values()} == {"viewer"}


def test_a_call_that_cannot_be_sent_ends_at_its_deadline(hosts: Hosts) -> None:
    camera, viewer = hosts.camera(), hosts.user("viewer")
    held = threading.Event()
    camera.server(DIVIDE, lambda _payload, _expires: (held.wait(SOON), Reply(Status.OK, []))[1])
    caller = viewer.caller(DIVIDE)
    assert caller.wait_peer(SOON)
    with pytest.raises(Timeout):
        in_time(caller.ask([], 0.2))
    held.set()
