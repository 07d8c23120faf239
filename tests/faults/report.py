"""The table of what was found, and docs/explanation/fault-matrix.md."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator, Sequence
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


_MATRIX, _ALONE = "| row | figure |", "| row | over | found |"

Findings = dict[str, str]
"""Of one row over one transport: by the name of each figure, its value and limit; other text by an empty name."""


def _section(known: dict[tuple[str, str], Findings], found: Sequence[Found], every: Sequence[Row], seed: int) -> str:
    for each in found:
        known[each.row.name, each.transport] = _findings(each)
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
        *_over_all(known, [row for row in every if len(row.transports) > 1]),
        "",
        *_over_one(known, [row for row in every if len(row.transports) == 1]),
    ]
    return "\n".join(lines)


def _over_all(known: dict[tuple[str, str], Findings], rows: Sequence[Row]) -> Iterator[str]:
    """A table with a column for each transport."""
    transports = list(dict.fromkeys(each for row in rows for each in row.transports))
    yield f"{_MATRIX} {' | '.join(transports)} |"
    yield "|---|---|" + "---|" * len(transports)
    for row in rows:
        findings = [known.get((row.name, transport), {}) for transport in transports]
        for name in dict.fromkeys(name for each in findings for name in each):
            cells = [each.get(name, "") for each in findings]
            limits = {_LIMIT.search(cell) for cell in cells if cell}
            texts = {limit[0] if limit else "" for limit in limits}
            if len(texts) == 1 and (common := texts.pop()):
                name, cells = name + common, [cell.removesuffix(common) for cell in cells]
            yield "".join(f"| {cell} " if cell else "| " for cell in (row.name, name, *cells)) + "|"


_LIMIT = re.compile(r" \(≤ [^()]*\)$")


def _over_one(known: dict[tuple[str, str], Findings], rows: Sequence[Row]) -> Iterator[str]:
    """A table of the rows that concern one transport."""
    yield _ALONE
    yield "|---|---|---|"
    for row in rows:
        for transport in row.transports:
            if findings := known.get((row.name, transport)):
                text = "; ".join(f"{name} {found}".strip() for name, found in findings.items())
                yield f"| {row.name} | {transport} | {text} |"


def _findings(found: Found) -> Findings:
    """Figures that have a limit, without those that must be 0 and are, and what else was missed."""
    if found.result is None:
        return {"": f"**missed:** {_on_the_page(found.why)}"}
    findings = {
        each.name: f"{'' if each.kept or (each.timed and not found.timed) else '**missed:** '}{_cell(each.found)}"
        for each in found.result.figures
        if each.limit or not each.kept
    }
    if found.result.violations:
        findings[""] = "**missed:** " + "; ".join(_on_the_page(str(each)) for each in found.result.violations[:3])
    return findings or {"": "kept"}


def _read(old: str) -> dict[tuple[str, str], Findings]:
    """What an earlier run wrote."""
    known: dict[tuple[str, str], Findings] = {}
    head: list[str] = []
    for line in old.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith((_MATRIX, _ALONE)):
            head = cells
        elif not line.startswith("|"):
            head = []
        elif head[1:2] == ["over"] and not line.startswith("|-"):
            known[cells[0], cells[1]] = {"": cells[2]}
        elif head and not line.startswith("|-"):
            limit = _LIMIT.search(cells[1])
            for transport, cell in zip(head[2:], cells[2:], strict=True):
                if cell:
                    findings = known.setdefault((cells[0], transport), {})
                    findings[_LIMIT.sub("", cells[1])] = cell + (limit[0] if limit else "")
    return known


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "/").split())


def _on_the_page(miss: str) -> str:
    """Its first line, without places of the machine that it was found on."""
    return re.sub(r"\S*/\S+", "…", miss.splitlines()[0])[:120]
