"""Noise that depends on a seed, a node, a quantity and a tick.

It does not depend on the caller, on how often it is asked, or on the order.

The generator is Philox, whose numbers are a function of a key and a counter (Salmon et al., "Parallel random numbers:
as easy as 1, 2, 3", SC 2011). The key is a hash of the names, and the counter is the tick.
"""

from __future__ import annotations

import hashlib
import threading
from functools import lru_cache
from typing import Any

import numpy as np

from ..innermodel.axes import Array


def normal(seed: int, node: str, quantity: str, tick: int, count: int) -> Array:
    """Numbers of mean 0 and standard deviation 1, shape (count,); always the same for the same arguments."""
    return _OWN.at(_key(seed, node, quantity), tick).standard_normal(count)


def normals(seed: int, node: str, quantity: str, ticks: range, count: int) -> Array:
    """Those of several ticks, shape (len(ticks), count); in less time than one after the other."""
    own, key = _OWN, _key(seed, node, quantity)
    made = np.empty((len(ticks), count))
    for row, tick in zip(made, ticks, strict=True):
        own.at(key, tick).standard_normal(out=row)
    return made


@lru_cache(maxsize=4096)
def _key(seed: int, node: str, quantity: str) -> tuple[int, int]:
    digest = hashlib.blake2b(f"{seed}\0{node}\0{quantity}".encode(), digest_size=16).digest()
    return int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:], "little")


class _Generator(threading.local):
    """A generator for each thread. A new one for each key and tick would take ten times as long."""

    def __init__(self) -> None:
        self._philox = np.random.Philox(0)
        self._generator = np.random.Generator(self._philox)
        self._counter, self._key = [0, 0, 0, 0], [0, 0]
        whole = self._philox.state
        # Lists, since numpy reads its own arrays number by number, which takes three times as long.
        state = {"counter": self._counter, "key": self._key}
        self._state: Any = {**whole, "state": state, "buffer": whole["buffer"].tolist()}

    def at(self, key: tuple[int, int], tick: int) -> np.random.Generator:
        """The generator, at the beginning of the numbers of a tick."""
        self._key[:] = key
        self._counter[1] = tick
        self._philox.state = self._state
        return self._generator


_OWN = _Generator()
