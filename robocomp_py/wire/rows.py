"""Many structs of numbers at once: a column for each of their numbers, to `struct` and numpy and back."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

FEW = 32
"""So many rows are quicker one by one."""

Columns = list[Sequence[Any]]


def unpacked(layout: struct.Struct, data: Any, begin: int, count: int) -> Columns:
    """The columns of so many rows, all of which are there."""
    rows = np.frombuffer(data, _row(layout.format), count, begin)
    return [rows[name].tolist() for name in rows.dtype.names or ()]


def packed(layout: struct.Struct, between: bytes, *columns: Sequence[Any]) -> Any:
    """Rows as octets. `between` is a row in which only what the columns leave free is of importance.

    Numbers are what `struct` takes, and refused as there.
    """
    kind = _row(layout.format)
    rows = np.empty(len(columns[0]), kind)
    rows.view(np.uint8).reshape(-1, kind.itemsize)[:] = np.frombuffer(between, np.uint8)
    letters = layout.format[1:].replace("x", "")
    for name, letter, column in zip(kind.names or (), letters, columns, strict=True):
        rows[name] = np.frombuffer(struct.pack(f"<{len(column)}{letter}", *column), f"<{letter}")
    return rows


@lru_cache(maxsize=1024)
def _row(text: str) -> np.dtype[Any]:
    """The layout of a row, as numpy says it."""
    order, letters = text[0], text[1:]
    names, formats, offsets, at = [], [], [], 0
    for letter in letters:
        if letter != "x":
            names.append(f"f{at}")
            formats.append(order + letter)
            offsets.append(at)
        at += struct.calcsize(order + letter)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at})
