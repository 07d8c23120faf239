# Generated from sorter.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of sorter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    belt: float = 80.0  # mm/s, the speed of the conveyor along z, 1.0 to 500.0
    parts: int = 6  # number of parts on it: `part1`, `part2`, and so on, 1 to 6

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "sorter",
    (
        Parameter(
            "belt",
            ParameterKind.FLOAT,
            80.0,
            minimum=1.0,
            maximum=500.0,
            description="mm/s, the speed of the conveyor along z",
        ),
        Parameter(
            "parts",
            ParameterKind.INT,
            6,
            minimum=1,
            maximum=6,
            description="number of parts on it: `part1`, `part2`, and so on",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
