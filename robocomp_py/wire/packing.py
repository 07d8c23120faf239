"""MessagePack written and read by compiled code. Numbers have the width of their type, so their offsets are known.

    bool false, true · ints int 8 … uint 64 · float 32, float 64 · enumerator int 32 · time int 64
    string str · struct array of its fields · sequence array, or what `messagepack` makes of numbers
    dictionary map

So runs of numbers are packed by one `struct` call, and lists of structs of numbers by the column. This code
reads only what it writes itself. The library reads all other forms of MessagePack, and everything for
which a Python loop is slower, such as lists of texts.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import groupby, islice
from typing import TYPE_CHECKING, Any, NoReturn

import msgpack

from ..contract.types import (
    INT32,
    STRING,
    TIME,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    children,
)
from .codec import Decoder, Encoder, check_size, refused
from .flat import flat_records, records
from .items import MAX_ITEMS, check_items, counter, take_items
from .plain import Frames, compile_planter
from .program import Program, is_fixed, is_loop
from .rows import FEW, Columns, packed, unpacked
from .values import RANGES, as_bool, as_dict, as_int, as_list, as_str

if TYPE_CHECKING:
    import numpy as np

PackArray = Callable[[Any, Callable[[Any], object], Frames], None]
"""Packs an array (the first argument) by calling the second; separate buffers are appended to the third."""

ReadArray = Callable[[Any, int, Frames], "tuple[np.ndarray[Any, Any], int]"]
"""Reads the array at an offset of a message; returns it and where it ends."""

_TAGS = {
    "b": 0xD0, "B": 0xCC, "h": 0xD1, "H": 0xCD, "i": 0xD2, "I": 0xCE, "q": 0xD3, "Q": 0xCF, "f": 0xCA, "d": 0xCB,
}  # fmt: skip
_FORMS = {kind: (_TAGS[kind.letter], kind.letter) for kind in Primitive if kind.letter in _TAGS}
"""The first octet of each number, and how `struct` packs the rest."""

_INT32 = _FORMS[INT32]
_FALSE, _TRUE = 0xC2, 0xC3
_BOOLS = {_FALSE: False, _TRUE: True}
_FIXARRAY, _ARRAY16, _ARRAY32 = 0x90, 0xDC, 0xDD
_FIXMAP, _MAP16, _MAP32 = 0x80, 0xDE, 0xDF
_FIXSTR, _STR8, _STR16, _STR32 = 0xA0, 0xD9, 0xDA, 0xDB
_ARRAY_HEADS = tuple(bytes([_FIXARRAY | count]) for count in range(16))
_MAP_HEADS = tuple(bytes([_FIXMAP | count]) for count in range(16))
_STRING_HEADS = tuple(bytes([_FIXSTR | count]) for count in range(32))


MAX_TREE = 16 * 1024 * 1024
"""A tree of more bytes is refused: each of them may become an object of many times its size."""


def compile_writer(message: Struct, array: Callable[[np.dtype[Any]], PackArray]) -> Encoder:
    return _Writer(message, array).compile()


def compile_reader(message: Struct, array: Callable[[np.dtype[Any]], ReadArray], otherwise: Decoder) -> Decoder | None:
    """A decoder for messages of `compile_writer`; for any other message it calls `otherwise`.

    None if the library is as fast for this type.
    """
    return _Reader(message, array).compile(otherwise) if _suits(message) else None


def check_tree(payload: Frames) -> None:
    """Raise an error if a payload is too large."""
    if len(payload[0]) > MAX_TREE:
        raise ValueError(f"{len(payload[0])} bytes besides large arrays; a message may have {MAX_TREE}")
    if len(payload) > 1:
        check_size(sum(memoryview(part).nbytes for part in payload))


def _suits(kind: Type) -> bool:
    """Whether this code reads a message at least as fast as the library, which is faster for texts, not for arrays."""
    found = list(islice(_read_here(kind), _MOST))
    return len(found) < _MOST and all(found) and found.count(STRING) <= len(found) / 2


_MOST = 64
"""A message with more parts of varying size is left to the library."""


def _read_here(kind: Type) -> Iterator[Type | None]:
    """The parts of varying size in a message; None if it has a part that the library reads faster."""
    match kind:
        case Struct(fields=fields):
            for field in fields:
                yield from _read_here(field.type)
        case Sequence(item) if kind.dtype is not None or (isinstance(item, Struct) and is_fixed(item)):
            yield kind
        case Sequence() | Dictionary():
            yield None
        case Primitive() if kind is STRING:
            yield kind
        case Primitive() | Enumeration():
            return


def _is_for_library(kind: Type) -> bool:
    """Whether the library packs such values faster than a Python loop: they are neither arrays nor rows."""
    is_rows = isinstance(kind, Sequence) and isinstance(kind.item, Struct) and is_fixed(kind.item)
    return is_loop(kind) and not is_rows and not has_arrays(kind)


def has_arrays(kind: Type) -> bool:
    """Whether a value of this type may have arrays of numpy in it."""
    return _has_arrays(kind, set())


def _has_arrays(kind: Type, seen: set[int]) -> bool:
    if id(kind) in seen:
        return False
    seen.add(id(kind))
    is_array = isinstance(kind, Sequence) and kind.is_array
    return is_array or any(_has_arrays(child, seen) for child in children(kind))


def _struct_head(count: int) -> tuple[str, tuple[int, ...]]:
    """The head of an array of `count` fields: the letters by which `struct` packs it, and its numbers."""
    if count < 16:
        return "B", (_FIXARRAY | count,)
    return ("BH", (_ARRAY16, count)) if count < 1 << 16 else ("BI", (_ARRAY32, count))


class _Writer:
    """Writes `encode(values) -> payload`. In it, `add` appends octets and `frames` are separate buffers.

    A run is a series of numbers that one call of `struct` packs: its letters, and an expression for each number. An
    expression of digits only is a constant.
    """

    def __init__(self, message: Struct, array: Callable[[np.dtype[Any]], PackArray]) -> None:
        self._message = message
        self._program = Program(message)
        self._array = cache(array)
        self._letters = ""
        self._values: list[str] = []
        self._inline = _Inline()

    def compile(self) -> Encoder:
        p = self._program
        names = [p.fresh() for _ in self._message.fields]
        is_one_run = is_fixed(Struct("", self._message.fields, object))
        refusal = f"{p.name(refused)}({p.name(self._message)}, values, exc)"
        with p.block("def encode(values)"), p.guarded(refusal):
            p.line(f"[{', '.join(names)}] = values")
            if is_one_run:
                self._fields(self._message.fields, names)
                p.line(f"return [{self._packed()}]")
            else:
                p.line("out = []; add = out.append; frames = []")
                self._fields(self._message.fields, names)
                self._end_run()
                p.line("payload = [b''.join(out), *frames]")
                p.line(f"if frames or len(payload[0]) > {MAX_TREE}: {p.name(check_tree)}(payload)")
                if counter(self._message):  # each item has an octet at least, so few messages are counted
                    check = f"{p.name(check_items)}({p.name(self._message)}, values)"
                    p.line(f"if len(payload[0]) > {MAX_ITEMS}: {check}")
                p.line("return payload")
        self._inline.over = True
        p.write_functions(self._write)
        return p.compile("encode")

    def _write(self, function: str, kind: Type) -> None:
        p = self._program
        with p.block(f"def {function}(value, add, frames)"):
            if isinstance(kind, Struct):
                self._fields(kind.fields, p.take_apart(kind, "value"))
            else:
                self._value(kind, "value")
            self._end_run()

    def _fields(self, fields: tuple[Field, ...], names: list[str]) -> None:
        letters, numbers = _struct_head(len(fields))
        self._run(letters, *map(str, numbers))
        for library, some in groupby(zip(fields, names, strict=True), lambda each: _is_for_library(each[0].type)):
            if library:
                self._by_library(list(some))
                continue
            for field, variable in some:
                self._value(field.type, variable)

    def _by_library(self, parts: list[tuple[Field, str]]) -> None:
        """Emit one call of the library that packs these: as an array, whose head is then cut off."""
        self._end_run()
        p = self._program
        plant = compile_planter(Struct(self._message.name, tuple(field for field, _ in parts)), no_array)
        head = struct.calcsize(">" + _struct_head(len(parts))[0])
        tree = f"{p.name(plant, 'plant')}(({', '.join(x for _, x in parts)},), frames)"
        p.line(f"add({p.name(msgpack.packb)}({tree})[{head}:])")

    def _run(self, letters: str, *values: str) -> None:
        self._letters += letters
        self._values += values

    def _packed(self) -> str:
        """End the run, and return an expression for its octets."""
        pack = self._program.name(struct.Struct(">" + self._letters).pack, "pack")
        expression = f"{pack}({', '.join(self._values)})"
        self._letters, self._values = "", []
        return expression

    def _end_run(self) -> None:
        if self._letters:
            self._program.line(f"add({self._packed()})")

    def _value(self, kind: Type, x: str) -> None:
        p = self._program
        match kind:
            case Primitive() if kind is STRING:
                self._end_run()
                text = p.fresh()
                p.line(f"{text} = ({x} if type({x}) is str else {p.name(as_str)}({x})).encode()")
                short = f"{p.name(_STRING_HEADS, 'heads')}[len({text})]"
                p.line(f"add({short} if len({text}) < 32 else {p.name(_string_head)}(len({text}))); add({text})")
            case Primitive() | Enumeration():
                self._leaf(kind, x)
            case Struct() if is_fixed(kind):
                self._fixed(kind, x)
            case Struct(fields=fields) if self._inline.may(kind):
                self._fields(fields, p.take_apart(kind, x))
            case Struct():
                self._call(kind, x)
            case Sequence(Struct() as item, records=True) if kind.dtype is not None:
                self._end_run()
                taken = f"{p.name(records(item).taken)}({x})"
                p.line(f"{p.name(self._array(kind.dtype), 'array')}({taken}, add, frames)")
            case Sequence() if kind.dtype is not None:
                self._end_run()
                p.line(f"{p.name(self._array(kind.dtype), 'array')}({x}, add, frames)")
            case Sequence() | Dictionary() if _is_for_library(kind):
                self._by_library([(Field("value", kind), x)])
            case Sequence(item):
                self._end_run()
                items, each, flat = p.fresh(), p.fresh(), flat_records(item)
                taken = p.name(flat.listed if flat else as_list)
                p.line(f"{items} = {x}.copy() if type({x}) is list else {taken}({x})")
                self._head(items, _ARRAY_HEADS, _array_head)
                if isinstance(item, Struct) and is_fixed(item):
                    self._rows(item, items)
                else:
                    self._loop(f"{each} in {items}", (item, each))
            case Dictionary(key, item):
                self._end_run()
                entries, k, v = p.fresh(), p.fresh(), p.fresh()
                p.line(f"{entries} = {p.name(as_dict)}({x})")
                self._head(entries, _MAP_HEADS, _map_head)
                self._loop(f"{k}, {v} in {entries}.items()", (key, k), (item, v))

    def _head(self, items: str, heads: tuple[bytes, ...], head: Callable[[int], bytes]) -> None:
        p = self._program
        short = f"{p.name(heads, 'heads')}[len({items})]"
        p.line(f"add({short} if len({items}) < 16 else {p.name(head)}(len({items})))")

    def _loop(self, head: str, *parts: tuple[Type, str]) -> None:
        with self._program.block(f"for {head}"), self._inline.not_here():
            for kind, x in parts:
                if is_loop(kind):
                    self._call(kind, x)
                else:
                    self._value(kind, x)
            self._end_run()

    def _call(self, kind: Type, x: str) -> None:
        self._end_run()
        self._program.line(f"{self._program.function_for(kind)}({x}, add, frames)")

    def _rows(self, item: Struct, items: str) -> None:
        """Emit code for structs of fixed size: one call for each, or by the column for many structs of numbers."""
        p = self._program
        each = p.fresh()
        if not _only_numbers(item):
            with p.block(f"for {each} in {items}"):
                self._fixed(item, each)
                self._end_run()
            return
        self._fixed(item, each)
        numbers = [value for value in self._values if not value.isdecimal()]
        if numbers:
            texts, between = zip(
                *(_around(*each) for each in zip(self._letters, self._values, strict=True)), strict=True
            )
            layout = p.name(struct.Struct(">" + "".join(texts)), "layout")
            columns = ", ".join(f"[{number} for {each} in {items}]" for number in numbers)
            with p.block(f"if len({items}) > {FEW}"):
                p.line(f"add({p.name(packed)}({layout}, {p.name(b''.join(between), 'between')}, {columns}))")
        with p.block("else" if numbers else "if True"):
            p.line(f"add(b''.join([{self._packed()} for {each} in {items}]))")

    def _fixed(self, kind: Struct, x: str) -> None:
        letters, numbers = _struct_head(len(kind.fields))
        self._run(letters, *map(str, numbers))
        for field in kind.fields:
            at = f"{x}.{field.attribute}"
            if isinstance(field.type, Struct):
                self._fixed(field.type, at)
            else:
                self._leaf(field.type, at)

    def _leaf(self, kind: Type, at: str) -> None:
        """Numbers are checked by `struct`, and are what it takes."""
        p = self._program
        if _is_number(kind):
            tag, letter = _FORMS[kind]  # type: ignore[index]  # numbers are primitives
            self._run("B" + letter, str(tag), at)
            return
        each = p.fresh()
        p.line(f"{each} = {at}")
        match kind:
            case Enumeration():
                self._run("B" + _INT32[1], str(_INT32[0]), p.member(kind, each))
            case Primitive.BOOL:
                plain = f"{_FALSE} + ({each} if {each} is True or {each} is False else {p.name(as_bool)}({each}))"
                self._run("B", plain)
            case Primitive.TIME:
                low, high = RANGES[TIME]
                self._run("Bq", str(_FORMS[TIME][0]), f"{p.name(as_int)}({each}, {low}, {high})")


def _around(letter: str, value: str) -> tuple[str, bytes]:
    """The letters of a run's item in a layout of numbers only, and the values written there."""
    if not value.isdecimal():
        return letter, bytes(struct.calcsize(">" + letter))
    octets = struct.pack(">" + letter, int(value))
    return "x" * len(octets), octets


def _is_number(kind: Type) -> bool:
    return kind in _FORMS and kind is not TIME if isinstance(kind, Primitive) else False


def _only_numbers(kind: Struct) -> bool:
    return all(
        _only_numbers(field.type) if isinstance(field.type, Struct) else _is_number(field.type) for field in kind.fields
    )


class _Inline:
    """Decides which structs are compiled inline: each struct of the message itself, once, to keep the code short.

    The others get functions, and so do structs in loops, because loops must not nest.
    """

    def __init__(self) -> None:
        self.over = False
        """Whether all further structs get functions."""
        self._seen: set[int] = set()

    def may(self, kind: Struct) -> bool:
        if self.over or id(kind) in self._seen:
            return False
        self._seen.add(id(kind))
        return True

    @contextmanager
    def not_here(self) -> Iterator[None]:
        before, self.over = self.over, True
        yield
        self.over = before


class _Reader:
    """Writes `decode(payload) -> values`. In it, `data` is the packed message, `n` is how much of it was read,
    and `left` is how many more items there may be."""

    def __init__(self, message: Struct, array: Callable[[np.dtype[Any]], ReadArray]) -> None:
        self._message = message
        self._program = Program(message)
        self._array = cache(array)
        self._letters = ""
        self._names: list[str] = []
        self._expected: list[tuple[str, int]] = []
        self._inline = _Inline()

    def compile(self, otherwise: Decoder) -> Decoder:
        p = self._program
        fields = self._message.fields
        with p.block("def decode(payload)"):
            with p.block("try"):
                if is_fixed(Struct("", fields, object)):
                    p.line("[data] = payload")
                    values = self._listed(fields)
                    self._end_run(whole=True)
                else:
                    p.line("data = payload[0]; n = 0")
                    p.line(f"left = [{MAX_ITEMS}]" if counter(self._message) else "left = None")
                    p.line(f"if len(payload) > 1 or len(data) > {MAX_TREE}: {p.name(check_tree)}(payload)")
                    with p.block("if type(data) is not bytes"):
                        p.line(f"data = {p.name(memoryview)}(data).cast('B')")
                    values = self._fields(fields)
                    with p.block("if n != len(data)"):
                        p.line(f"{p.name(_otherwise)}()")
                p.line(f"return ({values})")
            with p.block("except Exception"):
                p.line("pass  # it may be packed as others do, or be wrong: then it is said what is")
            p.line(f"return {p.name(otherwise, 'otherwise')}(payload)")
        self._inline.over = True
        p.write_functions(self._write)
        return p.compile("decode")

    def _write(self, function: str, kind: Type) -> None:
        assert isinstance(kind, Struct)
        p = self._program
        with p.block(f"def {function}(data, n, payload, left)"):
            p.line(f"return {p.made(kind, self._fields(kind.fields))}, n")

    def _fields(self, fields: tuple[Field, ...]) -> str:
        values = self._listed(fields)
        self._end_run()
        return values

    def _listed(self, fields: tuple[Field, ...]) -> str:
        """Emit code that reads these; return expressions for them, each with a comma, valid after the run."""
        self._expect(*_struct_head(len(fields)))
        return "".join([f"{self._value(field.type)}, " for field in fields])

    def _expect(self, letters: str, numbers: tuple[int, ...]) -> None:
        self._expected += [(self._take(letter), number) for letter, number in zip(letters, numbers, strict=True)]

    def _take(self, letter: str) -> str:
        name = self._program.fresh()
        self._letters += letter
        self._names.append(name)
        return name

    def _end_run(self, *, whole: bool = False) -> None:
        """Emit code that reads the run so far; `whole` if the message has nothing else."""
        if not self._letters:
            return
        p = self._program
        layout, found = struct.Struct(">" + self._letters), ", ".join(self._names)
        if whole:
            p.line(f"[{found}] = {p.name(layout.unpack, 'unpack')}(data)")
        else:
            p.line(f"[{found}] = {p.name(layout.unpack_from, 'unpack')}(data, n); n += {layout.size}")
        if self._expected:
            names, numbers = zip(*self._expected, strict=True)
            with p.block(f"if ({', '.join(names)},) != {numbers}"):
                p.line(f"{p.name(_otherwise)}()")
        self._letters, self._names, self._expected = "", [], []

    def _value(self, kind: Type) -> str:
        """Emit code that reads a value; return an expression for it, valid after the run."""
        p = self._program
        if is_fixed(kind):
            return self._fixed(kind)
        if isinstance(kind, Struct) and self._inline.may(kind):
            return p.made(kind, self._listed(kind.fields))
        self._end_run()
        result = p.fresh()
        match kind:
            case Struct():
                p.line(f"{result}, n = {p.function_for(kind)}(data, n, payload, left)")
            case Sequence() if kind.dtype is not None:
                p.line(f"{result}, n = {p.name(self._array(kind.dtype), 'array')}(data, n, payload)")
                if kind.records and isinstance(kind.item, Struct):
                    p.line(f"{result} = {p.name(records(kind.item).checked)}({result})")
            case Sequence(item):
                assert isinstance(item, Struct)
                self._rows(item, result)
            case _:
                p.line(f"{result}, n = {p.name(_string)}(data, n)")
        return result

    def _rows(self, item: Struct, result: str) -> None:
        """Emit code that reads structs of fixed size."""
        p = self._program
        values = [self._fixed(field.type) for field in item.fields]
        layout, marks = self._row(len(item.fields))
        names = [name for name in self._names if name not in dict(self._expected)]
        self._letters, self._names, self._expected = "", [], []
        p.line(f"count, n = {p.name(_count)}(data, n); {p.name(take_items)}(left, count)")
        arguments = f"({p.name(layout, 'layout')}, {p.name(marks, 'marks')}, data, n, count)"
        p.make_each(item, result, names, values, p.name(_rows) + arguments, p.name(_columns) + arguments)

    def _row(self, fields: int) -> tuple[struct.Struct, tuple[tuple[int, bytes], ...]]:
        """The run so far, in an array of this number of fields: its layout, and the fixed octets in it."""
        letters, numbers = _struct_head(fields)
        octets = struct.pack(">" + letters, *numbers)
        marks, text, expected = list(enumerate(octets)), "x" * len(octets), dict(self._expected)
        for name, letter in zip(self._names, self._letters, strict=True):
            if name in expected:
                octets = struct.pack(">" + letter, expected[name])
                marks += enumerate(octets, struct.calcsize(">" + text))
                letter = "x" * len(octets)
            text += letter
        return struct.Struct(">" + text), tuple((at, bytes([octet])) for at, octet in marks)

    def _fixed(self, kind: Type) -> str:
        p = self._program
        match kind:
            case Struct(fields=fields):
                self._expect(*_struct_head(len(fields)))
                return p.made(kind, "".join(f"{self._fixed(field.type)}, " for field in fields))
            case Enumeration():
                self._expect("B", (_INT32[0],))
                return p.enumerator(kind, self._take(_INT32[1]))
            case Primitive.BOOL:
                return f"{p.name(_BOOLS)}[{self._take('B')}]"
            case Primitive():
                tag, letter = _FORMS[kind]
                self._expect("B", (tag,))
                number = self._take(letter)
                return f"{p.name(_instant)}({number})" if kind is TIME else number
            case Sequence() | Dictionary():
                raise AssertionError("of no fixed size")


# What compiled code calls.


def _array_head(count: int) -> bytes:
    return struct.pack(">BH", _ARRAY16, count) if count < 1 << 16 else struct.pack(">BI", _ARRAY32, count)


def _map_head(count: int) -> bytes:
    return struct.pack(">BH", _MAP16, count) if count < 1 << 16 else struct.pack(">BI", _MAP32, count)


def _string_head(length: int) -> bytes:
    if length < 1 << 8:
        return struct.pack(">BB", _STR8, length)
    return struct.pack(">BH", _STR16, length) if length < 1 << 16 else struct.pack(">BI", _STR32, length)


def no_array(value: Any, dtype: np.dtype[Any], frames: Frames) -> NoReturn:
    raise AssertionError("these have none")


def _otherwise() -> NoReturn:
    raise ValueError("packed otherwise")


def _instant(value: int) -> int:
    low, high = RANGES[TIME]
    return as_int(value, low, high)


def _string(data: bytes, n: int) -> tuple[str, int]:
    tag = data[n]
    if _FIXSTR <= tag < _FIXSTR + 32:
        begin, length = n + 1, tag & 31
    elif tag in _STRING_LENGTHS:
        layout = _STRING_LENGTHS[tag]
        begin, (length,) = n + 1 + layout.size, layout.unpack_from(data, n + 1)
    else:
        _otherwise()
    if begin + length > len(data):
        _otherwise()
    return str(data[begin : begin + length], "utf-8"), begin + length


_STRING_LENGTHS = {_STR8: struct.Struct(">B"), _STR16: struct.Struct(">H"), _STR32: struct.Struct(">I")}


def _count(data: bytes, n: int) -> tuple[int, int]:
    """How many items an array has that begins there, and where the first is."""
    tag = data[n]
    if _FIXARRAY <= tag < _FIXARRAY + 16:
        return tag & 15, n + 1
    if tag == _ARRAY16:
        return int.from_bytes(data[n + 1 : n + 3], "big"), n + 3
    if tag == _ARRAY32:
        return int.from_bytes(data[n + 1 : n + 5], "big"), n + 5
    _otherwise()


_Marks = tuple[tuple[int, bytes], ...]


def _rows(
    layout: struct.Struct, marks: _Marks, data: bytes, n: int, count: int
) -> tuple[Iterable[tuple[Any, ...]], int]:
    """The numbers of `count` structs."""
    end = _end(layout, marks, data, n, count)
    return layout.iter_unpack(data[n:end]), end


def _columns(layout: struct.Struct, marks: _Marks, data: bytes, n: int, count: int) -> tuple[Columns, int]:
    """The same as columns."""
    end = _end(layout, marks, data, n, count)
    return unpacked(layout, data, n, count), end


def _end(layout: struct.Struct, marks: _Marks, data: bytes, n: int, count: int) -> int:
    """Where `count` structs end. Raises an exception if they are missing or packed in another way."""
    end = n + count * layout.size
    if end > len(data):
        _otherwise()
    for at, octet in marks:
        if data[n + at : end : layout.size] != octet * count:
            _otherwise()
    return end
