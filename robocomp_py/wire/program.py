"""Generates Python source, from which codecs compile their functions once per message type.

A type whose code cannot be inlined gets its own function (`function_for`), which is written later
(`write_functions`). Loops never nest within one function, because Python allows only 20 levels.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from itertools import repeat
from typing import Any

from ..contract.types import MAX_DEPTH, STRING, Dictionary, Enumeration, Primitive, Sequence, Struct, Type, children
from ..errors import CodecError
from .rows import FEW
from .values import as_member, as_tuple


class Program:
    """Lines of source, and the objects they refer to."""

    def __init__(self, message: Struct) -> None:
        if _height(message, {}) > MAX_DEPTH:
            raise CodecError(f"{message.name}: types nest deeper than {MAX_DEPTH} levels")
        self._lines: list[str] = []
        self._names: dict[str, Any] = {}
        self._known: dict[int, str] = {}
        self._functions: dict[int, str] = {}
        self._unwritten: list[Type] = []
        self._depth = 0
        self._count = 0

    def line(self, text: str) -> None:
        self._lines.append("    " * self._depth + text)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Indent the lines written in it below `head`, a `def`, `for` or `if`."""
        self.line(f"{head}:")
        self._depth += 1
        yield
        self._depth -= 1

    @contextmanager
    def guarded(self, error: str) -> Iterator[None]:
        """Any exception in the lines written in it is raised as `error`, made from `exc`."""
        with self.block("try"):
            yield
        with self.block("except Exception as exc"):
            self.line(f"raise {error} from exc")

    def fresh(self, stem: str = "v") -> str:
        """A variable name not used before."""
        self._count += 1
        return f"{stem}{self._count}"

    def name(self, thing: Any, stem: str = "g") -> str:
        """The global name of this object in the program."""
        key = id(thing)
        if key not in self._known:
            self._known[key] = self.fresh(f"_{stem}")
            self._names[self._known[key]] = thing
        return self._known[key]

    def take_apart(self, kind: Struct, value: str) -> list[str]:
        """Write an assignment of a value's fields to variables; return their names."""
        names = [self.fresh() for _ in kind.fields]
        if kind.python is None:
            self.line(f"[{', '.join(names)}] = {self.name(as_tuple)}({value}, {len(names)})")
        else:
            for name, field in zip(names, kind.fields, strict=True):
                self.line(f"{name} = {value}.{field.attribute}")
        return names

    def member(self, kind: Enumeration, value: str) -> str:
        """An expression for the number of the enumerator in a variable."""
        table = self.name({number: number for _, number in kind.members}, "enum")
        plain = f"type({value}) is {self.name(kind.python or int)}"
        return f"{table}[{value}] if {plain} else {self.name(as_member)}({value}, {table})"

    def enumerator(self, kind: Enumeration, number: str) -> str:
        """An expression for the enumerator of a number."""
        table = {value: kind.python(value) if kind.python else value for _, value in kind.members}
        return f"{self.name(table, 'enum')}[{number}]"

    def made(self, kind: Struct, values: str) -> str:
        """An expression for a struct of these values, with a comma behind each."""
        return f"{self.name(kind.python)}({values})" if kind.python else f"({values})"

    def make_each(self, kind: Struct, result: str, names: list[str], values: list[str], few: str, many: str) -> None:
        """Write what makes a list of `count` structs: of rows, in which these names are numbers and of which the values
        of the fields are made. `few` is what gives the rows, `many` their columns; `n` is then behind them.
        """
        made = self.made(kind, ", ".join([*values, ""]))
        by_rows = f"s, n = {few}; {result} = [{made} for [{', '.join(names)}] in s]"
        if not (names and is_record(kind)):
            self.line(by_rows)
            return
        with self.block(f"if count <= {FEW}"):
            self.line(by_rows)
        with self.block("else"):  # all objects are made before any is filled: that takes half the time
            each = self.fresh()
            pairs = [(f"{each}.{field.attribute}", value) for field, value in zip(kind.fields, values, strict=True)]
            plain = {value: target for target, value in pairs if value in names}
            self.line(f"s, n = {many}; {result} = {self.name(_blanks)}({self.name(kind.python)}, count)")
            with self.block(f"for {each}, {', '.join(plain.get(name, name) for name in names)} in zip({result}, *s)"):
                self.line("; ".join(f"{target} = {value}" for target, value in pairs if value not in plain) or "pass")

    def function_for(self, kind: Type) -> str:
        """The name of the function that treats values of this type."""
        key = id(kind)  # types live as long as their message does
        if key not in self._functions:
            self._functions[key] = self.fresh("f")
            self._unwritten.append(kind)
        return self._functions[key]

    def write_functions(self, write: Callable[[str, Type], None]) -> None:
        """Write every function that is used, by name; writing one may need others."""
        while self._unwritten:
            kind = self._unwritten.pop()
            write(self.function_for(kind), kind)

    def compile(self, function: str) -> Callable[..., Any]:
        source = "\n".join(self._lines)
        scope: dict[str, Any] = dict(self._names)
        # the text comes from contracts, which contain only identifiers
        exec(compile(source, f"<robocomp_py codec: {function}>", "exec"), scope)
        compiled: Callable[..., Any] = scope[function]
        return compiled


def is_loop(kind: Type) -> bool:
    """Whether values of this type need a loop in Python."""
    return isinstance(kind, Dictionary) or (isinstance(kind, Sequence) and kind.dtype is None)


def is_fixed(kind: Type) -> bool:
    """Whether all values of a type have the same size, and its parts names in Python."""
    match kind:
        case Primitive():
            return kind is not STRING
        case Enumeration():
            return True
        case Struct(fields=fields):
            return kind.python is not None and all(is_fixed(field.type) for field in fields)
        case Sequence() | Dictionary():
            return False


@dataclass(frozen=True)
class Leaf:
    """A part of fixed size without parts of its own, and its path in the value."""

    path: str
    kind: Type


def leaves_of(kind: Type) -> list[Leaf] | None:
    """The leaves of a type, in order, empty structs included; None if they vary between values."""
    return list(_leaves_under(kind, "")) if is_fixed(kind) else None


def _leaves_under(kind: Type, path: str) -> Iterator[Leaf]:
    if isinstance(kind, Struct) and kind.fields:
        for field in kind.fields:
            yield from _leaves_under(field.type, f"{path}.{field.attribute}")
    else:
        yield Leaf(path, kind)


def is_record(kind: Struct) -> bool:
    """Whether a struct's class comes from a generated module, so that its objects hold only their fields.

    Many such objects are made faster without their constructor.
    """
    made = kind.python
    return (
        isinstance(made, type)
        and bool(kind.fields)
        and "__contract__" in vars(made)
        and is_dataclass(made)
        and not hasattr(made, "__post_init__")
        and tuple(getattr(made, "__slots__", ())) == tuple(field.attribute for field in kind.fields)
        and made.__new__ is object.__new__
        and made.__setattr__ is object.__setattr__
    )


def _blanks(made: type[Any], count: int) -> list[Any]:
    pause = _COLLECTS_OFTEN and count > _YOUNG and gc.isenabled()
    try:
        if pause:
            gc.disable()
        return list(map(object.__new__, repeat(made, count)))
    finally:
        if pause:
            gc.enable()


_COLLECTS_OFTEN = sys.version_info < (3, 12)
"""Whether the garbage collector also runs repeatedly while objects are only created."""

_YOUNG = 700
"""New objects after which it runs by default."""


def _height(kind: Type, known: dict[int, int]) -> int:
    """How deep a type is nested; `known` holds the types that are already measured, by identity."""
    if id(kind) not in known:
        inside = children(kind)
        known[id(kind)] = 1 + max((_height(each, known) for each in inside), default=0) if inside else 0
    return known[id(kind)]
