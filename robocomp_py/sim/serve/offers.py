"""What a scene provides: interfaces of each device, under the id of its node, and of the joints of each port."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from ...innermodel.numbers import amiss_in_range
from ...innermodel.read import InnerModelError, number_of
from ...innermodel.tree import Tree
from ...wire.names import is_segment

_TRUTH = ("FullPoseEstimation", "FullPoseEstimationPub")

INTERFACES = {
    "laser": ("Laser", "LaserPub"),
    "differentialrobot": ("DifferentialRobot", "DifferentialRobotPub", *_TRUTH),
    "omnirobot": ("OmniRobot", "DifferentialRobot", "DifferentialRobotPub", *_TRUTH),
    "imu": ("IMU", "IMUPub"),
    "touchsensor": ("TouchSensor",),
    "rgbd": ("RGBD", "CameraRGBDSimple", "CameraRGBDSimplePub", "CameraSimple", "CameraSimplePub"),
    "camera": ("CameraSimple", "CameraSimplePub"),
    "display": ("Display",),
}
"""The interfaces of a device, by the tag of its node. Those that end in `Pub` are published."""

LIDAR = ("Lidar3D", "Lidar3DPub")
"""What a laser has besides that if it is a lidar."""

BASES = ("differentialrobot", "omnirobot")

JOINTS = ("joint", "prismaticjoint")

RANGED = (*JOINTS, "laser")
"""What works between `min` and `max`."""

MOTORS = ("JointMotor", "JointMotorPub")
"""The interfaces of the joints of one port."""

CONTROL = ("Simulation", "InnerModelManager", "SimulationPub")
"""The interfaces of the component itself."""


def motors(tree: Tree) -> dict[str, list[str]]:
    """The joints that are provided together, those of one `port`, by the name of their instance: `joints10067`.

    Those without a port are `joints`.
    """
    found: dict[str, list[str]] = {}
    for name in tree.ids:
        node = tree.node(name)
        if node.tag in JOINTS:
            port = node.values["port"]
            found.setdefault(f"joints{port}" if port else "joints", []).append(name)
    return found


def offers(tree: Tree, lidars: Collection[str] = ()) -> dict[str, tuple[str, ...]]:
    """The interfaces by the name of each instance: the ids of devices in the order of the file, then groups of joints.

    `lidars` are the lasers that have several fans, which no file says. A laser without rays has no interfaces, nor has
    a camera without a width.

    Raises InnerModelError for an id that cannot be the name of an instance, and for a joint or laser whose range is
    empty.
    """
    found: dict[str, tuple[str, ...]] = {}
    for name in tree.ids:
        node = tree.node(name)
        if node.tag in RANGED:
            low, high = number_of(node.values["min"]), number_of(node.values["max"])
            if wrong := amiss_in_range(node.tag, low, high):
                raise InnerModelError(f"`{name}`: {wrong}", node=name)
        if node.tag in INTERFACES and node.values.get("measures") != 0 and node.values.get("width") != 0:
            if not is_segment(name):
                raise InnerModelError(
                    f"`{name}`: the id of a device names an instance: use letters, digits, `_` and `-`", node=name
                )
            found[name] = (*INTERFACES[node.tag], *(LIDAR if name in lidars else ()))
    return found | {name: (*found.get(name, ()), *MOTORS) for name in motors(tree)}


def at_ports(tree: Tree, lidars: Collection[str]) -> dict[str, tuple[tuple[str, ...], int]]:
    """The interfaces and the port of each instance, as RoboComp's programs find them: one interface at a port.

    Instances without a port, which is 0 then, have all their interfaces. Raises InnerModelError for a port that two
    instances have.
    """
    found: dict[str, tuple[tuple[str, ...], int]] = {}
    groups, taken = motors(tree), dict[int, str]()
    for name, interfaces in offers(tree, lidars).items():
        node = groups[name][0] if name in groups else name
        port = int(number_of(tree.node(node).values.get("port", 0)))
        if port in taken:
            raise InnerModelError(
                f"`{node}`: port {port} is that of `{taken[port]}`, too: give one of them another port", node=node
            )
        if port:
            taken[port] = node
        found[name] = (interfaces[:1] if port else interfaces), port
    return found


def left_out(tree: Tree) -> dict[str, list[str]]:
    """The devices that no interface provides, by what is wrong with them: "laser without `measures`"."""
    found: dict[str, list[str]] = {}
    for name in tree.ids:
        node = tree.node(name)
        if node.tag == "laser" and node.values["measures"] == 0:
            found.setdefault("laser without `measures`", []).append(name)
        elif node.values.get("width") == 0:
            found.setdefault(f"{node.tag} without `width`", []).append(name)
    return found


def carried_by(tree: Tree, device: str) -> tuple[str, list[str]]:
    """The base and the joints whose states come with what an rgbd or a laser sees; "" for no base.

    They are those that serve its `ifconfig`, which is "port of joints,port of base" of an rgbd, and "port of base" of a
    laser; else, the base is that which carries it.
    """
    node = tree.node(device)
    told = str(node.values.get("ifconfig", ""))
    joints_port, _, base_port = f",{told}".partition(",") if node.tag == "laser" else told.partition(",")
    joints = motors(tree).get(f"joints{joints_port.strip()}", []) if joints_port.strip() else []
    bases = [name for name in tree.ids if tree.node(name).tag in BASES]
    for name in bases:
        if base_port.strip() and str(tree.node(name).values["port"]) == base_port.strip():
            return name, joints
    above = device
    while above and above not in bases:
        above = tree.node(above).parent
    return above, joints


def used(found: dict[str, tuple[str, ...]]) -> list[str]:
    """All interfaces of a scene, each once."""
    return list(dict.fromkeys(each for interfaces in found.values() for each in interfaces))


def names_of(interface: str, found: Mapping[str, tuple[str, ...]]) -> Iterable[str]:
    """The devices that have an interface."""
    return (name for name, interfaces in found.items() if interface in interfaces)
