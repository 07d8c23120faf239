"""InnerModelManager: the scene is asked and edited."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ...contract.interface import Interface
from ...contract.types import Dictionary, Enumeration, ExceptionType, Sequence, Struct, Type
from ...errors import ArgumentError
from ...runtime.worker import Worker
from .values import filled, operation

if TYPE_CHECKING:
    from ..editing import Box, Editing

_KINDS = {
    "joint": "Joint",
    "prismaticjoint": "Joint",
    "differentialrobot": "DifferentialRobot",
    "omnirobot": "OmniRobot",
    "plane": "Plane",
    "camera": "Camera",
    "rgbd": "RGBD",
    "imu": "IMU",
    "laser": "Laser",
    "mesh": "Mesh",
    "pointcloud": "PointCloud",
    "touchsensor": "TouchSensor",
    "display": "DisplayII",
}
"""The kinds of nodes, by their tags. All others are `Transform`."""

_POSE = ("x", "y", "z", "rx", "ry", "rz")


class Managed(Worker[Any]):
    """The handlers of InnerModelManager, for a component that implements it. Lengths are in mm, angles in rad.

    They raise the exception that the interface declares, with the code of what is wrong; ArgumentError where it
    declares none.
    """

    _editing: Editing

    def InnerModelManager_addTransform(self, item: str, engine: str, base: str, pose: Any) -> bool:
        """Add a frame, `static` or `bullet`."""
        with self._declared("addTransform"):
            self._editing.add_transform(item, engine, base, _pose(pose))
        return True

    def InnerModelManager_addJoint(self, item: str, base: str, j: Any) -> bool:
        """Add a joint. Joints with its `port` are one JointMotor."""
        with self._declared("addJoint"):
            self._editing.add_joint(item, base, _pose(j.pose), j.axis, j.min, j.max, j.port)
        return True

    def InnerModelManager_addMesh(self, item: str, base: str, m: Any) -> bool:
        """Add a shape from a file."""
        with self._declared("addMesh"):
            if m.render not in (0, 1):
                raise self._error("addMesh", "InvalidValues", f"`render` is {m.render}: it is 0 or 1")
            scale = (m.scaleX, m.scaleY, m.scaleZ)
            self._editing.add_mesh(item, base, _pose(m.pose), m.meshPath, scale, bool(m.render))
        return True

    def InnerModelManager_addPlane(self, item: str, base: str, plane: Any) -> bool:
        """Add a box."""
        with self._declared("addPlane"):
            self._editing.add_plane(item, base, _box(plane))
        return True

    def InnerModelManager_getAllNodeInformation(self) -> Any:
        """All nodes, parents first."""
        kind = self._output("getAllNodeInformation", 0)
        assert isinstance(kind, Sequence)
        assert isinstance(kind.item, Struct)
        fields = {each.name: each.type for each in kind.item.fields}
        tree, editing, made = self._editing.tree, self._editing, []
        for name in tree.ids:
            node = tree.node(name)
            values = {"id": name, "parentId": node.parent, "nType": _named(fields["nType"], _KINDS.get(node.tag, ""))}
            notes = _notes(fields["attributes"], editing.notes(name))
            made.append(filled(kind.item, {**values, "attributes": notes}))
        return made

    def InnerModelManager_setPose(self, base: str, item: str, pose: Any) -> bool:
        """Put a node where a pose says that is seen from `base`."""
        with self._declared("setPose"):
            self._editing.set_pose(base, item, _pose(pose))
        return True

    def InnerModelManager_setPoseFromParent(self, item: str, pose: Any) -> bool:
        """Put a node where a pose within its parent says."""
        with self._declared("setPoseFromParent"):
            self._editing.set_pose_from_parent(item, _pose(pose))
        return True

    def InnerModelManager_getPose(self, base: str, item: str) -> tuple[bool, Any]:
        """The true pose of a node, seen from `base`."""
        with self._declared("getPose"):
            pose = self._editing.pose(base, item)
        return True, filled(self._output("getPose", 1), dict(zip(_POSE, pose, strict=True)))

    def InnerModelManager_getPoseFromParent(self, item: str) -> tuple[bool, Any]:
        """The true pose of a node within its parent."""
        with self._declared("getPoseFromParent"):
            pose = self._editing.pose_from_parent(item)
        return True, filled(self._output("getPoseFromParent", 1), dict(zip(_POSE, pose, strict=True)))

    def InnerModelManager_setPlane(self, item: str, plane: Any) -> bool:
        """Set the place, the size and the texture of a box."""
        with self._declared("setPlane"):
            self._editing.set_plane(item, _box(plane))
        return True

    def InnerModelManager_transform(self, base: str, item: str, coordInItem: Any) -> tuple[bool, Any]:
        """A point of the frame `item`, seen from `base`."""
        with self._declared("transform"):
            x, y, z = self._editing.point(base, item, (coordInItem.x, coordInItem.y, coordInItem.z))
        return True, filled(self._output("transform", 1), {"x": x, "y": y, "z": z})

    def InnerModelManager_getTransformationMatrix(self, base: str, item: str) -> Any:
        """The matrix that leads from `item` to `base`."""
        with self._declared("getTransformationMatrix"):
            matrix = self._editing.matrix(base, item)
        values = {"cols": 4, "rows": 4, "data": matrix.ravel().astype(np.float32)}
        return filled(self._output("getTransformationMatrix", 0), values)

    def InnerModelManager_setScale(self, item: str, scaleX: float, scaleY: float, scaleZ: float) -> bool:
        """Set the scale of a shape from a file."""
        with self._declared("setScale"):
            self._editing.set_scale(item, (scaleX, scaleY, scaleZ))
        return True

    def InnerModelManager_addAttribute(self, idNode: str, name: str, type: str, value: str) -> bool:
        """Add a note to a node."""
        with self._declared("addAttribute"):
            self._editing.add_note(idNode, name, type, value)
        return True

    def InnerModelManager_removeAttribute(self, idNode: str, name: str) -> bool:
        """Remove a note."""
        with self._declared("removeAttribute"):
            self._editing.remove_note(idNode, name)
        return True

    def InnerModelManager_setAttribute(self, idNode: str, name: str, type: str, value: str) -> bool:
        """Change a note."""
        with self._declared("setAttribute"):
            self._editing.set_note(idNode, name, type, value)
        return True

    def InnerModelManager_getAttribute(self, idNode: str, name: str) -> tuple[bool, str, str]:
        """Type and value of a note."""
        with self._declared("getAttribute"):
            return True, *self._editing.note(idNode, name)

    def InnerModelManager_removeNode(self, item: str) -> bool:
        """Remove a node with all below it."""
        with self._declared("removeNode"):
            self._editing.remove(item)
        return True

    def InnerModelManager_moveNode(self, src: str, dst: str) -> bool:
        """Put a node below another parent."""
        with self._declared("moveNode"):
            self._editing.move(src, dst)
        return True

    def InnerModelManager_collide(self, a: str, b: str) -> bool:
        """Whether shapes at or below two nodes overlap."""
        with self._declared("collide"):
            return self._editing.collide(a, b)

    def InnerModelManager_setPointCloudData(self, id: str, cloud: Any) -> None:
        """Set the points of a cloud."""
        points = np.array([(each.x, each.y, each.z) for each in cloud], dtype=float).reshape(-1, 3)
        colours = np.array([(each.r, each.g, each.b) for each in cloud], dtype=float).reshape(-1, 3)
        with self._declared("setPointCloudData"):
            self._editing.set_cloud(id, points, colours)

    @contextlib.contextmanager
    def _declared(self, name: str) -> Iterator[None]:
        """Errors of an edit become those that the interface declares."""
        from ..editing import EditError  # needs MuJoCo

        try:
            yield
        except EditError as exc:
            raise self._error(name, exc.code, str(exc)) from exc

    def _error(self, name: str, code: str, text: str) -> Exception:
        for each in operation(self._manager(), name).raises:
            if each.name.endswith("::InnerModelManagerError") and each.python is not None:
                made: Exception = each.python(_named(_field(each, "err"), code), text)
                return made
        return ArgumentError(text)

    def _manager(self) -> Interface:
        return next(port.interface for port in self.component.ports if port.interface.short == "InnerModelManager")

    def _output(self, name: str, number: int) -> Type:
        return operation(self._manager(), name).outputs[number].type


def _field(kind: ExceptionType, name: str) -> Type:
    return next(each.type for each in kind.all_fields if each.name == name)


def _named(kind: Type, name: str) -> Any:
    """The value of an enumeration that has a name, or its first one."""
    assert isinstance(kind, Enumeration)
    python: Any = kind.python
    return python[name] if name in python.__members__ else next(iter(python))


def _notes(kind: Type, notes: dict[str, tuple[str, str]]) -> dict[str, Any]:
    assert isinstance(kind, Dictionary)
    return {name: filled(kind.value, {"type": of, "value": value}) for name, (of, value) in notes.items()}


def _pose(pose: Any) -> tuple[float, ...]:
    return tuple(getattr(pose, name) for name in _POSE)


def _box(plane: Any) -> Box:
    from ..editing import Box  # needs MuJoCo

    point, normal = (plane.px, plane.py, plane.pz), (plane.nx, plane.ny, plane.nz)
    return Box(point, normal, (plane.width, plane.height, plane.thickness), plane.texture)
