"""Every code has a page, and what the pages say is so."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from robocomp_py.dsl.explanations import codes
from tests.dsl.announcements import announced
from tests.dsl.slugs import every_slug
from tests.dsl.test_errors import FILES

from .diagnostics import INDEX, LANGUAGES, PAGES, Page, index, matches, read_pages
from .pages import ROOT

EVERY = read_pages()
OF_ICE = ("no-address",)
"""Those whose examples need Ice for Python."""

EXAMPLES = [pytest.param(page, marks=pytest.mark.tool if page.code in OF_ICE else (), id=page.code) for page in EVERY]


@pytest.mark.parametrize("page", EXAMPLES)
def test_a_wrong_example_yields_what_its_page_says_and_nothing_else(page: Page, tmp_path: Path) -> None:
    output = page.wrong.run(tmp_path)
    assert set(re.findall(r"(?:error|warning)\[[a-z0-9-]+\]", output)) == {f"{page.severity}[{page.code}]"}, output
    assert matches(page.wrong.said, output), f"`make golden` if this is meant:\n{output}"


@pytest.mark.parametrize("page", EXAMPLES)
def test_nothing_is_said_of_a_right_example(page: Page, tmp_path: Path) -> None:
    output = page.right.run(tmp_path)
    assert not re.search(r"(?:error|warning)\[|Traceback", output), output


@pytest.mark.parametrize("page", EVERY, ids=lambda page: page.code)
def test_a_page_has_its_form(page: Page) -> None:
    assert page.path.name == f"{page.code}.md"
    assert set(page.languages) <= set(LANGUAGES)
    assert [*page.languages] == [name for name in LANGUAGES if name in page.languages]
    assert page.wrong.files or page.wrong.commands
    assert page.right.files or page.right.commands


def test_every_code_has_a_page_and_every_page_a_code() -> None:
    pages = {path.stem for path in PAGES.glob("*.md") if path != INDEX}
    slugs = every_slug()
    assert pages - slugs == set()
    assert slugs - pages == set()


def test_a_page_names_every_language_in_which_its_code_occurs() -> None:
    named = {page.code: page.languages for page in EVERY}
    for path in (each for each in FILES if each.suffix != ".txt"):  # which is that of no language
        language = {".scxml": "SMDSL", ".xml": "InnerModel"}.get(path.suffix, path.suffix[1:].upper())
        for _, _, code in announced(path):
            assert language in named[code], f"{path}: {code} occurs in {language}"


def test_the_index_lists_every_page_in_order() -> None:
    assert INDEX.read_text(encoding="utf-8") == index(EVERY), "`make golden` if this is meant"


def test_the_pages_are_shipped_where_they_are_looked_for(tmp_path: Path) -> None:
    [wheel] = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with zipfile.ZipFile(wheel) as archive:
        shipped = [name for name in archive.namelist() if name.startswith("robocomp_py/diagnostics/")]
    assert {Path(name).stem for name in shipped} == {INDEX.stem, *codes()}
