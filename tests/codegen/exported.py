"""Interfaces written in other languages, for tests."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.codegen.exporting import Files
from robocomp_py.codegen.formats import export
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.workspace import SHIPPED, Workspace

ERRORS = Path(__file__).parent / "errors"
SHIPPED_FILES = sorted(SHIPPED.glob("*.idsl"))


def exported(path: Path, to: str) -> tuple[dict[str, str], Report]:
    """Texts by path, and what is said about the file, whether they can be used or not."""
    workspace = Workspace()
    files = workspace.interface_files(path)
    assert files, "\n".join(each.render() for each in workspace.report.diagnostics)
    report = workspace.report
    artifacts = export(Files(tuple(files)), to, report)
    return {str(each.path): each.text for each in artifacts}, report


def in_format(folder: Path, idsl: str, to: str) -> tuple[dict[str, str], list[str]]:
    """Texts by path, and the codes of what is said, for the text of a file X.idsl."""
    path = folder / "X.idsl"
    path.write_text(idsl, encoding="utf-8")
    texts, report = exported(path, to)
    return texts, [each.code for each in report.diagnostics]
