# Generated from lambda.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: UP040, RUF100
"""Module lambda: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import (
    INT32,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Struct,
)


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

_T = T  # an operation has this name, too


class PointProxy(Proxy):
    """Calls Point of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = POINT_INTERFACE

    def T(self, T: _T, *, deadline: float | None = None) -> _T:
        """`T` of lambda.Point.

        IDSL: T T(T T)
        """
        return self._ask(_Point_T, (T,), deadline)

    def TAsync(self, T: _T, *, deadline: float | None = None) -> Future[_T]:
        """Call `T` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Point_T, (T,), deadline)
