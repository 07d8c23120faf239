"""The same messages through two other implementations of XCDR1: pycdr2 (Cyclone DDS's) and rosbags (ROS 2's).

Both are given types made like ours; rosbags also has those that ROS 2 itself defines (`by_ros2`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import make_dataclass
from functools import cache
from typing import Any

import numpy as np
import pycdr2
from pycdr2 import types as idl
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robocomp_py.contract.types import (
    BOOL,
    STRING,
    TIME,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
)


def by_pycdr2(message: Struct, values: tuple[Any, ...]) -> bytes:
    """The payload as Cyclone DDS's Python implementation writes it."""
    kind, convert = _Pycdr2().struct(message.fields)
    payload: bytes = convert(values).serialize(endianness=pycdr2.Endianness.Little)
    assert isinstance(kind, type)
    return payload


def by_rosbags(message: Struct, values: tuple[Any, ...]) -> bytes:
    """The payload as the rosbag reader and writer of Python writes it."""
    ros = _Rosbags()
    name, convert = ros.struct(message.fields)
    return bytes(ros.store.serialize_cdr(convert(values), name))


def by_ros2(message: Struct, values: tuple[Any, ...]) -> bytes:
    """The payload of ROS 2's own message of that name. Structs are tuples; one for an array of a fixed length, too."""
    name = message.name.replace("::", "/msg/")
    return bytes(_ros2().serialize_cdr(_of_ros2(name, values), name))


@cache
def _ros2() -> Any:
    """A store takes a while to make, so tests that do not use it do not wait for it."""
    return get_typestore(Stores.ROS2_HUMBLE)


def _of_ros2(name: str, value: Any) -> Any:
    parts = divmod(value, 10**9) if name == "builtin_interfaces/msg/Time" else value
    _, fields = _ros2().fielddefs[name]
    return _ros2().types[name](*(_part_of_ros2(*kind, part) for (_, kind), part in zip(fields, parts, strict=True)))


def _part_of_ros2(node: Nodetype, detail: Any, value: Any) -> Any:
    match node:
        case Nodetype.NAME:
            return _of_ros2(detail, value)
        case Nodetype.ARRAY:
            ((_, (kind, _)), length) = detail
            assert len(value) == length
            return np.array(value, kind)
        case Nodetype.SEQUENCE if detail[0][0] is Nodetype.NAME:
            return [_of_ros2(detail[0][1], each) for each in value]
        case _:
            return value


Convert = Callable[[Any], Any]


def _parts(fields: tuple[Field, ...], value: Any) -> list[Any]:
    return list(value) if isinstance(value, tuple) else [getattr(value, f.attribute) for f in fields]


_TIME = (Field("seconds", Primitive.INT32), Field("nanoseconds", Primitive.UINT32))
_NOTHING = (Field("structure_needs_at_least_one_member", Primitive.UINT8),)


def _entry(kind: Dictionary) -> tuple[Field, ...]:
    return Field("key", kind.key), Field("value", kind.value)


class _Pycdr2:
    """Each method gives the other library's type, and a function that makes its values of ours."""

    def __init__(self) -> None:
        self._count = 0

    def struct(self, fields: tuple[Field, ...]) -> tuple[Any, Convert]:
        if not fields:
            kind, _ = self.struct(_NOTHING)
            return kind, lambda value: kind(0)
        self._count += 1
        inside = [self.any(field.type) for field in fields]
        members = [(f"f{number}", kind) for number, (kind, _) in enumerate(inside)]
        made = make_dataclass(f"S{self._count}", members, bases=(pycdr2.IdlStruct,))
        converts = [convert for _, convert in inside]
        return made, lambda value: made(*(c(v) for c, v in zip(converts, _parts(fields, value), strict=True)))

    def any(self, kind: Type) -> tuple[Any, Convert]:
        match kind:
            case Primitive.TIME:
                return self._time()
            case Primitive():
                return {BOOL: bool, STRING: str}.get(kind) or getattr(idl, kind.value), lambda value: value
            case Enumeration():
                return idl.int32, int
            case Struct(fields=fields):
                return self.struct(fields)
            case Sequence(item):
                inner, convert = self.any(item)
                if kind.dtype is not None:
                    return idl.sequence[inner], np.ndarray.tolist
                return idl.sequence[inner], lambda value: [convert(each) for each in value]
            case Dictionary():
                entry, convert_entry = self.struct(_entry(kind))
                return idl.sequence[entry], lambda value: [convert_entry(each) for each in value.items()]

    def _time(self) -> tuple[Any, Convert]:
        made, convert = self.struct(_TIME)
        return made, lambda value: convert(divmod(value, 10**9))


class _Rosbags:
    """The same; a type is a word in the language of .msg files, in which sequences hold no sequences."""

    def __init__(self) -> None:
        self.store = get_typestore(Stores.EMPTY)
        self._count = 0

    def struct(self, fields: tuple[Field, ...]) -> tuple[str, Convert]:
        inside = [self.any(field.type) for field in fields]
        text = "".join(f"{kind} f{number}\n" for number, (kind, _) in enumerate(inside))
        self._count += 1
        name = f"any/msg/S{self._count}"
        self.store.register(get_types_from_msg(text, name))
        made = self.store.types[name]
        if not fields:
            return name, lambda value: made(0)
        converts = [convert for _, convert in inside]
        return name, lambda value: made(*(c(v) for c, v in zip(converts, _parts(fields, value), strict=True)))

    def any(self, kind: Type) -> tuple[str, Convert]:
        match kind:
            case Primitive.TIME:
                name, convert_time = self.struct(_TIME)
                return name, lambda value: convert_time(divmod(value, 10**9))
            case Primitive():
                return kind.value, lambda value: value
            case Enumeration():
                return "int32", int
            case Struct(fields=fields):
                return self.struct(fields)
            case Sequence(item):
                inner, convert = self.any(item)
                if inner.endswith("[]"):
                    inner, convert = self.struct((Field("items", item),))
                    return f"{inner}[]", lambda value: [convert((each,)) for each in value]
                if item is STRING or isinstance(item, Struct | Dictionary) or item is TIME:
                    return f"{inner}[]", lambda value: [convert(each) for each in value]
                dtype = kind.dtype or np.dtype("<i4")
                return f"{inner}[]", lambda value: np.asarray(value, dtype)
            case Dictionary():
                entry, convert_entry = self.struct(_entry(kind))
                return f"{entry}[]", lambda value: [convert_entry(each) for each in value.items()]
