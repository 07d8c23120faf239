"""Dataclasses as JSON and back, field by field, so that a new field needs no code of its own.

dataclass      object of its fields; one that is missing has its default
mapping        object; a key that is a tuple is joined by `/`
tuple          array · enumeration: its value · path: text
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")


def to_json(value: Any) -> Any:
    match value:
        case Enum():
            return value.value
        case None | bool() | int() | float() | str():
            return value
        case PurePath():
            return str(value)
        case Mapping():
            return {"/".join(key) if isinstance(key, tuple) else key: to_json(each) for key, each in value.items()}
        case list() | tuple():
            return [to_json(each) for each in value]
        case _ if is_dataclass(value):
            return {each.name: to_json(getattr(value, each.name)) for each in fields(value)}
    raise TypeError(f"{type(value).__name__} has no JSON")


def from_json(kind: type[T], told: Any) -> T:
    """A dataclass of fields that this module knows. Raises ValueError, which names what does not fit."""
    made: T = _read(kind, told, kind.__name__)
    return made


def fields_from_json(kind: type[Any], told: Mapping[str, Any]) -> dict[str, Any]:
    """The values of some fields of a dataclass. Raises ValueError, which names what does not fit."""
    hints = get_type_hints(kind)
    return {name: _read(hints[name], value, f"{kind.__name__}.{name}") for name, value in told.items()}


def _read(kind: Any, told: Any, at: str) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is UnionType:
        (inner,) = (each for each in arguments if each is not NoneType)
        return None if told is None else _read(inner, told, at)
    if origin is tuple:
        return tuple(_read(arguments[0], each, at) for each in _fitting(list, told, at))
    if origin is Mapping:
        return {key: _read(arguments[1], each, f"{at}.{key}") for key, each in _fitting(dict, told, at).items()}
    if is_dataclass(kind):
        return _record(kind, _fitting(dict, told, at), at)
    if issubclass(kind, Enum | PurePath):
        return kind(_fitting(str, told, at))
    if kind is float and type(told) is int:
        return float(told)
    return _fitting(kind, told, at)


def _record(kind: Any, told: Mapping[str, Any], at: str) -> Any:
    hints = get_type_hints(kind)
    given = {}
    for each in fields(kind):
        if each.name in told:
            given[each.name] = _read(hints[each.name], told[each.name], f"{at}.{each.name}")
        elif each.default is MISSING and each.default_factory is MISSING:
            raise ValueError(f"{at} has no `{each.name}`")
    return kind(**given)


def _fitting(kind: Any, told: Any, at: str) -> Any:
    if type(told) is not kind:
        raise ValueError(f"{at} is {told!r:.80}")
    return told
