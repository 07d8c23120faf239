"""Actions and observations: from a vector to the arguments of a call, and from a message to a vector."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..client.values import fitted
from ..contract import types
from ..contract.interface import Operation
from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_LIMIT,
    FLOAT32_MAX,
    FLOATS,
    INTEGERS,
    Enumeration,
    Primitive,
    Struct,
    Type,
    dtypes,
)
from ..errors import EncodeError
from ..fieldpath import Wide
from ..spelling import unknown
from ..tools.parts import parts
from ..wire.cdr import Cdr

Array = NDArray[Any]
_PLAIN = (float, int, bool)
"""The types of single values."""

Taken = Iterator[float]
"""The parts of an action that are still to be used, in their order."""


@dataclass(frozen=True, slots=True)
class Range:
    """The least and the greatest value of a number: of one that the agent chooses, or of one that it observes."""

    low: float
    high: float

    def __post_init__(self) -> None:
        """Raises ValueError unless both are finite, and the second one is greater."""
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"a range from {self.low} to {self.high}: it needs finite numbers, the lower one first")

    def at(self, share: float) -> float:
        """From -1, which is the least value, to 1."""
        return self.low + (min(max(share, -1.0), 1.0) + 1.0) / 2.0 * (self.high - self.low)


class Action:
    """The arguments of a call, some of whose numbers are chosen by an agent."""

    def __init__(self, name: str, operation: Operation[Any], arguments: Mapping[str, Any]) -> None:
        """`arguments` has the inputs by their names, with a `Range` in the place of each number that is chosen.

        Raises ValueError for arguments that do not fit the operation, with the name of the wrong one.
        """
        self.name = name
        if not isinstance(arguments, Mapping):
            raise TypeError(f"{name}: its inputs are a dictionary from their names to values, not {arguments!r}")
        known = [each.name for each in operation.inputs]
        if wrong := next((each for each in arguments if each not in known), None):
            raise ValueError(f"{name}: {unknown('parameter', wrong, known)}")
        if absent := [each for each in known if each not in arguments]:
            raise ValueError(f"{name}: lacks {', '.join(f'`{each}`' for each in absent)}")
        self._inputs = [(each.type, arguments[each.name], each.name) for each in operation.inputs]
        self.size = sum(1 for _ in _ranges(list(arguments.values())))
        """How many numbers are chosen."""
        encode = Cdr().encoder(operation.request)
        for share in (-1.0, 1.0):
            try:
                encode(self.arguments(iter([share] * self.size)))
            except EncodeError as exc:
                raise ValueError(f"{name}: {str(exc).removeprefix(f'{operation.called}: ')}") from exc

    def arguments(self, taken: Taken) -> tuple[Any, ...]:
        """The inputs in their order, with the next `size` parts of an action, each from -1 to 1."""
        return tuple(fitted(kind, _chosen(kind, given, taken), what) for kind, given, what in self._inputs)


def _ranges(given: object) -> Iterator[Range]:
    if isinstance(given, Range):
        yield given
    elif isinstance(given, Mapping):
        yield from _ranges(list(given.values()))
    elif isinstance(given, list | tuple):
        for each in given:
            yield from _ranges(each)


def _chosen(kind: Type | None, given: Any, taken: Taken) -> Any:
    """What is given, with numbers in the places of ranges. The order is that of `_ranges`."""
    if isinstance(given, Range):
        number = given.at(next(taken))
        if kind is BOOL:
            return 2 * number >= given.low + given.high
        return round(number) if kind in INTEGERS else _sent(kind, number)
    if isinstance(given, float):
        return _sent(kind, given)
    if isinstance(given, Mapping):
        inner = {each.name: each.type for each in kind.fields} if isinstance(kind, Struct) else {}
        item = kind.value if isinstance(kind, types.Dictionary) else None
        return {name: _chosen(inner.get(name, item), each, taken) for name, each in given.items()}
    if isinstance(given, list | tuple):
        if isinstance(kind, Struct):
            fields = [each.type for each in kind.fields]
            return tuple(_chosen(*pair, taken) for pair in zip(fields, given, strict=False))
        item = kind.item if isinstance(kind, types.Sequence) else None
        return [_chosen(item, each, taken) for each in given]
    return given


def _sent(kind: Type | None, number: float) -> float:
    """A number as it arrives: calls without messages get the same as those with them."""
    return float(np.float32(number)) if kind is FLOAT32 and abs(number) < FLOAT32_LIMIT else number


class Observation:
    """Numbers of a message as an array of one dimension."""

    def __init__(self, name: str, fields: Sequence[types.Field], path: str, bounds: Range | None) -> None:
        """`fields` are those of the message. Raises ValueError for a path that does not lead to numbers, and for
        floating-point numbers without bounds."""
        self.name = name
        try:
            found = parts(fields, path)
        except ValueError as exc:
            raise ValueError(f"{name}: {exc}") from exc
        kinds = {_number(name, each.path, each.type) for each in found}
        if len(kinds) > 1:
            spelt = ", ".join(sorted(types.spell(each) for each in kinds))
            raise ValueError(f"{name}: numbers of several types ({spelt}); name one field after the other")
        (kind,) = kinds
        places = {each.name: place for place, each in enumerate(fields)}
        self._readers = [(places[str(each.steps[0])], _field_reader(fields, each.steps)) for each in found]
        """The place of a value in a message, and what takes a part of it."""
        self.dtype: np.dtype[Any] = np.dtype(np.uint8) if kind is BOOL else _dtype(kind)
        self.low, self.high = _bounds(name, kind, bounds)
        self._low, self._high = np.array(self.low, self.dtype), np.array(self.high, self.dtype)

    def of(self, values: Sequence[Any]) -> Array:
        """From the values of a message; a new array. Numbers out of bounds become the nearest bound.

        Raises ValueError for NaN.
        """
        read = [reader(values[place]) for place, reader in self._readers]
        if len(read) == 1 and type(read[0]) in _PLAIN:  # takes a third of the time of the general case below
            made: Array = np.array(read, self.dtype)
            if self.low < made.item() < self.high:
                return made
        arrays = [np.array(each, self.dtype).ravel() for each in read]
        made = arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
        np.minimum(made, self._high, out=made)  # `np.clip` takes three times as long for so few numbers
        np.maximum(made, self._low, out=made)
        if made.dtype.kind == "f" and math.isnan(np.maximum.reduce(made, initial=self.low)):
            raise ValueError(f"{self.name} is NaN: it cannot be observed")
        return made


def _number(name: str, path: str, kind: Type) -> Primitive | Enumeration:
    """The type of the numbers that a path leads to."""
    item = kind.item if isinstance(kind, types.Sequence) else kind
    if isinstance(item, Enumeration) or item is BOOL or item in INTEGERS or item in FLOATS:
        return item
    hint = f"; name a field of it: {path}.{item.fields[0].name}" if isinstance(item, Struct) and item.fields else ""
    if kind is not item and hint:
        hint = f"; name a field of its items: {path}[*].{item.fields[0].name}" if isinstance(item, Struct) else ""
    raise ValueError(f"{name}: `{path}` is {types.spell(kind).replace('::', '.')}, and no number{hint}")


def _dtype(kind: Primitive | Enumeration) -> np.dtype[Any]:
    return dtypes()[types.INT32 if isinstance(kind, Enumeration) else kind]


def _bounds(name: str, kind: Primitive | Enumeration, bounds: Range | None) -> tuple[float, float]:
    """The least and the greatest value: those of the type, unless they are given."""
    if isinstance(kind, Enumeration):
        numbers = [number for _, number in kind.members]
        least, greatest = min(numbers), max(numbers)
    elif kind is BOOL:
        least, greatest = 0, 1
    elif kind in INTEGERS:
        least, greatest = types.integer_range(kind)
    elif bounds is None:
        raise ValueError(f"{name} is a {kind}, which has no least and no greatest value: give a Range")
    else:
        limit = FLOAT32_MAX if kind is FLOAT32 else math.inf
        if max(abs(bounds.low), abs(bounds.high)) > limit:
            raise ValueError(f"{name} is a {kind}, and cannot be from {bounds.low:g} to {bounds.high:g}")
        return bounds.low, bounds.high
    if bounds is None:
        return least, greatest
    if not least <= bounds.low < bounds.high <= greatest:
        raise ValueError(f"{name} is from {least} to {greatest}, and cannot be from {bounds.low:g} to {bounds.high:g}")
    return math.ceil(bounds.low), math.floor(bounds.high)


def _field_reader(fields: Sequence[types.Field], steps: Sequence[str | int | Wide]) -> Callable[[Any], Any]:
    """What takes the part at the end of a path from the field with which it begins."""
    names, within = [], fields
    for each in steps:
        field = next((field for field in within if field.name == each), None)
        if field is None:
            return _reader(steps[1:])
        names.append(field.attribute)
        within = field.type.fields if isinstance(field.type, Struct) else ()
    return attrgetter(".".join(names[1:])) if names[1:] else _reader(())


def _reader(steps: Sequence[str | int | Wide]) -> Callable[[Any], Any]:
    """What takes the part at the end of a path from a value."""
    if not steps:
        return lambda value: value
    first, further = steps[0], _reader(steps[1:])
    if first is Wide.ITEMS:
        rest = list(steps[1:])
        if len(rest) == 1 and isinstance(rest[0], str):
            attribute = types.python_name(rest[0])
            of_one = attrgetter(attribute)
            return lambda items: items[attribute] if isinstance(items, np.ndarray) else list(map(of_one, items))
        return lambda items: [further(each) for each in items]
    return lambda value: further(_step(value, first))


def _step(value: Any, step: str | int | Wide) -> Any:
    if isinstance(value, dict):
        return value[step]
    if isinstance(step, str):
        return value[types.python_name(step)] if isinstance(value, np.void) else getattr(value, types.python_name(step))
    return value[step]
