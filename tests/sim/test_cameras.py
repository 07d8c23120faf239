"""The cameras and displays of a scene: what clients of a simulating component see."""

from __future__ import annotations

import importlib
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.sim.render import View
from robocomp_py.sim.serve import studio
from robocomp_py.testing.components import ComponentTest, load_component

SCENE = """\
<innerModel>
  <transform id="world">
    <plane id="ahead" pz="3000" nz="-1" size="9000,9000,0.002" texture="#00ff00"/>
    <display id="screen" pz="2000" px="1000" nz="-1" size="1800,9000,0.002" texture="#ff0000"/>
    <differentialrobot id="base" port="10004">
      <joint id="neck" axis="x" port="10067">
        <rgbd id="eye" width="12" height="8" focal="6" ifconfig="10067,10004"/>
      </joint>
    </differentialrobot>
    <camera id="corner" width="4" height="2" focal="2"/>
    <camera id="off"/>
  </transform>
</innerModel>
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("cameras")
    (made / "room.xml").write_text(SCENE)
    assert rc(["sim", "new", str(made / "room.xml"), "-o", str(made / "house")]) == 0
    return made


@pytest.fixture(scope="module")
def house(folder: Path) -> Iterator[ComponentTest]:
    with ComponentTest(load_component(folder / "house"), virtual=True) as component:
        yield component
    assert component.fine


def call(house: ComponentTest, name: str, interface: str, operation: str, *arguments: object) -> Any:
    return getattr(getattr(house.worker, interface.lower())[name], operation)(*arguments)


def made(house: ComponentTest, module: str, name: str, *values: object) -> Any:
    """A struct of the component's own classes."""
    package = type(house.worker).__module__.rpartition(".")[0]
    return getattr(importlib.import_module(f"{package}.generic.{module}"), name)(*values)


def test_cameras_and_displays_are_offered(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["sim", "offers", str(folder / "room.xml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["eye"] == ["RGBD", "CameraRGBDSimple", "CameraRGBDSimplePub", "CameraSimple", "CameraSimplePub"]
    assert found["corner"] == ["CameraSimple", "CameraSimplePub"]
    assert found["screen"] == ["Display"]
    assert "off" not in found


def test_a_display_refuses_what_is_no_picture(house: ComponentTest) -> None:
    for values, text in (
        ((2, 2, 3, np.zeros(11, np.uint8)), "a picture of 2 x 2 pixels of 3 bytes has 11 bytes"),
        ((2, 2, 2, np.zeros(8, np.uint8)), "2 x 2 pixels of 2 bytes: it is 1, 3 or 4 bytes"),
        ((-2, -2, 3, np.zeros(12, np.uint8)), "-2 x -2 pixels"),
        ((3000, 1, 1, np.zeros(3000, np.uint8)), "at most 2048 rows and columns"),
    ):
        with pytest.raises(Exception, match=text) as refused:
            call(house, "screen", "Display", "setImage", made(house, "RoboCompDisplay", "Image", *values))
        assert type(refused.value).__name__ == "HardwareFailedException"
    with pytest.raises(Exception, match=r"none\.png: there is no picture"):
        call(house, "screen", "Display", "setImageFromFile", "none.png")


@pytest.mark.tool
def test_a_camera_is_asked_for_its_colours(house: ComponentTest) -> None:
    image = call(house, "corner", "CameraSimple", "getImage")
    assert (image.width, image.height, image.depth, image.compressed) == (4, 2, 3, False)
    pixels = image.image.reshape(2, 4, 3)
    assert pixels[0, 0].argmax() == 1  # the wall is green
    assert pixels[0, 3].argmax() == 0  # the screen on the right is red


@pytest.mark.tool
def test_an_rgbd_is_asked_for_colours_distances_and_points_in_metres(house: ComponentTest) -> None:
    everything = call(house, "eye", "CameraRGBDSimple", "getAll", "")
    image, depth, points = everything.image, everything.depth, everything.points
    assert (image.width, image.height, image.focalx, image.cameraID) == (12, 8, 6, 0)
    assert image.alivetime == depth.alivetime == points.alivetime == house.worker.now() // 1_000_000
    distances = depth.depth.view("<f4").reshape(8, 12)
    assert distances[:, 0] == pytest.approx(3.0, abs=1e-3)
    assert distances[:, 8] == pytest.approx(2.0, abs=1e-3)
    seen = points.points.reshape(8, 12)[1, 8]
    assert (seen["x"], seen["y"], seen["z"]) == pytest.approx((2.5 / 6 * 2, 2.5 / 6 * 2, 2.0), abs=1e-3)
    only = [call(house, "eye", "CameraRGBDSimple", each, "") for each in ("getImage", "getDepth", "getPoints")]
    assert (only[0].image == image.image).all()
    assert (only[1].depth == depth.depth).all()
    assert (only[2].points == points.points).all()


@pytest.mark.tool
def test_an_rgbd_is_asked_for_millimetres_with_the_states_of_what_carries_it(house: ComponentTest) -> None:
    colours, distances, motors, base = call(house, "eye", "RGBD", "getData")
    assert colours.reshape(8, 12, 3)[4, 0].argmax() == 1
    assert distances.reshape(8, 12)[:, 8] == pytest.approx(2000, abs=1)
    assert list(motors) == ["neck"]
    assert base == call(house, "base", "DifferentialRobot", "getBaseState")
    image, depth, points, *_ = call(house, "eye", "RGBD", "getImage")
    assert (image["green"] == colours.reshape(-1, 3)[:, 1]).all()
    assert (depth == distances).all()
    assert tuple(points.reshape(8, 12)[1, 8]) == pytest.approx((2.5 / 6 * 2000, 2.5 / 6 * 2000, 2000, 1), abs=1)
    stream = call(house, "eye", "RGBD", "getXYZByteStream")[0].view("<f4").reshape(-1, 4)
    assert (stream[:, 0] == points["x"]).all()
    assert (call(house, "eye", "RGBD", "getDepthInIR")[0] == depth).all()
    said = call(house, "eye", "RGBD", "getRGBDParams")
    assert (said.color.width, said.depth.height, said.color.size, said.talkToBase) == (12, 8, 96, True)
    before = call(house, "eye", "RGBD", "getRegistration")
    assert before.name == "DepthInColor"
    call(house, "eye", "RGBD", "setRegistration", type(before).ColorInDepth)
    assert call(house, "eye", "RGBD", "getRegistration").name == "ColorInDepth"


@pytest.mark.tool
def test_what_a_display_is_sent_is_in_the_next_picture(house: ComponentTest, folder: Path) -> None:
    from PIL import Image

    def seen() -> list[int]:
        image = call(house, "corner", "CameraSimple", "getImage")
        return list(image.image.reshape(2, 4, 3)[0, 3] > 100)

    blue = np.tile(np.array((0, 0, 255), np.uint8), 6)
    call(house, "screen", "Display", "setImage", made(house, "RoboCompDisplay", "Image", 3, 2, 3, blue))
    assert seen() == [0, 0, 1]
    grey = np.full(4, 200, np.uint8)
    call(house, "screen", "Display", "setImage", made(house, "RoboCompDisplay", "Image", 2, 2, 1, grey))
    assert seen() == [1, 1, 1]
    Image.new("RGB", (5, 5), (255, 0, 255)).save(folder / "pink.png")
    call(house, "screen", "Display", "setImageFromFile", "pink.png")
    assert seen() == [1, 0, 1]


@pytest.mark.tool
def test_pictures_are_those_of_their_tick(house: ComponentTest) -> None:
    before = call(house, "eye", "CameraRGBDSimple", "getDepth", "").depth
    call(house, "base", "DifferentialRobot", "setSpeedBase", 500.0, 0.0)
    house.wait_for_computes(11)
    call(house, "base", "DifferentialRobot", "stopBase")
    driven = call(house, "base", "DifferentialRobot", "getBaseState").z
    after = call(house, "eye", "CameraRGBDSimple", "getDepth", "").depth
    assert driven > 100
    assert before.view("<f4")[0] - after.view("<f4")[0] == pytest.approx(driven / 1000, abs=1e-3)


def depths_of(message: Any) -> Any:
    return message.depth.view("<f4").reshape(message.height, message.width)


@pytest.mark.tool
def test_pictures_are_published_at_each_compute(house: ComponentTest) -> None:
    began = len(house.received("camerargbdsimplepub.pushRGBD"))
    ticks = house.worker.world.ticks
    house.wait_for(lambda: len(house.received("camerargbdsimplepub.pushRGBD")) >= began + 3)
    assert house.worker.world.ticks - ticks <= 4 * 10  # ticks of 5 ms in a period of 50 ms
    image, depth = house.received("camerargbdsimplepub.pushRGBD")[-1]
    assert (image.width, image.height, image.depth, depth.depthFactor) == (12, 8, 3, 1.0)
    now = call(house, "eye", "CameraRGBDSimple", "getAll", "")
    assert (image.image.reshape(-1) == now.image.image).all()
    assert (depths_of(depth) == depths_of(now.depth)).all()
    sizes = {(each.width, each.height) for (each,) in house.received("camerasimplepub.pushImage")}
    assert sizes == {(4, 2), (12, 8)}


class Drawn(NamedTuple):
    ticks: int
    camera: str
    has_colours: bool
    has_depths: bool


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Drawn]:
    """All that is drawn by components which start from now on."""
    found = []

    class Counting(studio.Renderer):
        def draw(self, view: View, camera: str, colours: Any, depths: Any) -> None:
            found.append(Drawn(view.ticks, camera, colours is not None, depths is not None))
            super().draw(view, camera, colours, depths)

    monkeypatch.setattr(studio, "Renderer", Counting)
    return found


@pytest.mark.tool
def test_two_topics_of_a_camera_share_what_is_drawn(folder: Path, drawn: list[Drawn]) -> None:
    with ComponentTest(load_component(folder / "house"), virtual=True) as house:

        def simple() -> list[Any]:
            return [each for (each,) in house.received("camerasimplepub.pushImage") if each.width == 12]

        def both() -> list[Any]:
            return [image for image, _ in house.received("camerargbdsimplepub.pushRGBD")]

        house.wait_for(lambda: min(len(simple()), len(both())) >= 3)
        pairs = list(zip(simple()[:3], both()[:3], strict=True))
    assert all(one.image.any() and (one.image == other.image).all() for one, other in pairs)
    assert len(drawn) == len({(each.ticks, each.camera) for each in drawn}), "a picture was drawn twice"


@pytest.mark.tool
def test_calls_and_publications_of_one_instant_share_what_is_drawn(folder: Path, drawn: list[Drawn]) -> None:
    asked, simple = [], []
    with ComponentTest(load_component(folder / "house"), virtual=True) as house:
        for _ in range(6):
            house.wait_for_computes(2)
            asked.append([call(house, "eye", "CameraRGBDSimple", each, "") for each in ("getImage", "getDepth")])
            simple.append(call(house, "corner", "CameraSimple", "getImage"))
        house.wait_for_computes(1)
        sent = {image.alivetime: (image, depth) for image, depth in house.received("camerargbdsimplepub.pushRGBD")}
        small = [each for (each,) in house.received("camerasimplepub.pushImage") if each.width == 4]
    for image, depth in asked:
        assert (image.image == sent[image.alivetime][0].image.reshape(-1)).all()
        assert (depth.depth.view("<f4") == depths_of(sent[depth.alivetime][1]).reshape(-1)).all()
    for one, other in zip(simple, small[1:12:2], strict=True):
        assert (one.image == other.image.reshape(-1)).all()
    times = Counter((each.ticks, each.camera) for each in drawn)
    assert times.pop((10, "corner")) == 2, "what has one topic is kept from the first call on"
    assert max(times.values()) == 1


@pytest.mark.tool
def test_a_camera_that_is_paused_is_drawn_once(folder: Path, drawn: list[Drawn]) -> None:
    with ComponentTest(load_component(folder / "house"), virtual=True) as house:
        house.call("Simulation.pause")
        house.wait_for_computes(1)
        call(house, "eye", "CameraRGBDSimple", "getAll", "")
        before = len(drawn)
        house.wait_for_computes(3)
        assert [each for each in drawn[before:] if each.camera == "eye"] == []
        times = [image.alivetime for image, _ in house.received("camerargbdsimplepub.pushRGBD")]
        assert len(set(times)) == len(times)


@pytest.mark.tool
def test_only_what_is_asked_for_is_read_from_opengl(folder: Path, drawn: list[Drawn]) -> None:
    with ComponentTest(load_component(folder / "house"), virtual=True) as house:
        call(house, "eye", "CameraRGBDSimple", "getImage", "")
        assert drawn.pop() == Drawn(0, "eye", has_colours=True, has_depths=False)
        depths = call(house, "eye", "CameraRGBDSimple", "getDepth", "").depth.view("<f4")
        assert depths[0] == pytest.approx(3.0, abs=1e-3)
        assert drawn.pop() == Drawn(0, "eye", has_colours=True, has_depths=True), "from now on, both"
        call(house, "eye", "RGBD", "getImage")
        assert drawn == []
        house.wait_for_computes(2)
        call(house, "corner", "CameraSimple", "getImage")
        assert {each.has_depths for each in drawn if each.camera == "corner"} == {False}
        assert {each.has_depths for each in drawn if each.camera == "eye"} == {True}, "one topic has depths"


@pytest.mark.tool
def test_by_the_clock_of_the_machine_pictures_are_published_while_others_are_asked_for(folder: Path) -> None:
    with ComponentTest(load_component(folder / "house"), {"component.period": 0.01}) as house:
        house.wait_for(lambda: len(house.received("camerargbdsimplepub.pushRGBD")) >= 3)
        image = call(house, "corner", "CameraSimple", "getImage")
        assert image.image.any()
        _, depth = house.received("camerargbdsimplepub.pushRGBD")[-1]
        assert depths_of(depth)[:, 0] == pytest.approx(3.0, abs=1e-3)
    assert house.fine
