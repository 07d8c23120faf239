"""`rc clock` drives the clock of a network in lock-step."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.component import Component
from robocomp_py.runtime.clock import SECOND
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import find_transport

from ..runtime.components import Diary
from ..runtime.running import make, running
from .test_every_command import ended

Said = pytest.CaptureFixture[str]

QUICK = ("--middleware", "shm", "--timeout", "30")


class Beating(Diary):
    """Notes the time of each `compute`, in ms."""

    component = Component("beating", (), period=0.1)

    def compute(self) -> None:
        self.entries.append(str(self.now() * 1000 // SECOND))


@pytest.fixture
def network(own_runtime_folder: Path) -> Iterator[tuple[Any, Any]]:
    """A leader and a follower, at full speed."""
    over = "middleware=shm"
    leads = ("clock.leader=sun", 'clock.followers=["moon"]', "clock.speed=0")
    with (
        running(make(Beating, find_transport, over, *leads, name="sun"), ready=False) as sun,
        running(make(Beating, find_transport, over, "clock.leader=sun", name="moon"), ready=False) as moon,
    ):
        wait_until(lambda: len(moon.entries) > 3)
        yield sun, moon


def told(said: Said, *arguments: str) -> dict[str, Any]:
    assert rc.main(["clock", *arguments, "--json", *QUICK]) == 0
    found: dict[str, Any] = json.loads(said.readouterr().out)
    return found


def test_a_network_is_paused_goes_on_step_by_step_and_resumes(network: tuple[Any, Any], capsys: Said) -> None:
    sun, moon = network
    assert told(capsys, "show") | {"now": 0} == {
        "leader": "sun",
        "now": 0,
        "speed": "max",
        "paused": False,
        "followers": ["moon"],
    }
    before = told(capsys, "pause")
    assert before["paused"]
    computes = len(moon.entries)
    assert len(sun.entries) == computes

    after = told(capsys, "step", "0.5")
    assert after["paused"]
    assert after["now"] == pytest.approx(before["now"] + 0.5)
    assert len(moon.entries) == len(sun.entries) == computes + 5

    assert told(capsys, "speed", "4")["speed"] == 4.0
    assert len(moon.entries) == computes + 5
    assert not told(capsys, "resume")["paused"]
    wait_until(lambda: len(moon.entries) > computes + 6)
    assert moon.entries[1:11] == [str(100 * turn) for turn in range(10)]

    assert rc.main(["clock", "show", *QUICK]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["leader", "time", "speed", "followers"]
    assert lines[1].split()[0] == "sun"
    assert lines[1].split()[3:] == ["4.0", "runs", "moon"]

    assert rc.main(["clock", "pause", "--of", "moon", "--middleware", "shm", "--timeout", "0.1"]) == 1
    assert "these lead a clock: sun" in capsys.readouterr().err


def test_without_a_clock_it_says_how_to_have_one(own_runtime_folder: Path, capsys: Said) -> None:
    assert rc.main(["clock", "show", "--middleware", "shm", "--timeout", "0.1"]) == 1
    assert "no component leads a clock here; `rcdeploy NET.ddsl --clock world`" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [("step",), ("step", "0"), ("step", "nan"), ("speed", "-1"), ("speed", "1e7"), ("speed", "fast")]
)
def test_a_wrong_number_is_a_wrong_usage(arguments: tuple[str, ...], capsys: Said) -> None:
    assert ended("clock", *arguments) == 2
    assert "rc clock" in capsys.readouterr().err
