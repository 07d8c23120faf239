# Generated from arena.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of arena."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    Parameter,
    ParameterKind,
    ParameterList,
    Parameters,
    ParameterSet,
)


@dataclass(frozen=True, slots=True)
class BodiesItem(Parameters):
    """An item of bodies. Raises ConfigurationError if a value is not allowed."""

    id: str = ""  # of the node
    mass: float = -1.0  # kg, of a base, a joint or a free body, -1.0 to 1000000.0
    # of a shape, or of all shapes below the node, -1.0 to 1000.0
    friction: float = -1.0
    # N, or N m: the most that the motor of a base or a joint gives, -1.0 to 1000000.0
    force: float = -1.0
    # mm/s: the speed of the surface of a plane along its z; 0: none, -100000.0 to
    # 100000.0
    belt: float = 0.0
    # mm: how far a suction cup or magnet reaches; -1: neither, -1.0 to 1000.0
    suction: float = -1.0

    __spec__: ClassVar[ParameterSet]


BodiesItem.__spec__ = ParameterSet(
    "bodies",
    (
        Parameter(
            "id",
            ParameterKind.STRING,
            "",
            mandatory=True,
            description="of the node",
        ),
        Parameter(
            "mass",
            ParameterKind.FLOAT,
            -1.0,
            minimum=-1.0,
            maximum=1000000.0,
            description="kg, of a base, a joint or a free body",
        ),
        Parameter(
            "friction",
            ParameterKind.FLOAT,
            -1.0,
            minimum=-1.0,
            maximum=1000.0,
            description="of a shape, or of all shapes below the node",
        ),
        Parameter(
            "force",
            ParameterKind.FLOAT,
            -1.0,
            minimum=-1.0,
            maximum=1000000.0,
            description="N, or N m: the most that the motor of a base or a joint gives",
        ),
        Parameter(
            "belt",
            ParameterKind.FLOAT,
            0.0,
            minimum=-100000.0,
            maximum=100000.0,
            description=(
                "mm/s: the speed of the surface of a plane along its z; 0: none"
            ),
        ),
        Parameter(
            "suction",
            ParameterKind.FLOAT,
            -1.0,
            minimum=-1.0,
            maximum=1000.0,
            description="mm: how far a suction cup or magnet reaches; -1: neither",
        ),
    ),
    python=BodiesItem,
)


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    scene: str = "arena.xml"  # InnerModel file, from this component's folder
    seed: int = 1  # what noise begins with, 0 to 1000000
    physics: bool = False  # whether bodies have weight and shapes are solid
    without_meshes: bool = False  # whether meshes whose files are missing are left out
    battery: float = 60.0  # %, what the battery holds at the start, 0.0 to 100.0
    capacity: float = 1.0  # Wh, what the battery holds when it is full, 0.1 to 100.0
    laser_noise: float = 10.0  # mm, standard deviation of a measure, 0.0 to 200.0
    film: str = ""  # GIF file to draw at the end what happened; none if empty
    # what physics needs of nodes and the file does not say; -1: as usual
    bodies: tuple[BodiesItem, ...] = ()

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "arena",
    (
        Parameter(
            "scene",
            ParameterKind.STRING,
            "arena.xml",
            description="InnerModel file, from this component's folder",
        ),
        Parameter(
            "seed",
            ParameterKind.INT,
            1,
            minimum=0,
            maximum=1000000,
            description="what noise begins with",
        ),
        Parameter(
            "physics",
            ParameterKind.BOOL,
            False,
            description="whether bodies have weight and shapes are solid",
        ),
        Parameter(
            "without_meshes",
            ParameterKind.BOOL,
            False,
            description="whether meshes whose files are missing are left out",
        ),
        Parameter(
            "battery",
            ParameterKind.FLOAT,
            60.0,
            minimum=0.0,
            maximum=100.0,
            description="%, what the battery holds at the start",
        ),
        Parameter(
            "capacity",
            ParameterKind.FLOAT,
            1.0,
            minimum=0.1,
            maximum=100.0,
            description="Wh, what the battery holds when it is full",
        ),
        Parameter(
            "laser_noise",
            ParameterKind.FLOAT,
            10.0,
            minimum=0.0,
            maximum=200.0,
            description="mm, standard deviation of a measure",
        ),
        Parameter(
            "film",
            ParameterKind.STRING,
            "",
            description="GIF file to draw at the end what happened; none if empty",
        ),
    ),
    lists=(
        ParameterList(
            "bodies",
            BodiesItem.__spec__,
            description=(
                "what physics needs of nodes and the file does not say; -1: as usual"
            ),
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
