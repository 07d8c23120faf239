"""A scene and a client that steers in it end in the same state in lock-step as in virtual time, whatever else runs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli import rc, rcgen
from robocomp_py.testing.simulation import Simulation

from ..seeds import SEEDS

pytestmark = pytest.mark.tool  # needs nothing but time

SCENE = """\
<innerModel>
  <plane id="floor" size="20000,10,20000" py="-5"/>
  <omnirobot id="base" noise="0.1">
    <plane id="body" size="300,300,300" py="155"/>
    <translation id="mount" ty="200"><laser id="front" measures="60" angle="4" max="5000"/></translation>
  </omnirobot>
  <plane id="wall" size="6000,900,10" pz="1500" py="450"/>
  <transform id="box" tx="400" tz="700" ty="101" engine="bullet"><plane id="side" size="200,200,200"/></transform>
</innerModel>
"""

WORLD = """\
from pathlib import Path

from robocomp_py.sim.serve.simulator import Simulator

from .generic.genericworker import GenericWorker

END = 600
\"""Ticks after which the state is told.\"""


class SpecificWorker(Simulator, GenericWorker):
    def compute(self):
        super().compute()
        if self.world.ticks == END:
            Path(self.params.told).write_text(self.world.digest())
"""

CLIENT_CDSL = """\
import "OmniRobot.idsl";
import "LaserPub.idsl";

Component client
{
    Communications { requires OmniRobot; subscribesTo LaserPub; };
    language python;
    period 50 ms;
};
"""

CLIENT = """\
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self):
        self.scan, self.turns = [], 0

    def LaserPub_pushLaserData(self, laserData):
        self.scan = laserData

    def compute(self):
        self.turns += 1
        if self.turns > 70:
            self.stop()
        elif len(self.scan):
            nearest = min(each.dist for each in self.scan)
            aside = self.scan[0].dist - self.scan[-1].dist
            self.omnirobot_proxy.setSpeedBase(aside / 10, nearest / 2, nearest / 5000)
"""

NETWORK = """\
import "room/room.cdsl";
import "client/client.cdsl";

Deployment both
{
    Component room
    {
        offers base : OmniRobot, DifferentialRobot, DifferentialRobotPub, FullPoseEstimation, FullPoseEstimationPub;
        offers front : Laser, LaserPub;
    };
    Component client { };
};
"""

BUSY = "while True: sum(range(100_000))"


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("both")
    (folder / "room.xml").write_text(SCENE)
    assert rc.main(["sim", "new", str(folder / "room.xml"), "-o", str(folder / "room")]) == 0
    (folder / "room" / "specificworker.py").write_text(WORLD)
    params = folder / "room" / "room.pdsl"
    told = '    told "the file that is told the state" string "";\n'
    params.write_text(params.read_text().replace("    seed ", f"{told}    seed "))
    (folder / "client").mkdir()
    (folder / "client" / "client.cdsl").write_text(CLIENT_CDSL)
    (folder / "client" / "specificworker.py").write_text(CLIENT)
    for each in ("room", "client"):
        assert rcgen.main([str(folder / each / f"{each}.cdsl")]) == 0
    (folder / "both.ddsl").write_text(NETWORK)
    return folder / "both.ddsl"


@pytest.fixture
def load() -> Iterator[None]:
    """As many busy processes as a small machine has cores."""
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(2)]
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.wait()


def settings(seed: int, told: Path) -> list[tuple[str, str]]:
    return [
        ("room", f"params.seed={seed}"),
        ("room", "params.physics=true"),
        ("room", f'params.told="{told}"'),
    ]


def in_virtual_time(network: Path, seed: int) -> str:
    told = network.with_name(f"virtual{seed}")
    with Simulation(network, settings=settings(seed, told)) as sim:
        assert sim.run(until=sim["client"].is_over, at_most=10.0), sim.failed
    return told.read_text()


def in_lockstep(network: Path, seed: int) -> str:
    told = network.with_name(f"lockstep{seed}")
    told.unlink(missing_ok=True)
    given = [word for name, text in settings(seed, told) for word in ("--set", f"{name}.{text}")]
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(network), "--until", "client", *given]
    command += ["--clock", "room", "--speed", "max"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=network.parent, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return told.read_text()


@pytest.mark.timeout(900)
def test_every_seed_ends_in_lockstep_as_in_virtual_time(network: Path) -> None:
    ends = {seed: in_virtual_time(network, seed) for seed in SEEDS}
    assert len(set(ends.values())) == len(SEEDS)
    assert {seed: in_lockstep(network, seed) for seed in SEEDS} == ends


@pytest.mark.timeout(900)
def test_it_does_so_while_the_machine_is_busy(network: Path, load: None) -> None:
    seeds = SEEDS[:3]
    assert {seed: in_lockstep(network, seed) for seed in seeds} == {
        seed: in_virtual_time(network, seed) for seed in seeds
    }
