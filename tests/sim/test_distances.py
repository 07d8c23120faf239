"""Distances of shapes are those of geometry."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest

from robocomp_py.innermodel.axes import Array
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.world import World

NAMES = [f"box{number}" for number in range(46)]
CORNERS: Array = np.array(list(product((-0.5, 0.5), repeat=3)))
EDGES = np.array(
    [pair for pair in combinations(range(8), 2) if np.abs(np.diff(CORNERS[list(pair)], axis=0)).sum() == 1]
)

Box = tuple[Array, Array]
"""Its pose, and its size in mm."""


def boxes() -> tuple[Tree, dict[str, Box]]:
    """Boxes of any size and turn, each in a place of its own."""
    random, tree, found = np.random.default_rng(3), Tree(), {}
    for name, place in zip(NAMES, product(range(4), range(4), range(3)), strict=False):
        x, y, z = 700.0 * np.array(place) + random.uniform(-40, 40, 3)
        rx, ry, rz = random.uniform(-3, 3, 3)
        size = random.uniform(20, 350, 3)
        tree.add("root", "transform", name, tx=x, ty=y, tz=z, rx=rx, ry=ry, rz=rz)
        tree.add(name, "plane", f"{name}_shape", size=tuple(size.tolist()), nz=-1.0)
        found[name] = tree.matrix("root", name), size
    return tree, found


def corners(box: Box) -> Array:
    pose, size = box
    made: Array = (CORNERS * size) @ pose[:3, :3].T + pose[:3, 3]
    return made


def from_corners(points: Array, box: Box) -> float:
    """The least distance of points from a box."""
    pose, size = box
    inside = (points - pose[:3, 3]) @ pose[:3, :3]
    return float(np.linalg.norm(np.maximum(np.abs(inside) - size / 2, 0.0), axis=1).min())


def from_edges(mine: Array, others: Array) -> float:
    """The least distance of an edge from another one, of those that are nearest within both."""
    start, other = mine[EDGES[:, 0], None], others[None, EDGES[:, 1]]
    along, across = (mine[EDGES[:, 1]] - mine[EDGES[:, 0]])[:, None], (others[EDGES[:, 0]] - others[EDGES[:, 1]])[None]
    away = start - other
    a, b, c = (along * along).sum(-1), (along * across).sum(-1), (across * across).sum(-1)
    d, e = (along * away).sum(-1), (across * away).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel edges: the corners tell their distance
        s, t = (b * e - c * d) / (a * c - b * b), (a * e - b * d) / (a * c - b * b)
    within = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    apart = np.linalg.norm(away + s[..., None] * along - t[..., None] * across, axis=-1)
    return float(apart[within].min(initial=np.inf))


def test_distances_of_a_thousand_pairs_of_boxes_are_those_of_geometry() -> None:
    tree, found = boxes()
    world, points = World(tree), {name: corners(box) for name, box in found.items()}
    pairs = list(combinations(NAMES, 2))
    assert len(pairs) > 1000
    for one, other in pairs:
        wanted = min(
            from_corners(points[one], found[other]),
            from_corners(points[other], found[one]),
            from_edges(points[one], points[other]),
        )
        assert wanted > 0
        assert world.distance(one, other) == pytest.approx(wanted, abs=1e-6), (one, other)
