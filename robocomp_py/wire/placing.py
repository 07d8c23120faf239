"""Builds payloads in given memory, around arrays that are already there.

An array that was filled in place should not move, but the bytes before it can. So the arrays get their
places first, at the offsets of a similar payload, with room before and after. When the message is
complete, the start of its payload is chosen so that the largest array stays in place. Usually all
arrays do; others are copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Pieces = list[Any]
"""The parts of a payload, in order: bytes, and arrays."""

SPARE = 1024
"""Bytes before and after: texts may grow by this number, compared to the message of the plan."""

_FIRST = SPARE + 4
"""Where a payload begins if it may begin anywhere: 4 octets before a multiple of 8, which aligns its numbers."""

_Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True, slots=True)
class Plan:
    """How much memory a message takes, and where in it each of its arrays begins."""

    size: int
    places: tuple[int, ...]


def plan(pieces: Pieces, arrays: Sequence[_Array]) -> Plan:
    """A plan for messages similar to the one with these pieces, which include these arrays."""
    starts, total = {}, 0
    for piece in pieces:
        starts[id(piece)] = total
        total += len(piece) if type(piece) is bytes else piece.nbytes
    return Plan(_FIRST + total + SPARE, tuple(_FIRST + starts[id(array)] for array in arrays))


def lay(pieces: Pieces, memory: _Array, planned: Plan) -> tuple[slice | None, Plan]:
    """Put the payload of these pieces into memory, an array of octets; return where, and the plan for the next one.

    An array counts as in place if its bytes are in this memory. If the payload does not fit, the
    memory stays as it is and None is returned.
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
    for number in moving:  # copy these before anything is overwritten
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
