"""The page about cameras works as written."""

from __future__ import annotations

from pathlib import Path

import pytest

from .pages import DOCS
from .reader import follow


@pytest.mark.tool  # OpenGL
def test_the_page_works_as_written(tmp_path: Path) -> None:
    assert follow(DOCS / "guides" / "cameras.md", tmp_path) == 10
