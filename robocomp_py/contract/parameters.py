"""What a component can be configured with, and whether a given configuration is right.

A `ParameterSet` comes from a PDSL file and is carried by generated code as a literal. `check`
turns the values of a configuration file into the generated, read-only classes, or says what is
wrong with each; it knows keys, not files, so that whoever read the file can add the line.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

from ..errors import ConfigurationError
from ..spelling import unknown

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
    """One value. `mandatory` ones must be given; the others have a default."""

    name: str
    kind: ParameterKind
    default: Any
    minimum: float | int | None = None
    maximum: float | int | None = None
    choices: tuple[str, ...] = ()
    mandatory: bool = False
    description: str = field(default="", compare=False)

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


@dataclass(frozen=True)
class ParameterList:
    """A table that repeats: `[[motors]]`."""

    name: str
    items: ParameterSet
    minimum: int = 0
    maximum: int | None = None
    description: str = field(default="", compare=False)

    def count(self, number: int, at: Key) -> list[Complaint]:
        """What is wrong with that many items."""
        if number >= self.minimum and (self.maximum is None or number <= self.maximum):
            return []
        upper = "any number" if self.maximum is None else self.maximum
        return [Complaint(at, f"{number} items of `{self.name}`; allowed: {self.minimum} to {upper}")]


@dataclass(frozen=True)
class ParameterSet:
    """Parameters and lists of one scope; `python` is the generated class that holds them."""

    name: str
    parameters: tuple[Parameter, ...] = ()
    lists: tuple[ParameterList, ...] = ()
    python: type[Any] | None = field(default=None, compare=False, repr=False)


class Parameters:
    """Base of the generated parameter classes. Making one with values not allowed raises ConfigurationError."""

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
    """One thing wrong with a configuration: at which key, and in words."""

    key: Key
    message: str

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

    Values of lists are lists of such dicts. What is wrong has its default, so that all
    complaints come at once.
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
            complaints.append(Complaint((*at, name), unknown("parameter", name, [*known, *lists])))
    for parameter in spec.parameters:
        key = (*at, parameter.name)
        values[parameter.name] = parameter.default
        if parameter.name in given:
            values[parameter.name], wrong = _value(parameter, given[parameter.name])
            complaints.extend(Complaint(key, text) for text in wrong)
        elif parameter.mandatory:
            complaints.append(Complaint(key, f"`{parameter.name}` is mandatory: give it ({parameter.allowed()})"))
    for each in spec.lists:
        values[each.name] = list(_items(each, given.get(each.name, []), (*at, each.name), complaints))


def _items(spec: ParameterList, given: Any, at: Key, complaints: list[Complaint]) -> Iterator[dict[str, Any]]:
    if not isinstance(given, list) or not all(isinstance(item, Mapping) for item in given):
        complaints.append(
            Complaint(
                at, f"`{spec.name}` is a list: write its items as tables, each under [[{dotted(('params', *at))}]]"
            )
        )
        return
    complaints += spec.count(len(given), at)
    for number, item in enumerate(given):
        values: dict[str, Any] = {}
        _fill(spec.items, item, (*at, number), values, complaints)
        yield values


def _value(parameter: Parameter, given: Any) -> tuple[Any, list[str]]:
    """The value as its Python type, and what is wrong with it."""
    if not _is_a(parameter.kind, given):
        return parameter.default, [f"`{parameter.name}` is {given!r}; allowed: {parameter.allowed()}"]
    if parameter.choices and given not in parameter.choices:
        return parameter.default, [f"`{parameter.name}`: {unknown('value', given, parameter.choices)}"]
    if not parameter.admits(given):
        return parameter.default, [f"`{parameter.name}` is {given!r}; allowed: {parameter.allowed()}"]
    return float(given) if parameter.kind in _FLOATS else given, []


_FLOATS = (ParameterKind.FLOAT, ParameterKind.DOUBLE)


def _is_a(kind: ParameterKind, value: Any) -> bool:
    if kind is ParameterKind.BOOL or isinstance(value, bool):
        return kind is ParameterKind.BOOL and isinstance(value, bool)
    if kind in _FLOATS:
        return isinstance(value, float) or (isinstance(value, int) and abs(value) <= sys.float_info.max)
    return isinstance(value, int if kind is ParameterKind.INT else str)
