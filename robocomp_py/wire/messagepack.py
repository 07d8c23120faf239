"""Codec `messagepack`: for ZeroMQ, so that a script in any language can call a component.

A payload is a list of buffers: the packed message (see `packing`), then the arrays it refers to.

    sequence of bytes         bin
    other arrays              ext 1: one letter for the dtype, then the little-endian data
    arrays of 64 KiB or more  ext 2: the letter, then uint32 the index of the buffer (from 1) with the data
    records                   like a sequence of bytes: consecutive, each with its fields in order, little-endian,
                              without padding; bool one byte, enumerator int32

The letters are those of Python's `struct`: ? b B h H i I q Q f d. For every array except records, a
list of plain MessagePack numbers is accepted too.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any

from ..contract.types import Struct
from .codec import Decoder, Encoder, unreadable
from .packing import MAX_TREE as MAX_TREE
from .packing import PackArray, check_tree, compile_writer, has_arrays, no_array
from .packing import ReadArray as ReadOwnArray
from .packing import compile_reader as compile_own_reader
from .plain import ReadArray, compile_reader
from .stream import PIECE, SHORT, compile_stream_reader, has_dictionary, unpack_piece

if TYPE_CHECKING:
    import numpy as np


class MessagePack:
    """Self-describing enough for other languages, checked against the contract on both ends."""

    name = "messagepack"

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        return compile_writer(message, partial(_array_packer, snapshot=snapshot))

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        array = _read_array_of(message)
        read = cache(partial(compile_reader, message, array, prefix=prefix))  # made when it is first needed
        stream = cache(partial(compile_stream_reader, message, array, prefix=prefix))
        in_parts = has_dictionary(message, {})

        def decode(payload: list[Any]) -> tuple[Any, ...]:
            try:
                check_tree(payload)
                packed = payload[0]
                if len(packed) > (SHORT if in_parts else PIECE):
                    return stream()(payload)
                return read()(unpack_piece(packed), payload)
            except Exception as exc:
                raise unreadable(message, exc) from exc

        ours = None if prefix else compile_own_reader(message, _array_reader, decode)
        if ours is None:
            read()
        return ours or decode


# These are called for types with arrays, which need numpy. Other messages are read and written without it.


def _array_packer(dtype: np.dtype[Any], *, snapshot: bool) -> PackArray:
    from .packed_arrays import array_packer

    return array_packer(dtype, snapshot=snapshot)


def _array_reader(dtype: np.dtype[Any]) -> ReadOwnArray:
    from .packed_arrays import array_reader

    return array_reader(dtype)


def _read_array_of(message: Struct) -> ReadArray:
    if not has_arrays(message):
        return no_array
    from .packed_arrays import read_array

    return read_array
