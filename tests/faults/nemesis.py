"""When something is done: plans that are the same for the same seed. Pure."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import NamedTuple


class Deed(NamedTuple):
    after: float
    """Seconds since the one before."""
    what: str


def deeds(seed: int, count: int, what: Sequence[str], least: float, most: float) -> Iterator[Deed]:
    """So many deeds of these kinds, with pauses between `least` and `most` seconds, all equally likely."""
    chance = random.Random(seed)
    for _ in range(count):
        yield Deed(chance.uniform(least, most), chance.choice(what))
