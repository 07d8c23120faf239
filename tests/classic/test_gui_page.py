"""The page about Qt is right: its component has a window, and counts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robocomp_py.classic.workers.qt.needs import provided

from ..docs.pages import DOCS, steps
from ..docs.reader import do


def test_the_stand_in_has_what_the_page_names() -> None:
    page = (DOCS / "guides" / "gui.md").read_text()
    sentence = page.partition("It has ")[2].partition("They can be imported")[0]
    named = re.findall(r"`(\w+)`", sentence)
    assert {"QTimer", "Signal", "QObject", "Qt", "pyqtSlot"} <= set(named)
    assert [name for name in named if not provided([name])] == []


@pytest.mark.tool
def test_the_page_works_as_written(tmp_path: Path) -> None:
    done = list(steps(DOCS / "guides" / "gui.md"))
    assert len(done) == 5
    for step in done:
        do(step, tmp_path, QT_QPA_PLATFORM="offscreen")
