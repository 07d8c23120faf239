# Generated from everything.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of everything with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import Everything, Shapes


class StoreFakes(TypedDict, total=False):
    """Fakes for the peer of `store`."""

    count: Fake[int]
    keep: Fake[Everything.Containers]
    widths: Fake[Everything.Widths]
    slices: Fake[tuple[Everything.Slices, int, Shapes.Point]]
    check: Fake[None]
    adjust: Fake[None]
    cube: Fake[Everything.Cube]
    levels: Fake[Everything.ByLevel]
    acknowledge: Fake[None]
    nothings: Fake[list[Everything.Nothing]]
    trigger: Fake[None]


class Store1Fakes(TypedDict, total=False):
    """Fakes for the peer of `store1`."""

    count: Fake[int]
    keep: Fake[Everything.Containers]
    widths: Fake[Everything.Widths]
    slices: Fake[tuple[Everything.Slices, int, Shapes.Point]]
    check: Fake[None]
    adjust: Fake[None]
    cube: Fake[Everything.Cube]
    levels: Fake[Everything.ByLevel]
    acknowledge: Fake[None]
    nothings: Fake[list[Everything.Nothing]]
    trigger: Fake[None]


class DrawingFakes(TypedDict, total=False):
    """Fakes for the peer of `drawing`."""

    draw: Fake[None]


class NewsFakes(TypedDict, total=False):
    """Fakes for the peer of `news`."""

    told: Fake[None]
    level: Fake[None]
    kept: Fake[None]
    compared: Fake[None]


class Store2Fakes(TypedDict, total=False):
    """Fakes for the peer of `store2`."""

    adjust: Fake[None]
    announced: Fake[None]


class Drawing1Fakes(TypedDict, total=False):
    """Fakes for the peer of `drawing1`."""

    draw: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    store: StoreFakes
    store1: Store1Fakes
    drawing: DrawingFakes
    news: NewsFakes
    store2: Store2Fakes
    drawing1: Drawing1Fakes
