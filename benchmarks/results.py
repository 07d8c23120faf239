"""The stored results, and what the page on performance shows of them.

`results.json` holds the tables, their findings, and the rows that the figures are drawn from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import figures, goals
from .goals import Finding
from .process import ROOT
from .scale import charts
from .tables import Table, fill

FILE = ROOT / "benchmarks" / "results.json"
PAGE = ROOT / "docs" / "explanation" / "performance.md"
IMAGES = ROOT / "docs" / "images"

DRAWN = ("query", "publish", "peers", "scale")
"""The measurements whose rows are kept for figures."""

SHOWN = ("machine", "summary", "simulation")
"""The tables that the page shows, besides those of a growing network."""


def store(tables: Sequence[Table], findings: Sequence[Finding], rows: Mapping[str, Sequence[Any]]) -> None:
    """Store a whole run."""
    _write(_results(tables, findings, rows))


def replace(tables: Sequence[Table], findings: Sequence[Finding], rows: Mapping[str, Sequence[Any]]) -> None:
    """Store some measurements in place of earlier ones; the others stay. Their tables say which machine, if it was
    another one, and how busy it was.

    The first table is the machine.
    """
    stored, found = load(), _results(tables, findings, rows)
    machine, *new = found["tables"]
    here, there = dict(machine["rows"]), dict(stored["tables"][0]["rows"])
    notes = [f"Measured on another machine: {here['processor']}."] if here["processor"] != there["processor"] else []
    notes += [f"Busy: {here['busy']}."] if "busy" in here else []
    for each in new:
        each["note"] = " ".join(filter(None, (each["note"], *notes)))
    stored["tables"] = _merged(stored["tables"], new, "name")
    stored["findings"] = _merged(stored["findings"], found["findings"], "goal")
    _write({**stored, **{name: found[name] for name in DRAWN if name in found}})


def _results(
    tables: Sequence[Table], findings: Sequence[Finding], rows: Mapping[str, Sequence[Any]]
) -> dict[str, list[dict[str, Any]]]:
    return {
        "tables": [asdict(each) for each in tables],
        "findings": [asdict(each) for each in findings],
        **{name: [asdict(row) for row in rows[name]] for name in DRAWN if name in rows},
    }


def _merged(stored: list[dict[str, Any]], new: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """The new entries, in place of the stored ones of the same name or at the end."""
    names = {each[key] for each in new}
    at = next((number for number, each in enumerate(stored) if each[key] in names), len(stored))
    return [*stored[:at], *new, *(each for each in stored[at:] if each[key] not in names)]


def _write(found: Mapping[str, Any]) -> None:
    FILE.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def load() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return found


def tables(results: Mapping[str, Any]) -> list[Table]:
    """All stored tables; the first is the machine, the last the summary."""
    stored = [
        Table(**{**each, "head": tuple(each["head"]), "rows": [tuple(row) for row in each["rows"]]})
        for each in results["tables"]
    ]
    return [*stored, goals.table([Finding(**each) for each in results["findings"]])]


def files(results: Mapping[str, Any]) -> dict[Path, str]:
    """The page and its figures, as they are to be written."""
    shown = [each for each in tables(results) if each.name in SHOWN or each.name.startswith("scale-")]
    every = figures.drawn(results) | charts.drawn(results.get("scale", []))
    drawn = {IMAGES / name: text for name, text in every.items()}
    return {PAGE: fill(PAGE.read_text(encoding="utf-8"), shown), **drawn}


def publish() -> None:
    """Write the page and its figures from the stored results."""
    for path, text in files(load()).items():
        path.write_text(text, encoding="utf-8")
