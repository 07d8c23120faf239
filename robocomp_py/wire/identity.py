"""Codec `identity`: values stay values, for threads of one process.

What travels is a snapshot (a plain tree and read-only arrays), so that sender and receivers, which
may have been generated separately, share nothing that either could change. An array that is
writable is copied when it is sent; a read-only one (a received one, or one frozen by
`array.flags.writeable = False`) is shared.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..contract.types import Struct
from .arrays import snapshot
from .codec import MAX_BYTES, Decoder, Encoder, check_size, refused, unreadable
from .plain import Frames, compile_planter, compile_reader


class Identity:
    """Makes no bytes, but checks every value as on a wire; only the size of texts is not limited."""

    name = "identity"

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:  # values themselves are never shared
        plant = compile_planter(message, _freeze)

        def encode(values: tuple[Any, ...]) -> list[Any]:
            try:
                sizes: Frames = []
                tree = plant(values, sizes)
                if sizes and (size := sum(sizes)) > MAX_BYTES:
                    check_size(size)
                return tree
            except Exception as exc:
                raise refused(message, values, exc) from exc

        return encode

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        read = compile_reader(message, _view, prefix=prefix)

        def decode(payload: Any) -> tuple[Any, ...]:
            try:
                return read(payload, [])
            except Exception as exc:
                raise unreadable(message, exc) from exc

        return decode


def _freeze(value: Any, dtype: np.dtype[Any], sizes: Frames) -> np.ndarray[Any, Any]:
    array = snapshot(value, dtype)
    sizes.append(array.nbytes)
    return array


def _view(value: Any, dtype: np.dtype[Any], frames: Frames) -> np.ndarray[Any, Any]:
    """An array object of the receiver's own: it may reshape it in place."""
    if not isinstance(value, np.ndarray) or (value.dtype is not dtype and value.dtype != dtype):
        raise ValueError(f"expected an array of {dtype.name}, found {type(value).__name__}")
    return value.view()
