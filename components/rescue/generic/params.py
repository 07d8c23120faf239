# Generated from rescue.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of rescue."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    charger_x: float = 0.8  # m, where the charging station is, -100.0 to 100.0
    charger_z: float = 2.6  # m, -100.0 to 100.0
    charger_alpha: float = 3.14  # rad, where to look there, -6.3 to 6.3
    low: float = 30.0  # % of the battery at which to go there, 1.0 to 90.0
    enough: float = 95.0  # % of the battery at which to leave it, 10.0 to 100.0
    near: int = 60  # height in pixels of a victim that is near enough, 5 to 1000

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "rescue",
    (
        Parameter(
            "charger_x",
            ParameterKind.FLOAT,
            0.8,
            minimum=-100.0,
            maximum=100.0,
            description="m, where the charging station is",
        ),
        Parameter(
            "charger_z",
            ParameterKind.FLOAT,
            2.6,
            minimum=-100.0,
            maximum=100.0,
            description="m",
        ),
        Parameter(
            "charger_alpha",
            ParameterKind.FLOAT,
            3.14,
            minimum=-6.3,
            maximum=6.3,
            description="rad, where to look there",
        ),
        Parameter(
            "low",
            ParameterKind.FLOAT,
            30.0,
            minimum=1.0,
            maximum=90.0,
            description="% of the battery at which to go there",
        ),
        Parameter(
            "enough",
            ParameterKind.FLOAT,
            95.0,
            minimum=10.0,
            maximum=100.0,
            description="% of the battery at which to leave it",
        ),
        Parameter(
            "near",
            ParameterKind.INT,
            60,
            minimum=5,
            maximum=1000,
            description="height in pixels of a victim that is near enough",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
