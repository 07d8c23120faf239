"""A clock that passes by itself, and components that follow it without waiting for each other."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import ConfigurationError
from robocomp_py.lockstep.free import Passing
from robocomp_py.lockstep.RoboCompClock import CLOCK_INTERFACE
from robocomp_py.runtime.clock import NEVER, SECOND
from robocomp_py.runtime.ports import Proxy
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import find_transport

from ..runtime.components import Diary
from ..runtime.running import make, running


class Machine:
    """Its time passes only when a test says so."""

    def __init__(self) -> None:
        self.seconds = 100.0

    def __call__(self) -> float:
        return self.seconds


def passing(longest: float = 1.0) -> tuple[Passing, Machine, threading.Event]:
    """A clock, the time of its machine, and what tells it that its component ends."""
    machine, over = Machine(), threading.Event()
    return Passing(over.is_set, longest, machine), machine, over


def test_between_two_ticks_the_time_goes_on_at_the_speed() -> None:
    clock, machine, _ = passing()
    assert clock.now() == 0
    clock.told(5 * SECOND, 2.0)
    machine.seconds += 0.25
    assert clock.now() == 5.5 * SECOND
    clock.told(5.5 * SECOND, 0.0)
    machine.seconds += 0.25
    assert clock.now() == 5.5 * SECOND


def test_it_stands_still_instead_of_going_back() -> None:
    clock, machine, _ = passing()
    clock.told(5 * SECOND, 1.0)
    machine.seconds += 0.5
    assert clock.now() == 5.5 * SECOND
    clock.told(5.25 * SECOND, 1.0)
    assert clock.now() == 5.5 * SECOND
    machine.seconds += 0.5
    assert clock.now() == 5.75 * SECOND


def test_it_stands_still_if_it_is_told_nothing_any_more() -> None:
    clock, machine, _ = passing(longest=1.0)
    clock.told(0, 1.0)
    machine.seconds += 60.0
    assert clock.now() == SECOND
    clock.told(60 * SECOND, 1.0)
    assert clock.now() == 60 * SECOND


def test_it_does_not_pass_the_end_of_a_step() -> None:
    clock, machine, _ = passing()
    clock.told(0, 1.0, until=SECOND // 4)
    machine.seconds += 0.5
    assert clock.now() == SECOND // 4


def test_when_its_component_ends_it_goes_on_as_the_machine() -> None:
    clock, machine, over = passing()
    clock.told(SECOND, 0.0)
    assert clock.now() == SECOND
    over.set()
    assert clock.now() == SECOND
    clock.told(0, 0.0)
    machine.seconds += 60.0
    assert clock.now() == 61 * SECOND


def test_a_wait_ends_by_its_event_or_at_its_time() -> None:
    clock, wake = Passing(lambda: False), threading.Event()
    clock.told(0, 1000.0)
    assert not clock.wait(wake, SECOND)
    wait_until(lambda: clock.wait(wake, SECOND) or clock.now() >= SECOND)
    wake.set()
    assert clock.wait(wake, NEVER)


class Beating(Diary):
    component = Component("beating", (), period=0.05)

    def compute(self) -> None:
        self.entries.append("compute")


def settings(middleware: str, speed: float) -> list[str]:
    leads = ['clock.followers=["moon"]', f"clock.speed={speed}"]
    return [f"middleware={middleware}", "clock.leader=sun", "clock.mode=free", *(leads if speed else [])]


@pytest.mark.parametrize("middleware", ["shm", "zeromq"])
def test_a_follower_beats_by_the_clock_of_its_leader(
    middleware: str, own_runtime_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def drive(*words: str) -> None:
        assert rc.main(["clock", *words, "--middleware", middleware, "--timeout", "30"]) == 0
        capsys.readouterr()

    with (
        running(make(Beating, find_transport, *settings(middleware, 100.0), name="sun")) as sun,
        running(make(Beating, find_transport, *settings(middleware, 0), name="moon")) as moon,
    ):
        wait_until(lambda: moon.now() > 5 * SECOND)
        seen = {moon.now() for _ in range(1000)}
        assert len(seen) > 1, "it goes on between two ticks, of which there are twenty a second"
        drive("pause")
        stands: list[int] = []

        def is_still() -> bool:
            stands.append(moon.now())
            return len(stands) > 20 and stands[-20] == stands[-1] >= sun.now() > 0

        wait_until(is_still)
        before, beats = sun.now(), moon.entries.count("compute")
        drive("step", "200")
        assert sun.now() == before + 200 * SECOND
        wait_until(lambda: moon.now() >= sun.now())
        wait_until(lambda: moon.entries.count("compute") > beats + 10)
        assert rc.main(["clock", "speed", "max", "--middleware", middleware, "--timeout", "30"]) == 1
        assert "rc clock speed: sun: a speed is a positive number" in capsys.readouterr().err
        drive("speed", "50")
        drive("resume")
        wait_until(lambda: moon.now() > before + 205 * SECOND)


class _ClockProxy(Proxy):
    interface = CLOCK_INTERFACE

    def tick(self, now: int, speed: float) -> None:
        (operation,) = CLOCK_INTERFACE.operations
        self._send(operation, (now, speed), None)


class Player(Diary):
    """Tells the time of a recording."""

    component = Component("player", (Port(Verb.PUBLISHES, CLOCK_INTERFACE, proxy=_ClockProxy),), period=0.01)
    clock_proxy: _ClockProxy

    def compute(self) -> None:
        self.clock_proxy.tick(7000 * SECOND, 0.0)


def test_a_component_may_tell_the_time_by_itself(own_runtime_folder: Path) -> None:
    with (
        running(make(Player, find_transport, *settings("shm", 1.0), name="sun")) as sun,
        running(make(Beating, find_transport, *settings("shm", 0), name="moon")) as moon,
    ):
        wait_until(lambda: moon.now() == 7000 * SECOND)
        assert sun.now() > 10**9 * SECOND, "it keeps the clock of its machine"


def test_a_follower_without_a_leader_can_be_stopped(own_runtime_folder: Path) -> None:
    made: Any = make(Beating, find_transport, *settings("shm", 0), name="moon")
    with running(made, ready=False) as moon:
        wait_until(lambda: moon.entries == ["initialize"])
    assert moon.entries == ["initialize", "finish"]


def test_a_clock_that_passes_by_itself_has_a_speed() -> None:
    with pytest.raises(
        ConfigurationError, match="`speed` is 0, as fast as possible, which a clock can only be in lock"
    ):
        make(Beating, find_transport, "clock.leader=sun", "clock.mode=free", "clock.speed=0")
