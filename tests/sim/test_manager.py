"""The scene of a simulating component is asked and edited by InnerModelManager."""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py import connect
from robocomp_py.cli.rc import main as rc
from robocomp_py.contract.component import Port
from robocomp_py.errors import DeclaredError, RemoteFailure
from robocomp_py.sim.editing import MOST_NOTES
from robocomp_py.testing.components import ComponentTest, load_component
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import find_transport

from ..runtime.running import make, running
from .scenes import WEDGE, room_with

SCENE = room_with('<rotation id="tilt"/>')


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("manager")
    (folder / "room.xml").write_text(SCENE)
    (folder / "wedge.obj").write_text(WEDGE)
    assert rc(["sim", "new", str(folder / "room.xml"), "-o", str(folder / "house")]) == 0
    return folder / "house"


@pytest.fixture
def house(folder: Path) -> Iterator[ComponentTest]:
    with ComponentTest(load_component(folder), virtual=True) as component:
        yield component
    assert component.fine


def call(house: ComponentTest, operation: str, *arguments: object) -> Any:
    return house.call(f"InnerModelManager.{operation}", *arguments)


def made(house: ComponentTest, name: str, **values: object) -> Any:
    package = type(house.worker).__module__.rpartition(".")[0]
    return getattr(importlib.import_module(f"{package}.generic.RoboCompInnerModelManager"), name)(**values)


def pose(house: ComponentTest, *numbers: float) -> Any:
    return made(house, "Pose3D", **dict(zip(("x", "y", "z", "rx", "ry", "rz"), numbers, strict=False)))


def plane(house: ComponentTest, **values: float | str) -> Any:
    return made(house, "Plane3D", **{"width": 100.0, "height": 100.0, "thickness": 10.0, **values})


def scan(house: ComponentTest) -> list[float]:
    return [each.dist for each in house.worker.laser["front"].getLaserData()]


def tick(house: ComponentTest) -> None:
    house.call("Simulation.step", 1)


def numbers(value: Any) -> tuple[float, ...]:
    return dataclasses.astuple(value)


def test_the_next_scan_sees_edits_together(house: ComponentTest) -> None:
    assert call(house, "addTransform", "shelf", "static", "world", pose(house, 1000, 300))
    assert call(house, "addPlane", "board", "shelf", plane(house, nx=1.0))
    assert scan(house)[0] == pytest.approx(1995)
    tick(house)
    assert scan(house)[0] == pytest.approx(995)
    assert call(house, "setPlane", "board", plane(house, px=100.0, nx=1.0, thickness=50.0))
    assert call(house, "setPoseFromParent", "shelf", pose(house, 500, 300))
    tick(house)
    assert scan(house)[0] == pytest.approx(575)
    assert call(house, "removeNode", "shelf")
    tick(house)
    assert scan(house)[0] == pytest.approx(1995)


def test_state_is_kept(house: ComponentTest) -> None:
    house.worker.differentialrobot["base"].setSpeedBase(200.0, 0.1)
    house.call("Simulation.step", 20)
    before = call(house, "getPose", "world", "mount")
    assert call(house, "addPlane", "board", "world", plane(house, pz=4000.0))
    assert call(house, "getPose", "world", "mount") == before
    tick(house)
    house.call("Simulation.step", 19)
    assert call(house, "getPose", "root", "base")[1].z == pytest.approx(2 * before[1].z, rel=1e-3)
    assert house.worker.differentialrobot["base"].getBaseState().advVz == 200


def test_poses_are_set_and_asked_from_anywhere(house: ComponentTest) -> None:
    call(house, "setPoseFromParent", "stand", pose(house, 1500, 0, 0, 0, 0.5))
    call(house, "setPose", "stand", "base", pose(house, 0, 0, -1000, 0, 0.25))
    assert numbers(call(house, "getPose", "stand", "base")[1]) == pytest.approx((0, 0, -1000, 0, 0.25, 0), abs=1e-3)
    call(house, "setPose", "mount", "pan", pose(house, 10, 20, 30, 0.1, 0.2, 0.3))
    tick(house)
    assert numbers(call(house, "getPose", "mount", "pan")[1]) == pytest.approx((10, 20, 30, 0.1, 0.2, 0.3), abs=1e-3)
    assert numbers(call(house, "getPoseFromParent", "mount")[1]) == pytest.approx((0, 300, 0, 0, 0, 0), abs=1e-3)
    point = made(house, "coord3D", x=1.0, y=2.0, z=3.0)
    there = call(house, "transform", "stand", "base", point)[1]
    matrix = call(house, "getTransformationMatrix", "stand", "base")
    assert (matrix.rows, matrix.cols) == (4, 4)
    assert (matrix.data.reshape(4, 4) @ (1, 2, 3, 1))[:3] == pytest.approx(numbers(there), abs=1e-3)


def test_a_reset_undoes_edits(house: ComponentTest) -> None:
    first = house.worker.world.tree.text()
    call(house, "removeNode", "base")
    call(house, "addPlane", "board", "world", plane(house))
    call(house, "addAttribute", "world", "note", "string", "text")
    tick(house)
    assert not house.worker.laser
    call(house, "removeNode", "board")  # takes effect with the next tick, which does not come
    house.call("Simulation.reset", 1)
    assert house.worker.world.tree.text() == first
    assert list(house.worker.laser) == ["front"]
    with pytest.raises(Exception, match="unknown attribute `note`"):
        call(house, "getAttribute", "world", "note")


def test_joints_come_and_go_with_their_motors(house: ComponentTest) -> None:
    joint = made(house, "jointType", pose=pose(house), min=0.5, max=1.0, axis="x", port=7)
    call(house, "addJoint", "nod", "pan", joint)
    tick(house)
    states = house.worker.jointmotor["joints7"].getAllMotorState()
    assert {name: state.pos for name, state in states.items()} == {"pan": 0, "nod": 0.5}
    call(house, "removeNode", "pan")
    tick(house)
    assert list(house.worker.jointmotor) == []


def test_a_mesh_is_added_and_scaled_and_collides(house: ComponentTest, folder: Path) -> None:
    mesh = made(house, "meshType", pose=pose(house, 1000, 0, 100), scaleX=1.0, scaleY=1.0, scaleZ=1.0)
    mesh.meshPath = str(folder.parent / "wedge.obj")
    call(house, "addMesh", "wedge", "world", mesh)
    assert not call(house, "collide", "wedge", "stand")
    call(house, "setScale", "wedge", 11.0, 1.0, 1.0)
    assert call(house, "collide", "wedge", "stand")
    call(house, "moveNode", "wedge", "tilt")
    assert call(house, "getPoseFromParent", "wedge")[1].x == 1000


def test_notes_and_nodes_are_listed(house: ComponentTest) -> None:
    assert call(house, "addAttribute", "wall", "colour", "string", "red")
    assert call(house, "setAttribute", "wall", "colour", "string", "blue")
    assert call(house, "getAttribute", "wall", "colour") == (True, "string", "blue")
    found = {each.id: each for each in call(house, "getAllNodeInformation")}
    assert (found["wall"].parentId, found["wall"].nType.name) == ("stand", "Plane")
    assert found["wall"].attributes["colour"].value == "blue"
    assert found["front"].nType.name == "Laser"
    assert (found["root"].parentId, found["root"].nType.name) == ("", "Transform")
    assert call(house, "removeAttribute", "wall", "colour")
    assert house.call("Simulation.cloud", "cloud", 0).version == 0
    points = [made(house, "Colored3DPoint", x=1.0, r=255), made(house, "Colored3DPoint", z=2.0)]
    call(house, "setPointCloudData", "cloud", points)
    cloud = house.call("Simulation.cloud", "cloud", 0)
    assert (list(cloud.points), list(cloud.colours)) == ([1, 0, 0, 0, 0, 2], [255, 0, 0, 0, 0, 0])
    known = house.call("Simulation.cloud", "cloud", cloud.version)
    assert (known.version, len(known.points)) == (cloud.version, 0)
    with pytest.raises(Exception, match="unknown pointcloud `wall`; known: cloud"):
        house.call("Simulation.cloud", "wall", 0)


def test_a_node_that_is_removed_is_no_longer_provided(house: ComponentTest, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "robocomp.sim")
    call(house, "removeNode", "mount")
    house.wait_for_computes(2)
    assert [each.getMessage() for each in caplog.records] == ["an edit has removed front/Laser, front/LaserPub"]
    assert list(house.worker.laser) == []
    assert list(house.worker.differentialrobot) == ["base"]


def test_a_device_that_comes_back_while_it_is_removed_is_provided(folder: Path) -> None:
    class Interrupted(load_component(folder)):  # type: ignore[misc]  # its class is found at run time
        """A removal of a laser waits until its calls are answered; meanwhile, another client resets the scene."""

        def _withdraw(self, port: Port, name: str) -> None:
            super()._withdraw(port, name)
            if port.interface.short == "Laser":
                self.Simulation_reset(1)

    with ComponentTest(Interrupted, {"params.scene": str(folder.parent / "room.xml")}, virtual=True) as house:
        call(house, "removeNode", "mount")
        tick(house)
        assert list(house.worker.laser) == list(house.worker.laserpub) == ["front"]
        assert len(scan(house)) == 2
    assert house.fine


MISTAKES: list[tuple[str, str, tuple[Any, ...], str]] = [
    ("NonExistingNode", "getPose", ("world", "stan"), "did you mean `stand`?"),
    ("NonExistingNode", "moveNode", ("stand", "nowhere"), "unknown node `nowhere`"),
    ("NonExistingNode", "removeNode", ("nothing",), "unknown node"),
    ("NonExistingNode", "addPlane", ("a", "nowhere", "plane"), "unknown node `nowhere`"),
    ("NonExistingAttribute", "getAttribute", ("wall", "colour"), "unknown attribute `colour`"),
    ("NonExistingAttribute", "setAttribute", ("wall", "colour", "string", "red"), "unknown attribute"),
    ("NonExistingAttribute", "removeAttribute", ("wall", "colour"), "unknown attribute"),
    ("NodeAlreadyExists", "addTransform", ("stand", "static", "world", "pose"), "there is a `stand` already"),
    ("InvalidPath", "addMesh", ("cup", "world", "mesh"), "there is no file `cup.obj`"),
    ("InvalidEngine", "addTransform", ("box", "ode", "world", "pose"), "it is `static` or `bullet`"),
    ("InvalidValues", "setPoseFromParent", ("stand", "nan"), "nan is no length"),
    ("InvalidValues", "setPoseFromParent", ("tilt", "shifted"), "cannot be moved"),
    ("InvalidValues", "addTransform", ("", "static", "world", "pose"), "'' is no id"),
    ("InvalidValues", "addPlane", ("a", "world", "flat"), "more than 0 each"),
    ("InvalidValues", "addPlane", ("a", "world", "dressed"), "`texture` has characters that no XML file can have"),
    ("InvalidValues", "setPlane", ("wall", "dressed"), "`texture` has characters that no XML file can have"),
    ("InvalidValues", "addJoint", ("a", "world", "joint"), "`port` is a whole number of at most 65535, not `99999`"),
    ("InvalidValues", "transform", ("world", "base", "point"), "nan is no length"),
    ("OperationInvalidNode", "addTransform", ("a", "static", "wall", "pose"), "has no children"),
    ("OperationInvalidNode", "setPlane", ("stand", "plane"), "not a plane"),
    ("OperationInvalidNode", "setScale", ("wall", 1.0, 1.0, 1.0), "not a mesh"),
    ("OperationInvalidNode", "setPoseFromParent", ("front", "pose"), "has no pose of its own"),
    ("OperationInvalidNode", "removeNode", ("world",), "`world` stays"),
    ("OperationInvalidNode", "moveNode", ("base", "mount"), "`mount` is below `base`"),
    ("Collision", "setPoseFromParent", ("stand", "shifted"), "`body` would be"),
    ("Collision", "setPose", ("stand", "base", "pose"), "deep in `wall`"),
]


def test_what_cannot_be_is_refused_with_its_code_and_changes_nothing(house: ComponentTest) -> None:
    values = {
        "pose": pose(house),
        "nan": pose(house, math.nan),
        "shifted": pose(house, 100),
        "plane": plane(house),
        "flat": plane(house, height=0.0),
        "dressed": plane(house, texture="\x01"),
        "joint": made(house, "jointType", pose=pose(house), min=0.0, max=1.0, axis="x", port=99999),
        "point": made(house, "coord3D", x=math.nan),
        "mesh": made(house, "meshType", scaleX=1.0, scaleY=1.0, scaleZ=1.0, meshPath="cup.obj"),
    }
    tick(house)
    before, nodes = house.worker.world.digest(), call(house, "getAllNodeInformation")
    for code, operation, arguments, text in MISTAKES:
        with pytest.raises(Exception, match=r".") as refused:
            call(house, operation, *(values.get(each, each) if isinstance(each, str) else each for each in arguments))
        error: Any = refused.value
        assert (operation, type(error).__name__, error.err.name) == (operation, "InnerModelManagerError", code)
        assert text in error.text
    assert call(house, "getAllNodeInformation") == nodes
    house.worker.settle()
    assert house.worker.world.digest() == before


def test_an_attribute_is_added_once(house: ComponentTest) -> None:
    call(house, "addAttribute", "wall", "colour", "string", "red")
    with pytest.raises(Exception, match=r"has an attribute `colour` already") as refused:
        call(house, "addAttribute", "wall", "colour", "string", "red")
    assert refused.value.err.name == "AttributeAlreadyExists"  # type: ignore[attr-defined]


def test_a_node_has_no_more_attributes_than_that(house: ComponentTest) -> None:
    for number in range(MOST_NOTES):
        call(house, "addAttribute", "wall", f"note{number}", "string", "")
    with pytest.raises(Exception, match=r".") as refused:
        call(house, "addAttribute", "wall", "colour", "string", "red")
    error: Any = refused.value
    assert (error.err.name, error.text) == ("InternalError", "`wall` has 1000 attributes, and cannot have more")
    assert call(house, "removeAttribute", "wall", "note7")
    assert call(house, "addAttribute", "wall", "colour", "string", "red")


def test_a_scene_that_can_no_longer_be_simulated_is_left_as_it_was(house: ComponentTest, folder: Path) -> None:
    """A mesh that was there when it was added, and is gone when it takes effect."""
    tick(house)
    before, path = house.worker.world.digest(), folder.parent / "brief.obj"
    path.write_text(WEDGE)
    mesh = made(house, "meshType", scaleX=1.0, scaleY=1.0, scaleZ=1.0, meshPath="brief.obj")
    assert call(house, "addMesh", "cup", "world", mesh)
    path.unlink()
    with pytest.raises(Exception, match=r".") as refused:
        call(house, "getPose", "world", "base")
    error: Any = refused.value
    assert error.err.name == "InternalError"
    assert "`cup`: there is no file `brief.obj`" in error.text
    assert "cup" not in {each.id for each in call(house, "getAllNodeInformation")}
    assert call(house, "getPose", "world", "base")[0]
    assert house.worker.world.digest() == before


def test_calls_that_declare_no_error_fail_with_a_text(house: ComponentTest, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(RemoteFailure, match="ArgumentError: unknown node `nothing`"):
        call(house, "collide", "nothing", "wall")
    with pytest.raises(RemoteFailure, match=r"ArgumentError: .*not a pointcloud"):
        call(house, "setPointCloudData", "wall", [])
    told = [each.getMessage() for each in caplog.records]
    assert [each.count("\n") for each in told] == [0, 0]
    assert told[1] == "Managed.InnerModelManager_setPointCloudData refused: `wall` is a plane, not a pointcloud"


def test_another_component_edits_the_scene_over_a_middleware(folder: Path) -> None:
    worker = load_component(folder)
    with running(make(worker, find_transport, "middleware=shm", name="manor")), connect(middleware="shm") as net:
        manager, laser = net.wait("manor/InnerModelManager", SOON), net.wait("front/Laser", SOON)
        plane = (1000.0, 0.0, 0.0, 1.0, 0.0, 0.0, 900.0, 900.0, 10.0, "")
        assert manager.addPlane("screen", "world", plane)
        wait_until(lambda: abs(laser.getLaserData()[0].dist - 995) < 1)
        with pytest.raises(DeclaredError, match="there is a `screen` already"):
            manager.addPlane("screen", "world", plane)
