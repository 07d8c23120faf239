"""Frames that are none: what a good one becomes by chance. Pure, and the same for the same seed."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence

_LONGEST = 300


def damaged(seed: int, count: int, good: Sequence[bytes]) -> Iterator[bytes]:
    """So many frames: good ones with changed, missing and additional octets, and others that are nothing but noise.

    A few may be good after all.
    """
    chance = random.Random(seed)
    for _ in range(count):
        yield _damage(chance, bytearray(chance.choice(good)))


def _damage(chance: random.Random, frame: bytearray) -> bytes:
    match chance.randrange(6):
        case 0:
            return chance.randbytes(chance.randrange(_LONGEST))
        case 1:
            return bytes(frame[: chance.randrange(len(frame) + 1)])
        case 2:
            return bytes(frame) + chance.randbytes(chance.randrange(1, _LONGEST))
        case 3:
            at = chance.randrange(len(frame) + 1)
            return bytes(frame[:at]) + chance.randbytes(chance.randrange(1, 9)) + bytes(frame[at:])
        case 4:  # numbers that claim too much
            at = chance.randrange(len(frame) + 1)
            frame[at : at + 4] = chance.choice((b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\0"))
            return bytes(frame)
        case _:
            for _ in range(chance.randrange(1, 5)):
                if frame:
                    frame[chance.randrange(len(frame))] = chance.randrange(256)
            return bytes(frame)
