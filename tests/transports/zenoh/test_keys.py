"""Over a router that asks for certificates, components do what the graph says, and nothing else; others do nothing."""

from __future__ import annotations

import contextlib
import itertools
import queue
import socket as plain
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robocomp_py.contract.interface import Pattern, Verb
from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.deploy import certificates
from robocomp_py.deploy.certificates import Issued
from robocomp_py.deploy.plan import Plan
from robocomp_py.deploy.security import secured
from robocomp_py.errors import ConfigurationError, Refused, Unreachable
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Reply, Status, TransportConfig, TypeRef
from robocomp_py.transports.zenoh import session as sessions
from robocomp_py.transports.zenoh.deployment import router
from robocomp_py.transports.zenoh.neighbours import QUESTION
from robocomp_py.transports.zenoh.tls import client_settings
from robocomp_py.transports.zenoh.transport import ZenohTransport
from tests.freeports import free_port

from ...deploy.security_network import DAY, NOW, addressed, made, network, way
from ..zeromq.hosts import DIVIDE, MOVE, Tap, divide, quotient
from .test_transport import joined

LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)
NEWS = Channel("robot/camera/Everything/news", Pattern.PUBLISH, TypeRef("", e.news.fingerprint, e.news.text), LATCHED)
COUNT = Channel("robot/camera/Everything/count", Pattern.QUERY, TypeRef("", 3, "count"))


def graph(port: int) -> Plan:
    """`viewer` may do all of the above but count, `other` that and no more, and `stranger` nothing."""
    return network(
        way("viewer", "camera", "divide"),
        way("viewer", "camera", "move"),
        way("viewer", "camera", "news", Verb.SUBSCRIBES),
        way("other", "camera", "count"),
        names=("camera", "viewer", "other", "stranger"),
        router=f"tls/127.0.0.1:{port}",
    )


def guarded(plan: Plan, host: str, keys: Path) -> dict[str, Any]:
    """The settings of the router of a host, with its keys."""
    [helper] = (each for each in secured(plan, keys).helpers if each.host == host)
    return dict(helper.options["router"])


class World:
    """A router of a network, and who comes to it."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.plan, self.keys = graph(self.port), folder / "keys"
        made(self.plan, self.keys)
        self.endpoint = f"tls/127.0.0.1:{self.port}"
        self._everything, self._numbers = contextlib.ExitStack(), itertools.count()

    def router_settings(self) -> dict[str, Any]:
        return guarded(self.plan, "", self.keys)

    def route(self, **more: Any) -> None:
        self._everything.enter_context(sessions.named_router("Patrol", self.router_settings() | more))

    def open(self, name: str, endpoint: str = "") -> ZenohTransport:
        """A component, as if on a host of its own: it shares no folder with others that tells what is served."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("ROBOCOMP_RUNTIME_DIR", str(self.keys.parent / f"r{next(self._numbers)}"))
            return self._open(name, endpoint)

    def _open(self, name: str, endpoint: str) -> ZenohTransport:
        options = {"connect": endpoint or self.endpoint, "keys": str(self.keys / name)}
        opened = ZenohTransport(TransportConfig(options, name))
        self._everything.callback(opened.close)
        return opened

    def session(self, keys: Path | None) -> zenoh.Session:
        """Somebody who knows Zenoh, and not us."""
        opened: zenoh.Session = joined(self.endpoint, client_settings(keys))
        self._everything.callback(opened.close)
        return opened

    def authority(self) -> Issued:
        return Issued((self.keys / "ca" / "ca.pem").read_bytes(), (self.keys / "ca" / "ca.key").read_bytes())

    def close(self) -> None:
        self._everything.close()


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as name:  # short: socket paths have 107 bytes
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", name)
        yield Path(name)


@pytest.fixture
def world(folder: Path) -> Iterator[World]:
    opened = World(folder)
    opened.route()
    yield opened
    opened.close()


def answers(session: zenoh.Session, key: str) -> list[bytes]:
    """What is answered to a question, if anything is, and not that the time is over."""
    return [reply.ok.payload.to_bytes() for reply in session.get(key, timeout=1.0) if reply.ok]


def test_along_its_edges_a_component_calls_commands_and_hears(world: World) -> None:
    camera, viewer = world.open("camera"), world.open("viewer")
    moved, heard = queue.Queue[Any](), queue.Queue[Any]()
    divide(camera)
    camera.inlet(MOVE, moved.put)
    outlet = camera.outlet(NEWS)
    encode, decode = camera.codec.encoder(e.news.request), camera.codec.decoder(e.news.request)
    outlet.send(encode((0, "kept")))
    viewer.inlet(NEWS, heard.put)
    assert quotient(viewer, 17, 5) == (3, 2)
    assert viewer.caller(DIVIDE).call(camera.codec.encoder(e.divide.request)((4, 2)), SOON).result(SOON)
    command = viewer.outlet(MOVE)
    assert command.wait_peer(SOON)
    for number in range(200):  # more than may be on their way without a word from the other side
        command.send(b"\0\1\0\0" + bytes([number]), SOON)
    assert [moved.get(timeout=SOON)[4] for _ in range(200)] == list(range(200))
    assert decode(heard.get(timeout=SOON)) == (0, "kept")
    for number in range(1, 200):
        outlet.send(encode((number, "new")), SOON)
    assert [decode(heard.get(timeout=SOON))[0] for _ in range(1, 200)] == list(range(1, 200))


def test_a_subscriber_to_any_instance_hears_every_publisher(folder: Path) -> None:
    """Messages are counted at both ends; a reliable publisher also has to see its subscriber."""
    world = World(folder)
    anyone = "robot/*/Everything/news"
    subscribed = (way("viewer", each, "news", Verb.SUBSCRIBES, looked_up=anyone) for each in ("camera", "other"))
    world.plan = replace(world.plan, ways=tuple(subscribed))
    made(world.plan, world.keys)
    world.route()
    try:
        viewer, heard = world.open("viewer"), queue.Queue[Any]()
        viewer.inlet(replace(NEWS, name=anyone), heard.put)
        decode = viewer.codec.decoder(e.news.request)
        for name in ("camera", "other"):
            transport = world.open(name)
            outlet = transport.outlet(replace(NEWS, name=f"robot/{name}/Everything/news"))
            assert outlet.wait_peer(SOON)
            for number in range(100):
                outlet.send(transport.codec.encoder(e.news.request)((number, name)), SOON)
            assert [decode(heard.get(timeout=SOON)) for _ in range(100)] == [(number, name) for number in range(100)]
        assert heard.empty()
    finally:
        world.close()


def test_components_of_one_process_call_and_hear_each_other(folder: Path) -> None:
    world = World(folder)
    ways = way("camera", "camera", "divide"), way("camera", "camera", "news", Verb.SUBSCRIBES)
    world.plan = replace(world.plan, ways=ways)
    made(world.plan, world.keys)
    world.route()
    try:
        server, client, heard = world.open("camera"), world.open("camera"), queue.Queue[Any]()
        divide(server)
        assert quotient(client, 17, 5) == (3, 2)
        client.inlet(NEWS, heard.put)
        outlet = server.outlet(NEWS)
        assert outlet.wait_peer(SOON)
        outlet.send(server.codec.encoder(e.news.request)((1, "new")), SOON)
        assert client.codec.decoder(e.news.request)(heard.get(timeout=SOON)) == (1, "new")
    finally:
        world.close()


def test_what_the_keys_are_not_for_is_refused_at_once_and_told(world: World, caplog: pytest.LogCaptureFixture) -> None:
    camera, other = world.open("camera"), world.open("other")
    divide(camera)
    camera.inlet(MOVE, lambda _: None)
    camera.outlet(NEWS)
    watching = world.open("viewer")
    assert watching.caller(DIVIDE).wait_peer(SOON)
    for link in (other.caller(DIVIDE), other.outlet(MOVE)):
        wait_until(lambda link=link: link.faced())
        with pytest.raises(Refused, match=rf"{link.channel.name}: the keys of this process .* rcdeploy keys"):
            link.wait_peer(SOON)
    with pytest.raises(Refused):
        other.caller(DIVIDE).ask(b"", SOON)
    with pytest.raises(Refused):
        other.outlet(MOVE).send(b"", SOON)
    other.inlet(NEWS, lambda _: None)
    wait_until(lambda: any(NEWS.name in each.getMessage() for each in caplog.records))
    assert watching.caller(COUNT).wait_peer(0.0) is False  # what is not there is not refused


@pytest.mark.parametrize("who", ["other", "stranger"])
def test_an_instance_without_a_link_reaches_nothing_despite_a_valid_certificate(world: World, who: str) -> None:
    executed: list[object] = []
    camera, viewer = world.open("camera"), world.open("viewer")
    server_link = divide(camera, executed)
    heard, moved, false = queue.Queue[Any](), queue.Queue[Any](), queue.Queue[Any]()
    camera.inlet(MOVE, moved.put)
    outlet = camera.outlet(NEWS)
    viewer.inlet(NEWS, heard.put)
    assert outlet.wait_peer(SOON)
    session = world.session(world.keys / who)
    for key in ("rc/0/robot/camera/**", "rc_to/**", "rc_ack/**", "**"):
        session.declare_subscriber(key, false.put, allowed_origin=zenoh.Locality.REMOTE)
    session.put(f"rc/0/{MOVE.name}", b"x")
    session.put(f"rc/0/{NEWS.name}", b"x")
    server = camera.table.find("serves", DIVIDE.name)[0].link
    for key in (camera.requests(server, DIVIDE.name), camera.address("rc_to", server)):
        session.put(key, b"x")
    publisher = viewer.table.find("publishes", NEWS.name)[0].link
    history = f"{camera.address('rc_ask', publisher)}/history"
    for channel in ("", f"/{NEWS.name}", f"/{COUNT.name}"):
        assert answers(session, f"{history}{channel}") == []
    assert answers(session, f"rc/0/{DIVIDE.name}") == []
    outlet.send(camera.codec.encoder(e.news.request)((1, "secret")))
    assert heard.get(timeout=SOON)
    assert quotient(viewer, 17, 5) == (3, 2)
    assert (executed, false.qsize(), moved.qsize(), heard.qsize()) == ([(17, 5)], 0, 0, 0)
    assert server_link.stats.malformed == 0


def test_an_instance_cannot_serve_a_channel_of_another(world: World) -> None:
    camera, viewer = world.open("camera"), world.open("viewer")
    divide(world.open("other"))  # a channel of the camera's
    assert not viewer.caller(DIVIDE).wait_peer(0.3)
    divide(camera)
    assert quotient(viewer, 17, 5) == (3, 2)


def test_an_edge_is_good_for_itself_alone(world: World) -> None:
    camera, other = world.open("camera"), world.open("other")
    divide(camera)
    camera.server(COUNT, lambda _payload, _expires: Reply(Status.OK, b"\0\1\0\0"))
    count = other.caller(COUNT)
    assert count.wait_peer(SOON)
    assert count.ask(b"", SOON).status is Status.OK
    assert answers(world.session(world.keys / "other"), f"rc/0/{DIVIDE.name}") == []


# Who is not let in at all.


def rewrite(world: World, name: str, issued: Issued) -> None:
    folder = world.keys / name
    (folder / "certificate.pem").write_bytes(issued.certificate)
    (folder / "key.pem").write_bytes(issued.key)


def refused(world: World, name: str = "viewer") -> None:
    with pytest.raises(zenoh.ZError):
        sessions.open_client(world.endpoint, client_settings(world.keys / name))


@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("none", "it asks for a certificate, and this process has none; start it with --keys FOLDER"),
        ("expired", "the certificate of this process has expired"),
        ("foreign", "it trusts another authority"),
        ("foreign router", "it is not the router of this network"),
        ("plain", "it speaks TLS only"),
    ],
)
def test_a_client_that_the_router_refuses_learns_the_reason(world: World, what: str, why: str) -> None:
    foreign, past = certificates.make_authority("Patrol", NOW), NOW - 10 * DAY
    match what:
        case "expired":
            rewrite(world, "viewer", certificates.issue(world.authority(), "viewer", (), past, 9, serves=False))
        case "foreign":
            rewrite(world, "viewer", certificates.issue(foreign, "viewer", (), NOW, 30, serves=False))
        case "foreign router":
            (world.keys / "viewer" / "ca.pem").write_bytes(foreign.certificate)
    options = {"connect": world.endpoint, "keys": str(world.keys / "viewer")}
    if what in ("none", "plain"):
        options = {"connect": f"{'tls' if what == 'none' else 'tcp'}/127.0.0.1:{world.port}"}
    with pytest.raises(Refused, match=f"refuses this process: {why}"):
        ZenohTransport(TransportConfig(options))


def test_a_router_that_comes_back_with_another_authority_is_reported(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    world = World(folder)
    try:
        with sessions.named_router("Patrol", world.router_settings()):
            viewer = world.open("viewer")
        foreign = certificates.make_authority("x", NOW)
        rewrite(world, "router@", certificates.issue(foreign, "router@", ("127.0.0.1",), NOW, 30, serves=True))
        with sessions.named_router("Patrol", world.router_settings()):
            told = "refuses this process: it is not the router of this network"
            wait_until(lambda: told in caplog.text)
            with pytest.raises(Unreachable):
                viewer.caller(DIVIDE).ask(b"", 0.1)
    finally:
        world.close()


def test_a_certificate_of_another_authority_is_refused(world: World) -> None:
    other = certificates.make_authority("Patrol", NOW)
    rewrite(world, "viewer", certificates.issue(other, "viewer", (), NOW, 30, serves=False))
    refused(world)


def test_an_expired_certificate_is_refused(world: World) -> None:
    past = NOW - 10 * DAY
    rewrite(world, "viewer", certificates.issue(world.authority(), "viewer", (), past, 9, serves=False))
    refused(world)


def test_a_peer_without_certificate_is_refused(world: World) -> None:
    settings = {"transport/link/tls/root_ca_certificate": str(world.keys / "viewer" / "ca.pem")}
    with pytest.raises(zenoh.ZError):
        sessions.open_client(world.endpoint, settings)


def test_a_plain_client_is_refused(world: World) -> None:
    with pytest.raises(zenoh.ZError):
        sessions.open_client(f"tcp/127.0.0.1:{world.port}")


def test_a_good_certificate_in_a_name_that_the_graph_does_not_know_is_good_for_nothing(world: World) -> None:
    camera = world.open("camera")
    divide(camera)
    rewrite(world, "stranger", certificates.issue(world.authority(), "eve", (), NOW, 30, serves=False))
    session = world.session(world.keys / "stranger")
    assert list(session.liveliness().get("rc_lv/**", timeout=1.0)) == []
    assert answers(session, f"rc/0/{DIVIDE.name}") == []


def test_without_a_certificate_the_routers_own_socket_is_good_for_nothing(world: World) -> None:
    divide(world.open("camera"))
    session = joined(sessions.resolved("here/Patrol"))
    try:
        assert list(session.liveliness().get("rc_lv/**", timeout=1.0)) == []
        assert answers(session, f"rc/0/{DIVIDE.name}") == []
    finally:
        session.close()


@pytest.mark.parametrize("how", ["another authority", "another name", "a certificate for clients"])
def test_a_router_that_is_not_the_networks_is_not_talked_to(folder: Path, how: str) -> None:
    world = World(folder)
    authority = certificates.make_authority("x", NOW) if how == "another authority" else world.authority()
    addresses, serves = (("10.9.9.9",), True) if how == "another name" else (("127.0.0.1",), "name" in how)
    serves = serves or how == "another authority"
    rewrite(world, "router@", certificates.issue(authority, "router@", addresses, NOW, 30, serves=serves))
    try:
        world.route()
        refused(world)
    finally:
        world.close()


def test_four_hundred_silent_connections_do_not_block_others(world: World) -> None:
    """Zenoh sends each away after ten seconds."""
    with contextlib.ExitStack() as opened:
        where = "127.0.0.1", world.port
        for _ in range(400):
            opened.enter_context(plain.create_connection(where))
        divide(world.open("camera"))
        assert quotient(world.open("viewer"), 17, 5) == (3, 2)


def test_what_was_recorded_of_an_encrypted_connection_is_worth_nothing(world: World) -> None:
    executed: list[object] = []
    camera, moved = world.open("camera"), queue.Queue[Any]()
    divide(camera, executed)
    camera.inlet(MOVE, moved.put)
    tap = Tap(world.port)
    try:
        viewer = world.open("viewer", tap.address.replace("tcp://", "tls/"))
        assert quotient(viewer, 17, 5) == (3, 2)
        command = viewer.outlet(MOVE)
        assert command.wait_peer(SOON)
        command.send(b"\0\1\0\0")
        assert moved.get(timeout=SOON)
        (recorded,) = map(bytes, tap.said)
        assert len(recorded) > 1000
    finally:
        tap.close()
    with plain.create_connection(("127.0.0.1", world.port)) as again:
        again.settimeout(SOON)
        again.sendall(recorded)
        with contextlib.suppress(ConnectionResetError, BrokenPipeError):
            while again.recv(65536):
                pass  # its part of a handshake that cannot be completed, and then it hangs up
    assert (executed, moved.qsize()) == ([(17, 5)], 0)


# Two routers.


def test_a_hosts_router_passes_on_what_its_own_processes_may_do_and_no_more(folder: Path) -> None:
    world = World(folder)
    there = f"tls/127.0.0.1:{free_port()}"
    hosts = {"viewer": "onboard", "stranger": "onboard"}
    plan = world.plan = replace(
        world.plan,
        processes=tuple(replace(each, host=hosts.get(each.name, "")) for each in world.plan.processes),
        helpers=(*world.plan.helpers, router("onboard", {"router": {"listen/endpoints": [there]}}, *addressed(there))),
    )
    made(plan, world.keys)
    onboard = {"listen/endpoints": [there], "connect/endpoints": [world.endpoint]}
    with sessions.named_router("Onboard", onboard | guarded(plan, "onboard", world.keys)):
        world.route()
        try:
            executed: list[object] = []
            divide(world.open("camera"), executed)
            viewer = world.open("viewer", there)
            assert quotient(viewer, 7, 2) == (3, 1)
            session = world.session(world.keys / "router@onboard")  # in wrong hands, with all that this host may do
            session.put(f"rc/0/{NEWS.name}", b"x")
            assert answers(session, f"rc/0/{COUNT.name}") == []
            assert answers(session, f"{QUESTION}/*") == [b""]  # routers may ask each other whether they answer
            with pytest.raises(zenoh.ZError):
                sessions.open_client(there, client_settings(None))
            assert executed == [(7, 2)]
        finally:
            world.close()


# What is wrong with the files.


@pytest.mark.parametrize("name", ["ca.pem", "certificate.pem", "key.pem", "identity.json"])
def test_a_file_that_is_missing_is_named_before_anything_is_opened(folder: Path, name: str) -> None:
    made(graph(1), folder / "keys")
    (folder / "keys" / "viewer" / name).unlink()
    with pytest.raises(ConfigurationError, match=f"{name}: No such file.*rcdeploy keys"):
        ZenohTransport(TransportConfig({"connect": "tls/127.0.0.1:1", "keys": str(folder / "keys" / "viewer")}))


def test_a_secret_key_that_others_can_read_is_refused(folder: Path) -> None:
    made(graph(1), folder / "keys")
    (folder / "keys" / "viewer" / "key.pem").chmod(0o644)
    with pytest.raises(ConfigurationError, match="chmod 600"):
        ZenohTransport(TransportConfig({"connect": "tls/127.0.0.1:1", "keys": str(folder / "keys" / "viewer")}))
