"""Bodies with weight, solid shapes and motors, against what can be computed by hand."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.bases import Pose, Speed, between, moved
from robocomp_py.sim.motion import SimulationError
from robocomp_py.sim.world import World

HALL = """\
<innerModel>
  <plane id="floor" size="20000,10,20000" py="-5"/>
  <plane id="wall" size="4000,1000,100" px="-2000" py="500" pz="3050"/>
  <differentialrobot id="base">
    <plane id="body" size="300,300,300" py="150"/>
    <joint id="shoulder" ty="300" axis="x" min="-3" max="3">
      <plane id="upper" size="60,300,60" py="150"/>
      <joint id="elbow" ty="300" axis="x" min="-3" max="3">
        <plane id="lower" size="60,300,60" py="150"/>
        <transform id="hand" ty="300"/>
      </joint>
    </joint>
  </differentialrobot>
  <omnirobot id="chair" tx="-2000" noise="0.1"><plane id="seat" size="400,400,400" py="200"/></omnirobot>
  <transform id="box" tz="1000" ty="101" engine="bullet" mass="1"><plane id="boxes" size="200,200,200"/></transform>
</innerModel>
"""


def world(folder: Path, text: str = HALL, **options: object) -> World:
    path = folder / "hall.xml"
    path.write_text(text)
    return World(Tree.read(path), **{"physics": True, **options})  # type: ignore[arg-type]


@pytest.fixture
def hall(tmp_path: Path) -> World:
    return world(tmp_path)


# Free bodies.


@pytest.mark.parametrize("physics", [False, True])
def test_the_speed_of_a_base_is_that_of_its_wheels(physics: bool) -> None:
    tree = Tree()
    tree.add("root", "plane", "wall", pz=1000.0, py=200.0, size=(900.0, 400.0, 100.0), collide=True)
    tree.add("root", "differentialrobot", "base", collide=True)
    tree.add("base", "plane", "body", size=(300.0, 300.0, 300.0), py=160.0, collide=True)
    world = World(tree, physics=physics, hold=0)
    world.drive("base", ahead=500.0)
    world.step(1)
    assert world.speed("base").ahead == pytest.approx(9.81 * 5.0 if physics else 500.0)
    world.step(199)
    assert world.speed("base").ahead == pytest.approx(500.0)
    world.step(400)
    assert world.speed("base") == (0.0, 0.0, 0.0)  # it is at the wall
    world.drive("base", ahead=-500.0)
    world.step(50)
    assert world.speed("base").ahead == pytest.approx(-500.0)
    world.drive("base")
    world.step(50)
    assert world.speed("base") == (0.0, 0.0, 0.0)


def test_a_pushed_box_moves_with_physics_and_not_without(tmp_path: Path) -> None:
    for physics in (True, False):
        hall = world(tmp_path, physics=physics, hold=0)
        hall.drive("base", ahead=300)
        hall.step(1000)
        front = hall.matrix("base")[2, 3] + 150
        assert front > 1400
        box = hall.matrix("box")[:3, 3]
        if physics:
            assert box == pytest.approx((0, 100, front + 100), abs=2)
        else:
            assert box.tolist() == [0, 101, 1000]


def test_a_body_falls_and_lies(tmp_path: Path) -> None:
    hall = world(tmp_path, HALL.replace('ty="101" engine', 'ty="2100" engine'))
    hall.step(100)
    assert hall.matrix("box")[1, 3] == pytest.approx(2100 - 9810 / 2 * 0.5 * 0.505, abs=1e-6)
    hall.step(400)
    assert hall.matrix("box")[1, 3] == pytest.approx(100, abs=1)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_friction_lets_a_box_slide_down_a_slope_or_holds_it(friction: float, tmp_path: Path) -> None:
    slope = 0.3
    hall = world(
        tmp_path,
        f"""<innerModel><rotation id="slope" rx="{slope}"><plane id="ramp" size="9000,10,9000"/>
        <transform id="box" ty="105" engine="bullet"><plane id="side" size="200,200,200"/></transform>
        </rotation></innerModel>""",
        parameters={"ramp": {"friction": friction}, "box": {"friction": friction}},
    )
    hall.step(200)
    slid = hall.matrix("box", "slope")[2, 3]
    wanted = 9810 / 2 * max(0.0, math.sin(slope) - friction * math.cos(slope))
    assert abs(slid) == pytest.approx(wanted, rel=0.04, abs=3)
    assert slid >= -3  # downhill is ahead: a positive turn about x lowers it


def test_a_door_hangs_in_a_free_frame(tmp_path: Path) -> None:
    """Gravity acts on what is part of a free body: only the links of robots are held by their motors."""
    hall = world(
        tmp_path,
        """<innerModel><transform id="ball" engine="bullet" mass="1"><joint id="lid"><plane id="top" size="9,9,9"/>
        </joint></transform></innerModel>""",
    )
    hall.step(100)
    assert hall.matrix("top")[1, 3] == pytest.approx(-9810 / 2 * 0.5 * 0.505, rel=1e-6)


PIT = """\
<innerModel><transform id="cup" tx="500" ty="9" engine="bullet"><joint id="lid"><plane id="top" size="9,9,9"/></joint>
</transform></innerModel>"""


def test_a_body_that_falls_out_of_the_scene_is_put_to_rest_and_told_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pit = world(tmp_path, PIT)
    pit.step(3000)
    (told,) = [each.getMessage() for each in caplog.records]
    assert told == "`cup` has fallen more than 1000 m below the scene by 15.0 s, and stays there"
    deep = pit.matrix("top")
    assert -1.2e6 < deep[1, 3] < -1e6
    other = pit.copy()
    pit.step(1000)
    assert pit.matrix("top") == pytest.approx(deep)
    other.step(1000)
    assert other.digest() == pit.digest()
    assert len(caplog.records) == 1


def test_a_body_at_rest_below_the_scene_falls_when_it_is_put_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pit = world(tmp_path, PIT)
    pit.step(3000)
    deep = pit.matrix("cup")
    edited = pit.tree.copy()
    edited.add("root", "plane", "new", px=-3000.0)
    pit.change(edited)
    pit.step(400)
    assert pit.matrix("cup") == pytest.approx(deep)
    assert len(caplog.records) == 1
    pit.change(pit.tree.copy(), {"cup": np.eye(4)})
    pit.step(100)
    assert pit.matrix("cup")[1, 3] == pytest.approx(-9810 / 2 * 0.5 * 0.505, rel=1e-6)


# Robots.


def test_a_base_drives_an_arc_with_a_small_lag(hall: World) -> None:
    hall.drive("base", ahead=300 * math.pi / 2, turn=math.pi / 2)
    hall.step(200)
    hall.drive("base")
    hall.step(40)
    assert hall.matrix("base")[[0, 2], 3] == pytest.approx((300, 300), abs=5)
    assert hall.odometry("base") == pytest.approx((*hall.matrix("base")[[0, 2], 3], math.pi / 2), abs=0.01)


def test_a_base_moves_aside_in_its_own_frame(tmp_path: Path) -> None:
    hall = world(tmp_path, HALL.replace('tx="-2000" noise="0.1"', 'tx="-2000" ry="0.5"'))
    hall.drive("chair", aside=400)
    hall.step(200)
    wanted = -2000 + 400 * math.cos(0.5), -400 * math.sin(0.5)
    assert hall.matrix("chair")[[0, 2], 3] == pytest.approx(wanted, abs=10)


@pytest.mark.parametrize("tilt", [0.5, -1.0, math.pi / 2])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_base_that_is_tilted_drives_in_the_plane_of_its_parent(tilt: float, turn: float, tmp_path: Path) -> None:
    """It leans, as on a mount, and is as fast as any other."""
    text = (
        f'<innerModel><omnirobot id="base" rx="{tilt}"><plane id="seat" size="300,300,300"/></omnirobot></innerModel>'
    )
    hall = world(tmp_path, text, hold=0)
    hall.drive("base", ahead=400, aside=-300, turn=turn)
    hall.step(40)
    before = hall.odometry("base")
    hall.step(200)
    wanted = Pose(*moved(before, Speed(400, -300, turn), 1.0))
    assert tuple(hall.odometry("base")) == pytest.approx(wanted, abs=5)  # a lag in bends, as that of any base
    assert hall.matrix("base")[:3, 3] == pytest.approx((wanted.x, 0, wanted.z), abs=5)


def test_a_wall_stops_a_base_and_its_wheels(tmp_path: Path) -> None:
    hall = world(tmp_path, hold=0)
    hall.set_noise("chair", 0)
    hall.drive("chair", ahead=1000)
    hall.step(1000)
    assert hall.matrix("chair")[2, 3] == pytest.approx(2800, abs=2)
    assert hall.odometry("chair").z == pytest.approx(2800, abs=2)


def test_what_is_too_heavy_does_not_move(tmp_path: Path) -> None:
    hall = world(tmp_path, hold=0, parameters={"box": {"mass": 100.0}})
    hall.drive("base", ahead=300)
    hall.step(1000)
    assert hall.matrix("box")[2, 3] == pytest.approx(1000, abs=5)
    hall = world(tmp_path, hold=0, parameters={"box": {"mass": 100.0}, "base": {"mass": 300.0, "force": 3000.0}})
    hall.drive("base", ahead=300)
    hall.step(1000)
    assert hall.matrix("box")[2, 3] > 1500


def test_noise_moves_a_base_and_not_what_its_wheels_say(hall: World) -> None:
    hall.drive("chair", ahead=1000)
    hall.step(200)
    said, true = hall.odometry("chair"), hall.matrix("chair")[[0, 2], 3]
    assert said.z == pytest.approx(1000, abs=60)
    assert said.x == pytest.approx(-2000, abs=1e-3)
    assert 0.01 < math.hypot(said.x - true[0], said.z - true[1]) < 60


def test_a_robot_drives_over_a_floor_of_several_parts_that_it_touches(tmp_path: Path) -> None:
    tiles = "".join(f'<plane id="tile{number}" size="1000,20,1000" pz="{number * 1000}"/>' for number in range(4))
    hall = world(
        tmp_path,
        f"""<innerModel>{tiles}<plane id="post" size="900,900,100" pz="3000"/>
        <omnirobot id="base"><plane id="body" size="300,300,300"/></omnirobot></innerModel>""",
        hold=0,
    )
    hall.drive("base", ahead=1000)
    hall.step(1000)
    assert hall.matrix("base")[2, 3] == pytest.approx(2800, abs=2)  # the post stops it


def arms(count: int) -> str:
    """Arms of six joints that turn about all axes."""
    made = ""
    for arm in range(count):
        links = "".join(
            f'<joint id="j{arm}{link}" axis="{"zxyzxy"[link]}" ty="{150 if link else 0}">'
            f'<plane id="p{arm}{link}" size="50,150,50" py="75"/>'
            for link in range(6)
        )
        made += f'<transform id="a{arm}" tx="{2000 * arm}">{links}{"</joint>" * 6}</transform>'
    return f"<innerModel>{made}</innerModel>"


def test_joints_arrive_where_they_are_told(tmp_path: Path) -> None:
    hall = world(tmp_path, arms(4))
    told = {name: hall.move_joint(name, math.sin(3 * number), 1.0) for number, name in enumerate(hall.joints)}
    assert len(told) == 24
    hall.step(300)
    for name, position in told.items():
        assert hall.position(name) == pytest.approx(position, abs=0.006)


def test_seven_joints_arrive_soon_though_they_bend_out_of_the_axes_of_others(tmp_path: Path) -> None:
    """Stretched upwards, as it begins, the arm has nearly no inertia about its vertical axes."""
    links = "".join(
        f'<joint id="j{number}" axis="{axis}" ty="200"><plane id="p{number}" size="60,200,60" py="100"/>'
        for number, axis in enumerate("yzxyzxy")
    )
    arm = world(tmp_path, f"<innerModel>{links}{'</joint>' * 7}</innerModel>")
    goals = {f"j{number}": (0.5 if number % 2 else -0.4, 1.0) for number in range(7)}
    arm.move_joints(goals)
    arm.step(130)  # 0.65 s, of which they may take 0.5 s
    assert max(abs(arm.position(joint) - goal) for joint, (goal, _) in goals.items()) < 0.001


def test_a_joint_follows_its_speed_and_at_once_is_soon(hall: World) -> None:
    hall.move_joint("shoulder", 2.0, speed=1.0)
    hall.step(100)
    assert hall.position("shoulder") == pytest.approx(0.5, abs=0.02)
    hall.move_joint("elbow", -0.5)
    assert hall.position("elbow") == pytest.approx(0, abs=0.02)
    hall.step(60)
    assert hall.position("elbow") == pytest.approx(-0.5, abs=0.02)


def test_links_of_one_robot_do_not_touch_each_other(tmp_path: Path) -> None:
    hall = world(tmp_path)
    hall.move_joint("elbow", 3.0, 2.0)
    hall.step(400)
    assert hall.position("elbow") == pytest.approx(3.0, abs=0.01)


def test_an_arm_that_is_too_weak_is_held_back(tmp_path: Path) -> None:
    text = """<innerModel><joint id="arm"><plane id="rod" size="1000,20,20" px="500"/></joint>
    <plane id="post" size="100,100,100" px="800" py="300"/></innerModel>"""
    hall = world(tmp_path, text, parameters={"arm": {"force": 5.0}})
    hall.move_joint("arm", 1.0, 1.0)
    hall.step(400)
    assert 0.2 < hall.position("arm") < 0.35


def test_an_arm_touches_the_table_that_it_is_mounted_on_with_its_hand_only(tmp_path: Path) -> None:
    text = """<innerModel><plane id="table" size="2000,100,2000" py="-50"/>
    <joint id="turret" axis="y"><plane id="foot" size="100,200,100"/>
      <joint id="shoulder" ty="300" axis="x"><plane id="link" size="40,40,600" pz="300"/></joint>
    </joint></innerModel>"""
    hall = world(tmp_path, text, parameters={"shoulder": {"force": 20.0}})
    hall.move_joint("turret", 1.0, 1.0)
    hall.step(240)
    assert hall.position("turret") == pytest.approx(1.0, abs=0.006)
    hall.move_joint("shoulder", 1.5, 1.0)
    hall.step(400)
    assert hall.position("shoulder") == pytest.approx(math.asin(300 / 600), abs=0.05)
    assert ("link", "table") in hall.touching()


def test_robots_touch_each_other(tmp_path: Path) -> None:
    bases = "".join(
        f'<omnirobot id="{name}" tz="{z}"><plane id="{name}body" size="300,300,300" py="150"/></omnirobot>'
        for name, z in (("one", 0), ("two", 1000))
    )
    hall = world(tmp_path, f'<innerModel><plane id="floor" size="9000,10,9000"/>{bases}</innerModel>', hold=0)
    hall.drive("one", ahead=500)
    hall.step(600)
    assert hall.matrix("two", "one")[2, 3] == pytest.approx(300, abs=5)
    assert hall.odometry("two").z > 1010  # pushed, although it brakes


# On and off.


def test_physics_can_be_switched_while_the_scene_runs(tmp_path: Path) -> None:
    hall = world(tmp_path, HALL.replace('ty="101" engine', 'ty="1000" engine'), physics=False)
    assert not hall.physics
    hall.move_joint("shoulder", 1.0)
    hall.step(50)
    assert hall.matrix("box")[1, 3] == 1000
    hall.set_physics(True)
    hall.step(20)
    assert hall.position("shoulder") == pytest.approx(1.0, abs=1e-3)
    height = hall.matrix("box")[1, 3]
    assert height == pytest.approx(1000 - 9810 / 2 * 0.1 * 0.105)
    hall.set_physics(False)
    hall.step(50)
    assert hall.matrix("box")[1, 3] == height
    hall.set_physics(True)
    hall.step(20)
    assert hall.matrix("box")[1, 3] == pytest.approx(height - 9810 / 2 * 0.1 * 0.105)  # it begins at rest


@pytest.mark.parametrize("turn", [0.0, 1e-8, 0.3, -2.0])
def test_the_speed_between_two_poses_leads_from_one_to_the_other(turn: float) -> None:
    speed, pose = Speed(300, -100, turn), Pose(10, 20, 0.7)
    assert between(pose, moved(pose, speed, 0.5), 0.5) == pytest.approx(speed, abs=1e-6)


# The same every time.


def story(hall: World) -> str:
    hall.drive("base", ahead=700, turn=0.05)
    hall.drive("chair", ahead=300, aside=200, turn=-0.3)
    hall.move_joint("shoulder", 1.4, speed=2.0)
    hall.step(250)
    return hall.digest()


def test_another_process_computes_the_same_and_a_seed_makes_a_world(tmp_path: Path) -> None:
    digests = [story(world(tmp_path, seed=seed)) for seed in range(20)]
    assert len(set(digests)) == 20
    code = (
        "import sys; from pathlib import Path; from tests.sim.test_physics import world, story\n"
        "for seed in range(20): print(story(world(Path(sys.argv[1]), seed=seed)))"
    )
    said = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    assert said.stdout.split() == digests


def test_what_looks_changes_nothing_and_reset_begins_again(hall: World, tmp_path: Path) -> None:
    first = story(hall)
    hall.reset()
    hall.drive("base", ahead=700, turn=0.05)
    hall.drive("chair", ahead=300, aside=200, turn=-0.3)
    hall.move_joint("shoulder", 1.4, speed=2.0)
    for _ in range(250):
        hall.step()
        hall.matrix("hand")
        hall.digest()
    assert hall.digest() == first


def test_a_copy_goes_on_in_the_same_way_while_bodies_sleep(hall: World) -> None:
    hall.step(400)
    hall.drive("base", ahead=900)
    copy = hall.copy()
    before = hall.digest()
    copy.step(200)
    assert hall.digest() == before
    hall.step(200)
    assert hall.digest() == copy.digest()
    assert np.array_equal(hall.matrix("box"), copy.matrix("box"))
    assert hall.matrix("box")[2, 3] > 1001


# Mistakes.


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"bocks": {"mass": 1.0}}, "parameters: unknown node `bocks`"),
        ({"box": {"mas": 1.0}}, "parameters of `box`: unknown parameter `mas`; did you mean `mass`?"),
        ({"box": {"mass": 0.0}}, "`mass` is 0: it has to be at least 1e-06"),
        ({"box": {"friction": math.nan}}, "`friction` is nan: it has to be a number"),
        ({"box": {"force": 1.0}}, "a transform has no `force`: only a base or a joint has one"),
        ({"box": {"belt": 1.0}}, "a transform has no `belt`: only a plane has one"),
        ({"hand": {"suction": 1.0}}, "a transform has no `suction`: only a shape, or a node above one, has one"),
        ({"hand": {"friction": 1.0}}, "a transform has no `friction`: only a shape, or a node above one, has one"),
    ],
)
def test_wrong_parameters_are_refused(parameters: object, text: str, tmp_path: Path) -> None:
    with pytest.raises(InnerModelError, match=re.escape(text)):
        world(tmp_path, parameters=parameters)


def test_what_has_no_result_is_told(tmp_path: Path) -> None:
    hall = world(tmp_path, hold=0, parameters={"base": {"force": 1e30}})
    hall.drive("base", ahead=1e9, turn=1e9)
    with pytest.raises(SimulationError, match=r"physics became unstable after 0\.\d\d\d s, at `base`"):
        hall.step(200)
