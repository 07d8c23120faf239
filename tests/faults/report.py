"""The table of what was found, and docs/reliability.md."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from .rows import Result, Row

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"

_BEGIN, _END = "<!-- written by `make faults` -->", "<!-- end of what `make faults` writes -->"


class Found(NamedTuple):
    row: Row
    transport: str
    result: Result | None
    """None if it could not be run to its end; `why` says what happened."""
    why: str
    seconds: float
    timed: bool

    @property
    def misses(self) -> list[str]:
        return [self.why] if self.result is None else self.result.misses(self.timed)


def table(found: Sequence[Found]) -> str:
    """For a terminal."""
    lines = [f"{'row':<12}{'over':<9}{'':<8}{'s':>5}  found"]
    for each in found:
        verdict = "MISSED" if each.misses else "kept"
        figures = "; ".join(map(str, each.result.figures)) if each.result else ""
        lines.append(f"{each.row.name:<12}{each.transport:<9}{verdict:<8}{each.seconds:>5.0f}  {figures}")
        lines += [f"{'':<34}{miss}" for miss in each.misses[:5]]
        if len(each.misses) > 5:
            lines.append(f"{'':<34}and {len(each.misses) - 5} more")
    return "\n".join(lines)


def write_page(found: Sequence[Found], seed: int, page: Path = PAGE) -> None:
    """Replace what was found before of the same rows and transports; what was not run stays as it was found then."""
    text = page.read_text()
    before, rest = text.split(_BEGIN, 1)
    old, after = rest.split(_END, 1)
    rows = _rows(old)
    machine = f"{os.cpu_count()} cores, Linux {platform.release().split('-')[0]}, Python {platform.python_version()}"
    for each in found:
        figures = "; ".join(map(str, each.result.figures)) if each.result else ""
        missed = "<br>".join(each.misses[:3])
        verdict = f"**missed**: {missed}" if each.misses else "kept"
        must = each.row.must
        rows[each.row.name, each.transport] = (
            f"| {each.row.fault} | {must} | {each.transport} | {figures} | {verdict} |"
        )
    versions = ", ".join(
        f"{name} {metadata.version(name)}" for name in ("pyzmq", "cyclonedds", "eclipse-zenoh", "iceoryx2")
    )
    lines = [
        _BEGIN,
        "",
        f"Found on a machine with {machine}, with {versions}; seed {seed}.",
        "",
        "| fault | must hold | over | found | |",
        "|---|---|---|---|---|",
        *(f"{line} <!-- {name} {transport} -->" for (name, transport), line in rows.items()),
        "",
    ]
    page.write_text(before + "\n".join(lines) + _END + after)


def _rows(old: str) -> dict[tuple[str, str], str]:
    rows = {}
    for line in old.splitlines():
        if line.startswith("| ") and line.endswith("-->"):
            text, _, named = line.removesuffix(" -->").rpartition(" <!-- ")
            name, _, transport = named.partition(" ")
            rows[name, transport] = text
    return rows
