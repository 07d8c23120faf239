"""Draws values of a topic with matplotlib."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import Timeout
from ..fieldpath import steps
from ..tools.drawing import need_matplotlib

if TYPE_CHECKING:
    from .operations import Topic


def plot(topic: Topic, fields: Sequence[str], seconds: float, axes: Any) -> Any:
    """See `Topic.plot`."""
    drawn = axes or _axes()
    times, columns = _gathered(topic, fields, seconds)
    for field, column in zip(fields or ("",), columns, strict=True):
        if isinstance(column[-1], np.ndarray):
            drawn.plot(column[-1], label=field)
            drawn.set_xlabel("number")
        else:
            drawn.plot(times, column, label=field)
            drawn.set_xlabel("seconds")
    drawn.set_title(topic._channel.name)
    if any(fields):
        drawn.legend()
    return drawn


def _axes() -> Any:
    need_matplotlib()
    from matplotlib import pyplot

    _, axes = pyplot.subplots()
    return axes


def _gathered(topic: Topic, fields: Sequence[str], seconds: float) -> tuple[list[float], list[list[Any]]]:
    """When messages came, in seconds, and the values of each field. Raises Timeout if none came."""
    times: list[float] = []
    columns: list[list[Any]] = [[] for _ in fields or ("",)]
    first = topic._operation.inputs[0].name if len(topic._operation.inputs) == 1 else ""
    begun = time.monotonic()
    with topic.listen(timeout=seconds) as messages:
        for message in messages:
            now = time.monotonic() - begun
            for field, column in zip(fields or ("",), columns, strict=True):
                column.append(_number(part_of(message, field, first), field))
            times.append(now)
            if now >= seconds:
                break
    if not times:
        raise Timeout(f"{topic._channel.name}: no message came in {seconds:g} s")
    return times, columns


def part_of(message: Any, path: str, first: str = "") -> Any:
    """The part of a message that a path such as `a.b[0]` names. `first` may stand for the whole message.

    Raises ValueError for what is no path, AttributeError and IndexError for what is not there.
    """
    if not path:
        return message
    parts = steps(path)
    if first and parts[0] == first and not hasattr(message, first):
        parts = parts[1:]
    for each in parts:
        message = message[each] if isinstance(each, int) else getattr(message, each)
    return message


def _number(value: Any, field: str) -> Any:
    if isinstance(value, np.ndarray | bool | int | float):
        return value
    raise ValueError(
        f"`{field or 'the message'}` is {type(value).__name__}, and only numbers and arrays of them are drawn"
    )
