"""Errors, warnings and hints of an open file.

In addition to `rc lint` there are hints about unused imports and about imports with errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ..dsl.diagnostics import Diagnostic, Severity
from ..dsl.source import Span
from .index import Index
from .project import Project, real

UNUSED_IMPORT = "unused-import"
BROKEN_IMPORT = "broken-import"


def complaints(project: Project, path: Path) -> list[Diagnostic]:
    found = project.check(path)
    own = [each for each in found if each.span.source.path == path]
    elsewhere = [each for each in found if each.span.source.path != path and each.severity is Severity.ERROR]
    own += [_seen_from(path, each) for each in found if _concerns(path, each)]
    if elsewhere:
        own += _broken_imports(Index(project), path, elsewhere)
    if any(each.severity is Severity.ERROR for each in found):
        return own  # an error may hide the use of an import
    return [*own, *_unused_imports(Index(project), path)]


def _concerns(path: Path, complaint: Diagnostic) -> bool:
    """Whether a diagnostic of another file, a component's Python, belongs to a place in this one."""
    return complaint.span.source.path != path and any(span.source.path == path for _, span in complaint.related)


def _seen_from(path: Path, complaint: Diagnostic) -> Diagnostic:
    """A diagnostic of another file, moved to the place in this one that it belongs to."""
    [here, *_] = [span for _, span in complaint.related if span.source.path == path]
    related = (("told of this", complaint.span), *(each for each in complaint.related if each[1] != here))
    return replace(complaint, span=here, related=related)


def _unused_imports(index: Index, path: Path) -> Iterator[Diagnostic]:
    for link in index.unused_imports(path):
        message = f"nothing of `{link.name}` is used here"
        yield Diagnostic(UNUSED_IMPORT, message, link.name.span, Severity.INFO, "remove it")


def _places(complaint: Diagnostic) -> list[Span]:
    return [complaint.span, *(span for _, span in complaint.related)]


def _broken_imports(index: Index, path: Path, errors: list[Diagnostic]) -> Iterator[Diagnostic]:
    """A hint for each import that has errors, directly or in its own imports: its names may be missing here."""
    made = index.outline(path)
    for link in made.links if made else ():
        target = index.target(link)
        brought = {real(each.source.path) for each in index.closure(target)} | {real(target)} if target else set()
        wrong = [each for each in errors if brought & {real(span.source.path) for span in _places(each)}]
        if wrong:
            related = tuple((each.message, each.span) for each in wrong[:1])
            message = f"there are mistakes in what `{link.name}` brings"
            yield Diagnostic(BROKEN_IMPORT, message, link.name.span, Severity.INFO, related=related)
