"""Explains why values do not fit a message: which field has the wrong value, and what it needs."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    STRING,
    TIME,
    Dictionary,
    Enumeration,
    Primitive,
    Sequence,
    Struct,
    Type,
)
from .arrays import as_array
from .records import is_structured, records
from .values import RANGES, as_bool, as_float, as_float32, as_int, as_list, as_member, as_str, as_tuple


def explain(message: Struct, values: Any) -> str | None:
    """The first field whose value does not fit its type, in words; None if all do."""
    if not isinstance(values, tuple) or len(values) != len(message.fields):
        return f"{message.title}: expected {len(message.fields)} values, got {_show(values)}"
    for field, value in zip(message.fields, values, strict=True):
        wrong = _explain(field.type, value, field.name)
        if wrong:
            return f"{message.title}: {wrong}"
    return None


def _explain(kind: Type, value: Any, at: str) -> str | None:
    match kind:
        case Primitive():
            return _misfit(partial(_FITS[kind], value), f"{at} must be {_WORDS[kind]}, not {_show(value)}")
        case Enumeration(name=name, members=members):
            table = {number: number for _, number in members}
            return _misfit(partial(as_member, value, table), f"{at} must be a {_short(name)}, not {_show(value)}")
        case Struct(name=name, fields=fields, python=python):
            inside = _parts(kind, value)
            if inside is None:
                what = f"a {python.__name__}" if python else f"a tuple of {len(fields)}, the fields of {_short(name)}"
                return f"{at} must be {what}, not {_show(value)}"
            parts = ((f.type, part, f"{at}.{f.name}") for f, part in zip(fields, inside, strict=True))
        case Sequence(Struct() as item) if item.dtype is not None and (kind.records or is_structured(value)):
            return _misfit(partial(records(item).taken, value), f"{at} must be records of {_short(item.name)}", value)
        case Sequence(item):
            if kind.dtype is not None:
                return _misfit(
                    partial(as_array, value, kind.dtype), f"{at} must be an array of {kind.dtype.name}", value
                )
            wrong = _misfit(partial(as_list, value), f"{at} must be a list, not {_show(value)}")
            if wrong:
                return wrong
            parts = ((item, part, f"{at}[{number}]") for number, part in enumerate(value))
        case Dictionary(key, item):
            if not isinstance(value, Mapping):
                return f"{at} must be a dict, not {_show(value)}"
            parts = (
                each
                for k, v in value.items()
                for each in ((key, k, f"key {_REPR.repr(k)} of {at}"), (item, v, f"{at}[{_REPR.repr(k)}]"))
            )
    return next(filter(None, (_explain(*part) for part in parts)), None)


def _misfit(fit: Callable[[], Any], otherwise: str, array: Any = None) -> str | None:
    try:
        fit()
    except Exception as exc:  # whatever a foreign object raises when it is looked at
        return otherwise if array is None else f"{otherwise}, not {_show(array)}: {exc}"
    return None


def _parts(kind: Struct, value: Any) -> tuple[Any, ...] | None:
    """The values of a struct's fields, or None if this is no such struct."""
    try:
        if kind.python is None:
            return as_tuple(value, len(kind.fields))
        return tuple(getattr(value, f.attribute) for f in kind.fields)
    except Exception:  # whatever a foreign object raises when it is looked at
        return None


def _short(name: str) -> str:
    return name.rpartition("::")[2]


def _show(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > _WHOLE:
        of = f"fields {', '.join(value.dtype.names)}" if value.dtype.names else value.dtype.name
        return f"ndarray of {of}, shape {value.shape}"
    return f"{type(value).__name__} {_REPR.repr(value)}"


_WHOLE = 6
"""The size up to which an array is shown with its values."""

_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = 60

_FITS: dict[Primitive, Callable[[Any], Any]] = {
    BOOL: as_bool,
    STRING: as_str,
    FLOAT32: as_float32,
    FLOAT64: as_float,
    **{kind: partial(as_int, low=low, high=high) for kind, (low, high) in RANGES.items()},
}
_WORDS = {
    BOOL: "a bool",
    STRING: "a str that encodes to UTF-8",
    FLOAT32: "a float (float32)",
    FLOAT64: "a float (float64)",
    **{kind: f"an int from {low} to {high}" for kind, (low, high) in RANGES.items()},
    TIME: "an int, nanoseconds since 1970, from {} to {}".format(*RANGES[TIME]),
}
