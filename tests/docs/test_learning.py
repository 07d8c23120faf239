"""The page about agents that learn works as written."""

from __future__ import annotations

from pathlib import Path

from .pages import DOCS
from .reader import follow


def test_the_page_works_as_written(tmp_path: Path) -> None:
    assert follow(DOCS / "guides" / "learning.md", tmp_path) == 5
