"""A row about shared memory: messages of all sizes, some of which are kept, take what is in use and little more."""

from __future__ import annotations

import time
from collections import deque
from pathlib import Path

from robocomp_py.transports.shm.room import prefix

from .laboratory import Laboratory, Remote, until
from .rows import Figure, Result, Row, Run

_CHANNEL = "faults/Conformance/memory"

_MOST = 8_000_000
_CONNECTIONS = 2
"""The queries and commands of the client, and its topic."""

_SLACK = _CONNECTIONS * 4_000_000
_PACE = 0.2
_WINDOW = 10
"""Looks: within so many, memory has to follow what is in use."""

_LINES = 20
"""Of the plot."""


def _of_all_sizes(run: Run) -> Result:
    """Queries, commands and publications of 0 B to 8 MB at random; what receives them keeps up to six at a time."""
    seconds = run.rounds(600, 8)
    with run.laboratory() as laboratory:
        server, client = laboratory.start("server"), laboratory.start("client")
        server.keep(channel=_CHANNEL, places=6, seed=run.seed)
        client.mix(channel=_CHANNEL, seconds=seconds, most=_MOST, seed=run.seed)
        used = _watched(laboratory, [server, client], seconds, run)
        done = client.wait(channel=_CHANNEL, timeout=60.0)
        server.keep_nothing()
        begun = time.monotonic()
        until(lambda: _shared(laboratory) <= _SLACK, 20.0, "memory goes back")
        back = time.monotonic() - begun
        history = laboratory.end()
    figures = [
        Figure("messages", done["sent"]),
        Figure("failed", done["failed"], "", 0),
        Figure("in use at most", max(each[1] for each in used) / 1e6, "MB"),
        Figure("shared memory at most", max(each[2] for each in used) / 1e6, "MB"),
        Figure("more than 1.5 × the memory in use + 8 MB, by", max(each[3] for each in used) / 1e6, "MB", 0),
        Figure("at most 8 MB after", back, "s", 3, timed=True),
    ]
    return Result(figures, run.check(history))


_Look = tuple[float, float, float, float]
"""When; bytes in use at most since a short while; bytes of shared memory; bytes of it beyond the bound."""


def _watched(laboratory: Laboratory, actors: list[Remote], seconds: float, run: Run) -> list[_Look]:
    found: list[_Look] = []
    lately: deque[float] = deque(maxlen=_WINDOW)
    begun = time.monotonic()
    while (at := time.monotonic() - begun) < seconds:
        time.sleep(_PACE)
        shared = _shared(laboratory)
        lately.append(sum(actor.held() for actor in actors))
        beyond = max(0.0, shared - 1.5 * max(lately) - _SLACK)
        found.append((at, max(lately), shared, beyond))
    for line in _plot(found):
        run.tell(line)
    return found


def _plot(found: list[_Look]) -> list[str]:
    """A line for each part of the time: the most that was in use (`#`) and had memory (`-`), a character a MB."""
    step = -(-len(found) // _LINES)
    lines = []
    for first in range(0, len(found), step):
        some = found[first : first + step]
        used, shared = (round(max(each[which] for each in some) / 1e6) for which in (1, 2))
        lines.append(f"{some[0][0]:>5.0f} s {'#' * used}{'-' * (shared - used)} {shared} MB, {used} in use")
    return lines


def _shared(laboratory: Laboratory) -> int:
    """Bytes of shared memory of all its processes."""
    folder = laboratory.folder / "run" / "shm"
    total = 0
    for path in Path("/dev/shm").glob(f"{prefix(folder)}*"):
        try:
            total += path.stat().st_blocks * 512
        except FileNotFoundError:  # it was closed meanwhile
            continue
    return total


ROWS = [
    Row(
        "memory",
        "queries, commands and publications of 0 B to 8 MB at random for ten minutes; receivers keep some",
        "0 failures; shared memory ≤ 1.5 × the messages in use + 4 MB a connection; returned in 3 s",
        ("shm",),
        610,
        _of_all_sizes,
    ),
]
