"""Another component makes all calls of InnerModelManager: the scene is simulated by a process of its own.

Edits take effect with `Simulation.step`: the period of the simulating component is longer than these tests.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.errors import RemoteFailure
from robocomp_py.testing.components import load_component
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import find_transport

from ..leftovers import killed_on_failure
from ..runtime.running import make, running
from .scenes import WEDGE, room_with

SCENE = room_with(
    '<transform id="shelf" tz="-3000"/>',
    '<mesh id="ramp" file="wedge.obj" tx="-3000"/>',
    '<translation id="corner" tz="-9000"><camera id="eye" width="4" height="2" focal="2"/></translation>',
)
VISITOR = """\
import "InnerModelManager.idsl";
import "Simulation.idsl";
import "JointMotor.idsl";
import "Laser.idsl";
import "CameraSimple.idsl";

Component visitor
{
    Communications { requires InnerModelManager, Simulation, JointMotor, Laser, CameraSimple; };
    language python;
};
"""
DEVICES = ("ports.jointmotor.from=joints7", "ports.laser.from=front", "ports.camerasimple.from=eye")


class Visitor:
    """The other component: its proxies, and the classes that were generated for it."""

    def __init__(self, worker: Any, folder: Path) -> None:
        self.worker, self.folder = worker, folder
        self.manager = worker.innermodelmanager_proxy
        package = type(worker).__module__.rpartition(".")[0]
        self.types: Any = importlib.import_module(f"{package}.generic.RoboCompInnerModelManager")

    def pose(self, *numbers: float) -> Any:
        return self.types.Pose3D(**dict(zip(("x", "y", "z", "rx", "ry", "rz"), numbers, strict=False)))

    def box(self, **values: Any) -> Any:
        return self.types.Plane3D(**{"width": 100.0, "height": 100.0, "thickness": 10.0, **values})

    def mesh(self, file: str) -> Any:
        return self.types.meshType(pose=self.pose(), scaleX=1.0, scaleY=1.0, scaleZ=1.0, meshPath=file)

    def joint(self, axis: str, port: int = 7) -> Any:
        return self.types.jointType(pose=self.pose(0, 100), min=0.5, max=1.0, axis=axis, port=port)

    def where(self, item: str, base: str = "world") -> tuple[float, ...]:
        found, pose = self.manager.getPose(base, item)
        assert found
        return dataclasses.astuple(pose)

    def nodes(self) -> dict[str, Any]:
        return {each.id: each for each in self.manager.getAllNodeInformation()}

    def step(self) -> None:
        """Let edits take effect."""
        self.worker.simulation_proxy.step(1)

    def scan(self) -> float:
        """What the laser measures to the right, in the tick after this, mm."""
        self.step()
        return float(self.worker.laser_proxy.getLaserData()[0].dist)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("calls")
    (made / "room.xml").write_text(SCENE)
    (made / "wedge.obj").write_text(WEDGE)
    (made / "visitor.cdsl").write_text(VISITOR)
    assert rc(["sim", "new", str(made / "room.xml"), "-o", str(made / "house")]) == 0
    assert rcgen([str(made / "visitor.cdsl"), "-o", str(made / "visitor")]) == 0
    return made


@contextmanager
def visiting(folder: Path, middleware: str) -> Iterator[Visitor]:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(folder / "house"), "--middleware", middleware]
    command += ["--set", "component.period=3600"]
    environment = os.environ | {"ROBOCOMP_COLOR": "never"}
    with killed_on_failure(command, stderr=subprocess.PIPE, text=True, env=environment) as house:
        assert house.stderr
        try:
            said = iter(house.stderr.readline, "")
            assert any("ready" in line for line in said)
            worker = load_component(folder / "visitor")
            with running(make(worker, find_transport, f"middleware={middleware}", *DEVICES)) as visitor:
                yield Visitor(visitor, folder)
        finally:
            house.terminate()
            house.communicate(timeout=SOON * 3)
    assert house.returncode == 143


@pytest.fixture(scope="module")
def visitor(folder: Path) -> Iterator[Visitor]:
    with visiting(folder, "zeromq") as made:
        yield made


CALLS: dict[str, Callable[[Visitor], None]] = {}
"""By the name of a call: makes it, shows what has become of it, and leaves the scene as it was."""


def call(shows: Callable[[Visitor], None]) -> Callable[[Visitor], None]:
    CALLS[shows.__name__] = shows
    return shows


@call
def addTransform(v: Visitor) -> None:
    assert v.manager.addTransform("tray", "static", "shelf", v.pose(100, 0, 0, 0, 0.5))
    assert v.manager.addTransform("ball", "bullet", "world", v.pose(0, 0, 4000)) is True
    assert v.where("tray") == pytest.approx((100, 0, -3000, 0, 0.5, 0), abs=1e-3)
    assert v.where("ball")[2] == pytest.approx(4000)
    assert v.manager.removeNode("tray")
    assert v.manager.removeNode("ball")


@call
def addJoint(v: Visitor) -> None:
    assert v.manager.addJoint("nod", "pan", v.joint("x"))
    v.step()
    states = v.worker.jointmotor_proxy.getAllMotorState()
    assert {name: state.pos for name, state in states.items()} == {"pan": 0, "nod": 0.5}
    assert v.where("nod", "pan") == pytest.approx((0, 100, 0, 0.5, 0, 0), abs=1e-3)
    assert v.manager.removeNode("nod")


@call
def addMesh(v: Visitor) -> None:
    assert v.manager.addMesh("wedge", "stand", v.mesh("wedge.obj"))
    assert v.nodes()["wedge"].nType.name == "Mesh"
    assert v.manager.collide("wedge", "wall")
    assert v.manager.removeNode("wedge")


@call
def addPlane(v: Visitor) -> None:
    assert v.scan() == pytest.approx(1995)
    assert v.manager.addPlane("board", "stand", v.box(px=-1000.0, py=300.0, nx=1.0))
    assert v.scan() == pytest.approx(995)
    assert v.manager.removeNode("board")
    assert v.scan() == pytest.approx(1995)


@call
def getAllNodeInformation(v: Visitor) -> None:
    nodes = v.nodes()
    assert (nodes["root"].parentId, nodes["root"].nType.name) == ("", "Transform")
    assert (nodes["wall"].parentId, nodes["wall"].nType.name) == ("stand", "Plane")
    assert (nodes["base"].nType.name, nodes["front"].nType.name) == ("DifferentialRobot", "Laser")
    assert all(each.parentId in nodes for each in nodes.values() if each.id != "root")


@call
def setPose(v: Visitor) -> None:
    assert v.manager.setPose("stand", "shelf", v.pose(10, 20, 30, 0.1, 0.2, 0.3))
    assert v.where("shelf") == pytest.approx((2010, 20, 30, 0.1, 0.2, 0.3), abs=1e-3)
    assert v.manager.setPose("world", "shelf", v.pose(0, 0, -3000))


@call
def setPoseFromParent(v: Visitor) -> None:
    assert v.manager.setPoseFromParent("stand", v.pose(1500))
    assert v.scan() == pytest.approx(1495)
    assert v.manager.setPoseFromParent("stand", v.pose(2000))


@call
def getPose(v: Visitor) -> None:
    assert v.manager.getPose("stand", "mount") == (True, v.pose(-2000, 300))


@call
def getPoseFromParent(v: Visitor) -> None:
    assert v.manager.getPoseFromParent("mount") == (True, v.pose(0, 300))


@call
def setPlane(v: Visitor) -> None:
    assert v.manager.setPlane("wall", v.box(nx=1.0, thickness=100.0, width=900.0, height=2000.0))
    assert v.scan() == pytest.approx(1950)
    assert v.manager.setPlane("wall", v.box(nx=1.0, thickness=10.0, width=900.0, height=2000.0, texture="#ff0000"))


@call
def transform(v: Visitor) -> None:
    seen, point = v.manager.transform("stand", "mount", v.types.coord3D(x=1.0, y=2.0, z=3.0))
    assert seen
    assert dataclasses.astuple(point) == pytest.approx((-1999, 302, 3))


@call
def getTransformationMatrix(v: Visitor) -> None:
    matrix = v.manager.getTransformationMatrix("stand", "mount")
    assert (matrix.rows, matrix.cols) == (4, 4)
    assert list(matrix.data) == [1, 0, 0, -2000, 0, 1, 0, 300, 0, 0, 1, 0, 0, 0, 0, 1]


@call
def setScale(v: Visitor) -> None:
    assert not v.manager.collide("ramp", "body")
    assert v.manager.setScale("ramp", 40.0, 1.0, 1.0)
    assert v.manager.collide("ramp", "body")
    assert v.manager.setScale("ramp", 1.0, 1.0, 1.0)


@call
def addAttribute(v: Visitor) -> None:
    assert v.manager.addAttribute("wall", "colour", "string", "red")
    note = v.nodes()["wall"].attributes["colour"]
    assert (note.type, note.value) == ("string", "red")
    assert v.manager.removeAttribute("wall", "colour")


@call
def removeAttribute(v: Visitor) -> None:
    assert v.manager.addAttribute("wall", "colour", "string", "red")
    assert v.manager.removeAttribute("wall", "colour")
    assert v.nodes()["wall"].attributes == {}


@call
def setAttribute(v: Visitor) -> None:
    assert v.manager.addAttribute("wall", "colour", "string", "red")
    assert v.manager.setAttribute("wall", "colour", "int", "3")
    assert v.manager.getAttribute("wall", "colour") == (True, "int", "3")
    assert v.manager.removeAttribute("wall", "colour")


@call
def getAttribute(v: Visitor) -> None:
    assert v.manager.addAttribute("wall", "built", "year", "1926")
    assert v.manager.getAttribute("wall", "built") == (True, "year", "1926")
    assert v.manager.removeAttribute("wall", "built")


@call
def removeNode(v: Visitor) -> None:
    assert v.manager.addTransform("tray", "static", "shelf", v.pose())
    assert v.manager.addPlane("plate", "tray", v.box())
    assert v.manager.removeNode("tray")
    assert not {"tray", "plate"} & v.nodes().keys()


@call
def moveNode(v: Visitor) -> None:
    assert v.manager.addTransform("tray", "static", "shelf", v.pose(100))
    assert v.manager.moveNode("tray", "stand")
    assert (v.nodes()["tray"].parentId, v.where("tray")[0]) == ("stand", pytest.approx(2100))
    assert v.manager.removeNode("tray")


@call
def collide(v: Visitor) -> None:
    assert v.manager.collide("body", "wall") is False
    assert v.manager.addPlane("crate", "stand", v.box(px=-40.0))
    assert v.manager.collide("crate", "wall") is True
    assert v.manager.removeNode("crate")


@call
def setPointCloudData(v: Visitor) -> None:
    point = v.types.Colored3DPoint
    v.manager.setPointCloudData("cloud", [point(x=1.0, r=255), point(z=2.0)])
    cloud = v.worker.simulation_proxy.cloud("cloud", 0)
    assert (list(cloud.points), list(cloud.colours)) == ([1, 0, 0, 0, 0, 2], [255, 0, 0, 0, 0, 0])
    v.manager.setPointCloudData("cloud", [])
    assert list(v.worker.simulation_proxy.cloud("cloud", 0).points) == []


def test_no_call_is_left_out(visitor: Visitor) -> None:
    operations = {each.name for each in visitor.types.INNERMODELMANAGER_INTERFACE.operations}
    assert operations == set(CALLS)
    assert len(operations) == 21


@pytest.mark.parametrize("name", CALLS)
def test_another_process_makes_the_call(name: str, visitor: Visitor) -> None:
    before = visitor.nodes()
    CALLS[name](visitor)
    assert visitor.nodes() == before


def brief(v: Visitor) -> None:
    """A mesh that is there when it is added, and gone when it takes effect."""
    path = v.folder / "brief.obj"
    path.write_text(WEDGE)
    assert v.manager.addMesh("cup", "world", v.mesh("brief.obj"))
    path.unlink()
    v.manager.getPose("world", "base")


def noted_twice(v: Visitor) -> None:
    try:
        v.manager.addAttribute("wall", "colour", "string", "red")
        v.manager.addAttribute("wall", "colour", "string", "blue")
    finally:
        v.manager.removeAttribute("wall", "colour")


ERRORS: dict[str, tuple[Callable[[Visitor], object], str]] = {
    "NonExistingNode": (lambda v: v.manager.getPose("world", "stan"), "did you mean `stand`?"),
    "NonExistingAttribute": (lambda v: v.manager.getAttribute("wall", "colour"), "unknown attribute `colour`"),
    "NodeAlreadyExists": (lambda v: v.manager.addPlane("stand", "world", v.box()), "there is a `stand` already"),
    "AttributeAlreadyExists": (noted_twice, "has an attribute `colour` already"),
    "InvalidPath": (lambda v: v.manager.addMesh("cup", "world", v.mesh("cup.obj")), "there is no file `cup.obj`"),
    "InvalidEngine": (lambda v: v.manager.addTransform("cup", "ode", "world", v.pose()), "`static` or `bullet`"),
    "InvalidValues": (lambda v: v.manager.setPoseFromParent("stand", v.pose(math.nan)), "nan is no length"),
    "OperationInvalidNode": (lambda v: v.manager.removeNode("world"), "`world` stays"),
    "InternalError": (brief, "`cup`: there is no file `brief.obj`"),
    "Collision": (lambda v: v.manager.setPoseFromParent("stand", v.pose(100)), "`body` would be"),
}


def test_no_error_is_left_out(visitor: Visitor) -> None:
    assert set(ERRORS) == set(visitor.types.ErrorType.__members__)
    assert len(ERRORS) == 10


@pytest.mark.parametrize("name", ERRORS)
def test_another_process_gets_the_error_as_its_own_class_and_nothing_has_changed(name: str, visitor: Visitor) -> None:
    before = visitor.nodes()
    does, text = ERRORS[name]
    with pytest.raises(visitor.types.InnerModelManagerError) as refused:
        does(visitor)
    assert refused.value.err is visitor.types.ErrorType[name]
    assert text in refused.value.text
    assert visitor.nodes() == before
    assert visitor.scan() == pytest.approx(1995)


def test_calls_that_declare_no_error_fail_with_a_text(visitor: Visitor) -> None:
    with pytest.raises(RemoteFailure, match="unknown node `stan`; did you mean `stand`"):
        visitor.manager.collide("stan", "body")
    with pytest.raises(RemoteFailure, match="not a pointcloud"):
        visitor.manager.setPointCloudData("wall", [])


def test_the_next_scan_and_collision_see_what_is_edited(visitor: Visitor) -> None:
    assert visitor.manager.addTransform("tray", "static", "world", visitor.pose(1000, 300))
    assert visitor.manager.addPlane("board", "tray", visitor.box(nx=1.0))
    assert not visitor.manager.collide("board", "wall")
    assert visitor.scan() == pytest.approx(995)
    assert visitor.manager.setPose("stand", "tray", visitor.pose(0, 300))
    assert visitor.manager.collide("board", "wall")
    assert visitor.scan() == pytest.approx(1995)
    assert visitor.manager.removeNode("tray")


@pytest.mark.tool
def test_the_next_picture_sees_what_is_edited(visitor: Visitor) -> None:
    """The camera is far behind the base, and looks ahead."""

    def greens() -> list[bool]:
        visitor.step()
        pixels = visitor.worker.camerasimple_proxy.getImage().image.reshape(2, 4, 3)
        return [bool(pixel.argmax() == 1 and pixel.max() > 0) for pixel in pixels[0]]

    before = greens()
    assert visitor.manager.addPlane(
        "board", "corner", visitor.box(pz=1000.0, nz=-1.0, width=9000.0, height=9000.0, texture="#00ff00")
    )
    assert greens() == [True] * 4
    assert visitor.manager.removeNode("board")
    assert greens() == before != [True] * 4


def test_calls_and_errors_pass_another_middleware(folder: Path) -> None:
    with visiting(folder, "zenoh") as visitor:
        for name in ("addPlane", "addJoint", "getAllNodeInformation", "getTransformationMatrix", "setPointCloudData"):
            CALLS[name](visitor)
        for name, (does, _) in ERRORS.items():
            with pytest.raises(visitor.types.InnerModelManagerError) as refused:
                does(visitor)
            assert refused.value.err is visitor.types.ErrorType[name]
