"""Codec `identity`: values stay values, for threads of one process.

What travels is a snapshot (a plain tree and read-only arrays), so that sender and receivers, which
may have been generated separately, share nothing that either could change. An array that is
writable is copied when it is sent; one that is not (a received one, or one frozen by
`array.flags.writeable = False`) travels as it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..contract.types import Struct
from .codec import Decoder, Encoder, as_array, guard_decoder, guard_encoder
from .plain import Frames, compile_planter, compile_reader


class Identity:
    """No bytes, but the same checks as on every wire: what works here works there."""

    name = "identity"

    def encoder(self, message: Struct) -> Encoder:
        plant = compile_planter(message, _freeze)
        return guard_encoder(message, lambda values: plant(values, []))

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        read = compile_reader(message, _same, prefix=prefix)
        return guard_decoder(message, lambda payload: read(payload, []))


def _freeze(value: Any, dtype: np.dtype[Any], frames: Frames) -> np.ndarray[Any, Any]:
    array = as_array(value, dtype)
    if array.flags.writeable:
        array = array.copy() if isinstance(value, np.ndarray | bytearray) else array
        array.flags.writeable = False
    return array


def _same(value: Any, dtype: np.dtype[Any], frames: Frames) -> np.ndarray[Any, Any]:
    if not isinstance(value, np.ndarray) or value.dtype != dtype:
        raise ValueError(f"expected an array of {dtype}, found {type(value).__name__}")
    return value
