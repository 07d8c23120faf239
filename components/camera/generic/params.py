# Generated from camera.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    map: str = "../house.toml"  # file of the house, from this component's folder
    width: int = 160  # pixels, 16 to 1920
    height: int = 120  # pixels, 16 to 1080
    field_of_view: float = 70.0  # degrees from edge to edge, 20.0 to 120.0

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "camera",
    (
        Parameter(
            "map",
            ParameterKind.STRING,
            "../house.toml",
            description="file of the house, from this component's folder",
        ),
        Parameter(
            "width",
            ParameterKind.INT,
            160,
            minimum=16,
            maximum=1920,
            description="pixels",
        ),
        Parameter(
            "height",
            ParameterKind.INT,
            120,
            minimum=16,
            maximum=1080,
            description="pixels",
        ),
        Parameter(
            "field_of_view",
            ParameterKind.FLOAT,
            70.0,
            minimum=20.0,
            maximum=120.0,
            description="degrees from edge to edge",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
