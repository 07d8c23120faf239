"""Noise that depends on a seed, a node, a quantity and a tick.

It does not depend on the caller, on how often it is asked, or on the order.

The generator is Philox, whose numbers are a function of a key and a counter (Salmon et al., "Parallel random numbers:
as easy as 1, 2, 3", SC 2011). The key is a hash of the names, and the counter is the tick.
"""

from __future__ import annotations

import hashlib

import numpy as np

from ..innermodel.axes import Array


def normal(seed: int, node: str, quantity: str, tick: int, count: int) -> Array:
    """Numbers of mean 0 and standard deviation 1, shape (count,); always the same for the same arguments."""
    text = f"{seed}\0{node}\0{quantity}".encode()
    key = int.from_bytes(hashlib.blake2b(text, digest_size=16).digest(), "little")
    return np.random.Generator(np.random.Philox(key=key, counter=tick << 64)).standard_normal(count)
