"""The guides to simulated scenes do what they say."""

from __future__ import annotations

from pathlib import Path

from .pages import ROOT, steps
from .reader import do


def test_the_guide_to_scenes_works_as_written(tmp_path: Path) -> None:
    done = list(steps(ROOT / "docs" / "guides" / "scenes.md"))
    assert len(done) > 2
    for step in done:
        do(step, tmp_path)
