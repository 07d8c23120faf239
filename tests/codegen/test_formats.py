"""What holds for every language of others: what it cannot hold is said where it stands, and files fit together."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from robocomp_py import plugins

from ..dsl.announcements import announced, complaint
from .exported import ERRORS, SHIPPED_FILES, exported
from .generated import MODELS

FORMATS = plugins.exporters()


@pytest.mark.parametrize("path", sorted(ERRORS.glob("*/*.idsl")), ids=lambda path: str(path.relative_to(ERRORS)))
def test_a_file_raises_what_it_announces(path: Path) -> None:
    _, report = exported(path, path.parent.name)
    shown = "\n".join(each.render() for each in report.diagnostics)
    assert Counter(map(complaint, report.diagnostics)) == announced(path), shown


@pytest.mark.parametrize("to", FORMATS)
@pytest.mark.parametrize("path", SHIPPED_FILES, ids=lambda path: path.stem)
def test_what_is_shipped_can_be_written_in_every_format(path: Path, to: str) -> None:
    texts, report = exported(path, to)
    assert texts
    assert report.errors == []


@pytest.mark.parametrize("to", FORMATS)
def test_a_file_does_not_depend_on_its_importer(to: str) -> None:
    alone, _ = exported(MODELS / "Shapes.idsl", to)
    together, _ = exported(MODELS / "Everything.idsl", to)
    assert alone.items() <= together.items()
    assert len(alone) < len(together)
