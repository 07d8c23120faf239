"""The page on InnerModel lists the tags that are read."""

from __future__ import annotations

import re

import pytest

from .innermodel import PAGE, filled


def test_the_page_lists_all_tags_and_attributes() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text == filled(text), "`make golden` if this is meant"


def test_the_example_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    said = code.rstrip().rpartition(": ")[2]
    exec(compile(code, str(PAGE), "exec"), {})
    assert capsys.readouterr().out.strip() == said
