"""Packs many structs of numbers at once, a column for each number, by `struct` and numpy; and unpacks them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

FEW = 32
"""Up to this number, rows are faster one by one."""

Columns = list[Sequence[Any]]


def unpacked(layout: struct.Struct, data: Any, begin: int, count: int) -> Columns:
    """The columns of `count` rows; the caller has checked that they are there."""
    import numpy as np  # tools, whose structs are tuples, never come here

    rows = np.frombuffer(data, _row(layout.format), count, begin)
    return [rows[name].tolist() for name in rows.dtype.names or ()]


def packed(layout: struct.Struct, between: bytes, *columns: Sequence[Any]) -> Any:
    """Rows as octets. `between` is a row with the octets that belong to no column.

    Numbers are accepted and refused as by `struct`.
    """
    import numpy as np

    kind = _row(layout.format)
    rows = np.empty(len(columns[0]), kind)
    rows.view(np.uint8).reshape(-1, kind.itemsize)[:] = np.frombuffer(between, np.uint8)
    letters = layout.format[1:].replace("x", "")
    for name, letter, column in zip(kind.names or (), letters, columns, strict=True):
        rows[name] = np.frombuffer(struct.pack(f"<{len(column)}{letter}", *column), f"<{letter}")
    return rows


@lru_cache(maxsize=1024)
def _row(text: str) -> np.dtype[Any]:
    """The layout of a row as a numpy dtype."""
    import numpy as np

    order, letters = text[0], text[1:]
    names, formats, offsets, at = [], [], [], 0
    for letter in letters:
        if letter != "x":
            names.append(f"f{at}")
            formats.append(order + letter)
            offsets.append(at)
        at += struct.calcsize(order + letter)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at})
