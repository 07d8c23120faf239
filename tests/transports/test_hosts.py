"""Transports as `rcdeploy` sets them up for several hosts; here all of them are this one."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.interface import Pattern
from robocomp_py.errors import ConfigurationError, Timeout, TransportError
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Reply, Status, TransportConfig, hosting
from robocomp_py.transports.dds.domain import settings
from robocomp_py.transports.dds.transport import DDSTransport
from robocomp_py.transports.zenoh.transport import ZenohTransport
from tests.freeports import free_port

DIVIDE = Channel("robot/camera/Everything/divide", Pattern.QUERY, type_of(e.divide, Pattern.QUERY))
TICK = Channel("robot/camera/Everything/divided", Pattern.PUBLISH, type_of(e.divide, Pattern.PUBLISH))


@pytest.fixture
def everything(monkeypatch: pytest.MonkeyPatch) -> Iterator[contextlib.ExitStack]:
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as name, contextlib.ExitStack() as stack:
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", name)  # short: socket paths have 107 bytes
        yield stack


def quotient_of(caller: Any, transport: Any, *numbers: int) -> object:
    """What is answered; asked again if two routers that have only just met lose the question."""
    request = transport.codec.encoder(e.divide.request)(numbers)
    replies: list[Reply] = []

    def answered() -> bool:
        with contextlib.suppress(Timeout):
            replies.append(caller.ask(request, 1.0))
        return bool(replies)

    wait_until(answered)
    return transport.codec.decoder(e.divide.response)(replies[0].payload)


def serve(transport: Any) -> None:
    decode, encode = transport.codec.decoder(e.divide.request), transport.codec.encoder(e.divide.response)
    transport.server(DIVIDE, lambda payload, _: Reply(Status.OK, encode(divmod(*decode(payload)))))


def run_routers(everything: contextlib.ExitStack) -> None:
    """Those of two hosts: `robot` listens, `base` connects; as options of who runs them."""
    at = f"tcp/127.0.0.1:{free_port()}"
    for name, router in (
        ("base", {"listen/endpoints": [], "connect/endpoints": [at]}),  # the one that connects may be first
        ("robot", {"listen/endpoints": [at], "connect/endpoints": []}),
    ):
        config = TransportConfig({"connect": f"here/{name}", "router": router}, "rcdeploy")
        everything.enter_context(hosting("zenoh", config))


def zenoh(everything: contextlib.ExitStack, name: str) -> ZenohTransport:
    opened = ZenohTransport(TransportConfig({"connect": f"here/{name}"}, name))
    everything.callback(opened.close)
    return opened


def test_components_of_two_zenoh_routers_that_are_connected_meet(everything: contextlib.ExitStack):
    run_routers(everything)
    robot, base = zenoh(everything, "robot"), zenoh(everything, "base")
    serve(robot)
    caller = base.caller(DIVIDE)
    assert caller.wait_peer(SOON)
    assert quotient_of(caller, base, 7, 3) == (2, 1)


def test_what_is_published_behind_one_zenoh_router_is_heard_behind_the_other(everything: contextlib.ExitStack):
    run_routers(everything)
    robot, base = zenoh(everything, "robot"), zenoh(everything, "base")
    heard: list[object] = []
    base.inlet(TICK, lambda payload: heard.append(base.codec.decoder(e.divide.request)(payload)))
    outlet = robot.outlet(TICK)
    assert outlet.wait_peer(SOON)

    def published() -> bool:
        outlet.send(robot.codec.encoder(e.divide.request)((7, 3)))
        return bool(heard)

    wait_until(published)
    assert heard[0] == (7, 3)


def test_a_zenoh_router_of_a_name_is_run_once(everything: contextlib.ExitStack):
    run_routers(everything)
    config = TransportConfig({"connect": "here/robot", "router": {}}, "rcdeploy")
    with pytest.raises(TransportError, match="`robot` is already run by"):
        everything.enter_context(hosting("zenoh", config))


def test_a_zenoh_router_leaves_nothing(everything: contextlib.ExitStack, tmp_path: Path):
    with contextlib.ExitStack() as routers:
        run_routers(routers)
    with contextlib.ExitStack() as routers:
        run_routers(routers)


def dds(everything: contextlib.ExitStack, **options: Any) -> DDSTransport:
    opened = DDSTransport(TransportConfig({"domain": 77, **options}, "host"))
    everything.callback(opened.close)
    return opened


def test_components_meet_over_dds_by_the_addresses_of_their_hosts(everything: contextlib.ExitStack):
    options = {"interface": "127.0.0.1", "peers": ["127.0.0.1"]}
    robot, base = dds(everything, **options), dds(everything, **options)
    serve(robot)
    caller = base.caller(DIVIDE)
    assert caller.wait_peer(SOON)
    assert quotient_of(caller, base, 7, 3) == (2, 1)


def test_dds_between_hosts_talks_only_to_its_peers():
    found = settings("10.0.0.10", 100, ("10.0.0.10", "10.0.0.11"))
    assert found["General", "Interfaces"] == '<NetworkInterface address="10.0.0.10"/>'
    assert found["General", "AllowMulticast"] == "false"
    assert found["General", "MaxMessageSize"] == "1400B"
    assert found["Discovery", "Peers"].count("<Peer ") == 2


def test_dds_takes_peers_as_a_list(everything: contextlib.ExitStack):
    with pytest.raises(ConfigurationError, match=r"`peers` must be a list of addresses, not '10\.0\.0\.1'"):
        dds(everything, peers="10.0.0.1")
