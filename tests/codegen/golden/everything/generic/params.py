# Generated from everything.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of everything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from robocomp_py.runtime.api import (
    Parameter,
    ParameterKind,
    ParameterList,
    Parameters,
    ParameterSet,
)


@dataclass(frozen=True, slots=True)
class MotorsGainsItem(Parameters):
    """An item of gains. Raises ConfigurationError if a value is not allowed."""

    p: float = 1.0
    i: float = 0.0

    __spec__: ClassVar[ParameterSet]


MotorsGainsItem.__spec__ = ParameterSet(
    "gains",
    (
        Parameter("p", ParameterKind.FLOAT, 1.0),
        Parameter("i", ParameterKind.FLOAT, 0.0),
    ),
    python=MotorsGainsItem,
)


@dataclass(frozen=True, slots=True)
class MotorsItem(Parameters):
    """An item of motors. Raises ConfigurationError if a value is not allowed."""

    id: int = 0
    gains: tuple[MotorsGainsItem, ...] = ()

    __spec__: ClassVar[ParameterSet]


MotorsItem.__spec__ = ParameterSet(
    "motors",
    (Parameter("id", ParameterKind.INT, 0, mandatory=True),),
    lists=(ParameterList("gains", MotorsGainsItem.__spec__),),
    python=MotorsItem,
)


@dataclass(frozen=True, slots=True)
class SensorsGainsItem(Parameters):
    """An item of gains. Raises ConfigurationError if a value is not allowed."""

    factor: float = 1.0

    __spec__: ClassVar[ParameterSet]


SensorsGainsItem.__spec__ = ParameterSet(
    "gains",
    (Parameter("factor", ParameterKind.DOUBLE, 1.0),),
    python=SensorsGainsItem,
)


@dataclass(frozen=True, slots=True)
class SensorsItem(Parameters):
    """An item of sensors. Raises ConfigurationError if a value is not allowed."""

    name: str = "front"
    gains: tuple[SensorsGainsItem, ...] = ()

    __spec__: ClassVar[ParameterSet]


SensorsItem.__spec__ = ParameterSet(
    "sensors",
    (Parameter("name", ParameterKind.STRING, "front"),),
    lists=(ParameterList("gains", SensorsGainsItem.__spec__),),
    python=SensorsItem,
)


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    verbose: bool = False  # whether to tell more
    device: str = "/dev/tty\\USB0"  # where the device is
    rate: int = 10  # Hz, 1 to 1000
    # m/s; and a description that is so long that it cannot stand behind the parameter
    # in one line, 0.0 to 2.0
    speed: float = 0.5
    precise: float = 1e-09
    enabled: bool = True  # dynamic
    mode: Literal["walk", "run", "stand still"] = "walk"  # what to do
    one: Literal["only"] = "only"
    motors: tuple[MotorsItem, ...] = ()  # from left to right
    sensors: tuple[SensorsItem, ...] = ()

    __spec__: ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "everything",
    (
        Parameter(
            "verbose",
            ParameterKind.BOOL,
            False,
            description="whether to tell more",
        ),
        Parameter(
            "device",
            ParameterKind.STRING,
            "/dev/tty\\USB0",
            mandatory=True,
            description="where the device is",
        ),
        Parameter(
            "rate",
            ParameterKind.INT,
            10,
            minimum=1,
            maximum=1000,
            description="Hz",
        ),
        Parameter(
            "speed",
            ParameterKind.FLOAT,
            0.5,
            minimum=0.0,
            maximum=2.0,
            description=(
                "m/s; and a description that is so long that it cannot stand "
                "behind the parameter in one line"
            ),
        ),
        Parameter("precise", ParameterKind.DOUBLE, 1e-09),
        Parameter("enabled", ParameterKind.BOOL, True, dynamic=True),
        Parameter(
            "mode",
            ParameterKind.ENUM,
            "walk",
            choices=("walk", "run", "stand still"),
            description="what to do",
        ),
        Parameter("one", ParameterKind.ENUM, "only", choices=("only",)),
    ),
    lists=(
        ParameterList(
            "motors",
            MotorsItem.__spec__,
            minimum=0,
            maximum=4,
            description="from left to right",
        ),
        ParameterList("sensors", SensorsItem.__spec__),
    ),
    python=Params,
)

PARAMS = Params.__spec__
