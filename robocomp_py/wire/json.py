"""Values as JSON and back, for tools: what is shown of a message, and what a person types.

    integers, float, bool, string   the same; NaN and infinities as "NaN", "Infinity" and "-Infinity"
    time                            nanoseconds since 1970
    enumeration                     the name of its member
    struct                          an object
    sequence                        an array; of octets, base64
    dictionary                      an object, whose keys are text

Structs may be of any form in Python when they are shown, and are tuples of their fields when they are read: the types
are those of `contract.told`, which have no classes.

numpy is imported only for what has its types, since its import takes longer than all else that a tool needs.
"""

from __future__ import annotations

import base64
import binascii
import math
import sys
from collections.abc import Sequence as Items
from typing import Any

from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_LIMIT,
    FLOATS,
    STRING,
    UINT8,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    integer_range,
    spell,
)
from ..spelling import closest
from .values import as_float32

_NOT_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}

FLOAT64_MAX = sys.float_info.max

_FLOAT32_NORMAL = 2.0**-126
"""Smaller numbers have fewer digits as a float32."""

_WIDEST = 8
"""Maximum number of fields that a message to people names."""


class Unfit(ValueError):
    """JSON that does not fit a type; the text says where and what fits."""


def show_fields(fields: Items[Field], values: Items[Any]) -> dict[str, Any]:
    """The fields of a message by name, as `json.dumps` takes them."""
    return {field.name: show(field.type, value) for field, value in zip(fields, values, strict=True)}


def show(kind: Type, value: Any) -> Any:
    """A value as `json.dumps` takes it."""
    match kind:
        case Struct(fields=fields):
            if isinstance(value, _of_numpy("void")):
                return show_fields(fields, value.item())
            if isinstance(value, tuple):
                return show_fields(fields, value)
            return show_fields(fields, [getattr(value, field.attribute) for field in fields])
        case Sequence(item) if item is UINT8:
            return base64.b64encode(bytes(value)).decode()
        case Sequence(item):
            if isinstance(value, _of_numpy("ndarray")) and value.dtype.names is None and item not in FLOATS:
                return value.tolist()
            return [show(item, each) for each in value]
        case Dictionary(key, item):
            return {_show_key(key, each): show(item, other) for each, other in value.items()}
        case Enumeration(members=members):
            return next((name for name, number in members if number == int(value)), int(value))
        case Primitive():
            return _show_primitive(kind, value)


def _show_primitive(kind: Primitive, value: Any) -> Any:
    plain = value.item() if type(value) not in _PLAIN and isinstance(value, _of_numpy("generic")) else value
    if kind not in FLOATS:
        return plain
    if not math.isfinite(plain):
        return next(name for name, number in _NOT_FINITE.items() if number == plain or plain != plain)
    return _short(plain) if kind is FLOAT32 else float(plain)


_PLAIN = frozenset({bool, int, float, str})


def _of_numpy(name: str) -> Any:
    """A class of numpy's. Before numpy is imported, no value is of its classes; then this is ()."""
    return getattr(sys.modules.get("numpy"), name, ())


def _short(value: float) -> float:
    """The number with the fewest digits that is rounded to this float32: 0.1, and not 0.10000000149011612."""
    if single := _of_numpy("float32"):
        return float(str(single(value)))
    rounded = as_float32(value)
    for digits in range(6 if abs(value) >= _FLOAT32_NORMAL else 1, 9):
        short = float(f"{rounded:.{digits}g}")
        if abs(short) < FLOAT32_LIMIT and as_float32(short) == rounded:
            return short
    return float(f"{rounded:.9g}")


def _show_key(kind: Type, value: Any) -> str:
    key = show(kind, value)
    return str(key).lower() if isinstance(key, bool) else str(key)


def take_fields(fields: Items[Field], given: Any, what: str) -> tuple[Any, ...]:
    """The values of a message's fields. Raises Unfit if `given` is not an object with just these fields.

    `what` names the message, or the field that it is.
    """
    if not isinstance(given, dict):
        raise Unfit(f"{what}: {_described(given)} is given; it takes {_spelt(fields)}")
    names = {field.name for field in fields}
    for name in given:
        if name not in names:
            near = closest(name, names) or _deeper(fields, name)
            hint = f"did you mean `{near}`?" if near else f"it takes {_spelt(fields) if fields else 'none'}"
            raise Unfit(f"{what}: no field `{name}`; {hint}")
    if absent := [field.name for field in fields if field.name not in given]:
        raise Unfit(f"{what}: lacks {', '.join(f'`{name}`' for name in absent[:_WIDEST])}; it takes {_spelt(fields)}")
    return tuple(take(field.type, given[field.name], f"{what}.{field.name}") for field in fields)


def _deeper(fields: Items[Field], name: str) -> str:
    """Look for a field in the structs of these fields. Returns its path, such as `battery.percentage`, or ""."""
    return next(
        (
            f"{field.name}.{name}"
            for field in fields
            if isinstance(field.type, Struct) and any(each.name == name for each in field.type.fields)
        ),
        "",
    )


def take(kind: Type, given: Any, what: str) -> Any:
    """A value of a type. Raises Unfit."""
    match kind:
        case Struct(fields=fields):
            return take_fields(fields, given, what)
        case Sequence(item) if item is UINT8 and isinstance(given, str):
            import numpy as np

            try:
                return np.frombuffer(base64.b64decode(given, validate=True), np.uint8)
            except binascii.Error as exc:
                raise Unfit(f"{what}: not base64: {exc}") from exc
        case Sequence(item):
            if not isinstance(given, list):
                raise Unfit(f"{what}: {_described(given)} is given; it takes an array of {_word(item)}")
            items = [take(item, each, f"{what}[{place}]") for place, each in enumerate(given)]
            if kind.dtype is None:
                return items
            import numpy as np

            return np.array(items, kind.dtype)
        case Dictionary(key, item):
            if not isinstance(given, dict):
                raise Unfit(f"{what}: {_described(given)} is given; it takes an object")
            return {_take_key(key, each, what): take(item, other, f"{what}[{each!r}]") for each, other in given.items()}
        case Enumeration(members=members):
            numbers = dict(members)
            if given in numbers:
                return numbers[given]
            raise Unfit(f"{what}: {_described(given)} is given; it takes one of {', '.join(numbers)}")
        case Primitive():
            return _take_primitive(kind, given, what)


def _take_primitive(kind: Primitive, given: Any, what: str) -> Any:
    if kind is STRING or kind is BOOL:
        if isinstance(given, kind.python):
            return given
    elif kind in FLOATS:
        if isinstance(given, str) and given in _NOT_FINITE:
            return _NOT_FINITE[given]
        if isinstance(given, int | float) and not isinstance(given, bool):
            if abs(given) < FLOAT32_LIMIT if kind is FLOAT32 else abs(given) <= FLOAT64_MAX:
                return float(given)
            raise Unfit(f"{what}: {given} is out of range; it takes {_word(kind)}")
    elif isinstance(given, int) and not isinstance(given, bool):
        low, high = integer_range(kind)
        if low <= given <= high:
            return given
        raise Unfit(f"{what}: {given} is out of range; it takes {low} to {high}")
    raise Unfit(f"{what}: {_described(given)} is given; it takes {_word(kind)}")


def _take_key(kind: Type, given: str, what: str) -> Any:
    """A key, which is text in JSON."""
    if kind is BOOL and given in ("true", "false"):
        return given == "true"
    try:
        number: Any = int(given) if isinstance(kind, Primitive) and kind is not STRING and kind is not BOOL else given
    except ValueError:
        number = given
    return take(kind, number, f"key {given!r} of {what}")


def template(fields: Items[Field]) -> dict[str, Any]:
    """An object with all fields, to be filled in: zero, false, "" and empty ones."""
    return {field.name: _empty(field.type) for field in fields}


def _empty(kind: Type) -> Any:
    match kind:
        case Struct(fields=fields):
            return template(fields)
        case Sequence(item):
            return "" if item is UINT8 else []
        case Dictionary():
            return {}
        case Enumeration(members=members):
            return members[0][0] if members else ""
        case Primitive():
            return kind.zero


def _described(given: Any) -> str:
    """A given value, in the words of JSON."""
    match given:
        case bool() | None:
            return {True: "true", False: "false", None: "null"}[given]
        case int() | float():
            return f"the number {given}"
        case str():
            return f"the text {given[:40]!r}"
        case list():
            return "an array"
        case _:
            return "an object"


def _spelt(fields: Items[Field]) -> str:
    """The fields with their types: `{x float64, y float64}`."""
    parts = [f"{field.name} {_word(field.type)}" for field in fields[:_WIDEST]]
    return "{" + ", ".join([*parts, "…"] if len(fields) > _WIDEST else parts) + "}"


def _word(kind: Type) -> str:
    match kind:
        case Struct(fields=fields) if all(isinstance(field.type, Primitive) for field in fields):
            return _spelt(fields)
        case _:
            return spell(kind).replace("::", ".")
