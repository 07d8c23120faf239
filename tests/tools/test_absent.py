"""When hosts are looked for that were out of reach from the beginning."""

from __future__ import annotations

from collections.abc import Collection

from robocomp_py.tools.absent import Absent


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def looks(absent: Absent, clock: Clock, until: float, lost: Collection[str] | None) -> list[float]:
    """When it is looked until then, to the second; in vain."""
    found = []
    while clock.now < until:
        if absent.is_due():
            found.append(clock.now)
            absent.looked(lost)
        clock.now += 1.0
    return found


def test_without_absent_hosts_nothing_is_looked_for() -> None:
    clock = Clock()
    absent = Absent((), clock)
    assert not absent
    assert looks(absent, clock, 100.0, ()) == []


def test_pauses_become_longer_up_to_a_minute() -> None:
    clock = Clock()
    assert looks(Absent(["base"], clock), clock, 250.0, ["base"]) == [2.0, 6.0, 14.0, 30.0, 62.0, 122.0, 182.0, 242.0]


def test_only_one_looks_at_a_time() -> None:
    clock = Clock()
    absent = Absent(["base"], clock)
    clock.now = 5.0
    assert [absent.is_due(), absent.is_due()] == [True, False]


def test_a_host_that_is_heard_is_looked_for_no_longer() -> None:
    absent = Absent(["base", "robot"], Clock())
    absent.found("base")
    assert ("base" in absent, "robot" in absent) == (False, True)
    absent.found("robot")
    assert not absent


def test_a_host_that_can_be_asked_again_has_a_minute_to_publish() -> None:
    clock = Clock()
    absent = Absent(["base"], clock)
    looks(absent, clock, 200.0, ["base"])
    back = looks(absent, clock, 600.0, ())
    assert back[0] + 60.0 <= back[-1] <= back[0] + 120.0
    assert not absent


def test_a_host_is_looked_for_on_and_on_if_the_looks_fail() -> None:
    clock = Clock()
    absent = Absent(["base"], clock)
    looks(absent, clock, 600.0, None)
    assert "base" in absent
