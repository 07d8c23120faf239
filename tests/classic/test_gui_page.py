"""The page about Qt is right: its component has a window, and counts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robocomp_py.classic.workers.qt.needs import provided

from ..docs.pages import steps
from ..docs.test_docs import DOCS, do


def test_the_stand_in_has_what_the_page_lists() -> None:
    page = (DOCS / "guides" / "gui.md").read_text()
    table = page.partition("## Without Qt")[2].partition("All of that is there")[0]
    listed: dict[str, list[str]] = {}
    for line in table.splitlines():
        if line.startswith("| `"):
            first, second = re.split(r"(?<!\\)\|", line)[1:3]
            for name in re.findall(r"`(\w+)`", first):
                listed[name] = re.findall(r"`([a-z]\w+)`", second)
    assert {"QTimer", "Signal", "QObject", "QMutex", "QApplication", "Qt"} <= set(listed)
    for name, parts in listed.items():
        assert provided([name]), name
        if name != "Signal":  # what a signal has, its objects have
            assert [part for part in parts if not provided([name, part])] == []


@pytest.mark.tool
def test_the_page_works_as_written(tmp_path: Path) -> None:
    done = list(steps(DOCS / "guides" / "gui.md"))
    assert len(done) == 5
    for step in done:
        do(step, tmp_path, QT_QPA_PLATFORM="offscreen")
