"""A process says that its components get on, and does not if one of them is at the same thing for too long."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Pattern, Verb
from robocomp_py.contract.qos import DEFAULT_QOS
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.notify import watchdog_s
from robocomp_py.runtime.route import Route
from robocomp_py.runtime.tally import Tallies, Tally
from robocomp_py.runtime.watchdog import Watchdog
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until


class Component:
    """With a monitor that a thread may be inside."""

    def __init__(self) -> None:
        self.monitor = Monitor()
        self.monitor.open()
        self.is_up = True
        self.life = ""
        self.busy = "laser is busy with compute at laser.py:7"
        self._looks = threading.Semaphore(0)

    @property
    def is_over(self) -> bool:
        """Asked at each look."""
        self._looks.release()
        return False

    def looked_at(self, number: int) -> None:
        """Return when it has been looked at so many times more."""
        while self._looks.acquire(blocking=False):
            pass
        for _ in range(number):
            assert self._looks.acquire(timeout=SOON)


@pytest.fixture
def component() -> Iterator[Component]:
    made = Component()
    yield made
    made.monitor.close()


@pytest.fixture(autouse=True)
def launched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", "@nobody")
    monkeypatch.setenv("WATCHDOG_USEC", "15000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)


@contextmanager
def watched(*every: Component, wishes: tuple[float | None, ...] = (None,)) -> Iterator[list[str]]:
    told: list[str] = []
    with Watchdog(every, wishes, told.append):
        yield told


def test_a_component_that_makes_progress_feeds_the_watchdog(component: Component) -> None:
    with watched(component) as told:
        wait_until(lambda: len(told) > 3)
    assert set(told) == {"WATCHDOG=1"}


def test_a_component_that_is_stuck_is_silent_and_one_that_waits_for_an_answer_is_not(component: Component) -> None:
    with component.monitor.held(), watched(component) as told:
        component.looked_at(2)  # at the first look it may just have begun
        told.clear()
        component.looked_at(5)
        assert told == []
        with component.monitor.suspended():
            wait_until(lambda: "WATCHDOG=1" in told)


def test_the_log_says_once_what_it_is_busy_with(component: Component, caplog: pytest.LogCaptureFixture) -> None:
    with component.monitor.held(), watched(component):
        wait_until(lambda: caplog.records)
        component.looked_at(5)
    [told] = [each.getMessage() for each in caplog.records]
    busy = r"laser is busy with compute at laser.py:7 for more than ([\d.]+) s; the watchdog ends it after 0.015 s"
    found = re.fullmatch(busy, told)
    assert found
    assert float(found[1]) > 0.01


def test_nothing_is_logged_of_a_component_that_makes_progress(
    component: Component, caplog: pytest.LogCaptureFixture
) -> None:
    with watched(component):
        component.looked_at(10)
    assert not caplog.records


def test_nothing_is_said_before_it_is_ready(component: Component) -> None:
    component.is_up = False
    with watched(component) as told:
        component.looked_at(3)
        assert told == []
        component.is_up = True
        wait_until(lambda: told)


def test_one_of_several_that_is_stuck_silences_all(component: Component) -> None:
    other = Component()
    with other.monitor.held(), watched(component, other) as told:
        component.looked_at(2)
        told.clear()
        component.looked_at(3)
        assert told == []
    other.monitor.close()


def test_its_configuration_overrides_its_launcher(component: Component) -> None:
    with watched(component, wishes=(0.006, 0.012)) as told:
        wait_until(lambda: len(told) > 1)
    assert told[:2] == ["WATCHDOG_USEC=12000\nWATCHDOG=1", "WATCHDOG=1"]


def test_a_component_without_a_limit_says_so_once(component: Component) -> None:
    with watched(component, wishes=(0.0, 0.006)) as told, component.monitor.held():
        wait_until(lambda: told)
    assert told == ["WATCHDOG_USEC=0"]


def test_its_load_is_reported_until_it_is_idle(component: Component) -> None:
    served(component.monitor.tallies, (0.05, 0.2))
    with watched(component) as told:
        wait_until(lambda: len([line for line in told if "CALLS" in line]) == 2 and "CALLS" not in told[-1])
    first, second = (line.split("=")[-1].split() for line in told if "CALLS" in line)
    assert (float(first[0]) > 0, float(first[1])) == (True, 250.0)
    assert second == ["0", "0"]


def test_its_status_is_reported_when_it_changes(component: Component) -> None:
    component.life = "laser compute 0 0 0 1.0"
    with watched(component) as told:
        wait_until(lambda: len(told) > 3)
        component.life = "laser emergency 4 0 0 1.0"
        wait_until(lambda: "emergency" in " ".join(told[1:]) and told[-1] == "WATCHDOG=1")
    assert [line for each in told for line in each.split("\n") if "LIFE" in line] == [
        "X_ROBOCOMP_LIFE=laser compute 0 0 0 1.0",
        "X_ROBOCOMP_LIFE=laser emergency 4 0 0 1.0",
    ]


def test_only_a_launcher_that_asked_is_notified(component: Component, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WATCHDOG_USEC")
    before = set(threading.enumerate())
    with watched(component) as told:
        assert set(threading.enumerate()) <= before  # others may end
    assert told == []


@pytest.mark.parametrize(("microseconds", "whom", "seconds"), [
    ("2500000", None, 2.5),
    ("2500000", "this process", 2.5),
    ("2500000", "another one", 0.0),
    ("soon", None, 0.0),
    ("inf", None, 0.0),
    ("-1", None, 0.0),
])  # fmt: skip
def test_the_launchers_wish_is_read_as_systemd_writes_it(
    microseconds: str, whom: str | None, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", microseconds)
    if whom:
        monkeypatch.setenv("WATCHDOG_PID", str(os.getpid() if whom == "this process" else os.getppid()))
    assert watchdog_s() == seconds


def served(tallies: Tallies, *times: tuple[float, float]) -> Tally:
    """A query that was answered with these times in seconds: waited, ran."""
    operation = next(each for each in e.EVERYTHING.operations if each.name == "divide")
    transport: Any = None
    route = Route(transport, "inproc", "a/Everything/divide", DEFAULT_QOS, 1.0)
    tally = Tally(Port(Verb.IMPLEMENTS, e.EVERYTHING), operation, Pattern.QUERY, route)
    for waited, ran in times:
        tally.count += 1
        tally.time(0.0, ran, waited)
    link: Any = object()
    tallies.add(tally, link)
    return tally


def test_the_load_is_what_was_since_it_was_read_last() -> None:
    tallies = Tallies()
    tally = served(tallies, (0.0, 0.1), (0.125, 0.25), (0.0, 0.2))
    assert tallies.take() == (3, 0.375)
    assert tallies.take() == (0, 0.0)
    tally.count += 1
    tally.time(0.0, 0.05, 0.0)
    assert tallies.take() == (1, pytest.approx(0.05))
