"""The code of import.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .generic import class_, lambda_
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Only one method runs at a time. While it waits for the reply of another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""
        # Proxies: self.odd_proxy, self.point_proxy, self.empty_proxy, self.odd1_proxy

    def compute(self) -> None:
        """Called every 100 ms."""

    def Odd_import(
        self,
        deadline_: int,
        deadline__: int,
        self_: int,
        class_: class_.list_,
    ) -> None:
        """`import` of class.Odd.

        IDSL: void import(int deadline, int deadline_, int self, list class)
        """

    def Odd_list(
        self,
        list: NDArray[np.float32],
    ) -> tuple[class_.list_, class_.Mode, class_.dict_]:
        """`list` of class.Odd.

        IDSL: list list(sequence<float> list, out Mode int, out dict dict)
        """
        return class_.list_(), class_.Mode.None_, {}

    def Odd_Point(self, Point: class_.Point) -> tuple[class_.Point, class_.Point]:
        """`Point` of class.Odd.

        IDSL: Point Point(Point Point, out Point second) throws ValueError, Exception
        """
        return class_.Point(), class_.Point()

    def Odd_interface(self) -> int:
        """`interface` of class.Odd.

        IDSL: int interface()
        """
        return 0

    def Odd__ask(self, x: int, float: float) -> int:
        """`_ask` of class.Odd.

        IDSL: int _ask(int x, float float)
        """
        return 0

    def Odd__send(self) -> None:
        """`_send` of class.Odd.

        IDSL: void _send()
        """

    def Odd_getX(self) -> None:
        """`getX` of class.Odd.

        IDSL: void getX()
        """

    def Odd_getXAsync(self) -> int:
        """`getXAsync` of class.Odd.

        IDSL: int getXAsync()
        """
        return 0

    def Odd_str(self) -> str:
        """`str` of class.Odd.

        IDSL: string str()
        """
        return ""

    def Odd_strs(self, str: list[str]) -> list[str]:
        """`strs` of class.Odd.

        IDSL: sequence<string> strs(sequence<string> str)
        """
        return []

    def Odd_float(self, float: float, mode: class_.Mode) -> float:
        """`float` of class.Odd.

        IDSL: float float(float float, Mode mode = name)
        """
        return 0.0

    def Odd_tuple(self) -> str:
        """`tuple` of class.Odd.

        IDSL: string tuple()
        """
        return ""

    def Odd_Future(self, from_: lambda_.T) -> class_.Sequence_:
        """`Future` of class.Odd.

        IDSL: Sequence Future(lambda::T from)
        """
        return class_.Sequence_()

    def Odd_class(self) -> lambda_.T:
        """`class` of class.Odd.

        IDSL: lambda::T class()
        """
        return lambda_.T()

    def Odd_l(self, l: class_.I, O: class_.O, I: NDArray[np.float32]) -> class_.I:  # noqa: E741, RUF100
        """`l` of class.Odd.

        IDSL: I l(I l, O O, sequence<float> I)
        """
        return class_.I()

    def Odd_command(self, s: class_.Struct_) -> None:
        """`command` of class.Odd.

        IDSL: [command] void command(Struct s)
        """

    def Point_T(self, T: lambda_.T) -> lambda_.T:
        """`T` of lambda.Point.

        IDSL: T T(T T)
        """
        return lambda_.T()

    def Odd1_import(
        self,
        deadline_: int,
        deadline__: int,
        self_: int,
        class_: class_.list_,
    ) -> None:
        """`import` of class.Odd.

        IDSL: void import(int deadline, int deadline_, int self, list class)
        """

    def Odd1__send(self) -> None:
        """`_send` of class.Odd.

        IDSL: void _send()
        """

    def Odd1_getX(self) -> None:
        """`getX` of class.Odd.

        IDSL: void getX()
        """

    def Odd1_publish(self, f: class_.Field_) -> None:
        """`publish` of class.Odd.

        IDSL: [publish] void publish(Field f)
        """
