# Generated from lambda.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: UP040, RUF100
"""Module lambda: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import INT32, Field, Interface, Operation, Struct


@dataclass(slots=True)
class T:
    """T of module lambda."""

    x: int = 0

    __contract__: ClassVar[Struct]


T.__contract__ = Struct(
    "lambda::T",
    (Field("x", INT32),),
    T,
)

Odd: TypeAlias = list[T]

_Point_T: Operation[T] = Operation(
    "lambda::Point",
    "T",
    inputs=(Field("T", T.__contract__),),
    outputs=(Field("ret", T.__contract__),),
)
POINT_INTERFACE = Interface(
    "lambda::Point",
    (_Point_T,),
)
