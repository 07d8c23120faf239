"""Sources of messages: headers, and subscribers of all instances (`*`)."""

from __future__ import annotations

import queue
import time
import uuid
from dataclasses import replace

import pytest

from ...contract.qos import Durability, QoS, Reliability
from ...errors import Unreachable
from ...transports.base import Capability, Heard, Outlet, Transport, wait_connected
from ..parts import TransportSuite, answering, asker, blob, query, subscribe, topic, unblob
from ..patience import SOON

_LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)


class SourcesConformance(TransportSuite):
    def test_a_star_hears_every_instance(self, here: Transport, there: Transport, name: str) -> None:
        _, interface, operation = name.split("/")
        interface = f"C{uuid.uuid4().hex[:8]}"
        inbox = subscribe(there, topic(f"robot/*/{interface}/{operation}"))
        outlets = [here.outlet(topic(f"robot/{instance}/{interface}/{operation}")) for instance in ("one", "two")]
        stranger = here.outlet(topic(f"other/three/{interface}/{operation}"))
        for outlet in outlets:
            assert outlet.wait_peer(SOON)
        stranger.send(blob(here, b"stranger"))
        for outlet, message in zip(outlets, (b"one", b"two"), strict=True):
            outlet.send(blob(here, message))
        assert {inbox.get(timeout=SOON), inbox.get(timeout=SOON)} == {b"one", b"two"}

    def test_a_headed_sink_sees_who_sent_a_message_when_and_which_it_is(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        heard: queue.Queue[Heard] = queue.Queue()
        there.inlet(replace(topic(name), headed=True), heard.put)
        plain = subscribe(there, topic(name))
        outlet = here.outlet(topic(name))
        _wait_connected(outlet)
        begun = time.time_ns()
        for message in (b"1", b"2", b"3"):
            outlet.send(blob(here, message))
        one, two, three = (heard.get(timeout=SOON) for _ in range(3))
        for number, each in enumerate((one, two, three), 1):
            assert each.channel == name
            assert each.source == one.source != 0
            assert each.sequence == number
            assert unblob(there, each.payload) == b"%d" % number
        assert begun <= one.stamp <= two.stamp <= three.stamp <= time.time_ns()
        assert [plain.get(timeout=SOON) for _ in range(3)] == [b"1", b"2", b"3"]  # others are not affected

    def test_a_headed_sink_of_a_star_tells_the_sources_apart(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        interface = f"C{uuid.uuid4().hex[:8]}"
        heard: queue.Queue[Heard] = queue.Queue()
        there.inlet(replace(topic(f"*/{interface}/news"), headed=True), heard.put)
        outlets = {instance: here.outlet(topic(f"{instance}/{interface}/news")) for instance in ("one", "two")}
        for outlet in outlets.values():
            _wait_connected(outlet)
        for _ in range(2):
            for instance, outlet in outlets.items():
                outlet.send(blob(here, instance.encode()))
        messages = [heard.get(timeout=SOON) for _ in range(4)]
        by_instance = {
            instance: [each for each in messages if unblob(there, each.payload) == instance.encode()]
            for instance in outlets
        }
        for instance, (first, second) in by_instance.items():
            assert first.source == second.source
            assert (first.sequence, second.sequence) == (1, 2)
            assert first.channel in (f"{instance}/{interface}/news", f"*/{interface}/news")
        assert by_instance["one"][0].source != by_instance["two"][0].source

    def test_headers_of_latched_messages_are_those_of_the_past(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        if Capability.LATCHED not in here.capabilities:
            return  # refused, as the tests of queues show
        outlet = here.outlet(topic(name, _LATCHED))
        for message in (b"1", b"2", b"3"):
            outlet.send(blob(here, message))
        sent = time.time_ns()
        heard: queue.Queue[Heard] = queue.Queue()
        there.inlet(replace(topic(name, _LATCHED), headed=True), heard.put)
        late = [heard.get(timeout=SOON) for _ in range(_LATCHED.depth)]
        assert [(each.channel, each.sequence, unblob(there, each.payload)) for each in late] == [
            (name, 2, b"2"),
            (name, 3, b"3"),
        ]
        assert 0 < late[0].stamp <= late[1].stamp <= sent

    def test_a_star_is_never_oneself(self, here: Transport, there: Transport) -> None:
        interface = f"C{uuid.uuid4().hex[:8]}"
        inbox = subscribe(here, topic(f"*/{interface}/news"))
        own, other = (t.outlet(topic(f"{n}/{interface}/news")) for t, n in ((here, "one"), (there, "two")))
        here.server(query(f"one/{interface}/ask"), answering(here, bytes.upper))
        caller = here.caller(query(f"*/{interface}/ask"))
        with pytest.raises(Unreachable):
            asker(here, caller, "ask")(b"self")
        there.server(query(f"two/{interface}/ask"), answering(there, bytes.title))
        assert caller.wait_peer(SOON)
        assert asker(here, caller, "ask")(b"two") == b"Two"
        assert other.wait_peer(SOON)
        own.send(blob(here, b"own"))
        other.send(blob(there, b"other"))
        assert inbox.get(timeout=SOON) == b"other"

    def test_a_star_holds_up_nothing_that_oneself_publishes(self, here: Transport) -> None:
        interface, qos = f"C{uuid.uuid4().hex[:8]}", QoS(Reliability.RELIABLE, depth=4)
        here.inlet(topic(f"*/{interface}/news", qos), lambda payload: None)
        outlet = here.outlet(topic(f"one/{interface}/news", qos))
        for _ in range(50):
            outlet.send(blob(here, b"news"), SOON)


def _wait_connected(outlet: Outlet) -> None:
    assert outlet.wait_peer(SOON)
    assert wait_connected(outlet, SOON)
