# Generated from arm.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    # InnerModel file with the arm, from this component's folder
    scene: str = "../cell/belt.xml"
    tool: str = "lefttool"  # id of the frame of its tool; all joints above it are moved
    speed: float = 500.0  # mm/s, of the tool, 1.0 to 2000.0
    turning: float = 2.0  # rad/s, of the tool, 0.1 to 10.0

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "arm",
    (
        Parameter(
            "scene",
            ParameterKind.STRING,
            "../cell/belt.xml",
            description="InnerModel file with the arm, from this component's folder",
        ),
        Parameter(
            "tool",
            ParameterKind.STRING,
            "lefttool",
            description="id of the frame of its tool; all joints above it are moved",
        ),
        Parameter(
            "speed",
            ParameterKind.FLOAT,
            500.0,
            minimum=1.0,
            maximum=2000.0,
            description="mm/s, of the tool",
        ),
        Parameter(
            "turning",
            ParameterKind.FLOAT,
            2.0,
            minimum=0.1,
            maximum=10.0,
            description="rad/s, of the tool",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
