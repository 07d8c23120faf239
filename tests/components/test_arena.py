"""The rescue story in a simulated scene: wander and rescue are those of the other networks, unchanged."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from robocomp_py.cli import rc, rcgen
from robocomp_py.testing.simulation import Simulation

from ..seeds import SEEDS
from . import story
from .conftest import COMPONENTS

NETWORK = COMPONENTS / "arena.ddsl"
SHORT = (("arena", "params.battery=30.5"), ("arena", "params.capacity=4"), ("rescue", "params.enough=40"))
"""The same story in half of the time."""

EYE = """\
import "LaserPub.idsl";
import "FullPoseEstimationPub.idsl";
import "CameraSimplePub.idsl";

Component eye
{
    Communications
    {
        subscribesTo LaserPub, FullPoseEstimationPub;
        publishes CameraSimplePub;
    };
    language python;
    period 100 ms;
};
"""

EYE_WORKER = '''\
"""A camera without OpenGL: one column of pixels for the person, if the laser sees it."""

import math

import numpy as np

from .generic import RoboCompCameraSimple
from .generic.genericworker import GenericWorker

PERSON = 8.8, 0.8
HIGH_M, FOCAL, FIELD = 1.0, 114, 0.6


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.scan, self.pose = [], None

    def LaserPub_pushLaserData(self, laserData) -> None:
        self.scan = laserData

    def FullPoseEstimationPub_newFullPose(self, pose) -> None:
        self.pose = pose

    def compute(self) -> None:
        image = np.zeros((120, 160, 3), np.uint8)
        if self.pose and len(self.scan):
            dx, dz = PERSON[0] - self.pose.x, PERSON[1] - self.pose.z
            away, bearing = math.hypot(dx, dz), math.remainder(math.atan2(dx, dz) - self.pose.ry, math.tau)
            measured = min(self.scan, key=lambda each: abs(each.angle - bearing)).dist / 1000
            if abs(bearing) < FIELD and abs(measured - away) < 0.6:
                image[: round(FOCAL * HIGH_M / away), 80] = 220, 30, 40
        self.camerasimplepub_proxy.pushImage(RoboCompCameraSimple.TImage(False, 160, 120, 3, image.ravel()))
'''


LIDAR = """\
import "Laser.idsl";
import "LaserPub.idsl";

Component lidar
{
    Communications { implements Laser; publishes LaserPub; };
    language python;
    period 50 ms;
};
"""

LIDAR_WORKER = '''\
"""A driver of a laser that sees walls at 1 m on both sides."""

import math

from .generic import RoboCompGenericBase, RoboCompLaser
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def scan(self):
        angles = [math.radians(each) for each in range(-135, 136, 3)]
        distances = [min(5000.0, 1000.0 / max(abs(math.sin(each)), 0.01)) for each in angles]
        return list(map(RoboCompLaser.TData, angles, distances))

    def compute(self) -> None:
        self.laserpub_proxy.pushLaserData(self.scan())

    def Laser_getLaserData(self):
        return self.scan()

    def Laser_getLaserAndBStateData(self):
        return self.scan(), RoboCompGenericBase.TBaseState()
'''

WHEELS = """\
import "DifferentialRobot.idsl";

Component wheels
{
    Communications { implements DifferentialRobot; };
    language python;
};
"""

WHEELS_WORKER = '''\
"""A driver of a base."""

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def DifferentialRobot_setSpeedBase(self, adv: float, rot: float) -> None:
        pass
'''

MIDDLEWARES = ("zeromq", "dds", "zenoh", "shm")


def component(folder: Path, name: str, cdsl: str, worker: str) -> None:
    """Write a component. Methods that its code does not have raise NotImplementedError."""
    (folder / name).mkdir()
    (folder / name / f"{name}.cdsl").write_text(cdsl)
    (folder / name / "specificworker.py").write_text(worker)
    assert rcgen.main(["--stubs", str(folder / name / f"{name}.cdsl")]) == 0


@pytest.fixture(scope="module")
def without_opengl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The network with a stub in the place of its camera, which has the name of the camera."""
    folder = tmp_path_factory.mktemp("arena")
    component(folder, "eye", EYE, EYE_WORKER)
    text = NETWORK.read_text()
    camera = "        offers camera : CameraSimple, CameraSimplePub;\n"
    assert camera in text
    stub = "    Component camera : eye { };\n    Component wander"
    return network(folder, text.replace(camera, "").replace("    Component wander", stub), "eye")


def network(folder: Path, text: str, *added: str) -> Path:
    """Write a network of shipped components and added ones."""
    for name in ("arena", "wander", "speech", "rescue"):
        text = text.replace(f'"{name}/{name}.cdsl"', f'"{COMPONENTS}/{name}/{name}.cdsl"')
    made = folder / "network.ddsl"
    made.write_text("".join(f'import "{name}/{name}.cdsl";\n' for name in added) + text)
    return made


def run(network: Path, seed: int, settings: Sequence[tuple[str, str]] = ()) -> str:
    """Run the mission to its end; returns the hash of all that was said."""
    with Simulation(network, seed, settings=[("arena", f"params.seed={seed}"), *settings]) as sim:
        assert sim.run(until=sim["rescue"].is_over, at_most=150.0), f"seed {seed}: {sim.failed}"
    return sim.hash


def in_another_process(network: Path, seed: int, *settings: str) -> str:
    """The same."""
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "simulate", str(network), "--until", "rescue"]
    given = [word for each in (f"arena.params.seed={seed}", *settings) for word in ("--set", each)]
    done = subprocess.run([*command, "--seed", str(seed), *given], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.split("hash ")[1].split()[0]


def test_the_network_and_its_scene_are_without_diagnostics(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["lint", str(NETWORK), str(COMPONENTS / "arena" / "arena.xml")]) == 0
    assert not any(capsys.readouterr())
    assert rcgen.main(["--check", str(NETWORK)]) == 0, capsys.readouterr().out


def test_the_mission_succeeds_and_is_the_same_in_another_process(
    without_opengl: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    first = run(without_opengl, 1, SHORT)
    story.check(caplog.text)
    assert in_another_process(without_opengl, 1, *(".".join(each) for each in SHORT)) == first
    assert run(without_opengl, 2, SHORT) != first


def said_by_wander(network: Path) -> set[tuple[str, str]]:
    """Where its messages go, and those that it hears come from."""
    lines: list[str] = []
    explores = ("wander", "params.explores=true")
    with Simulation(network, settings=[explores], write=lines.append) as sim:
        sim.run(0.5)
    messages = [each for each in map(json.loads, lines) if each.get("from") == "wander" or "LaserPub" in each["to"]]
    return {(each["to"], each["kind"]) for each in messages}


def test_drivers_that_are_named_alike_take_the_place_of_simulated_devices(tmp_path: Path, without_opengl: Path) -> None:
    component(tmp_path, "lidar", LIDAR, LIDAR_WORKER)
    component(tmp_path, "wheels", WHEELS, WHEELS_WORKER)
    devices = "    Component laser : lidar { };\n    Component base : wheels { };\n"
    text = f'import "wander/wander.cdsl";\n\nDeployment robot\n{{\n{devices}    Component wander {{ }};\n}};\n'
    by_drivers = said_by_wander(network(tmp_path, text, "lidar", "wheels"))
    assert ("base/DifferentialRobot/setSpeedBase", "query") in by_drivers
    assert ("laser/LaserPub/pushLaserData", "publish") in by_drivers
    assert by_drivers == said_by_wander(without_opengl)


@pytest.mark.tool  # OpenGL
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_mission_succeeds_with_every_noise_and_is_the_same_in_another_process(
    seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    first = run(NETWORK, seed)
    story.check(caplog.text)
    assert in_another_process(NETWORK, seed) == first


@pytest.mark.tool  # OpenGL
@pytest.mark.timeout(900)
@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_the_mission_succeeds_over_a_middleware(middleware: str, tmp_path: Path) -> None:
    command = ("-m", "robocomp_py.cli.rcdeploy", NETWORK, "--until", "rescue", "--middleware", middleware)
    film = ("arena", f"params.film={tmp_path / 'story.gif'}")
    sets = [word for each in (film, *SHORT) for word in ("--set", ".".join(each))]
    story.check(story.run(*command, "--clock", "arena", "--speed", "max", *sets, cwd=tmp_path))
    assert (tmp_path / "story.gif").read_bytes().startswith(b"GIF89a")
