"""States that are kept, and plans that are tried in copies of a world."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.plans import Command, Plan, evaluate, follow
from robocomp_py.sim.world import World

HALL = """\
<innerModel>
  <plane id="floor" size="20000,10,20000" py="-5"/>
  <omnirobot id="base" noise="0.05">
    <plane id="body" size="300,300,300" py="150"/>
    <joint id="arm" ty="300" axis="x"><plane id="rod" size="50,300,50" py="150"/></joint>
    <transform id="mount"><imu id="imu"/></transform>
  </omnirobot>
  <plane id="table" size="400,700,400" pz="1500" py="350"/>
  <transform id="box" tx="800" tz="700" ty="101" engine="bullet"><plane id="side" size="200,200,200"/></transform>
  <transform id="lid" tx="800" tz="700" ty="252" engine="bullet"><plane id="top" size="100,100,100"/></transform>
</innerModel>
"""

AHEAD = [Command(0.0, "base", (600.0,)), Command(0.8, "base", (600.0,))]
AWAY = [Command(0.0, "base", (0.0, -600.0)), Command(0.3, "arm", (1.0, 2.0))]
INTO_BOX = [Command(0.0, "base", (600.0, 700.0))]


@pytest.fixture
def hall(tmp_path: Path) -> World:
    (tmp_path / "hall.xml").write_text(HALL)
    return World(Tree.read(tmp_path / "hall.xml"), physics=True, seed=3)


def story(hall: World) -> str:
    hall.drive("base", ahead=700, aside=800, turn=0.1)
    hall.move_joint("arm", 1.0, speed=1.0)
    hall.step(150)
    return hall.digest()


# States.


def test_after_a_restore_the_run_ends_in_the_same_bits(hall: World) -> None:
    hall.step(300)  # the boxes sleep
    saved, before = hall.save(), hall.digest()
    first = story(hall)
    hall.reset_imu("imu")
    hall.set_physics(False)
    hall.set_noise("base", 0.0)
    hall.reset(7)
    for _ in range(2):
        hall.restore(saved)
        assert hall.digest() == before
        assert (hall.ticks, hall.physics) == (300, True)
        assert story(hall) == first
    assert hall.matrix("box")[0, 3] > 801


def test_a_run_from_a_saved_state_repeats_with_any_seed(hall: World) -> None:
    ends = set()
    for seed in range(20):
        hall.reset(seed)
        story(hall)
        saved = hall.save()
        first = story(hall)
        hall.restore(saved)
        assert story(hall) == first
        ends.add(first)
    assert len(ends) == 20


def test_a_state_may_be_restored_in_a_copy_but_not_in_another_scene(hall: World, tmp_path: Path) -> None:
    hall.step(50)
    saved, copy = hall.save(), hall.copy()
    copy.step(10)
    copy.restore(saved)
    assert copy.digest() == hall.digest()
    with pytest.raises(ValueError, match="the saved state is that of another scene"):
        World(Tree.read(tmp_path / "hall.xml")).restore(saved)


# Plans.


def test_the_live_world_is_untouched_and_the_prediction_is_the_run(hall: World) -> None:
    hall.step(200)
    before = hall.digest()
    outcomes = evaluate(hall, [AHEAD, AWAY, INTO_BOX], 1.5)
    assert hall.digest() == before
    assert [each.digest for each in evaluate(hall, [AHEAD, AWAY, INTO_BOX], 1.5)] == [each.digest for each in outcomes]
    saved = hall.save()
    for plan, outcome in zip((AHEAD, AWAY, INTO_BOX), outcomes, strict=True):
        hall.restore(saved)
        followed = follow(hall, plan, 1.5)
        assert hall.digest() == outcome.digest == followed.digest
        assert hall.matrix("box") == pytest.approx(outcome.poses["box"][-1], abs=1e-9)
        assert outcome.contacts == followed.contacts


def test_an_outcome_has_poses_contacts_and_distances(hall: World) -> None:
    hall.set_noise("base", 0)
    watched = [("body", "table"), ("box", "table")]
    ahead, away, into_box = evaluate(hall, [AHEAD, AWAY, INTO_BOX], 2.0, watched=watched)
    assert ahead.times == pytest.approx(np.arange(0, 2.01, 0.05))
    assert ahead.poses["base"].shape == (41, 4, 4)
    assert ahead.poses["base"][20, 2, 3] == pytest.approx(600, abs=30)
    assert ahead.distances[0] == pytest.approx(1500 - 200 - 1080 - 150, abs=40)
    assert away.distances == pytest.approx((1150, math.hypot(500, 500)), abs=3)
    assert {(each.one, each.other) for each in away.contacts} == {("floor", "side"), ("side", "top")}
    pushed = next(each for each in into_box.contacts if (each.one, each.other) == ("body", "side"))
    assert pushed.time == pytest.approx((800 - 100 - 150) / 700 + 0.04, abs=0.08)


def test_a_policy_looks_and_decides(hall: World) -> None:
    seen = []

    def carefully(world: World) -> None:
        seen.append(world.time)
        world.drive("base", ahead=600 if world.distance("base", "table") > 300 else 0)

    (outcome,) = evaluate(hall, [carefully], 2.5, watched=[("base", "table")])
    assert 200 < outcome.distances[0] < 300
    assert seen == pytest.approx(np.arange(0, 2.5, 0.05))
    assert hall.ticks == 0


def test_contacts_are_told_with_their_force(hall: World) -> None:
    hall.step(400)
    weighed = [each.force for each in hall.contacts() if (each.one, each.other) == ("floor", "side")]
    assert sum(weighed) == pytest.approx(2 * 0.5 * 9.81, rel=0.02)  # although they sleep
    hall.set_physics(False)
    assert hall.contacts() == []
    assert hall.touching() == []


def test_a_plan_without_result_is_told_and_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "hall.xml").write_text(HALL)
    hall = World(Tree.read(tmp_path / "hall.xml"), physics=True, parameters={"base": {"force": 1e30}})

    def impossible(world: World) -> None:
        world.drive("base", ahead=1e9, turn=1e9)

    wild, fine = evaluate(hall, [impossible, AWAY], 1.0)
    assert fine.failed == ""
    assert wild.failed.startswith("physics became unstable after 0.")


def test_of_commands_at_one_time_the_last_one_counts(hall: World) -> None:
    plan = [Command(0.5, "base", (0.0,)), Command(0.0, "base", (-300.0,)), Command(0.0, "base", (300.0,))]
    [outcome] = evaluate(hall, [plan], 1.0)
    begin, *_, end = outcome.poses["base"][:, 2, 3]
    assert end - begin > 100


@pytest.mark.parametrize(
    ("plan", "horizon", "text"),
    [
        ([Command(0.0, "bass", (1.0,))], 1.0, "unknown base, joint or gripper `bass`; did you mean `base`"),
        ([Command(0.0, "arm", (1.0, 2.0, 3.0))], 1.0, "it needs a time, and 1 to 2 values"),
        ([Command(0.0, "base", (math.nan,))], 1.0, "values that are finite numbers"),
        ([Command(0.5, "base", (1e20,))], 1.0, "a value is at most 1e+09"),
        ([Command(-1.0, "base", (1.0,))], 1.0, "its time is before the beginning"),
        ([], 0.0, "a plan of 0.0 s"),
        ([], 4000.0, "at most 3600"),
    ],
)
def test_wrong_plans_are_refused_before_anything_runs(plan: Plan, horizon: float, text: str, hall: World) -> None:
    with pytest.raises((InnerModelError, ValueError), match=re.escape(text)):
        evaluate(hall, [AHEAD, plan], horizon)
    with pytest.raises(InnerModelError, match="`mount` has no shapes"):
        evaluate(hall, [AHEAD], 1.0, watched=[("mount", "table")])
    assert hall.ticks == 0
