"""Memory of large messages."""

from __future__ import annotations

from functools import cache

KEPT = 32 * 1024 * 1024
"""Bytes that a process keeps for large messages after the first ones, rather than ask for them with each."""


@cache
def keep_memory() -> None:
    """Have the C library keep what large messages free, for the next ones. Once per process.

    glibc gives memory back beyond twice the largest block that it once mapped for itself, and getting
    it again costs more than all else about a message of a megabyte. So we map one, and never touch it.
    """
    bytes(KEPT // 2)
