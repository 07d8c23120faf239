"""Components follow the clock of one of them, and none gets ahead of the others."""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import Any

import pytest

from robocomp_py.contract.component import Component, PeriodicTimer, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import PRESETS
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime.clock import SECOND
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import find_transport
from robocomp_py.virtual.simulation import Simulation

from ..runtime.components import MIDDLEWARES, Calculator, Diary, EverythingProxy, EverythingPublisher
from ..runtime.running import make, running
from ..virtual.parts import part


class Sun(Diary):
    """The leader: publishes the number of each `compute`."""

    component = Component(
        "sun",
        (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=PRESETS["services_default"]),),
        period=0.05,
    )
    everything_proxy: EverythingPublisher

    def compute(self) -> None:
        self.everything_proxy.news(len(self.entries), "")
        self.entries.append(f"compute at {self.ms}")

    @property
    def ms(self) -> int:
        """The time of its clock."""
        return self.now() * 1000 // SECOND


class Earth(Calculator):
    """Takes its time to work."""

    def Everything_work(self, task: str) -> str:
        self.sleep(0.12)
        return task

    @property
    def ms(self) -> int:
        return self.now() * 1000 // SECOND

    def Everything_poke(self, number: int) -> None:
        self.entries.append(f"poke {number} at {self.ms}")


class Moon(Sun):
    """Hears the sun, and asks the earth."""

    component = Component(
        "moon",
        (
            Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
            Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=PRESETS["services_default"]),
        ),
        period=0.1,
        timers=(PeriodicTimer("blink", 0.25),),
    )
    everything_proxy: EverythingProxy  # type: ignore[assignment]
    heard = -1

    def compute(self) -> None:
        turn = self.entries.count("compute")
        self.entries.append("compute")
        self.entries.append(f"{turn} at {self.ms} after news {self.heard}")
        self.everything_proxy.poke(turn)
        if turn == 3:
            self.entries.append(f"{self.everything_proxy.work('done')} at {self.ms} after news {self.heard}")
        if turn == 5:
            self.sleep(0.23)
            self.entries.append(f"awake at {self.ms} after news {self.heard}")

    def timer_blink(self) -> None:
        self.entries.append(f"blink at {self.ms}")

    def Everything_news(self, number: int, text: str) -> None:
        self.heard = number


Story = tuple[list[str], list[str], list[str]]


def leading(*followers: str, speed: float = 0.0) -> list[str]:
    names = ", ".join(f'"{each}"' for each in followers)
    return ["clock.leader=sun", f"clock.followers=[{names}]", f"clock.speed={speed}"]


def in_lockstep(middleware: str) -> Story:
    """What the three note in lock-step, until the moon has computed eight times."""
    over, following = f"middleware={middleware}", "clock.leader=sun"
    with (
        running(make(Sun, find_transport, over, *leading("earth", "moon"), name="sun"), ready=False) as sun,
        running(make(Earth, find_transport, over, following, name="earth"), ready=False) as earth,
        running(make(Moon, find_transport, over, following, name="moon"), ready=False) as moon,
    ):
        wait_until(lambda: moon.entries.count("compute") > 8)
    assert (sun.outcome, earth.outcome, moon.outcome) == (True, True, True)
    return noted(sun, earth, moon)


def in_virtual_time() -> Story:
    kinds = {"sun": Sun, "earth": Earth, "moon": Moon}
    with Simulation([part(kind, name) for name, kind in kinds.items()]) as sim:
        sim.run(until=lambda: sim["moon"].computes > 8, at_most=60.0)
        sun, earth, moon = (sim[name].worker for name in kinds)
        return noted(sun, earth, moon)


def noted(sun: Any, earth: Any, moon: Any) -> Story:
    """What happened in the first virtual second, without the life cycle."""
    pokes = [each for each in earth.entries if each.startswith("poke")]
    return sun.entries[1:21], pokes[:8], [each for each in moon.entries if " at " in each][:13]


@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_the_story_is_the_same_over_every_middleware_as_in_virtual_time(middleware: str) -> None:
    sun, earth, moon = in_lockstep(middleware)
    assert sun == [f"compute at {50 * turn}" for turn in range(20)]
    assert moon == [
        "0 at 0 after news 1",
        "blink at 0",
        "1 at 100 after news 3",
        "2 at 200 after news 5",
        "blink at 250",
        "3 at 300 after news 7",
        "done at 420 after news 9",
        "4 at 500 after news 11",
        "blink at 500",
        "5 at 600 after news 13",
        "blink at 750",
        "awake at 830 after news 17",
        "6 at 900 after news 19",
    ]
    assert earth == [f"poke {number} at {at}" for number, at in enumerate((0, 100, 200, 300, 500, 600, 900, 1000))]
    assert (sun, earth, moon) == in_virtual_time()


class Hearing(Sun):
    """Hears the sun, and computes at the same instants."""

    component = Component(
        "hearing", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=PRESETS["services_default"]),), period=0.05
    )

    def compute(self) -> None:
        self.entries.append(f"compute at {self.ms}")

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"news {number} at {self.ms}")


@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_a_handler_sees_the_present_instant_also_if_its_component_is_yet_to_compute(middleware: str) -> None:
    over = f"middleware={middleware}"
    with (
        running(make(Sun, find_transport, over, *leading("moon"), name="sun"), ready=False),
        running(make(Hearing, find_transport, over, "clock.leader=sun", name="moon"), ready=False) as moon,
    ):
        wait_until(lambda: "compute at 200" in moon.entries)
    entries = moon.entries[1 : moon.entries.index("compute at 200") + 1]
    assert entries[-4:] == ["news 4 at 150", "compute at 150", "news 5 at 200", "compute at 200"]


class Poking(Moon):
    """A leader that pokes the earth many times."""

    component = Component("sun", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.05)

    def compute(self) -> None:
        for number in range(20):
            self.everything_proxy.poke(number)


class Stirred(Earth):
    """Computes at the same instants, and each poke wakes its loop."""

    component = Component("earth", Earth.component.ports, period=0.05)

    def compute(self) -> None:
        self.entries.append(f"compute at {self.ms}")

    def Everything_poke(self, number: int) -> None:
        super().Everything_poke(number)
        self.period = self.period


def test_a_component_computes_when_its_turn_comes_and_not_when_a_handler_wakes_its_loop() -> None:
    over = "middleware=shm"
    with (
        running(make(Poking, find_transport, over, *leading("earth"), name="sun"), ready=False),
        running(make(Stirred, find_transport, over, "clock.leader=sun", name="earth"), ready=False) as earth,
    ):
        wait_until(lambda: "compute at 500" in earth.entries)
    for at in range(50, 500, 50):
        entries = [each for each in earth.entries if each.endswith(f" at {at}")]
        assert entries == [*(f"poke {number} at {at}" for number in range(20)), f"compute at {at}"]


class Asking(Moon):
    """A leader that asks the earth, whose answer takes some time."""

    component = Component("sun", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.05)

    def compute(self) -> None:
        self.entries.append(f"{self.everything_proxy.work('done')} at {self.ms}")


def test_the_clock_goes_on_while_the_component_that_leads_waits_for_an_answer() -> None:
    with (
        running(make(Asking, find_transport, *leading("earth"), name="sun"), ready=False) as sun,
        running(make(Earth, find_transport, "clock.leader=sun", "component.period=60", name="earth"), ready=False),
    ):
        wait_until(lambda: len(sun.entries) > 4)
    assert sun.entries[1:4] == ["done at 120", "done at 270", "done at 420"], "a call takes 120 ms: two periods pass"


class Woken(Sun):
    """A leader whose period is changed at each `compute`, by a thread of its own: that calls its loop."""

    def compute(self) -> None:
        super().compute()
        thread = threading.Thread(target=setattr, args=(self, "period", 0.05 + 0.05 * (len(self.entries) % 2)))
        thread.start()


def test_the_component_that_leads_may_be_called_while_it_leads() -> None:
    with (
        running(make(Woken, find_transport, *leading("moon"), name="sun"), ready=False) as sun,
        running(make(Earth, find_transport, "clock.leader=sun", name="earth"), ready=False),
        running(make(Moon, find_transport, "clock.leader=sun", name="moon"), ready=False) as moon,
    ):
        wait_until(lambda: len(sun.entries) > 50 and moon.entries.count("compute") > 10)


def test_a_late_component_begins_at_the_present_instant() -> None:
    following = "clock.leader=sun"
    with (
        running(make(Sun, find_transport, *leading("earth"), name="sun"), ready=False) as sun,
        running(make(Earth, find_transport, following, name="earth"), ready=False),
    ):
        wait_until(lambda: len(sun.entries) > 10)
        before = len(sun.entries)
        with running(make(Moon, find_transport, following, name="moon")) as moon:
            wait_until(lambda: moon.entries.count("compute") > 3)
    times = [int(each.split()[2]) for each in moon.entries if "after news" in each and "done" not in each]
    assert times[0] >= 50 * (before - 2)
    assert times[:3] == [times[0], times[0] + 100, times[0] + 200]


def test_a_follower_that_ends_leaves_the_others_at_work(caplog: pytest.LogCaptureFixture) -> None:
    following = "clock.leader=sun"
    with running(make(Sun, find_transport, *leading("earth"), name="sun"), ready=False) as sun:
        with running(make(Earth, find_transport, following, name="earth")):
            pass
        reached = len(sun.entries)
        wait_until(lambda: len(sun.entries) > reached + 10)
    assert "follows this clock" not in caplog.text


def test_a_sleep_at_the_end_follows_the_machine() -> None:
    class Sleepy(Earth):
        def finish(self) -> None:
            self.sleep(0.001)
            super().finish()

    with running(make(Sun, find_transport, *leading("earth", "nobody"), name="sun"), ready=False):
        made = make(Sleepy, find_transport, "clock.leader=sun", name="earth")
        with running(made, ready=False) as earth:
            wait_until(lambda: earth.entries == ["initialize"])
    assert earth.entries == ["initialize", "finish"], "its clock was never moved"


def test_components_without_a_clock_to_follow_import_nothing_of_it() -> None:
    code = "import sys, robocomp_py.runtime.run; assert not [each for each in sys.modules if 'lockstep' in each]"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=SOON * 6)


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (["clock.speed=1"], "`clock` lacks its `leader`"),
        (["clock.leader=a b"], "'a b' names no instance"),
        (["clock.leader=sun", "clock.followers=moon"], "`followers` must be a list of instances"),
        (["clock.leader=sun", "clock.speed=-1"], "`speed` is -1"),
        (["clock.leader=sun", "clock.lost=forget"], "unknown value"),
        (["clock.leder=sun"], "unknown key"),
    ],
)
def test_a_wrong_clock_is_told_before_anything_starts(sets: list[str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        make(Sun, find_transport, *sets)
