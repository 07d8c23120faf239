"""Keeps the garbage collector of Python away from work that makes many objects."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_collection() -> Iterator[None]:
    """While entered, garbage collection is off: for objects without cycles, of which there are so many that searching
    them again and again takes long."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


_MANY = 50_000
"""New objects after which garbage is collected in a short-lived process; by default, 700."""


@contextmanager
def rare_collection() -> Iterator[None]:
    """While entered, garbage is collected seldom; afterwards, this process is to end, and what there is stays.

    This is for commands that end soon. They import tens of thousands of objects, none of which is garbage. Searching
    these repeatedly takes a tenth of the time of a command, and searching them once more at its end another tenth.
    """
    gc.set_threshold(_MANY)
    try:
        yield
    finally:
        gc.freeze()
