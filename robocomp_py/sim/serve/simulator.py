"""The base of a component that simulates a scene.

class SpecificWorker(Simulator, GenericWorker):
    pass
"""

from __future__ import annotations

import inspect
import logging
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal

from ...contract.component import Port
from ...contract.interface import Interface
from ...contract.types import Type
from ...errors import ConfigurationError
from ...innermodel.read import InnerModelError, number_of
from ...innermodel.tree import Tree
from ...runtime.clock import Real
from ...runtime.instances import InstanceHandler, NamedHandlers, NamedProxies
from ...runtime.ports import has_subscribers
from ...spelling import unknown
from ..parameters import PARAMETERS
from .bases import DifferentialRobotHandler, OmniRobotHandler, state
from .control import Controlled, Progress
from .lasers import LaserHandler, Lidar3DHandler, classified, scanned
from .manager import Managed
from .motors import JointMotorHandler, states
from .offers import motors, names_of, offers
from .pace import Pace
from .sensors import FullPoseEstimationHandler, IMUHandler, TouchSensorHandler, measured, posed
from .values import filled, operation, records

try:
    from ..build import MissingMeshError
    from ..editing import EditError, Editing
    from ..remote import Remote
    from ..state import HOLD
    from ..world import World
    from .cameras import (
        Camera,
        CameraPublication,
        CameraRGBDSimpleHandler,
        CameraSimpleHandler,
        DisplayHandler,
        RGBDHandler,
    )
    from .studio import Studio
except ImportError as exc:
    raise ConfigurationError(f"a scene needs MuJoCo: pip install 'robocomp-py[sim]' ({exc})") from exc
except (AttributeError, RuntimeError) as exc:  # PyOpenGL raises the first for an OpenGL that is not there, MuJoCo the
    if not (wanted := os.environ.get("MUJOCO_GL", "")):  # second for a name that it does not know
        raise
    text = f"MUJOCO_GL={wanted} names an OpenGL that this machine does not have, so MuJoCo cannot be loaded"
    raise ConfigurationError(f"{text}: unset it; without OpenGL, everything but cameras works") from exc

log = logging.getLogger("robocomp.sim")

_PICTURES = "CameraSimplePub", "CameraRGBDSimplePub"
"""Topics of cameras."""

_ALL_PORTS = ""
"""In the place of a port: a camera draws once for all of its topics, so its publication is that of all their ports."""

_SCENE = ""
"""In the place of an instance: SimulationPub tells of the whole scene."""


class Simulator(Controlled, Managed):
    """Simulates the file of the parameter `scene`, which is looked for in the component's folder.

    Each device is a named instance with the id of its node: `front/Laser`. All joints with one `port` are one instance:
    `joints10067/JointMotor`; those without a port are `joints/JointMotor`. Interfaces that the CDSL does not have are
    not provided. The scene follows the clock of the component, and `compute` publishes what the devices tell.

    It also has the handlers of Simulation and InnerModelManager, for a CDSL that implements them, and publishes
    SimulationPub.
    """

    remote: Remote | None = None
    """The process that draws, with `render = "process"`, which its owner closes. None: the component has its own."""
    _studio: Studio | None = None
    _is_providing = False
    _logged: frozenset[str] = frozenset()
    """What only the scene has or only the network declares, which has been logged."""

    def initialize(self) -> None:
        """Read the scene, and add its devices. Raises ConfigurationError for a scene that cannot be simulated."""
        path = Path(inspect.getfile(type(self))).parent / self.params.scene
        tree = Tree()
        compat: Literal["", "robocomp"] = "robocomp" if getattr(self.params, "compat", "") == "robocomp" else ""
        try:
            tree = Tree.read(Path(os.path.normpath(path)), drops_offsets=bool(compat))
            for problem in tree.problems:
                log.warning("%s", problem)
            self._tree, self._motors = tree, motors(tree)
            offers(tree)
            self._go_home(all_joints=bool(compat))
            self.world = World(
                self._tree,
                seed=self.params.seed,
                without_meshes=self.params.without_meshes,
                physics=self.params.physics,
                hold=getattr(self.params, "hold", HOLD),  # components made before this parameter lack it
                parameters=self._parameters(),
                compat=compat,
            )
        except InnerModelError as exc:
            raise ConfigurationError(_told(exc, tree, self.instance)) from exc
        self._pace = Pace(self.world.tick, self.now())
        self._folder = path.parent
        in_process = getattr(self.params, "render", "") == "process"
        suspended = self._suspended if isinstance(self._clock, Real) else None
        self._studio = Studio(suspended, in_process=in_process, remote=self.remote)
        self._editing, self._saved = Editing(self.world), {}
        self._publications: dict[tuple[str, str], Callable[[], None]] = {}
        """By the port and the name of the instance, or `_ALL_PORTS` and `_SCENE`; in the order of publishing."""
        self._pictures: dict[str, CameraPublication] = {}
        """By camera."""
        self._provide()
        for port in self.component.ports:
            if port.interface.short == "SimulationPub" and port not in self.component.named:
                progress, proxy = Progress(self.world, self._pace, port), getattr(self, port.attribute)
                self._publications[port.name, _SCENE] = partial(_if_heard, proxy, partial(_tell, progress, proxy))

    def _provide(self) -> None:
        """Remove what the scene has no longer, and add what it has and the network declares.

        A removal lets handlers run. If one of them edits the scene, this returns, and has to be called again.
        """
        self._tree = self.world.tree
        self._motors, found = motors(self._tree), offers(self._tree, self.world.lidars)
        undeclared: list[str] = []
        absent: list[tuple[str, str, list[str]]] = []
        removed = self._remove_all_but(found)
        if removed:
            log.info("an edit has removed %s", ", ".join(removed))
        if self.world.tree is not self._tree:
            return
        for port in self.component.named:
            instances, names = getattr(self, port.attribute), list(names_of(port.interface.short, found))
            for name in names:
                if name in instances:
                    continue
                if not instances.is_declared(name):
                    undeclared.append(f"{name}/{port.interface.short}")
                elif isinstance(instances, NamedHandlers):
                    instances.add(name, self._handler(port.interface, name))
                elif isinstance(instances, NamedProxies):
                    self._publish(port, name, instances.add(name))
            absent += [(port.interface.short, name, names) for name in instances.absent]
            if port.interface.short == "JointMotor" and isinstance(instances, NamedHandlers):
                for name, handler in instances.items():
                    handler.joints = {each: self._tree.node(each) for each in self._motors[name]}
        if fresh := [each for each in undeclared if each not in self._logged]:
            log.info("the network does not declare %s; `rc sim offers` prints the lines", ", ".join(fresh))
        for short, name, names in absent:
            if f"{name}/{short}" not in self._logged and f"{name}/{short}" not in removed:
                log.warning("the network declares `offers %s : %s`: %s", name, short, unknown(short, name, names))
        self._logged = frozenset((*undeclared, *(f"{name}/{short}" for short, name, _ in absent)))

    def _remove_all_but(self, found: Mapping[str, tuple[str, ...]]) -> list[str]:
        """Remove the devices that `offers` no longer finds; returns their names."""
        removed = []
        for port in self.component.named:
            instances = getattr(self, port.attribute)
            for name in sorted(set(instances) - set(names_of(port.interface.short, found))):
                self._withdraw(port, name)
                instances.remove(name)
                removed.append(f"{name}/{port.interface.short}")
        return removed

    def _publish(self, port: Port, name: str, proxy: Any) -> None:
        """Publish what an instance tells in each `compute`."""
        if port.interface.short not in _PICTURES:
            self._publications[port.name, name] = partial(_if_heard, proxy, self._publication(port, name, proxy))
            return
        if name not in self._pictures:
            self._publications[_ALL_PORTS, name] = self._pictures[name] = CameraPublication(self._camera(name))
        self._pictures[name].add(port, proxy)

    def _withdraw(self, port: Port, name: str) -> None:
        """Publish it no longer."""
        self._publications.pop((port.name, name), None)
        if port.interface.short in _PICTURES and name in self._pictures and self._pictures[name].remove(port):
            del self._pictures[name], self._publications[_ALL_PORTS, name]

    def compute(self) -> None:
        """Go on to the present time, and publish what has subscribers."""
        self.follow()
        for publish in list(self._publications.values()):
            publish()

    def settle(self) -> None:
        """Let edits take effect, and provide what there is then."""
        try:
            self._editing.settle()
        except EditError as exc:
            log.error("edits of the scene are dropped: %s", exc)
        if self._is_providing:  # a removal waits: handlers run meanwhile, and may edit the scene again
            return
        self._is_providing = True
        try:
            while self.world.tree is not self._tree:
                self._provide()
        finally:
            self._is_providing = False

    def finish(self) -> None:
        """Wait for the picture that is being drawn."""
        if self._studio:
            self._studio.close()

    def _parameters(self) -> dict[str, dict[str, float]]:
        """What the parameter `bodies` has, by the ids of nodes."""
        return {
            each.id: {
                name: value
                for name, known in PARAMETERS.items()
                if (value := getattr(each, name, known.usual)) != known.usual
            }
            for each in self.params.bodies
        }

    def _go_home(self, *, all_joints: bool) -> None:
        """Put joints whose file names a `home` there, if they are provided; or else all that are provided, to 0."""
        for port in self.component.named:
            if port.interface.short != "JointMotor":
                continue
            for name, joints in self._motors.items():
                for joint in joints if getattr(self, port.attribute).is_declared(name) else ():
                    node = self._tree.node(joint)
                    update = self._tree.update_joint if node.tag == "joint" else self._tree.update_prismatic
                    home = number_of(node.values["home"])
                    if home or all_joints:
                        update(joint, home)

    def _handler(self, interface: Interface, name: str) -> InstanceHandler:
        match interface.short:
            case "Laser":
                return LaserHandler(self.world, self._tree.node(name), interface)
            case "Lidar3D":
                return Lidar3DHandler(self.world, name, self.now, lambda: self.period, interface)
            case "DifferentialRobot":
                return DifferentialRobotHandler(self.world, name, interface)
            case "OmniRobot":
                return OmniRobotHandler(self.world, name, interface)
            case "IMU":
                return IMUHandler(self.world, name, interface)
            case "TouchSensor":
                return TouchSensorHandler(self.world, name, interface)
            case "FullPoseEstimation":
                return FullPoseEstimationHandler(self.world, name, interface)
            case "CameraSimple":
                return CameraSimpleHandler(self._camera(name), interface)
            case "CameraRGBDSimple":
                return CameraRGBDSimpleHandler(self._camera(name), interface)
            case "RGBD":
                return RGBDHandler(self._camera(name), interface)
            case "Display":
                return DisplayHandler(self.world, name, self._folder, interface)
            case "JointMotor":
                joints = {each: self._tree.node(each) for each in self._motors[name]}
                return JointMotorHandler(self.world, name, joints, interface)
        raise AssertionError(f"`offers` has no {interface.short}")

    def _publication(self, port: Port, name: str, proxy: Any) -> Callable[[], None]:
        match port.interface.short:
            case "LaserPub":
                kind = operation(port.interface, "pushLaserData").inputs[0].type
                return lambda: proxy.pushLaserData(records(kind, scanned(self.world, name)))
            case "Lidar3DPub":
                return partial(
                    self._publish_cloud, name, operation(port.interface, "pushLidarData").inputs[0].type, proxy
                )
            case "DifferentialRobotPub":
                made = partial(filled, operation(port.interface, "pushBaseState").inputs[0].type)
                return lambda: proxy.pushBaseState(made(state(self.world, name)))
            case "IMUPub":
                imu = operation(port.interface, "publish").inputs[0].type
                return lambda: proxy.publish(measured(self.world, name, imu))
            case "FullPoseEstimationPub":
                pose = operation(port.interface, "newFullPose").inputs[0].type
                return lambda: proxy.newFullPose(posed(self.world, name, pose))
            case "JointMotorPub":
                map_kind = operation(port.interface, "motorStates").inputs[0].type
                return lambda: proxy.motorStates(states(self.world, self._motors[name], map_kind))
        raise AssertionError(f"`offers` has no {port.interface.short}")

    def _publish_cloud(self, name: str, kind: Type, proxy: Any) -> None:
        time = self.now() // 1_000_000
        proxy.pushLidarData(classified(self.world.cloud(name), kind, period=self.period, time=time))

    def _camera(self, name: str) -> Camera:
        number = self.world.cameras.index(name)
        node = self._tree.node(name)
        assert self._studio
        return Camera(self.world, self._studio, node, number, self.now, lambda: self.period)


def _if_heard(proxy: Any, publish: Callable[[], None]) -> None:
    if has_subscribers(proxy):
        publish()


def _tell(progress: Progress, proxy: Any) -> None:
    proxy.advanced(*progress.take())


def _told(error: InnerModelError, tree: Tree, instance: str) -> str:
    """What is wrong with a scene: a line for each problem, with its place and what may be meant."""
    if problems := [each for each in error.problems if each.is_error]:
        lines = [f"{each.place}: {each.message}{f'; {each.hint}' if each.hint else ''}" for each in problems]
        unread = any(each.code == "unreadable" for each in problems)
        return "\n".join(lines) + (
            "; set the parameter `scene` to the file, from this component's folder" if unread else ""
        )
    place, text = tree.place(error.node) if error.node else None, str(error)
    if isinstance(error, MissingMeshError):
        text = (
            f"{error.lack}; mend the path, or leave such meshes out: `without_meshes = true` below `[params]` in the "
            "component's etc/config.toml; for one run `--set params.without_meshes=true`, "
            f"in a network `--set {instance}.params.without_meshes=true`"
        )
    return f"{place}: {text}" if place else text
