"""The stored results of a whole run, and what the page on performance shows of them.

`results.json` holds the tables of the run, its findings, and the rows that the figures are drawn from.
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
from .tables import Table, fill

FILE = ROOT / "benchmarks" / "results.json"
PAGE = ROOT / "docs" / "explanation" / "performance.md"
IMAGES = ROOT / "docs" / "images"

DRAWN = ("query", "publish", "peers")
"""The measurements whose rows are kept for figures."""


def store(tables: Sequence[Table], findings: Sequence[Finding], rows: Mapping[str, Sequence[Any]]) -> None:
    results = {
        "tables": [asdict(each) for each in tables],
        "findings": [asdict(each) for each in findings],
        **{name: [asdict(row) for row in rows[name]] for name in DRAWN},
    }
    FILE.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def load() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return found


def tables(results: Mapping[str, Any]) -> list[Table]:
    """All tables of the stored run; the first is the machine, the last the summary."""
    stored = [Table(**{**each, "rows": [tuple(row) for row in each["rows"]]}) for each in results["tables"]]
    return [*stored, goals.table([Finding(**each) for each in results["findings"]])]


def files(results: Mapping[str, Any]) -> dict[Path, str]:
    """The page and its figures, as they are to be written."""
    shown = [each for each in tables(results) if each.name in ("machine", "summary")]
    drawn = {IMAGES / name: text for name, text in figures.drawn(results).items()}
    return {PAGE: fill(PAGE.read_text(encoding="utf-8"), shown), **drawn}


def publish() -> None:
    """Write the page and its figures from the stored results."""
    for path, text in files(load()).items():
        path.write_text(text, encoding="utf-8")
