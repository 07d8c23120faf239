"""Messages as plain trees of lists, dicts and scalars: what `messagepack` packs and `identity` hands over.

    struct → list of its fields · sequence → list, or one leaf made by the codec if it is an array
    dictionary → dict · enumerator → int · everything else → itself
    records → one array, like numbers

Both directions validate, so a tree is always valid. A float32 is rounded when the tree is made:
all those of a struct by one `struct` call.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_LIMIT,
    FLOATS,
    STRING,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
)
from .flat import flat_records, records
from .program import Program, is_loop
from .values import RANGES, as_bool, as_dict, as_float, as_float32, as_int, as_list, as_member, as_str

if TYPE_CHECKING:
    import numpy as np

Frames = list[Any]
"""Buffers beside the tree, for arrays too large to be copied into it."""

PackArray = Callable[[Any, "np.dtype[Any]", Frames], Any]
ReadArray = Callable[[Any, "np.dtype[Any]", Frames], "np.ndarray[Any, Any]"]

NUMBERS = {bool, int, float}
"""The types of items in a list that can be read as an array."""


class Entries(list[Any]):
    """Keys and values in turn, in place of a dict in a tree."""

    def items(self) -> Iterator[tuple[Any, Any]]:
        return zip(self[::2], self[1::2], strict=True)


def compile_planter(message: Struct, array: PackArray) -> Callable[[tuple[Any, ...], Frames], list[Any]]:
    """A function from a message's fields to a tree. It may raise anything; `explain` finds the reason."""
    return _Planter(message, array).compile()


def compile_reader(message: Struct, array: ReadArray, *, prefix: bool) -> Callable[[Any, Frames], tuple[Any, ...]]:
    """A function from a tree, which may hold anything, to a message's fields."""
    return _Reader(message, array).compile(prefix)


def _is_flat(kind: Type) -> bool:
    """Whether a struct is cheap to write out wherever it is an item: it has a class, and only scalars."""
    return (
        isinstance(kind, Struct)
        and kind.python is not None
        and all(isinstance(f.type, Primitive | Enumeration) for f in kind.fields)
    )


class _Planter:
    def __init__(self, message: Struct, array: PackArray) -> None:
        self._message = message
        self._program = Program(message)
        self._array = self._program.name(array, "array")

    def compile(self) -> Callable[[tuple[Any, ...], Frames], list[Any]]:
        p = self._program
        names = [p.fresh() for _ in self._message.fields]
        with p.block("def plant(values, frames)"):
            p.line(f"[{', '.join(names)}] = values")
            self._return_row(self._message.fields, names)
        p.write_functions(self._write)
        return p.compile("plant")

    def _write(self, function: str, kind: Type) -> None:
        with self._program.block(f"def {function}(value, frames)"):
            if isinstance(kind, Struct):
                self._return_row(kind.fields, self._program.take_apart(kind, "value"))
            else:
                self._program.line(f"return {self._plant(kind, 'value')}")

    def _return_row(self, fields: tuple[Field, ...], names: list[str]) -> None:
        singles = [n for f, n in zip(fields, names, strict=True) if f.type is FLOAT32]
        if singles:
            self._program.line(f"[{', '.join(singles)}] = {self._rounded(singles)}")
        self._program.line(f"return {self._row(fields, names)}")

    def _rounded(self, singles: list[str]) -> str:
        layout = struct.Struct(f"<{len(singles)}f")
        unpack, pack = self._program.name(layout.unpack), self._program.name(layout.pack)
        return f"{unpack}({pack}({', '.join(singles)}))"

    def _row(self, fields: tuple[Field, ...], names: list[str]) -> str:
        """The list of a struct's fields. Those of type float32 are already rounded."""
        trees = (n if f.type is FLOAT32 else self._plant(f.type, n) for f, n in zip(fields, names, strict=True))
        return f"[{', '.join(trees)}]"

    def _plant(self, kind: Type, x: str) -> str:
        """An expression for the tree of the value `x`."""
        p = self._program
        match kind:
            case Struct():
                return f"{p.function_for(kind)}({x}, frames)"
            case Sequence(Struct() as item, records=True):
                taken = f"{p.name(records(item).taken)}({x})"
                return f"{self._array}({taken}, {p.name(kind.dtype, 'dtype')}, frames)"
            case Sequence(item) if kind.dtype is not None:
                return f"{self._array}({x}, {p.name(kind.dtype, 'dtype')}, frames)"
            case Sequence(item):
                flat = flat_records(item)
                taken = p.name(flat.listed if flat else as_list)
                return self._list(item, f"({x} if type({x}) is list else {taken}({x}))")
            case Dictionary(key, item):
                k, v = p.fresh(), p.fresh()
                items = f"({x} if type({x}) is dict else {p.name(as_dict)}({x})).items()"
                return f"{{{self._plant(key, k)}: {self._item(item, v)} for {k}, {v} in {items}}}"
            case Enumeration(members=members, python=python):
                table = p.name({number: number for _, number in members}, "enum")
                return f"({table}[{x}] if type({x}) is {p.name(python or int)} else {p.name(as_member)}({x}, {table}))"
            case Primitive():
                return self._scalar(kind, x)

    def _item(self, kind: Type, x: str) -> str:
        return f"{self._program.function_for(kind)}({x}, frames)" if is_loop(kind) else self._plant(kind, x)

    def _list(self, item: Type, items: str) -> str:
        each = self._program.fresh()
        if not isinstance(item, Struct) or not _is_flat(item):
            return f"[{self._item(item, each)} for {each} in {items}]"
        names = [self._program.fresh() for _ in item.fields]
        sources = {n: f"{each}.{f.attribute}" for n, f in zip(names, item.fields, strict=True)}
        singles = [n for n, f in zip(names, item.fields, strict=True) if f.type is FLOAT32]
        if singles and singles == names:
            return f"[{self._rounded(list(sources.values()))} for {each} in {items}]"
        lets = [(n, source) for n, source in sources.items() if n not in singles]
        if singles:
            lets.append((f"[{', '.join(singles)}]", self._rounded([sources[n] for n in singles])))
        # `for x in (y,)` in a comprehension is an assignment, and compiled as one
        assigned = "".join(f" for {n} in ({source},)" for n, source in lets)
        return f"[{self._row(item.fields, names)} for {each} in {items}{assigned}]"

    def _scalar(self, kind: Primitive, x: str) -> str:
        p = self._program
        if kind is BOOL:
            return f"({x} if {x} is True or {x} is False else {p.name(as_bool)}({x}))"
        if kind is STRING:
            return f"({x} if type({x}) is str and {x}.isascii() else {p.name(as_str)}({x}))"
        if kind is FLOAT32:
            return f"{p.name(as_float32)}({x})"
        if kind in FLOATS:
            return f"({x} if type({x}) is float else {p.name(as_float)}({x}))"
        low, high = RANGES[kind]
        return f"({x} if type({x}) is int and {low} <= {x} <= {high} else {p.name(as_int)}({x}, {low}, {high}))"


class Scalars:
    """Expressions that check what was unpacked, for the compiled readers of trees and of streams."""

    def __init__(self, program: Program) -> None:
        self._program = program

    def read(self, kind: Primitive | Enumeration, x: str) -> str:
        """An expression for the value in the variable `x`, checked against a type."""
        p = self._program
        wrong = p.name(_wrong)
        match kind:
            case Enumeration(members=members, python=python):
                table = {number: python(number) if python else number for _, number in members}
                return f"{p.name(table, 'enum')}[{x} if type({x}) is int else {wrong}('an enumerator', {x})]"
            case Primitive.BOOL:
                return f"({x} if {x} is True or {x} is False else {wrong}('a bool', {x}))"
            case Primitive() if kind is STRING:
                return f"({x} if type({x}) is str else {wrong}('a string', {x}))"
            case Primitive() if kind is FLOAT32:
                small = f"{-FLOAT32_LIMIT!r} < {x} < {FLOAT32_LIMIT!r}"
                return f"({x} if type({x}) is float and {small} else {p.name(_float32)}({x}))"
            case Primitive() if kind in FLOATS:
                return f"({x} if type({x}) is float else {p.name(_number)}({x}))"
            case Primitive():
                low, high = RANGES[kind]
                return f"({x} if type({x}) is int and {low} <= {x} <= {high} else {wrong}('{kind}', {x}))"


class _Reader:
    def __init__(self, message: Struct, array: ReadArray) -> None:
        self._message = message
        self._program = Program(message)
        self._array = self._program.name(array, "array")

    def compile(self, prefix: bool) -> Callable[[Any, Frames], tuple[Any, ...]]:
        self._write_struct("read", self._message, f"tree[:{len(self._message.fields)}]" if prefix else "tree")
        self._program.write_functions(self._write)
        return self._program.compile("read")

    def _write(self, function: str, kind: Type) -> None:
        if isinstance(kind, Struct):
            self._write_struct(function, kind, "tree")
            return
        with self._program.block(f"def {function}(tree, frames)"):
            self._program.line(f"return {self._read(kind, 'tree')}")

    def _write_struct(self, function: str, kind: Struct, source: str) -> None:
        p = self._program
        names = [p.fresh() for _ in kind.fields]
        with p.block(f"def {function}(tree, frames)"):
            p.line(f"if type(tree) is not list: {p.name(_wrong)}('a list', tree)")
            p.line(f"[{', '.join(names)}] = {source}")
            p.line(f"return {self._made(kind, names)}")

    def _made(self, kind: Struct, names: list[str]) -> str:
        values = "".join(f"{self._read(f.type, n)}, " for f, n in zip(kind.fields, names, strict=True))
        return f"{self._program.name(kind.python)}({values})" if kind.python else f"({values})"

    def _read(self, kind: Type, x: str) -> str:
        """An expression for the value of the tree `x`."""
        p = self._program
        match kind:
            case Struct():
                return f"{p.function_for(kind)}({x}, frames)"
            case Sequence(Struct() as item, records=True):
                array = f"{self._array}({x}, {p.name(kind.dtype, 'dtype')}, frames)"
                return f"{p.name(records(item).checked)}({array})"
            case Sequence(item) if kind.dtype is not None:
                return f"{self._array}({x}, {p.name(kind.dtype, 'dtype')}, frames)"
            case Sequence(item):
                return self._list(item, x)
            case Dictionary(key, item):
                k, v = p.fresh(), p.fresh()
                items = f"({x} if type({x}) is dict else {p.name(_entries)}({x})).items()"
                return f"{{{self._read(key, k)}: {self._item(item, v)} for {k}, {v} in {items}}}"
            case Primitive() | Enumeration():
                return Scalars(p).read(kind, x)

    def _item(self, kind: Type, x: str) -> str:
        return f"{self._program.function_for(kind)}({x}, frames)" if is_loop(kind) else self._read(kind, x)

    def _list(self, item: Type, x: str) -> str:
        p = self._program
        if not isinstance(item, Struct) or not _is_flat(item):
            each = p.fresh()
            items = f"({x} if type({x}) is list else {p.name(_wrong)}('a list', {x}))"
            return f"[{self._item(item, each)} for {each} in {items}]"
        names = [p.fresh() for _ in item.fields]
        return f"[{self._made(item, names)} for [{', '.join(names)}] in {p.name(_rows)}({x})]"


# What compiled readers call.


def _number(value: Any) -> float:
    return float(value if type(value) in (float, int) else _wrong("a number", value))


def _float32(value: Any) -> float:
    return as_float32(_number(value))


def _rows(tree: Any) -> list[Any]:
    """A list of lists (or of the tuples that `struct` makes), or an error."""
    if type(tree) is not list or not set(map(type, tree)) <= {list, tuple}:
        _wrong("a list of lists", tree)
    rows: list[Any] = tree
    return rows


def _entries(tree: Any) -> Entries:
    return tree if type(tree) is Entries else _wrong("a map", tree)


def _wrong(expected: str, value: Any) -> Any:
    raise ValueError(f"expected {expected}, found {type(value).__name__}")
