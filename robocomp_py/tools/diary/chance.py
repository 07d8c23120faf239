"""What code reads besides its messages: clocks and chance.

Clocks are read through functions of the module `time`. While a diary is written, or a component runs again, those that
the code of a component calls are observed. What it has imported by `from time import …` is not.
"""

from __future__ import annotations

import contextlib
import inspect
import random
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

CLOCKS = ("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns")

Read = Callable[[str, Callable[[], Any]], Any]
"""Gets the name of a clock and the function that reads it; returns what the code is given."""


class _Here(threading.local):
    read: Read | None = None
    """Set while code of a component runs on this thread."""


here = _Here()

_changing = threading.Lock()
_observers = 0


@contextlib.contextmanager
def observed_clocks() -> Iterator[None]:
    """While this is entered, `here.read` is asked for the time that code of a component reads."""
    global _observers
    with _changing:
        _observers += 1
        if _observers == 1:
            for name in CLOCKS:
                setattr(time, name, _observed(f"time.{name}", getattr(time, name)))
    try:
        yield
    finally:
        with _changing:
            _observers -= 1
            if not _observers:
                for name in CLOCKS:
                    setattr(time, name, getattr(time, name).__wrapped__)


def _observed(name: str, original: Callable[[], Any]) -> Callable[[], Any]:
    def read() -> Any:
        observe = here.read
        return original() if observe is None or _is_ours(inspect.currentframe()) else observe(name, original)

    read.__wrapped__ = original  # type: ignore[attr-defined]  # functions take any attribute
    return read


def _is_ours(reading: FrameType | None) -> bool:
    """Whether the framework or the log asks, and not the code of a component. `reading` is the frame that it calls."""
    asking = reading.f_back if reading else None
    name = str(asking.f_globals.get("__name__", "")) if asking else ""
    return name == "logging" or name.startswith("robocomp_py.")


@contextlib.contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Seeds `random`, `numpy.random`, and the generators that `numpy.random.default_rng()` makes while entered."""
    import numpy as np
    from numpy.random import bit_generator

    generators: Any = bit_generator
    before = generators.randbits
    random.seed(seed)
    np.random.seed(seed & 0xFFFFFFFF)
    generators.randbits = random.Random(seed).getrandbits
    try:
        yield
    finally:
        generators.randbits = before
