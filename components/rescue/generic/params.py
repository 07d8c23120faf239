# Generated from rescue.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of rescue: read-only, and within their ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All of them; ConfigurationError if a value is not allowed."""

    charger_x: float = 0.8  # m, where the charging station is, -100.0 to 100.0
    charger_z: float = 3.4  # m, -100.0 to 100.0
    charger_alpha: float = 3.14  # rad, where to look when leaving it, -7.0 to 7.0
    low: float = 30.0  # % of the battery at which to go there, 1.0 to 90.0
    enough: float = 95.0  # % at which to leave it, 10.0 to 100.0
    close: int = 45  # pixels, how tall somebody near looks in the picture, 5 to 1000

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "rescue",
    (
        Parameter("charger_x", ParameterKind.FLOAT, 0.8, minimum=-100.0, maximum=100.0),
        Parameter("charger_z", ParameterKind.FLOAT, 3.4, minimum=-100.0, maximum=100.0),
        Parameter(
            "charger_alpha",
            ParameterKind.FLOAT,
            3.14,
            minimum=-7.0,
            maximum=7.0,
        ),
        Parameter("low", ParameterKind.FLOAT, 30.0, minimum=1.0, maximum=90.0),
        Parameter("enough", ParameterKind.FLOAT, 95.0, minimum=10.0, maximum=100.0),
        Parameter("close", ParameterKind.INT, 45, minimum=5, maximum=1000),
    ),
    python=Params,
)

PARAMS = Params.__spec__
