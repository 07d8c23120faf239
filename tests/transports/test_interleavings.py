"""Two threads at once: each test makes them meet where one has done half of its work."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.testing.conformance import blob, query, topic, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Statistics, TransportConfig, wait_connected
from robocomp_py.transports.dds.topics import Publisher as DDSPublisher
from robocomp_py.transports.dds.transport import DDSTransport
from robocomp_py.transports.dds.types import Grant
from robocomp_py.transports.directory_transport import DirectoryLink
from robocomp_py.transports.leader_followers import Job, Lane
from robocomp_py.transports.shm.loop import Loop
from robocomp_py.transports.shm.transport import ShmTransport
from robocomp_py.transports.zenoh.reader import Reader
from robocomp_py.transports.zeromq.sockets import Subscription
from robocomp_py.transports.zeromq.transport import ZeroMQTransport

from .dds.domains import DOMAIN

RELIABLE = QoS(Reliability.RELIABLE, depth=1)


def test_zeromq_a_publisher_that_was_paused_is_heard_even_if_there_was_room_again_at_that_moment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with contextlib.closing(ZeroMQTransport(TransportConfig())) as here:
        heard, go_on, paused = queue.Queue[bytes](), threading.Event(), threading.Event()

        def sink(payload: Any) -> None:
            go_on.wait(SOON)
            heard.put(unblob(here, payload))

        inlet: Any = here.inlet(topic("a/b/c", RELIABLE), sink)
        mute = here.reactor.mute

        def mute_late(subscription: Subscription) -> None:
            """Until then, the sink has handled everything."""
            if not paused.is_set():
                paused.set()
                go_on.set()
                wait_until(lambda: inlet._lane.idle)
                inlet._drain()  # as the thread does that ran the sink, if it has not yet
            mute(subscription)

        monkeypatch.setattr(here.reactor, "mute", mute_late)
        outlet = here.outlet(topic("a/b/c", RELIABLE))
        assert wait_connected(outlet, SOON)
        words = [b"in the sink", b"waits", b"not read yet"]
        for word in words:
            outlet.send(blob(here, word))
        assert paused.wait(SOON)
        assert [heard.get(timeout=SOON) for _ in words] == words
        outlet.send(blob(here, b"later"))
        assert heard.get(timeout=SOON) == b"later"


class _Fussy(DirectoryLink[Any]):
    """A link whose first look fails."""

    role, facing = "calls", "serves"
    looked = 0

    def look(self) -> bool:
        self.looked += 1
        return self.looked > 1


def test_a_link_that_could_not_look_when_it_was_opened_looks_again_even_if_the_others_are_looking_just_then() -> None:
    with contextlib.closing(ShmTransport(TransportConfig())) as here:
        opened: list[_Fussy] = []

        class Opening(_Fussy):
            def look(self) -> bool:
                if threading.current_thread() is not threading.main_thread() and not opened:
                    opened.append(
                        here._open(partial(_Fussy, here, Channel("a/b/d", query("").pattern, query("").type)))
                    )
                return True

        here._open(partial(Opening, here, query("a/b/c")))
        here._known = -1  # as if a peer had come
        here.look_soon()
        wait_until(lambda: bool(opened) and opened[0].looked > 1)


def test_shm_a_shared_wake_up_reaches_all_links_although_one_closes_meanwhile() -> None:
    attended: list[object] = []

    class Link:
        def on_input(self, *, one: bool = False) -> tuple[Job, ...]:
            attended.append(self)
            return ()

    class Leaving(Link):
        """When it is compared with another link that is about to be attended to, that one leaves."""

        def __eq__(self, other: object) -> bool:
            loop.remove(5, first)
            return self is other

        __hash__ = Link.__hash__

    wakeup = SimpleNamespace(wait=lambda seconds: (5, 6))
    loop = Loop(wakeup, SimpleNamespace(wake=lambda number: True), lambda: 1.0, lambda: None)  # type: ignore[arg-type]
    before, first, second = Leaving(), Link(), Link()
    for link in (first, second):
        loop.add(5, link)
    loop.receive()
    attended.clear()
    loop.attend(before)
    loop.receive()
    assert second in attended


def test_a_lane_that_is_closed_stays_empty_although_a_message_arrives_meanwhile() -> None:
    lane = Lane("a/b/c", lambda payload: None, 1, lossy=False, stats=Statistics())
    assert lane.put(b"1")
    close_gate = lane._gate.close

    def close_late() -> None:
        lane.put(b"2")
        close_gate()

    lane._gate.close = close_late  # type: ignore[method-assign]
    lane.close()
    assert lane.idle


def test_zenoh_a_subscription_that_ends_while_messages_are_read_is_no_error(caplog: pytest.LogCaptureFixture) -> None:
    heard, ended = queue.Queue[Any](), threading.Event()
    messages = iter([b"first"])

    def receive() -> bytes:
        for message in messages:
            return message
        ended.set()
        raise zenoh.ZError("ended")

    def receive_now() -> bytes:
        raise zenoh.ZError("ended")

    reader = Reader("a/b/c", lambda message: message, heard.put, 1, lossy=True, stats=Statistics())
    with caplog.at_level(logging.WARNING):
        reader.start(SimpleNamespace(recv=receive, try_recv=receive_now))  # type: ignore[arg-type]
        assert heard.get(timeout=SOON) == b"first"
        assert ended.wait(SOON)
        reader.close()
    assert not caplog.records


def test_dds_credit_of_a_reader_that_is_not_discovered_yet_is_kept_although_another_one_is() -> None:
    with contextlib.closing(DDSTransport(TransportConfig({"domain": DOMAIN}))) as here:
        outlet = here.outlet(topic("a/b/c", RELIABLE))
        assert isinstance(outlet, DDSPublisher)
        early = Grant(7, outlet.id, 0, 1000)
        outlet._early[7] = early
        outlet.look()
        assert outlet._early == {7: early}
