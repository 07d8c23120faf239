"""Measures queries if freed memory stays in the process, instead of going back to the kernel each time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .query import Tell
from .rounds import Effort
from .tables import Table, octets, times_as_much, us

SIZES = (1_000_000, 6_000_000)
SETTINGS = {"MALLOC_TRIM_THRESHOLD_": "268435456", "MALLOC_MMAP_THRESHOLD_": "134217728"}
"""Of glibc, read when a process starts."""


@dataclass(frozen=True)
class Row:
    """p50 in µs, with glibc's own settings and with these."""

    middleware: str
    size: int
    ours: float
    raw: float
    ratio: float
    kept_ours: float
    kept_raw: float
    kept_ratio: float


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    chosen = [each for each in middlewares if each != "inproc"]  # which has no raw peer
    if not chosen:
        return []
    tell(f"memory · {', '.join(chosen)} · as it is")
    as_it_is = _queries(chosen, effort, {})
    tell(f"memory · {', '.join(chosen)} · kept")
    kept = _queries(chosen, effort, SETTINGS)
    return [
        Row(before["middleware"], before["size"], *_figures(before), *_figures(after))
        for before, after in zip(as_it_is, kept, strict=True)
    ]


def _queries(middlewares: list[str], effort: Effort, settings: dict[str, str]) -> list[dict[str, Any]]:
    """The result of the benchmark of queries in processes with these settings."""
    with tempfile.TemporaryDirectory(prefix="rc-") as folder:
        file = Path(folder, "found.json")
        command = [sys.executable, "-m", "benchmarks", "--what", "query", "--json", str(file)]
        command += ["--rounds", str(effort.rounds), "--seconds", str(effort.seconds)]
        command += ["--only", ",".join(middlewares), "--sizes", ",".join(map(str, SIZES))]
        environment = {name: value for name, value in os.environ.items() if name not in SETTINGS} | settings
        root = Path(__file__).parents[1]
        subprocess.run(command, check=True, cwd=root, env=environment, stdout=subprocess.DEVNULL)
        found: list[dict[str, Any]] = json.loads(file.read_text())["query"]
        return found


def _figures(row: dict[str, Any]) -> tuple[float, float, float]:
    if row["failure"]:
        raise RuntimeError(row["failure"])
    return row["ours"]["p50"], row["raw"]["p50"], row["ratio"]


def table(rows: list[Row]) -> Table:
    head = ("", "array", "ours p50", "raw p50", "ratio", "ours, kept", "raw, kept", "ratio, kept")
    cells = [
        (
            row.middleware,
            octets(row.size),
            *(us(row.ours), us(row.raw), times_as_much(row.ratio)),
            *(us(row.kept_ours), us(row.kept_raw), times_as_much(row.kept_ratio)),
        )
        for row in rows
    ]
    return Table("memory", "query round trip, when freed memory is kept", head, cells)
