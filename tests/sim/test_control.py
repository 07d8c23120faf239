"""A simulation from outside: its time, its noise, its beginning, and where everything is."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.sim.serve.pace import Pace
from robocomp_py.testing.components import ComponentTest, load_component

SCENE = """\
<innerModel>
  <transform id="world">
    <differentialrobot id="base" tx="500" noise="0.1">
      <joint id="pan" ty="300" axis="y"><laser id="front" measures="2" angle="3.14" max="5000"/></joint>
    </differentialrobot>
  </transform>
</innerModel>
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("control")
    (folder / "room.xml").write_text(SCENE)
    assert rc(["sim", "new", str(folder / "room.xml"), "-o", str(folder / "house")]) == 0
    return folder / "house"


@pytest.fixture(scope="module")
def component(folder: Path) -> Iterator[ComponentTest]:
    with ComponentTest(load_component(folder), virtual=True) as component:
        yield component
    assert component.fine


@pytest.fixture
def house(component: ComponentTest) -> ComponentTest:
    component.call("Simulation.resume")
    component.call("Simulation.setSpeed", 1.0)
    component.call("Simulation.reset", 1)
    return component


def drive(house: ComponentTest, ahead: float) -> None:
    house.worker.differentialrobot["base"].setSpeedBase(ahead, 0.0)


def refusal(house: ComponentTest, operation: str, *arguments: object) -> str:
    with pytest.raises(Exception, match=r".") as refused:
        house.call(f"Simulation.{operation}", *arguments)
    assert type(refused.value).__name__ == "SimulationException"
    return str(refused.value)


def test_it_stands_still_while_it_is_paused_and_goes_on_by_steps(house: ComponentTest) -> None:
    house.call("Simulation.pause")
    before = house.call("Simulation.now")
    house.run(5.0)
    now = house.call("Simulation.now")
    assert (now.tick, now.paused) == (before.tick, True)
    after = house.call("Simulation.step", 200)
    assert (after.tick, after.time) == (before.tick + 200, pytest.approx(before.time + 1))
    house.call("Simulation.resume")
    house.run(1.0)
    assert house.call("Simulation.now").tick == pytest.approx(after.tick + 200, abs=11)


def test_it_goes_on_at_a_factor_of_the_clock(house: ComponentTest) -> None:
    house.call("Simulation.setSpeed", 4.0)
    before = house.call("Simulation.now")
    house.run(10.0)
    now = house.call("Simulation.now")
    assert now.time - before.time == pytest.approx(40, abs=0.3)
    assert (now.speed, now.reached) == (4.0, pytest.approx(4.0))


def test_it_begins_again_with_another_seed(house: ComponentTest) -> None:
    world, places = house.worker.world, set()
    for seed in (1, 2, 1):
        house.call("Simulation.reset", seed)
        drive(house, 300.0)
        house.call("Simulation.pause")
        house.call("Simulation.step", 100)
        places.add(world.matrix("base").tobytes())
        house.call("Simulation.resume")
    assert len(places) == 2


def test_physics_is_switched(house: ComponentTest) -> None:
    house.call("Simulation.setPhysics", True)
    assert house.call("Simulation.now").physics
    drive(house, 100.0)
    before = house.worker.world.matrix("base")[2, 3]
    house.call("Simulation.step", 100)
    assert house.worker.world.matrix("base")[2, 3] > before + 10
    house.call("Simulation.setPhysics", False)
    assert not house.call("Simulation.now").physics


def test_a_state_is_kept_and_gone_on_from(house: ComponentTest) -> None:
    house.call("Simulation.pause")
    drive(house, 300.0)
    house.call("Simulation.step", 20)
    token, digests = house.call("Simulation.save"), set()
    for _ in range(3):
        house.call("Simulation.restore", token)
        house.call("Simulation.step", 50)
        digests.add(house.worker.world.digest())
    assert len(digests) == 1
    assert house.call("Simulation.now").tick == pytest.approx(house.worker.world.ticks)
    for _ in range(16):
        house.call("Simulation.save")
    assert "the last 16 are kept" in refusal(house, "restore", token)


def test_plans_are_tried_in_copies(house: ComponentTest) -> None:
    house.call("Simulation.pause")
    house.call("Simulation.setNoise", "base", 0.0)
    package = type(house.worker).__module__.rpartition(".")[0]
    kinds = importlib.import_module(f"{package}.generic.RoboCompSimulation")
    plans = [[kinds.Command(0.0, "base", np.array([speed, 0.0, 0.0]))] for speed in (100.0, 200.0)]
    before = house.worker.world.digest()
    slow, fast = house.call("Simulation.evaluate", plans, 0.5, [])
    assert house.worker.world.digest() == before
    assert [each.poses[0].z for each in (slow, fast)] == pytest.approx([50, 100])
    assert (slow.poses[0].id, slow.failed) == ("base", "")
    assert "unknown base, joint or gripper `bass`" in refusal(
        house, "evaluate", [[kinds.Command(0.0, "bass", np.array([1.0]))]], 0.5, []
    )
    assert "at most 64" in refusal(house, "evaluate", plans * 40, 1.0, [])


def test_noise_is_set(house: ComponentTest) -> None:
    house.call("Simulation.setNoise", "base", 0.0)
    drive(house, 100.0)
    house.call("Simulation.step", 100)
    assert house.call("Simulation.poses", ["base"])[0].z == pytest.approx(50)


def test_poses_are_true_and_seen_from_the_root(house: ComponentTest) -> None:
    house.worker.world.move_joint("pan", 0.5)
    base, pan = house.call("Simulation.poses", [])
    assert (base.id, base.x, pan.id) == ("base", 500, "pan")
    assert (pan.x, pan.y, pan.z, pan.rx, pan.ry, pan.rz) == pytest.approx((500, 300, 0, 0, 0.5, 0))
    [front] = house.call("Simulation.poses", ["front"])
    assert front.ry == pytest.approx(0.5)


def test_the_scene_is_told_as_a_file(house: ComponentTest) -> None:
    package = type(house.worker).__module__.rpartition(".")[0]
    pose = importlib.import_module(f"{package}.generic.RoboCompInnerModelManager").Pose3D(z=3000.0)
    house.call("InnerModelManager.addTransform", "shelf", "static", "world", pose)
    text = house.call("Simulation.scene")
    assert '<transform id="shelf" tz="3000"/>' in text
    assert '<joint id="pan" ty="300" axis="y">' in text
    assert house.call("Simulation.scene") == text
    house.call("InnerModelManager.removeNode", "shelf")


def test_what_has_moved_is_published(house: ComponentTest) -> None:
    told: list[Any] = []

    def latest() -> Any:
        told[:] = house.received("simulationpub.advanced")
        return told[-1]

    house.run(1.0)
    assert latest()[1] == []
    house.worker.world.move_joint("pan", 0.25)
    house.run(1.0)
    assert latest()[0].tick == pytest.approx(house.call("Simulation.now").tick, abs=11)
    moved = [poses for _, poses in told if poses]
    assert [each.id for each in moved[0]] == ["base", "pan"]
    assert [each.id for each in moved[-1]] == ["pan"]
    assert moved[-1][0].ry == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("operation", "arguments", "text"),
    [
        ("step", (-1,), "-1 ticks in one call: it is from 0 to 20000"),
        ("step", (20_001,), "20001 ticks in one call"),
        ("setSpeed", (-1.0,), "a speed of -1: it is from 0, for as fast as possible, to 1000"),
        ("setSpeed", (math.nan,), "a speed of nan"),
        ("setSpeed", (0.0,), "0 needs the machine's clock"),
        ("reset", (-1,), "a seed of -1: it is 0 or more"),
        ("setNoise", ("bass", 1.0), "did you mean `base`?"),
        ("setNoise", ("base", math.inf), "inf is no standard deviation"),
        ("attach", ("hand",), "unknown gripper `hand`; known: none; `suction`, in an item of the parameter `bodies`,"),
        ("detach", ("hand",), "unknown gripper `hand`"),
        ("restore", (99,), "there is no saved state 99"),
        ("poses", (["base", "pann"],), "unknown node `pann`; did you mean `pan`?"),
    ],
)
def test_what_cannot_be_is_refused(
    operation: str, arguments: tuple[object, ...], text: str, house: ComponentTest
) -> None:
    before = house.worker.world.digest()
    assert text in refusal(house, operation, *arguments)
    assert house.worker.world.digest() == before


def test_physics_and_what_it_needs_are_parameters(folder: Path) -> None:
    settings: dict[str, Any] = {"params.physics": True, "params.bodies": [{"id": "pan", "mass": 3.0}]}
    with ComponentTest(load_component(folder), settings, virtual=True) as house:
        assert house.call("Simulation.now").physics
    settings["params.bodies"] = [{"id": "pann", "mass": 3.0}]
    with ComponentTest(load_component(folder), settings, virtual=True) as house:
        pass
    assert not house.fine


@pytest.mark.parametrize(("settings", "seconds"), [({}, 1.0), ({"params.hold": 2.5}, 2.5), ({"params.hold": 0.0}, 4.0)])
def test_how_long_a_base_drives_on_is_a_parameter(settings: dict[str, Any], seconds: float, folder: Path) -> None:
    with ComponentTest(load_component(folder), settings, virtual=True) as house:
        drive(house, 100.0)
        house.call("Simulation.step", 800)
        assert house.worker.world.matrix("base")[2, 3] == pytest.approx(100.0 * seconds, rel=0.05)


def test_with_the_clock_of_the_machine_it_is_as_fast_as_it_can(folder: Path) -> None:
    with ComponentTest(load_component(folder)) as house:
        house.call("Simulation.setSpeed", 0.0)
        house.wait_for(lambda: house.worker.world.time > 30.0)
        assert house.call("Simulation.now").speed == 0.0
    assert house.fine


def test_of_a_long_delay_only_the_last_second_is_made_up_for(caplog: pytest.LogCaptureFixture) -> None:
    pace = Pace(0.005, now=0)
    assert pace.follow(50_000_000, 0) == 10
    assert pace.follow(10_000_000_000, 10) == 200
    assert "the scene is 10.0 s late" in caplog.text.replace("9.9", "10.0")
    assert pace.follow(10_050_000_000, 210) == 10


def test_ticks_that_took_too_long_are_still_due_and_lateness_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    pace, now, ticks = Pace(0.005, now=0), 0, 0
    for _ in range(50):
        now += 100_000_000
        due = pace.follow(now, ticks)
        ticks += 5
        pace.owe(due - 5)
    assert due == 200
    assert len(caplog.records) == 1
    for _ in range(5):
        now += 100_000_000
        ticks += pace.follow(now, ticks)
    assert pace.follow(now, ticks) == 0
    pace.follow(now + 10_000_000_000, ticks)
    assert len(caplog.records) == 2


def test_a_scene_that_is_told_to_be_too_fast_answers_as_before(folder: Path, tmp_path: Path) -> None:
    boxes = "".join(
        f'<transform id="box{each}" tx="{each * 900}" engine="bullet"><plane id="side{each}"/></transform>'
        for each in range(200)
    )
    (tmp_path / "boxes.xml").write_text(f"<innerModel>{boxes}</innerModel>")
    settings = {"params.physics": True, "params.scene": str(tmp_path / "boxes.xml")}
    with ComponentTest(load_component(folder), settings) as house:
        house.call("Simulation.setSpeed", 1000.0)
        before = house.worker.world.ticks
        house.wait_for(lambda: house.worker.world.ticks > before)
        before = house.worker.world.ticks
        house.call("Simulation.setSpeed", 1.0)
        assert house.worker.world.ticks - before < 3_000  # of 10,000, which are due in each period
    assert house.fine


def test_who_steps_or_resets_the_scene_by_hand_owes_nothing() -> None:
    pace = Pace(0.005, now=0)
    assert pace.follow(1_000_000_000, 0) == 200
    assert pace.follow(1_100_000_000, 0) == 0
    assert pace.follow(1_200_000_000, 0) == 20
