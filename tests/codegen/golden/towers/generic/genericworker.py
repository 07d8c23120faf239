# Generated from towers.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of towers, and the methods that its SpecificWorker must define."""

from __future__ import annotations

import builtins
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    Component,
    Durability,
    Port,
    QoS,
    Reliability,
    Verb,
    Worker,
)
from robocomp_py.runtime.instances import InstanceHandler, NamedHandlers, NamedProxies

from . import Everything, Shapes, class_, lambda_


class DrawingHandler(InstanceHandler):
    """Answers for one `Drawing`. Derive a class from it, and add an object of it:
    self.drawing.add(name, handler).
    """

    @abstractmethod
    def draw(self, outline: Shapes.Points) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """


_class_ = class_  # an operation has this name, too


class OddHandler(InstanceHandler):
    """Answers for one `Odd`. Derive a class from it, and add an object of it:
    self.odd.add(name, handler).
    """

    @abstractmethod
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

    @abstractmethod
    def list(
        self,
        list: NDArray[np.float32],
    ) -> tuple[_class_.list_, _class_.Mode, _class_.dict_]:
        """`list` of class.Odd.

        IDSL: list list(sequence<float> list, out Mode int, out dict dict)
        """

    @abstractmethod
    def Point(self, Point: _class_.Point) -> tuple[_class_.Point, _class_.Point]:
        """`Point` of class.Odd.

        IDSL: Point Point(Point Point, out Point second) throws ValueError, Exception
        """

    @abstractmethod
    def interface(self) -> int:
        """`interface` of class.Odd.

        IDSL: int interface()
        """

    @abstractmethod
    def _ask(self, x: int, float: float) -> int:
        """`_ask` of class.Odd.

        IDSL: int _ask(int x, float float)
        """

    @abstractmethod
    def _send(self) -> None:
        """`_send` of class.Odd.

        IDSL: void _send()
        """

    @abstractmethod
    def getX(self) -> None:
        """`getX` of class.Odd.

        IDSL: void getX()
        """

    @abstractmethod
    def getXAsync(self) -> int:
        """`getXAsync` of class.Odd.

        IDSL: int getXAsync()
        """

    @abstractmethod
    def str(self) -> builtins.str:
        """`str` of class.Odd.

        IDSL: string str()
        """

    @abstractmethod
    def strs(self, str: builtins.list[builtins.str]) -> builtins.list[builtins.str]:
        """`strs` of class.Odd.

        IDSL: sequence<string> strs(sequence<string> str)
        """

    @abstractmethod
    def float(self, float: float, mode: _class_.Mode) -> float:
        """`float` of class.Odd.

        IDSL: float float(float float, Mode mode = name)
        """

    @abstractmethod
    def tuple(self) -> builtins.str:
        """`tuple` of class.Odd.

        IDSL: string tuple()
        """

    @abstractmethod
    def Future(self, from_: lambda_.T) -> _class_.Sequence_:
        """`Future` of class.Odd.

        IDSL: Sequence Future(lambda::T from)
        """

    @abstractmethod
    def class_(self) -> lambda_.T:
        """`class` of class.Odd.

        IDSL: lambda::T class()
        """

    @abstractmethod
    def l(self, l: _class_.I, O: _class_.O, I: NDArray[np.float32]) -> _class_.I:  # noqa: E741, E743, RUF100
        """`l` of class.Odd.

        IDSL: I l(I l, O O, sequence<float> I)
        """

    @abstractmethod
    def command(self, s: _class_.Struct_) -> None:
        """`command` of class.Odd.

        IDSL: [command] void command(Struct s)
        """


class GenericWorker(Worker[None]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "towers",
        ports=(
            Port(Verb.IMPLEMENTS, Shapes.DRAWING_INTERFACE, each=True),
            Port(Verb.IMPLEMENTS, class_.ODD_INTERFACE, each=True, concurrent=True),
            Port(
                Verb.PUBLISHES,
                Everything.NEWS_INTERFACE,
                qos=QoS(
                    reliability=Reliability.RELIABLE,
                    durability=Durability.TRANSIENT_LOCAL,
                    depth=3,
                ),
                each=True,
                proxy=Everything.NewsPublisher,
            ),
        ),
        period=0.1,
    )
    middleware = "auto"

    drawing: NamedHandlers[DrawingHandler]
    odd: NamedHandlers[OddHandler]
    news: NamedProxies[Everything.NewsPublisher]
