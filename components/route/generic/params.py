# Generated from route.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of route."""

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
class PlacesItem(Parameters):
    """An item of places. Raises ConfigurationError if a value is not allowed."""

    x: float = 0.0  # m to the right, -1000.0 to 1000.0
    z: float = 0.0  # m ahead, -1000.0 to 1000.0
    alpha: float = 0.0  # rad, positive to the right, -6.3 to 6.3

    __spec__: ClassVar[ParameterSet]


PlacesItem.__spec__ = ParameterSet(
    "places",
    (
        Parameter(
            "x",
            ParameterKind.FLOAT,
            0.0,
            minimum=-1000.0,
            maximum=1000.0,
            description="m to the right",
        ),
        Parameter(
            "z",
            ParameterKind.FLOAT,
            0.0,
            minimum=-1000.0,
            maximum=1000.0,
            description="m ahead",
        ),
        Parameter(
            "alpha",
            ParameterKind.FLOAT,
            0.0,
            minimum=-6.3,
            maximum=6.3,
            description="rad, positive to the right",
        ),
    ),
    python=PlacesItem,
)


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    speed: float = 0.8  # m/s on a free way, 0.05 to 2.0
    turning: float = 1.0  # rad/s, the fastest turn, 0.1 to 3.0
    # m and rad from a place at which it counts as reached, 0.01 to 1.0
    near: float = 0.03
    wide: float = 0.33  # m, half of the width of the robot, 0.1 to 2.0
    long: float = 0.43  # m, half of the length of the robot, 0.1 to 2.0
    margin: float = 0.06  # m that must be free around it, 0.0 to 1.0
    # in this order; the robot looks to alpha at each
    places: tuple[PlacesItem, ...] = ()

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "route",
    (
        Parameter(
            "speed",
            ParameterKind.FLOAT,
            0.8,
            minimum=0.05,
            maximum=2.0,
            description="m/s on a free way",
        ),
        Parameter(
            "turning",
            ParameterKind.FLOAT,
            1.0,
            minimum=0.1,
            maximum=3.0,
            description="rad/s, the fastest turn",
        ),
        Parameter(
            "near",
            ParameterKind.FLOAT,
            0.03,
            minimum=0.01,
            maximum=1.0,
            description="m and rad from a place at which it counts as reached",
        ),
        Parameter(
            "wide",
            ParameterKind.FLOAT,
            0.33,
            minimum=0.1,
            maximum=2.0,
            description="m, half of the width of the robot",
        ),
        Parameter(
            "long",
            ParameterKind.FLOAT,
            0.43,
            minimum=0.1,
            maximum=2.0,
            description="m, half of the length of the robot",
        ),
        Parameter(
            "margin",
            ParameterKind.FLOAT,
            0.06,
            minimum=0.0,
            maximum=1.0,
            description="m that must be free around it",
        ),
    ),
    lists=(
        ParameterList(
            "places",
            PlacesItem.__spec__,
            description="in this order; the robot looks to alpha at each",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
