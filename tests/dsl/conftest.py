"""What the tests of the languages share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def standard_folders_are_empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Imports are found beside the importing file and among the shipped interfaces only."""
    monkeypatch.setenv("HOME", str(tmp_path / "nobody"))
    monkeypatch.delenv("ROBOCOMP", raising=False)
    monkeypatch.delenv("ROBOCOMP_INTERFACES", raising=False)
