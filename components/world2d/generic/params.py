# Generated from world2d.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of world2d."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import Parameter, ParameterKind, Parameters, ParameterSet


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    map: str = "../house.toml"  # file of the house, from this component's folder
    picture: str = ""  # SVG file to draw at the end what happened; none if empty
    step: float = 0.05  # s that pass in the world with every compute, 0.001 to 1.0
    max_adv: float = 1.5  # m/s, the fastest it drives, 0.1 to 3.0
    max_rot: float = 2.5  # rad/s, the fastest it turns, 0.1 to 10.0
    battery: float = 60.0  # %, what the battery holds at the start, 0.0 to 100.0
    capacity: float = 1.0  # Wh, what the battery holds when it is full, 0.1 to 100.0
    beams: int = 91  # measures in a scan, 3 to 1081
    noise: float = 10.0  # mm, standard deviation of a measure, 0.0 to 200.0
    seed: int = 1  # what the noise begins with, 0 to 1000000

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "world2d",
    (
        Parameter(
            "map",
            ParameterKind.STRING,
            "../house.toml",
            description="file of the house, from this component's folder",
        ),
        Parameter(
            "picture",
            ParameterKind.STRING,
            "",
            description="SVG file to draw at the end what happened; none if empty",
        ),
        Parameter(
            "step",
            ParameterKind.FLOAT,
            0.05,
            minimum=0.001,
            maximum=1.0,
            description="s that pass in the world with every compute",
        ),
        Parameter(
            "max_adv",
            ParameterKind.FLOAT,
            1.5,
            minimum=0.1,
            maximum=3.0,
            description="m/s, the fastest it drives",
        ),
        Parameter(
            "max_rot",
            ParameterKind.FLOAT,
            2.5,
            minimum=0.1,
            maximum=10.0,
            description="rad/s, the fastest it turns",
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
            "beams",
            ParameterKind.INT,
            91,
            minimum=3,
            maximum=1081,
            description="measures in a scan",
        ),
        Parameter(
            "noise",
            ParameterKind.FLOAT,
            10.0,
            minimum=0.0,
            maximum=200.0,
            description="mm, standard deviation of a measure",
        ),
        Parameter(
            "seed",
            ParameterKind.INT,
            1,
            minimum=0,
            maximum=1000000,
            description="what the noise begins with",
        ),
    ),
    python=Params,
)

PARAMS = Params.__spec__
