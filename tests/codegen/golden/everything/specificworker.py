"""The code of everything.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .generic import Everything, Shapes
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Methods Counter_… are `concurrent`: they may run at any time, and several at
    once. Protect attributes that they share with a lock. Of the other methods, only one
    runs at a time. While it waits for the reply of another component, a handler may
    run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""
        # Proxies: self.store_proxy, self.store1_proxy, self.drawing_proxy,
        # self.news_proxy, self.store2_proxy, self.drawing1_proxy

    def compute(self) -> None:
        """Called every 20 ms."""

    def Store_count(self) -> int:
        """`count` of Everything.Store.

        IDSL: idempotent int count()
        """
        return 0

    def Store_keep(self, what: Everything.Containers) -> Everything.Containers:
        """Keep something, and get it back.

        IDSL: Containers keep(Containers what)
        """
        return Everything.Containers()

    def Store_widths(self, what: Everything.Widths) -> Everything.Widths:
        """`widths` of Everything.Store.

        IDSL: idempotent Widths widths(Widths what)
        """
        return Everything.Widths()

    def Store_slices(
        self,
        what: Everything.Slices,
    ) -> tuple[Everything.Slices, int, Shapes.Point]:
        """`slices` of Everything.Store.

        IDSL: Slices slices(Slices what, out int number, out Shapes::Point middle)
        """
        return [], 0, Shapes.Point()

    def Store_check(self, fail: bool, late: bool) -> None:
        """Do nothing. Fails if it is told to.

        IDSL: void check(bool fail, bool late) throws Late, Failed
        """

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

    def Store_cube(self, what: Everything.Cube) -> Everything.Cube:
        """`cube` of Everything.Store.

        IDSL: Cube cube(Cube what)
        """
        return []

    def Store_levels(self, what: Everything.ByLevel) -> Everything.ByLevel:
        """`levels` of Everything.Store.

        IDSL: ByLevel levels(ByLevel what)
        """
        return {}

    def Store_acknowledge(self) -> None:
        """`acknowledge` of Everything.Store.

        IDSL: [query] void acknowledge()
        """

    def Store_nothings(self, number: int) -> list[Everything.Nothing]:
        """`nothings` of Everything.Store.

        IDSL: [query] sequence<Nothing> nothings(int number)
        """
        return []

    def Store_trigger(self, number: int, levels: Everything.Levels) -> None:
        """`trigger` of Everything.Store.

        IDSL: [command] void trigger(int number, Levels levels)
        """

    def Counter_count(self) -> int:
        """`count` of Everything.Counter.

        IDSL: idempotent int count()
        """
        return 0

    def Drawing_draw(self, outline: Shapes.Points) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """

    def News_told(self, what: str, values: NDArray[np.float32]) -> None:
        """`told` of Everything.News.

        IDSL: void told(string what, sequence<float> values)
        """

    def News_level(self, now: Everything.Level) -> None:
        """`level` of Everything.News.

        IDSL: [publish] void level(Level now)
        """

    def News_kept(self, what: Everything.Containers) -> None:
        """`kept` of Everything.News.

        IDSL: [publish] void kept(Containers what)
        """

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

    def News1_told(self, what: str, values: NDArray[np.float32]) -> None:
        """`told` of Everything.News.

        IDSL: void told(string what, sequence<float> values)
        """

    def News1_level(self, now: Everything.Level) -> None:
        """`level` of Everything.News.

        IDSL: [publish] void level(Level now)
        """

    def News1_kept(self, what: Everything.Containers) -> None:
        """`kept` of Everything.News.

        IDSL: [publish] void kept(Containers what)
        """

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

    def Store1_announced(self, what: str) -> None:
        """`announced` of Everything.Store.

        IDSL: [publish] void announced(string what)
        """

    def Drawing1_draw(self, outline: Shapes.Points) -> None:
        """`draw` of Shapes.Drawing.

        IDSL: void draw(Points outline)
        """
