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
        total += len(piece) if type(piece) is bytes else piece.nbytes
    return Plan(_FIRST + total + SPARE, tuple(_FIRST + starts[id(array)] for array in arrays))


def lay(pieces: Pieces, memory: _Array, planned: Plan) -> tuple[slice | None, Plan]:
    """Make memory, an array of octets, hold the payload of these pieces; say where, and what to plan the next with.

    An array is in its memory if its bytes are, whatever object it is. What does not fit leaves the
    memory as it is, and is nowhere: None.
    """
    here, room = _address(memory), memory.nbytes
    starts, total = [], 0
    inside: dict[int, tuple[int, int]] = {}  # by its number, where a piece is and how long
    for number, piece in enumerate(pieces):
        starts.append(total)
        if type(piece) is bytes:
            total += len(piece)
            continue
        size, at = piece.nbytes, _address(piece) - here
        if size and 0 <= at <= room - size:
            inside[number] = at, size
        total += size
    stays = max(inside, key=lambda number: inside[number][1], default=None)
    begin = _FIRST if stays is None else inside[stays][0] - starts[stays]
    if not 0 <= begin <= room - total:
        begin = _FIRST
    moving = [number for number, (at, _) in inside.items() if at != begin + starts[number]]
    fits = begin + total <= room
    if moving or not fits:
        found = {at: _FIRST + starts[number] for number, (at, _) in inside.items()}
        planned = Plan(_FIRST + total + SPARE, tuple(found.get(place, place) for place in planned.places))
    if not fits:
        return None, planned
    for number in moving:  # out of the way, before anything is written
        pieces[number] = pieces[number].tobytes()
        del inside[number]
    written = 0
    for number in (*inside, len(pieces)):
        between = b"".join(pieces[written:number])
        end = begin + (total if number == len(pieces) else starts[number])
        memory.data[end - len(between) : end] = between
        written = number + 1
    return slice(begin, begin + total), planned


def _address(array: _Array) -> int:
    address: int = array.ctypes.data
    return address
