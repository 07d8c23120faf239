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
from ..errors import DecodeError, EncodeError
from .codec import MAX_BYTES, Decoder, Encoder, as_array, guard_decoder, guard_encoder, read_only, view_of
from .plain import Frames, compile_planter, compile_reader

APART = 64 * 1024
"""Arrays of so many bytes travel in a buffer of their own."""

INLINE_EXT, APART_EXT = 1, 2
_LETTERS = {dtype: {"bool": "?", "int64": "q", "uint64": "Q"}.get(dtype.name, dtype.char) for dtype in DTYPES.values()}
_DTYPES = {ord(letter): dtype for dtype, letter in _LETTERS.items()}
_REFERENCE = struct.Struct("<BI")


class MessagePack:
    """Self-describing enough for other languages, checked against the contract on both ends."""

    name = "messagepack"

    def encoder(self, message: Struct) -> Encoder:
        plant = compile_planter(message, _pack_array)
        packb = msgpack.packb

        def encode(values: tuple[Any, ...]) -> list[Any]:
            frames: Frames = []
            tree = plant(values, frames)
            payload = [packb(tree), *frames]
            if frames or len(payload[0]) > MAX_BYTES:
                _refuse_oversize(message, payload)
            return payload

        return guard_encoder(message, encode)

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        read = compile_reader(message, _read_array, prefix=prefix)
        unpackb = msgpack.unpackb

        def decode(payload: list[Any]) -> tuple[Any, ...]:
            return read(unpackb(payload[0], strict_map_key=False), payload)

        return guard_decoder(message, decode)


def _refuse_oversize(message: Struct, payload: list[Any]) -> None:
    size = sum(memoryview(part).nbytes for part in payload)
    if size > MAX_BYTES:
        raise EncodeError(f"{message.name}: {size} bytes; a message may have {MAX_BYTES}")


def _pack_array(value: Any, dtype: np.dtype[Any], frames: Frames) -> Any:
    array = as_array(value, dtype)
    if array.nbytes >= APART:
        frames.append(array.data)
        return msgpack.ExtType(APART_EXT, _REFERENCE.pack(ord(_LETTERS[dtype]), len(frames)))
    if dtype == np.uint8:
        return array.tobytes()
    return msgpack.ExtType(INLINE_EXT, _LETTERS[dtype].encode() + array.tobytes())


def _read_array(value: Any, dtype: np.dtype[Any], payload: Frames) -> np.ndarray[Any, Any]:
    if type(value) is bytes:
        return _view(value, _DTYPES[ord("B")], dtype, 0)
    if type(value) is msgpack.ExtType:
        if value.code == INLINE_EXT:
            return _view(value.data, _DTYPES[value.data[0]], dtype, 1)
        if value.code == APART_EXT:
            letter, index = _REFERENCE.unpack(value.data)
            if index == 0:
                raise DecodeError("an array refers to buffer 0, which holds no array")
            return _view(payload[index], _DTYPES[letter], dtype, 0)
    if type(value) is list:
        return read_only(as_array(value, dtype))
    raise DecodeError(f"expected an array of {dtype.name}, found {type(value).__name__}")


def _view(data: Any, found: np.dtype[Any], expected: np.dtype[Any], offset: int) -> np.ndarray[Any, Any]:
    if found != expected:
        raise DecodeError(f"expected an array of {expected.name}, found one of {found.name}")
    return view_of(data, expected, (memoryview(data).nbytes - offset) // expected.itemsize, offset)
