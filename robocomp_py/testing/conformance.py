"""Tests that every transport must pass. A transport uses them with three lines:

    class TestMyTransport(TransportConformance):
        def open_transport(self) -> Transport:
            return MyTransport(TransportConfig({...}))

Two transports that it opens one after the other must reach each other, and no others. Requirements:

    topics      every subscriber gets every message, in order, whichever side opened first · messages published after
                both sides are connected arrive, including the first one and an immediate answer to it, also if both
                sides opened at once · channels are separate · 0 B to 64 MB · nothing after close · a sink that raises
                or is slow does not affect others · a sink may publish · latched messages are kept or refused · a slow
                sink gets the newest `depth` messages · reliable topics lose nothing, and every sender gives up at its
                own deadline · losses are counted, and a flood is bounded · `*` receives from all other instances ·
                a headed sink gets source, sequence number and time of each message
    commands    in order, once, from many senders; no receiver: Unreachable
    qos         missed deadlines, lost publishers and expired messages are reported and counted: see `testing.qos`
    queries     replies find their callers, 64 out of order · clients get equal shares, and none waits for another's
                flood · every status arrives · no server: Unreachable · calls end at their deadlines, and a late reply
                reaches no other call · cancelled calls leave nothing behind · a service may call others, and be called
                back · the callback of a call may take long, and call again · at most one server
    contract    both sides report a different contract under the same name, and no message passes
    lifetime    close ends waits, openings and sending with Closed; it is final, and leaves no thread ·
                peers restart, move, or are killed
    typed       every IDSL type in both directions · every outcome of a call · several clients · serial workers

Time limits are generous and scaled by $ROBOCOMP_PATIENCE; no test judges speed.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from ..contract.component import Port
from ..contract.interface import Operation, Pattern, Verb
from ..contract.qos import Durability, QoS, Reliability
from ..errors import (
    AlreadyServed,
    Busy,
    Closed,
    ContractMismatch,
    EncodeError,
    RemoteFailure,
    Timeout,
    Unreachable,
    UnsupportedQoS,
)
from ..runtime import ports
from ..runtime.calls import type_of
from ..runtime.monitor import MAX_SUSPENDED, Monitor
from ..runtime.route import Route, Router
from ..transports.base import (
    Caller,
    Capability,
    Channel,
    Heard,
    Link,
    Outlet,
    Reply,
    Status,
    SupportsConnected,
    SupportsQuestion,
    Transport,
    gathering,
    require,
    wait_connected,
)
from ..wire.codec import Payload
from . import everything as e
from .parts import A_MOMENT as A_MOMENT
from .parts import BLOB, OTHER, Victim, in_time, publish_once, put, subscribe
from .parts import Inbox as Inbox
from .parts import blob as blob
from .parts import command as command
from .parts import drain as drain
from .parts import greet as greet
from .parts import query as query
from .parts import topic as topic
from .parts import unblob as unblob
from .patience import SOON, wait_until
from .qos import QoSConformance, refuses

_STARTS = 10
"""New ends of a topic that a test opens one after the other."""

_AT_ONCE = 25
"""Pairs of ends that a test opens at the same time."""

_CLOSINGS = 8
"""Transports that a test closes while threads use them."""

_MANY = QoS(depth=5000)
_RELIABLE = QoS(Reliability.RELIABLE, depth=8)
_LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)


class TransportConformance(QoSConformance):
    """Implement `open_transport`; the rest is the contract."""

    # Topics.

    def test_every_subscriber_gets_every_message_in_order(self, here: Transport, there: Transport, name: str) -> None:
        inboxes = [subscribe(transport, topic(name, _MANY)) for transport in (here, there, there)]
        outlet = there.outlet(topic(name, _MANY))
        greet(there, outlet, *inboxes)
        sent = [str(number).encode() for number in range(1000)]
        for number, message in enumerate(sent, 1):
            outlet.send(blob(there, message))
            if number % 100 == 0:  # best-effort messages may be lost if they are sent faster than they can travel
                wait_until(lambda n=number: all(inbox.qsize() == n for inbox in inboxes))  # type: ignore[misc]
        assert [drain(inbox) for inbox in inboxes] == [sent] * 3

    def test_the_publisher_may_come_first(self, here: Transport, there: Transport, name: str) -> None:
        outlet = here.outlet(topic(name))
        inbox = subscribe(there, topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"x"))
        assert inbox.get(timeout=SOON) == b"x"

    def test_the_subscriber_may_come_first(self, here: Transport, there: Transport, name: str) -> None:
        inbox = subscribe(there, topic(name))
        outlet = here.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"x"))
        assert inbox.get(timeout=SOON) == b"x"

    @pytest.mark.parametrize("qos", [QoS(), _RELIABLE], ids=["best effort", "reliable"])
    def test_a_subscriber_that_is_ready_hears_what_is_published_next(
        self, here: Transport, name: str, qos: QoS
    ) -> None:
        if refuses(here, qos):
            return
        outlet = here.outlet(topic(name, qos))
        here.inlet(command(name + "ed"), lambda payload: outlet.send(blob(here, unblob(here, payload))))
        for number in range(_STARTS):
            with contextlib.closing(self.open_transport()) as transport:
                inbox = Inbox()
                with gathering(transport):
                    link = transport.inlet(topic(name, qos), put(transport, inbox))
                    asking = transport.outlet(command(name + "ed"))
                assert asking.wait_peer(SOON)
                assert wait_connected(link, SOON)
                asking.send(blob(transport, b"%d" % number))
                assert inbox.get(timeout=SOON) == b"%d" % number

    @pytest.mark.parametrize("qos", [QoS(), _RELIABLE], ids=["best effort", "reliable"])
    def test_subscribers_that_are_ready_hear_the_first_words_of_a_new_publisher(
        self, here: Transport, there: Transport, name: str, qos: QoS
    ) -> None:
        if refuses(here, qos):
            return
        inboxes = [Inbox(), Inbox()]
        for transport, inbox in zip((here, there), inboxes, strict=True):
            assert wait_connected(transport.inlet(topic(name, qos), put(transport, inbox)), SOON)
        for number in range(_STARTS):
            with contextlib.closing(self.open_transport()) as transport:
                with gathering(transport):
                    outlet = transport.outlet(topic(name, qos))
                assert wait_connected(outlet, SOON)
                outlet.send(blob(transport, b"%d" % number))
                for inbox in inboxes:
                    assert inbox.get(timeout=SOON) == b"%d" % number

    def test_a_publisher_and_a_subscriber_that_open_at_once_are_connected(
        self, here: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        """Each may be open before it sees the other. `here` has already created what both need in order to meet."""

        def connected(opening: threading.Barrier, open_it: Callable[[], Link]) -> Link:
            opening.wait(SOON)
            link = open_it()
            assert wait_connected(link, SOON)
            return link

        for number in range(_AT_ONCE):
            channel, inbox = topic(name.replace("/Conformance/", f"/Conf{number}/")), Inbox()
            opening = threading.Barrier(2)
            with (
                contextlib.closing(self.open_transport()) as one,
                contextlib.closing(self.open_transport()) as other,
            ):
                outlet = pool.submit(connected, opening, partial(one.outlet, channel))
                pool.submit(connected, opening, partial(other.inlet, channel, put(other, inbox))).result(SOON)
                outlet.result(SOON).send(blob(one, b"word"))  # type: ignore[attr-defined]  # it is an outlet
                assert inbox.get(timeout=SOON) == b"word"

    def test_an_end_without_peers_is_connected_until_it_is_closed(self, here: Transport, name: str) -> None:
        inlet, outlet = here.inlet(topic(name), lambda payload: None), here.outlet(topic(name + "x"))
        for link in (inlet, outlet):
            assert wait_connected(link, SOON)
            link.close()
            if isinstance(link, SupportsConnected):
                with pytest.raises(Closed):
                    wait_connected(link, SOON)

    def test_publishing_without_subscribers_is_fine(self, here: Transport, name: str) -> None:
        outlet = here.outlet(topic(name))
        assert not outlet.wait_peer(0.0)
        outlet.send(blob(here, b"x"))

    def test_channels_do_not_leak_into_each_other(self, here: Transport, there: Transport, name: str) -> None:
        inbox, other_inbox = subscribe(there, topic(name)), subscribe(there, topic(name + "x"))
        outlet, other = here.outlet(topic(name)), here.outlet(topic(name + "x"))
        assert outlet.wait_peer(SOON)
        assert other.wait_peer(SOON)
        other.send(blob(here, b"other"))
        outlet.send(blob(here, b"this"))
        assert (inbox.get(timeout=SOON), other_inbox.get(timeout=SOON)) == (b"this", b"other")
        assert inbox.empty()
        assert other_inbox.empty()

    @pytest.mark.parametrize("size", [0, 1, 65_535, 65_536, 1_000_003, 64 * 1024 * 1024])
    def test_payloads_from_nothing_to_64_megabytes(
        self, here: Transport, there: Transport, name: str, size: int
    ) -> None:
        inbox = subscribe(there, topic(name))
        outlet = here.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        sent = np.arange(size, dtype=np.uint8)
        outlet.send(here.codec.encoder(BLOB)((sent,)))
        assert inbox.get(timeout=SOON * 2) == sent.tobytes()

    def test_nothing_arrives_after_close_returns(self, here: Transport, there: Transport, name: str) -> None:
        closed, witness = Inbox(), subscribe(there, topic(name))
        link = there.inlet(topic(name), put(there, closed))
        outlet = here.outlet(topic(name))
        greet(here, outlet, closed, witness)
        link.close()
        outlet.send(blob(here, b"late"))
        assert witness.get(timeout=SOON) == b"late"
        assert closed.empty()

    def test_close_waits_for_a_sink_that_runs(self, here: Transport, there: Transport, name: str) -> None:
        entered, release, left = threading.Event(), threading.Event(), threading.Event()

        def sink(payload: Payload) -> None:
            entered.set()
            release.wait(SOON)
            left.set()

        link = there.inlet(topic(name), sink)
        outlet = here.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"x"))
        assert entered.wait(SOON)
        threading.Timer(A_MOMENT, release.set).start()
        link.close()
        assert left.is_set()

    def test_a_sink_that_raises_does_not_affect_others(
        self, here: Transport, there: Transport, name: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        inbox = Inbox()

        def fussy(payload: Payload) -> None:
            inbox.put(unblob(there, payload))
            if inbox.queue[-1] == b"bad":
                raise ValueError("bad")

        there.inlet(topic(name), fussy)
        outlet = here.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"bad"))
        outlet.send(blob(here, b"good"))
        assert [inbox.get(timeout=SOON), inbox.get(timeout=SOON)] == [b"bad", b"good"]
        assert "ValueError: bad" in caplog.text

    def test_a_slow_sink_delays_no_other_channel(self, here: Transport, there: Transport, name: str) -> None:
        release = threading.Event()
        there.inlet(topic(name), lambda _: release.wait(SOON))
        inbox = subscribe(there, topic(name + "x"))
        slow, quick = here.outlet(topic(name)), here.outlet(topic(name + "x"))
        assert slow.wait_peer(SOON)
        assert quick.wait_peer(SOON)
        slow.send(blob(here, b"stuck"))
        quick.send(blob(here, b"x"))
        try:
            assert inbox.get(timeout=SOON) == b"x"
        finally:
            release.set()

    def test_a_sink_may_publish(self, here: Transport, there: Transport, name: str) -> None:
        back, inbox = here.outlet(topic(name + "back")), subscribe(there, topic(name + "back"))
        assert back.wait_peer(SOON)
        here.inlet(topic(name), lambda payload: back.send(blob(here, unblob(here, payload) + b"!")))
        outlet = there.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(there, b"ping"))
        assert inbox.get(timeout=SOON) == b"ping!"

    def test_late_subscribers_get_what_is_latched_or_it_is_refused(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        latched = topic(name, _LATCHED)
        if Capability.LATCHED not in here.capabilities:
            with pytest.raises(UnsupportedQoS):
                require(here, "this transport", latched)
            return
        early, outlet = subscribe(here, latched), here.outlet(latched)
        assert outlet.wait_peer(SOON)
        for message in (b"old", b"map", b"pose"):
            outlet.send(blob(here, message))
        late = subscribe(there, latched)
        assert [late.get(timeout=SOON), late.get(timeout=SOON)] == [b"map", b"pose"]
        outlet.send(blob(here, b"new"))
        assert late.get(timeout=SOON) == b"new"
        assert [early.get(timeout=SOON) for _ in range(4)] == [b"old", b"map", b"pose", b"new"]
        assert early.empty()

    def test_of_what_waits_for_a_slow_sink_the_newest_stay(self, here: Transport, there: Transport, name: str) -> None:
        blocked, release, inbox = threading.Event(), threading.Event(), Inbox()

        def sink(payload: Payload) -> None:
            inbox.put(unblob(there, payload))
            blocked.set()
            release.wait(SOON)

        channel = topic(name, QoS(depth=3))
        link, outlet = there.inlet(channel, sink), here.outlet(channel)
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"0"))
        assert blocked.wait(SOON)
        for number in range(1, 21):
            outlet.send(blob(here, str(number).encode()))
            wait_until(lambda n=number: link.stats.dropped >= n - 3)  # type: ignore[misc]
        release.set()
        wait_until(lambda: inbox.qsize() == 4)
        assert drain(inbox) == [b"0", b"18", b"19", b"20"]
        assert link.stats.dropped == 17

    def test_a_sink_slower_than_its_sender_stays_near_the_newest(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        permits, delivered = threading.Semaphore(0), list[int]()

        def sink(payload: Payload) -> None:
            delivered.append(int(unblob(there, payload)))
            permits.acquire(timeout=SOON)

        channel = topic(name, QoS(depth=4))
        there.inlet(channel, sink)
        outlet = here.outlet(channel)
        assert outlet.wait_peer(SOON)
        numbers = itertools.count()
        for step in range(250):
            for _ in range(4):
                outlet.send(blob(here, str(next(numbers)).encode()))
            wait_until(lambda already=step: len(delivered) > already)  # type: ignore[misc]
            permits.release()
        permits.release(len(delivered))
        assert delivered[-1] > 500, "it is told what was sent long ago"

    def test_reliable_loses_nothing_to_a_slow_sink(self, here: Transport, there: Transport, name: str) -> None:
        channel = topic(name, _RELIABLE)
        if Capability.RELIABLE not in here.capabilities:
            with pytest.raises(UnsupportedQoS):
                require(here, "this transport", channel)
            return
        inbox, begun = Inbox(), threading.Event()

        def sink(payload: Payload) -> None:
            begun.wait(SOON)  # let everything pile up first
            inbox.put(unblob(there, payload))

        there.inlet(channel, sink)
        outlet = here.outlet(channel)
        assert outlet.wait_peer(SOON)
        sent = [str(number).encode() for number in range(300)]
        threading.Timer(A_MOMENT, begun.set).start()
        for message in sent:
            outlet.send(blob(here, message), SOON)
        wait_until(lambda: inbox.qsize() == len(sent))
        assert drain(inbox) == sent

    def test_reliable_gives_up_at_its_deadline(self, here: Transport, there: Transport, name: str) -> None:
        channel = topic(name, _RELIABLE)
        if Capability.RELIABLE not in here.capabilities:
            return  # refused, as the test above shows
        release = threading.Event()
        there.inlet(channel, lambda _: release.wait(SOON * 3))
        outlet = here.outlet(channel)
        assert outlet.wait_peer(SOON)
        try:
            with pytest.raises(Timeout):
                _send_many(here, outlet, 100_000)
        finally:
            release.set()

    def test_every_sender_gives_up_at_its_own_deadline(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        channel = topic(name, _RELIABLE)
        if Capability.RELIABLE not in here.capabilities:
            return  # refused, as a test above shows
        release = threading.Event()
        there.inlet(channel, lambda _: release.wait(SOON * 3))
        outlet = here.outlet(channel)
        assert outlet.wait_peer(SOON)
        try:
            with pytest.raises(Timeout):  # until the queue is full and no acknowledgement is on its way
                _send_many(here, outlet, 100_000, SOON / 3)
            patient = pool.submit(outlet.send, blob(here, bytes(100_000)), SOON * 3)
            wait_until(patient.running)
            for _ in range(3):
                with pytest.raises(Timeout):
                    outlet.send(blob(here, bytes(100_000)), A_MOMENT / 3)
            assert not patient.done()
        finally:
            release.set()
        patient.result(SOON * 3)

    @pytest.mark.parametrize("asked", [QoS(depth=4), QoS(Reliability.RELIABLE, depth=4)], ids=["less", "more"])
    def test_best_effort_never_waits_and_counts_what_it_lost_whatever_is_asked_for(
        self, here: Transport, there: Transport, name: str, asked: QoS
    ) -> None:
        if refuses(there, asked):
            return
        release = threading.Event()
        first = threading.Event()

        def sink(payload: Payload) -> None:
            first.set()
            release.wait(SOON * 3)

        link, outlet = there.inlet(topic(name, asked), sink), here.outlet(topic(name, QoS(depth=4)))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"0"))
        assert first.wait(SOON)
        for number in range(1, 5000):
            outlet.send(blob(here, str(number).encode()))
        release.set()

        def all_accounted_for() -> bool:
            outlet.send(blob(here, b"last"))
            return link.stats.received + link.stats.dropped + link.stats.lost >= 5000

        wait_until(all_accounted_for)
        assert link.stats.repeated == 0

    def test_a_flood_is_bounded(self, here: Transport, there: Transport, name: str) -> None:
        release, first, last = threading.Event(), threading.Event(), threading.Event()
        delivered: list[int] = []

        def sink(payload: Payload) -> None:
            delivered.append(len(unblob(there, payload)))
            first.set()
            release.wait(SOON * 3)
            if not delivered[-1]:
                last.set()

        channel = topic(name, QoS(depth=4))
        there.inlet(channel, sink)
        outlet = here.outlet(channel)
        assert outlet.wait_peer(SOON)
        large = blob(here, bytes(100_000))
        outlet.send(large)
        assert first.wait(SOON)
        for _ in range(1000):
            outlet.send(large)
        release.set()

        def all_over() -> bool:
            outlet.send(blob(here, b""))
            return last.is_set()

        wait_until(all_over)
        assert delivered.count(100_000) < 500

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
            return  # it is refused: see above
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
            _asker(here, caller, "ask")(b"self")
        there.server(query(f"two/{interface}/ask"), answering(there, bytes.title))
        assert caller.wait_peer(SOON)
        assert _asker(here, caller, "ask")(b"two") == b"Two"
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

    def test_a_publisher_that_floods_does_not_starve_another(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        _, _, operation = name.split("/")
        interface = f"C{uuid.uuid4().hex[:8]}"
        if refuses(here, _RELIABLE):
            return
        heard, stop = {b"flood": 0, b"word": 0}, threading.Event()
        meanwhile = [0]

        def sink(payload: Payload) -> None:
            what = unblob(here, payload)
            if what == b"word":
                meanwhile.append(heard[b"flood"])
            heard[what] += 1
            time.sleep(0.001)

        link = here.inlet(topic(f"*/{interface}/{operation}", _RELIABLE), sink)
        flooding = there.outlet(topic(f"a/{interface}/{operation}", _RELIABLE))
        other = there.outlet(topic(f"b/{interface}/{operation}", _RELIABLE))
        for each in (link, flooding, other):
            assert wait_connected(each, SOON)

        def flood() -> None:
            while not stop.is_set():
                flooding.send(blob(there, b"flood"), SOON)

        flooder, held_up = threading.Thread(target=flood), []
        flooder.start()
        try:
            wait_until(lambda: heard[b"flood"] > 50)
            for number in range(1, 21):
                before = heard[b"flood"]
                other.send(blob(there, b"word"), SOON)
                wait_until(lambda n=number: heard[b"word"] == n)  # type: ignore[misc]
                held_up.append(meanwhile[number] - before)
            assert sorted(held_up)[10] < 50, held_up
        finally:
            stop.set()
            flooder.join()

    # Commands.

    def test_commands_arrive_once_and_in_order(self, here: Transport, there: Transport, name: str) -> None:
        inbox = Inbox()
        link = here.inlet(command(name), put(here, inbox))
        outlet = there.outlet(command(name))
        assert outlet.wait_peer(SOON)
        sent = [str(number).encode() for number in range(500)]
        for message in sent:
            outlet.send(blob(there, message))
        wait_until(lambda: inbox.qsize() == len(sent))
        assert drain(inbox) == sent
        assert (link.stats.lost, link.stats.repeated, link.stats.dropped) == (0, 0, 0)

    def test_many_may_command_one(self, here: Transport, there: Transport, name: str) -> None:
        inbox = Inbox()
        here.inlet(command(name), put(here, inbox))
        for transport, message in ((here, b"a"), (there, b"b"), (there, b"c")):
            outlet = transport.outlet(command(name))
            assert outlet.wait_peer(SOON)
            outlet.send(blob(transport, message))
        assert {inbox.get(timeout=SOON) for _ in range(3)} == {b"a", b"b", b"c"}

    def test_commands_of_any_size(self, here: Transport, there: Transport, name: str) -> None:
        inbox = Inbox()
        here.inlet(command(name), put(here, inbox))
        outlet = there.outlet(command(name))
        assert outlet.wait_peer(SOON)
        for size in (0, 4_000, 10_000, 20_000, 65_535, 65_536):
            outlet.send(blob(there, b"a" * size))
            assert inbox.get(timeout=SOON) == b"a" * size

    def test_a_command_without_a_receiver_is_unreachable(self, here: Transport, name: str) -> None:
        with pytest.raises(Unreachable):
            here.outlet(command(name)).send(blob(here, b"x"))

    # Queries.

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_question_gets_its_answer(self, here: Transport, there: Transport, name: str, ask: str) -> None:
        here.server(query(name), answering(here, bytes.upper))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert _asker(there, caller, ask)(b"abc") == b"ABC"

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_questions_and_answers_of_any_size(self, here: Transport, there: Transport, name: str, ask: str) -> None:
        here.server(query(name), answering(here, bytes.upper))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        for size in (0, 4_000, 10_000, 20_000, 65_535, 65_536):
            assert _asker(there, caller, ask)(b"a" * size) == b"A" * size

    def test_an_answer_may_come_later(self, here: Transport, there: Transport, name: str) -> None:
        later: queue.Queue[Future[Reply]] = queue.Queue()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            reply: Future[Reply] = Future()
            later.put(reply)
            return reply

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        asked = caller.call(blob(there, b""), SOON)
        later.get(timeout=SOON).set_result(Reply(Status.OK, blob(here, b"later")))
        assert unblob(there, asked.result(SOON).payload) == b"later"

    def test_answers_out_of_order_find_their_callers(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        waiting: list[tuple[Payload, Future[Reply]]] = []
        all_in = threading.Event()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            waiting.append((payload, Future()))
            if len(waiting) == 64:
                all_in.set()
            return waiting[-1][1]

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        futures = [caller.call(blob(there, str(number).encode()), SOON) for number in range(64)]
        assert all_in.wait(SOON)
        for payload, reply in reversed(waiting):
            reply.set_result(Reply(Status.OK, blob(here, unblob(here, payload))))
        assert [unblob(there, f.result(SOON).payload) for f in futures] == [str(n).encode() for n in range(64)]

    @pytest.mark.parametrize("ask", ["ask", "call"])
    @pytest.mark.parametrize(
        "status", [Status.OK, Status.THROWN, Status.FAILED, Status.EXPIRED, Status.BUSY, Status.REFUSED]
    )
    def test_every_status_arrives(self, here: Transport, there: Transport, name: str, status: Status, ask: str) -> None:
        here.server(query(name), lambda payload, expires: Reply(status, blob(here, b"why")))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        payload = blob(there, b"")
        reply = caller.ask(payload, SOON) if ask == "ask" else caller.call(payload, SOON).result(SOON)
        assert (reply.status, unblob(there, reply.payload)) == (status, b"why")

    def test_a_service_that_raises_fails_its_call(
        self, here: Transport, there: Transport, name: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        def service(payload: Payload, expires: float) -> Reply:
            raise ValueError("broken service")

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert caller.ask(blob(there, b""), SOON).status is Status.FAILED
        assert "broken service" in caplog.text

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_call_without_a_server_is_unreachable(self, here: Transport, name: str, ask: str) -> None:
        with pytest.raises(Unreachable):
            _asker(here, here.caller(query(name)), ask)(b"")

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_the_deadline_holds_and_a_late_answer_reaches_no_other_call(
        self, here: Transport, there: Transport, name: str, ask: str, pool: ThreadPoolExecutor
    ) -> None:
        release = threading.Event()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            data = unblob(here, payload)
            return pool.submit(lambda: (data == b"slow" and release.wait(SOON), Reply(Status.OK, blob(here, data)))[1])

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        begun = time.monotonic()
        with pytest.raises(Timeout):
            _asker(there, caller, ask, A_MOMENT)(b"slow")
        assert time.monotonic() - begun >= A_MOMENT * 0.9
        release.set()
        assert [_asker(there, caller, ask)(str(n).encode()) for n in range(3)] == [b"0", b"1", b"2"]

    def test_what_is_asked_again_is_executed_once_and_answered_again(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        executed: list[bytes] = []

        def service(payload: Payload, expires: float) -> Reply:
            executed.append(unblob(here, payload))
            return Reply(Status.OK, blob(here, b"%d" % len(executed)))

        channel = replace(query(name), idempotent=True)
        here.server(channel, service)
        caller: Any = there.caller(channel)
        assert caller.wait_peer(SOON)
        if not isinstance(numbering := caller, SupportsQuestion):
            return  # an optional part of the contract
        question = numbering.question(blob(there, b"first"))
        for _ in range(3):
            assert unblob(there, question.ask(SOON).payload) == b"1"
        question.close()
        question = numbering.question(blob(there, b"second"))
        for _ in range(3):
            assert unblob(there, question.call(SOON).result(SOON).payload) == b"2"
        question.close()
        assert unblob(there, caller.ask(blob(there, b"third"), SOON).payload) == b"3"
        assert executed == [b"first", b"second", b"third"]

    def test_the_answer_to_a_retry_goes_to_the_last_attempt(self, here: Transport, there: Transport, name: str) -> None:
        answers: queue.Queue[Future[Reply]] = queue.Queue()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            answer: Future[Reply] = Future()
            answers.put(answer)
            return answer

        channel = replace(query(name), idempotent=True)
        here.server(channel, service)
        caller: Any = there.caller(channel)
        assert caller.wait_peer(SOON)
        if not isinstance(numbering := caller, SupportsQuestion):
            return  # an optional part of the contract
        question = numbering.question(blob(there, b"long"))
        question.call(SOON).cancel()
        wait_until(lambda: answers.qsize() == 1)
        last = question.call(SOON)
        assert unblob(there, _asked_meanwhile(there, caller, answers, here).payload) == b"meanwhile"
        answers.get().set_result(Reply(Status.OK, blob(here, b"done")))
        assert unblob(there, last.result(SOON).payload) == b"done"
        assert answers.empty()
        question.close()

    def test_giving_up_leaves_nothing_behind(self, here: Transport, there: Transport, name: str) -> None:
        here.server(query(name), _answering_all_but_stuck(here))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        stuck = caller.call(blob(there, b"stuck"), SOON)
        assert stuck.cancel()
        assert _asker(there, caller, "call")(b"next") == b"next"

    def test_a_service_may_ask_another(self, here: Transport, there: Transport, name: str) -> None:
        there.server(query(name + "inner"), answering(there, lambda data: data + b"!"))
        onward = here.caller(query(name + "inner"))
        assert onward.wait_peer(SOON)
        here.server(query(name), lambda payload, expires: onward.ask(blob(here, unblob(here, payload)), SOON))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert _asker(there, caller, "ask")(b"hop") == b"hop!"

    def test_a_service_may_be_called_back(self, here: Transport, there: Transport, name: str) -> None:
        here.server(query(name + "back"), answering(here, lambda data: data + b"back"))
        back = there.caller(query(name + "back"))
        assert back.wait_peer(SOON)
        there.server(query(name + "on"), lambda payload, expires: back.ask(blob(there, unblob(there, payload)), SOON))
        on = here.caller(query(name + "on"))
        assert on.wait_peer(SOON)
        here.server(query(name), lambda payload, expires: on.ask(blob(here, unblob(here, payload)), SOON))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert _asker(there, caller, "ask")(b"there and ") == b"there and back"

    def test_a_callback_may_ask_again(self, here: Transport, there: Transport, name: str) -> None:
        later: queue.Queue[Future[Reply]] = queue.Queue()

        def service(payload: Payload, expires: float) -> Reply | Future[Reply]:
            data = unblob(here, payload)
            if data != b"first":
                return Reply(Status.OK, blob(here, data.upper()))
            reply: Future[Reply] = Future()
            later.put(reply)
            return reply

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        answers = Inbox()

        def again(done: Future[Reply]) -> None:
            answers.put(unblob(there, caller.ask(blob(there, b"again"), SOON).payload))

        for _ in range(20):
            caller.call(blob(there, b"first"), SOON).add_done_callback(again)
            later.get(timeout=SOON).set_result(Reply(Status.OK, blob(here, b"FIRST")))
        assert [answers.get(timeout=SOON) for _ in range(20)] == [b"AGAIN"] * 20
        assert _asker(there, caller, "call")(b"afterwards") == b"AFTERWARDS"

    def test_a_slow_callback_delays_nothing_else(self, here: Transport, there: Transport, name: str) -> None:
        later: queue.Queue[Future[Reply]] = queue.Queue()
        called_back, release = threading.Event(), threading.Event()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            reply: Future[Reply] = Future()
            later.put(reply)
            return reply

        def slow(done: Future[Reply]) -> None:
            called_back.set()
            release.wait(SOON * 3)

        here.server(query(name), service)
        here.server(query(name + "x"), answering(here, bytes.upper))
        caller, other = there.caller(query(name)), there.caller(query(name + "x"))
        inbox, outlet = subscribe(there, topic(name + "news")), here.outlet(topic(name + "news"))
        for link in (caller, other, outlet):
            assert link.wait_peer(SOON)
        caller.call(blob(there, b""), SOON * 3).add_done_callback(slow)
        later.get(timeout=SOON).set_result(Reply(Status.OK, blob(here, b"")))
        assert called_back.wait(SOON)
        try:
            outlet.send(blob(here, b"news"))
            assert inbox.get(timeout=SOON) == b"news"
            assert _asker(there, other, "call")(b"x") == b"X"
        finally:
            release.set()

    def test_a_second_server_is_refused(self, here: Transport, there: Transport, name: str) -> None:
        first = here.server(query(name), answering(here, bytes.upper))
        with pytest.raises(AlreadyServed):
            there.server(query(name), answering(there, bytes.lower))
        first.close()
        there.server(query(name), answering(there, bytes.lower))

    def test_a_second_server_is_refused_also_where_one_claim_stands_for_several(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        claimed, unclaimed = query(name), replace(query(name), exclusive=False)
        for channel, again in ((claimed, unclaimed), (unclaimed, claimed), (unclaimed, unclaimed)):
            first = here.server(channel, answering(here, bytes.upper))
            with pytest.raises(AlreadyServed):
                there.server(again, answering(there, bytes.lower))
            first.close()
        there.server(unclaimed, answering(there, bytes.lower))

    def test_clients_get_equal_shares_of_a_server(self, here: Transport, name: str, pool: ThreadPoolExecutor) -> None:
        def service(payload: Payload, expires: float) -> Reply:
            time.sleep(0.0001)  # so that the server decides about turns, and not the interpreter
            return Reply(Status.OK, payload)

        here.server(query(name), service)
        done, start, stop = [0] * 16, threading.Barrier(16), threading.Event()

        def client(number: int) -> None:
            with contextlib.closing(self.open_transport()) as transport:
                caller = transport.caller(query(name))
                assert caller.wait_peer(SOON)
                ask = _asker(transport, caller, "ask")
                ask(b"hello")
                start.wait(SOON * 3)
                while not stop.is_set():
                    ask(b"again")
                    done[number] += 1

        clients = [pool.submit(client, number) for number in range(16)]
        wait_until(lambda: min(done) >= 100 or any(each.done() for each in clients), SOON * 3)
        shares = sorted(done)
        stop.set()
        for each in clients:
            each.result(SOON * 6)  # they all close their transports at once
        assert shares[0] >= shares[-1] / 2, shares

    def test_a_flood_of_one_client_does_not_hold_up_calls_of_another(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        handled, stop, room = [0], threading.Event(), threading.Semaphore(200)

        def service(payload: Payload, expires: float) -> Reply:
            time.sleep(0.0005)
            handled[0] += 1
            return Reply(Status.OK, payload)

        here.server(query(name), service)
        flooding, other = there.caller(query(name)), self.open_transport()
        caller = other.caller(query(name))
        assert flooding.wait_peer(SOON)
        assert caller.wait_peer(SOON)

        def flood() -> None:
            while not stop.is_set():
                if room.acquire(timeout=A_MOMENT):
                    flooding.call(blob(there, b"flood"), SOON * 3).add_done_callback(lambda _: room.release())

        flooder = threading.Thread(target=flood)
        flooder.start()
        held_up = []
        try:
            wait_until(lambda: handled[0] > 200)
            for _ in range(20):
                before = handled[0]
                assert _asker(other, caller, "ask")(b"call") == b"call"
                held_up.append(handled[0] - before)
        finally:
            stop.set()
            flooder.join()
            other.close()
        assert sorted(held_up)[10] < 50, held_up

    # Contracts.

    @pytest.mark.parametrize("instance", ["named", "any"])
    def test_another_contract_is_named_and_calls_do_not_pass(
        self, here: Transport, there: Transport, name: str, instance: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        name, looked_up = _in_a_namespace(name, instance)
        executed = Inbox()
        server = here.server(query(name), answering(here, _noting(executed)))
        caller = there.caller(replace(query(looked_up), type=OTHER))
        with pytest.raises(ContractMismatch, match=r"data: sequence<int16> here, sequence<uint8> there"):
            caller.wait_peer(SOON)
        with pytest.raises(ContractMismatch, match=r"data: sequence<int16> here, sequence<uint8> there"):
            _asker(there, caller, "ask")(b"x")
        wait_until(lambda: server.stats.mismatched > 0)
        assert executed.empty()
        assert "data: sequence<uint8> here, sequence<int16> there" in caplog.text

    @pytest.mark.parametrize("instance", ["named", "any"])
    def test_another_contract_is_named_and_messages_do_not_pass(
        self, here: Transport, there: Transport, name: str, instance: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        """Both sides report it, even if the subscriber names no instance."""
        name, looked_up = _in_a_namespace(name, instance)
        inbox, witness = Inbox(), subscribe(there, topic(name))
        link = there.inlet(replace(topic(looked_up), type=OTHER), put(there, inbox))
        outlet = here.outlet(topic(name))
        greet(here, outlet, witness)
        wait_until(lambda: link.stats.mismatched > 0 and outlet.stats.mismatched > 0)
        assert inbox.empty()
        assert "data: sequence<uint8> here, sequence<int16> there" in caplog.text
        assert "data: sequence<int16> here, sequence<uint8> there" in caplog.text

    # Lifetime.

    def test_close_releases_waiters(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        here.server(query(name), _answering_all_but_stuck(here))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        pending = caller.call(blob(there, b"stuck"), SOON * 3)
        asking = pool.submit(caller.ask, blob(there, b"stuck"), SOON * 3)
        wait_until(lambda: asking.running())
        caller.close()
        for waiting in (pending, asking):
            with pytest.raises(Closed):
                waiting.result(SOON)

    def test_closing_a_transport_ends_its_calls_as_closed(
        self, here: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        here.server(query(name), _answering_all_but_stuck(here))

        def ask_until_it_fails(transport: Transport, caller: Caller, answered: threading.Semaphore) -> None:
            while True:
                caller.ask(blob(transport, b"x"), SOON)
                answered.release()

        for _ in range(5):
            transport = self.open_transport()
            caller, answered = transport.caller(query(name)), threading.Semaphore(0)
            assert caller.wait_peer(SOON)
            asking: list[Future[Any]] = []
            asking += [pool.submit(ask_until_it_fails, transport, caller, answered) for _ in range(6)]
            asking += [pool.submit(_asker(transport, caller, how, SOON * 3), b"stuck") for how in ("ask", "call")]
            for _ in range(20):
                assert answered.acquire(timeout=SOON)
            transport.close()
            assert [type(each.exception(SOON)) for each in asking] == [Closed] * len(asking)

    def test_a_transport_that_closes_ends_what_uses_it_as_closed(
        self, here: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        """Threads that open links or publish at that moment get Closed, whatever exception the middleware raises."""

        def repeat(use: Callable[[], object], begun: threading.Event) -> None:
            while True:
                use()
                begun.set()

        def open_and_close(open_it: Callable[[], Link]) -> None:
            open_it().close()

        def drop(payload: Payload) -> None: ...

        for _ in range(_CLOSINGS):
            transport = self.open_transport()
            outlet, payload = transport.outlet(topic(name)), blob(transport, b"x")
            inlet = here.inlet(topic(name), drop)
            assert outlet.wait_peer(SOON)
            openings: list[Callable[[], Link]] = [
                partial(transport.outlet, topic(name)),
                partial(transport.inlet, topic(name), drop),
                partial(transport.caller, query(name)),
            ]
            uses = [partial(outlet.send, payload), *(partial(open_and_close, each) for each in openings)]
            begun = [threading.Event() for _ in uses]
            using = [pool.submit(repeat, use, each) for use, each in zip(uses, begun, strict=True)]
            assert all(each.wait(SOON) for each in begun)
            transport.close()
            inlet.close()
            assert [repr(each.exception(SOON)) for each in using if type(each.exception()) is not Closed] == []

    def test_close_is_final_and_may_be_repeated(self, here: Transport, name: str) -> None:
        outlet, caller = here.outlet(topic(name)), here.caller(query(name))
        here.server(query(name), answering(here, bytes.upper))
        here.close()
        here.close()
        outlet.close()
        for use in (
            lambda: outlet.send(blob(here, b"")),
            lambda: caller.ask(blob(here, b""), SOON),
            lambda: caller.call(blob(here, b""), SOON),
            lambda: here.outlet(topic(name)),
            lambda: here.server(query(name), answering(here, bytes.upper)),
        ):
            with pytest.raises(Closed):
                use()

    def test_a_sink_may_close_its_own_link(self, here: Transport, there: Transport, name: str) -> None:
        closed = threading.Event()
        links: list[Link] = []

        def sink(payload: Payload) -> None:
            links[0].close()
            closed.set()

        links.append(there.inlet(topic(name), sink))
        outlet = here.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"x"))
        assert closed.wait(SOON)

    def test_no_thread_is_left_after_close(self, name: str) -> None:
        before = set(threading.enumerate())
        transport = self.open_transport()
        transport.inlet(topic(name), lambda _: time.sleep(A_MOMENT))
        transport.server(query(name), answering(transport, bytes.upper))
        outlet, caller = transport.outlet(topic(name)), transport.caller(query(name))
        assert outlet.wait_peer(SOON)
        assert caller.wait_peer(SOON)
        outlet.send(blob(transport, b"x"))
        assert _asker(transport, caller, "ask")(b"x") == b"X"
        transport.close()
        assert set(threading.enumerate()) - before == set()

    def test_a_server_may_be_restarted_under_its_clients(self, there: Transport, name: str) -> None:
        caller = there.caller(query(name))
        for life in range(3):
            transport = self.open_transport()
            transport.server(query(name), answering(transport, partial(_signed, str(life))))
            assert caller.wait_peer(SOON)
            assert _asker(there, caller, "ask")(b"life ") == f"life {life}".encode()
            assert _asker(there, caller, "call")(b"life ") == f"life {life}".encode()
            transport.close()
            with pytest.raises(Unreachable):
                _asker(there, caller, "ask")(b"")

    def test_a_publisher_and_its_subscribers_may_be_restarted(self, name: str) -> None:
        stays, inbox = self.open_transport(), Inbox()
        stays.inlet(topic(name), put(stays, inbox))
        for life in (b"first", b"second"):
            transport = self.open_transport()
            outlet = transport.outlet(topic(name))
            assert outlet.wait_peer(SOON)
            outlet.send(blob(transport, life))
            assert inbox.get(timeout=SOON) == life
            transport.close()
        stays.close()
        transport, other = self.open_transport(), self.open_transport()
        outlet = transport.outlet(topic(name))
        inbox = subscribe(other, topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(transport, b"third"))
        assert inbox.get(timeout=SOON) == b"third"
        transport.close()
        other.close()

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_server_may_move_to_another_transport(
        self, here: Transport, there: Transport, name: str, ask: str
    ) -> None:
        """Calls in between find no server, or the new one; never the old one, which no longer serves the channel."""
        asking = self.open_transport()
        caller = asking.caller(query(name))
        question = _asker(asking, caller, ask)
        server = here.server(query(name), answering(here, partial(_signed, "one")))
        assert caller.wait_peer(SOON)
        assert question(b"by ") == b"by one"
        server.close()
        with pytest.raises(Unreachable):
            question(b"by ")
        assert not caller.wait_peer(0.0)
        there.server(query(name), answering(there, partial(_signed, "two")))
        assert caller.wait_peer(SOON)
        assert question(b"by ") == b"by two"
        asking.close()

    def test_a_receiver_of_commands_may_move_too(self, here: Transport, there: Transport, name: str) -> None:
        asking = self.open_transport()
        outlet, inbox = asking.outlet(command(name)), Inbox()
        inlet = here.inlet(command(name), lambda _: None)
        assert outlet.wait_peer(SOON)
        outlet.send(blob(asking, b"one"))
        inlet.close()
        with pytest.raises(Unreachable):
            outlet.send(blob(asking, b"nobody"))
        there.inlet(command(name), put(there, inbox))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(asking, b"two"))
        assert inbox.get(timeout=SOON) == b"two"
        asking.close()

    def test_a_killed_publisher_may_be_followed_by_another(self, here: Transport, there: Transport, name: str) -> None:
        inbox = subscribe(here, topic(name))
        victim = Victim(self, here, name, publish_once)
        assert inbox.get(timeout=SOON * 3) == b"last words"
        victim.kill()
        outlet = there.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(there, b"new"))
        assert inbox.get(timeout=SOON) == b"new"

    def test_a_killed_server_is_not_waited_for_in_vain(self, there: Transport, name: str) -> None:
        victim = Victim(self, there, name)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON * 3)
        victim.kill()
        wait_until(lambda: not caller.wait_peer(0.0))

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_server_that_dies_in_a_call_makes_it_unreachable(
        self, there: Transport, name: str, ask: str, pool: ThreadPoolExecutor
    ) -> None:
        victim = Victim(self, there, name)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON * 3)  # a process has to start first
        asking = pool.submit(_asker(there, caller, ask, SOON * 3), b"stuck")
        victim.wait_until_stuck()
        victim.kill()
        with pytest.raises(Unreachable):
            asking.result(SOON)

    # Typed: what user code sees.

    @pytest.fixture
    def proxy(self, here: Transport, there: Transport, name: str) -> Iterator[_Proxy]:
        with _Served(here, name, _Handlers()), _Using(there, name) as proxy:
            yield proxy

    def test_every_type_there_and_back(self, proxy: _Proxy) -> None:
        for value in (e.Nested(), everything_odd()):
            assert_same(proxy.ask(e.echo_nested, value), value)

    def test_large_and_empty_arrays_there_and_back(self, proxy: _Proxy) -> None:
        image = np.random.default_rng(1).integers(0, 256, 6_000_000, np.uint8)
        large = e.Arrays(
            image,
            np.array([-32768, 32767], np.int16),
            np.array([-(2**63), 2**63 - 1], np.int64),
            np.array([math.nan, math.inf, -math.inf, 1e-45], np.float32),
            np.linspace(0, 1, 100_000),
            np.array([True, False]),
        )
        for value in (e.Arrays(), large):
            back = proxy.ask(e.echo_arrays, value)
            assert_same(back, value)
            assert not back.octets.flags.writeable

    def test_lists_bytes_and_buffers_are_taken_for_arrays(self, proxy: _Proxy) -> None:
        given = e.Arrays(b"abc", [1, 2], range(3), memoryview(np.ones(2, np.float32)), (0.5,), [True])  # type: ignore[arg-type]
        back = proxy.ask(e.echo_arrays, given)
        assert back.octets.tobytes() == b"abc"
        assert (back.small.tolist(), back.ints.tolist(), back.floats.tolist()) == ([1, 2], [0, 1, 2], [1.0, 1.0])

    def test_a_receiver_cannot_alter_what_was_sent(self, here: Transport, there: Transport, name: str) -> None:
        kept: list[e.Nested] = []

        class Vandal(_Handlers):
            def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
                kept.append(value)
                value.names.append("vandalised")
                value.scalars.text = "vandalised"
                return value

        sent = everything_odd()
        names, text = list(sent.names), sent.scalars.text
        with _Served(here, name, Vandal()), _Using(there, name) as proxy:
            got = proxy.ask(e.echo_nested, sent)
        assert (sent.names, sent.scalars.text) == (names, text)
        got.names.append("mine")
        assert kept[0].names == [*names, "vandalised"]

    def test_results_then_outputs_come_as_a_tuple(self, proxy: _Proxy) -> None:
        assert proxy.ask(e.divide, 17, 5) == (3, 2)
        assert proxy.ask(e.divide, 2**63 - 1, 1) == (2**63 - 1, 0)

    def test_declared_exceptions_arrive_as_themselves(self, proxy: _Proxy) -> None:
        with pytest.raises(e.Failed) as caught:
            proxy.ask(e.divide, 1, 0)
        assert (type(caught.value), caught.value.what, caught.value.code) == (e.Failed, "division by zero", 7)

    def test_exceptions_derived_from_declared_ones_do_too(self, proxy: _Proxy) -> None:
        with pytest.raises(e.Failed) as caught:
            proxy.ask(e.divide, 1, -1)
        assert isinstance(caught.value, e.FailedBadly)
        assert caught.value.where == e.Point(1.0, 2.0)

    def test_an_undeclared_exception_is_told_with_its_traceback(
        self, proxy: _Proxy, caplog: pytest.LogCaptureFixture
    ) -> None:
        with pytest.raises(RemoteFailure, match="ZeroDivisionError: on purpose") as caught:
            proxy.ask(e.work, "raise")
        assert "Everything_work" in caught.value.trace
        assert "ZeroDivisionError" in caplog.text

    def test_a_wrong_return_value_fails_the_call_and_says_why(
        self, proxy: _Proxy, caplog: pytest.LogCaptureFixture
    ) -> None:
        with pytest.raises(RemoteFailure, match="ret must be a str"):
            proxy.ask(e.work, "return nonsense")

    def test_a_wrong_argument_is_not_sent(self, proxy: _Proxy) -> None:
        with pytest.raises(EncodeError, match="divisor must be an int"):
            proxy.ask(e.divide, 1, "two")
        with pytest.raises(EncodeError, match=r"dividend must be an int from -9223372036854775808"):
            proxy.ask(e.divide, 2**63, 1)

    def test_asynchronous_calls_end_like_synchronous_ones(self, proxy: _Proxy) -> None:
        futures = [proxy.ask_async(e.divide, number, 7) for number in range(50)]
        assert [f.result(SOON) for f in futures] == [divmod(number, 7) for number in range(50)]
        with pytest.raises(e.Failed):
            proxy.ask_async(e.divide, 1, 0).result(SOON)

    def test_they_can_be_awaited(self, proxy: _Proxy) -> None:
        async def both() -> list[Any]:
            calls = [asyncio.wrap_future(proxy.ask_async(e.divide, number, 3)) for number in (10, 11)]
            return list(await asyncio.gather(*calls))

        assert asyncio.run(both()) == [(3, 1), (3, 2)]
        with proxy.monitor.held():
            assert asyncio.run(both()) == [(3, 1), (3, 2)]

    def test_calls_that_are_awaited_end_as_closed_when_their_component_stops(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        async def awaited(proxy: _Proxy) -> str:
            return str(await asyncio.wrap_future(proxy.ask_async(e.work, "stay", deadline=10 * SOON)))

        class Slow(_Handlers):
            def __init__(self) -> None:
                super().__init__()
                self.begun, self.released = threading.Event(), threading.Event()

            def Everything_work(self, task: str) -> Any:
                self.begun.set()
                self.released.wait(10 * SOON)
                return task

        slow = Slow()
        with _Served(here, name, slow), _Using(there, name) as proxy:
            try:
                answer = pool.submit(asyncio.run, awaited(proxy))
                assert slow.begun.wait(SOON)
                proxy.monitor.turn_away()
                with pytest.raises(Closed, match="the component is stopping"):
                    answer.result(SOON)
            finally:
                slow.released.set()

    def test_callbacks_run_like_handlers(self, proxy: _Proxy) -> None:
        inside: list[bool] = []
        done = threading.Event()
        future = proxy.ask_async(e.divide, 1, 1)

        def called_back(_: object) -> None:
            inside.append(proxy.monitor.is_inside)
            done.set()

        future.add_done_callback(called_back)
        assert done.wait(SOON)
        assert inside == [True]

    def test_idempotent_calls_outlast_a_restart_of_their_server_and_others_do_not(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        with contextlib.ExitStack() as everything:
            with _Served(here, name, _Handlers()):
                proxy = everything.enter_context(_Using(there, name))
                assert proxy.ask(e.divide, 7, 2) == (3, 1)
            with pytest.raises(Unreachable):
                proxy.ask(e.work, "once", deadline=SOON)
            later = [pool.submit(proxy.ask, e.divide, 9, 2, deadline=SOON), proxy.ask_async(e.divide, 9, 2)]
            with _Served(here, name, _Handlers()):
                assert [each.result(SOON) for each in later] == [(4, 1)] * 2

    def test_a_handler_that_takes_too_long_times_out(self, proxy: _Proxy) -> None:
        with pytest.raises(Timeout):
            proxy.ask(e.work, "wait", deadline=A_MOMENT)
        assert proxy.ask(e.work, "quick") == "quick"

    def test_what_expired_while_it_waited_is_not_executed(self, here: Transport, there: Transport, name: str) -> None:
        handlers = _Handlers()
        with _Served(here, name, handlers) as served, _Using(there, name) as proxy:
            served.monitor.enter()
            for task in ("never", "somewhat later"):  # when the second call ends, the first has expired there
                with pytest.raises(Timeout):
                    proxy.ask(e.work, task, deadline=A_MOMENT)
            served.monitor.leave()
            assert proxy.ask(e.work, "later") == "later"
        assert "never" not in handlers.done

    def test_commands_and_publications_reach_their_handlers(self, here: Transport, there: Transport, name: str) -> None:
        handlers = _Handlers()
        with _Served(here, name, handlers), _Using(there, name) as proxy:
            proxy.send(e.poke, 3)
            wait_until(lambda: handlers.done == [3])

    def test_malformed_messages_are_dropped_counted_and_logged_once(
        self, here: Transport, there: Transport, name: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        handlers = _Handlers()
        route = _router(there, name)(Port(Verb.REQUIRES, e.EVERYTHING), e.poke)
        channel = Channel(route.channel, Pattern.COMMAND, type_of(e.poke, Pattern.COMMAND))
        with _Served(here, name, handlers) as served:
            outlet = there.outlet(channel)
            assert outlet.wait_peer(SOON)
            caplog.clear()
            for _ in range(20):
                outlet.send(blob(there, b"these are not the bytes you are looking for"))
            outlet.send(there.codec.encoder(e.poke.request)((5,)))
            wait_until(lambda: handlers.done == [5])
            assert served.stats(e.poke).malformed == 20
        assert sum("malformed" in record.message for record in caplog.records) == 1

    def test_eight_clients_get_their_own_answers(self, here: Transport, name: str, pool: ThreadPoolExecutor) -> None:
        def client(number: int) -> list[str]:
            transport = self.open_transport()
            try:
                with _Using(transport, name) as proxy:
                    return [proxy.ask(e.work, f"{number}.{n}") for n in range(40)]
            finally:
                transport.close()

        with _Served(here, name, _Handlers()):
            answers = list(pool.map(client, range(8)))
        assert answers == [[f"{number}.{n}" for n in range(40)] for number in range(8)]

    def test_a_component_that_stops_is_unreachable(self, here: Transport, there: Transport, name: str) -> None:
        served = _Served(here, name, _Handlers())
        with served, _Using(there, name) as proxy:
            assert proxy.ask(e.work, "first") == "first"
            served.monitor.turn_away()
            for how in (proxy.ask, lambda *call: proxy.ask_async(*call).result(SOON)):
                with pytest.raises(Unreachable, match=r"its server left$"):
                    how(e.work, "stopping")
        with pytest.raises((Unreachable, Closed)):
            proxy.ask(e.work, "gone")

    def test_threads_may_share_a_proxy(self, proxy: _Proxy, pool: ThreadPoolExecutor) -> None:
        assert list(pool.map(lambda n: proxy.ask(e.work, str(n)), range(200))) == [str(n) for n in range(200)]

    def test_handlers_of_a_worker_never_overlap(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        inside, most = [0], [0]

        class Nosy(_Handlers):
            def Everything_work(self, task: str) -> str:
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                time.sleep(0.001)
                inside[0] -= 1
                return task

        with _Served(here, name, Nosy()), _Using(there, name) as proxy:
            list(pool.map(lambda n: proxy.ask(e.work, str(n), deadline=SOON), range(60)))
        assert most == [1]

    def test_waiting_handlers_let_others_in_so_components_may_call_in_circles(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        ours, theirs = name + "ours", name + "theirs"
        with (
            _Served(here, ours, _Onward()) as a,
            _Served(there, theirs, _Onward()) as b,
            _Using(here, theirs, a.monitor) as a_to_b,
            _Using(there, ours, b.monitor) as b_to_a,
            _Using(there, ours) as start,
        ):
            a.handlers.onward, b.handlers.onward = a_to_b, b_to_a
            assert start.ask(e.work, "go 5", deadline=SOON) == "arrived"

    def test_too_many_suspended_handlers_make_it_busy(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        waits, release = threading.Semaphore(0), threading.Event()
        served = _Served(here, name, _Handlers())

        def work(task: str) -> str:
            if task == "quick":
                return task
            with served.monitor.suspended():
                waits.release()
                release.wait(SOON)
            return task

        served.handlers.Everything_work = work
        with served, _Using(there, name) as proxy:
            futures = [proxy.ask_async(e.work, "wait", deadline=SOON * 3) for _ in range(MAX_SUSPENDED)]
            for _ in futures:
                assert waits.acquire(timeout=SOON)
            served.monitor.enter()
            with pytest.raises(Busy):
                proxy.ask(e.work, "one too many")
            served.monitor.leave()
            release.set()
            assert [f.result(SOON) for f in futures] == ["wait"] * MAX_SUSPENDED
            assert proxy.ask(e.work, "quick") == "quick"


# -- channels, payloads, inboxes ----------------------------------------------


def answering(transport: Transport, answer: Callable[[bytes], bytes]) -> Callable[[Payload, float], Reply]:
    return lambda payload, expires: Reply(Status.OK, blob(transport, answer(unblob(transport, payload))))


def _wait_connected(outlet: Outlet) -> None:
    assert outlet.wait_peer(SOON)
    assert wait_connected(outlet, SOON)


def _send_many(transport: Transport, outlet: Outlet, number: int, deadline: float = A_MOMENT) -> None:
    for _ in range(number):
        outlet.send(blob(transport, bytes(100_000)), deadline)


def _noting(inbox: Inbox) -> Callable[[bytes], bytes]:
    """An echo that leaves a note."""

    def note(data: bytes) -> bytes:
        inbox.put(data)
        return data

    return note


def _in_a_namespace(name: str, instance: str) -> tuple[str, str]:
    """A channel in a new namespace, and the name that a client uses for it: with this instance, or `any`."""
    namespace, interface, operation = name.split("/")
    looked_up = "*" if instance == "any" else "one"
    return f"{namespace}/one/{interface}/{operation}", f"{namespace}/{looked_up}/{interface}/{operation}"


def _signed(name: str, data: bytes) -> bytes:
    return data + name.encode()


def _asker(transport: Transport, caller: Caller, how: str, deadline: float = SOON) -> Callable[[bytes], bytes]:
    """Ask by either of the two ways."""

    def ask(data: bytes) -> bytes:
        payload = blob(transport, data)
        reply = caller.ask(payload, deadline) if how == "ask" else caller.call(payload, deadline).result(SOON * 3)
        return unblob(transport, in_time(reply).payload)

    return ask


def _asked_meanwhile(
    transport: Transport, caller: Caller, answers: queue.Queue[Future[Reply]], serving: Transport
) -> Reply:
    """A call after others, answered at once: everything sent before it has arrived."""
    known = answers.qsize()
    asked = caller.call(blob(transport, b"meanwhile"), SOON)
    wait_until(lambda: answers.qsize() > known)
    answers.queue.pop().set_result(Reply(Status.OK, blob(serving, b"meanwhile")))
    return asked.result(SOON)


def _answering_all_but_stuck(transport: Transport) -> Callable[[Payload, float], Reply | Future[Reply]]:
    """A service that echoes requests, but never answers `stuck`."""

    def service(payload: Payload, expires: float) -> Reply | Future[Reply]:
        data = unblob(transport, payload)
        return Future() if data == b"stuck" else Reply(Status.OK, blob(transport, data))

    return service


# -- typed --------------------------------------------------------------------


class _Handlers:
    """Implements `Everything`."""

    def __init__(self) -> None:
        self.done: list[object] = []
        self.onward: Any = None

    def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
        return value

    def Everything_echo_arrays(self, value: e.Arrays) -> e.Arrays:
        return value

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        if divisor == 0:
            raise e.Failed("division by zero", 7)
        if divisor == -1:
            raise e.FailedBadly("worse", 8, e.Point(1.0, 2.0))
        return divmod(dividend, divisor)

    def Everything_work(self, task: str) -> Any:
        self.done.append(task)
        if task == "raise":
            raise ZeroDivisionError("on purpose")
        if task == "wait":
            time.sleep(A_MOMENT * 2)
        return None if task == "return nonsense" else task

    def Everything_poke(self, number: int) -> None:
        self.done.append(number)


class _Onward(_Handlers):
    """Passes work on until there is none left."""

    def Everything_work(self, task: str) -> Any:
        left = int(task.split()[1])
        return self.onward.ask(e.work, f"go {left - 1}", deadline=SOON) if left else "arrived"


class _Served:
    """Handlers behind a transport, under a monitor of their own."""

    def __init__(self, transport: Transport, name: str, handlers: Any) -> None:
        self.monitor = Monitor("served")
        self.monitor.open()
        self.handlers = handlers
        self._operations = [operation for operation, _ in e.EVERYTHING.under(Verb.IMPLEMENTS)]
        self._port = Port(Verb.IMPLEMENTS, e.EVERYTHING)
        self._route = _router(transport, name)
        self._links: list[Link] = []

    def stats(self, operation: Operation[Any]) -> Any:
        return self._links[self._operations.index(operation)].stats

    def __enter__(self) -> _Served:
        self._links = ports.bind_handlers(self._port, self.handlers, self._route, self.monitor)
        return self

    def __exit__(self, *exc: object) -> None:
        ports.close_all(self._links)
        self.monitor.close()


class _Proxy(ports.Proxy):
    """What a generated proxy does, for any operation."""

    monitor: Monitor

    def ask(self, operation: Operation[Any], *arguments: Any, deadline: float | None = None) -> Any:
        return self._ask(operation, arguments, deadline)

    def ask_async(self, operation: Operation[Any], *arguments: Any, deadline: float | None = None) -> Future[Any]:
        return self._ask_async(operation, arguments, deadline)

    def send(self, operation: Operation[None], *arguments: Any) -> None:
        self._send(operation, arguments, None)


class _Using:
    """A proxy of `Everything` over a transport, once its server is visible."""

    def __init__(self, transport: Transport, name: str, monitor: Monitor | None = None) -> None:
        self._monitor, self._own = monitor or Monitor("using"), monitor is None
        if self._own:
            self._monitor.open()
        port = Port(Verb.REQUIRES, e.EVERYTHING, proxy=_Proxy)
        self._proxy, self._links = ports.bind_proxy(port, _router(transport, name), self._monitor)

    def __enter__(self) -> _Proxy:
        for link in self._links:
            assert link.wait_peer(SOON)
        assert isinstance(self._proxy, _Proxy)
        self._proxy.monitor = self._monitor
        return self._proxy

    def __exit__(self, *exc: object) -> None:
        ports.close_all(self._links)
        if self._own:
            self._monitor.close()


def _router(transport: Transport, name: str) -> Router:
    instance = name.replace("/", "_")

    def route(port: Port, operation: Operation[Any]) -> Route:
        return Route(transport, "tested", f"{instance}/{port.interface.short}/{operation.name}", port.qos, SOON)

    return route


def everything_odd() -> e.Nested:
    """A value at the limits of its types."""
    scalars = e.Scalars(
        True, -128, 65535, -(2**63), 255, 0.5, -32768, math.inf, "naïve ☃ 𝄞\0end", 2**32 - 1, -1, 2**64 - 1, 2**31 - 1,
        e.Colour.ultraviolet,
    )  # fmt: skip
    return e.Nested(
        scalars,
        [e.Point(-0.0, 5e-324), e.Point(math.nan, -math.inf)],
        ["", "x" * 1000, "ñ"],
        [e.Colour.green, e.Colour.ultraviolet],
        {"": e.Point(), "königlich": e.Point(1.0, 2.0)},
        {-(2**31): "low", 2**31 - 1: "high"},
        {e.Colour.green: 1.5},
        [[], [e.Point(3.0, 4.0)] * 2],
    )


def assert_same(found: Any, expected: Any, at: str = "value") -> None:
    """Assert that values are equal (NaN equals NaN), of the same classes, and arrays of the same dtype."""
    if isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype, at
        np.testing.assert_array_equal(found, expected, at)
        return
    assert type(found) is type(expected), f"{at}: {found!r} is no {type(expected).__name__}"
    if is_dataclass(expected):
        for each in fields(expected):
            assert_same(getattr(found, each.name), getattr(expected, each.name), f"{at}.{each.name}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), at
        for number, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert_same(one, other, f"{at}[{number}]")
    elif isinstance(expected, dict):
        assert list(map(repr, found)) == list(map(repr, expected)), at
        for one, other in zip(found.values(), expected.values(), strict=True):
            assert_same(one, other, f"{at}[…]")
    elif isinstance(expected, float):
        same = found == expected or (math.isnan(found) and math.isnan(expected))
        assert same, f"{at}: {found!r} is not {expected!r}"
        assert math.copysign(1, found) == math.copysign(1, expected) or math.isnan(expected), at
    else:
        assert found == expected, at
