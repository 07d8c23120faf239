"""Measures the memory that `shm` allocates for messages of several sizes, and the memory in use.

There is one client and one server. The memory is read after each round, and once more after a pause. A message is in
use from sending until the server drops it.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robocomp_py.testing.parts import blob, command, query
from robocomp_py.transports.base import Reply, Status, TransportConfig
from robocomp_py.transports.shm.room import prefix
from robocomp_py.transports.shm.transport import ShmTransport

from .goals import Finding
from .pair import place
from .query import Tell
from .rounds import Effort
from .tables import Table

LARGE, SMALL, MOST = 5_000_000, 64, 8_000_000
_BURST = 100
_QUIET = 2.5
"""Seconds after which free memory is back."""

_NAME = "shm/Benchmark/memory"


@dataclass(frozen=True)
class Row:
    """In bytes. `used` is the maximum in use, `most` the maximum allocated, `after` the amount allocated at the end."""

    traffic: str
    used: int
    most: int
    after: int

    @property
    def met(self) -> bool:
        return self.most <= 1.5 * self.used + 4_000_000 and self.after <= 4_000_000


def run(effort: Effort, tell: Tell) -> list[Row]:
    traffics: list[tuple[str, Callable[[random.Random], list[int]]]] = [
        (f"1 query of 5 MB, {_BURST} commands of 64 B", lambda chance: [LARGE, *[SMALL] * _BURST]),
        ("queries and commands of 0 B to 8 MB, at random", lambda chance: _sizes(chance)),
    ]
    rows = []
    for what, sizes in traffics:
        tell(f"shared · {what}")
        with place() as here:
            rows.append(_measured(what, sizes, Path(here.folder), effort.rounds))
    return rows


def _sizes(chance: random.Random) -> list[int]:
    return [int(MOST * chance.random() ** 4) for _ in range(5)]


def _measured(what: str, sizes: Callable[[random.Random], list[int]], folder: Path, rounds: int) -> Row:
    chance, used, most = random.Random(1), 0, 0
    client, server = (ShmTransport(TransportConfig(owner=name)) for name in ("client", "server"))
    try:
        server.server(query(_NAME + "q"), lambda payload, _: Reply(Status.OK, blob(server, b"")))
        server.inlet(command(_NAME + "c"), lambda payload: None)
        ask, tell = client.caller(query(_NAME + "q")), client.outlet(command(_NAME + "c"))
        if not (ask.wait_peer(10.0) and tell.wait_peer(10.0)):
            raise RuntimeError("client and server do not find each other")
        for _ in range(10 * rounds):
            first, *others = sizes(chance)
            ask.ask(blob(client, bytes(first)), 10.0)
            for size in others:
                tell.send(blob(client, bytes(size)), 10.0)
            ask.ask(blob(client, b""), 10.0)  # then the commands were taken
            used = max(used, first, sum(others))
            most = max(most, _memory(folder))
        time.sleep(_QUIET)
        return Row(what, used, most, _memory(folder))
    finally:
        client.close()
        server.close()


def _memory(folder: Path) -> int:
    """Bytes of shared memory of the processes of a run-time folder."""
    found = Path("/dev/shm").glob(f"{prefix(folder / 'shm')}*")
    return sum(path.stat().st_blocks * 512 for path in found)


def table(rows: list[Row]) -> Table:
    head = ("traffic", "in use at once", "has memory", f"after {_QUIET:g} s", "goal")
    cells = [
        (
            row.traffic,
            *(f"{size / 1e6:.1f} MB" for size in (row.used, row.most, row.after)),
            f"≤ 1.5 × in use + 4 MB; 4 MB after: {'met' if row.met else 'missed'}",
        )
        for row in rows
    ]
    return Table("shared", "shared memory for messages of several sizes", head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        Finding(
            "shared",
            "shm",
            row.traffic,
            f"{row.most / 1e6:.1f} MB of {row.used / 1e6:.1f} MB",
            row.met,
            value=row.most / row.used,
        )
        for row in rows
    ]
