"""The page of a scene that runs, visited by a program."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robocomp_py import connect
from robocomp_py.cli.rc import main as rc
from robocomp_py.client.session import NotThere, Session
from robocomp_py.runtime.load import load_worker
from robocomp_py.sim.view.live import LiveShow, chosen
from robocomp_py.sim.view.page import Page
from robocomp_py.testing.patience import SOON
from robocomp_py.tools.network import Network
from robocomp_py.transports.base import find_transport
from tests.runtime.running import make, running
from tests.sim.view.visitor import Visitor, visiting

SCENE = """\
<innerModel>
  <transform id="world">
    <differentialrobot id="base"><plane id="body" size="400,400,400" texture="#3366aa"/></differentialrobot>
    <plane id="wall" pz="2000" size="3000,1000,10"/>
    <pointcloud id="seen"/>
  </transform>
</innerModel>
"""


@contextmanager
def followed(show: LiveShow) -> Iterator[None]:
    is_ended = threading.Event()
    thread = threading.Thread(target=show.follow, args=(is_ended,), name="show")
    thread.start()
    try:
        yield
    finally:
        is_ended.set()
        thread.join()


def body(visitor: Visitor) -> Any:
    """Where the base is on the page."""
    (found,) = (each for each in visitor.shown("Box") if each["dimensions"][0] == 0.4)
    return found["where"][:3, 3]


def test_a_running_scene_is_shown_as_it_goes_on(tmp_path: Path) -> None:
    (tmp_path / "room.xml").write_text(SCENE)
    assert rc(["sim", "new", str(tmp_path / "room.xml"), "-o", str(tmp_path / "house")]) == 0
    told: list[str] = []
    session = Session("", ("shm",), SOON)
    with (
        running(make(load_worker(tmp_path / "house"), find_transport, "middleware=shm", name="house")),
        connect(middleware="shm") as net,
        Page("house") as page,
    ):
        house = net.wait("house", SOON)
        assert chosen(session.census()) == "house"
        show = LiveShow(page, session, "house", told.append)
        with followed(show), visiting(page.url) as visitor:
            visitor.awaits(lambda: len(visitor.shown("Box")) == 2)
            assert body(visitor) == pytest.approx((0, 0, 0))
            # it moves
            house.InnerModelManager.setPose("root", "base", (1000, 0, 500, 0, 0, 0))
            visitor.awaits(lambda: body(visitor) == pytest.approx((0.5, -1, 0)))
            visitor.awaits(lambda: "real time" in visitor.value("time"))
            # a node is added, and its true pose is told
            box = {"px": 0, "py": 0, "pz": 0, "nx": 0, "ny": 0, "nz": 1, "width": 70, "height": 70, "thickness": 70}
            house.InnerModelManager.addPlane("crate", "base", {**box, "texture": ""})
            visitor.awaits(lambda: any(each["dimensions"][0] == 0.07 for each in visitor.shown("Box")))
            crate = next(each for each in visitor.shown("Box") if each["dimensions"][0] == 0.07)
            assert crate["where"][:3, 3] == pytest.approx((0.5, -1, 0))
            visitor.click(crate["name"])
            visitor.awaits(lambda: "at 1000, 0, 500 mm" in visitor.value("node"))
            assert visitor.value("node").splitlines()[:2] == ["plane crate", "in base"]
            house.InnerModelManager.setPose("root", "base", (1200, 0, 500, 0, 0, 0))
            visitor.awaits(lambda: "at 1200, 0, 500 mm" in visitor.value("node"))
            # points are set, and set again
            point = {"x": 100, "y": 0, "z": 200, "r": 255, "g": 0, "b": 9}
            house.InnerModelManager.setPointCloudData("seen", [point])
            visitor.awaits(lambda: visitor.shown("PointCloud"))
            (cloud,) = visitor.shown("PointCloud")
            assert cloud["points"].tolist() == pytest.approx([0.2, -0.1, 0.0])
            assert cloud["colors"].tolist() == [255, 0, 9]
            more = {**point, "y": 300}, {**point, "x": float("nan")}
            house.InnerModelManager.setPointCloudData("seen", [point, *more])
            visitor.awaits(lambda: [len(each["points"]) for each in visitor.shown("PointCloud")] == [6])
            house.InnerModelManager.setPointCloudData("seen", [])
            visitor.awaits(lambda: not visitor.shown("PointCloud"))
            house.Simulation.pause()
            visitor.awaits(lambda: "stands still" in visitor.value("time"))
    session.close()
    assert told == []


def test_it_is_told_if_nothing_simulates() -> None:
    with pytest.raises(NotThere, match="no component that is ready simulates a scene; `rc sim new` writes one"):
        chosen(Network([]))
