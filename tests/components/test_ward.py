"""A wheelchair follows a route through a simulated ward."""

from __future__ import annotations

import importlib
import math

import pytest

from robocomp_py.cli import rc, rcgen
from robocomp_py.testing.simulation import Simulation

from ..seeds import SEEDS
from .conftest import COMPONENTS

NETWORK = COMPONENTS / "ward.ddsl"
END = 7.4, 3.35, 0.0


def ward(seed: int) -> Simulation:
    return Simulation(NETWORK, seed, settings=[("ward", f"params.seed={seed}")])


def arrives(seed: int) -> str:
    """Drive to the end, and see that the chair is truly there; returns the hash of all that was said."""
    with ward(seed) as sim:
        assert sim.run(until=sim["route"].is_over, at_most=60.0), f"seed {seed}: {sim.failed}"
        truth = sim["ward"].worker.world.truth("chair")
    away = math.dist((truth.position[0], truth.position[2]), END[:2])
    assert away < 0.1, f"seed {seed}: {away} m from the end"
    assert abs(math.remainder(truth.angles[1] - END[2], math.tau)) < 0.1
    return sim.hash


def test_the_network_and_its_scene_are_without_diagnostics(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["lint", str(NETWORK), str(COMPONENTS / "ward" / "ward.xml")]) == 0
    assert not any(capsys.readouterr())
    assert rcgen.main(["--check", str(NETWORK)]) == 0, capsys.readouterr().out


def test_the_chair_arrives() -> None:
    assert arrives(1) != arrives(2)


@pytest.mark.tool  # needs nothing but time
def test_the_chair_arrives_with_every_noise_and_every_run_is_the_same() -> None:
    hashes = [arrives(seed) for seed in SEEDS]
    assert len(set(hashes)) == len(SEEDS)
    assert arrives(SEEDS[7]) == hashes[7]


def test_it_waits_while_something_is_in_its_way(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    with ward(1) as sim:
        sim.run(0.1)
        worker = sim["ward"].worker
        values = importlib.import_module(
            f"{type(worker).__module__.rpartition('.')[0]}.generic.RoboCompInnerModelManager"
        )
        plane = values.Plane3D(px=2150, py=300, pz=4200, nz=1, thickness=50, width=600, height=600)
        worker.InnerModelManager_addPlane("trolley", "world", plane)
        sim.run(until=lambda: sim["route"].worker.waits, at_most=10.0)
        before = worker.world.truth("chair").position
        sim.run(5.0)
        assert worker.world.truth("chair").position == pytest.approx(before, abs=0.01)
        assert before[2] + 0.42 < 4.2
        worker.InnerModelManager_removeNode("trolley")
        assert sim.run(until=sim["route"].is_over, at_most=60.0)
    assert caplog.text.count("waiting: something is in the way") == 1
