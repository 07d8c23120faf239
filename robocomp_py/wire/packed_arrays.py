"""Arrays in MessagePack: how codec `messagepack` packs and reads them. This module needs numpy."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

from ..contract.types import dtypes
from .arrays import as_array, read_only, view_of
from .arrays import snapshot as frozen
from .packing import PackArray, ReadArray
from .plain import NUMBERS, Frames

APART = 64 * 1024
"""Arrays of at least this number of bytes travel in their own buffer."""

INLINE_EXT, APART_EXT = 1, 2
_LETTERS = {dtype: kind.letter for kind, dtype in dtypes().items()}
_DTYPES = {ord(letter): dtype for dtype, letter in _LETTERS.items()}
_REFERENCE = struct.Struct("<BI")
_INDEX = struct.Struct("<I")
_APART_BYTES = _REFERENCE.size
_BIN8, _BIN16 = struct.Struct(">BB"), struct.Struct(">BH")
_EXT8, _EXT16, _EXT32 = struct.Struct(">BBbB"), struct.Struct(">BHbB"), struct.Struct(">BIbB")
_HEADS = {
    tag: (head.unpack_from, head.size)
    for tag, head in ((0xC4, _BIN8), (0xC5, _BIN16), (0xC7, _EXT8), (0xC8, _EXT16), (0xC9, _EXT32))
}
"""The heads of arrays by their first octet: bin 8 and 16, and ext 8, 16 and 32 with the letter."""
_OCTET = ord("B")
_OCTETS = np.dtype(np.uint8)


def array_packer(dtype: np.dtype[Any], *, snapshot: bool) -> PackArray:
    """A function that packs arrays of this dtype. A large array is sent in a separate buffer: a copy of it with
    `snapshot`, or the array itself."""
    return _packer(dtype, frozen if snapshot else as_array)


def _packer(dtype: np.dtype[Any], keep: Callable[[Any, np.dtype[Any]], np.ndarray[Any, Any]]) -> PackArray:
    """As `array_packer`; `keep(array)` is what is sent of a large array."""
    if dtype.names:
        return _record_packer(keep)
    octets, letter = dtype == _OCTETS, ord(_LETTERS[dtype])

    def pack(value: Any, add: Callable[[Any], object], frames: Frames) -> None:
        array = as_array(value, dtype)
        size = array.nbytes
        if size >= APART:
            frames.append(keep(array, dtype).data)
            add(_EXT8.pack(0xC7, _APART_BYTES, APART_EXT, letter) + _INDEX.pack(len(frames)))
        elif octets:
            add(_BIN8.pack(0xC4, size) if size < 256 else _BIN16.pack(0xC5, size))
            add(array)
        elif size < 255:
            add(_EXT8.pack(0xC7, size + 1, INLINE_EXT, letter))
            add(array)
        elif size < 0xFFFF:
            add(_EXT16.pack(0xC8, size + 1, INLINE_EXT, letter))
            add(array)
        else:  # one octet less than is sent apart, and with its letter one more than fits
            add(_EXT32.pack(0xC9, size + 1, INLINE_EXT, letter))
            add(array)

    return pack


def _record_packer(keep: Callable[[Any, np.dtype[Any]], np.ndarray[Any, Any]]) -> PackArray:
    """A function that packs records as octets."""
    pack_octets = _packer(_OCTETS, keep)

    def pack(array: Any, add: Callable[[Any], object], frames: Frames) -> None:
        pack_octets(array.view(_OCTETS), add, frames)

    return pack


def array_reader(dtype: np.dtype[Any]) -> ReadArray:
    """A function that reads such arrays. Any other content, or another way of packing, raises an exception."""
    if dtype.names:
        return _record_reader(dtype)
    octets, letter, item = dtype == _OCTETS, ord(_LETTERS[dtype]), dtype.itemsize
    checked = dtype.kind == "b"

    def read(data: Any, n: int, payload: Frames) -> tuple[np.ndarray[Any, Any], int]:
        unpack, begin = _HEADS[data[n]]
        if begin > 3:
            _, size, code, found = unpack(data, n)
            if found != letter or not size:
                raise ValueError("another array")
            begin += n
            end = begin + size - 1
            if code == APART_EXT:
                (index,) = _INDEX.unpack(data[begin:end])
                if index == 0:
                    raise ValueError("no array")
                return _view(payload[index], letter, dtype), end
            if code != INLINE_EXT or octets:
                raise ValueError("another form")
        else:
            _, size = unpack(data, n)
            begin += n
            end = begin + size
            if not octets:
                raise ValueError("another array")
        if end > len(data):
            raise ValueError("no whole array")
        inside = data[begin:end] if type(data) is bytes else bytes(data[begin:end])  # copied: nothing is aligned there
        if checked or begin == end:
            return view_of(inside, dtype, (end - begin) // item, 0), end
        return np.frombuffer(inside, dtype), end

    return read


def _record_reader(dtype: np.dtype[Any]) -> ReadArray:
    read_octets = array_reader(_OCTETS)

    def read(data: Any, n: int, payload: Frames) -> tuple[np.ndarray[Any, Any], int]:
        array, end = read_octets(data, n, payload)
        return array.view(dtype), end

    return read


def read_array(value: Any, dtype: np.dtype[Any], payload: Frames) -> np.ndarray[Any, Any]:
    """A read-only array from what the library unpacked: octets, an extension, or a list of numbers.

    `payload` has the buffers of large arrays. Raises ValueError for any other value, and for an array of another dtype;
    OverflowError for a number out of range; KeyError, IndexError or struct.error for a damaged extension.
    """
    if dtype.names:
        return _read_records(value, dtype, payload)
    if type(value) is bytes:
        return view_of(value, dtype, len(value), 0) if dtype == _OCTETS else _view(value, _OCTET, dtype)
    if type(value) is msgpack.ExtType:
        if value.code == INLINE_EXT:
            return _view(value.data[1:], value.data[0], dtype)  # a copy: behind the letter nothing is aligned
        if value.code == APART_EXT:
            letter, index = _REFERENCE.unpack(value.data)
            if index == 0:
                raise ValueError("an array refers to buffer 0, which holds no array")
            return _view(payload[index], letter, dtype)
    if type(value) is list and set(map(type, value)) <= NUMBERS:
        return read_only(as_array(value, dtype))
    raise ValueError(f"expected an array of {dtype.name}, found {type(value).__name__}")


def _read_records(value: Any, dtype: np.dtype[Any], payload: Frames) -> np.ndarray[Any, Any]:
    if type(value) is list:
        raise ValueError("expected records in one block, found list")
    octets = read_array(value, _OCTETS, payload)
    if octets.nbytes % dtype.itemsize:
        raise ValueError(f"{octets.nbytes} bytes are no multiple of {dtype.itemsize}, the size of a record")
    return octets.view(dtype)


def _view(data: Any, letter: int, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    if _DTYPES[letter] != dtype:
        raise ValueError(f"expected an array of {dtype.name}, found one of {_DTYPES[letter].name}")
    count, rest = divmod(memoryview(data).nbytes, dtype.itemsize)
    if rest:
        raise ValueError(f"{rest} bytes more than {count} of {dtype.name}")
    return view_of(data, dtype, count, 0)
