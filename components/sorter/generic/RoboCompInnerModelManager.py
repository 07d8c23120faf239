# Generated from InnerModelManager.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompInnerModelManager: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    INT32,
    STRING,
    UINT8,
    DeclaredError,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Sequence,
    Struct,
)


class NodeType(IntEnum):
    """What a node is."""

    Transform = 0
    Joint = 1
    DifferentialRobot = 2
    OmniRobot = 3
    Plane = 4
    Camera = 5
    RGBD = 6
    IMU = 7
    Laser = 8
    Mesh = 9
    PointCloud = 10
    TouchSensor = 11
    DisplayII = 12

    __contract__: ClassVar[Enumeration]


NodeType.__contract__ = Enumeration(
    "RoboCompInnerModelManager::NodeType",
    (
        ("Transform", 0),
        ("Joint", 1),
        ("DifferentialRobot", 2),
        ("OmniRobot", 3),
        ("Plane", 4),
        ("Camera", 5),
        ("RGBD", 6),
        ("IMU", 7),
        ("Laser", 8),
        ("Mesh", 9),
        ("PointCloud", 10),
        ("TouchSensor", 11),
        ("DisplayII", 12),
    ),
    NodeType,
)


@dataclass(slots=True)
class AttributeType:
    """A note on a node, with a type that its author chooses."""

    type: str = ""
    value: str = ""

    __contract__: ClassVar[Struct]


AttributeType.__contract__ = Struct(
    "RoboCompInnerModelManager::AttributeType",
    (
        Field("type", STRING),
        Field("value", STRING),
    ),
    AttributeType,
    doc="A note on a node, with a type that its author chooses.",
)

AttributeMap: TypeAlias = dict[str, AttributeType]


@dataclass(slots=True)
class NodeInformation:
    """A node and its place in the tree."""

    id: str = ""
    parentId: str = ""  # empty of the root
    nType: NodeType = NodeType.Transform
    attributes: AttributeMap = field(default_factory=dict)  # the notes on it

    __contract__: ClassVar[Struct]


NodeInformation.__contract__ = Struct(
    "RoboCompInnerModelManager::NodeInformation",
    (
        Field("id", STRING),
        Field("parentId", STRING, doc="empty of the root"),
        Field("nType", NodeType.__contract__),
        Field(
            "attributes",
            Dictionary(
                STRING,
                AttributeType.__contract__,
                "RoboCompInnerModelManager::AttributeMap",
            ),
            doc="the notes on it",
        ),
    ),
    NodeInformation,
    doc="A node and its place in the tree.",
)

NodeInformationSequence: TypeAlias = list[NodeInformation]


class ErrorType(IntEnum):
    """What is wrong with a call."""

    NonExistingNode = 0
    NonExistingAttribute = 1
    NodeAlreadyExists = 2
    AttributeAlreadyExists = 3
    InvalidPath = 4
    InvalidEngine = 5
    InvalidValues = 6
    OperationInvalidNode = 7
    InternalError = 8
    Collision = 9

    __contract__: ClassVar[Enumeration]


ErrorType.__contract__ = Enumeration(
    "RoboCompInnerModelManager::ErrorType",
    (
        ("NonExistingNode", 0),
        ("NonExistingAttribute", 1),
        ("NodeAlreadyExists", 2),
        ("AttributeAlreadyExists", 3),
        ("InvalidPath", 4),
        ("InvalidEngine", 5),
        ("InvalidValues", 6),
        ("OperationInvalidNode", 7),
        ("InternalError", 8),
        ("Collision", 9),
    ),
    ErrorType,
)


@dataclass(eq=False)
class InnerModelManagerError(DeclaredError):
    """The call has changed nothing."""

    err: ErrorType = ErrorType.NonExistingNode
    text: str = ""  # what is wrong, for people

    __contract__: ClassVar[ExceptionType]


InnerModelManagerError.__contract__ = ExceptionType(
    "RoboCompInnerModelManager::InnerModelManagerError",
    (
        Field("err", ErrorType.__contract__),
        Field("text", STRING, doc="what is wrong, for people"),
    ),
    base=None,
    python=InnerModelManagerError,
    doc="The call has changed nothing.",
)


@dataclass(slots=True)
class Colored3DPoint:
    """A point with a colour."""

    x: float = 0.0  # mm
    y: float = 0.0  # mm
    z: float = 0.0  # mm
    r: int = 0
    g: int = 0
    b: int = 0

    __contract__: ClassVar[Struct]


Colored3DPoint.__contract__ = Struct(
    "RoboCompInnerModelManager::Colored3DPoint",
    (
        Field("x", FLOAT32, doc="mm"),
        Field("y", FLOAT32, doc="mm"),
        Field("z", FLOAT32, doc="mm"),
        Field("r", UINT8),
        Field("g", UINT8),
        Field("b", UINT8),
    ),
    Colored3DPoint,
    doc="A point with a colour.",
)

PointCloudVector: TypeAlias = list[Colored3DPoint]


@dataclass(slots=True)
class Plane3D:
    """A box around a point; its thickness is along its normal."""

    px: float = 0.0  # mm
    py: float = 0.0  # mm
    pz: float = 0.0  # mm
    nx: float = 0.0
    ny: float = 0.0
    nz: float = 0.0
    width: float = 0.0  # mm
    height: float = 0.0  # mm
    thickness: float = 0.0  # mm
    texture: str = ""  # a file with a picture, or a colour as `#rrggbb`

    __contract__: ClassVar[Struct]


Plane3D.__contract__ = Struct(
    "RoboCompInnerModelManager::Plane3D",
    (
        Field("px", FLOAT32, doc="mm"),
        Field("py", FLOAT32, doc="mm"),
        Field("pz", FLOAT32, doc="mm"),
        Field("nx", FLOAT32),
        Field("ny", FLOAT32),
        Field("nz", FLOAT32),
        Field("width", FLOAT32, doc="mm"),
        Field("height", FLOAT32, doc="mm"),
        Field("thickness", FLOAT32, doc="mm"),
        Field("texture", STRING, doc="a file with a picture, or a colour as `#rrggbb`"),
    ),
    Plane3D,
    doc="A box around a point; its thickness is along its normal.",
)


@dataclass(slots=True)
class coord3D:
    """A point."""

    x: float = 0.0  # mm
    y: float = 0.0  # mm
    z: float = 0.0  # mm

    __contract__: ClassVar[Struct]


coord3D.__contract__ = Struct(
    "RoboCompInnerModelManager::coord3D",
    (
        Field("x", FLOAT32, doc="mm"),
        Field("y", FLOAT32, doc="mm"),
        Field("z", FLOAT32, doc="mm"),
    ),
    coord3D,
    doc="A point.",
)


@dataclass(slots=True)
class Pose3D:
    """A pose."""

    x: float = 0.0  # mm
    y: float = 0.0  # mm
    z: float = 0.0  # mm
    rx: float = 0.0  # rad
    ry: float = 0.0  # rad
    rz: float = 0.0  # rad

    __contract__: ClassVar[Struct]


Pose3D.__contract__ = Struct(
    "RoboCompInnerModelManager::Pose3D",
    (
        Field("x", FLOAT32, doc="mm"),
        Field("y", FLOAT32, doc="mm"),
        Field("z", FLOAT32, doc="mm"),
        Field("rx", FLOAT32, doc="rad"),
        Field("ry", FLOAT32, doc="rad"),
        Field("rz", FLOAT32, doc="rad"),
    ),
    Pose3D,
    doc="A pose.",
)


@dataclass(slots=True)
class jointType:
    """A joint that turns."""

    pose: Pose3D = field(default_factory=Pose3D)  # its offset, before it turns
    lx: float = 0.0  # without effect
    ly: float = 0.0  # without effect
    lz: float = 0.0  # without effect
    hx: float = 0.0  # without effect
    hy: float = 0.0  # without effect
    hz: float = 0.0  # without effect
    mass: float = 0.0  # kg
    min: float = 0.0  # rad
    max: float = 0.0  # rad
    axis: str = ""  # x, y or z
    port: int = 0  # joints with one port are one JointMotor

    __contract__: ClassVar[Struct]


jointType.__contract__ = Struct(
    "RoboCompInnerModelManager::jointType",
    (
        Field("pose", Pose3D.__contract__, doc="its offset, before it turns"),
        Field("lx", FLOAT32, doc="without effect"),
        Field("ly", FLOAT32, doc="without effect"),
        Field("lz", FLOAT32, doc="without effect"),
        Field("hx", FLOAT32, doc="without effect"),
        Field("hy", FLOAT32, doc="without effect"),
        Field("hz", FLOAT32, doc="without effect"),
        Field("mass", FLOAT32, doc="kg"),
        Field("min", FLOAT32, doc="rad"),
        Field("max", FLOAT32, doc="rad"),
        Field("axis", STRING, doc="x, y or z"),
        Field("port", INT32, doc="joints with one port are one JointMotor"),
    ),
    jointType,
    doc="A joint that turns.",
)


@dataclass(slots=True)
class meshType:
    """A shape from a file."""

    pose: Pose3D = field(default_factory=Pose3D)
    scaleX: float = 0.0
    scaleY: float = 0.0
    scaleZ: float = 0.0
    render: int = 0  # 0: with surfaces, 1: as wires
    meshPath: str = ""  # the file, on the machine of the server

    __contract__: ClassVar[Struct]


meshType.__contract__ = Struct(
    "RoboCompInnerModelManager::meshType",
    (
        Field("pose", Pose3D.__contract__),
        Field("scaleX", FLOAT32),
        Field("scaleY", FLOAT32),
        Field("scaleZ", FLOAT32),
        Field("render", INT32, doc="0: with surfaces, 1: as wires"),
        Field("meshPath", STRING, doc="the file, on the machine of the server"),
    ),
    meshType,
    doc="A shape from a file.",
)

FloatSeq: TypeAlias = NDArray[np.float32]


@dataclass(slots=True)
class Matrix:
    """A matrix, row by row."""

    cols: int = 0
    rows: int = 0
    data: FloatSeq = field(default_factory=lambda: np.empty(0, np.float32))

    __contract__: ClassVar[Struct]


Matrix.__contract__ = Struct(
    "RoboCompInnerModelManager::Matrix",
    (
        Field("cols", INT32),
        Field("rows", INT32),
        Field("data", Sequence(FLOAT32)),
    ),
    Matrix,
    doc="A matrix, row by row.",
)

_InnerModelManager_addTransform: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "addTransform",
    inputs=(
        Field("item", STRING),
        Field("engine", STRING),
        Field("base", STRING),
        Field("pose", Pose3D.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Add a frame below `base`: `static`, or a `bullet` that moves freely.",
)
_InnerModelManager_addJoint: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "addJoint",
    inputs=(
        Field("item", STRING),
        Field("base", STRING),
        Field("j", jointType.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Add a joint below `base`.",
)
_InnerModelManager_addMesh: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "addMesh",
    inputs=(
        Field("item", STRING),
        Field("base", STRING),
        Field("m", meshType.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Add a shape from a file below `base`.",
)
_InnerModelManager_addPlane: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "addPlane",
    inputs=(
        Field("item", STRING),
        Field("base", STRING),
        Field("plane", Plane3D.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Add a box below `base`.",
)
_InnerModelManager_getAllNodeInformation: Operation[NodeInformationSequence] = (
    Operation(
        "RoboCompInnerModelManager::InnerModelManager",
        "getAllNodeInformation",
        outputs=(Field("nodesInfo", Sequence(NodeInformation.__contract__)),),
        raises=(InnerModelManagerError.__contract__,),
        doc="All nodes.",
    )
)
_InnerModelManager_setPose: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "setPose",
    inputs=(
        Field("base", STRING),
        Field("item", STRING),
        Field("pose", Pose3D.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Put a node where a pose says that is seen from `base`.",
)
_InnerModelManager_setPoseFromParent: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "setPoseFromParent",
    inputs=(
        Field("item", STRING),
        Field("pose", Pose3D.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Put a node where a pose within its parent says.",
)
_InnerModelManager_getPose: Operation[tuple[bool, Pose3D]] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "getPose",
    inputs=(
        Field("base", STRING),
        Field("item", STRING),
    ),
    outputs=(
        Field("ret", BOOL),
        Field("pose", Pose3D.__contract__),
    ),
    raises=(InnerModelManagerError.__contract__,),
    doc="The pose of a node, seen from `base`.",
)
_InnerModelManager_getPoseFromParent: Operation[tuple[bool, Pose3D]] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "getPoseFromParent",
    inputs=(Field("item", STRING),),
    outputs=(
        Field("ret", BOOL),
        Field("pose", Pose3D.__contract__),
    ),
    raises=(InnerModelManagerError.__contract__,),
    doc="The pose of a node within its parent.",
)
_InnerModelManager_setPlane: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "setPlane",
    inputs=(
        Field("item", STRING),
        Field("plane", Plane3D.__contract__),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Set the place, the size and the texture of a box.",
)
_InnerModelManager_transform: Operation[tuple[bool, coord3D]] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "transform",
    inputs=(
        Field("base", STRING),
        Field("item", STRING),
        Field("coordInItem", coord3D.__contract__),
    ),
    outputs=(
        Field("ret", BOOL),
        Field("coordInBase", coord3D.__contract__),
    ),
    raises=(InnerModelManagerError.__contract__,),
    doc="A point of the frame `item`, seen from `base`.",
)
_InnerModelManager_getTransformationMatrix: Operation[Matrix] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "getTransformationMatrix",
    inputs=(
        Field("base", STRING),
        Field("item", STRING),
    ),
    outputs=(Field("ret", Matrix.__contract__),),
    raises=(InnerModelManagerError.__contract__,),
    doc="The matrix that leads from `item` to `base`, 4 by 4.",
)
_InnerModelManager_setScale: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "setScale",
    inputs=(
        Field("item", STRING),
        Field("scaleX", FLOAT32),
        Field("scaleY", FLOAT32),
        Field("scaleZ", FLOAT32),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Set the scale of a shape from a file.",
)
_InnerModelManager_addAttribute: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "addAttribute",
    inputs=(
        Field("idNode", STRING),
        Field("name", STRING),
        Field("type", STRING),
        Field("value", STRING),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Add a note to a node.",
)
_InnerModelManager_removeAttribute: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "removeAttribute",
    inputs=(
        Field("idNode", STRING),
        Field("name", STRING),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Remove a note.",
)
_InnerModelManager_setAttribute: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "setAttribute",
    inputs=(
        Field("idNode", STRING),
        Field("name", STRING),
        Field("type", STRING),
        Field("value", STRING),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Change a note.",
)
_InnerModelManager_getAttribute: Operation[tuple[bool, str, str]] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "getAttribute",
    inputs=(
        Field("idNode", STRING),
        Field("name", STRING),
    ),
    outputs=(
        Field("ret", BOOL),
        Field("type", STRING),
        Field("value", STRING),
    ),
    raises=(InnerModelManagerError.__contract__,),
    doc="A note on a node.",
)
_InnerModelManager_removeNode: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "removeNode",
    inputs=(Field("item", STRING),),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Remove a node with all below it.",
)
_InnerModelManager_moveNode: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "moveNode",
    inputs=(
        Field("src", STRING),
        Field("dst", STRING),
    ),
    outputs=(Field("ret", BOOL),),
    raises=(InnerModelManagerError.__contract__,),
    doc="Put a node below another parent; it keeps its pose within its parent.",
)
_InnerModelManager_collide: Operation[bool] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "collide",
    inputs=(
        Field("a", STRING),
        Field("b", STRING),
    ),
    outputs=(Field("ret", BOOL),),
    doc="Whether shapes at or below two nodes overlap.",
)
_InnerModelManager_setPointCloudData: Operation[None] = Operation(
    "RoboCompInnerModelManager::InnerModelManager",
    "setPointCloudData",
    inputs=(
        Field("id", STRING),
        Field("cloud", Sequence(Colored3DPoint.__contract__)),
    ),
    doc="Set the points of a cloud.",
)
INNERMODELMANAGER_INTERFACE = Interface(
    "RoboCompInnerModelManager::InnerModelManager",
    (
        _InnerModelManager_addTransform,
        _InnerModelManager_addJoint,
        _InnerModelManager_addMesh,
        _InnerModelManager_addPlane,
        _InnerModelManager_getAllNodeInformation,
        _InnerModelManager_setPose,
        _InnerModelManager_setPoseFromParent,
        _InnerModelManager_getPose,
        _InnerModelManager_getPoseFromParent,
        _InnerModelManager_setPlane,
        _InnerModelManager_transform,
        _InnerModelManager_getTransformationMatrix,
        _InnerModelManager_setScale,
        _InnerModelManager_addAttribute,
        _InnerModelManager_removeAttribute,
        _InnerModelManager_setAttribute,
        _InnerModelManager_getAttribute,
        _InnerModelManager_removeNode,
        _InnerModelManager_moveNode,
        _InnerModelManager_collide,
        _InnerModelManager_setPointCloudData,
    ),
)


class InnerModelManagerProxy(Proxy):
    """Calls InnerModelManager of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = INNERMODELMANAGER_INTERFACE

    def addTransform(
        self,
        item: str,
        engine: str,
        base: str,
        pose: Pose3D,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Add a frame below `base`: `static`, or a `bullet` that moves freely.

        IDSL: bool addTransform(string item, string engine, string base, Pose3D pose)
        throws InnerModelManagerError
        """
        return self._ask(
            _InnerModelManager_addTransform,
            (item, engine, base, pose),
            deadline,
        )

    def addTransformAsync(
        self,
        item: str,
        engine: str,
        base: str,
        pose: Pose3D,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `addTransform` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_addTransform,
            (item, engine, base, pose),
            deadline,
        )

    def addJoint(
        self,
        item: str,
        base: str,
        j: jointType,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Add a joint below `base`.

        IDSL: bool addJoint(string item, string base, jointType j) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_addJoint, (item, base, j), deadline)

    def addJointAsync(
        self,
        item: str,
        base: str,
        j: jointType,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `addJoint` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_addJoint, (item, base, j), deadline)

    def addMesh(
        self,
        item: str,
        base: str,
        m: meshType,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Add a shape from a file below `base`.

        IDSL: bool addMesh(string item, string base, meshType m) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_addMesh, (item, base, m), deadline)

    def addMeshAsync(
        self,
        item: str,
        base: str,
        m: meshType,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `addMesh` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_addMesh, (item, base, m), deadline)

    def addPlane(
        self,
        item: str,
        base: str,
        plane: Plane3D,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Add a box below `base`.

        IDSL: bool addPlane(string item, string base, Plane3D plane) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_addPlane, (item, base, plane), deadline)

    def addPlaneAsync(
        self,
        item: str,
        base: str,
        plane: Plane3D,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `addPlane` without waiting. The Future is done within the deadline."""
        return self._ask_async(
            _InnerModelManager_addPlane,
            (item, base, plane),
            deadline,
        )

    def getAllNodeInformation(
        self,
        *,
        deadline: float | None = None,
    ) -> NodeInformationSequence:
        """All nodes.

        IDSL: void getAllNodeInformation(out NodeInformationSequence nodesInfo) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_getAllNodeInformation, (), deadline)

    def getAllNodeInformationAsync(
        self,
        *,
        deadline: float | None = None,
    ) -> Future[NodeInformationSequence]:
        """Call `getAllNodeInformation` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_InnerModelManager_getAllNodeInformation, (), deadline)

    def setPose(
        self,
        base: str,
        item: str,
        pose: Pose3D,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Put a node where a pose says that is seen from `base`.

        IDSL: bool setPose(string base, string item, Pose3D pose) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_setPose, (base, item, pose), deadline)

    def setPoseAsync(
        self,
        base: str,
        item: str,
        pose: Pose3D,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `setPose` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_setPose, (base, item, pose), deadline)

    def setPoseFromParent(
        self,
        item: str,
        pose: Pose3D,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Put a node where a pose within its parent says.

        IDSL: bool setPoseFromParent(string item, Pose3D pose) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_setPoseFromParent, (item, pose), deadline)

    def setPoseFromParentAsync(
        self,
        item: str,
        pose: Pose3D,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `setPoseFromParent` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_setPoseFromParent,
            (item, pose),
            deadline,
        )

    def getPose(
        self,
        base: str,
        item: str,
        *,
        deadline: float | None = None,
    ) -> tuple[bool, Pose3D]:
        """The pose of a node, seen from `base`.

        IDSL: bool getPose(string base, string item, out Pose3D pose) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_getPose, (base, item), deadline)

    def getPoseAsync(
        self,
        base: str,
        item: str,
        *,
        deadline: float | None = None,
    ) -> Future[tuple[bool, Pose3D]]:
        """Call `getPose` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_getPose, (base, item), deadline)

    def getPoseFromParent(
        self,
        item: str,
        *,
        deadline: float | None = None,
    ) -> tuple[bool, Pose3D]:
        """The pose of a node within its parent.

        IDSL: bool getPoseFromParent(string item, out Pose3D pose) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_getPoseFromParent, (item,), deadline)

    def getPoseFromParentAsync(
        self,
        item: str,
        *,
        deadline: float | None = None,
    ) -> Future[tuple[bool, Pose3D]]:
        """Call `getPoseFromParent` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_InnerModelManager_getPoseFromParent, (item,), deadline)

    def setPlane(
        self,
        item: str,
        plane: Plane3D,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Set the place, the size and the texture of a box.

        IDSL: bool setPlane(string item, Plane3D plane) throws InnerModelManagerError
        """
        return self._ask(_InnerModelManager_setPlane, (item, plane), deadline)

    def setPlaneAsync(
        self,
        item: str,
        plane: Plane3D,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `setPlane` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_setPlane, (item, plane), deadline)

    def transform(
        self,
        base: str,
        item: str,
        coordInItem: coord3D,
        *,
        deadline: float | None = None,
    ) -> tuple[bool, coord3D]:
        """A point of the frame `item`, seen from `base`.

        IDSL: bool transform(string base, string item, coord3D coordInItem, out coord3D
        coordInBase) throws InnerModelManagerError
        """
        return self._ask(
            _InnerModelManager_transform,
            (base, item, coordInItem),
            deadline,
        )

    def transformAsync(
        self,
        base: str,
        item: str,
        coordInItem: coord3D,
        *,
        deadline: float | None = None,
    ) -> Future[tuple[bool, coord3D]]:
        """Call `transform` without waiting. The Future is done within the deadline."""
        return self._ask_async(
            _InnerModelManager_transform,
            (base, item, coordInItem),
            deadline,
        )

    def getTransformationMatrix(
        self,
        base: str,
        item: str,
        *,
        deadline: float | None = None,
    ) -> Matrix:
        """The matrix that leads from `item` to `base`, 4 by 4.

        IDSL: Matrix getTransformationMatrix(string base, string item) throws
        InnerModelManagerError
        """
        return self._ask(
            _InnerModelManager_getTransformationMatrix,
            (base, item),
            deadline,
        )

    def getTransformationMatrixAsync(
        self,
        base: str,
        item: str,
        *,
        deadline: float | None = None,
    ) -> Future[Matrix]:
        """Call `getTransformationMatrix` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_getTransformationMatrix,
            (base, item),
            deadline,
        )

    def setScale(
        self,
        item: str,
        scaleX: float,
        scaleY: float,
        scaleZ: float,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Set the scale of a shape from a file.

        IDSL: bool setScale(string item, float scaleX, float scaleY, float scaleZ)
        throws InnerModelManagerError
        """
        return self._ask(
            _InnerModelManager_setScale,
            (item, scaleX, scaleY, scaleZ),
            deadline,
        )

    def setScaleAsync(
        self,
        item: str,
        scaleX: float,
        scaleY: float,
        scaleZ: float,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `setScale` without waiting. The Future is done within the deadline."""
        return self._ask_async(
            _InnerModelManager_setScale,
            (item, scaleX, scaleY, scaleZ),
            deadline,
        )

    def addAttribute(
        self,
        idNode: str,
        name: str,
        type: str,
        value: str,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Add a note to a node.

        IDSL: bool addAttribute(string idNode, string name, string type, string value)
        throws InnerModelManagerError
        """
        return self._ask(
            _InnerModelManager_addAttribute,
            (idNode, name, type, value),
            deadline,
        )

    def addAttributeAsync(
        self,
        idNode: str,
        name: str,
        type: str,
        value: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `addAttribute` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_addAttribute,
            (idNode, name, type, value),
            deadline,
        )

    def removeAttribute(
        self,
        idNode: str,
        name: str,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Remove a note.

        IDSL: bool removeAttribute(string idNode, string name) throws
        InnerModelManagerError
        """
        return self._ask(_InnerModelManager_removeAttribute, (idNode, name), deadline)

    def removeAttributeAsync(
        self,
        idNode: str,
        name: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `removeAttribute` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_removeAttribute,
            (idNode, name),
            deadline,
        )

    def setAttribute(
        self,
        idNode: str,
        name: str,
        type: str,
        value: str,
        *,
        deadline: float | None = None,
    ) -> bool:
        """Change a note.

        IDSL: bool setAttribute(string idNode, string name, string type, string value)
        throws InnerModelManagerError
        """
        return self._ask(
            _InnerModelManager_setAttribute,
            (idNode, name, type, value),
            deadline,
        )

    def setAttributeAsync(
        self,
        idNode: str,
        name: str,
        type: str,
        value: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `setAttribute` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_setAttribute,
            (idNode, name, type, value),
            deadline,
        )

    def getAttribute(
        self,
        idNode: str,
        name: str,
        *,
        deadline: float | None = None,
    ) -> tuple[bool, str, str]:
        """A note on a node.

        IDSL: bool getAttribute(string idNode, string name, out string type, out string
        value) throws InnerModelManagerError
        """
        return self._ask(_InnerModelManager_getAttribute, (idNode, name), deadline)

    def getAttributeAsync(
        self,
        idNode: str,
        name: str,
        *,
        deadline: float | None = None,
    ) -> Future[tuple[bool, str, str]]:
        """Call `getAttribute` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_getAttribute,
            (idNode, name),
            deadline,
        )

    def removeNode(self, item: str, *, deadline: float | None = None) -> bool:
        """Remove a node with all below it.

        IDSL: bool removeNode(string item) throws InnerModelManagerError
        """
        return self._ask(_InnerModelManager_removeNode, (item,), deadline)

    def removeNodeAsync(
        self,
        item: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `removeNode` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_removeNode, (item,), deadline)

    def moveNode(self, src: str, dst: str, *, deadline: float | None = None) -> bool:
        """Put a node below another parent; it keeps its pose within its parent.

        IDSL: bool moveNode(string src, string dst) throws InnerModelManagerError
        """
        return self._ask(_InnerModelManager_moveNode, (src, dst), deadline)

    def moveNodeAsync(
        self,
        src: str,
        dst: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `moveNode` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_moveNode, (src, dst), deadline)

    def collide(self, a: str, b: str, *, deadline: float | None = None) -> bool:
        """Whether shapes at or below two nodes overlap.

        IDSL: bool collide(string a, string b)
        """
        return self._ask(_InnerModelManager_collide, (a, b), deadline)

    def collideAsync(
        self,
        a: str,
        b: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `collide` without waiting. The Future is done within the deadline."""
        return self._ask_async(_InnerModelManager_collide, (a, b), deadline)

    def setPointCloudData(
        self,
        id: str,
        cloud: PointCloudVector,
        *,
        deadline: float | None = None,
    ) -> None:
        """Set the points of a cloud.

        IDSL: void setPointCloudData(string id, PointCloudVector cloud)
        """
        return self._ask(_InnerModelManager_setPointCloudData, (id, cloud), deadline)

    def setPointCloudDataAsync(
        self,
        id: str,
        cloud: PointCloudVector,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `setPointCloudData` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(
            _InnerModelManager_setPointCloudData,
            (id, cloud),
            deadline,
        )
