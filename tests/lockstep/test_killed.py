"""Processes in lock-step are killed: the clock goes on without them, with them again, or the leader fails."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import pytest

from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import wait_until
from tests.cli.programs import Program, running

IDSL = "module Sky { interface Sky { int ask(int number); }; interface SkyPub { [publish] void news(int number); }; };"
SUN = """
import "../Sky.idsl";
Component sun { Communications { implements Sky; publishes SkyPub; }; language python; period 50 ms; };
"""
MOON = """
import "../Sky.idsl";
Component moon { Communications { requires Sky; subscribesTo SkyPub; }; language python; period 100 ms; };
"""
SUN_CODE = """
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    turn = 0

    def compute(self):
        self.turn += 1
        self.skypub_proxy.news(self.turn)
        if self.turn % 20 == 0:
            self.log.info("life of %d at %d ms", self.turn, self.now() // 1_000_000)

    def Sky_ask(self, number):
        return number + 1
"""
MOON_CODE = """
from robocomp_py.errors import TransportError

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    turn = 0

    def compute(self):
        self.turn += 1
        try:
            self.sky_proxy.ask(self.turn)
        except TransportError:
            return  # the sun was killed meanwhile
        if self.turn == 1 or self.turn % 10 == 0:
            self.log.info("life of %d at %d ms", self.turn, self.now() // 1_000_000)

    def SkyPub_news(self, number):
        pass
"""
NETWORK = """
import "sun/sun.cdsl"; import "moon/moon.cdsl";
Deployment sky
{
    clock sun(speed max%s);
    Component sun { %s };
    Component moon { %s };
    Component io : moon { };
};
"""
RESTART = "restart on_failure(intensity 5, delay 1 ms);"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sky")
    (folder / "Sky.idsl").write_text(IDSL)
    for name, model, code in (("sun", SUN, SUN_CODE), ("moon", MOON, MOON_CODE)):
        (folder / name).mkdir()
        (folder / name / f"{name}.cdsl").write_text(model)
        assert rcgen([str(folder / name / f"{name}.cdsl")]) == 0
        (folder / name / "specificworker.py").write_text(code)
    return folder


def network(folder: Path, settings: str, sun: str, moon: str) -> Path:
    path = folder / "sky.ddsl"
    path.write_text(NETWORK % (settings, sun, moon))
    return path


def kill(path: Path, instance: str, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    rcdeploy(["status", str(path), "--json"])
    (pid,) = (each["pid"] for each in json.loads(capsys.readouterr().out)["processes"] if each["name"] == instance)
    os.kill(pid, signal.SIGKILL)


def times(program: Program, instance: str) -> list[tuple[int, int]]:
    """What an instance has told of each of its computes: the number in its life, and the time of its clock in ms."""
    told = (re.search(rf" {instance} │ life of (\d+) at (\d+) ms$", line) for line in list(program.lines))
    return [(int(each[1]), int(each[2])) for each in told if each]


def latest(program: Program, *instances: str) -> int:
    """The time that all of them have reached."""
    return min(max((at for _, at in times(program, each)), default=-1) for each in instances)


def lives(program: Program, instance: str) -> list[int]:
    """When each life of the moon began."""
    return [at for turn, at in times(program, instance) if turn == 1]


@pytest.mark.parametrize("middleware", ["shm", "zeromq"])
def test_the_clock_goes_on_without_a_killed_follower_and_from_its_instant_with_a_new_leader(
    folder: Path, middleware: str, own_runtime_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = network(folder, "", RESTART, RESTART)
    with running("rcdeploy", path, "--middleware", middleware) as program:
        wait_until(lambda: latest(program, "sun", "moon", "io") > 2000)
        before = latest(program, "sun", "moon", "io")
        kill(path, "moon", capsys)
        program.wait_for("moon, which follows this clock, is gone")
        wait_until(lambda: len(lives(program, "moon")) == 2)
        assert lives(program, "moon")[1] >= before, "it begins at the present instant"

        kill(path, "sun", capsys)
        program.wait_for("sun is ready again")
        begun = max(latest(program, "moon"), latest(program, "io"))
        wait_until(lambda: latest(program, "sun", "moon", "io") > begun + 2000)
        program.terminate()
    assert lives(program, "io") == [0], "it has one life, and its clock never went back"
    for each in ("sun", "moon", "io"):
        told = [at for _, at in times(program, each)]
        assert told == sorted(told)


def test_the_leader_fails_with_a_killed_follower_if_the_network_says_so(
    folder: Path, own_runtime_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = network(folder, ", lost stop", "", "")
    with running("rcdeploy", path, "--middleware", "shm") as program:
        wait_until(lambda: latest(program, "sun", "moon", "io") > 1000)
        kill(path, "io", capsys)
        program.wait_for("io, which follows this clock, is gone", "sun ended with exit code 1")
        program.terminate()
    assert program.returncode == 1
    assert not any("goes on without it" in line for line in program.lines)
