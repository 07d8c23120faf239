# Generated from names.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of import, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import class_, lambda_
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "import",
        ports=(
            Port(Verb.REQUIRES, class_.ODD_INTERFACE, proxy=class_.OddProxy),
            Port(Verb.REQUIRES, lambda_.POINT_INTERFACE, proxy=lambda_.PointProxy),
            Port(Verb.REQUIRES, class_.EMPTY_INTERFACE, proxy=class_.EmptyProxy),
            Port(Verb.IMPLEMENTS, class_.ODD_INTERFACE),
            Port(Verb.IMPLEMENTS, lambda_.POINT_INTERFACE),
            Port(
                Verb.PUBLISHES,
                class_.ODD_INTERFACE,
                number="1",
                proxy=class_.OddPublisher,
            ),
            Port(Verb.SUBSCRIBES, class_.ODD_INTERFACE, number="1"),
        ),
        params=PARAMS,
        period=0.1,
    )
    middleware = "auto"

    odd_proxy: class_.OddProxy
    point_proxy: lambda_.PointProxy
    empty_proxy: class_.EmptyProxy
    odd1_proxy: class_.OddPublisher

    @abstractmethod
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

    @abstractmethod
    def Odd_list(
        self,
        list: NDArray[np.float32],
    ) -> tuple[class_.list_, class_.Mode, class_.dict_]:
        """`list` of class.Odd.

        IDSL: list list(sequence<float> list, out Mode int, out dict dict)
        """

    @abstractmethod
    def Odd_Point(self, Point: class_.Point) -> tuple[class_.Point, class_.Point]:
        """`Point` of class.Odd.

        IDSL: Point Point(Point Point, out Point second) throws ValueError, Exception
        """

    @abstractmethod
    def Odd_interface(self) -> int:
        """`interface` of class.Odd.

        IDSL: int interface()
        """

    @abstractmethod
    def Odd__ask(self, x: int, float: float) -> int:
        """`_ask` of class.Odd.

        IDSL: int _ask(int x, float float)
        """

    @abstractmethod
    def Odd__send(self) -> None:
        """`_send` of class.Odd.

        IDSL: void _send()
        """

    @abstractmethod
    def Odd_getX(self) -> None:
        """`getX` of class.Odd.

        IDSL: void getX()
        """

    @abstractmethod
    def Odd_getXAsync(self) -> int:
        """`getXAsync` of class.Odd.

        IDSL: int getXAsync()
        """

    @abstractmethod
    def Odd_str(self) -> str:
        """`str` of class.Odd.

        IDSL: string str()
        """

    @abstractmethod
    def Odd_strs(self, str: list[str]) -> list[str]:
        """`strs` of class.Odd.

        IDSL: sequence<string> strs(sequence<string> str)
        """

    @abstractmethod
    def Odd_float(self, float: float, mode: class_.Mode) -> float:
        """`float` of class.Odd.

        IDSL: float float(float float, Mode mode = name)
        """

    @abstractmethod
    def Odd_tuple(self) -> str:
        """`tuple` of class.Odd.

        IDSL: string tuple()
        """

    @abstractmethod
    def Odd_Future(self, from_: lambda_.T) -> class_.Sequence_:
        """`Future` of class.Odd.

        IDSL: Sequence Future(lambda::T from)
        """

    @abstractmethod
    def Odd_class(self) -> lambda_.T:
        """`class` of class.Odd.

        IDSL: lambda::T class()
        """

    @abstractmethod
    def Odd_l(self, l: class_.I, O: class_.O, I: NDArray[np.float32]) -> class_.I:  # noqa: E741, RUF100
        """`l` of class.Odd.

        IDSL: I l(I l, O O, sequence<float> I)
        """

    @abstractmethod
    def Odd_command(self, s: class_.Struct_) -> None:
        """`command` of class.Odd.

        IDSL: [command] void command(Struct s)
        """

    @abstractmethod
    def Point_T(self, T: lambda_.T) -> lambda_.T:
        """`T` of lambda.Point.

        IDSL: T T(T T)
        """

    @abstractmethod
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

    @abstractmethod
    def Odd1__send(self) -> None:
        """`_send` of class.Odd.

        IDSL: void _send()
        """

    @abstractmethod
    def Odd1_getX(self) -> None:
        """`getX` of class.Odd.

        IDSL: void getX()
        """

    @abstractmethod
    def Odd1_publish(self, f: class_.Field_) -> None:
        """`publish` of class.Odd.

        IDSL: [publish] void publish(Field f)
        """
