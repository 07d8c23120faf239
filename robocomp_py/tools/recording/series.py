"""Numbers of a recording over time: fields of messages, and how long messages were on their way."""

from __future__ import annotations

import contextlib
import math
from array import array
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...contract import types
from ...contract.types import BOOL, FLOATS, INTEGERS, Enumeration, Field, Struct, Type
from ...errors import DecodeError
from ...fieldpath import steps
from ..parts import walk
from .bag import RecordingError
from .calls import INFO
from .reader import Recording, named, values_by_topic

Numbers = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Curve:
    """A number in the messages of a topic."""

    topic: str
    path: str
    """Its path in the message: `air.temperature`."""
    times: Numbers = field(repr=False)
    """When the messages were recorded: seconds since the recording began."""
    values: Numbers = field(repr=False)
    """NaN if a sequence of the message is too short for the path."""


def curves(
    recording: Recording, wanted: Sequence[str], start: int | None = None, end: int | None = None
) -> list[list[Curve]]:
    """What each of these words names: a topic or a part of its name, and optionally a path: `LaserPub.scan[0].dist`.

    Without a path, and for a path to a struct, these are all numbers in it except those of sequences. If a word names
    several topics, each has a list of its own. Messages that cannot be decoded are left out. Raises RecordingError.
    """
    groups = [each for word in wanted for each in _groups(recording, word)]
    by_topic: dict[str, list[_Line]] = {}
    for line in (line for lines in groups for line in lines):
        by_topic.setdefault(line.topic, []).append(line)
    values = values_by_topic()
    for message in recording.messages(list(by_topic), start, end):
        try:
            found = values(message)
        except DecodeError:
            continue
        at = (message.log_time - recording.start) / 1e9
        for line in by_topic[message.topic.name]:
            line.times.append(at)
            line.values.append(_number(found, line.places))
    return [
        [Curve(each.topic, each.path, np.array(each.times), np.array(each.values)) for each in lines]
        for lines in groups
    ]


def delays(
    recording: Recording, names: Collection[str] | None = None, start: int | None = None, end: int | None = None
) -> dict[str, Numbers]:
    """Seconds from when each message was sent until it was recorded, by topic; of calls, how long each took.

    Topics whose publishers do not tell when they send have none. Raises RecordingError.
    """
    found = {each: array("d") for each in (recording.topics if names is None else names)}
    values = values_by_topic()
    for message in recording.messages(names, start, end):
        if message.topic.called is not None:
            with contextlib.suppress(DecodeError):
                took = values(message)[0][_TOOK]
                found[message.topic.name].extend([took] if math.isfinite(took) else [])
        elif message.publish_time != message.log_time:
            found[message.topic.name].append((message.log_time - message.publish_time) / 1e9)
    return {name: np.array(each) for name, each in found.items()}


_TOOK = [each.name for each in INFO.fields].index("took")


@dataclass
class _Line:
    topic: str
    path: str
    places: tuple[int, ...]
    """The number at each level of the decoded values."""
    times: array[float] = field(default_factory=lambda: array("d"))
    values: array[float] = field(default_factory=lambda: array("d"))


def _groups(recording: Recording, word: str) -> Iterator[list[_Line]]:
    before, slash, last = word.rpartition("/")
    name, dot, path = last.partition(".")
    for each in named(recording, f"{before}{slash}{name}"):
        topic = recording.topics[each]
        if topic.operation is None:
            raise RecordingError(f"{topic.name}: {topic.problem}")
        inputs = topic.operation.inputs
        try:
            found = list(_below(inputs, steps(path)) if dot else _numbers(inputs))
        except ValueError as exc:
            raise RecordingError(f"{topic.name}: {exc}") from exc
        if not found:
            fields = ", ".join(f"{one.name} {types.spell(one.type)}" for one in inputs)
            what = f"`{path}`" if path else "a message"
            raise RecordingError(
                f"{topic.name}: {what} has no numbers outside of sequences; a message has {fields or 'no fields'}"
            )
        yield [_Line(topic.name, spelt, places) for spelt, places in found]


def _below(fields: Sequence[Field], parts: list[str | int]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """The numbers at and below a path, with where they are. The name of an only parameter may be left out."""
    reached = list(walk(fields, parts))
    spelt, kind = reached[-1].spelt, reached[-1].type
    places = [each.place for each in reached if each.place is not None]
    if len(places) < len(reached):
        raise ValueError(f"`{spelt}` is in a dictionary, and only numbers outside of them are drawn")
    if isinstance(kind, Struct):
        for deeper, further in _numbers(kind.fields):
            yield f"{spelt}.{deeper}", (*places, *further)
    elif _is_number(kind):
        yield spelt, tuple(places)
    else:
        hint = f"; write one of its numbers as {_example(spelt, kind)}" if isinstance(kind, types.Sequence) else ""
        raise ValueError(f"`{spelt}` is {types.spell(kind)}, and only numbers are drawn{hint}")


def _example(spelt: str, kind: Type) -> str:
    """The path of a number in a sequence."""
    while isinstance(kind, types.Sequence):
        spelt, kind = f"{spelt}[0]", kind.item
    inside = next(_numbers(kind.fields), ("",))[0] if isinstance(kind, Struct) else ""
    return f"{spelt}.{inside}" if inside else spelt


def _numbers(fields: Sequence[Field]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """All numbers outside of sequences and dictionaries."""
    for place, each in enumerate(fields):
        if isinstance(each.type, Struct):
            for spelt, places in _numbers(each.type.fields):
                yield f"{each.name}.{spelt}", (place, *places)
        elif _is_number(each.type):
            yield each.name, (place,)


def _is_number(kind: Type) -> bool:
    return isinstance(kind, Enumeration) or kind in FLOATS or kind in INTEGERS or kind is BOOL


def _number(value: Any, places: Sequence[int]) -> float:
    try:
        for each in places:
            value = value[each]
    except IndexError:
        return math.nan
    return float(value)
