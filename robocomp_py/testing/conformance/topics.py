"""Topics: publishers and subscribers meet in any order, and messages arrive."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from ...contract.qos import QoS, Reliability
from ...errors import Closed
from ...transports.base import Link, SupportsConnected, Transport, gathering, wait_connected
from ...wire.codec import Payload
from ..parts import A_MOMENT, BLOB, Inbox, TransportSuite, blob, command, drain, greet, put, subscribe, topic, unblob
from ..patience import SOON, wait_until
from .qos import refuses

_STARTS = 10
"""New ends of a topic that a test opens one after the other."""

_AT_ONCE = 25
"""Pairs of ends that a test opens at the same time."""

_MANY = QoS(depth=5000)
_RELIABLE = QoS(Reliability.RELIABLE, depth=8)


class TopicsConformance(TransportSuite):
    def test_every_subscriber_gets_every_message_in_order(self, here: Transport, there: Transport, name: str) -> None:
        inboxes = [subscribe(transport, topic(name, _MANY)) for transport in (here, there, there)]
        outlet = there.outlet(topic(name, _MANY))
        greet(there, outlet, *inboxes)
        sent = [str(number).encode() for number in range(1000)]
        for number, message in enumerate(sent, 1):
            outlet.send(blob(there, message))
            if number % 100 == 0:  # best-effort messages may be lost if they are sent faster than they can travel
                wait_until(lambda n=number: all(inbox.qsize() == n for inbox in inboxes))  # type: ignore[misc]  # mypy
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
