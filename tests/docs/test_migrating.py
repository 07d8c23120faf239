"""The page for who comes from RoboComp is right: what it says that commands print, they print."""

from __future__ import annotations

from pathlib import Path

from .pages import steps
from .test_docs import DOCS, do


def test_the_page_works_as_written(tmp_path: Path) -> None:
    done = list(steps(DOCS / "migrating.md"))
    assert len(done) > 4
    for step in done:
        do(step, tmp_path)
