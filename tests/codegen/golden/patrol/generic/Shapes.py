# Generated from Shapes.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module Shapes: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import (
    FLOAT32,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Sequence,
    Struct,
)


@dataclass(slots=True)
class Point:
    """Point of module Shapes."""

    x: float = 0.0  # in m
    y: float = 0.0  # in m

    __contract__: ClassVar[Struct]


Point.__contract__ = Struct(
    "Shapes::Point",
    (
        Field("x", FLOAT32, doc="in m"),
        Field("y", FLOAT32, doc="in m"),
    ),
    Point,
)

Points: TypeAlias = list[Point]

_Drawing_draw: Operation[None] = Operation(
    "Shapes::Drawing",
    "draw",
    inputs=(Field("outline", Sequence(Point.__contract__)),),
)
DRAWING_INTERFACE = Interface(
    "Shapes::Drawing",
    (_Drawing_draw,),
)


class DrawingProxy(Proxy):
    """Calls Drawing of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = DRAWING_INTERFACE

    def draw(self, outline: Points, *, deadline: float | None = None) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """
        return self._ask(_Drawing_draw, (outline,), deadline)

    def drawAsync(
        self,
        outline: Points,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `draw` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Drawing_draw, (outline,), deadline)
