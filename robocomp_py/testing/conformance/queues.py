"""Queues of topics: what waits for a slow subscriber, what a late one still gets, and when a publisher waits."""

from __future__ import annotations

import itertools
import threading
import time
import uuid
from concurrent.futures import ThreadPoolExecutor

import pytest

from ...contract.qos import Durability, QoS, Reliability
from ...errors import Timeout, UnsupportedQoS
from ...transports.base import Capability, Outlet, Transport, require, wait_connected
from ...wire.codec import Payload
from ..parts import A_MOMENT, Inbox, TransportSuite, blob, drain, subscribe, topic, unblob
from ..patience import SOON, wait_until
from .qos import refuses

_RELIABLE = QoS(Reliability.RELIABLE, depth=8)
_LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)


class QueuesConformance(TransportSuite):
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
            wait_until(lambda n=number: link.stats.dropped >= n - 3)  # type: ignore[misc]  # mypy
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
            wait_until(lambda already=step: len(delivered) > already)  # type: ignore[misc]  # mypy
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
                wait_until(lambda n=number: heard[b"word"] == n)  # type: ignore[misc]  # mypy
                held_up.append(meanwhile[number] - before)
            assert sorted(held_up)[10] < 50, held_up
        finally:
            stop.set()
            flooder.join()


def _send_many(transport: Transport, outlet: Outlet, number: int, deadline: float = A_MOMENT) -> None:
    for _ in range(number):
        outlet.send(blob(transport, bytes(100_000)), deadline)
