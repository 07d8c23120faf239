"""Codec `ice`: encapsulations of ZeroC Ice's encoding 1.1, whole, as `ice_invoke` takes and gives them.

    payload     int32 its size, 01 01, then the fields; little-endian, and nothing is aligned
    size        one octet below 255; otherwise ff, int32
    string      size, UTF-8
    sequence    size, items · dictionary: size, entries {key, value} · enum: its number, written as a size
    bool byte · int8 byte · uint16 int · uint32 long · uint64 long · time long, the nanoseconds
    response    the out parameters, then what is returned
    exception   a slice for each class, derived ones first: one octet of flags, `::Module::Name`, in the sliced format
                int32 its size from here on, then the fields of its own

The types are those of the Slice file that `rcgen` writes. What Slice cannot say does travel between two of
ours: a byte below 0 and a long from 2**63 as their two's complement, an enumerator below 0 as the long form of
a size, an empty struct as one octet.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from ..contract.types import (
    BOOL,
    LINEAGE,
    TIME,
    UINT16,
    UINT32,
    Dictionary,
    Enumeration,
    ExceptionType,
    Primitive,
    Response,
    Sequence,
    Struct,
    Thrown,
    Type,
    thrown,
)
from .arrays import as_array, view_of
from .codec import MAX_BYTES, Decoder, Encoder, Payload, check_size, refused, unreadable
from .flat import flat_records, records
from .items import MAX_ITEMS, Left, take_items
from .layouts import IceRecords
from .program import Leaf, leaves_of
from .rows import FEW, Columns, packed, unpacked
from .serial import NUMBERS, Reading, Writing
from .values import RANGES, as_dict, as_int, as_list, as_str

_HEAD = "iH"
"""The size of an encapsulation and its encoding."""

_ENCODING = 0x0101
_LONG = 255
"""In place of a size: it follows as an int32."""

_SIZES = tuple(bytes([size]) for size in range(_LONG))
_LONG_SIZE, _INT32 = struct.Struct("<Bi"), struct.Struct("<i")

_WRITTEN = {kind: kind.letter for kind in Primitive} | {BOOL: "B", UINT16: "Hxx", UINT32: "Ixxxx"}
"""How `struct` packs each type. Unsigned numbers get padding to Slice's wider type, so `struct` checks their range."""

_READ = {**_WRITTEN, UINT16: "I", UINT32: "Q"}
_WIDER: dict[np.dtype[Any], np.dtype[Any]] = {np.dtype("<u2"): np.dtype("<i4"), np.dtype("<u4"): np.dtype("<i8")}


class Ice:
    """What programs of ZeroC Ice write and read.

    Received arrays of octets and bools are views of the payload.
    """

    name = "ice"

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        if isinstance(message, Thrown) and message.kind:
            return _thrower(message, message.kind)
        return _EncodeProgram(message).compile()

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        if isinstance(message, Thrown):
            return _catcher(message, message.kind, prefix=prefix) if message.kind else _lineage
        return _DecodeProgram(message).compile(prefix)


def _in_order(message: Struct) -> list[tuple[int, Type]]:
    """Which field is where on the wire, and its type."""
    fields = [(number, field.type) for number, field in enumerate(message.fields)]
    returns = isinstance(message, Response) and message.fields and message.fields[0].name == "ret"
    return [*fields[1:], fields[0]] if returns else fields


# What has a fixed size is a run of primitives, its leaves.


def _leaves(kind: Type) -> list[Leaf] | None:
    """The leaves of a type, in order; None if its size varies."""
    leaves = leaves_of(kind)
    return leaves if leaves is not None and all(_is_octet(leaf.kind) for leaf in leaves) else None


def _is_octet(kind: Type) -> bool:
    """Whether a type is an enumeration whose members all take one octet."""
    return not isinstance(kind, Enumeration) or all(0 <= number < _LONG for _, number in kind.members)


def _letters(leaves: list[Leaf], letters: dict[Primitive, str]) -> list[str]:
    return [letters[leaf.kind] if isinstance(leaf.kind, Primitive) else "B" for leaf in leaves]


class _EncodeProgram(Writing):
    """Writes `encode(values) -> bytes`."""

    def __init__(self, message: Struct) -> None:
        super().__init__(message)
        self._run(_HEAD, "n", str(_ENCODING))
        self._first = ""
        """Packs the first run; called last, because the run holds the size of the whole message."""

    def compile(self) -> Encoder:
        p = self._program
        names = [p.fresh() for _ in self._message.fields]
        refusal = f"{p.name(refused)}({p.name(self._message)}, values, exc)"
        with p.block("def encode(values)"), p.guarded(refusal):
            p.line("out = [b'']; add = out.append")
            p.line(f"[{', '.join(names)}] = values")
            for number, kind in _in_order(self._message):
                self._value(kind, names[number])
            self._end_run()
            with p.block(f"if n > {MAX_BYTES}"):
                p.line(f"{p.name(check_size)}(n)")
            self._check_items()
            p.line(f"out[0] = {self._first}; return b''.join(out)")
        p.write_functions(self._write)
        return p.compile("encode")

    def _end_run(self, size: str = "", more: str = "") -> None:
        """Emit what packs the run and, at its end, a size; `more` octets follow."""
        if not (self._letters or size):
            return
        p = self._program
        values = ", ".join(self._values)
        fixed = struct.calcsize("<" + self._letters)
        if not size:
            octets, run = str(fixed), f"{p.name(struct.Struct('<' + self._letters).pack)}({values})"
        else:
            octets = f"({fixed + 1} if {size} < {_LONG} else {fixed + 5}){' + ' if more else ''}{more}"
            if values:
                short, long = (p.name(struct.Struct(f"<{self._letters}{each}").pack) for each in ("B", "Bi"))
                run = f"{short}({values}, {size}) if {size} < {_LONG} else {long}({values}, {_LONG}, {size})"
            else:
                run = f"{p.name(_SIZES)}[{size}] if {size} < {_LONG} else {p.name(_LONG_SIZE.pack)}({_LONG}, {size})"
        if self._first:
            p.line(f"add({run}); n += {octets}")
        else:
            self._first = run
            p.line(f"n = {octets}")
        self._letters, self._values = "", []

    def _value(self, kind: Type, x: str) -> None:
        p = self._program
        leaves = _leaves(kind)
        if leaves is not None:
            for leaf, letters in zip(leaves, _letters(leaves, _WRITTEN), strict=True):
                self._run(letters, *self._leaf(leaf, x))
            return
        size = p.fresh()
        match kind:
            case Primitive():
                text = p.fresh()
                p.line(f"{text} = ({x} if type({x}) is str else {p.name(as_str)}({x})).encode(); {size} = len({text})")
                self._end_run(size, size)
                p.line(f"add({text})")
            case Enumeration():
                number = p.name(_number, "number")
                p.line(f"{size} = {p.member(kind, x)}")
                self._end_run()
                p.line(f"{size} = {number}({size}); add({size}); n += len({size})")
            case Struct():
                self._call(kind, x)
            case Sequence(Struct() as item, records=True) if _leaves(item) is not None:
                array = p.fresh()
                p.line(f"{array} = {p.name(records(item).taken)}({x}); {size} = {array}.size")
                p.line(f"{array} = {p.name(IceRecords(item).octets)}({array})")
                self._end_run(size, f"{array}.nbytes")
                p.line(f"add({array})")
            case Sequence(Struct() as item, records=True):  # enumerators differ in size
                items = p.fresh()
                known = p.name(records(item))
                p.line(f"{items} = {known}.objects({known}.taken({x})); {size} = len({items})")
                self._end_run(size)
                self._items(item, items, size)
            case Sequence() if kind.dtype is not None:
                array = p.fresh()
                p.line(f"{array} = {p.name(as_array)}({x}, {p.name(kind.dtype)}); {size} = {array}.size")
                if kind.dtype in _WIDER:
                    p.line(f"{array} = {array}.astype({p.name(_WIDER[kind.dtype])})")
                self._end_run(size, f"{array}.nbytes")
                p.line(f"add({array})")
            case Sequence(item):
                items, flat = p.fresh(), flat_records(item)
                in_place = flat is not None and _leaves(item) is not None
                taken = p.name((flat.items if in_place else flat.listed) if flat else as_list)
                p.line(f"{items} = {x}.copy() if type({x}) is list else {taken}({x}); {size} = len({items})")
                self._end_run(size)
                if flat is None or not in_place:
                    self._items(item, items, size)
                    return
                with p.block(f"if type({items}) is list"):
                    self._items(item, items, size)
                with p.block("else"):
                    p.line(f"{items} = {p.name(IceRecords(flat.kind).octets)}({items})")
                    p.line(f"add({items}); n += {items}.nbytes")
            case Dictionary(key, item):
                entries, k, v = p.fresh(), p.fresh(), p.fresh()
                p.line(f"{entries} = {p.name(as_dict)}({x}); {size} = len({entries})")
                self._end_run(size)
                self._loop(f"{k}, {v} in {entries}.items()", (key, k), (item, v))

    def _items(self, item: Type, items: str, size: str) -> None:
        p = self._program
        each = p.fresh()
        leaves = _leaves(item) or []
        letters = _letters(leaves, _WRITTEN)
        if not letters or not {leaf.kind for leaf in leaves} <= NUMBERS:
            self._loop(f"{each} in {items}", (item, each))
            return
        layout = struct.Struct("<" + "".join(letters))
        columns = [f"[{each}{leaf.path} for {each} in {items}]" for leaf in leaves]
        with p.block(f"if {size}"):
            if len(set(letters)) == 1 and len(letters[0]) == 1:  # all numbers of one kind: one call packs them all
                width = len(letters)
                p.line(f"s = [0] * ({width} * {size})" if width > 1 else f"s = {columns[0]}")
                for number, column in enumerate(columns if width > 1 else ()):
                    p.line(f"s[{number}::{width}] = {column}")
                p.line(f"add({p.name(struct.pack)}(f'<{{len(s)}}{letters[0]}', *s)); n += {layout.size} * {size}")
                return
            few = ", ".join(f"{each}{leaf.path}" for leaf in leaves)
            with p.block(f"if {size} > {FEW}"):
                p.line(f"add({p.name(packed)}({p.name(layout)}, {p.name(bytes(layout.size))}, {', '.join(columns)}))")
            with p.block("else"):
                p.line(f"add(b''.join([{p.name(layout.pack)}({few}) for {each} in {items}]))")
            p.line(f"n += {layout.size} * {size}")

    def _time(self, x: str) -> tuple[str, ...]:
        low, high = RANGES[TIME]
        plain = f"{x} if type({x}) is int and {low} <= {x} <= {high}"
        return (f"{plain} else {self._program.name(as_int)}({x}, {low}, {high})",)


def _number(number: int) -> bytes:
    """An enumerator as a size."""
    return _SIZES[number] if 0 <= number < _LONG else _LONG_SIZE.pack(_LONG, number)


class _DecodeProgram(Reading):
    """Writes `decode(payload) -> values`.

    A text that reaches beyond the payload is read shorter: `n` is checked when numbers are read, and at the end.
    """

    def __init__(self, message: Struct) -> None:
        super().__init__(message)
        self._letters, self._names = _HEAD, ["size", "encoding"]

    def compile(self, prefix: bool) -> Decoder:
        p = self._program
        with p.block("def decode(payload)"), p.guarded(f"{p.name(unreadable)}({p.name(self._message)}, exc)"):
            p.line(f"data = payload if type(payload) is bytes else {p.name(memoryview)}(payload).cast('B')")
            self._begin()
            values = {number: self._value(kind) for number, kind in _in_order(self._message)}
            self._end_run()
            with p.block(f"if n {'>' if prefix else '!='} size"):
                p.line(f"{p.name(_refuse_rest)}(size, n)")
            p.line(f"return ({''.join(f'{values[number]}, ' for number in sorted(values))})")
        p.write_functions(self._write)
        return p.compile("decode")

    def part(self) -> Callable[[Any, int, Left], tuple[tuple[Any, ...], int]]:
        """A function that reads the fields at an offset in a payload; it returns also where they end."""
        p = self._program
        self._begun, self._letters, self._names = True, "", []
        with p.block("def read(data, n, left)"):
            values = "".join(f"{value}, " for value in [self._value(field.type) for field in self._message.fields])
            self._end_run()
            p.line(f"return ({values}), n")
        p.write_functions(self._write)
        return p.compile("read")

    def _end_run(self) -> None:
        if not self._letters:
            return
        p = self._program
        layout = struct.Struct("<" + self._letters)
        names, unpack = ", ".join(self._names), p.name(layout.unpack_from)
        if self._begun:
            p.line(f"[{names}] = {unpack}(data, n); n += {layout.size}")
        else:
            self._begun = True
            p.line(f"[{names}] = {unpack}(data); n = {layout.size}")
            with p.block(f"if size != len(data) or encoding != {_ENCODING} or size > {MAX_BYTES}"):
                p.line(f"{p.name(_refuse)}(data)")
        self._letters, self._names = "", []

    def _size(self, long: Callable[[Any, int], tuple[int, int]]) -> str:
        """Emit what reads a size, and what is in front of it; return the variable."""
        p = self._program
        (size,) = self._run("B")
        self._end_run()
        p.line(f"if {size} == {_LONG}: {size}, n = {p.name(long)}(data, n)")
        return size

    def _letters_of(self, kind: Type) -> str | None:
        leaves = _leaves(kind)
        return None if leaves is None else "".join(_letters(leaves, _READ))

    def _varying(self, kind: Type) -> str:
        p = self._program
        result = p.fresh()
        match kind:
            case Primitive():
                size = self._size(_long_size)
                p.line(f"{result} = str(data[n : n + {size}], 'utf-8'); n += {size}")
            case Enumeration():
                number = self._size(_long_number)
                p.line(f"{result} = {p.enumerator(kind, number)}")
            case Sequence(Struct() as item, records=True) if _leaves(item) is not None:
                size = self._size(_long_size)
                p.line(f"{result}, n = {p.name(IceRecords(item).read)}(data, n, {size})")
            case Sequence(Struct() as item, records=True):
                size = self._size(_long_size)
                p.line(f"{result} = []; left = left or [{MAX_ITEMS}]")
                self._repeat(size, (item,), f"{result}.append({{}})", result)
                p.line(f"{result} = {p.name(records(item).received)}({result})")
            case Sequence() if kind.dtype is not None:
                size = self._size(_long_size)
                wire = _WIDER.get(kind.dtype, kind.dtype)
                read = _narrowed if wire != kind.dtype else view_of if wire.itemsize == 1 else _copied
                p.line(f"{result} = {p.name(read)}(data, {p.name(kind.dtype)}, {size}, n)")
                p.line(f"n += {size} * {wire.itemsize}")
            case Sequence(item):
                size = self._size(_long_size)
                p.line(f"{result} = []")
                self._repeat(size, (item,), f"{result}.append({{}})", result)
            case Dictionary(key, item):
                size = self._size(_long_size)
                p.line(f"{result} = {{}}")
                self._repeat(size, (key, item), f"{result}[{{}}] = {{}}", result)
            case Struct():
                raise AssertionError("read elsewhere")
        return result

    def _rows_of(self, letters: str, count: str) -> tuple[str, str]:
        p = self._program
        arguments = f"({p.name(struct.Struct('<' + letters))}, data, n, {count}, left)"
        return p.name(_few) + arguments, p.name(_many) + arguments

    def _primitive(self, kind: Primitive, take: Callable[[], str]) -> str:
        x = take()
        if kind is TIME or kind is UINT16 or kind is UINT32:
            low, high = RANGES[kind]
            return f"({x} if {low} <= {x} <= {high} else {self._program.name(as_int)}({x}, {low}, {high}))"
        return x


# What compiled decoders call.


def _refuse(data: Any) -> NoReturn:
    check_size(len(data))
    size, major, minor = struct.unpack_from("<iBB", data)
    if (major, minor) != (1, 1):
        raise ValueError(f"encoding {major}.{minor} of Ice instead of 1.1")
    raise ValueError(f"an encapsulation of {size} bytes in {len(data)}")


def _refuse_rest(size: int, n: int) -> NoReturn:
    raise ValueError(f"{size - n} bytes left over" if n < size else f"{n - size} bytes are missing")


def _long_number(data: Any, n: int) -> tuple[int, int]:
    return _INT32.unpack_from(data, n)[0], n + _INT32.size


def _long_size(data: Any, n: int) -> tuple[int, int]:
    size, n = _long_number(data, n)
    if not 0 <= size <= len(data) - n:
        raise ValueError(f"a size of {size} in {len(data) - n} bytes")
    return size, n


def _copied(data: Any, dtype: np.dtype[Any], count: int, n: int) -> np.ndarray[Any, Any]:
    """A copy, because numpy needs twice the time for an unaligned array."""
    if not count:
        return view_of(b"", dtype, 0, 0)
    end = n + count * dtype.itemsize
    if end > len(data):
        raise ValueError(f"{count} of {dtype.name} exceed the payload")
    return np.frombuffer(bytes(data[n:end]), dtype)


def _narrowed(data: Any, dtype: np.dtype[Any], count: int, n: int) -> np.ndarray[Any, Any]:
    """An array of an unsigned type, which Slice carries as a wider type."""
    array = view_of(data, _WIDER[dtype], count, n)
    limit = np.iinfo(dtype).max
    if count and (array.min() < 0 or array.max() > limit):
        raise ValueError(f"values from {array.min()} to {array.max()} are not from 0 to {limit}")
    return np.frombuffer(array.astype(dtype).tobytes(), dtype)


def _few(layout: struct.Struct, data: Any, n: int, count: int, left: Left) -> tuple[Iterator[tuple[Any, ...]], int]:
    """The leaves of `count` items of fixed size."""
    end = _end_of_rows(layout, data, n, count, left)
    return layout.iter_unpack(memoryview(data)[n:end]), end


def _many(layout: struct.Struct, data: Any, n: int, count: int, left: Left) -> tuple[Columns, int]:
    """The same as columns."""
    end = _end_of_rows(layout, data, n, count, left)
    return unpacked(layout, data, n, count), end


def _end_of_rows(layout: struct.Struct, data: Any, n: int, count: int, left: Left) -> int:
    take_items(left, count)
    end = n + count * layout.size
    if end > len(data):
        raise ValueError(f"{count} items exceed the payload")
    return end


# An exception has a slice for each class. A client can skip the slice of an unknown class only if the slice has a size.
# So exceptions with a base use Ice's sliced format; others use the compact format, as Ice itself does.

_ENCAPSULATION = struct.Struct("<" + _HEAD)
_HAS_OPTIONALS, _HAS_REFERENCES, _HAS_SIZE, _IS_LAST = 0x04, 0x08, 0x10, 0x20

_MAX_SLICES = 128
"""More bases than the languages allow an exception."""


def _thrower(message: Thrown, kind: ExceptionType) -> Encoder:
    """A function that writes an exception from its lineage, one slice for each class, and its fields."""
    writers = [_slice_writer(each, sliced=kind.base is not None) for each in _with_bases(kind)]

    def encode(values: tuple[Any, ...]) -> bytes:
        try:
            if len(values) != len(message.fields):
                raise ValueError(f"{len(values)} values")
            slices = [part for write in writers for part in write(values[1:])]
            size = _ENCAPSULATION.size + sum(map(len, slices))
            check_size(size)
            return b"".join((_ENCAPSULATION.pack(size, _ENCODING), *slices))
        except Exception as exc:
            raise refused(message, values, exc) from exc

    return encode


def _slice_writer(kind: ExceptionType, *, sliced: bool) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """A function that writes the slice of one class, in pieces, from the fields of all classes."""
    type_id = f"::{kind.name}".encode()
    flags = (_HAS_SIZE if sliced else 0) | (0 if kind.base else _IS_LAST)
    head = bytes([flags]) + _number(len(type_id)) + type_id
    end = len(kind.all_fields)
    encode_own = _EncodeProgram(Struct(kind.name, kind.fields)).compile()

    def write(fields: tuple[Any, ...]) -> tuple[Any, ...]:
        own = memoryview(encode_own(fields[end - len(kind.fields) : end]))[_ENCAPSULATION.size :]
        return (head, _INT32.pack(_INT32.size + len(own)), own) if sliced else (head, own)

    return write


def _with_bases(kind: ExceptionType) -> Iterator[ExceptionType]:
    yield kind
    if kind.base:
        yield from _with_bases(kind.base)


@dataclass(frozen=True)
class _Slice:
    """A slice: its name, where its fields begin and, if it has a size, where the next slice begins."""

    place: int
    flags: int
    name: str
    begin: int
    end: int | None


def _lineage(payload: Payload) -> tuple[Any, ...]:
    """The names of an exception's classes, up to the first slice without a size."""
    try:
        return (LINEAGE.join(each.name for each in _slices(_opened(payload))),)
    except Exception as exc:
        raise unreadable(thrown(), exc) from exc


def _catcher(message: Thrown, kind: ExceptionType, *, prefix: bool) -> Decoder:
    """A function that reads the fields of an exception of this kind, or of one derived from it."""
    parts = [(each.name, _DecodeProgram(Struct(each.name, each.fields)).part()) for each in _with_bases(kind)]

    def decode(payload: Payload) -> tuple[Any, ...]:
        try:
            data = _opened(payload)
            fields: list[Any] = []
            left = [MAX_ITEMS]
            slices = _slices(data)
            n = _place_of(kind.name, slices)
            if kind.base is None and slices[-1].place > n and slices[-1].end is not None:
                own, n = parts[0][1](joined := _with_fields_of_bases(data, n, slices), 0, left)
                if n != len(joined):
                    _refuse_rest(len(joined), n)
                return (kind.name, *own)
            for name, read in parts:
                part = _slice_at(data, n)
                if part.name != name:
                    raise ValueError(f"a slice of {part.name} instead of one of {name}")
                own, n = read(data, part.begin, left)
                n = _end_of(part, n)
                fields[:0] = own
            if n > len(data) or (n < len(data) and not prefix):
                _refuse_rest(len(data), n)
            return (LINEAGE.join(kind.lineage), *fields)
        except Exception as exc:
            raise unreadable(message, exc) from exc

    return decode


def _with_fields_of_bases(data: Any, place: int, slices: list[_Slice]) -> bytes:
    """The fields of a class and of its bases, in the order of a kind whose bases are not known: theirs come first."""
    return b"".join(data[each.begin : each.end] for each in reversed(slices) if each.place >= place)


def _opened(payload: Payload) -> Any:
    data = payload if type(payload) is bytes else memoryview(payload).cast("B")
    size, encoding = _ENCAPSULATION.unpack_from(data)
    if size != len(data) or encoding != _ENCODING or size > MAX_BYTES:
        _refuse(data)
    return data


def _slices(data: Any) -> list[_Slice]:
    """The slices, up to the first without a size."""
    found = [_slice_at(data, _ENCAPSULATION.size)]
    while (end := found[-1].end) is not None and not found[-1].flags & _IS_LAST:
        found.append(_slice_at(data, end))
        if len(found) > _MAX_SLICES:
            raise ValueError(f"more than {_MAX_SLICES} slices")
    return found


def _place_of(name: str, slices: list[_Slice]) -> int:
    for each in slices:
        if each.name == name:
            return each.place
    raise ValueError(f"a {slices[0].name} that is no {name}")


def _slice_at(data: Any, place: int) -> _Slice:
    flags, size, n = data[place], data[place + 1], place + 2
    if size == _LONG:
        size, n = _long_size(data, n)
    name = str(data[n : n + size], "utf-8").removeprefix("::")
    n += size
    if flags & _HAS_REFERENCES:
        raise ValueError(f"{name} refers to objects of classes, which only Ice itself can read")
    if not flags & _HAS_SIZE:
        return _Slice(place, flags, name, n, None)
    length, begin = _long_number(data, n)
    if not begin <= n + length <= len(data):
        raise ValueError(f"a slice of {length} bytes in {len(data) - n}")
    return _Slice(place, flags, name, begin, n + length)


def _end_of(part: _Slice, n: int) -> int:
    """Where a slice ends, if its fields end at `n`."""
    if part.end is None:
        if part.flags & _HAS_OPTIONALS:
            raise ValueError(f"{part.name} has optional members")
        return n
    if n > part.end:
        raise ValueError(f"the fields of {part.name} are longer than its slice")
    return part.end
