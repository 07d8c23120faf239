"""The rescue network again, with a recording in place of its world."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.tools.diary.events import DiaryReader
from robocomp_py.tools.replay.leading import followed

from ..leftovers import killed_on_failure
from .conftest import COMPONENTS

LONG = 12 * SOON

OTHERS = ("wander", "camera", "speech", "rescue")

NEAR = {"start": "[9.9, 5.0, 3.14]"}
"""Where the robot begins, so that the mission is short: it finds the victim on its way to the charger."""

MISSION = {"low": 59.8, "charger_x": 8.8, "charger_z": 1.5}


@contextlib.contextmanager
def command(log: Path, *arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    """A command of ours, which is ended with the block if it has not ended itself; its output is in a file."""
    words = [sys.executable, "-m", *map(str, arguments)]
    out: IO[bytes]
    with log.open("wb") as out, killed_on_failure(words, stdout=out, stderr=out, cwd=log.parent) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.terminate()
            process.wait(LONG)


def settings(of: Mapping[str, Any], prefix: str = "") -> list[str]:
    return [word for name, value in of.items() for word in ("--set", f"{prefix}params.{name}={value}")]


def recorded(folder: Path, house: str) -> list[str]:
    """Record the world of a mission, as time passes; returns what was logged."""
    sets = [*settings({"map": house, "picture": '""', "battery": 60}, "world."), *settings({"map": house}, "camera.")]
    sets += settings(MISSION, "rescue.")
    recording = ("record", "world", "DifferentialRobot", "Laser", "--calls", "--timeout", str(LONG))
    network = ("up", COMPONENTS / "rescue.ddsl", "--clock", "world", "--until", "rescue", "--log-dir", folder / "logs")
    with command(folder / "record.log", "robocomp_py.cli.rc", *recording, "-o", folder / "run") as recorder:
        with command(folder / "up.log", "robocomp_py.cli.rcdeploy", *network, *sets) as running:
            assert running.wait(LONG) == 0, (folder / "up.log").read_text()
        recorder.send_signal(signal.SIGINT)
        assert recorder.wait(SOON) == 130, (folder / "record.log").read_text()
    return re.findall(
        r"rescue │ (.* of the battery|battery .*|found .*|help .*)$", (folder / "up.log").read_text(), re.M
    )


def replayed(folder: Path, house: str, run: Path) -> tuple[list[str], dict[str, list[Any]]]:
    """What the other components log and do when the recording leads their clock."""
    folder.mkdir()
    sets = {"camera": settings({"map": house}), "rescue": settings(MISSION)}
    with contextlib.ExitStack() as ends:
        processes = {}
        for name in OTHERS:
            diary = ("--set", f'component.diary="{folder / name}.mcap"', "--set", "clock.leader=world")
            started = command(
                folder / f"{name}.log", "robocomp_py.cli.rc", "run", COMPONENTS / name, *diary, *sets.get(name, ())
            )
            processes[name] = ends.enter_context(started)
        wait_until(lambda: [len(each.followers) for each in followed(take_census(own=True))] == [4], LONG)
        leads = ["replay", str(run), "--clock", "--rate", "max", "--answer", "--timeout", str(LONG)]
        assert rc.main(leads) == 0
        assert processes["rescue"].wait(LONG) == 0
    log = (folder / "rescue.log").read_text()
    said = re.findall(r"rescue INFO: (.* of the battery|battery .*|found .*|help .*)$", log, re.M)
    return said, {name: done(folder / f"{name}.mcap") for name in OTHERS}


def done(diary: Path) -> list[Any]:
    """All that a component did, in order, with what was sent."""
    found = []
    with DiaryReader(diary) as reader:
        while (event := reader.take()) is not None:
            if event["kind"] in ("turn", "out", "end"):
                found.append((event["kind"], event.get("call"), event.get("data"), event.get("error")))
    return found


@pytest.mark.tool  # needs nothing but time
def test_the_mission_has_the_same_story_without_its_world(
    own_runtime_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (COMPONENTS / "house.toml").read_text()
    for name, value in NEAR.items():
        text = re.sub(rf"^{name} = \[.*?\]", f"{name} = {value}", text, flags=re.M)
    (tmp_path / "house.toml").write_text(text)
    house = f'"{tmp_path / "house.toml"}"'
    story = recorded(tmp_path, house)
    assert [each.split()[0] for each in story] == ["exploring,", "battery", "found", "help"], story
    first, outputs = replayed(tmp_path / "first", house, tmp_path / "run")
    assert without_numbers(first) == without_numbers(story)
    assert {name: len(each) > 50 for name, each in outputs.items()} == dict.fromkeys(OTHERS, True)
    assert replayed(tmp_path / "second", house, tmp_path / "run") == (first, outputs)


def without_numbers(lines: list[str]) -> list[str]:
    """As the clock of the machine, by which the world was recorded, moves them a little."""
    return [re.sub(r"\d[\d.]*", "…", each) for each in lines]
