"""Codec `cdr`, whose large arrays stay apart until whoever sends them copies them into shared memory: once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ...contract.types import Sequence, Struct, Type, children
from ...wire.cdr import Cdr
from ...wire.codec import Encoder, Payload
from ...wire.values import snapshot as frozen

APART = 16 * 1024
"""Arrays of so many bytes stay apart."""

_Array = np.ndarray[Any, np.dtype[Any]]


class ApartCdr(Cdr):
    """A payload to be sent is octets, or a list of octets and arrays. One that was received is octets, always."""

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


def _apart(parts: list[Any], kept: Callable[[_Array], _Array]) -> list[Any]:
    result: list[Any] = []
    between: list[Any] = []
    for part in parts:
        if type(part) is np.ndarray and part.nbytes >= APART:
            result += [b"".join(between), kept(part)]
            between = []
        else:
            between.append(part)
    return [*result, b"".join(between)]


def _shared(array: _Array) -> _Array:
    return array


def _copied(array: _Array) -> _Array:
    return frozen(array, array.dtype)
