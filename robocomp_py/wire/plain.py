"""Messages as plain trees of lists, dicts and scalars: what `messagepack` packs and `identity` hands over.

    struct → list of its fields · sequence → list, or one leaf made by the codec if it is an array
    dictionary → dict · enumerator → int · everything else → itself

Both directions validate, so that a tree is right whoever made it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_MAX,
    FLOATS,
    INTEGERS,
    STRING,
    TIME,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    integer_range,
)
from .codec import TIME_MAX, TIME_MIN, Program, structs_in

Frames = list[Any]
"""Buffers beside the tree, for arrays too large to be copied into it."""

PackArray = Callable[[Any, "np.dtype[Any]", Frames], Any]
ReadArray = Callable[[Any, "np.dtype[Any]", Frames], "np.ndarray[Any, Any]"]


def compile_planter(message: Struct, array: PackArray) -> Callable[[tuple[Any, ...], Frames], list[Any]]:
    """A function from a message's fields to a tree. What it raises is for `explain` to explain."""
    return _Planter(array).compile(message)


def compile_reader(message: Struct, array: ReadArray, *, prefix: bool) -> Callable[[Any, Frames], tuple[Any, ...]]:
    """A function from a tree, which may hold anything, to a message's fields."""
    return _Reader(array).compile(message, prefix)


class _Planter:
    def __init__(self, array: PackArray) -> None:
        self._program = Program()
        self._array = self._program.name(array, "array")
        self._structs: dict[str, str] = {}

    def compile(self, message: Struct) -> Callable[[tuple[Any, ...], Frames], list[Any]]:
        for struct in structs_in(message):
            self._define(struct)
        names = [self._program.fresh() for _ in message.fields]
        self._function("plant(values, frames)", f"[{', '.join(names)}] = values", message.fields, names)
        return self._program.compile("plant")

    def _define(self, struct: Struct) -> None:
        function = self._structs[struct.name] = self._program.fresh("plant_")
        names = [self._program.fresh() for _ in struct.fields]
        getters = "; ".join(f"{n} = value.{f.attribute}" for n, f in zip(names, struct.fields, strict=True))
        self._function(f"{function}(value, frames)", getters or "pass", struct.fields, names)

    def _function(self, signature: str, first: str, fields: tuple[Field, ...], names: list[str]) -> None:
        p = self._program
        p.line(f"def {signature}:")
        p.indent()
        p.line(first)
        p.line(f"return [{', '.join(self._plant(f.type, n) for f, n in zip(fields, names, strict=True))}]")
        p.dedent()

    def _plant(self, kind: Type, x: str) -> str:
        p = self._program
        match kind:
            case Struct(name=name):
                return f"{self._structs[name]}({x}, frames)"
            case Sequence(item) if kind.dtype is not None:
                return f"{self._array}({x}, {p.name(kind.dtype, 'dtype')}, frames)"
            case Sequence(item):
                each = p.fresh()
                items = f"({x} if type({x}) is list else {p.name(as_list)}({x}))"
                return f"[{self._plant(item, each)} for {each} in {items}]"
            case Dictionary(key, item):
                k, v = p.fresh(), p.fresh()
                return f"{{{self._plant(key, k)}: {self._plant(item, v)} for {k}, {v} in {x}.items()}}"
            case Enumeration(members=members):
                return f"{p.name({number: number for _, number in members}, 'enum')}[{x}]"
            case Primitive():
                return self._scalar(kind, x)

    def _scalar(self, kind: Primitive, x: str) -> str:
        p = self._program
        if kind is BOOL:
            return f"({x} if {x} is True or {x} is False else {p.name(as_bool)}({x}))"
        if kind is STRING:
            return f"({x} if type({x}) is str and {x}.isascii() else {p.name(as_str)}({x}))"
        if kind is FLOAT32:
            within = f"{-FLOAT32_MAX!r} <= {x} <= {FLOAT32_MAX!r}"
            return f"({x} if type({x}) is float and {within} else {p.name(as_float32)}({x}))"
        if kind in FLOATS:
            return f"({x} if type({x}) is float else {p.name(as_float)}({x}))"
        low, high = _range(kind)
        return f"({x} if type({x}) is int and {low} <= {x} <= {high} else {p.name(as_int)}({x}, {low}, {high}))"


class _Reader:
    def __init__(self, array: ReadArray) -> None:
        self._program = Program()
        self._array = self._program.name(array, "array")
        self._structs: dict[str, str] = {}

    def compile(self, message: Struct, prefix: bool) -> Callable[[Any, Frames], tuple[Any, ...]]:
        for struct in structs_in(message):
            self._define(struct)
        source = f"tree[:{len(message.fields)}]" if prefix else "tree"
        self._function("read(tree, frames)", source, message)
        return self._program.compile("read")

    def _define(self, struct: Struct) -> None:
        function = self._structs[struct.name] = self._program.fresh("read_")
        self._function(f"{function}(tree, frames)", "tree", struct)

    def _function(self, signature: str, source: str, struct: Struct) -> None:
        p = self._program
        names = [p.fresh() for _ in struct.fields]
        values = "".join(f"{self._read(f.type, n)}, " for f, n in zip(struct.fields, names, strict=True))
        p.line(f"def {signature}:")
        p.indent()
        p.line(f"if type(tree) is not list: {p.name(_wrong)}('a list', tree)")
        p.line(f"[{', '.join(names)}] = {source}")
        p.line(f"return {p.name(struct.python)}({values})" if struct.python else f"return ({values})")
        p.dedent()

    def _read(self, kind: Type, x: str) -> str:
        p = self._program
        wrong = p.name(_wrong)
        match kind:
            case Struct(name=name):
                return f"{self._structs[name]}({x}, frames)"
            case Sequence(item) if kind.dtype is not None:
                return f"{self._array}({x}, {p.name(kind.dtype, 'dtype')}, frames)"
            case Sequence(item):
                each = p.fresh()
                return (
                    f"[{self._read(item, each)} for {each} in ({x} if type({x}) is list else {wrong}('a list', {x}))]"
                )
            case Dictionary(key, item):
                k, v = p.fresh(), p.fresh()
                items = f"({x} if type({x}) is dict else {wrong}('a map', {x})).items()"
                return f"{{{self._read(key, k)}: {self._read(item, v)} for {k}, {v} in {items}}}"
            case Enumeration(members=members, python=python):
                table = {number: python(number) if python else number for _, number in members}
                return f"{p.name(table, 'enum')}[{x}]"
            case Primitive():
                return self._scalar(kind, x)

    def _scalar(self, kind: Primitive, x: str) -> str:
        p = self._program
        wrong = p.name(_wrong)
        if kind is BOOL:
            return f"({x} if {x} is True or {x} is False else {wrong}('a bool', {x}))"
        if kind is STRING:
            return f"({x} if type({x}) is str else {wrong}('a string', {x}))"
        if kind in FLOATS:
            return f"({x} if type({x}) is float else {p.name(_number)}({x}))"
        low, high = _range(kind)
        return f"({x} if type({x}) is int and {low} <= {x} <= {high} else {wrong}('{kind}', {x}))"


def _range(kind: Primitive) -> tuple[int, int]:
    if kind is TIME:
        return TIME_MIN, TIME_MAX
    assert kind in INTEGERS
    return integer_range(kind)


# What compiled code calls when a value is not of the plainest type: numpy scalars, subclasses, mistakes.


def as_list(value: Any) -> list[Any]:
    if isinstance(value, str | bytes | Mapping):
        raise TypeError(f"{type(value).__name__} is not a list")
    return list(value)


def as_bool(value: Any) -> bool:
    if isinstance(value, np.bool_):
        return bool(value)
    raise TypeError(f"{value!r} is not a bool")


def as_str(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is not a str")
    value.encode()
    return str(value)


def as_int(value: Any, low: int, high: int) -> int:
    if not isinstance(value, int | np.integer):
        raise TypeError(f"{value!r} is not an int")
    if not low <= int(value) <= high:
        raise OverflowError(f"{value} is not from {low} to {high}")
    return int(value)


def as_float(value: Any) -> float:
    if not isinstance(value, int | float | np.number | np.bool_):
        raise TypeError(f"{value!r} is not a float")
    return float(value)


def as_float32(value: Any) -> float:
    number = as_float(value)
    if FLOAT32_MAX < abs(number) < float("inf"):
        raise OverflowError(f"{number} exceeds float32")
    return number


def _number(value: Any) -> float:
    return float(value if type(value) is int else _wrong("a number", value))


def _wrong(expected: str, value: Any) -> Any:
    raise ValueError(f"expected {expected}, found {type(value).__name__}")
