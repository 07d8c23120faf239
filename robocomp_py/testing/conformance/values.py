"""Values at the limits of their types, and how to compare them."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from .. import everything as e


def everything_odd() -> e.Nested:
    """A value at the limits of its types."""
    scalars = e.Scalars(
        True, -128, 65535, -(2**63), 255, 0.5, -32768, math.inf, "naïve ☃ 𝄞\0end", 2**32 - 1, -1, 2**64 - 1, 2**31 - 1,
        e.Colour.ultraviolet,
    )  # fmt: skip
    return e.Nested(
        scalars,
        [e.Point(-0.0, 5e-324), e.Point(math.nan, -math.inf)],
        ["", "x" * 1000, "ñ"],
        [e.Colour.green, e.Colour.ultraviolet],
        {"": e.Point(), "königlich": e.Point(1.0, 2.0)},
        {-(2**31): "low", 2**31 - 1: "high"},
        {e.Colour.green: 1.5},
        [[], [e.Point(3.0, 4.0)] * 2],
    )


def assert_same(found: Any, expected: Any, at: str = "value") -> None:
    """Assert that values are equal (NaN equals NaN), of the same classes, and arrays of the same dtype."""
    if isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype, at
        np.testing.assert_array_equal(found, expected, at)
        return
    assert type(found) is type(expected), f"{at}: {found!r} is no {type(expected).__name__}"
    if is_dataclass(expected):
        for each in fields(expected):
            assert_same(getattr(found, each.name), getattr(expected, each.name), f"{at}.{each.name}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), at
        for number, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert_same(one, other, f"{at}[{number}]")
    elif isinstance(expected, dict):
        assert list(map(repr, found)) == list(map(repr, expected)), at
        for one, other in zip(found.values(), expected.values(), strict=True):
            assert_same(one, other, f"{at}[…]")
    elif isinstance(expected, float):
        same = found == expected or (math.isnan(found) and math.isnan(expected))
        assert same, f"{at}: {found!r} is not {expected!r}"
        assert math.copysign(1, found) == math.copysign(1, expected) or math.isnan(expected), at
    else:
        assert found == expected, at
