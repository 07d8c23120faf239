"""Codec `messagepack`: for ZeroMQ, so that a script in any language can call a component.

A payload is a list of buffers: the packed tree of `plain`, then the arrays it refers to.

    sequence of bytes         bin
    other arrays              ext 1: one letter for the dtype, then the little-endian data
    arrays of 64 KiB or more  ext 2: the letter, then uint32 the index of the buffer (from 1) with the data

The letters are those of Python's `struct`: ? b B h H i I q Q f d. Instead of any of these, an
array of plain MessagePack numbers is accepted.
"""

from __future__ import annotations

import struct
from typing import Any

import msgpack
import numpy as np

from ..contract.types import DTYPES, Struct
from .codec import Decoder, Encoder, check_size, refused, unreadable
from .plain import Frames, compile_planter, compile_reader
from .values import as_array, read_only, snapshot, view_of

APART = 64 * 1024
"""Arrays of so many bytes travel in a buffer of their own."""

INLINE_EXT, APART_EXT = 1, 2
_LETTERS = {dtype: {"bool": "?", "int64": "q", "uint64": "Q"}.get(dtype.name, dtype.char) for dtype in DTYPES.values()}
_DTYPES = {ord(letter): dtype for dtype, letter in _LETTERS.items()}
_REFERENCE = struct.Struct("<BI")
_OCTET = ord("B")
_OCTETS = np.dtype(np.uint8)
_NUMBERS = {bool, int, float}

MAX_TREE = 16 * 1024 * 1024
"""A tree of more bytes is refused: each of them may become an object of many times its size."""

_SHORT = 2 * 1024
"""A tree of fewer bytes cannot make the library allocate much, whatever it claims to hold."""


class MessagePack:
    """Self-describing enough for other languages, checked against the contract on both ends."""

    name = "messagepack"

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        plant = compile_planter(message, _pack_array if snapshot else _share_array)
        packb = msgpack.packb

        def encode(values: tuple[Any, ...]) -> list[Any]:
            try:
                frames: Frames = []
                tree = plant(values, frames)
                payload = [packb(tree), *frames]
                _check_size(payload)
                return payload
            except Exception as exc:
                raise refused(message, values, exc) from exc

        return encode

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        read = compile_reader(message, _read_array, prefix=prefix)
        unpackb = msgpack.unpackb

        def decode(payload: list[Any]) -> tuple[Any, ...]:
            try:
                _check_size(payload)
                if len(payload[0]) > _SHORT:
                    _check_whole(payload[0])
                return read(unpackb(payload[0], strict_map_key=False), payload)
            except Exception as exc:
                raise unreadable(message, exc) from exc

        return decode


def _check_size(payload: list[Any]) -> None:
    if len(payload[0]) > MAX_TREE:
        raise ValueError(f"{len(payload[0])} bytes besides large arrays; a message may have {MAX_TREE}")
    if len(payload) > 1:
        check_size(sum(memoryview(part).nbytes for part in payload))


def _check_whole(packed: Any) -> None:
    """Refuse lists that claim more items than there are: the library would make room for them first."""
    unpacker = msgpack.Unpacker(max_buffer_size=len(packed), strict_map_key=False)
    unpacker.feed(packed)
    unpacker.skip()


def _pack_array(value: Any, dtype: np.dtype[Any], frames: Frames) -> Any:
    array = as_array(value, dtype)
    return _packed(array, dtype) if array.nbytes < APART else _apart(snapshot(array, dtype), dtype, frames)


def _share_array(value: Any, dtype: np.dtype[Any], frames: Frames) -> Any:
    array = as_array(value, dtype)
    return _packed(array, dtype) if array.nbytes < APART else _apart(array, dtype, frames)


def _packed(array: np.ndarray[Any, Any], dtype: np.dtype[Any]) -> Any:
    if dtype == _OCTETS:
        return array.tobytes()
    return msgpack.ExtType(INLINE_EXT, _LETTERS[dtype].encode() + array.tobytes())


def _apart(array: np.ndarray[Any, Any], dtype: np.dtype[Any], frames: Frames) -> Any:
    frames.append(array.data)
    return msgpack.ExtType(APART_EXT, _REFERENCE.pack(ord(_LETTERS[dtype]), len(frames)))


def _read_array(value: Any, dtype: np.dtype[Any], payload: Frames) -> np.ndarray[Any, Any]:
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
    if type(value) is list and set(map(type, value)) <= _NUMBERS:
        return read_only(as_array(value, dtype))
    raise ValueError(f"expected an array of {dtype.name}, found {type(value).__name__}")


def _view(data: Any, letter: int, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    if _DTYPES[letter] != dtype:
        raise ValueError(f"expected an array of {dtype.name}, found one of {_DTYPES[letter].name}")
    count, rest = divmod(memoryview(data).nbytes, dtype.itemsize)
    if rest:
        raise ValueError(f"{rest} bytes more than {count} of {dtype.name}")
    return view_of(data, dtype, count, 0)
