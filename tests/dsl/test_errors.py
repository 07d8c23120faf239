"""Every mistake is found where it stands, and nothing else is complained about."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from robocomp_py.dsl.workspace import Workspace

from .announcements import announced, complaint
from .slugs import PACKAGE, slugs_in

HERE = Path(__file__).parent
FILES = sorted(HERE.glob("*/errors/*.*"))
CONVERTED = sorted(HERE.parent.glob("codegen/errors/*/*.idsl"))
"""Those whose mistakes other languages have; they are tested in codegen/test_formats.py."""

SOURCES = [*sorted((PACKAGE / "dsl").rglob("*.py")), *sorted((PACKAGE / "codegen").glob("*.py"))]
SOURCES += [PACKAGE / "innermodel" / "read.py"]
SOURCES += [PACKAGE / "cli" / name for name in ("common.py", "rc.py", "rcgen.py")]

TESTED_ELSEWHERE = {
    "unreadable": "test_unusual_files.py",  # no file under version control can be so
    "too-large": "test_unusual_files.py",
    "unknown-port": "ddsl/test_allow.py",  # they need the components of the network
    "wrong-allow": "ddsl/test_allow.py",
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(HERE)))
def test_a_file_raises_what_it_announces(path: Path, standard_folders_are_empty: None) -> None:
    workspace = Workspace()
    workspace.check(path)
    own = [each for each in workspace.report.diagnostics if each.span.source.path == path]
    shown = "\n".join(each.render() for each in own)
    assert Counter(map(complaint, own)) == announced(path), shown


def test_every_slug_occurs_in_some_file() -> None:
    covered = {code for path in (*FILES, *CONVERTED) for _, _, code in announced(path)} | TESTED_ELSEWHERE.keys()
    produced = slugs_in(SOURCES)
    assert len(produced) > 40
    assert produced - covered == set()


def test_what_is_tested_elsewhere_is_tested_there() -> None:
    assert all(f'"{slug}"' in (HERE / name).read_text() for slug, name in TESTED_ELSEWHERE.items())
