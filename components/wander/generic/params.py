# Generated from wander.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of wander."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    explores: bool = False  # whether it explores before it is told to
    speed: float = 1.2  # m/s on a free way, 0.1 to 2.0
    near: float = 0.15  # m to a place at which it counts as reached, 0.05 to 1.0

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "wander",
    (
        Parameter(
            "explores",
            ParameterKind.BOOL,
            False,
            description="whether it explores before it is told to",
        ),
        Parameter(
            "speed",
            ParameterKind.FLOAT,
            1.2,
            minimum=0.1,
            maximum=2.0,
            description="m/s on a free way",
        ),
        Parameter(
            "near",
            ParameterKind.FLOAT,
            0.15,
            minimum=0.05,
            maximum=1.0,
            description="m to a place at which it counts as reached",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
