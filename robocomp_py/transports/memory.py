"""Memory of large messages."""

from __future__ import annotations

from functools import cache

KEPT = 32 * 1024 * 1024
"""Bytes that a process keeps for large messages, instead of requesting them for each."""


@cache
def keep_memory() -> None:
    """Have the C library keep the memory of large messages for later ones. Once per process.

    glibc returns free memory beyond twice the largest block that it has mapped. Getting it again is the
    largest cost of a message of a megabyte. So this maps a large block once, and never touches it.
    """
    bytes(KEPT // 2)
