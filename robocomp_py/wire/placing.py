"""Payloads put together in memory that is given, around arrays that lie there already.

An array that is filled in place cannot move; the bytes in front of it can. So the arrays of a message
get their places first, where the payload of such a message would have them, with room in front and
behind. When the message is complete, its payload begins wherever it has to for the largest of these
arrays to stay, and so mostly for all of them; what lies elsewhere is copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Pieces = list[Any]
"""The parts of a payload, in order: bytes, and arrays."""

SPARE = 1024
"""Bytes in front and behind: so much longer may texts become than they were in the message that was planned with."""

_FIRST = SPARE + 4
"""Where a payload begins that may begin anywhere: 4 octets before a multiple of 8, as its numbers like it."""

_Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True, slots=True)
class Plan:
    """How much memory a message takes, and where in it each of its arrays begins."""

    size: int
    places: tuple[int, ...]


def plan(pieces: Pieces, arrays: Sequence[_Array]) -> Plan:
    """For messages like one of these pieces, among which are these arrays."""
    starts, total = {}, 0
    for piece in pieces:
        starts[id(piece)] = total
        total += _size(piece)
    return Plan(_FIRST + total + SPARE, tuple(_FIRST + starts[id(array)] for array in arrays))


def lay(pieces: Pieces, memory: _Array, planned: Plan) -> tuple[slice | None, Plan]:
    """Make memory, an array of octets, hold the payload of these pieces; say where, and what to plan the next with.

    An array is in its memory if its bytes are, whatever object it is. What does not fit leaves the
    memory as it is, and is nowhere: None.
    """
    here, room = _address(memory), memory.nbytes
    parts, total = [], 0
    for piece in pieces:
        size = _size(piece)
        at = _address(piece) - here if isinstance(piece, np.ndarray) and size else -1
        parts.append((piece, total, size, at if 0 <= at <= room - size else None))
        total += size
    inside = [(size, at - start) for _, start, size, at in parts if at is not None]
    begin = max(inside, default=(0, _FIRST))[1]
    if not 0 <= begin <= room - total:
        begin = _FIRST
    moving = {start: piece.tobytes() for piece, start, _, at in parts if at is not None and at != begin + start}
    fits = begin + total <= room
    if moving or not fits:
        found = {at: _FIRST + start for _, start, _, at in parts if at is not None}
        planned = Plan(_FIRST + total + SPARE, tuple(found.get(place, place) for place in planned.places))
    if not fits:
        return None, planned
    data = memory.data
    for piece, start, size, at in parts:
        if size and at != begin + start:
            data[begin + start : begin + start + size] = memoryview(moving.get(start, piece)).cast("B")
    return slice(begin, begin + total), planned


def _size(piece: Any) -> int:
    size: int = piece.nbytes if isinstance(piece, np.ndarray) else len(piece)
    return size


def _address(array: _Array) -> int:
    address: int = array.ctypes.data
    return address
