"""A scene from what MuJoCo reads: URDF and MJCF.

Links become frames, joints become joints along z of frames of their own, and shapes become boxes and meshes. What
InnerModel does not have is left out, and listed.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.nodes import Value
from ..innermodel.read import ROOT_ID, InnerModelError
from ..innermodel.tree import Tree
from .urdf import readable

_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "joint", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismaticjoint"}
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_PLANE, _MESH = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_MESH)
_UNKNOWN = {int(mujoco.mjtGeom.mjGEOM_HFIELD): "hfield", int(mujoco.mjtGeom.mjGEOM_SDF): "mesh"}
_INFINITE, _THIN = 20000.0, 10.0
"""mm: a side of a plane that MJCF calls infinite, and the height of all planes."""
_PACKAGES = "a file of the package NAME is looked for in folders NAME beside and above it"
_GREY = (0.5, 0.5, 0.5)
"""Of a shape that has no colour."""
_COUNTED = {
    "nsensor": "sensor",
    "ncam": "camera",
    "ntendon": "tendon",
    "nlight": "light",
    "nsite": "site",
    "nactuator": "actuator",
}
"""What a model of MuJoCo may have that is left out."""


@dataclass(frozen=True)
class Imported:
    """What became of a file."""

    tree: Tree
    meshes: dict[str, str] = field(default_factory=dict)
    """The texts of the files of its meshes in the format OBJ, by their paths beside the scene."""
    left_out: list[str] = field(default_factory=list)
    """What the tree does not have, for people."""


def imported(path: Path, meshes: str = "meshes") -> Imported:
    """The scene of a file of URDF or MJCF. `meshes` is the folder of its meshes, beside the scene.

    Raises InnerModelError for a file that MuJoCo cannot read or that has no link, and for a ball joint.
    """
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        model, left_out = _read(path)
    made = converted(model, meshes)
    made.left_out.extend(left_out)
    made.left_out.extend(f"MuJoCo warns: {' '.join(str(each.message).split())}" for each in told)
    return made


def _read(path: Path) -> tuple[mujoco.MjModel, list[str]]:
    """The model of a file, and what it lacks."""
    left_out: list[str] = []
    try:
        if urdf := readable(path.read_bytes(), path.parent.resolve()):
            text, left_out = urdf
            spec = mujoco.MjSpec.from_string(text)
            spec.modelfiledir = str(path.parent.resolve())
        else:
            spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # else links that cannot move lose their frames
        spec.compiler.boundmass = spec.compiler.boundinertia = 1e-6  # masses of links are left out, and may be missing
        spec.compiler.balanceinertia = True
        model: mujoco.MjModel = spec.compile()
    except InnerModelError as exc:
        raise InnerModelError(f"{path}: {exc}") from exc
    except ValueError as exc:
        text = " ".join(str(exc).split())
        hint = f"; {_PACKAGES}" if "package:" in text else ""
        raise InnerModelError(f"{path}: MuJoCo cannot read it: {text}{hint}") from exc
    if model.nbody + model.ngeom == 1:
        raise InnerModelError(f"{path}: it has no link and no shape")
    return model, left_out


def converted(model: mujoco.MjModel, meshes: str = "meshes") -> Imported:
    """The scene of a model of MuJoCo. Raises InnerModelError for a ball joint."""
    made = Imported(Tree())
    frames = {0: ROOT_ID}
    for number in range(1, model.nbody):
        frames[number] = _add_body(made.tree, model, number, frames[int(model.body_parentid[number])])
    seen_only = _seen_only(model)
    for number in range(model.ngeom):
        if number not in seen_only:
            _add_shape(made, model, number, frames[int(model.geom_bodyid[number])], meshes)
    if seen_only:
        made.left_out.append(f"shapes that touch nothing, of links that also have solid ones: {len(seen_only)}")
    counts = {name: int(getattr(model, key, 0)) for key, name in _COUNTED.items()}
    made.left_out.extend(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)
    made.left_out.extend(_equality(model, number) for number in range(model.neq))
    return made


def _seen_only(model: mujoco.MjModel) -> set[int]:
    """The geoms that touch nothing, of bodies with geoms that do.

    Many files have two sets of shapes for each link: one to be seen, and one to collide. A scene has solid
    shapes only.
    """
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    solid = set(model.geom_bodyid[touches].tolist()) - {0}
    return {number for number in np.flatnonzero(~touches).tolist() if int(model.geom_bodyid[number]) in solid}


def _equality(model: mujoco.MjModel, number: int) -> str:
    one, other = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
    if model.eq_type[number] == int(mujoco.mjtEq.mjEQ_JOINT) and other >= 0:
        return f"that {model.joint(one).name} follows {model.joint(other).name}"
    return f"the equality {model.equality(number).name or number}"


def _add_body(tree: Tree, model: mujoco.MjModel, number: int, parent: str) -> str:
    """Add the frame of a body and its joints; returns the frame that moves with all of them."""
    body = model.body(number)
    joints = [model.joint(each) for each in range(body.jntadr[0], body.jntadr[0] + body.jntnum[0])]
    is_free = any(model.jnt_type[joint.id] == _FREE for joint in joints)
    free: dict[str, Value] = {"engine": "bullet", "mass": _rounded(model.body_mass[number])} if is_free else {}
    name = first = _id_of(tree, body, "body")
    tree.add(parent, "transform", name, **_placed(_pose(body.pos, body.quat)), **free)
    for joint in joints:
        if model.jnt_type[joint.id] != _FREE:
            name = _add_joint(tree, model, joint, name, first)
    return name


def _add_joint(tree: Tree, model: mujoco.MjModel, joint: Any, parent: str, body: str) -> str:
    label = _id_of(tree, joint, "joint")
    kind = _KINDS.get(int(model.jnt_type[joint.id]))
    if kind is None:
        raise InnerModelError(
            f"body {body}: {label} is a ball joint, and joints of a scene have one axis: replace it by three hinges"
        )
    axis = axes.turn_from_simulation(joint.axis) if kind == "joint" else joint.axis @ axes.TO_SIMULATION
    turn = axes.pose(axes.position_from_simulation(joint.pos).tolist(), axes.along_normal((-axis).tolist()))
    factor = 1.0 if kind == "joint" else 1000.0
    low, high = (_rounded(factor * (each - model.qpos0[joint.qposadr[0]])) for each in joint.range)
    limits = {"min": low, "max": high} if model.jnt_limited[joint.id] else {}
    before = _free_id(tree, f"{label}_axis")
    tree.add(parent, "transform", before, **_placed(turn))
    tree.add(before, kind, label, axis="z", **limits)
    after = _free_id(tree, f"{label}_moved")
    tree.add(label, "transform", after, **_placed(axes.inverse(turn)))
    return after


def _add_shape(made: Imported, model: mujoco.MjModel, number: int, parent: str, meshes: str) -> None:
    geom, kind = model.geom(number), int(model.geom_type[number])
    if lost := _UNKNOWN.get(kind):
        made.left_out.append(f"the {lost} {getattr(model, lost)(geom.dataid[0]).name}")
        return
    name = _id_of(made.tree, geom, "geom")
    place = _free_id(made.tree, f"{name}_at")
    made.tree.add(parent, "transform", place, **_placed(_pose(geom.pos, geom.quat)))
    colour = _colour(model, number)
    if kind == _MESH:
        label = model.mesh(geom.dataid[0]).name or f"mesh{geom.dataid[0]}"
        stem = str(PurePosixPath(meshes, f"{label.replace('/', '_')}{colour.replace('#', '-')}"))
        text = _obj(model, int(geom.dataid[0]), colour)
        file = next(each for each in _numbered(stem, ".obj") if made.meshes.get(each, text) == text)
        made.meshes[file] = text
        made.tree.add(place, "mesh", name, file=file)
        return
    dressed = {"texture": colour} if colour else {}
    made.tree.add(place, "plane", name, **_box(model, number), **dressed)


def _box(model: mujoco.MjModel, number: int) -> dict[str, Any]:
    """The attributes of the box that a shape becomes."""
    if model.geom_type[number] == _PLANE:
        depth, width = (float(each) * 2000.0 or _INFINITE for each in model.geom_size[number][:2])
        return {"size": (_rounded(width), _THIN, _rounded(depth)), "py": -_THIN / 2}
    depth, width, height = (_rounded(each * 2000.0) for each in model.geom_aabb[number][3:])
    return {"size": (width, height, depth)}


def _colour(model: mujoco.MjModel, number: int) -> str:
    """The colour of a shape as `#rrggbb`; "" if it has none."""
    material = int(model.geom_matid[number])
    colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[number]
    if material < 0 and np.allclose(colour[:3], _GREY):
        return ""
    return "#" + "".join(f"{round(255 * float(min(max(each, 0.0), 1.0))):02x}" for each in colour[:3])


def _obj(model: mujoco.MjModel, mesh: int, colour: str) -> str:
    """A mesh in the format OBJ, mm. Files of meshes have their own z, towards the viewer."""
    begin, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    points: Array = axes.position_from_simulation(model.mesh_vert[begin : begin + count].astype(float)) * (1, 1, -1)
    begin, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    faces: NDArray[Any] = model.mesh_face[begin : begin + count] + 1
    told = "".join(f" {int(colour[each : each + 2], 16) / 255:.4g}" for each in (1, 3, 5)) if colour else ""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}{told}" for x, y, z in (points + 0.0).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in faces.tolist()]
    return "\n".join(lines) + "\n"


def _pose(position: Array, quaternion: Array) -> Array:
    """A pose of MuJoCo in the axes of InnerModel, mm."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    here = axes.rotation_from_simulation(turn.reshape(3, 3))
    return axes.pose(axes.position_from_simulation(np.asarray(position)).tolist(), here)


def _placed(pose: Array) -> Mapping[str, float]:
    """A pose as attributes."""
    numbers = (*pose[:3, 3].tolist(), *axes.angles(pose[:3, :3]).tolist())
    return dict(zip(("tx", "ty", "tz", "rx", "ry", "rz"), map(_rounded, numbers), strict=True))


def _rounded(number: float) -> float:
    """Without the errors of floating-point arithmetic."""
    return round(float(number), 6) + 0.0


def _id_of(tree: Tree, thing: Any, kind: str) -> str:
    """An id for a body, a joint or a shape. MuJoCo needs no names, and lets a body and a joint have the same one."""
    name = thing.name or f"{kind}{thing.id}"
    return name if name not in tree else _free_id(tree, f"{name}_{kind}")


def _free_id(tree: Tree, name: str) -> str:
    """This id, or if a node has it, the same with the first number that makes it free."""
    return next(each for each in _numbered(name) if each not in tree)


def _numbered(name: str, ending: str = "") -> Iterator[str]:
    """This name, then the same with a number: `arm.obj`, `arm0.obj`, `arm1.obj` …"""
    yield f"{name}{ending}"
    yield from (f"{name}{number}{ending}" for number in itertools.count())
