"""Codec `cdr` that keeps large arrays apart, so that sending copies them only once, into shared memory."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ...contract.types import Sequence, Struct, Type, children
from ...wire.arrays import is_frozen, read_only
from ...wire.cdr import Cdr
from ...wire.codec import Encoder, Payload

APART = 16 * 1024
"""Arrays of at least this many bytes stay apart."""

_Array = np.ndarray[Any, np.dtype[Any]]


class Parts(list[Any]):
    """A payload to be sent: octets and arrays, alternating."""

    size: int


class ApartCdr(Cdr):
    """A payload to be sent is octets or `Parts`; a received one is always octets."""

    def __init__(self) -> None:
        super().__init__(columns=True)  # only programs of ours read them

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        if not _has_arrays(message, set()):
            return super().encoder(message)
        return partial(_encode, self.pieces(message), _copied if snapshot else _shared)


def _has_arrays(kind: Type, seen: set[int]) -> bool:
    if id(kind) in seen:
        return False
    seen.add(id(kind))
    if isinstance(kind, Sequence) and kind.dtype is not None:
        return True
    return any(_has_arrays(child, seen) for child in children(kind))


def _encode(pieces: Encoder, kept: Callable[[_Array], _Array], values: tuple[Any, ...]) -> Payload:
    parts = pieces(values)
    for part in parts:
        if type(part) is np.ndarray and part.nbytes >= APART:
            return _apart(parts, kept)
    return b"".join(parts)


def _apart(parts: list[Any], kept: Callable[[_Array], _Array]) -> Parts:
    result = Parts()
    between: list[Any] = []
    size = 0
    for part in parts:
        if type(part) is np.ndarray and part.nbytes >= APART:
            octets = b"".join(between)
            result += octets, kept(part)
            size += len(octets) + part.nbytes
            between = []
        else:
            between.append(part)
    if between:
        result.append(b"".join(between))
        size += len(result[-1])
    result.size = size
    return result


def _shared(array: _Array) -> _Array:
    return array


def _copied(array: _Array) -> _Array:
    return array if is_frozen(array) else read_only(array.copy())
