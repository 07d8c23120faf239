"""Files with mistakes: those of the tests of the languages, and the wrong examples of the pages about codes."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

from robocomp_py.dsl.workspace import ENDINGS
from tests.docs.diagnostics import read_pages
from tests.dsl.test_errors import FILES, HERE


def write_examples(folder: Path) -> list[str]:
    """All of them, each with the files around it; their names."""
    return [*_files_of_tests(folder), *_files_of_pages(folder)]


def _files_of_tests(folder: Path) -> Iterator[str]:
    for each in sorted({path.parent for path in FILES}):
        shutil.copytree(each, folder / each.relative_to(HERE), dirs_exist_ok=True)
    yield from (str(path.relative_to(HERE)) for path in FILES if _is_utf8(path))


def _files_of_pages(folder: Path) -> Iterator[str]:
    for page in read_pages():
        for each in page.wrong.files:
            each.write(folder / "pages" / page.code)
            if each.name.endswith(ENDINGS) and not each.saved:
                yield f"pages/{page.code}/{each.name}"


def _is_utf8(path: Path) -> bool:
    """An editor does not show others as they are."""
    try:
        path.read_bytes().decode()
    except UnicodeDecodeError:
        return False
    return path.name.endswith(ENDINGS)
