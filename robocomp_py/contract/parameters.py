"""What a component can be configured with, and whether a given configuration is right.

A `ParameterSet` comes from a PDSL file and is carried by generated code as a literal. `check`
turns the values of a configuration file into the generated, read-only classes, or says what is
wrong with each. It knows keys, not files: the reader of the file adds the line.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

from ..errors import ConfigurationError
from ..spelling import closest, unknown

Key = tuple[str | int, ...]


class ParameterKind(StrEnum):
    INT = "int"
    FLOAT = "float"
    DOUBLE = "double"
    STRING = "string"
    BOOL = "bool"
    ENUM = "enum"


@dataclass(frozen=True)
class Parameter:
    """One value. `mandatory` ones must be given; `dynamic` ones may be changed while the component runs."""

    name: str
    kind: ParameterKind
    default: Any
    minimum: float | int | None = None
    maximum: float | int | None = None
    choices: tuple[str, ...] = ()
    mandatory: bool = False
    description: str = field(default="", compare=False)
    dynamic: bool = False

    def admits(self, value: Any) -> bool:
        """Whether a number is in the range; everything is, if there is none."""
        if self.minimum is None or self.maximum is None:
            return True
        return bool(self.minimum <= value <= self.maximum)

    def allowed(self) -> str:
        """What may be written, for people: `float, 0 to 2`."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        kind = "float" if self.kind is ParameterKind.DOUBLE else str(self.kind)
        return kind if self.minimum is None else f"{kind}, {self.minimum} to {self.maximum}"

    def read(self, text: str) -> Any:
        """Convert a text to the parameter's type; a text that cannot be converted is returned unchanged."""
        try:
            match self.kind:
                case ParameterKind.INT:
                    return int(text, 16 if "x" in text.lower() else 10)
                case ParameterKind.FLOAT | ParameterKind.DOUBLE:
                    return float(text)
                case ParameterKind.BOOL:
                    return {"true": True, "false": False}.get(text.lower(), text)
                case ParameterKind.STRING | ParameterKind.ENUM:
                    return text
        except ValueError:
            return text


@dataclass(frozen=True)
class ParameterList:
    """A table that repeats: `[[motors]]`."""

    name: str
    items: ParameterSet
    minimum: int = 0
    maximum: int | None = None
    description: str = field(default="", compare=False)

    def count(self, number: int, at: Key) -> list[Complaint]:
        """What is wrong with this number of items."""
        if number >= self.minimum and (self.maximum is None or number <= self.maximum):
            return []
        upper = "any number" if self.maximum is None else self.maximum
        what = _described(self.name, self.description)
        return [Complaint(at, f"{number} items of {what}; allowed: {self.minimum} to {upper}", "config-item-count")]


@dataclass(frozen=True)
class ParameterSet:
    """Parameters and lists of one scope; `python` is the generated class that holds them."""

    name: str
    parameters: tuple[Parameter, ...] = ()
    lists: tuple[ParameterList, ...] = ()
    python: type[Any] | None = field(default=None, compare=False, repr=False)


class Parameters:
    """Base of the generated parameter classes. Invalid values raise ConfigurationError."""

    __slots__ = ()
    __spec__: ClassVar[ParameterSet]

    def __post_init__(self) -> None:
        spec = self.__spec__
        given = {p.name: getattr(self, p.name) for p in spec.parameters}
        _, complaints = check(ParameterSet(spec.name, spec.parameters), given)
        for each in spec.lists:
            complaints += each.count(len(getattr(self, each.name)), (each.name,))
        if complaints:
            raise ConfigurationError("\n".join(f"{c.path}: {c.message}" for c in complaints))


@dataclass(frozen=True)
class Complaint:
    """One error in a configuration: its key, its message and its code.

    Errors that cannot occur in a file have no code.
    """

    key: Key
    message: str
    code: str = ""

    @property
    def path(self) -> str:
        """`motors[0].max_speed`."""
        return dotted(self.key)


def dotted(key: Iterable[str | int]) -> str:
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def check(spec: ParameterSet, given: Mapping[str, Any]) -> tuple[dict[str, Any], list[Complaint]]:
    """The value of every parameter, by name, and what is wrong with those given.

    Values of lists are lists of such dicts. A wrong value is replaced by its default, so that all
    errors are found at once.
    """
    values: dict[str, Any] = {}
    complaints: list[Complaint] = []
    _fill(spec, given, (), values, complaints)
    return values, complaints


def build(spec: ParameterSet, values: Mapping[str, Any]) -> Any:
    """The generated class filled with checked values; lists become tuples."""
    if spec.python is None:
        raise TypeError(f"parameters {spec.name!r} have no Python class")
    lists = {each.name: tuple(build(each.items, item) for item in values[each.name]) for each in spec.lists}
    return spec.python(**{p.name: values[p.name] for p in spec.parameters}, **lists)


def flat(spec: ParameterSet, values: Mapping[str, Any], at: Key = ()) -> Iterator[tuple[Key, Parameter, Any]]:
    """Every parameter of checked values, including those of items: key, parameter and value."""
    for parameter in spec.parameters:
        yield (*at, parameter.name), parameter, values[parameter.name]
    for each in spec.lists:
        for number, item in enumerate(values[each.name]):
            yield from flat(each.items, item, (*at, each.name, number))


def change(
    spec: ParameterSet, values: Mapping[str, Any], texts: Mapping[str, str]
) -> tuple[dict[str, Any], list[str], list[Complaint]]:
    """The values after a change of dynamic parameters, which are given as texts by key (`motors[0].max_speed`).

    Also returns the keys whose values changed, and the errors; if there are any, the values must not be used.
    The texts may include parameters that are not dynamic if their values stay the same.
    """
    new = _copied(values)
    known = {dotted(key): (key, parameter, value) for key, parameter, value in flat(spec, values)}
    changed: list[str] = []
    complaints: list[Complaint] = []
    for name, text in texts.items():
        if name not in known:
            complaints.append(Complaint((name,), unknown("parameter", name, known), "config-unknown-key"))
            continue
        key, parameter, before = known[name]
        value, wrong = _value(parameter, parameter.read(text), key)
        if wrong:
            complaints.append(wrong)
        elif value != before and not parameter.dynamic:
            message = f"`{name}` is not dynamic: it keeps its value while the component runs"
            complaints.append(Complaint(key, message))
        elif value != before:
            changed.append(name)
            scope: Any = new
            for part in key[:-1]:
                scope = scope[part]
            scope[key[-1]] = value
    return new, changed, complaints


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: list(map(_copied, each)) if isinstance(each, list) else each for name, each in values.items()}


def _fill(
    spec: ParameterSet,
    given: Mapping[str, Any],
    at: Key,
    values: dict[str, Any],
    complaints: list[Complaint],
) -> None:
    known = {p.name: p for p in spec.parameters}
    lists = {each.name: each for each in spec.lists}
    for name in given:
        if name not in known and name not in lists:
            message = unknown("parameter", name, [*known, *lists])
            complaints.append(Complaint((*at, name), message, "config-unknown-key"))
    for parameter in spec.parameters:
        key = (*at, parameter.name)
        values[parameter.name] = parameter.default
        if parameter.name in given:
            value, wrong = _value(parameter, given[parameter.name], key)
            values[parameter.name] = parameter.default if wrong else value
            complaints += [wrong] if wrong else []
        elif parameter.mandatory:
            what = _described(parameter.name, parameter.description)
            message = f"{what} is mandatory: give it ({parameter.allowed()})"
            complaints.append(Complaint(key, message, "config-missing"))
    for each in spec.lists:
        values[each.name] = list(_items(each, given.get(each.name, []), (*at, each.name), complaints))


def _items(spec: ParameterList, given: Any, at: Key, complaints: list[Complaint]) -> Iterator[dict[str, Any]]:
    if not isinstance(given, list) or not all(isinstance(item, Mapping) for item in given):
        where = dotted(("params", *(part for part in at if isinstance(part, str))))
        what = _described(spec.name, spec.description)
        message = f"{what} is a list: write its items as tables, each under [[{where}]]"
        complaints.append(Complaint(at, message, "config-wrong-type"))
        return
    complaints += spec.count(len(given), at)
    for number, item in enumerate(given):
        values: dict[str, Any] = {}
        _fill(spec.items, item, (*at, number), values, complaints)
        yield values


def _value(parameter: Parameter, given: Any, key: Key) -> tuple[Any, Complaint | None]:
    """The value as its Python type, or what is wrong with it."""
    message = f"{_described(parameter.name, parameter.description)} is {given!r}; allowed: {parameter.allowed()}"
    if not _is_a(parameter.kind, given):
        return given, Complaint(key, message, "config-wrong-type")
    if parameter.choices and given not in parameter.choices:
        near = closest(given, parameter.choices)
        return given, Complaint(key, f"{message}; did you mean `{near}`?" if near else message, "config-unknown-value")
    if not parameter.admits(given):
        return given, Complaint(key, message, "config-out-of-range")
    return float(given) if parameter.kind in _FLOATS else given, None


def _described(name: str, description: str) -> str:
    """A name in a sentence, with what it is: `max_speed` (m/s)."""
    return f"`{name}` ({' '.join(description.split())})" if description else f"`{name}`"


_FLOATS = (ParameterKind.FLOAT, ParameterKind.DOUBLE)


def _is_a(kind: ParameterKind, value: Any) -> bool:
    if kind is ParameterKind.BOOL or isinstance(value, bool):
        return kind is ParameterKind.BOOL and isinstance(value, bool)
    if kind in _FLOATS:
        return isinstance(value, float) or (isinstance(value, int) and abs(value) <= sys.float_info.max)
    return isinstance(value, int if kind is ParameterKind.INT else str)
