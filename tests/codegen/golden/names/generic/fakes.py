# Generated from names.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of import with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

import builtins
from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import class_, lambda_


class OddFakes(TypedDict, total=False):
    """Fakes for the peer of `odd`."""

    list: Fake[tuple[class_.list_, class_.Mode, class_.dict_]]
    Point: Fake[tuple[class_.Point, class_.Point]]
    interface: Fake[int]
    _ask: Fake[int]
    _send: Fake[None]
    getX: Fake[None]
    getXAsync: Fake[int]
    str: Fake[builtins.str]
    strs: Fake[builtins.list[builtins.str]]
    float: Fake[float]
    tuple: Fake[builtins.str]
    Future: Fake[class_.Sequence_]
    l: Fake[class_.I]  # noqa: E741, RUF100
    command: Fake[None]


class PointFakes(TypedDict, total=False):
    """Fakes for the peer of `point`."""

    T: Fake[lambda_.T]


class EmptyFakes(TypedDict, total=False):
    """Fakes for the peer of `empty`."""


class Odd1Fakes(TypedDict, total=False):
    """Fakes for the peer of `odd1`."""

    _send: Fake[None]
    getX: Fake[None]
    publish: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    odd: OddFakes
    point: PointFakes
    empty: EmptyFakes
    odd1: Odd1Fakes
