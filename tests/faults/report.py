"""The table of what was found, and docs/explanation/fault-matrix.md."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from .rows import Result, Row

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "fault-matrix.md"

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


def write_page(found: Sequence[Found], every: Sequence[Row], seed: int, page: Path = PAGE) -> None:
    """Replace what was found before of the same rows and transports; what was not run stays as it was found then."""
    text = page.read_text()
    before, rest = text.split(_BEGIN, 1)
    old, after = rest.split(_END, 1)
    page.write_text(f"{before}{_BEGIN}\n\n{_section(_read(old), found, every, seed)}\n\n{_END}{after}")


_HEADING = "| row | over | found |"


def _section(known: dict[tuple[str, str], str], found: Sequence[Found], every: Sequence[Row], seed: int) -> str:
    for each in found:
        known[each.row.name, each.transport] = _cell(_summary(each))
    packages = ("pyzmq", "cyclonedds", "eclipse-zenoh", "iceoryx2")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in packages)
    machine = f"{os.cpu_count()} cores, Linux {platform.release().split('-')[0]}, Python {platform.python_version()}"
    lines = [
        "| row | fault | must hold |",
        "|---|---|---|",
        *(f"| {row.name} | {row.fault} | {row.must} |" for row in every),
        "",
        f"Found with {machine}, {versions}; last run: seed {seed}, load average {os.getloadavg()[1]:.0f} at its end.",
        "",
        _HEADING,
        "|---|---|---|",
    ]
    for row in every:
        for transport in row.transports:
            if (row.name, transport) in known:
                lines.append(f"| {row.name} | {transport} | {known[row.name, transport]} |")
    return "\n".join(lines)


def _summary(found: Found) -> str:
    """Its figures, without those that must be 0 and are, and its misses."""
    figures = [str(each) for each in found.result.figures if each.limit != 0 or not each.kept] if found.result else []
    if found.misses:
        figures.append(f"**missed:** {'; '.join(map(_on_the_page, found.misses[:3]))}")
    return "; ".join(figures) or "kept"


def _read(old: str) -> dict[tuple[str, str], str]:
    """What an earlier run wrote."""
    known = {}
    for line in old.partition(_HEADING)[2].splitlines():
        cells = line.strip("|").split(" | ")
        if len(cells) == 3:
            row, transport, summary = (cell.strip() for cell in cells)
            known[row, transport] = summary
    return known


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "/").split())


def _on_the_page(miss: str) -> str:
    """Its first line, without places of the machine that it was found on."""
    return re.sub(r"\S*/\S+", "…", miss.splitlines()[0])[:120]
