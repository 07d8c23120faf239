"""Every mistake is found where it stands, and nothing else is complained about."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import robocomp_py
from robocomp_py.dsl.workspace import Workspace

from .announcements import announced, complaint

HERE = Path(__file__).parent
FILES = sorted(HERE.glob("*/errors/*.*"))

PACKAGE = Path(robocomp_py.__file__).parent
SOURCES = [*sorted((PACKAGE / "dsl").rglob("*.py")), *sorted((PACKAGE / "codegen").glob("*.py"))]
SOURCES += [PACKAGE / "cli" / name for name in ("common.py", "rc.py", "rcgen.py")]

SLUG_AT = {"error": 0, "warning": 0, "_error": 0, "Diagnostic": 0, "_find": 1, "_check_names": 2}
"""Which argument of a call is a slug."""

TESTED_ELSEWHERE = {"unreadable", "too-large"}
"""In test_unusual_files.py: no file under version control can be so."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(HERE)))
def test_a_file_raises_what_it_announces(path: Path, standard_folders_are_empty: None) -> None:
    workspace = Workspace()
    workspace.check(path)
    own = [each for each in workspace.report.diagnostics if each.span.source.path == path]
    shown = "\n".join(each.render() for each in own)
    assert Counter(map(complaint, own)) == announced(path), shown


def test_every_slug_occurs_in_some_file() -> None:
    covered = {code for path in FILES for _, _, code in announced(path)} | TESTED_ELSEWHERE
    produced = {slug for path in SOURCES for slug in slugs_of(path)}
    assert len(produced) > 40
    assert produced - covered == set()


def test_what_is_tested_elsewhere_is_tested_there() -> None:
    text = (HERE / "test_unusual_files.py").read_text()
    assert all(f'"{slug}"' in text for slug in TESTED_ELSEWHERE)


def slugs_of(path: Path) -> Iterator[str]:
    """The slugs that a module can produce."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            at = SLUG_AT.get(name, len(node.args))
            slug = node.args[at] if at < len(node.args) else None
            if isinstance(slug, ast.Constant) and isinstance(slug.value, str) and " " not in slug.value:
                yield slug.value
