# Generated from speech.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of speech."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    computes_per_word: int = 3  # how long a word takes, 1 to 100

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "speech",
    (
        Parameter(
            "computes_per_word",
            ParameterKind.INT,
            3,
            minimum=1,
            maximum=100,
            description="how long a word takes",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
