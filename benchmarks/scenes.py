"""Scenes of simulation, of any size: two robots with arms, free boxes and walls."""

from __future__ import annotations

from robocomp_py.innermodel.tree import Tree

FREE = 20
"""Boxes that move freely."""

_LINKS = 7
"""Of an arm."""


def hall(shapes: int, *, free: int = FREE, resting: bool = True) -> Tree:
    """A hall with this number of shapes. Free boxes rest on the floor, or else fall."""
    tree = Tree()
    tree.add("root", "transform", "world")
    tree.add("world", "plane", "floor", py=-1000.0, size=(60000.0, 2000.0, 60000.0))  # thick: boxes fall fast
    for number in range(2):
        _robot(tree, f"robot{number}", -2000.0 + 4000.0 * number)
    for number in range(free):
        name, height = f"box{number}", 100.0 if resting else 300.0 + 700.0 * number
        x, z = -4000.0 + 500.0 * (number % 10), 3000.0 + 600.0 * (number // 10)
        tree.add("world", "transform", name, engine="bullet", mass=1.0, tx=x, ty=height, tz=z)
        tree.add(name, "plane", f"{name}_shape", size=(200.0, 200.0, 200.0))
    for number in range(shapes - 1 - free - 2 * (_LINKS + 1)):
        x, z = -9000.0 + 900.0 * (number % 20), 6000.0 + 700.0 * (number // 20)
        size = (300.0, 600.0, 100.0)
        tree.add("world", "plane", f"wall{number}", size=size, px=x, py=300.0, pz=z, collide=True)
    return tree


def _robot(tree: Tree, name: str, x: float) -> None:
    """A base that moves sideways, too, with a laser and an arm of seven joints."""
    tree.add("world", "omnirobot", name, tx=x, collide=True)
    tree.add(name, "plane", f"{name}_body", size=(400.0, 400.0, 400.0), py=220.0, collide=True)
    tree.add(name, "translation", f"{name}_mount", ty=450.0)
    tree.add(f"{name}_mount", "laser", f"{name}_laser", measures=360, angle=6.2831853, max=10000.0)
    above = f"{name}_mount"
    for number in range(_LINKS):
        joint = f"{name}_joint{number}"
        tree.add(above, "joint", joint, axis="zxyzxyz"[number], ty=120.0, min=-3.0, max=3.0)
        tree.add(joint, "plane", f"{joint}_link", size=(60.0, 100.0, 60.0), py=60.0)
        above = joint
