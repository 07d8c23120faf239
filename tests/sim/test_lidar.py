"""A lidar, against a room whose walls can be computed by hand; and as clients of a component see it."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.world import World
from robocomp_py.testing.components import ComponentTest, load_component

ROOM = """\
<innerModel>
  <transform id="world">
    <plane id="floor" py="-5" size="8000,10,8000"/>
    <plane id="east" px="2005" size="10,9000,9000"/>
    <plane id="north" pz="3005" size="9000,9000,10"/>
    <plane id="west" px="-2505" size="10,9000,9000"/>
    <differentialrobot id="base" tx="300" tz="-200" ry="0.4">
      <plane id="body" size="300,300,300" py="600"/>
      <transform id="mount" ty="600" rx="0.1"><laser id="top" measures="72" angle="6.2831853" min="50" max="6000"/></transform>
    </differentialrobot>
    <laser id="plain" measures="3" angle="1" max="5000"/>
  </transform>
</innerModel>
"""  # noqa: E501


def world(folder: Path, text: str = ROOM, **parameters: float) -> World:
    path = folder / "room.xml"
    path.write_text(text)
    return World(Tree.read(path), seed=1, parameters={"top": parameters or {"fans": 8, "field": 0.8}})


def by_hand(room: World) -> np.ndarray[Any, Any]:
    """Where rays meet the inner sides of the walls and of the floor, within the lidar, mm; in the order of a scan."""
    pose, found = room.matrix("top"), []
    for turn in np.linspace(math.pi, -math.pi, 72, endpoint=False)[::-1]:
        for height in np.linspace(0.4, -0.4, 8):
            own = (math.sin(turn) * math.cos(height), math.sin(height), math.cos(turn) * math.cos(height))
            away = pose[:3, :3] @ own
            sides = ((0, 2000.0), (2, 3000.0), (0, -2500.0), (1, 0.0))
            reach = [(side - pose[axis, 3]) / away[axis] for axis, side in sides if away[axis]]
            hits = [each for each in reach if each > 0 and _is_inside(pose[:3, 3] + each * away)]
            if hits and 50 <= min(hits) <= 6000:
                found.append(min(hits) * np.array(own))
    return np.array(found)


def _is_inside(point: np.ndarray[Any, Any]) -> bool:
    """Whether a point of a plane belongs to its wall: walls are 9 m wide and high, and the floor 8 m."""
    return bool((np.abs(point) < 4500).all() and (point[1] > 1e-6 or np.abs(point[[0, 2]]).max() < 4000))


def test_points_lie_on_the_walls(tmp_path: Path) -> None:
    room = world(tmp_path)
    expected = by_hand(room)
    assert len(expected) > 400
    assert room.cloud("top") == pytest.approx(expected, abs=1e-3)


def test_points_move_with_what_carries_the_lidar(tmp_path: Path) -> None:
    room = world(tmp_path)
    before = room.cloud("top")
    room.drive("base", ahead=200.0, turn=0.7)
    room.step(150)
    assert room.cloud("top") == pytest.approx(by_hand(room), abs=1e-3)
    assert len(before) != len(room.cloud("top"))


def test_what_is_too_near_or_too_far_gives_no_point(tmp_path: Path) -> None:
    room = world(tmp_path, ROOM.replace('min="50" max="6000"', 'min="2500" max="3500"'))
    distances = np.linalg.norm(room.cloud("top"), axis=1)
    assert len(distances)
    assert (distances >= 2500).all()
    assert (distances <= 3500).all()


def test_one_fan_is_the_laser_itself(tmp_path: Path) -> None:
    room = world(tmp_path, fans=1)
    points, distances = room.cloud("top"), room.scan("top")[::-1]
    assert np.linalg.norm(points, axis=1) == pytest.approx(distances[distances < 6000])
    assert points[:, 1] == pytest.approx(0, abs=1e-9)


def test_noise_is_along_the_rays_and_always_the_same(tmp_path: Path) -> None:
    room = world(tmp_path)
    exact = room.cloud("top")
    room.set_noise("top", 10.0)
    noisy = room.cloud("top")
    assert (noisy == room.cloud("top")).all()
    assert (room.copy().cloud("top") == noisy).all()
    apart = np.linalg.norm(noisy, axis=1) - np.linalg.norm(exact, axis=1)
    assert apart.std() == pytest.approx(10, rel=0.15)
    assert np.cross(noisy, exact) == pytest.approx(0, abs=1e-2)
    room.step()
    assert (noisy != room.cloud("top")).any()


def test_a_lidar_keeps_its_fans_when_the_scene_is_edited(tmp_path: Path) -> None:
    room = world(tmp_path)
    tree = room.tree.copy()
    tree.add("world", "plane", "shelf", size=(100.0, 100.0, 100.0), px=1000.0)
    room.change(tree)
    assert len(room.cloud("top")) > 400
    without = room.tree.copy()
    without.remove("top")
    room.change(without)
    assert room.lidars == []


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"fans": 0}, "`fans` is 0: it has to be at least 1"),
        ({"fans": 2.5}, "`fans` is 2.5: it has to be a whole number"),
        ({"fans": 1001}, "`fans` is 1001: it can be 1000 at most"),
        ({"field": 4}, "`field` is 4: it can be 3.14159 at most"),
        ({"fan": 4}, "unknown parameter `fan`; did you mean `fans`?"),
    ],
)
def test_wrong_parameters_are_refused(parameters: dict[str, float], text: str, tmp_path: Path) -> None:
    with pytest.raises(InnerModelError, match="parameters of `top`") as refused:
        world(tmp_path, **parameters)
    assert text in str(refused.value)


def test_only_a_laser_has_fans_and_no_more_rays_than_memory(tmp_path: Path) -> None:
    with pytest.raises(InnerModelError, match="a plane has no `fans`: only a laser has one"):
        World(Tree.read(_written(tmp_path)), parameters={"floor": {"fans": 4}})
    with pytest.raises(InnerModelError, match="1000 fans of 7200 rays: a lidar has at most 1000000 rays"):
        world(tmp_path, ROOM.replace('measures="72"', 'measures="7200"'), fans=1000)
    with pytest.raises(InnerModelError, match="unknown lidar `plain`; known: top"):
        world(tmp_path).cloud("plain")


def _written(folder: Path) -> Path:
    (folder / "room.xml").write_text(ROOM)
    return folder / "room.xml"


# As a component.


@pytest.fixture(scope="module")
def component(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ComponentTest]:
    folder = tmp_path_factory.mktemp("lidar")
    assert rc(["sim", "new", str(_written(folder)), "--lidar", "top", "-o", str(folder / "house")]) == 0
    written = tomllib.loads((folder / "house" / "etc" / "config.toml").read_text())
    settings = {"params.bodies": written["params"]["bodies"]}
    with ComponentTest(load_component(folder / "house"), settings, virtual=True) as component:
        yield component
    assert component.fine


@pytest.fixture
def house(component: ComponentTest) -> Any:
    component.call("Simulation.pause")
    component.call("Simulation.reset", 1)
    return component.worker


def test_only_what_is_told_is_a_lidar(house: Any) -> None:
    assert (list(house.laser), list(house.lidar3d), list(house.lidar3dpub)) == (["top", "plain"], ["top"], ["top"])


def test_points_are_records_in_metres_with_x_ahead_y_left_and_z_up(house: Any) -> None:
    data, cloud = house.lidar3d["top"].getLidarData("", 0.0, math.tau, 1), house.world.cloud("top")
    points = data.points
    assert points.dtype.names[:4] == ("x", "y", "z", "intensity")
    assert len(points) == len(cloud) > 800
    seen = np.stack((points["x"], points["y"], points["z"]), axis=1)
    assert seen == pytest.approx(cloud[:, [2, 0, 1]] * (0.001, -0.001, 0.001), abs=1e-5)
    assert points["r"] == pytest.approx(np.linalg.norm(seen, axis=1), abs=1e-5)
    assert points["distance2d"] == pytest.approx(np.hypot(seen[:, 0], seen[:, 1]), abs=1e-5)
    right = points[np.argmin(points["y"])]
    assert right["phi"] > 1
    assert points["theta"] == pytest.approx(np.arccos(seen[:, 2] / points["r"]), abs=1e-4)
    assert (np.diff(points["phi"]) > -1e-5).all()
    assert data.period == pytest.approx(50)


def test_a_sector_may_cross_the_direction_behind(house: Any) -> None:
    lidar = house.lidar3d["top"]
    whole = lidar.getLidarData("", 0.0, math.tau, 1).points["phi"]
    ahead = lidar.getLidarData("", -0.5, 1.0, 1).points["phi"]
    assert sorted(ahead) == sorted(whole[np.abs(whole) <= 0.5])
    behind = lidar.getLidarData("", math.pi - 0.5, 1.0, 1).points["phi"]
    assert sorted(behind) == sorted(whole[np.abs(whole) >= math.pi - 0.5])
    assert len(lidar.getLidarData("", 0.0, float(np.float32(math.tau)), 1).points) == len(whole)


def test_points_are_thinned_by_degrees(house: Any) -> None:
    phi = np.degrees(house.lidar3d["top"].getLidarData("", 0.0, 7.0, 10).points["phi"])
    assert len(phi)
    assert np.abs(phi - np.round(phi / 10) * 10) == pytest.approx(0, abs=0.51)
    assert len(set(np.round(phi).tolist())) <= 37


def test_points_that_are_far_are_left_out(house: Any) -> None:
    lidar = house.lidar3d["top"]
    near = lidar.getLidarDataWithThreshold2d("", 2.0, 1).points
    assert 0 < len(near) < len(lidar.getLidarData("", 0.0, 7.0, 1).points)
    assert near["distance2d"].max() <= 2.0
    assert len(lidar.getLidarDataWithThreshold2d("", math.nan, 1).points) == 0


def test_points_are_published(component: ComponentTest, house: Any) -> None:
    component.wait_for(lambda: component.received("lidar3dpub.pushLidarData"))
    [(data,)] = component.received("lidar3dpub.pushLidarData")[-1:]
    points = house.lidar3d["top"].getLidarData("", 0.0, 7.0, 1).points
    for axis, values in zip("xyz", (data.XArray, data.YArray, data.ZArray), strict=True):
        assert values == pytest.approx(points[axis])
    assert set(data.CategoriesArray.tolist()) == {0}
    assert len(data.CategoriesArray) == len(points)


def test_a_lidar_that_is_no_laser_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(_written(tmp_path))
    assert rc(["sim", "offers", path, "--lidar", "tob"]) == 1
    assert "rc sim: --lidar tob: unknown laser `tob`; did you mean `top`?" in capsys.readouterr().err
    assert rc(["sim", "offers", path, "--lidar", "top"]) == 0
    assert (
        "offers top : Laser, LaserPub, Lidar3D, Lidar3DPub;\noffers plain : Laser, LaserPub;" in capsys.readouterr().out
    )
