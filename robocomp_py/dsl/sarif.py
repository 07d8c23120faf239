"""Diagnostics as SARIF 2.1.0, a format for code review tools."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ..version import __version__
from .diagnostics import Diagnostic, Severity
from .explanations import explanation, meaning, severity, summary
from .source import Span

_SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
_ROOT = "%SRCROOT%"

_LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "note"}


def to_sarif(diagnostics: Sequence[Diagnostic], root: Path) -> dict[str, Any]:
    """A log of one run. Files are named relative to `root`, if they are below it."""
    rules = {code: number for number, code in enumerate(sorted({each.code for each in diagnostics}))}
    driver = {
        "name": "rc lint",
        "organization": "robocomp_py",
        "version": __version__,
        "rules": [_rule(code) for code in rules],
    }
    run = {
        "tool": {"driver": driver},
        "invocations": [{"executionSuccessful": True}],
        "originalUriBaseIds": {_ROOT: {"uri": f"{root.resolve().as_uri()}/"}},
        "columnKind": "unicodeCodePoints",
        "results": [_result(each, rules[each.code], root) for each in diagnostics],
    }
    return {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}


def _rule(code: str) -> dict[str, Any]:
    page = explanation(code)
    if not page:
        return {"id": code}
    return {
        "id": code,
        "shortDescription": {"text": summary(page)},
        "fullDescription": {"text": meaning(page)},
        "defaultConfiguration": {"level": severity(page)},
        "help": {"text": page, "markdown": page},
    }


def _result(diagnostic: Diagnostic, rule: int, root: Path) -> dict[str, Any]:
    said = [diagnostic.message, diagnostic.hint]
    result = {
        "ruleId": diagnostic.code,
        "ruleIndex": rule,
        "level": _LEVELS[diagnostic.severity],
        "message": {"text": "; ".join(filter(None, said))},
        "locations": [{"physicalLocation": _place(diagnostic.span, root)}],
    }
    related = [
        {"id": number, "message": {"text": text}, "physicalLocation": _place(span, root)}
        for number, (text, span) in enumerate(diagnostic.related)
    ]
    return {**result, "relatedLocations": related} if related else result


def _place(span: Span, root: Path) -> dict[str, Any]:
    """A file, and a region of it; only the file if it is empty."""
    place: dict[str, Any] = {"artifactLocation": _artifact(span.source.path, root)}
    if span.source.text:
        line, column = span.source.position(span.start)
        end_line, end_column = span.source.position(span.end)
        place["region"] = {"startLine": line, "startColumn": column, "endLine": end_line, "endColumn": end_column}
    return place


def _artifact(path: Path, root: Path) -> dict[str, str]:
    relative, base = Path(os.path.abspath(path)), Path(os.path.abspath(root))
    if not relative.is_relative_to(base):
        return {"uri": relative.as_uri()}
    return {"uri": quote(relative.relative_to(base).as_posix()), "uriBaseId": _ROOT}
