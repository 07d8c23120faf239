"""Values handed over within one process: values that cannot change are not copied."""

from __future__ import annotations

import numpy as np

from robocomp_py.contract.types import FLOAT64, UINT8, Sequence
from robocomp_py.wire.identity import Identity

from .codecs import one

CODEC = Identity()
MESSAGE = one(Sequence(FLOAT64))


def hand_over(
    array: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    (received,) = CODEC.decoder(MESSAGE)(CODEC.encoder(MESSAGE)((array,)))
    assert isinstance(received, np.ndarray)
    return received


def test_a_frozen_array_is_shared() -> None:
    frozen = np.arange(5.0)
    frozen.flags.writeable = False
    assert np.shares_memory(hand_over(frozen), frozen)


def test_a_received_array_that_is_sent_on_is_shared() -> None:
    received = hand_over(np.arange(5.0))
    assert np.shares_memory(hand_over(received), received)
    assert np.shares_memory(hand_over(received[1:3]), received)


def test_bytes_are_shared() -> None:
    message, octets = one(Sequence(UINT8)), b"octets"
    (received,) = CODEC.decoder(message)(CODEC.encoder(message)((octets,)))
    assert np.shares_memory(received, np.frombuffer(octets, np.uint8))


def test_a_writable_array_is_copied() -> None:
    base = np.arange(5.0)
    view = base[:]
    view.flags.writeable = False
    for array in (base, view, base[::2], np.frombuffer(bytearray(base.tobytes()))):
        assert not np.shares_memory(hand_over(array), array)


def test_receivers_share_one_copy() -> None:
    payload = CODEC.encoder(MESSAGE)((np.arange(5.0),))
    decode = CODEC.decoder(MESSAGE)
    (first,), (second,) = decode(payload), decode(payload)
    assert np.shares_memory(first, second)
