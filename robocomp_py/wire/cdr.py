"""Codec `cdr`: XCDR1, little-endian, final types (OMG DDS-XTypes 1.3, 7.4.3; what ROS 2 and Fast DDS speak).

    payload     00 01 00 00, then the fields; primitives are aligned to their size (at most 8), counted from
                after these four octets
    string      uint32 length with the NUL, UTF-8, NUL
    sequence    uint32 count, items; those of records, too
    dictionary  a sequence of entries {key, value}
    enum        int32 · time: int32 seconds, uint32 nanoseconds · an empty struct: one octet

Compiled code packs runs of fixed-size fields by one `struct` call. Because alignment depends on
where a run begins, there are eight layouts of each run, chosen by `n & 7`. What needs numpy is imported
for messages that have arrays.
"""

from __future__ import annotations

import operator
import struct
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any, NoReturn

from ..contract.types import (
    BOOL,
    TIME,
    Dictionary,
    Enumeration,
    Primitive,
    Sequence,
    Struct,
    Type,
    children,
)
from .codec import MAX_BYTES, Decoder, Encoder, check_size, refused, unreadable
from .columns import ColumnDictionary, has_columns
from .flat import flat_records, records
from .items import Left
from .program import Leaf, leaves_of
from .rows import Columns, unpacked
from .serial import NUMBERS, Reading, Writing, check_count
from .values import as_dict, as_list, as_str

ENCAPSULATION = b"\x00\x01\x00\x00"
TAIL = bytes(4)
"""Follows a payload with room for a header: the count of an empty sequence."""

_ORIGIN = len(ENCAPSULATION)
"""From where alignment counts in a payload, modulo 8."""

_Layouts = tuple[struct.Struct, ...]
_LETTERS = {kind: "B" if kind is BOOL else kind.letter for kind in Primitive} | {TIME: "iI"}
_PADDING = tuple(bytes(-n & 7) for n in range(8))
_TAILS = tuple(bytes(-n & 3) + TAIL for n in range(4))


class Cdr:
    """The binary format of DDS; on Zenoh and shared memory and in recordings, too.

    Received arrays are views of the payload. Those of 8-byte numbers are aligned in memory only if
    the payload begins 4 octets before a multiple of 8. A transport with its own buffers should ensure that:
    numpy accepts unaligned arrays, but some operations (matrix products) are slow with them.

    `room`, a multiple of 8, leaves this number of octets free between encapsulation and fields, for the
    header of a transport that sends both as one sample. Payloads are then bytearrays, padded to a multiple
    of four and followed by `TAIL`, which the transport may use or omit.
    """

    name = "cdr"

    def __init__(self, room: int = 0, *, columns: bool = False) -> None:
        self._room, self._columns = room, columns

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        return _EncodeProgram(message, self._room, self._columns).compile()

    def pieces(self, message: Struct) -> Encoder:
        """Like `encoder`, but returns a list of the parts of a payload, with arrays as they are."""
        return _EncodeProgram(message, self._room, self._columns).compile(join=False)

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        return _DecodeProgram(message, self._room, self._columns).compile(prefix)

    def standard(self, message: Struct) -> Callable[[Any], Any]:
        """A function from a received payload, without `TAIL`, to what `Cdr()` would have made, for other programs.

        Where nothing differs, it returns the payload itself. Behind the last field may be up to three further octets.
        It may raise DecodeError.
        """
        if self._columns and _uses_columns(message):
            decode, encode = self.decoder(message), Cdr().encoder(message)
            return lambda payload: encode(decode(payload))
        if self._room:
            begin = len(ENCAPSULATION) + self._room
            return lambda payload: b"".join((ENCAPSULATION, memoryview(payload)[begin:]))
        return lambda payload: payload


def _uses_columns(kind: Type) -> bool:
    if isinstance(kind, Dictionary) and has_columns(kind):
        return True
    return any(map(_uses_columns, children(kind)))


# What has a fixed size is a run of primitives, its leaves.


def _letters(*some: Leaf) -> str:
    return "".join(_letter(leaf.kind) for leaf in some)


def _letter(kind: Type) -> str:
    match kind:
        case Primitive():
            return _LETTERS[kind]
        case Enumeration():
            return "i"
        case Struct(fields=()):
            return "B"
    raise AssertionError("no leaf")


def _layouts(letters: str, origin: int = 0) -> _Layouts:
    """The packing of these primitives, by the offset (modulo 8) at which they begin; alignment counts from `origin`."""
    return tuple(struct.Struct("<" + _aligned(letters, (start - origin) & 7)) for start in range(8))


def _aligned(letters: str, start: int) -> str:
    text, at = "", start
    for letter in letters:
        size = struct.calcsize("<" + letter)
        text += "x" * (-at % size) + letter
        at += -at % size + size
    return text


class _EncodeProgram(Writing):
    """Writes `encode(values) -> bytes`."""

    def __init__(self, message: Struct, room: int, columns: bool) -> None:
        super().__init__(message)
        self._room, self._columns = room, columns
        self._begun = False
        """Whether anything has been written. The first run is packed together with the encapsulation."""

    def compile(self, *, join: bool = True) -> Encoder:
        p = self._program
        fields = self._message.fields
        names = [p.fresh() for _ in fields]
        refusal = f"{p.name(refused)}({p.name(self._message)}, values, exc)"
        with p.block("def encode(values)"), p.guarded(refusal):
            p.line("out = []; add = out.append; n = 0")
            p.line(f"[{', '.join(names)}] = values")
            self._fields(fields, names)
            self._end_run()
            with p.block(f"if n > {MAX_BYTES - len(ENCAPSULATION)}"):
                p.line(f"{p.name(check_size)}(n + {len(ENCAPSULATION)})")
            self._check_items()
            if self._room:
                p.line(f"add({p.name(_TAILS)}[n & 3])")
            p.line(f"return {'bytearray' if self._room else 'bytes'}().join(out)" if join else "return out")
        p.write_functions(self._write)
        return p.compile("encode")

    def _end_run(self) -> None:
        p = self._program
        head = ENCAPSULATION + bytes(self._room)
        if not self._begun:
            self._begun = True
            first = struct.Struct(f"<{len(head)}s{_aligned(self._letters, 0)}")
            values = "".join(f", {value}" for value in self._values)
            p.line(f"add({p.name(first.pack)}({p.name(head)}{values})); n = {first.size - len(head)}")
        elif self._letters:
            layouts = p.name(_layouts(self._letters), "layouts")
            p.line(f"s = {layouts}[n & 7]; add(s.pack({', '.join(self._values)})); n += s.size")
        self._letters, self._values = "", []

    def _value(self, kind: Type, x: str) -> None:
        p = self._program
        leaves = leaves_of(kind)
        if leaves is not None:
            for leaf in leaves:
                self._run(_letters(leaf), *self._leaf(leaf, x))
            return
        match kind:
            case Primitive():
                text = p.fresh()
                p.line(f"{text} = ({x} if type({x}) is str else {p.name(as_str)}({x})).encode()")
                self._run("I", f"len({text}) + 1")
                self._end_run()
                p.line(f"add({text}); add(b'\\0'); n += len({text}) + 1")
            case Struct():
                self._call(kind, x)
            case Sequence(Struct() as item, records=True):
                from .layouts import CdrRecords

                array = p.fresh()
                p.line(f"{array} = {p.name(records(item).taken)}({x})")
                self._run("I", f"{array}.size")
                self._end_run()
                p.line(f"n = {p.name(CdrRecords(item).write)}({array}, n, add)")
            case Sequence() if kind.dtype is not None:
                from .arrays import as_array

                array = p.fresh()
                p.line(f"{array} = {p.name(as_array)}({x}, {p.name(kind.dtype)})")
                self._run("I", f"{array}.size")
                self._end_run()
                if kind.dtype.itemsize == 8:
                    p.line(f"if {array}.size: add({p.name(_PADDING)}[n & 7]); n += -n & 7")
                p.line(f"add({array}); n += {array}.nbytes")
            case Sequence(item):
                items, flat = p.fresh(), flat_records(item)
                taken = p.name(flat.items if flat else as_list)
                p.line(f"{items} = {x}.copy() if type({x}) is list else {taken}({x})")
                self._run("I", f"len({items})")
                self._end_run()
                if flat is None:
                    self._items(item, items)
                    return
                with p.block(f"if type({items}) is list"):
                    self._items(item, items)
                from .layouts import CdrRecords

                with p.block("else"):
                    p.line(f"n = {p.name(CdrRecords(flat.kind).write)}({items}, n, add)")
            case Dictionary(key, item):
                entries, k, v = p.fresh(), p.fresh(), p.fresh()
                p.line(f"{entries} = {p.name(as_dict)}({x})")
                self._run("I", f"len({entries})")
                self._end_run()
                if self._columns and has_columns(kind):
                    p.line(f"n = {p.name(ColumnDictionary(kind).write)}({entries}, n, add)")
                    return
                self._loop(f"{k}, {v} in {entries}.items()", (key, k), (item, v))
            case Enumeration():
                raise AssertionError("enumerations have leaves")

    def _items(self, item: Type, items: str) -> None:
        p = self._program
        each = p.fresh()
        leaves = leaves_of(item) or []
        kinds = {leaf.kind for leaf in leaves}
        if len(kinds) != 1 or not kinds <= NUMBERS:
            self._loop(f"{each} in {items}", (item, each))
            return
        # All numbers have one type, so there is no padding: one call packs them, and by column is fastest.
        letter, width = _letters(leaves[0]), len(leaves)
        with p.block(f"if {items}"):
            if struct.calcsize("<" + letter) > 4:
                p.line(f"add({p.name(_PADDING)}[n & 7]); n += -n & 7")
            if width == 1:
                p.line(f"s = [{each}{leaves[0].path} for {each} in {items}]")
            else:
                p.line(f"s = [0] * ({width} * len({items}))")
                for column, leaf in enumerate(leaves):
                    p.line(f"s[{column}::{width}] = [{each}{leaf.path} for {each} in {items}]")
            p.line(f"s = {p.name(struct.pack)}(f'<{{len(s)}}{letter}', *s)")
            p.line("add(s); n += len(s)")

    def _time(self, x: str) -> tuple[str, ...]:
        self._program.line(f"{x} = {self._program.name(operator.index)}({x})")
        return f"{x} // 1000000000", f"{x} % 1000000000"


class _DecodeProgram(Reading):
    """Writes `decode(payload) -> values`.

    What is aligned is aligned from behind the encapsulation, which is `ENCAPSULATION` modulo 8, since room is.
    """

    def __init__(self, message: Struct, room: int, columns: bool) -> None:
        super().__init__(message)
        self._columns = columns
        self._start = len(ENCAPSULATION) + room
        self._slack = len(_TAILS[1]) if room else 3  # DDS may pad a payload to a multiple of four

    def compile(self, prefix: bool) -> Callable[[Any], tuple[Any, ...]]:
        p = self._program
        with p.block("def decode(payload)"), p.guarded(f"{p.name(unreadable)}({p.name(self._message)}, exc)"):
            p.line("data = memoryview(payload)")
            with p.block(f"if not {self._start} <= data.nbytes <= {MAX_BYTES} or data[0] != 0 or data[1] != 1"):
                p.line(f"{p.name(_refuse)}(data)")
            self._begin()
            values = self._fields(self._message.fields)
            self._end_run()
            if not prefix:
                with p.block(f"if not 0 <= data.nbytes - n <= {self._slack}"):
                    p.line(f"{p.name(_refuse_rest)}(data, n)")
            p.line(f"return ({values})")
        p.write_functions(self._write)
        return p.compile("decode")

    def _end_run(self) -> None:
        p = self._program
        names = ", ".join(self._names)
        if not self._begun:
            self._begun = True
            first = struct.Struct("<" + _aligned(self._letters, 0))
            read = f"[{names}] = {p.name(first.unpack_from)}(data, {self._start}); " if names else ""
            p.line(f"{read}n = {self._start + first.size}")
        elif self._letters:
            layouts = p.name(_layouts(self._letters, _ORIGIN), "layouts")
            p.line(f"s = {layouts}[n & 7]; [{names}] = s.unpack_from(data, n); n += s.size")
        self._letters, self._names = "", []

    def _letters_of(self, kind: Type) -> str | None:
        leaves = leaves_of(kind)
        return None if leaves is None else _letters(*leaves)

    def _varying(self, kind: Type) -> str:
        p = self._program
        result = p.fresh()
        match kind:
            case Primitive():
                (length,) = self._run("I")
                self._end_run()
                p.line(f"{result} = {p.name(_text)}(data, n, {length}); n += {length}")
            case Sequence(Struct() as item, records=True):
                from .layouts import CdrRecords

                (count,) = self._run("I")
                self._end_run()
                p.line(f"{result}, n = {p.name(CdrRecords(item, _ORIGIN).read)}(data, n, {count})")
            case Sequence() if kind.dtype is not None:
                from .arrays import view_of

                (count,) = self._run("I")
                self._end_run()
                if kind.dtype.itemsize == 8:
                    p.line(f"if {count}: n += {_ORIGIN} - n & 7")
                p.line(f"{result} = {p.name(view_of)}(data, {p.name(kind.dtype)}, {count}, n); n += {result}.nbytes")
            case Sequence(item):
                (count,) = self._run("I")
                self._end_run()
                p.line(f"{result} = []")
                self._repeat(count, (item,), f"{result}.append({{}})", result)
            case Dictionary(key, item):
                (count,) = self._run("I")
                self._end_run()
                if self._columns and has_columns(kind):
                    p.line(f"{p.name(check_count)}(data, n, {count}, left)")
                    p.line(f"{result}, n = {p.name(ColumnDictionary(kind, _ORIGIN).read)}(data, n, {count})")
                    return result
                p.line(f"{result} = {{}}")
                self._repeat(count, (key, item), f"{result}[{{}}] = {{}}", result)
            case Struct() | Enumeration():
                raise AssertionError("read elsewhere, or of fixed size")
        return result

    def _rows_of(self, letters: str, count: str) -> tuple[str, str]:
        p = self._program
        arguments = f"({p.name(_layouts(letters, _ORIGIN), 'layouts')}, data, n, {count}, left)"
        return p.name(_rows) + arguments, p.name(_columns) + arguments

    def _primitive(self, kind: Primitive, take: Callable[[], str]) -> str:
        return f"{self._program.name(_instant)}({take()}, {take()})" if kind is TIME else take()


# What compiled decoders call.


def _refuse(data: memoryview) -> NoReturn:
    check_size(data.nbytes)
    raise ValueError("not XCDR1 little-endian")


def _refuse_rest(data: memoryview, n: int) -> NoReturn:
    raise ValueError(f"{data.nbytes - n} bytes left over")


def _instant(seconds: int, nanoseconds: int) -> int:
    if nanoseconds > 999999999:
        raise ValueError(f"{nanoseconds} nanoseconds are more than a second")
    return seconds * 1000000000 + nanoseconds


def _text(data: memoryview, n: int, length: int) -> str:
    if length == 0:  # some writers leave out the NUL of an empty string
        return ""
    if length > data.nbytes - n or data[n + length - 1] != 0:
        raise ValueError(f"a string of {length} bytes in {data.nbytes - n}, or without its end")
    return str(data[n : n + length - 1], "utf-8")


def _rows(layouts: _Layouts, data: memoryview, n: int, count: int, left: Left) -> tuple[Iterable[tuple[Any, ...]], int]:
    """The leaves of `count` items of fixed size."""
    first, layout, begin, end = _regular(layouts, data, n, count, left)
    return chain(first, layout.iter_unpack(data[begin:end])), end


def _columns(layouts: _Layouts, data: memoryview, n: int, count: int, left: Left) -> tuple[Columns, int]:
    """The same as columns."""
    first, layout, begin, end = _regular(layouts, data, n, count, left)
    columns = unpacked(layout, data, begin, count - len(first))
    if first:
        columns = [[*some, *others] for some, others in zip(zip(*first, strict=True), columns, strict=True)]
    return columns, end


def _regular(
    layouts: _Layouts, data: memoryview, n: int, count: int, left: Left
) -> tuple[list[tuple[Any, ...]], struct.Struct, int, int]:
    """The leaves of the first items, until their padding repeats; and the layout of the others, which are all there."""
    check_count(data, n, count, left)
    first: list[tuple[Any, ...]] = []
    while True:
        layout = layouts[n & 7]
        if len(first) == count:
            return first, layout, n, n
        if layouts[(n + layout.size) & 7].format == layout.format:
            end = n + (count - len(first)) * layout.size
            if end > data.nbytes:
                raise ValueError(f"{count} items exceed the payload")
            return first, layout, n, end
        first.append(layout.unpack_from(data, n))
        n += layout.size
