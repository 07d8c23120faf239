"""What a scene needs and InnerModel cannot say: masses, friction, the strength of motors, by the ids of nodes.

World(tree, physics=True, parameters={"box": {"mass": 2.0, "friction": 0.4}, "elbow": {"force": 30.0}})
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..innermodel.read import InnerModelError
from ..innermodel.tree import Node, Tree
from ..spelling import unknown

BASES = ("differentialrobot", "omnirobot")
JOINTS = ("joint", "prismaticjoint")
FANS = 16
"""How many fans a lidar has, if it is not told."""

FIELD = 0.5236
"""The angle between the highest and the lowest fan of a lidar, if it is not told, rad: 30 degrees."""

SHAPES = ("plane", "display", "mesh")


@dataclass(frozen=True, slots=True)
class Parameter:
    text: str
    """What it means, with its unit."""
    least: float
    """The lowest value."""
    needs: str
    """Which nodes have it, for messages."""
    usual: float = -1.0
    """The value that stands for none, where one has to be written."""
    most: float = math.inf
    """The highest value."""
    is_whole: bool = False


PARAMETERS = {
    "mass": Parameter("mass of a body without what moves on it, kg", 1e-6, "a base, a joint or a free body"),
    "friction": Parameter("friction of a shape, or of all shapes below the node", 0.0, "a shape, or a node above one,"),
    "force": Parameter("the most that a motor gives, N; N m if it turns", 0.0, "a base or a joint"),
    "belt": Parameter("speed of the surface of a shape along its z, mm/s", -math.inf, "a plane", 0.0),
    "suction": Parameter("how far a suction cup or magnet reaches, mm", 0.0, "a shape, or a node above one,"),
    "fans": Parameter("how many fans of rays a lidar has", 1.0, "a laser", most=1000.0, is_whole=True),
    "field": Parameter("the angle between its highest and its lowest fan, rad", 0.0, "a laser", most=math.pi),
}
"""All parameters by their names."""

Parameters = Mapping[str, Mapping[str, float]]
"""Values by the id of a node and the name of a parameter."""


def checked(tree: Tree, parameters: Parameters) -> dict[str, dict[str, float]]:
    """The parameters as numbers. Raises InnerModelError with all that is wrong."""
    wrong = []
    for name, values in parameters.items():
        if name not in tree:
            wrong.append(f"parameters: {unknown('node', name, tree.ids)}")
            continue
        for key, value in values.items():
            if problem := _problem(tree, tree.node(name), key, value):
                wrong.append(f"parameters of `{name}`: {problem}")
    if wrong:
        raise InnerModelError("\n".join(wrong))
    return {name: {key: float(value) for key, value in values.items()} for name, values in parameters.items()}


def _problem(tree: Tree, node: Node, key: str, value: object) -> str:
    """What is wrong with a parameter; "" if nothing is."""
    if key not in PARAMETERS:
        return unknown("parameter", key, PARAMETERS)
    known = PARAMETERS[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return f"`{key}` is {value!r}: it has to be a number"
    if value < known.least:
        return f"`{key}` is {value:g}: it has to be at least {known.least:g}"
    if value > known.most:
        return f"`{key}` is {value:g}: it can be {known.most:g} at most"
    if known.is_whole and value != round(value):
        return f"`{key}` is {value:g}: it has to be a whole number"
    if not _has(tree, node, key):
        return f"a {node.tag} has no `{key}`: only {known.needs} has one"
    return ""


def _has(tree: Tree, node: Node, key: str) -> bool:
    if key == "belt":
        return node.tag == "plane"
    if key in ("fans", "field"):
        return node.tag == "laser"
    if key in ("friction", "suction"):
        return node.tag in SHAPES or any(_has(tree, tree.node(child), key) for child in node.children)
    moves = node.tag in (*BASES, *JOINTS)
    return moves or (key == "mass" and node.values.get("engine") == "bullet")
