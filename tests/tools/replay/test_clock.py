"""A replay leads the clock of a network, in place of the component that was recorded."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.runtime.clock import SECOND
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.tools.network import End, Network
from robocomp_py.tools.replay.leading import Followed, followed, leaders
from robocomp_py.transports.base import find_transport
from robocomp_py.transports.census import Told

from ...runtime.components import RELIABLE, Diary
from ...runtime.running import make, running
from .recorded import complained, recorded, said


class Clocked(Diary):
    """Notes when it computes, and when it hears something."""

    component = Component("clocked", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),), period=0.02)

    def compute(self) -> None:
        self.entries.append(f"compute {self.now()}")

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"{number} {self.now()}")

    @property
    def heard(self) -> dict[int, int]:
        """When each message was heard, in ns."""
        found = (each.split() for each in self.entries if each[:1].isdecimal())
        return {int(number): int(now) for number, now in found}


def following(mode: str, name: str = "clocked", middleware: str = "shm", leader: str = "talker") -> Any:
    sets = (f"middleware={middleware}", f"clock.leader={leader}", f"clock.mode={mode}")
    return running(make(Clocked, find_transport, *sets, name=name), ready=False)


def replayed(run: Path, followers: int, *arguments: str) -> None:
    """Replay to the end, once so many components follow."""
    wait_until(lambda: [len(each.followers) for each in followed(take_census(own=True))] == [followers])
    assert rc.main(["replay", str(run), "--clock", "--timeout", str(SOON), *arguments]) == 0


@contextlib.contextmanager
def replaying(run: Path, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A replay in a process of its own, which ends with the block: it would last, and disturb what comes after it."""
    words = [sys.executable, "-m", "robocomp_py.cli.rc", "replay", str(run), "--clock", "--timeout", str(SOON)]
    with subprocess.Popen([*words, *arguments]) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("middleware", ["shm", "zeromq"])
def test_in_lockstep_components_do_the_same_each_time(
    middleware: str, own_runtime_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = recorded(tmp_path / "run", numbers=50, seconds=0.01)
    stories: list[tuple[list[str], list[str]]] = []
    for _ in range(2):
        with (
            following("lockstep", middleware=middleware) as first,
            following("lockstep", "second", middleware) as second,
        ):
            replayed(run, 2, "--rate", "max")
            stories.append((list(first.entries), list(second.entries)))
    assert stories[0] == stories[1]
    assert stories[0][0].count("49 490000001") == 1
    assert [each for each in stories[0][1] if each.startswith("compute")][-1] == "compute 480000000"
    told = capsys.readouterr().out
    assert "run: 50 messages in " in told
    assert ", by the clock that it led" in told


def test_a_replay_goes_on_from_where_the_clock_stands(own_runtime_folder: Path, tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", numbers=5, seconds=0.1)
    with following("lockstep") as worker:
        replayed(run, 1)
        wait_until(lambda: bool(followed(take_census(own=True))))  # the leader of the first replay is gone
        replayed(run, 1, "--rate", "max")
        times = [int(each.split()[1]) for each in worker.entries if each[:1].isdecimal()]
    assert times[:5] == [number * SECOND // 10 + 1 for number in range(5)]
    assert times[5:] == [each + times[4] for each in times[:5]]


def test_a_clock_that_passes_by_itself_passes_with_the_replay(own_runtime_folder: Path, tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", numbers=5, seconds=0.1)
    with following("free") as worker:
        replayed(run, 1, "--rate", "2")
        wait_until(lambda: len(worker.heard) == 5)
        assert sorted(worker.heard) == list(range(5))
        assert all(now >= number * SECOND // 10 - SECOND // 20 for number, now in worker.heard.items())
        assert sum(each.startswith("compute") for each in worker.entries) > 1


def test_the_clock_of_a_replay_is_driven_as_any_other(
    own_runtime_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = recorded(tmp_path / "run", numbers=10, seconds=1.0)
    with following("lockstep") as worker:
        wait_until(lambda: bool(followed(take_census(own=True))))
        with replaying(run, "--rate", "0.01") as replay:
            wait_until(lambda: leaders(take_census(own=True)) == ["talker"])
            assert rc.main(["clock", "pause", "--timeout", str(SOON)]) == 0
            assert rc.main(["clock", "step", "2", "--timeout", str(SOON)]) == 0
            assert max(worker.heard) in (1, 2)
            assert rc.main(["clock", "speed", "max", "--timeout", str(SOON)]) == 0
            assert rc.main(["clock", "resume", "--timeout", str(SOON)]) == 0
            assert replay.wait(SOON) == 0
            assert max(worker.heard) == 9


def test_the_clock_that_it_leads_is_chosen(
    own_runtime_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = recorded(tmp_path / "run", numbers=3)
    soon = ("--timeout", "0.1")
    assert "no component follows a clock here" in complained(capsys, run, "--clock", *soon)
    with (
        following("lockstep"),
        running(make(Clocked, find_transport, *("clock.leader=sun", "middleware=shm"), name="moon"), ready=False),
    ):
        wait_until(lambda: len(followed(take_census(own=True))) == 2)
        assert "choose one by --of: sun, talker" in complained(capsys, run, "--clock", *soon)
        assert "did you mean `sun`" in complained(capsys, run, "--clock", "--of", "son", *soon)
        assert json.loads(said(capsys, run, "--clock", "--of", "talker", "--json"))["late"] is None
    leads = ("clock.leader=talker", "clock.followers=[]", "middleware=shm", "clock.mode=free")
    with running(make(Clocked, find_transport, *leads, name="talker")), following("free"):
        wait_until(lambda: leaders(take_census(own=True)) == ["talker"])
        assert "talker leads the clock; stop it" in complained(capsys, run, "--clock", *soon)
    with following("free"):
        assert "passes by itself" in complained(capsys, run, "--clock", "--rate", "max", code=2)


@pytest.mark.parametrize(
    ("arguments", "why"), [(("--of", "sun"), "it needs --clock"), (("--rate", "max"), "needs --clock")]
)
def test_what_a_clock_needs_is_told(
    arguments: tuple[str, ...], why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in complained(capsys, recorded(tmp_path / "run"), *arguments, code=2)


def test_a_clock_without_a_leader_is_seen() -> None:
    def end(owner: str, role: str, channel: str) -> End:
        return End("near", Told(owner, 1, role, channel, 0, ""))

    ends = [
        end("moon", "calls", "sun/LockstepLeader/join"),
        end("moon", "calls", "sun/LockstepLeader/leave"),
        end("lab/mars", "calls", "sun/LockstepLeader/join"),
        end("eye", "subscribes", "lab/star/Clock/tick"),
        end("ear", "subscribes", "*/Clock/tick"),
        end("hand", "subscribes", "led/Clock/tick"),
        end("led", "publishes", "led/Clock/tick"),
        end("foot", "calls", "first/LockstepLeader/join"),
        end("first", "serves", "first/ClockControl/state"),
    ]
    network = Network(ends, own=True)
    assert followed(network) == [
        Followed("lab/star", False, {"eye": "near"}),
        Followed("sun", True, {"lab/mars": "near", "moon": "near"}),
    ]
    assert leaders(network) == ["first", "led"]
