# Generated from names.pdsl by rcgen 0.1.0: edits are lost.
"""The parameters of import."""

from __future__ import annotations

import builtins
import typing
from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    Parameter,
    ParameterKind,
    ParameterList,
    Parameters,
    ParameterSet,
)


@dataclass(frozen=True, slots=True)
class ParamsItem(Parameters):
    """An item of Params. Raises ConfigurationError if a value is not allowed."""

    __spec__: ClassVar[ParameterSet]


ParamsItem.__spec__ = ParameterSet(
    "Params",
    python=ParamsItem,
)


@dataclass(frozen=True, slots=True)
class MotorsGainsItem(Parameters):
    """An item of gains. Raises ConfigurationError if a value is not allowed."""

    __spec__: ClassVar[ParameterSet]


MotorsGainsItem.__spec__ = ParameterSet(
    "gains",
    python=MotorsGainsItem,
)


@dataclass(frozen=True, slots=True)
class MotorsItem(Parameters):
    """An item of motors. Raises ConfigurationError if a value is not allowed."""

    gains: tuple[MotorsGainsItem, ...] = ()

    __spec__: ClassVar[ParameterSet]


MotorsItem.__spec__ = ParameterSet(
    "motors",
    lists=(ParameterList("gains", MotorsGainsItem.__spec__),),
    python=MotorsItem,
)


@dataclass(frozen=True, slots=True)
class MotorsGainsItem2(Parameters):
    """An item of motors_gains. Raises ConfigurationError if a value is not allowed."""

    __spec__: ClassVar[ParameterSet]


MotorsGainsItem2.__spec__ = ParameterSet(
    "motors_gains",
    python=MotorsGainsItem2,
)


@dataclass(frozen=True, slots=True)
class ClassVarItem(Parameters):
    """An item of ClassVar. Raises ConfigurationError if a value is not allowed."""

    __spec__: ClassVar[ParameterSet]


ClassVarItem.__spec__ = ParameterSet(
    "ClassVar",
    python=ClassVarItem,
)


@dataclass(frozen=True, slots=True)
class Params(Parameters):
    """All parameters. Raises ConfigurationError if a value is not allowed."""

    int: int = 1
    str: builtins.str = "a"
    other: builtins.str = "b"
    Literal: typing.Literal["a", "b"] = "a"
    mode: typing.Literal["a", "b"] = "b"
    tuple: bool = True
    float: float = 1.0
    Params: builtins.tuple[ParamsItem, ...] = ()
    motors: builtins.tuple[MotorsItem, ...] = ()
    motors_gains: builtins.tuple[MotorsGainsItem2, ...] = ()
    ClassVar: builtins.tuple[ClassVarItem, ...] = ()

    __spec__: typing.ClassVar[ParameterSet]


Params.__spec__ = ParameterSet(
    "int",
    (
        Parameter("int", ParameterKind.INT, 1),
        Parameter("str", ParameterKind.STRING, "a"),
        Parameter("other", ParameterKind.STRING, "b"),
        Parameter("Literal", ParameterKind.ENUM, "a", choices=("a", "b")),
        Parameter("mode", ParameterKind.ENUM, "b", choices=("a", "b")),
        Parameter("tuple", ParameterKind.BOOL, True),
        Parameter("float", ParameterKind.FLOAT, 1.0),
    ),
    lists=(
        ParameterList("Params", ParamsItem.__spec__),
        ParameterList("motors", MotorsItem.__spec__),
        ParameterList("motors_gains", MotorsGainsItem2.__spec__),
        ParameterList("ClassVar", ClassVarItem.__spec__),
    ),
    python=Params,
)

PARAMS = Params.__spec__
