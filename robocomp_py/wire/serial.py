"""The common part of the codecs for formats of consecutive fields without tags: CDR's and Ice's.

A value of fixed size is a run of primitives, the leaves of its type. All leaves between two parts of varying size are
packed or read by one `struct` call.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from ..contract.types import TIME, Enumeration, Field, Primitive, Struct, Type
from .items import MAX_ITEMS, Left, check_items, counter, take_items
from .program import Leaf, Program, is_loop
from .values import as_bool

NUMBERS = frozenset(kind for kind in Primitive if kind.letter and kind.python in (int, float)) - {TIME}
"""Types for which the checks of `struct` are enough."""


class Writing(ABC):
    """Writes functions `(value, n, add) -> n`: in them, `n` counts the bytes so far and `add` appends some."""

    def __init__(self, message: Struct) -> None:
        self._message = message
        self._program = Program(message)
        self._letters = ""
        self._values: list[str] = []

    @abstractmethod
    def _value(self, kind: Type, x: str) -> None:
        """Emit code that packs the value `x`, or add it to the run."""

    @abstractmethod
    def _end_run(self) -> None:
        """Emit code that packs the run."""

    @abstractmethod
    def _time(self, x: str) -> tuple[str, ...]:
        """What is packed for the time `x`, a variable."""

    def _write(self, function: str, kind: Type) -> None:
        p = self._program
        with p.block(f"def {function}(value, n, add)"):
            if isinstance(kind, Struct):
                self._fields(kind.fields, p.take_apart(kind, "value"))
            else:
                self._value(kind, "value")
            self._end_run()
            p.line("return n")

    def _fields(self, fields: tuple[Field, ...], names: list[str]) -> None:
        if not fields:
            self._run("B", "0")
        for field, variable in zip(fields, names, strict=True):
            self._value(field.type, variable)

    def _check_items(self) -> None:
        """Emit code that refuses too many items. An item has at least one octet, so few messages are counted."""
        if counter(self._message):
            p = self._program
            with p.block(f"if n > {MAX_ITEMS}"):
                p.line(f"{p.name(check_items)}({p.name(self._message)}, values)")

    def _run(self, letters: str, *values: str) -> None:
        self._letters += letters
        self._values += values

    def _loop(self, head: str, *parts: tuple[Type, str]) -> None:
        with self._program.block(f"for {head}"):
            for kind, x in parts:
                if is_loop(kind):
                    self._call(kind, x)
                else:
                    self._value(kind, x)
            self._end_run()

    def _call(self, kind: Type, x: str) -> None:
        self._end_run()
        self._program.line(f"n = {self._program.function_for(kind)}({x}, n, add)")

    def _leaf(self, leaf: Leaf, x: str) -> tuple[str, ...]:
        """An expression for a leaf of the value `x`. `struct` checks and converts numbers."""
        p = self._program
        at = x + leaf.path
        match leaf.kind:
            case Struct():
                return ("0",)
            case Primitive() if leaf.kind in NUMBERS:
                return (at,)
        each = p.fresh()
        p.line(f"{each} = {at}")
        match leaf.kind:
            case Enumeration():
                return (p.member(leaf.kind, each),)
            case Primitive.BOOL:
                return (f"{each} if {each} is True or {each} is False else {p.name(as_bool)}({each})",)
            case Primitive.TIME:
                return self._time(each)
        raise AssertionError(f"no leaf: {leaf.kind}")


class Reading(ABC):
    """Writes functions `(data, n, left) -> value, n`: in them, `data` is the payload, `n` how much was read, and `left`
    how many more items there may be."""

    def __init__(self, message: Struct) -> None:
        self._message = message
        self._program = Program(message)
        self._letters = ""
        self._names: list[str] = []
        self._begun = False
        """Whether anything has been read. The first run is read from a fixed offset."""

    @abstractmethod
    def _letters_of(self, kind: Type) -> str | None:
        """How the leaves of a type are packed; None if its size varies."""

    @abstractmethod
    def _varying(self, kind: Type) -> str:
        """Emit code that reads a value of varying size; return an expression for it."""

    @abstractmethod
    def _primitive(self, kind: Primitive, take: Callable[[], str]) -> str:
        """An expression for a primitive other than a bool, from the variables of its leaf."""

    @abstractmethod
    def _end_run(self) -> None:
        """Emit code that reads the run."""

    @abstractmethod
    def _rows_of(self, letters: str, count: str) -> tuple[str, str]:
        """Expressions for the leaves of `count` items, few and many, and where they end; see `Program.make_each`."""

    def _write(self, function: str, kind: Type) -> None:
        p = self._program
        with p.block(f"def {function}(data, n, left)"):
            value = p.made(kind, self._fields(kind.fields)) if isinstance(kind, Struct) else self._value(kind)
            self._end_run()
            p.line(f"return {value}, n")

    def _begin(self) -> None:
        """Emit the limit of items, if the message can have any."""
        if counter(self._message):
            self._program.line(f"left = [{MAX_ITEMS}]")
        else:
            self._program.line("left = None")

    def _fields(self, fields: tuple[Field, ...]) -> str:
        if not fields:
            self._run("B")
        return "".join(f"{value}, " for value in [self._value(field.type) for field in fields])

    def _run(self, letters: str) -> list[str]:
        names = [self._program.fresh() for _ in letters]
        self._letters += letters
        self._names += names
        return names

    def _value(self, kind: Type) -> str:
        """Emit code that reads a value; return an expression for it, valid after the run."""
        letters = self._letters_of(kind)
        if letters is not None:
            return self._fixed(kind, iter(self._run(letters)).__next__)
        return self._call(kind) if isinstance(kind, Struct) else self._varying(kind)

    def _call(self, kind: Type) -> str:
        self._end_run()
        result = self._program.fresh()
        self._program.line(f"{result}, n = {self._program.function_for(kind)}(data, n, left)")
        return result

    def _repeat(self, count: str, kinds: tuple[Type, ...], store: str, result: str) -> None:
        """Emit a loop that reads `count` groups of these types and stores each group."""
        p = self._program
        letters = self._letters_of(kinds[0]) if len(kinds) == 1 else None
        if letters:
            self._rows(count, kinds[0], letters, result)
            return
        p.line(f"{p.name(check_count)}(data, n, {count}, left)")
        with p.block(f"for _ in range({count})"):
            values = [self._call(kind) if is_loop(kind) else self._value(kind) for kind in kinds]
            self._end_run()
            p.line(store.format(*values))

    def _rows(self, count: str, item: Type, letters: str, result: str) -> None:
        """Emit code that reads items of fixed size."""
        p = self._program
        names = [p.fresh() for _ in letters]
        take, (few, many) = iter(names).__next__, self._rows_of(letters, count)
        if isinstance(item, Struct) and item.fields:
            p.line(f"count = {count}")
            p.make_each(item, result, names, [self._fixed(field.type, take) for field in item.fields], few, many)
        else:
            p.line(f"s, n = {few}; {result} = [{self._fixed(item, take)} for [{', '.join(names)}] in s]")

    def _fixed(self, kind: Type, take: Callable[[], str]) -> str:
        """An expression for a value of fixed size from the variables of its leaves."""
        p = self._program
        match kind:
            case Enumeration():
                return p.enumerator(kind, take())
            case Struct(fields=()):
                take()
                return p.made(kind, "")
            case Struct(fields=fields):
                return p.made(kind, "".join(f"{self._fixed(field.type, take)}, " for field in fields))
            case Primitive.BOOL:
                return f"{p.name(_BOOLS)}[{take()}]"
            case Primitive():
                return self._primitive(kind, take)
        raise AssertionError("of no fixed size")


_BOOLS = (False, True)


# What compiled decoders call.


def check_count(data: Any, n: int, count: int, left: Left) -> None:
    if count > len(data) - n:  # every item has a byte at least: refuse before anything is allocated
        raise ValueError(f"{count} items in {len(data) - n} bytes")
    take_items(left, count)
