"""What becomes of messages that are too old, and of publishers that offer less than is asked for. No clock but ours."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.transports.base import Channel, Heard, Sink, Source, Statistics, TypeRef
from robocomp_py.transports.reception import Reception

FRONT, REAR = "front/LaserPub/push", "rear/LaserPub/push"
NOW = 1_700_000_000_000_000_000


class Hearing:
    """A subscription whose messages wait for each other until `deliver`."""

    def __init__(self, qos: QoS, heard: Callable[[str], object] | None = None, *, headed: bool = False) -> None:
        self.now, self.stats = 100.0, Statistics()
        self.delivered: list[object] = []
        self._sink: Sink = self._deliver
        channel = Channel("*/LaserPub/push", Pattern.PUBLISH, TypeRef("x"), qos, on_receive=heard, headed=headed)
        self.reception = Reception(channel, self.stats, self._through, lambda: self.now, self._stamp)
        self._waiting: list[object] = []

    def _stamp(self) -> int:
        return NOW + int(self.now * 1e9)

    def _through(self, wrap: Callable[[Sink], Sink]) -> None:
        self._sink = wrap(self._sink)

    def _deliver(self, payload: object) -> None:
        self.delivered.append(payload)

    def receive(self, payload: object, name: str = FRONT, age: float = 0.0) -> None:
        if self.reception.on:
            payload = self.reception.admit(name, self._stamp() - int(age * 1e9), payload, 7, 1)
        self._waiting.append(payload)

    def deliver(self) -> list[object]:
        for payload in self._waiting:
            self.stats.received += 1
            self._sink(payload)
        self._waiting.clear()
        return self.delivered


def test_without_a_qos_request_reception_is_off() -> None:
    hearing = Hearing(QoS())
    hearing.reception.meet([Source(FRONT, QoS(deadline=1.0, lease=1.0))])
    assert not hearing.reception.on


def test_who_asks_for_headers_gets_them_with_each_message_that_is_fresh() -> None:
    hearing = Hearing(QoS(lifespan=1.0), headed=True)
    hearing.receive("fresh")
    hearing.receive("old", age=2.0)
    assert hearing.deliver() == [Heard(FRONT, 7, 1, hearing._stamp(), "fresh")]


def test_commands_have_no_headers() -> None:
    channel = Channel("front/Laser/stop", Pattern.COMMAND, TypeRef("x"), headed=True)
    assert not Reception(channel, Statistics(), lambda wrap: None).on


def test_every_message_is_reported_on_arrival() -> None:
    heard: list[str] = []
    hearing = Hearing(QoS(), heard.append)
    hearing.receive(1)
    hearing.receive(2, REAR)
    assert heard == [FRONT, REAR]
    assert hearing.deliver() == [1, 2]


def test_what_waited_too_long_is_not_delivered_but_counted(caplog: pytest.LogCaptureFixture) -> None:
    hearing = Hearing(QoS(lifespan=1.0))
    hearing.receive("old")
    hearing.now += 0.6
    hearing.receive("new")
    hearing.receive("newer")
    hearing.now += 0.6
    assert hearing.deliver() == ["new", "newer"]
    assert (hearing.stats.received, hearing.stats.expired) == (2, 1)
    assert "older than its lifespan of 1 s when its turn came" in caplog.text


def test_the_age_of_a_message_counts_from_when_it_was_sent(caplog: pytest.LogCaptureFixture) -> None:
    hearing = Hearing(QoS(lifespan=1.0))
    hearing.receive("fresh", age=0.5)
    hearing.receive("stale", age=1.5)
    assert hearing.deliver() == ["fresh"]
    assert "when it came in, 1.5 s after it was sent" in caplog.text
    hearing.receive("fresh too", age=0.5)
    hearing.now += 0.6
    assert hearing.deliver() == ["fresh"]


def test_a_message_from_the_future_is_new() -> None:
    hearing = Hearing(QoS(lifespan=1.0))
    hearing.receive("from an hour ahead", age=-3600.0)
    hearing.now += 1.5
    assert hearing.deliver() == []


def test_a_message_that_does_not_say_when_it_was_sent_is_new() -> None:
    hearing = Hearing(QoS(lifespan=1.0))
    hearing.receive("unknown", age=hearing.now + NOW / 1e9)
    assert hearing.deliver() == ["unknown"]


def test_the_lifespan_that_a_publisher_offers_holds_for_its_messages_and_no_others() -> None:
    hearing = Hearing(QoS())
    hearing.receive("came before anybody spoke of lifespans")
    hearing.reception.meet([Source(FRONT, QoS(lifespan=1.0)), Source(REAR, QoS())])
    hearing.receive("front")
    hearing.receive("rear", REAR)
    hearing.now += 2.0
    assert hearing.deliver() == ["came before anybody spoke of lifespans", "rear"]


@pytest.mark.parametrize(("asked", "offered"), [(1.0, 9.0), (9.0, 1.0)])
def test_the_shorter_lifespan_of_both_ends_holds(asked: float, offered: float) -> None:
    hearing = Hearing(QoS(lifespan=asked))
    hearing.reception.meet([Source(FRONT, QoS(lifespan=offered))])
    hearing.receive("front")
    hearing.now += 2.0
    assert hearing.deliver() == []


def test_a_qos_that_a_publisher_lacks_is_logged_once_with_a_remedy(caplog: pytest.LogCaptureFixture) -> None:
    hearing = Hearing(QoS(Reliability.RELIABLE, deadline=0.5))
    for _ in range(3):
        hearing.reception.meet([Source(FRONT, QoS(deadline=2.0)), Source(REAR, hearing.reception._channel.qos)])
    assert [record.message for record in caplog.records] == [
        "*/LaserPub/push: the publisher of front/LaserPub/push keeps less than this subscription asks for: "
        "`reliable` is asked for, `best_effort` is offered; `deadline 500 ms` is asked for, `deadline 2 s` is "
        'offered. Give its port the qos that ours has, or ours reliability = "best_effort", deadline = 2'
    ]


def test_many_publishers_cost_a_bounded_memory() -> None:
    hearing = Hearing(QoS())
    hearing.reception.meet(Source(f"i{number}/LaserPub/push", QoS(lifespan=1.0)) for number in range(5000))
    assert len(hearing.reception._lifespans) == len(hearing.reception._told) == 1000
