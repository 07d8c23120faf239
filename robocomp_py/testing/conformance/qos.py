"""QoS of topics: deadlines, lifespans, leases and `keep_all`.

A transport must refuse, by name, a policy that it does not declare.
For a policy that it declares, the tests require:

    deadline      a missed one is reported and counted; none is missed while messages come
    lifespan      expired messages are not delivered, whichever end sets the limit: not to slow sinks or latecomers
    liveliness    a publisher whose process is killed or hangs is lost, and so is a manual one that sends nothing;
                  a publisher that returned can be lost again
    clock jumps   no deadline is missed, no publisher lost
    offered less  than requested: both are reported, and messages pass
    slow readers  a healthy one beside a hung one gets everything · at most `depth` messages wait, and the statistics
                  count the others · `keep_all` is bounded
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from ...contract.component import Port
from ...contract.interface import Operation, Pattern, Verb
from ...contract.qos import Durability, History, Liveliness, QoS, Reliability
from ...errors import Timeout, UnsupportedQoS
from ...runtime import ports
from ...runtime.calls import type_of
from ...runtime.monitor import Monitor
from ...runtime.route import Route
from ...runtime.watch import Lost, Missed
from ...runtime.watching import Watching
from ...transports.base import Channel, Outlet, Transport, needs, require
from ...wire.codec import Payload
from .. import everything as e
from ..parts import A_MOMENT, Inbox, TransportSuite, Victim, blob, greet, subscribe, topic, unblob
from ..patience import SCALE, SOON, wait_until

_SHORT = 0.1 * SCALE
_LIFESPAN = 0.15 * SCALE
_AUTOMATIC = QoS(lease=1.0 * SCALE)
_MANUAL = QoS(lease=0.3 * SCALE, liveliness=Liveliness.MANUAL_BY_TOPIC)
_MOST = 200_000
"""More messages than any transport must keep."""


class QoSConformance(TransportSuite):
    def test_a_missed_deadline_is_told(self, here: Transport, there: Transport, name: str) -> None:
        qos = QoS(deadline=_SHORT)
        if refuses(here, qos):
            return
        with _Subscribed(there, name, qos) as subscribed:
            _send(_publish(here, name, qos), here, 1)
            wait_until(lambda: subscribed.told)
            first = subscribed.told[0]
            assert isinstance(first, Missed)
            assert first.channel == _channel(name)

    def test_no_deadline_is_missed_while_messages_come(self, here: Transport, there: Transport, name: str) -> None:
        qos = QoS(depth=100, deadline=SOON * 3)
        if refuses(here, qos):
            return
        with _Subscribed(there, name, qos) as subscribed:
            outlet = _publish(here, name, qos)
            for number in range(20):
                _send(outlet, here, number)
            wait_until(lambda: len(subscribed.numbers) == 20)
            assert subscribed.told == []

    @pytest.mark.parametrize("who", ["subscriber", "publisher"])
    def test_what_waits_for_a_slow_sink_beyond_its_lifespan_is_not_delivered(
        self, here: Transport, there: Transport, name: str, who: str
    ) -> None:
        qos = QoS(lifespan=_LIFESPAN)
        if refuses(here, qos):
            return
        inbox, blocked, release = Inbox(), threading.Event(), threading.Event()

        def sink(payload: Payload) -> None:
            inbox.put(unblob(there, payload))
            blocked.set()
            release.wait(SOON)

        link = there.inlet(topic(name, qos if who == "subscriber" else QoS()), sink)
        outlet = here.outlet(topic(name, qos if who == "publisher" else QoS()))
        assert outlet.wait_peer(SOON)
        assert link.wait_peer(SOON)
        # The first message blocks the sink. Once one was dropped, the queue is full: all messages have arrived.
        _until(lambda: blocked.is_set() and link.stats.dropped > 0, outlet, here, b"old")
        _let_lifespan_pass()
        release.set()
        wait_until(lambda: link.stats.expired > 0)  # before newer messages displace the old ones
        _until(lambda: b"fresh" in inbox.queue, outlet, here, b"fresh")
        assert inbox.queue.count(b"old") == 1

    def test_latecomers_do_not_get_what_is_older_than_its_lifespan(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        qos = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=5, lifespan=_LIFESPAN)
        if refuses(here, qos):
            return
        outlet = here.outlet(topic(name, qos))
        outlet.send(blob(here, b"old"))
        _let_lifespan_pass()
        inbox = subscribe(there, topic(name, qos))
        _until(lambda: not inbox.empty(), outlet, here, b"fresh")
        assert inbox.get_nowait() == b"fresh"

    def test_a_publisher_whose_process_hangs_is_lost_and_so_is_one_that_is_killed(
        self, there: Transport, name: str
    ) -> None:
        if refuses(there, _AUTOMATIC):
            return
        with _Subscribed(there, name, _AUTOMATIC) as subscribed:
            victim = Victim(self, there, name, _publish_news)
            wait_until(lambda: subscribed.alive() == [_channel(name)], SOON * 3)  # a process has to start first
            losses = 0
            if victim.hang():
                losses = 1
                wait_until(lambda: subscribed.told)
                victim.go_on()
                wait_until(subscribed.alive)
            victim.kill()
            wait_until(lambda: len(subscribed.told) > losses)
            assert subscribed.told == [Lost(_channel(name), 1, total) for total in range(1, losses + 2)]

    def test_a_publisher_that_came_back_may_be_lost_again(self, there: Transport, name: str) -> None:
        if refuses(there, _AUTOMATIC):
            return
        with _Subscribed(there, name, _AUTOMATIC) as subscribed:
            for _ in range(2):
                transport = self.open_transport()
                _publish(transport, name, _AUTOMATIC)
                wait_until(lambda: subscribed.alive() == [_channel(name)])
                transport.close()
                wait_until(lambda: not subscribed.alive())
            wait_until(lambda: len(subscribed.told) == 2)
            assert subscribed.told[-1] == Lost(_channel(name), 1, 2)

    def test_a_publisher_that_has_to_send_something_and_does_not_is_lost(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        if refuses(here, _MANUAL):
            return
        with _Subscribed(there, name, _MANUAL) as subscribed:
            outlet = _publish(here, name, _MANUAL)
            for times in (1, 2):
                _send(outlet, here, times)
                wait_until(lambda n=times: len(subscribed.told) == n)  # type: ignore[misc]
            assert subscribed.told == [Lost(_channel(name), 1, 1), Lost(_channel(name), 1, 2)]

    def test_when_the_clock_jumps_no_deadline_is_missed_and_no_publisher_lost(
        self, here: Transport, there: Transport, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        qos = QoS(deadline=SOON * 3, lease=SOON * 3, liveliness=Liveliness.MANUAL_BY_TOPIC)
        if refuses(here, qos):
            return
        true_ns = time.time_ns
        with _Subscribed(there, name, qos) as subscribed:
            outlet = _publish(here, name, qos)
            for number, hours in enumerate((0, 24, -24)):
                leap = hours * 3600 * 10**9
                monkeypatch.setattr(time, "time_ns", lambda leap=leap: true_ns() + leap)
                monkeypatch.setattr(time, "time", lambda leap=leap: (true_ns() + leap) / 1e9)
                _send(outlet, here, number)
                wait_until(lambda: len(subscribed.numbers) > number)  # noqa: B023 - called at once
            assert subscribed.numbers == [0, 1, 2]
            assert subscribed.told == []

    def test_a_publisher_that_offers_less_is_named_and_heard(
        self, here: Transport, there: Transport, name: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        asked = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, deadline=5.0, lease=2.0)
        if refuses(here, asked):
            return
        inbox, outlet = subscribe(there, topic(name, asked)), here.outlet(topic(name))
        greet(here, outlet, inbox)
        for policy in (
            "`reliable` is asked for, `best_effort` is offered",
            "`transient_local` is asked for, `volatile` is offered",
            "`deadline 5 s` is asked for, none is offered",
            "`lease 2 s` is asked for, none is offered",
        ):
            wait_until(lambda text=policy: text in caplog.text)  # type: ignore[misc]
        outlet.send(blob(here, b"x"))
        assert inbox.get(timeout=SOON) == b"x"

    def test_a_healthy_subscriber_beside_one_that_hangs_gets_everything(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        release, stuck = threading.Event(), threading.Event()

        def hang(payload: Payload) -> None:
            stuck.set()
            release.wait(SOON * 3)

        healthy = self.open_transport()
        there.inlet(topic(name), hang)
        inbox, outlet = subscribe(healthy, topic(name)), here.outlet(topic(name))
        try:
            greet(here, outlet, inbox)
            _until(stuck.is_set, outlet, here, b"")
            for number in range(200):
                sent = str(number).encode()
                outlet.send(blob(here, sent))
                while inbox.get(timeout=SOON) != sent:
                    pass  # messages sent before the other one got stuck
        finally:
            release.set()
            healthy.close()

    def test_of_a_flood_no_more_waits_for_a_slow_sink_than_its_depth_and_the_statistics_say_so(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        release, stuck = threading.Event(), threading.Event()

        def hang(payload: Payload) -> None:
            stuck.set()
            release.wait(SOON * 3)

        channel = topic(name, QoS(depth=4))
        link, outlet = there.inlet(channel, hang), here.outlet(channel)
        assert outlet.wait_peer(SOON)
        sent = 0

        def waiting() -> int:
            nonlocal sent
            outlet.send(blob(here, b"x"))
            sent += 1
            return sent - link.stats.received - link.stats.dropped - link.stats.lost

        try:
            wait_until(lambda: waiting() >= 0 and stuck.is_set())
            for _ in range(2000):
                waiting()
            wait_until(lambda: waiting() <= 4 + 1)  # the one that was just sent may be on its way
        finally:
            release.set()

    @pytest.mark.parametrize("reliability", list(Reliability))
    def test_to_keep_all_is_bounded_and_loses_nothing(
        self, here: Transport, there: Transport, name: str, reliability: Reliability
    ) -> None:
        qos = QoS(reliability, history=History.KEEP_ALL)
        if refuses(here, qos):
            return
        release = threading.Event()
        there.inlet(topic(name, qos), lambda _: release.wait(SOON * 3))
        outlet = here.outlet(topic(name, qos))
        assert outlet.wait_peer(SOON)
        message = blob(here, bytes(100))
        try:
            with pytest.raises(Timeout):
                _send_many(outlet, message)
        finally:
            release.set()


def _send_many(outlet: Outlet, message: Payload) -> None:
    for _ in range(_MOST):
        outlet.send(message, A_MOMENT)


def refuses(transport: Transport, qos: QoS) -> bool:
    """Whether a transport does not offer a QoS; then its error must say so."""
    channel = topic("any/Conformance/op", qos)
    if not needs(channel) & ~transport.capabilities:
        return False
    with pytest.raises(UnsupportedQoS, match="this transport does not offer"):
        require(transport, "this transport", channel)
    return True


def _until(condition: Callable[[], object], outlet: Outlet, transport: Transport, message: bytes) -> None:
    """Send a message repeatedly until a condition holds."""

    def tried() -> object:
        outlet.send(blob(transport, message))
        return condition()

    wait_until(tried)


def _let_lifespan_pass() -> None:
    end = time.monotonic() + 2 * _LIFESPAN
    wait_until(lambda: time.monotonic() >= end, SOON + 2 * _LIFESPAN)


# -- topics as the runtime subscribes to them ---------------------------------


def _channel(name: str) -> str:
    return f"{name.replace('/', '_')}/{e.EVERYTHING.short}/{e.news.name}"


def _publish(transport: Transport, name: str, qos: QoS) -> Outlet:
    """An outlet with a connected subscriber."""
    outlet = transport.outlet(Channel(_channel(name), Pattern.PUBLISH, type_of(e.news, Pattern.PUBLISH), qos))
    assert outlet.wait_peer(SOON)
    return outlet


def _send(outlet: Outlet, transport: Transport, number: int) -> None:
    outlet.send(transport.codec.encoder(e.news.request)((number, "")))


def _publish_news(transport: Transport, name: str, _: Any) -> None:
    """For a victim."""
    _send(_publish(transport, name, _AUTOMATIC), transport, 1)


class _Subscribed:
    """A subscription, its received messages, and its QoS events."""

    def __init__(self, transport: Transport, name: str, qos: QoS) -> None:
        self.told: list[Missed | Lost] = []
        self.numbers: list[int] = []
        self._monitor = Monitor("subscribed")
        self._monitor.open()
        self._watching = Watching("subscribed", lambda port, operation, event: self.told.append(event))
        port = Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=qos)

        def route(port: Port, operation: Operation[Any]) -> Route:
            return Route(transport, "tested", _channel(name), port.qos, SOON)

        self._links = ports.bind_handlers(port, self, route, self._monitor, self._watching)
        (self._watched,) = self._watching.all

    def alive(self) -> list[str]:
        return self._watched.alive()

    def Everything_news(self, number: int, text: str) -> None:
        self.numbers.append(number)

    def __enter__(self) -> _Subscribed:
        self._watching.begin()
        return self

    def __exit__(self, *exc: object) -> None:
        self._watching.close()
        ports.close_all(self._links)
        self._monitor.close()
