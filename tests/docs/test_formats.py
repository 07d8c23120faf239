"""The page on other people's formats is right: what it says that commands print, they print."""

from __future__ import annotations

from pathlib import Path

import pytest

from .pages import DOCS, Command, steps
from .reader import do

PAGE = DOCS / "guides" / "formats.md"


def needs_a_tool(step: object) -> bool:
    return isinstance(step, Command) and step.text.split()[0] in ("slice2py", "idlc")


def test_the_page_works_as_written(tmp_path: Path) -> None:
    done = [step for step in steps(PAGE) if not needs_a_tool(step)]
    assert len(done) > 10
    for step in done:
        do(step, tmp_path)


@pytest.mark.tool
def test_the_compilers_say_nothing_of_what_the_page_gives_them(tmp_path: Path) -> None:
    done = list(steps(PAGE))
    assert sum(map(needs_a_tool, done)) == 2
    for step in done:
        do(step, tmp_path)
