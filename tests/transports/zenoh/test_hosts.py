"""Where each host has a router, nothing that is sent right after the routers have met is lost silently."""

from __future__ import annotations

import contextlib
import queue
from collections.abc import Iterator
from typing import Any

import pytest

from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.testing.conformance import answering, blob, command, query, topic, unblob
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import Status, TransportConfig
from robocomp_py.transports.zenoh import session as sessions
from robocomp_py.transports.zenoh.transport import ZenohTransport

from ...freeports import free_port

LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=3)


class Hosts:
    """Two hosts: the router of `base` runs, that of `onboard` once they are to meet."""

    def __init__(self, everything: contextlib.ExitStack) -> None:
        self._endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._everything = everything
        everything.enter_context(sessions.named_router("Base", {"listen/endpoints": [self._endpoint]}))
        self.base = self._join("here/Base")

    def meet(self) -> ZenohTransport:
        """A component on the other host, opened as soon as its router runs."""
        self._everything.enter_context(sessions.named_router("Onboard", {"connect/endpoints": [self._endpoint]}))
        return self._join("here/Onboard")

    def _join(self, connect: str) -> ZenohTransport:
        opened = ZenohTransport(TransportConfig({"connect": connect}))
        self._everything.callback(opened.close)
        return opened


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    with contextlib.ExitStack() as everything:
        yield Hosts(everything)


def test_the_first_call_is_answered(hosts: Hosts) -> None:
    hosts.base.server(query("a/b/c"), answering(hosts.base, bytes.upper))
    onboard = hosts.meet()
    caller = onboard.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    assert caller.ask(blob(onboard, b"x"), SOON).status is Status.OK


def test_the_first_command_is_executed(hosts: Hosts) -> None:
    executed = queue.Queue[Any]()
    hosts.base.inlet(command("a/b/c"), executed.put)
    onboard = hosts.meet()
    outlet = onboard.outlet(command("a/b/c"))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(onboard, b"x"))
    assert unblob(hosts.base, executed.get(timeout=SOON)) == b"x"


def test_the_first_message_of_a_topic_is_heard(hosts: Hosts) -> None:
    heard = queue.Queue[Any]()
    hosts.base.inlet(topic("a/b/c"), heard.put)
    onboard = hosts.meet()
    outlet = onboard.outlet(topic("a/b/c"))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(onboard, b"x"))
    assert unblob(hosts.base, heard.get(timeout=SOON)) == b"x"


def test_what_was_latched_before_is_heard(hosts: Hosts) -> None:
    hosts.base.outlet(topic("a/b/c", LATCHED)).send(blob(hosts.base, b"kept"))
    onboard, heard = hosts.meet(), queue.Queue[Any]()
    onboard.inlet(topic("a/b/c", LATCHED), heard.put)
    assert unblob(onboard, heard.get(timeout=SOON)) == b"kept"
