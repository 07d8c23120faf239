"""A component that simulates a scene: what it provides, and what its clients see."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.innermodel.nodes import DEVICES
from robocomp_py.sim.serve.offers import INTERFACES
from robocomp_py.testing.components import ComponentTest, load_component

SCENE = """\
<innerModel>
  <transform id="world">
    <plane id="east" px="2005" nx="1" size="9000,2000,10"/>
    <differentialrobot id="base" tx="500" port="10004">
      <translation id="mount" ty="300"><laser id="front" measures="2" angle="3.1415926535" max="5000"/></translation>
    </differentialrobot>
    <omnirobot id="chair" tx="-2000"><laser id="aside" measures="1" max="5000" ifconfig="10004"/></omnirobot>
    <translation id="pole" ty="300"><laser id="still" measures="1" angle="0" min="10" max="5000"/></translation>
    <laser id="off"/>
  </transform>
</innerModel>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "room.xml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A component that simulates a scene."""
    folder = tmp_path_factory.mktemp("plain")
    (folder / "room.xml").write_text(SCENE)
    assert rc(["sim", "new", str(folder / "room.xml"), "-o", str(folder / "house")]) == 0
    return folder / "house"


@pytest.fixture
def house(plain: Path) -> Iterator[ComponentTest]:
    with ComponentTest(load_component(plain), virtual=True) as component:
        yield component
    assert component.fine


def call(house: ComponentTest, name: str, interface: str, operation: str, *arguments: object) -> Any:
    handler = getattr(house.worker, interface.lower())[name]
    return getattr(handler, operation)(*arguments)


def test_every_device_is_an_instance(house: ComponentTest) -> None:
    worker = house.worker
    assert list(worker.laser) == list(worker.laserpub) == ["front", "aside", "still"]
    assert list(worker.differentialrobot) == ["base", "chair"]
    assert list(worker.omnirobot) == ["chair"]


def test_a_laser_is_asked(house: ComponentTest) -> None:
    right, ahead = call(house, "front", "Laser", "getLaserData")
    assert (right.angle, right.dist) == pytest.approx((math.pi / 2, 1500))
    assert (ahead.angle, ahead.dist) == pytest.approx((0, 5000), abs=1e-6)
    scan, state = call(house, "front", "Laser", "getLaserAndBStateData")
    assert (len(scan), state.x) == (2, 500)
    assert call(house, "still", "Laser", "getLaserAndBStateData")[1].x == 0
    assert call(house, "aside", "Laser", "getLaserAndBStateData")[1].x == 500
    said = call(house, "front", "Laser", "getLaserConfData")
    assert (said.maxMeasures, said.maxDegrees, said.maxRange) == (2, 180, 5000)


def test_a_laser_tells_the_state_of_the_base_that_carries_it_now(house: ComponentTest) -> None:
    house.call("InnerModelManager.moveNode", "mount", "chair")
    house.call("Simulation.step", 1)
    assert call(house, "front", "Laser", "getLaserAndBStateData")[1].x == -2000
    house.call("InnerModelManager.moveNode", "mount", "world")
    house.call("Simulation.step", 1)
    assert call(house, "front", "Laser", "getLaserAndBStateData")[1].x == 0


def test_a_base_is_driven(house: ComponentTest) -> None:
    call(house, "base", "DifferentialRobot", "setSpeedBase", 100.0, 0.0)
    call(house, "chair", "OmniRobot", "setSpeedBase", 60.0, 30.0, 0.0)
    began = house.worker.world.time
    house.wait_for_computes(11)
    passed = house.worker.world.time - began
    assert 0 < passed < 1
    state = call(house, "base", "DifferentialRobot", "getBaseState")
    assert (state.x, state.z, state.advVz, state.isMoving) == pytest.approx((500, 100 * passed, 100, True))
    pose = call(house, "chair", "OmniRobot", "getBasePose")
    assert pose == pytest.approx((-2000 + 60 * passed, 30 * passed, 0), abs=0.6)
    call(house, "base", "DifferentialRobot", "stopBase")
    call(house, "base", "DifferentialRobot", "setOdometerPose", 10, 20, 0.5)
    assert call(house, "base", "DifferentialRobot", "getBasePose") == (10, 20, 0.5)
    call(house, "base", "DifferentialRobot", "correctOdometer", 30, 40, 0.25)
    state = call(house, "base", "DifferentialRobot", "getBaseState")
    assert (state.x, state.correctedX, state.correctedAlpha) == (10, 30, 0.25)
    call(house, "chair", "OmniRobot", "stopBase")
    call(house, "chair", "OmniRobot", "setOdometer", state)
    assert call(house, "chair", "OmniRobot", "getBaseState") == state
    call(house, "base", "DifferentialRobot", "resetOdometer")
    assert call(house, "base", "DifferentialRobot", "getBasePose") == (0, 0, 0.0)


@pytest.mark.parametrize(
    ("operation", "arguments"),
    [
        ("setSpeedBase", (math.nan, 0.0)),
        ("setSpeedBase", (0.0, math.inf)),
        ("setSpeedBase", (3e38, 0.0)),
        ("setOdometerPose", (2**31 - 1, 0, 0.0)),
        ("setOdometerPose", (0, 0, math.nan)),
        ("correctOdometer", (0, 0, -math.inf)),
    ],
)
def test_a_number_that_is_not_finite_is_refused_by_its_interface(
    operation: str, arguments: tuple[float, ...], house: ComponentTest
) -> None:
    with pytest.raises(Exception, match=r"(nan|inf|e\+\d+) is no") as refused:
        call(house, "base", "DifferentialRobot", operation, *arguments)
    assert type(refused.value).__name__ == "HardwareFailedException"


def test_a_first_speed_that_may_be_in_metres_is_told_once(
    house: ComponentTest, caplog: pytest.LogCaptureFixture
) -> None:
    for speed in (1e-15, 0.5, 0.25, 200.0):
        call(house, "base", "DifferentialRobot", "setSpeedBase", speed, 0.0)
    call(house, "chair", "OmniRobot", "setSpeedBase", 0.0, 300.0, 0.0)
    call(house, "chair", "OmniRobot", "setSpeedBase", 0.5, 0.0, 0.0)  # as at the end of a drive
    told = "`base` was told to drive at 0.5 mm/s, which hardly moves it: this interface takes mm/s, not m/s"
    assert [each.getMessage() for each in caplog.records if each.levelname == "WARNING"] == [told]


def test_a_state_that_is_refused_changes_nothing(house: ComponentTest) -> None:
    state = call(house, "base", "DifferentialRobot", "getBaseState")
    wrong = dataclasses.replace(state, x=1.0, correctedX=math.nan)
    with pytest.raises(Exception, match="nan is no pose"):
        call(house, "base", "DifferentialRobot", "setOdometer", wrong)
    assert call(house, "base", "DifferentialRobot", "getBaseState") == state


def test_a_base_that_goes_on_for_ever_stops_where_messages_cannot_carry_its_place(house: ComponentTest) -> None:
    call(house, "base", "DifferentialRobot", "setOdometerPose", 10**9, 0, math.pi / 2)
    for _ in range(2):
        call(house, "base", "DifferentialRobot", "setSpeedBase", 1e9, 0.0)
        house.wait_for_computes(11)
    x, _, _ = call(house, "base", "DifferentialRobot", "getBasePose")
    assert 10**9 < x < 2**31
    assert not call(house, "base", "DifferentialRobot", "getBaseState").isMoving


def test_the_next_commands_are_told(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["sim", "new", str(scene), "-o", str(scene.parent / "house"), "--lidar", "front"]) == 0
    told = [line.strip() for line in capsys.readouterr().out.splitlines() if line.startswith("    ")]
    assert told == [f"rc run {scene.parent / 'house'}", f"rc sim offers {scene} --lidar front"]
    assert rc(told[1].split()[1:]) == 0
    assert "offers front : " in capsys.readouterr().out


def test_without_mujoco_the_extra_is_named(scene: Path) -> None:
    code = "import sys; sys.modules['mujoco'] = None; import robocomp_py.sim.serve.simulator"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "a scene needs MuJoCo: pip install 'robocomp-py[sim]'" in said.stderr


def test_records_are_filled_as_lists_are(scene: Path) -> None:
    """A component with an IDSL of its own: the scan is an array of records, and one field has another name."""
    folder = scene.parent
    assert rc(["sim", "new", str(scene), "-o", str(folder / "house")]) == 0
    (folder / "house" / "Laser.idsl").write_text(
        """
        module RoboCompLaser
        {
            struct LaserConfData { int maxRange; int colour; };
            struct TData { float angle; float dist; float light; };
            [records] sequence<TData> TLaserData;
            struct State { float x; };
            interface Laser
            {
                TLaserData getLaserData();
                TLaserData getLaserAndBStateData(out State bState);
                LaserConfData getLaserConfData();
            };
        };
        """
    )
    cdsl = folder / "house" / "house.cdsl"
    text = cdsl.read_text().replace('import "LaserPub.idsl";', "")
    cdsl.write_text(re.sub(r"LaserPub each qos\(sensor_data\),", "", text))

    assert rcgen([str(cdsl)]) == 0
    with ComponentTest(load_component(folder / "house"), virtual=True) as house:
        scan = call(house, "front", "Laser", "getLaserData")
        assert scan.dtype.names == ("angle", "dist", "light")
        assert scan["dist"].tolist() == pytest.approx([1500, 5000])
        said = call(house, "front", "Laser", "getLaserConfData")
        assert (said.maxRange, said.colour) == (5000, 0)
    assert house.fine


def test_offers_are_printed(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["sim", "offers", str(scene), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "base": ["DifferentialRobot", "DifferentialRobotPub", "FullPoseEstimation", "FullPoseEstimationPub"],
        "front": ["Laser", "LaserPub"],
        "chair": [
            "OmniRobot",
            "DifferentialRobot",
            "DifferentialRobotPub",
            "FullPoseEstimation",
            "FullPoseEstimationPub",
        ],
        "aside": ["Laser", "LaserPub"],
        "still": ["Laser", "LaserPub"],
    }


WITH_PORTS = SCENE.replace('id="front"', 'id="front" port="10003"').replace(
    '<laser id="off"/>', '<joint id="pan" port="10067"/><joint id="tilt" port="10067"/>'
)


def test_offers_are_printed_with_the_ports_of_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "room.xml"
    path.write_text(WITH_PORTS)
    assert rc(["sim", "offers", str(path), "--ports"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["offers base : DifferentialRobot port 10004;", "offers front : Laser port 10003;"]
    assert lines[-2:] == ["offers still : Laser, LaserPub;", "offers joints10067 : JointMotor port 10067;"]
    assert rc(["sim", "offers", str(path), "--ports", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["front"] == {"interfaces": ["Laser"], "port": 10003}
    path.write_text(WITH_PORTS.replace("10003", "10004"))
    assert rc(["sim", "offers", str(path), "--ports"]) == 1
    assert "room.xml:5:40: `front`: port 10004 is that of `base`, too" in capsys.readouterr().err


def test_what_is_wrong_with_a_device_is_told_beside_the_offers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "room.xml"
    path.write_text(
        '<innerModel><imu id="imu"/><laser id="front" measures="five" angle="3.9" max="5000"/></innerModel>'
    )
    assert rc(["sim", "offers", str(path)]) == 0
    told = capsys.readouterr()
    assert told.out == "offers imu : IMU, IMUPub;\n"
    assert told.err.splitlines() == [
        f"2 warnings about {path}; to read: rc lint {path}",
        "not provided yet: laser without `measures`: front",
    ]


def test_devices_that_are_not_provided_yet_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "room.xml"
    path.write_text(SCENE.replace('<laser id="off"/>', '<laser id="off"/><pointcloud id="cloud"/>'))
    assert rc(["sim", "new", str(path), "-o", str(tmp_path / "house")]) == 0
    assert "not provided yet: laser without `measures`: off\n" in capsys.readouterr().out


def test_meshes_without_a_file_are_told_when_a_component_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "room.xml"
    path.write_text(SCENE.replace('<laser id="off"/>', '<mesh id="cup" file="cup.obj"/><mesh id="dish"/>'))
    assert rc(["sim", "new", str(path), "-o", str(tmp_path / "house")]) == 0
    said = capsys.readouterr().out
    told = (
        "no such file: cup.obj, (none) of `dish`; `without_meshes = true` in its etc/config.toml leaves such meshes out"
    )
    assert f"{told}\n" in said


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<innerModel>\n  <lazer id='a'/>\n</innerModel>", "room.xml:2:3: unknown tag <lazer>; did you mean <laser>?"),
        (None, "room.xml:1:1: the file cannot be read: there is no such file; set the parameter `scene` to the file"),
        (SCENE.replace('measures="2"', 'measures="2" min="9000"'), "room.xml:5:40: `front`: `min` is 9000, not less"),
        (SCENE.replace('id="front"', 'id="front laser"'), "room.xml:5:40: `front laser`: the id of a device names an"),
        (SCENE.replace("<laser", "<mesh id='cup' file='cup.obj'/><laser", 1), "room.xml:5:40: `cup`: there is no file"),
    ],
)
def test_a_component_tells_what_is_wrong_with_its_scene(
    text: str | None, told: str, plain: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scene = tmp_path / "room.xml"
    if text is not None:
        scene.write_text(text)
    with ComponentTest(load_component(plain), {"params.scene": str(scene)}, virtual=True) as house:
        pass
    assert not house.fine
    [record] = [each for each in caplog.records if each.levelname == "ERROR"]
    assert told in record.message
    assert "Traceback" not in caplog.text


def test_a_component_names_the_settings_that_leave_out_missing_meshes_and_has_them(
    plain: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scene = tmp_path / "room.xml"
    scene.write_text(SCENE.replace("<laser", "<mesh id='cup'/><laser", 1))
    with ComponentTest(load_component(plain), {"params.scene": str(scene)}, virtual=True) as house:
        pass
    [told] = [each.message for each in caplog.records if each.levelname == "ERROR"]
    assert "`cup`: the mesh has no `file`; mend the path, or leave such meshes out: " in told
    assert "`without_meshes = true` below `[params]`" in told
    assert f"in a network `--set {house.worker.instance}.params.without_meshes=true`" in told
    [assignment] = re.findall(r"`--set (params\.\S+)`", told)
    key, _, value = assignment.partition("=")
    settings = {"params.scene": str(scene), key: value == "true"}
    with ComponentTest(load_component(plain), settings, virtual=True) as house:
        assert "cup" in house.worker.world.tree
    assert house.fine


@pytest.mark.parametrize(
    ("text", "folder", "said"),
    [
        ('<innerModel><lazer id="a"/></innerModel>', "house", "unknown tag"),
        ('<innerModel><transform id="a"/></innerModel>', "house", "no device that can be provided"),
        (SCENE.replace('measures="2"', 'measures="2" min="6000"'), "house", "`min` is 6000, not less than `max`"),
        (SCENE.replace('measures="2"', 'measures="2" min="-1"'), "house", "room.xml:5:40: `front`: `min` is negative"),
        (
            SCENE.replace('<laser id="off"/>', '<joint id="off" min="2" max="1"/>'),
            "house",
            "`min` is 2, more than `max`",
        ),
        (SCENE.replace('"front"', '"front laser"'), "house", "`front laser`: the id of a device names an instance"),
        (SCENE, "two words", "is not a component name"),
        (SCENE, "class", "is a Python keyword"),
        (SCENE, "numpy", "has the name of a library"),
        (SCENE, "full", "exists and is not an empty folder"),
    ],
)
def test_a_component_that_cannot_be_is_refused(
    text: str, folder: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "room.xml"
    path.write_text(text)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "diary.txt").touch()
    assert rc(["sim", "new", str(path), "-o", str(tmp_path / folder)]) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / folder / "specificworker.py").exists()


def test_a_scene_that_is_not_there_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["sim", "offers", str(tmp_path / "none.xml")]) == 1
    assert "there is no such file" in capsys.readouterr().err


def test_the_folder_of_a_component_is_no_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "room").mkdir()
    assert rc(["sim", "offers", str(tmp_path / "room")]) == 1
    assert capsys.readouterr().err.endswith("/room: it is a folder\n")
    (tmp_path / "room.xml").touch()
    assert rc(["sim", "offers", str(tmp_path / "room")]) == 1
    assert f"it is a folder; did you mean `{tmp_path / 'room.xml'}`?" in capsys.readouterr().err


@pytest.mark.parametrize("action", ["new", "offers"])
def test_a_misspelt_scene_is_told_with_a_similar_one(
    action: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "room.xml").touch()
    assert rc(["sim", action, str(tmp_path / "roo.xml")]) == 1
    assert f"roo.xml: there is no such file; did you mean `{tmp_path / 'room.xml'}`?" in capsys.readouterr().err


def test_a_misspelt_offer_names_the_device_that_may_be_meant(plain: Path, caplog: pytest.LogCaptureFixture) -> None:
    declared = {"offers.frnt.Laser.middleware": "zeromq", "offers.still.Laser.middleware": "zeromq"}
    with ComponentTest(
        load_component(plain), {"params.scene": str(plain.parent / "room.xml")} | declared, virtual=True
    ) as house:
        for name in ("a", "b"):  # after an edit, the same is not told again
            tree = house.worker.world.tree.copy()
            tree.add("world", "plane", name)
            house.worker.world.change(tree)
            house.worker.settle()
    told = [each.getMessage() for each in caplog.records if "offers frnt" in each.getMessage()]
    assert len(told) == 1
    assert told[0] == "the network declares `offers frnt : Laser`: unknown Laser `frnt`; did you mean `front`?"


def test_what_the_network_does_not_declare_is_told_once(plain: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "robocomp.sim")
    declared = {"offers.still.Laser.middleware": "zeromq"}
    with ComponentTest(
        load_component(plain), {"params.scene": str(plain.parent / "room.xml")} | declared, virtual=True
    ):
        pass
    [told] = [each.getMessage() for each in caplog.records if "does not declare" in each.getMessage()]
    assert told.startswith("the network does not declare base/DifferentialRobot, chair/DifferentialRobot, ")
    assert told.endswith("; `rc sim offers` prints the lines")


def test_tags_whose_ids_are_checked_are_those_of_devices() -> None:
    assert set(INTERFACES) == DEVICES
