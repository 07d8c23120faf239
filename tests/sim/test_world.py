"""A simulated scene against what can be computed by hand."""

from __future__ import annotations

import math
import random
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.bases import Pose, Speed, moved
from robocomp_py.sim.world import World

ROOM = """\
<innerModel>
  <transform id="world">
    <plane id="north" pz="3005" nz="1" size="9000,2000,10"/>
    <plane id="east" px="2005" nx="1" size="9000,2000,10" collide="1"/>
    <plane id="west" px="-4005" nx="-1" size="9000,2000,10"/>
    <differentialrobot id="base" collide="1">
      <plane id="body" size="300,300,300" collide="1"/>
      <translation id="mount" ty="300">
        <laser id="laser" measures="8" angle="6.283185307179586" min="100" max="5000"/>
      </translation>
      <joint id="shoulder" ty="200" axis="x" min="-1" max="1">
        <prismaticjoint id="slide" axis="y" offset="50" max="80"><transform id="hand" tz="20"/></prismaticjoint>
      </joint>
    </differentialrobot>
    <omnirobot id="chair" tx="-2000" tz="-1000" ry="0.5" noise="0.1"/>
  </transform>
</innerModel>
"""


def world(folder: Path, text: str = ROOM, **options: float) -> World:
    path = folder / "room.xml"
    path.write_text(text)
    return World(Tree.read(path), **options)  # type: ignore[arg-type]


@pytest.fixture
def room(tmp_path: Path) -> World:
    return world(tmp_path)


# Sensors.


def test_the_name_of_a_file_is_no_scene(room: World) -> None:
    with pytest.raises(TypeError, match=r"'room.xml' is not a Tree; `Tree.read`"):
        World("room.xml")  # type: ignore[arg-type]  # that is what is wrong
    with pytest.raises(TypeError, match=r"'room.xml' is not a Tree"):
        room.change("room.xml")  # type: ignore[arg-type]  # the same
    assert room.scan("laser").shape == (8,)


def test_a_laser_measures_the_walls_from_the_right_to_the_left(room: World) -> None:
    """Only the wall on the right is 2 m away: a mirrored world shows here."""
    diagonal = math.sqrt(2)
    wanted = (5000, 2000 * diagonal, 2000, 2000 * diagonal, 3000, 3000 * diagonal, 4000, 4000 * diagonal)
    assert np.allclose(room.scan("laser"), np.minimum(wanted, 5000), rtol=0, atol=1e-6)


def test_the_walls_turn_as_the_robot_does(room: World) -> None:
    room.drive("base", turn=math.pi / 2)
    room.step(200)
    assert room.scan("laser")[4] == pytest.approx(2000)  # ahead is what was on the right


@pytest.mark.parametrize("turn", [0.0, 0.3, -1.1, 2.7])
def test_any_ray_meets_a_wall_where_geometry_says(turn: float, tmp_path: Path) -> None:
    text = ROOM.replace('measures="8"', 'measures="97"').replace('max="5000"', 'max="90000"')
    room = world(tmp_path, text)
    room.drive("base", turn=turn)
    room.step(200)
    angles = turn + math.pi - 2 * math.pi * np.arange(97) / 97
    right, ahead = np.sin(angles), np.cos(angles)
    with np.errstate(divide="ignore"):
        east = np.where(right > 0, 2000 / right, np.where(right < 0, -4000 / right, math.inf))
        north = np.where(ahead > 0, 3000 / ahead, math.inf)
    hit = np.minimum(east, north)
    point = hit[:, None] * np.stack((right, ahead), axis=1)
    seen = (np.abs(point) < 4400).all(axis=1)
    assert seen.sum() > 50
    assert np.allclose(room.scan("laser")[seen], hit[seen], rtol=0, atol=1e-6)


def test_what_is_nearer_than_a_laser_can_measure_is_at_its_least(tmp_path: Path) -> None:
    room = world(tmp_path, ROOM.replace('min="100"', 'min="2500"'))
    assert room.scan("laser")[2] == 2500


def test_noise_has_its_deviation_and_no_memory(room: World) -> None:
    room.set_noise("laser", 20.0)
    errors = []
    for _ in range(10_000):
        room.step()
        errors.append(room.scan("laser")[2] - 2000)
    assert np.std(errors) == pytest.approx(20, rel=0.05)
    assert abs(np.mean(errors)) < 1
    assert abs(np.corrcoef(errors[1:], errors[:-1])[0, 1]) < 0.05
    assert np.array_equal(room.scan("laser"), room.scan("laser"))


def test_noise_depends_on_nothing_but_the_tick(tmp_path: Path, room: World) -> None:
    other = world(tmp_path)
    for each in (room, other):
        each.set_noise("laser", 20.0)
        each.set_noise("chair", 0.3)
        each.drive("chair", ahead=100)
    room.step(20)
    for _ in range(20):
        other.step()
        other.scan("laser")
    with ThreadPoolExecutor(1) as threads:
        elsewhere = threads.submit(other.scan, "laser").result()
    assert np.array_equal(elsewhere, room.scan("laser"))
    assert other.digest() == room.digest()


def test_what_is_not_there_is_not_disturbed(room: World) -> None:
    room.set_noise("laser", 20.0)
    assert room.scan("laser")[0] == 5000


# Motion.


def test_a_base_drives_an_arc(room: World) -> None:
    room.drive("base", ahead=300 * math.pi / 2, turn=math.pi / 2)  # a quarter of a circle of 300 mm, in one second
    room.step(200)
    assert room.odometry("base") == pytest.approx((300, 300, math.pi / 2))
    assert room.matrix("base")[:3, 3] == pytest.approx((300, 0, 300))
    assert room.time == pytest.approx(1)


def test_a_base_with_two_wheels_does_not_move_aside(room: World) -> None:
    room.drive("base", aside=100)
    assert room.speed("base") == Speed()
    room.set_noise("chair", 0)
    room.drive("chair", aside=100)
    room.step(200)
    wanted = -2000 + 100 * math.cos(0.5), -1000 - 100 * math.sin(0.5), 0.5
    assert room.odometry("chair") == pytest.approx(wanted)
    assert room.matrix("chair")[[0, 2], 3] == pytest.approx(wanted[:2])


def test_small_turns_are_those_of_large_ones() -> None:
    for turn in (1e-9, 1e-7, 1e-5, 1e-3):
        x, z, _ = moved(Pose(0, 0, 0), Speed(100, 0, turn), 1.0)
        assert x == pytest.approx(100 * turn / 2, rel=1e-5)
        assert z == pytest.approx(100 * math.sin(turn) / turn, rel=1e-12)


def test_a_base_stops_when_it_is_told_nothing_any_more(tmp_path: Path) -> None:
    room = world(tmp_path, hold=0.5)
    room.drive("base", ahead=100)
    room.step(100)
    assert room.odometry("base").z == pytest.approx(50)
    room.step(100)
    assert room.odometry("base").z == pytest.approx(50)
    assert room.speed("base") == Speed()
    room = world(tmp_path, hold=0)
    room.drive("base", ahead=100)
    room.step(1000)
    assert room.odometry("base").z == pytest.approx(500)


def test_noise_moves_a_base_and_not_its_odometry(room: World) -> None:
    room.drive("chair", ahead=1000)
    room.step(100)
    believed, true = room.odometry("chair"), room.matrix("chair")[:3, 3]
    assert math.hypot(believed.x + 2000, believed.z + 1000) == pytest.approx(500)
    assert 0.01 < math.hypot(believed.x - true[0], believed.z - true[2]) < 50


def test_odometry_can_be_set_and_corrected(room: World) -> None:
    room.set_odometry("base", 10, 20, math.pi / 2)
    room.drive("base", ahead=100)
    room.step(100)
    assert room.odometry("base") == pytest.approx((60, 20, math.pi / 2))
    room.correct_odometry("base", 0, 0, 0)
    room.step(100)
    assert room.odometry("base") == pytest.approx((110, 20, math.pi / 2))
    assert room.corrected("base") == pytest.approx((0, 50, 0))
    assert room.matrix("base")[:3, 3] == pytest.approx((0, 0, 100))


def test_a_base_stops_before_what_stops_it(room: World) -> None:
    room.drive("base", turn=math.pi / 2)
    room.step(200)
    room.drive("base", ahead=400)
    for _ in range(20):
        room.drive("base", ahead=400)
        room.step(100)
    where = room.odometry("base")
    assert 2000 - 150 - 2 <= where.x <= 2000 - 150
    assert room.matrix("base")[0, 3] == pytest.approx(where.x)
    room.drive("base", ahead=-400)
    room.step(100)
    assert room.odometry("base").x == pytest.approx(where.x - 200)


POSTS = """\
<innerModel>
  <transform id="world">
    <transform id="posts">{posts}</transform>
    <differentialrobot id="base" collide="1">
      <plane id="body" size="300,300,300" py="200" collide="1"/>
      <joint id="pan" ty="200" axis="y"><plane id="boom" size="60,60,1500" pz="600" collide="1"/></joint>
    </differentialrobot>
  </transform>
</innerModel>
"""


@pytest.mark.parametrize("boom", ["60,60,1500", "60,60,60"])
def test_no_shape_of_a_base_ever_enters_what_stops_it(boom: str, tmp_path: Path) -> None:
    """However it drives and turns, and wherever it was put in between."""
    places = [(x, z) for x in range(-4200, 4300, 1400) for z in range(-4200, 4300, 1400) if x or z]
    posts = "".join(
        f'<plane id="p{x}_{z}" px="{x}" pz="{z}" py="200" size="90,900,90" collide="1"/>' for x, z in places
    )
    text = POSTS.format(posts=posts).replace("60,60,1500", boom)
    room, chosen, stops = world(tmp_path, text), random.Random(2), 0
    saved = [room.save()]
    for _ in range(400):
        room.drive("base", chosen.choice((300.0, 900.0, -900.0)), 0.0, chosen.choice((0.0, 1.0, 9.0, -9.0)))
        room.step(chosen.choice((1, 7, 40)))
        before = room.odometry("base")
        room.step(2)
        stops += room.odometry("base") == before
        assert not room.collide("base", "posts")
        if chosen.random() < 0.1:
            saved.append(room.save())
        if chosen.random() < 0.1:
            room.restore(chosen.choice(saved))
        if chosen.random() < 0.05:
            room.reset()
    assert stops


def test_bases_that_drive_towards_one_another_stop_before_they_touch(tmp_path: Path) -> None:
    text = """<innerModel><transform id="world">
      <omnirobot id="one" collide="1"><plane id="boom" size="60,60,1500" pz="750" collide="1"/></omnirobot>
      <omnirobot id="two" tz="2600" collide="1"><plane id="body" size="300,300,300" collide="1"/></omnirobot>
    </transform></innerModel>"""
    room, stops = world(tmp_path, text), 0
    for _ in range(200):
        room.drive("one", ahead=900.0)
        room.drive("two", ahead=-600.0)
        before = room.odometry("one"), room.odometry("two")
        room.step()
        stops += room.odometry("one") == before[0] or room.odometry("two") == before[1]
        assert not room.collide("one", "two")
    assert stops


def test_a_base_that_passes_an_obstacle_moves_as_its_wheels_tell(tmp_path: Path) -> None:
    post = '<plane id="post" px="500" pz="1500" py="200" size="90,900,90" collide="1"/>'
    room = world(tmp_path, POSTS.format(posts=post).replace("60,60,1500", "60,60,60"))
    for _ in range(60):
        room.drive("base", ahead=100.0)
        room.step(100)
        assert room.odometry("base").z == pytest.approx(room.matrix("base")[2, 3], abs=1e-6)
    assert room.odometry("base").z == pytest.approx(3000.0)


PEN = """\
<innerModel>
  <plane id="left" px="-1500" size="90,900,3000" collide="1"/>
  <plane id="right" px="1500" size="90,900,3000" collide="1"/>
  <plane id="back" pz="-1500" size="3000,900,90" collide="1"/>
  <plane id="front" pz="1500" size="3000,900,90" collide="1"/>
  <omnirobot id="one" tx="-600" collide="1">
    <plane id="cube" size="300,300,300" collide="1"/>
    <joint id="pan" axis="y"><plane id="boom" size="60,60,600" pz="200" collide="{solid}"/></joint>
  </omnirobot>
  <omnirobot id="other" tx="600" collide="1"><plane id="beam" size="900,90,90" collide="1"/></omnirobot>
</innerModel>
"""


@pytest.mark.parametrize("solid", [0, 1])
def test_bases_that_may_touch_move_in_turn(solid: int, tmp_path: Path) -> None:
    """They end in the same bits, however many ticks they are asked for at once."""
    at_once, in_turn = (world(tmp_path, PEN.format(solid=solid)) for _ in range(2))
    chosen, touched = random.Random(3), 0
    for _ in range(150):
        ticks = chosen.choice((1, 7, 40, 300))
        for name in ("one", "other"):
            speed = chosen.uniform(-900, 900), chosen.uniform(-900, 900), chosen.choice((0.0, 0.0, 1.0, -9.0))
            for each in (at_once, in_turn):
                each.drive(name, *speed)
        if chosen.random() < 0.2:
            goal = chosen.uniform(-3.0, 3.0), chosen.choice((0.0, 0.5))
            for each in (at_once, in_turn):
                each.move_joint("pan", *goal)
        at_once.step(ticks)
        for _ in range(ticks):
            in_turn.step()
        assert at_once.digest() == in_turn.digest()
        touched += at_once.distance("one", "other") < 20.0
    assert touched


def before_a_post(tmp_path: Path) -> World:
    """A base that drives slowly to a post, with its arm turned aside."""
    post = '<plane id="post" pz="1700" py="200" size="90,900,90" collide="1"/>'
    room = world(tmp_path, POSTS.format(posts=post))
    room.move_joint("pan", math.pi / 2)
    room.drive("base", ahead=100.0)
    room.step(20)
    return room


def test_an_arm_that_turned_stops_its_base(tmp_path: Path) -> None:
    room = before_a_post(tmp_path)
    assert room.odometry("base").z == pytest.approx(10.0)
    room.move_joint("pan", 0.0)
    room.drive("base", ahead=600.0)
    room.step(200)
    assert 1700 - 45 - 1350 - 3.1 <= room.odometry("base").z <= 1700 - 45 - 1350


def test_an_arm_that_turns_while_its_base_drives_stops_it(tmp_path: Path) -> None:
    room = before_a_post(tmp_path)
    room.move_joint("pan", 0.0, 1.0)
    for _ in range(5):
        room.drive("base", ahead=100.0)
        room.step(150)
    assert 1700 - 45 - 1350 - 3.1 <= room.odometry("base").z <= 1700 - 45 - 1350


def test_it_goes_through_what_does_not_stop_it(room: World) -> None:
    for _ in range(2):
        room.drive("base", ahead=4000)
        room.step(200)
    assert room.odometry("base").z == pytest.approx(8000)


def test_one_that_begins_inside_may_leave(tmp_path: Path) -> None:
    room = world(tmp_path, ROOM.replace('id="base"', 'id="base" tx="1900" ry="1.5707963267948966"'))
    room.drive("base", ahead=100)
    room.step(100)
    assert room.odometry("base").x == 1900
    room.drive("base", ahead=-400)
    room.step(100)
    assert room.odometry("base").x == pytest.approx(1700)


def test_a_joint_moves_at_its_speed_to_within_its_limits(room: World) -> None:
    assert room.move_joint("shoulder", 5.0, speed=2.0) == 1.0
    room.step(50)
    assert room.position("shoulder") == pytest.approx(0.5)
    room.step(100)
    assert room.position("shoulder") == 1.0
    assert room.move_joint("slide", 30) == 30
    assert room.position("slide") == pytest.approx(30)
    tree = Tree()
    tree.add("root", "joint", "shoulder", ty=200.0, axis="x")
    tree.add("shoulder", "prismaticjoint", "slide", axis="y", offset=50.0)
    tree.add("slide", "transform", "hand", tz=20.0)
    tree.update_joint("shoulder", 1.0)
    tree.update_prismatic("slide", 30)
    assert np.allclose(room.matrix("hand", "base"), tree.matrix("root", "hand"), rtol=0, atol=1e-9)


# The same every time.


def story(room: World, at_once: int = 300) -> str:
    room.set_noise("laser", 5.0)
    room.drive("base", ahead=250, turn=0.4)
    room.drive("chair", ahead=100, aside=50, turn=-0.3)
    room.move_joint("shoulder", 0.8, speed=0.5)
    for _ in range(300 // at_once):
        room.step(at_once)
    return room.digest()


@pytest.mark.parametrize("physics", [False, True])
def test_ticks_at_once_are_the_same_as_one_by_one(tmp_path: Path, physics: bool) -> None:
    at_once, one_by_one = (world(tmp_path, physics=physics) for _ in range(2))
    digest = story(at_once)
    assert story(one_by_one, at_once=1) == digest


def test_ticks_at_once_are_the_same_while_one_base_drives_and_a_wall_stops_it(tmp_path: Path) -> None:
    digests, places = set(), []
    for at_once in (1, 200):
        room = world(tmp_path)
        for speed, turn in ((900.0, 1.2), (900.0, 0.4), (900.0, 0.0), (-300.0, -0.5), (900.0, 0.3)):
            room.drive("base", ahead=speed, turn=turn)
            for _ in range(200 // at_once):
                room.step(at_once)
            places.append(room.odometry("base").x)
        digests.add(room.digest())
    assert len(digests) == 1
    assert 1500.0 < max(places) < 1850.0  # half of its body is between there and the wall at 2000


def test_another_process_sees_the_same(tmp_path: Path, room: World) -> None:
    code = (
        "import sys; from pathlib import Path; from tests.sim.test_world import world, story\n"
        "print(story(world(Path(sys.argv[1]))))"
    )
    said = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == story(room)


def test_a_seed_makes_a_world(tmp_path: Path) -> None:
    digests = {story(world(tmp_path, seed=seed)) for seed in range(5)}
    assert len(digests) == 5
    room = world(tmp_path, seed=3)
    first = story(room)
    room.reset()
    assert room.ticks == 0
    assert story(room) == first
    room.reset(4)
    assert story(room) in digests - {first}


def test_a_copy_goes_on_in_the_same_way_and_by_itself(room: World) -> None:
    story(room)
    copy = room.copy()
    before = room.digest()
    copy.step(100)
    assert room.digest() == before != copy.digest()
    room.step(100)
    assert room.digest() == copy.digest()
    assert np.array_equal(room.scan("laser"), copy.scan("laser"))


def test_who_looks_changes_nothing(tmp_path: Path, room: World) -> None:
    other = world(tmp_path)
    for each in (room, other):
        each.drive("chair", ahead=100)
    for _ in range(50):
        room.step()
        room.scan("laser")
        room.matrix("hand")
    other.step(50)
    assert room.digest() == other.digest()


def test_time_is_exact(room: World) -> None:
    for tick in range(1, 42):
        room.step()
        assert room.time == tick / 200
    room.step(359)
    assert room.time == 2.0


# Mistakes.


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda room: room.drive("bass"), InnerModelError, "unknown base `bass`; did you mean `base`?"),
        (lambda room: room.scan("lasr"), InnerModelError, "unknown laser `lasr`; did you mean `laser`?"),
        (lambda room: room.move_joint("hand", 0), InnerModelError, "unknown joint `hand`"),
        (lambda room: room.matrix("hands"), InnerModelError, "unknown node `hands`; did you mean `hand`?"),
        (lambda room: room.drive("base", ahead=math.nan), ValueError, "nan is no speed"),
        (lambda room: room.drive("base", turn=-math.inf), ValueError, "-inf is no speed"),
        (lambda room: room.move_joint("shoulder", math.nan), ValueError, "nan is no position"),
        (lambda room: room.set_odometry("base", x=math.inf), ValueError, "inf is no pose"),
        (lambda room: room.correct_odometry("base", 0, 0, math.nan), ValueError, "nan is no pose"),
        (lambda room: room.set_noise("laser", -1), ValueError, "a standard deviation of -1"),
        (lambda room: room.set_noise("hand", 1), InnerModelError, "unknown laser, imu, base or camera `hand`"),
        (lambda room: room.step(-1), ValueError, "-1 ticks"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(call, error, text: str, room: World) -> None:  # type: ignore[no-untyped-def]
    before = room.digest()
    with pytest.raises(error, match=re.escape(text)):
        call(room)
    assert room.digest() == before


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('measures="8"', 'measures="-1"', "`measures` is negative"),
        ('max="5000"', 'max="50"', "it has 8, 100 and 50"),
        ('<transform id="hand" tz="20"/>', '<mesh id="cup" file="cup.obj"/>', "`cup`: there is no file `cup.obj`"),
        ('<transform id="hand" tz="20"/>', '<mesh id="cup"/>', "`cup`: the mesh has no `file`; mend the path, or"),
    ],
)
def test_a_scene_that_cannot_be_simulated_says_why(old: str, new: str, text: str, tmp_path: Path) -> None:
    with pytest.raises(InnerModelError, match=re.escape(text)):
        world(tmp_path, ROOM.replace(old, new))


def test_a_laser_without_rays_is_left_out(tmp_path: Path) -> None:
    room = world(tmp_path, ROOM.replace('measures="8"', ""))
    assert room.lasers == []
    with pytest.raises(InnerModelError, match="unknown laser `laser`"):
        room.scan("laser")


def test_meshes_that_are_not_there_can_be_left_out(tmp_path: Path) -> None:
    text = ROOM.replace('<transform id="hand" tz="20"/>', '<mesh id="cup" file="cup.obj"/>')
    assert world(tmp_path, text, without_meshes=True).matrix("cup").shape == (4, 4)


@pytest.mark.parametrize("times", [{"tick": 0.0}, {"tick": math.inf}, {"hold": -1.0}, {"hold": math.inf}])
def test_a_tick_and_a_hold_are_finite_times(times: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"a tick of .* s, and a hold of .* s"):
        World(Tree(), **times)  # type: ignore[arg-type]  # mypy: a time may be given as another parameter
