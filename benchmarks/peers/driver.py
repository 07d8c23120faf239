"""What the programs of all frameworks have in common. Nothing but numpy is needed: some run on another Python.

The near end connects to a socket in its folder, and is told in lines how large an array to send, and
how many times; it answers each with a list of seconds, in JSON. When the connection ends, so does it.
"""

from __future__ import annotations

import json
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[np.uint8]]
Ask = Callable[[Array], Array]

MEETING = "near.sock"
"""In the folder of a party, where who measures listens."""


def drive(ask: Ask, folder: str) -> None:
    """Measure on request, until the connection ends."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(f"{folder}/{MEETING}")
        with connection.makefile("rw") as lines:
            for line in lines:
                size, count = map(int, line.split())
                print(json.dumps(_round_trips(ask, size, count)), file=lines, flush=True)


def _round_trips(ask: Ask, size: int, count: int) -> list[float]:
    data = np.random.default_rng(size).integers(0, 256, size, np.uint8)
    if not np.array_equal(ask(data), data):
        raise ValueError("the answer is not what was asked")
    taken, now = [], time.perf_counter
    for _ in range(count):
        begun = now()
        ask(data)
        taken.append(now() - begun)
    return taken


def until_told() -> None:
    """For a far end: until who started it closes its standard input, or has gone."""
    sys.stdin.buffer.read()


def main(**ends: Callable[..., None]) -> None:
    """Run the end that the command line names, with what else stands there."""
    end, *arguments = sys.argv[1:]
    ends[end](*arguments)
