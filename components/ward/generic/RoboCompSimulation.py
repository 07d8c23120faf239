# Generated from Simulation.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompSimulation: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT32,
    INT64,
    STRING,
    UINT8,
    DeclaredError,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Sequence,
    Struct,
)


@dataclass(eq=False)
class SimulationException(DeclaredError):
    """What is asked cannot be done."""

    what: str = ""  # why, and what can be done, for people

    __contract__: ClassVar[ExceptionType]


SimulationException.__contract__ = ExceptionType(
    "RoboCompSimulation::SimulationException",
    (Field("what", STRING, doc="why, and what can be done, for people"),),
    base=None,
    python=SimulationException,
    doc="What is asked cannot be done.",
)


@dataclass(slots=True)
class Moment:
    """How far a simulation is."""

    tick: int = 0  # ticks since its beginning
    time: float = 0.0  # s since its beginning
    paused: bool = False  # whether it stands still until `resume` or `step`
    physics: bool = False  # whether bodies have weight and shapes are solid
    speed: float = 0.0  # what it was told by setSpeed
    # simulated seconds in a second of the component's clock, lately
    reached: float = 0.0

    __contract__: ClassVar[Struct]


Moment.__contract__ = Struct(
    "RoboCompSimulation::Moment",
    (
        Field("tick", INT64, doc="ticks since its beginning"),
        Field("time", FLOAT64, doc="s since its beginning"),
        Field("paused", BOOL, doc="whether it stands still until `resume` or `step`"),
        Field("physics", BOOL, doc="whether bodies have weight and shapes are solid"),
        Field("speed", FLOAT64, doc="what it was told by setSpeed"),
        Field(
            "reached",
            FLOAT64,
            doc="simulated seconds in a second of the component's clock, lately",
        ),
    ),
    Moment,
    doc="How far a simulation is.",
)

IdList: TypeAlias = list[str]


@dataclass(slots=True)
class NodePose:
    """Where a node truly is: its position in mm, and its rotation Rx·Ry·Rz in rad, seen
    from the root of the scene.
    """

    id: str = ""
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    rx: float = 0.0
    ry: float = 0.0
    rz: float = 0.0

    __contract__: ClassVar[Struct]


NodePose.__contract__ = Struct(
    "RoboCompSimulation::NodePose",
    (
        Field("id", STRING),
        Field("x", FLOAT64),
        Field("y", FLOAT64),
        Field("z", FLOAT64),
        Field("rx", FLOAT64),
        Field("ry", FLOAT64),
        Field("rz", FLOAT64),
    ),
    NodePose,
    doc="Where a node truly is: its position in mm, and its rotation Rx·Ry·Rz in rad, seen from the root of the scene.",  # noqa: E501, RUF100
)

PoseList: TypeAlias = list[NodePose]


@dataclass(slots=True)
class Contact:
    """Two shapes that touch."""

    one: str = ""
    other: str = ""
    force: float = 0.0  # N, with which they press on each other; of a plan, 0
    # s since the beginning; of a plan, when they touched first, since its beginning
    time: float = 0.0

    __contract__: ClassVar[Struct]


Contact.__contract__ = Struct(
    "RoboCompSimulation::Contact",
    (
        Field("one", STRING),
        Field("other", STRING),
        Field(
            "force",
            FLOAT64,
            doc="N, with which they press on each other; of a plan, 0",
        ),
        Field(
            "time",
            FLOAT64,
            doc="s since the beginning; of a plan, when they touched first, since its beginning",  # noqa: E501, RUF100
        ),
    ),
    Contact,
    doc="Two shapes that touch.",
)

ContactList: TypeAlias = list[Contact]

NumberList: TypeAlias = NDArray[np.float64]


@dataclass(slots=True)
class Command:
    """What a robot is told at a time of a plan."""

    at: float = 0.0  # s since the beginning of the plan
    node: str = ""  # a base, a joint or a gripper
    # a base: mm/s ahead, mm/s aside, rad/s; a joint: position, speed; a gripper: 1 or 0
    values: NumberList = field(default_factory=lambda: np.empty(0, np.float64))

    __contract__: ClassVar[Struct]


Command.__contract__ = Struct(
    "RoboCompSimulation::Command",
    (
        Field("at", FLOAT64, doc="s since the beginning of the plan"),
        Field("node", STRING, doc="a base, a joint or a gripper"),
        Field(
            "values",
            Sequence(FLOAT64),
            doc="a base: mm/s ahead, mm/s aside, rad/s; a joint: position, speed; a gripper: 1 or 0",  # noqa: E501, RUF100
        ),
    ),
    Command,
    doc="What a robot is told at a time of a plan.",
)

Plan: TypeAlias = list[Command]

PlanList: TypeAlias = list[Plan]


@dataclass(slots=True)
class Pair:
    """Two nodes whose distance is watched."""

    one: str = ""
    other: str = ""

    __contract__: ClassVar[Struct]


Pair.__contract__ = Struct(
    "RoboCompSimulation::Pair",
    (
        Field("one", STRING),
        Field("other", STRING),
    ),
    Pair,
    doc="Two nodes whose distance is watched.",
)

PairList: TypeAlias = list[Pair]


@dataclass(slots=True)
class Outcome:
    """What a plan leads to."""

    # of all nodes that can move, at its end
    poses: PoseList = field(default_factory=list)
    # what touched, in the order of the first time
    contacts: ContactList = field(default_factory=list)
    # mm, the least ones of the watched pairs; 0 or less: they overlapped
    distances: NumberList = field(default_factory=lambda: np.empty(0, np.float64))
    failed: str = ""  # why it ended early; empty if it did not

    __contract__: ClassVar[Struct]


Outcome.__contract__ = Struct(
    "RoboCompSimulation::Outcome",
    (
        Field(
            "poses",
            Sequence(NodePose.__contract__),
            doc="of all nodes that can move, at its end",
        ),
        Field(
            "contacts",
            Sequence(Contact.__contract__),
            doc="what touched, in the order of the first time",
        ),
        Field(
            "distances",
            Sequence(FLOAT64),
            doc="mm, the least ones of the watched pairs; 0 or less: they overlapped",
        ),
        Field("failed", STRING, doc="why it ended early; empty if it did not"),
    ),
    Outcome,
    doc="What a plan leads to.",
)

OutcomeList: TypeAlias = list[Outcome]

FloatList: TypeAlias = NDArray[np.float32]

ByteList: TypeAlias = NDArray[np.uint8]


@dataclass(slots=True)
class Cloud:
    """Points that a component has set."""

    version: int = 0  # another one each time they are set; 0: never
    # x, y and z of each, mm, in the frame of its node
    points: FloatList = field(default_factory=lambda: np.empty(0, np.float32))
    # red, green and blue of each
    colours: ByteList = field(default_factory=lambda: np.empty(0, np.uint8))

    __contract__: ClassVar[Struct]


Cloud.__contract__ = Struct(
    "RoboCompSimulation::Cloud",
    (
        Field("version", INT64, doc="another one each time they are set; 0: never"),
        Field(
            "points",
            Sequence(FLOAT32),
            doc="x, y and z of each, mm, in the frame of its node",
        ),
        Field("colours", Sequence(UINT8), doc="red, green and blue of each"),
    ),
    Cloud,
    doc="Points that a component has set.",
)

_Simulation_now: Operation[Moment] = Operation(
    "RoboCompSimulation::Simulation",
    "now",
    outputs=(Field("ret", Moment.__contract__),),
    idempotent=True,
    doc="How far it is.",
)
_Simulation_step: Operation[Moment] = Operation(
    "RoboCompSimulation::Simulation",
    "step",
    inputs=(Field("count", INT32),),
    outputs=(Field("ret", Moment.__contract__),),
    raises=(SimulationException.__contract__,),
    doc="Go on by a number of ticks at once, whether it is paused or not: at most 20000 in one call.",  # noqa: E501, RUF100
)
_Simulation_pause: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "pause",
    idempotent=True,
    doc="Stand still. Sensors and motors answer meanwhile, and goals wait.",
)
_Simulation_resume: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "resume",
    idempotent=True,
    doc="Go on after a pause.",
)
_Simulation_setSpeed: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "setSpeed",
    inputs=(Field("factor", FLOAT64),),
    raises=(SimulationException.__contract__,),
    idempotent=True,
    doc="Go on at this factor of the component's clock: 2 is twice as fast; 0 is as fast as the machine can, which\nneeds a component that follows the machine's clock.",  # noqa: E501, RUF100
)
_Simulation_reset: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "reset",
    inputs=(Field("seed", INT32),),
    raises=(SimulationException.__contract__,),
    doc="Begin again at tick 0, with everything as the file has it, and noise of this seed.",  # noqa: E501, RUF100
)
_Simulation_setPhysics: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "setPhysics",
    inputs=(Field("on", BOOL),),
    idempotent=True,
    doc="Switch physics on or off: with it, bodies have weight, shapes are solid, and motors have to move them.",  # noqa: E501, RUF100
)
_Simulation_setNoise: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "setNoise",
    inputs=(
        Field("id", STRING),
        Field("sigma", FLOAT64),
    ),
    raises=(SimulationException.__contract__,),
    idempotent=True,
    doc="Set the standard deviation of the noise of a node: of a laser in mm; of an imu in m/s² and rad/s; of a base as\na part of its speed; of an rgbd as a part of its depths.",  # noqa: E501, RUF100
)
_Simulation_scene: Operation[str] = Operation(
    "RoboCompSimulation::Simulation",
    "scene",
    outputs=(Field("ret", STRING),),
    idempotent=True,
    doc="The scene with all edits so far: a file of InnerModel with absolute paths, in which what moves is where it began.",  # noqa: E501, RUF100
)
_Simulation_cloud: Operation[Cloud] = Operation(
    "RoboCompSimulation::Simulation",
    "cloud",
    inputs=(
        Field("id", STRING),
        Field("known", INT64),
    ),
    outputs=(Field("ret", Cloud.__contract__),),
    raises=(SimulationException.__contract__,),
    idempotent=True,
    doc="The points of a `pointcloud`; none if their version is still the one that the caller knows.",  # noqa: E501, RUF100
)
_Simulation_poses: Operation[PoseList] = Operation(
    "RoboCompSimulation::Simulation",
    "poses",
    inputs=(Field("ids", Sequence(STRING)),),
    outputs=(Field("ret", Sequence(NodePose.__contract__)),),
    raises=(SimulationException.__contract__,),
    idempotent=True,
    doc="Where nodes truly are. Without ids: all nodes that can move.",
)
_Simulation_contacts: Operation[ContactList] = Operation(
    "RoboCompSimulation::Simulation",
    "contacts",
    outputs=(Field("ret", Sequence(Contact.__contract__)),),
    idempotent=True,
    doc="What touches while physics is on.",
)
_Simulation_attach: Operation[str] = Operation(
    "RoboCompSimulation::Simulation",
    "attach",
    inputs=(Field("gripper", STRING),),
    outputs=(Field("ret", STRING),),
    raises=(SimulationException.__contract__,),
    doc="Switch a suction cup or magnet on; returns the body that it holds then, or nothing if it reaches none.",  # noqa: E501, RUF100
)
_Simulation_detach: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "detach",
    inputs=(Field("gripper", STRING),),
    raises=(SimulationException.__contract__,),
    idempotent=True,
    doc="Switch it off.",
)
_Simulation_save: Operation[int] = Operation(
    "RoboCompSimulation::Simulation",
    "save",
    outputs=(Field("ret", INT64),),
    doc="Keep the state of now, and return a token for it. The oldest of more than 16 is dropped.",  # noqa: E501, RUF100
)
_Simulation_restore: Operation[None] = Operation(
    "RoboCompSimulation::Simulation",
    "restore",
    inputs=(Field("token", INT64),),
    raises=(SimulationException.__contract__,),
    doc="Go on from a kept state, as often as needed.",
)
_Simulation_evaluate: Operation[OutcomeList] = Operation(
    "RoboCompSimulation::Simulation",
    "evaluate",
    inputs=(
        Field("plans", Sequence(Sequence(Command.__contract__))),
        Field("horizon", FLOAT64),
        Field("watched", Sequence(Pair.__contract__)),
    ),
    outputs=(Field("ret", Sequence(Outcome.__contract__)),),
    raises=(SimulationException.__contract__,),
    idempotent=True,
    doc="Try plans for a time in s, each in a copy of the scene, which itself does not change: at most 64 plans, and\n600 s of all together. Distances of pairs are noted each 50 ms.",  # noqa: E501, RUF100
)
SIMULATION_INTERFACE = Interface(
    "RoboCompSimulation::Simulation",
    (
        _Simulation_now,
        _Simulation_step,
        _Simulation_pause,
        _Simulation_resume,
        _Simulation_setSpeed,
        _Simulation_reset,
        _Simulation_setPhysics,
        _Simulation_setNoise,
        _Simulation_scene,
        _Simulation_cloud,
        _Simulation_poses,
        _Simulation_contacts,
        _Simulation_attach,
        _Simulation_detach,
        _Simulation_save,
        _Simulation_restore,
        _Simulation_evaluate,
    ),
)
