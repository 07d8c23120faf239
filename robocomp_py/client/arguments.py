"""The arguments of a call, by position or by name, as an operation takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..contract.types import Enumeration, Field, Struct
from ..spelling import and_then, unknown
from .values import empty, fitted


def arguments(
    name: str, fields: Sequence[Field], values: Sequence[Any], named: Mapping[str, Any], *, also: Sequence[str] = ()
) -> tuple[Any, ...]:
    """The inputs of an operation in their order; messages call it `name`, and tell of the arguments it `also` takes.

    Raises TypeError, and EncodeError for a part of one that does not fit.
    """
    takes = f"it takes ({example(fields)})"
    if len(values) > len(fields):
        raise TypeError(f"{name}: {len(values)} arguments are given; {takes}")
    given = {field.name: value for field, value in zip(fields, values, strict=False)}
    known = {each.name: each.name for each in fields} | {each.attribute: each.name for each in fields}
    for key, value in named.items():
        if key not in known:
            names = [*(each.name for each in fields), *also]
            raise TypeError(f"{name}: {and_then(unknown('argument', key, names), takes)}")
        if known[key] in given:
            raise TypeError(f"{name}: `{key}` is given twice")
        given[known[key]] = value
    if absent := [each.name for each in fields if each.name not in given]:
        raise TypeError(f"{name}: lacks {', '.join(f'`{each}`' for each in absent)}; {takes}")
    return tuple(fitted(each.type, given[each.name], f"{name}: {each.name}") for each in fields)


def example(fields: Sequence[Field]) -> str:
    """Arguments as a caller may write them."""
    return ", ".join(f"{each.attribute}={_plain(each)}" for each in fields)


def _plain(field: Field) -> str:
    """A value of a type as a caller may write it: an enumerator by its name, a struct as a dictionary."""
    return repr(_written(field.type, empty(field.type)))


def _written(kind: Any, value: Any) -> Any:
    match kind:
        case Struct(fields=fields):
            return {each.name: _written(each.type, empty(each.type)) for each in fields}
        case Enumeration(members=members):
            return members[0][0] if members else 0
    return value if isinstance(value, bool | int | float | str | dict) else []
