"""Draws values of a topic with matplotlib."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..contract.types import python_name
from ..errors import Timeout
from ..fieldpath import Wide, wide_steps
from ..tools.drawing import need_matplotlib
from .values import Record

if TYPE_CHECKING:
    from .hearing import Listening


_GAP = math.nan


def plot(
    name: str, first: str, listen: Callable[[float], Listening], fields: Sequence[str], seconds: float, axes: Any
) -> Any:
    """See `Topic.plot`. `listen` subscribes to the topic of that name; it gets the longest wait for a message.

    `first` is the field of its messages, if they have only one; else "".
    """
    drawn = axes or _axes()
    times, columns = _gathered(listen, first, fields, seconds)
    if not times:
        raise Timeout(f"{name}: no message came in {seconds:g} s")
    for field, column in columns.items():
        if all(each is _GAP for each in column):
            raise ValueError(f"`{field}` is in none of {len(column)} messages: they have too few items")
    for field, column in columns.items():
        arrays = [each for each in column if isinstance(each, np.ndarray)]
        if arrays:
            drawn.plot(arrays[-1], label=field)
            drawn.set_xlabel("number")
        else:
            drawn.plot(times, column, label=field)
            drawn.set_xlabel("seconds")
    drawn.set_title(name)
    if any(columns):
        drawn.legend()
    return drawn


def _axes() -> Any:
    need_matplotlib()
    from matplotlib import pyplot

    _, axes = pyplot.subplots()
    return axes


def _gathered(
    listen: Callable[[float], Listening], first: str, fields: Sequence[str], seconds: float
) -> tuple[list[float], dict[str, list[Any]]]:
    """When messages came, in seconds, and the values of each field."""
    times: list[float] = []
    columns: dict[str, list[Any]] = {}
    begun = time.monotonic()
    with listen(seconds) as messages:
        for message in messages:
            now = time.monotonic() - begun
            if not columns:
                columns = {path: [] for field in fields or ("",) for path in numbers_below(message, field, first)}
            for path, column in columns.items():
                try:
                    column.append(_number(part_of(message, path, first), path or first))
                except IndexError:  # of too few items: the curve has a gap
                    column.append(_GAP)
            times.append(now)
            if now >= seconds:
                break
    return times, columns


def numbers_below(message: Any, field: str, first: str) -> list[str]:
    """The field itself, or if it is a struct, the numbers in it except those of sequences. Raises ValueError."""
    if field.count("[*]") > 1:
        raise ValueError(
            f"`{field}` has [*] more than once; draw one of these arrays: {field.replace('[*]', '[0]', 1)}"
        )
    try:
        value = part_of(message, field, first)
    except IndexError:  # another message may have more items
        return [field]
    if not isinstance(value, Record):
        return [field]
    found = [f"{field}.{each}" if field else each for each in _numbers(value)]
    if not found:
        kind = type(value).__name__
        raise ValueError(f"`{field or 'the message'}` is {kind}, which has no numbers outside of sequences")
    return found


def _numbers(value: Record) -> Iterator[str]:
    for field in value.__contract__.fields:
        inner = value[field.name]
        if isinstance(inner, Record):
            yield from (f"{field.name}.{each}" for each in _numbers(inner))
        elif isinstance(inner, bool | int | float):
            yield field.name


def part_of(message: Any, path: str, first: str = "") -> Any:
    """The part of a message that a path such as `a.b[0]` names; with `a[*].b`, an array of that part of all items.

    `first` may stand for the whole message. Raises ValueError for what is no path, AttributeError and IndexError for
    what is not there.
    """
    if not path:
        return message
    parts = wide_steps(path)
    if first and parts[0] == first and not hasattr(message, first):
        parts = parts[1:]
    return _part(message, parts)


def _part(value: Any, parts: Sequence[str | int | Wide]) -> Any:
    for place, each in enumerate(parts):
        match each:
            case int():
                value = value[each]
            case str() if isinstance(value, list | np.ndarray):
                raise AttributeError(f"a sequence has no field `{each}`; its items may have: [0].{each} or [*].{each}")
            case str():
                value = getattr(value, python_name(each))
            case Wide.ITEMS:
                found = [_part(item, parts[place + 1 :]) for item in value]
                return np.array(found) if all(isinstance(item, bool | int | float) for item in found) else found
            case Wide.FIELDS:
                return value
    return value


def _number(value: Any, field: str) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.ndim == 1:
        return value
    if isinstance(value, bool | int | float):
        return value
    kind, hint = type(value).__name__, ""
    if isinstance(value, list | np.ndarray):
        item = value[0] if len(value) else None
        kind = f"a sequence of {type(item).__name__}" if len(value) else "a sequence without items"
        if isinstance(item, Record) and field and "[*]" not in field:
            inner = next(_numbers(item), item.__contract__.fields[0].name)
            hint = f"; write a number of its items, as {field}[*].{inner} or {field}[0].{inner}"
    raise ValueError(f"`{field or 'the message'}` is {kind}, and only numbers and arrays of them are drawn{hint}")
