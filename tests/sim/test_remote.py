"""Pictures that a process of its own draws, and what becomes of them when a process ends. They need OpenGL."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.errors import ConfigurationError
from robocomp_py.gym import NetworkEnv, Range
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.remote import DrawingLost, Remote
from robocomp_py.sim.render import Picture, Renderer
from robocomp_py.sim.world import World
from robocomp_py.testing.components import ComponentTest, load_component
from robocomp_py.testing.patience import wait_until

from ..leftovers import killed_on_failure

pytestmark = pytest.mark.tool

ROOM = """\
<innerModel>
  <transform id="world">
    <plane id="wall" pz="3000" nz="-1" size="9000,9000,10" texture="#00ff00"/>
    <display id="screen" pz="2000" px="1000" nz="-1" size="1800,9000,10" texture="#ff0000"/>
    <differentialrobot id="base"><rgbd id="eye" width="48" height="32" focal="20"/></differentialrobot>
    <camera id="corner" width="9" height="5" focal="4"/>
  </transform>
</innerModel>
"""


@pytest.fixture
def room(tmp_path: Path) -> World:
    (tmp_path / "room.xml").write_text(ROOM)
    return World(Tree.read(tmp_path / "room.xml"))


@pytest.fixture
def remote() -> Iterator[Renderer]:
    with Renderer(Remote()) as made:
        yield made


def painters(parent: int) -> list[int]:
    """The processes that draw for a process."""
    found = []
    for each in Path("/proc").glob("[0-9]*"):
        try:
            command, state = (each / "cmdline").read_bytes(), (each / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        if b"robocomp_py.sim.painter" in command and int(state[1]) == parent:
            found.append(int(each.name))
    return found


def is_alive(process: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2]
    except OSError:
        return False


def same(one: Picture, other: Picture) -> bool:
    return one.colours.tobytes() == other.colours.tobytes() and one.depths.tobytes() == other.depths.tobytes()


def test_a_process_draws_what_a_thread_draws_bit_by_bit(room: World, remote: Renderer) -> None:
    with Renderer() as here:

        def agree() -> bool:
            return all(
                same(here.picture(room.view(), each), remote.picture(room.view(), each)) for each in room.cameras
            )

        assert agree()
        room.drive("base", ahead=300, turn=0.5)
        room.step(100)
        room.set_noise("eye", 0.02)
        assert agree()
        pixels = np.random.default_rng(1).integers(0, 255, (20, 30, 3)).astype(np.uint8)
        for _ in range(2):  # of another size, and then of the same one
            room.show("screen", pixels)
            assert agree()
            pixels = pixels[::-1].copy()
        before, processes = remote.picture(room.view(), "eye"), painters(os.getpid())
        edited = room.tree.copy()
        edited.add("world", "plane", "new", pz=1000.0, size=(400.0, 400.0, 400.0), texture="#0000ff")
        room.change(edited)
        assert agree()
        assert not same(before, remote.picture(room.view(), "eye"))
        assert painters(os.getpid()) == processes
    remote.close()
    assert painters(os.getpid()) == []


def test_a_process_that_is_killed_is_told_and_started_again(room: World, remote: Renderer) -> None:
    before = remote.picture(room.view(), "eye")
    (process,) = painters(os.getpid())
    os.kill(process, signal.SIGKILL)
    with pytest.raises(DrawingLost, match="was ended by SIGKILL; the next picture starts it again"):
        remote.picture(room.view(), "eye")
    assert same(remote.picture(room.view(), "eye"), before)
    assert painters(os.getpid()) != [process]


def test_a_process_that_does_not_answer_is_ended_and_not_started_forever(room: World) -> None:
    with Renderer(Remote(patience=0.0)) as impatient:
        for _ in range(5):
            with pytest.raises(DrawingLost, match="did not answer, and was ended"):
                impatient.picture(room.view(), "eye")
        assert painters(os.getpid()) == []
        with pytest.raises(DrawingLost, match="has ended 5 times within 60 s: it is started again later"):
            impatient.picture(room.view(), "eye")


def test_without_opengl_the_process_says_what_to_install(
    room: World, remote: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    with pytest.raises(ConfigurationError, match="is the package libegl1 installed"):
        remote.picture(room.view(), "eye")


_DRAW = """
import signal, sys
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.remote import Remote
from robocomp_py.sim.render import Renderer
from robocomp_py.sim.world import World
renderer = Renderer(Remote())
renderer.picture(World(Tree.read(sys.argv[1])).view(), "eye")
print("drawn", flush=True)
signal.pause()
"""


def test_the_process_ends_when_the_one_that_it_draws_for_is_killed(room: World, tmp_path: Path) -> None:
    command = [sys.executable, "-c", _DRAW, str(tmp_path / "room.xml")]
    with killed_on_failure(command, stdout=subprocess.PIPE, text=True) as drawing:
        assert drawing.stdout
        assert drawing.stdout.readline() == "drawn\n"
        (process,) = painters(drawing.pid)
        drawing.kill()
    wait_until(lambda: not is_alive(process))


# As a component.


@pytest.fixture
def house(room: World, tmp_path: Path) -> Path:
    assert rc(["sim", "new", str(tmp_path / "room.xml"), "-o", str(tmp_path / "house")]) == 0
    return tmp_path / "house"


def image(house: ComponentTest) -> Any:
    return house.worker.camerasimple["eye"].getImage()


def test_a_client_is_answered_the_declared_error_and_then_the_picture_of_its_tick(house: Path) -> None:
    with ComponentTest(load_component(house), {"params.render": "process"}, virtual=True) as component:
        before = image(component)
        os.kill(painters(os.getpid())[0], signal.SIGKILL)
        component.worker.world.set_noise("eye", 0.01)  # or the picture before would do
        with pytest.raises(Exception, match="was ended by SIGKILL") as failed:
            image(component)
        assert type(failed.value).__name__ == "HardwareFailedException"
        assert (image(component).image == before.image).all()
        component.wait_for(lambda: component.received("camerargbdsimplepub.pushRGBD"))
        _, depth = component.received("camerargbdsimplepub.pushRGBD")[-1]
        now = component.worker.camerargbdsimple["eye"].getDepth("")
        assert (depth.depth.reshape(-1) == now.depth).all()
    assert component.fine
    assert painters(os.getpid()) == []


def test_an_environment_has_the_same_process_in_all_episodes(house: Path, tmp_path: Path) -> None:
    offers = (
        "offers base : DifferentialRobot, FullPoseEstimationPub; offers eye : CameraSimple; offers screen : Display;"
    )
    (tmp_path / "net.ddsl").write_text(
        f'import "house/house.cdsl"; Deployment net {{ Component house {{ {offers} }}; }};'
    )
    environment = NetworkEnv(
        tmp_path / "net.ddsl",
        actions={"base/DifferentialRobot/setSpeedBase": {"adv": Range(0.0, 300.0), "rot": 0.0}},
        observations={"base/FullPoseEstimationPub/newFullPose.pose.z": Range(-9.0, 9.0)},
        reward=lambda before, action, after: 0.0,
        settings=[("house", "params.render=process")],
    )
    shown = {"width": 30, "height": 20, "depth": 3, "Img": np.arange(1800, dtype=np.uint8)}
    pictures, processes = [], []
    with contextlib.closing(environment):
        for number in range(4):
            environment.reset(seed=1)
            if number == 2:  # what a display shows does not stay for the next episode
                environment.call("screen/Display/setImage", img=shown)
            environment.step(np.ones(1, np.float32))
            pictures.append(environment.call("eye/CameraSimple/getImage").image.tobytes())
            processes.append(painters(os.getpid()))
    assert [each == pictures[0] for each in pictures] == [True, True, False, True]
    assert processes == [processes[0]] * 4
    assert len(processes[0]) == 1
    assert painters(os.getpid()) == []


def test_a_component_goes_on_to_publish_when_its_process_is_killed(house: Path) -> None:
    with ComponentTest(load_component(house), {"params.render": "process"}) as component:

        def published() -> int:
            return len(component.received("camerargbdsimplepub.pushRGBD"))

        component.wait_for(published)
        os.kill(painters(os.getpid())[0], signal.SIGKILL)
        began = published()
        component.wait_for(lambda: published() > began + 1)
    assert component.fine
    assert painters(os.getpid()) == []


def test_a_way_of_drawing_that_does_not_exist_is_told(house: Path) -> None:
    with (
        pytest.raises(ConfigurationError, match=r"render.*`?proces`?.*process"),
        ComponentTest(load_component(house), {"params.render": "proces"}),
    ):
        pass
