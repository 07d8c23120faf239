"""Deadlines and liveliness: what is missed and lost, and when it is said. No clock but ours."""

from __future__ import annotations

from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.qos import Liveliness, QoS
from robocomp_py.runtime.watch import CHANNELS, Lost, Missed, Watch

FRONT, REAR = "front/LaserPub/push", "rear/LaserPub/push"
AUTOMATIC, MANUAL = QoS(lease=1.0), QoS(lease=1.0, liveliness=Liveliness.MANUAL_BY_TOPIC)


def there(*names: str, offered: QoS = AUTOMATIC) -> Mapping[str, QoS]:
    return dict.fromkeys(names, offered)


class Looking:
    """A watch, and who is there."""

    def __init__(self, qos: QoS, *names: str, offered: QoS | None = None) -> None:
        self.watch, self.asked = Watch(qos), 0
        self._offered = offered or qos
        self.names = names

    def look(self, now: float) -> list[Missed | Lost]:
        return self.watch.look(now, self._sources)

    def _sources(self) -> Mapping[str, QoS]:
        self.asked += 1
        return there(*self.names, offered=self._offered)


def test_messages_in_time_miss_nothing() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT)
    for tick in range(10):
        looking.watch.heard(FRONT, tick * 0.1)
        assert looking.look(tick * 0.1 + 0.09) == []
    assert looking.watch.missed == 0


def test_no_deadline_runs_before_the_first_message() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT)
    assert looking.look(100.0) == []
    assert looking.watch.due() == float("inf")


def test_the_first_message_tells_that_there_is_something_to_wait_for() -> None:
    watch = Watch(QoS(deadline=0.1))
    assert watch.heard(FRONT, 1.0)
    assert not watch.heard(FRONT, 1.05)
    assert watch.due() == 1.05 + 0.1


def test_every_deadline_without_a_message_is_one_miss() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT)
    looking.watch.heard(FRONT, 0.0)
    assert looking.look(0.11) == [Missed(FRONT, 1, 1)]
    assert looking.look(0.15) == []
    assert looking.look(0.21) == [Missed(FRONT, 1, 2)]
    looking.watch.heard(FRONT, 0.25)
    assert looking.look(0.34) == []
    assert looking.look(0.36) == [Missed(FRONT, 1, 3)]


def test_unread_misses_are_reported_together() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT)
    looking.watch.heard(FRONT, 0.0)
    assert looking.look(0.55) == [Missed(FRONT, 5, 5)]


def test_a_miss_is_counted_even_if_the_message_came_before_the_next_look() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT)
    looking.watch.heard(FRONT, 0.0)
    assert looking.watch.heard(FRONT, 0.25)
    assert looking.watch.due() < 0.25
    assert looking.look(0.26) == [Missed(FRONT, 2, 2)]


def test_each_publisher_has_its_own_deadline() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT, REAR)
    looking.watch.heard(FRONT, 0.0)
    looking.watch.heard(REAR, 0.0)
    looking.watch.heard(FRONT, 0.09)
    assert looking.look(0.11) == [Missed(REAR, 1, 1)]
    assert looking.look(0.21) == [Missed(FRONT, 1, 1), Missed(REAR, 1, 2)]
    assert looking.watch.missed == 3


def test_a_publisher_that_has_gone_misses_one_deadline_and_then_counts_when_it_is_back() -> None:
    looking = Looking(QoS(deadline=0.1))
    looking.watch.heard(FRONT, 0.0)
    assert looking.look(0.55) == [Missed(FRONT, 1, 1)]
    assert looking.look(9.0) == []
    assert looking.watch.due() == float("inf")
    assert looking.watch.heard(FRONT, 10.0)
    assert looking.look(10.05) == []
    assert looking.look(10.11) == [Missed(FRONT, 1, 2)]


def test_publishers_are_listed_only_when_something_is_due() -> None:
    looking = Looking(QoS(deadline=0.1), FRONT)
    looking.watch.heard(FRONT, 0.0)
    for tick in range(9):
        looking.look(tick * 0.01)
    assert looking.asked == 0


def test_a_publisher_that_left_is_lost_once() -> None:
    looking = Looking(AUTOMATIC, FRONT)
    assert looking.look(0.0) == []
    looking.names = ()
    assert looking.look(0.25) == [Lost(FRONT, 1, 1)]
    assert looking.look(9.0) == []


def test_a_publisher_that_came_back_may_be_lost_again() -> None:
    looking = Looking(AUTOMATIC, FRONT)
    looking.look(0.0)
    looking.names = ()
    looking.look(1.0)
    looking.names = (FRONT,)
    assert looking.look(2.0) == []
    looking.names = ()
    assert looking.look(3.0) == [Lost(FRONT, 1, 2)]


def test_an_unknown_publisher_cannot_be_lost() -> None:
    looking = Looking(AUTOMATIC)
    assert [looking.look(float(now)) for now in range(5)] == [[]] * 5


def test_a_publisher_is_looked_for_several_times_in_a_lease() -> None:
    looking = Looking(QoS(lease=0.4), FRONT)
    looking.look(0.0)
    assert 0 < looking.watch.due() <= 0.1
    looking = Looking(QoS(lease=1000.0), FRONT)
    looking.look(0.0)
    assert looking.watch.due() <= 1.0


def test_an_automatic_publisher_may_be_silent() -> None:
    looking = Looking(AUTOMATIC, FRONT)
    looking.watch.heard(FRONT, 0.0)
    assert [looking.look(float(now)) for now in range(5)] == [[]] * 5


def test_a_manual_publisher_is_lost_after_its_lease() -> None:
    looking = Looking(MANUAL, FRONT)
    looking.look(0.0)
    looking.watch.heard(FRONT, 0.1)
    assert looking.look(0.9) == []
    assert looking.watch.due() <= 1.1 + 1e-6
    assert looking.look(1.11) == [Lost(FRONT, 1, 1)]
    assert looking.look(5.0) == []
    looking.watch.heard(FRONT, 6.0)
    assert looking.look(6.5) == []
    assert looking.look(7.1) == [Lost(FRONT, 1, 2)]


def test_a_manual_publisher_is_not_lost_before_its_first_message() -> None:
    looking = Looking(MANUAL, FRONT)
    assert [looking.look(float(now)) for now in range(5)] == [[]] * 5


def test_a_silence_that_ended_before_the_next_look_counts() -> None:
    looking = Looking(MANUAL, FRONT)
    looking.look(0.0)
    looking.watch.heard(FRONT, 0.1)
    assert looking.watch.heard(FRONT, 2.0)
    assert looking.look(2.0) == [Lost(FRONT, 1, 1)]


def test_a_killed_publisher_that_lives_by_what_it_sends_is_lost_once_and_at_once() -> None:
    looking = Looking(MANUAL, FRONT)
    looking.look(0.0)
    looking.watch.heard(FRONT, 0.2)
    looking.names = ()
    assert looking.look(0.3) == [Lost(FRONT, 1, 1)]
    assert [looking.look(0.3 + tick * 0.25) for tick in range(8)] == [[]] * 8


def test_the_shorter_lease_of_both_ends_and_the_publishers_kind_hold() -> None:
    looking = Looking(QoS(lease=10.0), FRONT, offered=QoS(lease=0.5, liveliness=Liveliness.MANUAL_BY_TOPIC))
    looking.look(0.0)
    looking.watch.heard(FRONT, 0.1)
    assert looking.look(0.7) == [Lost(FRONT, 1, 1)]


def test_strangers_that_are_heard_and_never_seen_are_not_lost() -> None:
    looking = Looking(AUTOMATIC)
    looking.watch.heard(FRONT, 0.0)
    assert looking.look(5.0) == []


def test_the_number_of_watched_channels_is_bounded() -> None:
    watch = Watch(QoS(deadline=1.0))
    for number in range(CHANNELS + 100):
        watch.heard(f"i{number}/LaserPub/push", 0.0)
    assert len(watch.look(1.5, dict)) == CHANNELS


@given(
    st.lists(st.floats(0.001, 2.0), min_size=1, max_size=30),
    st.lists(st.booleans(), min_size=30, max_size=30),
)
def test_every_miss_is_reported_once_however_often_the_watch_looks(gaps: list[float], looks: list[bool]) -> None:
    deadline = 0.25
    looking, now, told = Looking(QoS(deadline=deadline), FRONT), 0.0, 0
    looking.watch.heard(FRONT, now)
    for gap, also in zip(gaps, looks, strict=False):
        if also:
            told += sum(each.more for each in looking.look(now + gap / 2) if isinstance(each, Missed))
        now += gap
        looking.watch.heard(FRONT, now)
    told += sum(each.more for each in looking.look(now) if isinstance(each, Missed))
    assert told == looking.watch.missed
    low = sum(int(gap / deadline - 1e-6) for gap in gaps)
    high = sum(int(gap / deadline + 1e-6) for gap in gaps)
    assert low <= told <= high
