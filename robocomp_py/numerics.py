"""Loads numpy without threads for linear algebra, for programs that do none."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

_THREADS = "OPENBLAS_NUM_THREADS"


@contextmanager
def one_thread() -> Iterator[None]:
    """While entered, an import of numpy starts no threads, unless the user has chosen their number.

    By default, OpenBLAS starts a thread for each further processor, and each of them is busy for about 25 ms before it
    sleeps. Processes that are started while this is entered start no
    threads either.
    """
    if _THREADS in os.environ:
        yield
        return
    os.environ[_THREADS] = "1"
    try:
        yield
    finally:
        os.environ.pop(_THREADS, None)
