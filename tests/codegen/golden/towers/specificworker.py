"""The code of towers.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

import builtins

import numpy as np
from numpy.typing import NDArray

from .generic import Shapes, class_, lambda_
from .generic.genericworker import DrawingHandler, GenericWorker, OddHandler


class OneDrawing(DrawingHandler):
    """One `Drawing`; `self.instance` is its name."""

    def draw(self, outline: Shapes.Points) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """


_class_ = class_  # an operation has this name, too


class OneOdd(OddHandler):
    """One `Odd`; `self.instance` is its name."""

    def import_(
        self,
        deadline_: int,
        deadline__: int,
        self_: int,
        class_: _class_.list_,
    ) -> None:
        """`import` of class.Odd.

        IDSL: void import(int deadline, int deadline_, int self, list class)
        """

    def list(
        self,
        list: NDArray[np.float32],
    ) -> tuple[_class_.list_, _class_.Mode, _class_.dict_]:
        """`list` of class.Odd.

        IDSL: list list(sequence<float> list, out Mode int, out dict dict)
        """
        return class_.list_(), class_.Mode.None_, {}

    def Point(self, Point: _class_.Point) -> tuple[_class_.Point, _class_.Point]:
        """`Point` of class.Odd.

        IDSL: Point Point(Point Point, out Point second) throws ValueError, Exception
        """
        return class_.Point(), class_.Point()

    def interface(self) -> int:
        """`interface` of class.Odd.

        IDSL: int interface()
        """
        return 0

    def _ask(self, x: int, float: float) -> int:
        """`_ask` of class.Odd.

        IDSL: int _ask(int x, float float)
        """
        return 0

    def _send(self) -> None:
        """`_send` of class.Odd.

        IDSL: void _send()
        """

    def getX(self) -> None:
        """`getX` of class.Odd.

        IDSL: void getX()
        """

    def getXAsync(self) -> int:
        """`getXAsync` of class.Odd.

        IDSL: int getXAsync()
        """
        return 0

    def str(self) -> builtins.str:
        """`str` of class.Odd.

        IDSL: string str()
        """
        return ""

    def strs(self, str: builtins.list[builtins.str]) -> builtins.list[builtins.str]:
        """`strs` of class.Odd.

        IDSL: sequence<string> strs(sequence<string> str)
        """
        return []

    def float(self, float: float, mode: _class_.Mode) -> float:
        """`float` of class.Odd.

        IDSL: float float(float float, Mode mode = name)
        """
        return 0.0

    def tuple(self) -> builtins.str:
        """`tuple` of class.Odd.

        IDSL: string tuple()
        """
        return ""

    def Future(self, from_: lambda_.T) -> _class_.Sequence_:
        """`Future` of class.Odd.

        IDSL: Sequence Future(lambda::T from)
        """
        return class_.Sequence_()

    def class_(self) -> lambda_.T:
        """`class` of class.Odd.

        IDSL: lambda::T class()
        """
        return lambda_.T()

    def l(self, l: _class_.I, O: _class_.O, I: NDArray[np.float32]) -> _class_.I:  # noqa: E741, E743, RUF100
        """`l` of class.Odd.

        IDSL: I l(I l, O O, sequence<float> I)
        """
        return class_.I()

    def command(self, s: _class_.Struct_) -> None:
        """`command` of class.Odd.

        IDSL: [command] void command(Struct s)
        """


class SpecificWorker(GenericWorker):
    """Methods of OddHandler are `concurrent`: they may run at any time, and several at
    once. Protect attributes that they share with a lock. Of the other methods, only one
    runs at a time. While it waits for the reply of another component, a handler may
    run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""
        # Named instances: self.drawing.add("front", OneDrawing()),
        # self.odd.add("front", OneOdd()), self.news.add("front")

    def compute(self) -> None:
        """Called every 100 ms."""
