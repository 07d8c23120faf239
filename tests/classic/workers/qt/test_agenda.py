"""What is due when: alarms that keep their beat, and calls that were posted."""

from __future__ import annotations

import pytest

from robocomp_py.classic.workers.qt.agenda import MAX_POSTED, Agenda, Alarm
from robocomp_py.errors import ComponentError
from robocomp_py.runtime.clock import NEVER, SECOND, Virtual, ns


class Day:
    """An agenda, a clock that is set by hand, and what was done. Times are in seconds."""

    def __init__(self, least: float = 0.0) -> None:
        self.clock = Virtual(100 * SECOND)
        self.done: list[str] = []
        self.woken = 0
        self.agenda = Agenda(self._wake, self.clock, ns(least))

    def _wake(self) -> None:
        self.woken += 1

    def alarm(self, name: str, *, single: bool = False) -> Alarm:
        return Alarm(lambda: self.done.append(name), single)

    def at(self, now: float) -> list[str]:
        """What is done until nothing is due any more."""
        self.clock.advance(ns(now))
        self.done.clear()
        while self.do(now):
            pass
        return list(self.done)

    def start(self, alarm: Alarm, seconds: float) -> None:
        self.agenda.start(alarm, ns(seconds))

    def do(self, now: float) -> bool:
        return self.agenda.do(ns(now))

    def due(self, now: float) -> float:
        return self.agenda.due(ns(now)) / SECOND


@pytest.fixture
def day() -> Day:
    return Day()


def test_nothing_is_due_of_nothing(day: Day) -> None:
    assert day.agenda.due(0) == NEVER
    assert not day.do(100.0)


def test_an_alarm_rings_again_and_again(day: Day) -> None:
    day.start(day.alarm("tick"), 2.0)
    assert day.due(100.5) == 102.0
    assert [day.at(now) for now in (101.9, 102.0, 103.0, 104.5)] == [[], ["tick"], [], ["tick"]]
    assert day.due(104.5) == 106.0
    assert day.due(107.0) == 107.0


def test_a_single_one_rings_once(day: Day) -> None:
    alarm = day.alarm("once", single=True)
    day.start(alarm, 2.0)
    assert [day.at(now) for now in (102.0, 110.0)] == [["once"], []]
    assert alarm.at is None


def test_an_alarm_that_is_stopped_or_started_again_forgets_its_time(day: Day) -> None:
    one, other = day.alarm("one"), day.alarm("other")
    day.start(one, 1.0)
    day.start(other, 1.0)
    day.start(other, 5.0)
    day.agenda.stop(one)
    assert [day.at(now) for now in (104.9, 105.0)] == [[], ["other"]]


def test_what_was_missed_is_counted_and_not_made_up_for(day: Day) -> None:
    day.start(day.alarm("tick"), 1.0)
    assert day.at(104.5) == ["tick"]
    assert day.agenda.missed == 3
    assert day.due(104.5) == 105.0


def test_what_is_late_at_the_begin_rings_then_in_its_order_and_is_not_missed(day: Day) -> None:
    day.start(day.alarm("second"), 2.0)
    day.start(day.alarm("first"), 1.0)
    day.start(day.alarm("later", single=True), 60.0)
    day.agenda.skip_to(ns(150.0))
    assert day.at(150.0) == ["first", "second"]
    assert (day.due(150.0), day.agenda.missed) == (151.0, 0)
    assert day.at(160.0)[-1] == "later"


def test_an_interval_may_have_a_least_value() -> None:
    day = Day(least=0.001)
    day.start(day.alarm("always"), 0.0)
    assert [day.at(now) for now in (100.0, 100.001, 100.0015, 100.002)] == [[], ["always"], [], ["always"]]


def test_the_older_of_two_things_comes_first(day: Day) -> None:
    day.start(day.alarm("late"), 3.0)
    day.start(day.alarm("early"), 1.0)
    day.clock.advance(102 * SECOND)
    day.agenda.post(lambda: day.done.append("posted"))
    assert day.at(103.0) == ["early", "posted", "late"]


def test_an_alarm_that_always_rings_lets_others_in_between(day: Day) -> None:
    day.start(day.alarm("always"), 0.0)
    for name in "ab":
        day.agenda.post(lambda name=name: day.done.append(name))
    for _ in range(5):
        day.do(100.0)
    assert [each for each in day.done if each != "always"] == ["a", "b"]


def test_an_alarm_does_not_ring_inside_of_itself(day: Day) -> None:
    def ring() -> None:
        day.done.append("in")
        day.do(110.0)
        day.done.append("out")

    day.start(Alarm(ring), 1.0)
    assert day.do(102.0)
    assert day.done == ["in", "out"]


def test_an_alarm_that_fails_rings_again(day: Day) -> None:
    def ring() -> None:
        raise ValueError("bad")

    day.start(Alarm(ring), 1.0)
    for now in (101.0, 102.0):
        with pytest.raises(ValueError, match="bad"):
            day.do(now)


def test_a_waiting_thread_is_woken(day: Day) -> None:
    day.start(day.alarm("tick"), 1.0)
    day.agenda.post(lambda: None)
    assert day.woken == 2


def test_what_waits_is_bounded(day: Day) -> None:
    for _ in range(MAX_POSTED):
        day.agenda.post(lambda: None)
    with pytest.raises(ComponentError, match="emits signals faster than they are handled"):
        day.agenda.post(lambda: None)


def test_a_closed_one_does_nothing_any_more(day: Day) -> None:
    tick = day.alarm("tick")
    day.start(tick, 1.0)
    day.agenda.post(lambda: None)
    day.agenda.close()
    day.agenda.post(lambda: None)
    day.start(day.alarm("late"), 1.0)
    assert day.agenda.due(0) == NEVER
    assert tick.at is None
