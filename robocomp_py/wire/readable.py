"""Messages as JSON, for people and for comparison. Nothing reads it back."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence as Items
from typing import Any

import numpy as np

from ..contract.types import Dictionary, Enumeration, Primitive, Sequence, Struct, Type

_MOST_ITEMS = 32
"""Longest array that is written out; of a longer one, only what identifies it."""


def readable(message: Struct, values: Items[Any]) -> dict[str, Any]:
    """The fields of a message, by name, as `json.dumps` takes them."""
    return {field.name: _readable(field.type, value) for field, value in zip(message.fields, values, strict=True)}


def _readable(kind: Type, value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist() if value.size <= _MOST_ITEMS else _summary(value)
    match kind:
        case Struct(fields=fields):
            parts = value if isinstance(value, tuple) else [getattr(value, field.attribute) for field in fields]
            return readable(kind, parts)
        case Sequence(item):
            return [_readable(item, each) for each in value]
        case Dictionary(key, item):
            return {str(_readable(key, each)): _readable(item, other) for each, other in value.items()}
        case Enumeration(members=members):
            return next(name for name, number in members if number == int(value))
        case Primitive():
            return value


def _summary(array: np.ndarray[Any, Any]) -> str:
    """Type, shape and a hash of the contents."""
    shape = ", ".join(map(str, array.shape))
    return f"{array.dtype.name}[{shape}] sha256:{hashlib.sha256(array.tobytes()).hexdigest()[:16]}"
