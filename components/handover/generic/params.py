# Generated from handover.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of handover."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    times: int = 4  # how often the bottle is handed over, 1 to 1000

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "handover",
    (
        Parameter(
            "times",
            ParameterKind.INT,
            4,
            minimum=1,
            maximum=1000,
            description="how often the bottle is handed over",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
