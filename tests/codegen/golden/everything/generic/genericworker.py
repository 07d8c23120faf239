# Generated from everything.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of everything, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    Component,
    Durability,
    History,
    Port,
    QoS,
    Reliability,
    Verb,
    Worker,
)

from . import Everything, Shapes
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "everything",
        ports=(
            Port(
                Verb.REQUIRES,
                Everything.STORE_INTERFACE,
                proxy=Everything.StoreProxy,
            ),
            Port(
                Verb.REQUIRES,
                Everything.STORE_INTERFACE,
                number="1",
                proxy=Everything.StoreProxy,
            ),
            Port(Verb.REQUIRES, Shapes.DRAWING_INTERFACE, proxy=Shapes.DrawingProxy),
            Port(Verb.IMPLEMENTS, Everything.STORE_INTERFACE),
            Port(Verb.IMPLEMENTS, Everything.COUNTER_INTERFACE, concurrent=True),
            Port(Verb.IMPLEMENTS, Shapes.DRAWING_INTERFACE),
            Port(
                Verb.PUBLISHES,
                Everything.NEWS_INTERFACE,
                qos=QoS(
                    reliability=Reliability.RELIABLE,
                    durability=Durability.TRANSIENT_LOCAL,
                    depth=3,
                ),
                proxy=Everything.NewsPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                Everything.STORE_INTERFACE,
                number="2",
                proxy=Everything.StorePublisher,
            ),
            Port(
                Verb.PUBLISHES,
                Shapes.DRAWING_INTERFACE,
                number="1",
                middleware="inproc",
                proxy=Shapes.DrawingPublisher,
            ),
            Port(Verb.SUBSCRIBES, Everything.NEWS_INTERFACE, qos=QoS(depth=5)),
            Port(Verb.SUBSCRIBES, Everything.NEWS_INTERFACE, number="1"),
            Port(Verb.SUBSCRIBES, Everything.STORE_INTERFACE, number="1"),
            Port(
                Verb.SUBSCRIBES,
                Shapes.DRAWING_INTERFACE,
                number="1",
                qos=QoS(history=History.KEEP_ALL),
            ),
        ),
        params=PARAMS,
        period=0.02,
    )
    middleware = "auto"

    store_proxy: Everything.StoreProxy
    store1_proxy: Everything.StoreProxy
    drawing_proxy: Shapes.DrawingProxy
    news_proxy: Everything.NewsPublisher
    store2_proxy: Everything.StorePublisher
    drawing1_proxy: Shapes.DrawingPublisher

    @abstractmethod
    def Store_count(self) -> int:
        """`count` of Everything.Store.

        IDSL: idempotent int count()
        """

    @abstractmethod
    def Store_keep(self, what: Everything.Containers) -> Everything.Containers:
        """Keep something, and get it back.

        IDSL: Containers keep(Containers what)
        """

    @abstractmethod
    def Store_widths(self, what: Everything.Widths) -> Everything.Widths:
        """`widths` of Everything.Store.

        IDSL: idempotent Widths widths(Widths what)
        """

    @abstractmethod
    def Store_slices(
        self,
        what: Everything.Slices,
    ) -> tuple[Everything.Slices, int, Shapes.Point]:
        """`slices` of Everything.Store.

        IDSL: Slices slices(Slices what, out int number, out Shapes::Point middle)
        """

    @abstractmethod
    def Store_check(self, fail: bool, late: bool) -> None:
        """Do nothing. Fails if it is told to.

        IDSL: void check(bool fail, bool late) throws Late, Failed
        """

    @abstractmethod
    def Store_adjust(
        self,
        to: float,
        level: Everything.Level,
        note: str,
        share: float,
    ) -> None:
        """`adjust` of Everything.Store.

        IDSL: void adjust(float to, Level level = medium, string note = "none", double
        share = 1)
        """

    @abstractmethod
    def Store_cube(self, what: Everything.Cube) -> Everything.Cube:
        """`cube` of Everything.Store.

        IDSL: Cube cube(Cube what)
        """

    @abstractmethod
    def Store_levels(self, what: Everything.ByLevel) -> Everything.ByLevel:
        """`levels` of Everything.Store.

        IDSL: ByLevel levels(ByLevel what)
        """

    @abstractmethod
    def Store_acknowledge(self) -> None:
        """`acknowledge` of Everything.Store.

        IDSL: [query] void acknowledge()
        """

    @abstractmethod
    def Store_nothings(self, number: int) -> list[Everything.Nothing]:
        """`nothings` of Everything.Store.

        IDSL: [query] sequence<Nothing> nothings(int number)
        """

    @abstractmethod
    def Store_trigger(self, number: int, levels: Everything.Levels) -> None:
        """`trigger` of Everything.Store.

        IDSL: [command] void trigger(int number, Levels levels)
        """

    @abstractmethod
    def Counter_count(self) -> int:
        """`count` of Everything.Counter.

        IDSL: idempotent int count()
        """

    @abstractmethod
    def Drawing_draw(self, outline: Shapes.Points) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """

    @abstractmethod
    def News_told(self, what: str, values: NDArray[np.float32]) -> None:
        """`told` of Everything.News.

        IDSL: void told(string what, sequence<float> values)
        """

    @abstractmethod
    def News_level(self, now: Everything.Level) -> None:
        """`level` of Everything.News.

        IDSL: [publish] void level(Level now)
        """

    @abstractmethod
    def News_kept(self, what: Everything.Containers) -> None:
        """`kept` of Everything.News.

        IDSL: [publish] void kept(Containers what)
        """

    @abstractmethod
    def News_compared(
        self,
        left: Everything.Containers,
        right: Everything.Containers,
        numbers: Everything.Numbers,
    ) -> None:
        """`compared` of Everything.News.

        IDSL: [publish] void compared(Containers left, Containers right, Numbers
        numbers)
        """

    @abstractmethod
    def News1_told(self, what: str, values: NDArray[np.float32]) -> None:
        """`told` of Everything.News.

        IDSL: void told(string what, sequence<float> values)
        """

    @abstractmethod
    def News1_level(self, now: Everything.Level) -> None:
        """`level` of Everything.News.

        IDSL: [publish] void level(Level now)
        """

    @abstractmethod
    def News1_kept(self, what: Everything.Containers) -> None:
        """`kept` of Everything.News.

        IDSL: [publish] void kept(Containers what)
        """

    @abstractmethod
    def News1_compared(
        self,
        left: Everything.Containers,
        right: Everything.Containers,
        numbers: Everything.Numbers,
    ) -> None:
        """`compared` of Everything.News.

        IDSL: [publish] void compared(Containers left, Containers right, Numbers
        numbers)
        """

    @abstractmethod
    def Store1_adjust(
        self,
        to: float,
        level: Everything.Level,
        note: str,
        share: float,
    ) -> None:
        """`adjust` of Everything.Store.

        IDSL: void adjust(float to, Level level = medium, string note = "none", double
        share = 1)
        """

    @abstractmethod
    def Store1_announced(self, what: str) -> None:
        """`announced` of Everything.Store.

        IDSL: [publish] void announced(string what)
        """

    @abstractmethod
    def Drawing1_draw(self, outline: Shapes.Points) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """
