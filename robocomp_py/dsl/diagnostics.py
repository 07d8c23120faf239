"""Diagnostics: what is wrong with a text, where, and how to correct it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from ..errors import RobocompError
from ..spelling import closest
from .source import Span


class Severity(StrEnum):
    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """`code` is a stable slug; `message` is for the author of the file: lower case, no full stop."""

    code: str
    message: str
    span: Span
    severity: Severity = Severity.ERROR
    hint: str = ""
    related: tuple[tuple[str, Span], ...] = ()
    """Related places, each with a text: `first defined here`."""

    def render(self) -> str:
        """With place, source line and caret, as compilers do."""
        lines = [f"{_place(self.span)}: {self.severity}[{self.code}]: {self.message}", *_excerpt(self.span)]
        if self.hint:
            lines.append(f"    {self.hint}")
        for text, span in self.related:
            lines += [f"  {_place(span)}: {text}", *_excerpt(span)]
        return _printable("\n".join(lines))

    def to_json(self) -> dict[str, Any]:
        """For machines. The end is the position after the last character."""
        line, column = self.span.source.position(self.span.start)
        end_line, end_column = self.span.source.position(self.span.end)
        return {
            "file": str(self.span.source.path),
            "line": line,
            "column": column,
            "end_line": end_line,
            "end_column": end_column,
            "severity": str(self.severity),
            "code": self.code,
            "message": self.message,
            "hint": self.hint,
        }


@dataclass
class Report:
    """Diagnostics as they are found."""

    diagnostics: list[Diagnostic] = field(default_factory=list)

    def error(self, code: str, message: str, span: Span, hint: str = "", *related: tuple[str, Span]) -> None:
        self.diagnostics.append(Diagnostic(code, message, span, Severity.ERROR, hint, related))

    def warning(self, code: str, message: str, span: Span, hint: str = "", *related: tuple[str, Span]) -> None:
        self.diagnostics.append(Diagnostic(code, message, span, Severity.WARNING, hint, related))

    def extend(self, found: Iterable[Diagnostic]) -> None:
        known = set(self.diagnostics)
        self.diagnostics += [each for each in found if each not in known]

    @property
    def errors(self) -> list[Diagnostic]:
        return [each for each in self.diagnostics if each.severity is Severity.ERROR]


class DslError(RobocompError):
    """Files are wrong; the message shows every diagnostic."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = ordered(diagnostics)
        super().__init__("\n".join(each.render() for each in self.diagnostics))


def ordered(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """By file and place."""
    return sorted(diagnostics, key=lambda each: (str(each.span.source.path), each.span.start, each.code))


def mistyped(name: str, known: Iterable[str]) -> str:
    """The known name that differs from this one by one or two typing errors, or nothing.

    It is stricter than `did_you_mean`, for names that share long parts: `PoseEstimation` is no misspelling of
    `FullPoseEstimation`.
    """
    near = closest(name, known)
    return near if _slips(name.lower(), near.lower()) <= (1 if len(name) < _LONG else 2) else ""


def _slips(name: str, meant: str) -> int:
    """The number of wrong, additional or missing characters; two swapped characters count once."""
    differ = [at for at, (one, other) in enumerate(zip(name, meant, strict=False)) if one != other]
    if len(name) == len(meant) and len(differ) == 2 and name[differ[0]] == meant[differ[1]]:
        return 1
    pairs = difflib.SequenceMatcher(None, name, meant, autojunk=False).get_opcodes()
    return sum(max(i2 - i1, j2 - j1) for kind, i1, i2, j1, j2 in pairs if kind != "equal")


_LONG = 6
"""The shortest name that may have two typing errors, in characters."""


def did_you_mean(name: str, known: Iterable[str], *, prefix: str = "") -> str:
    """`did you mean `Laser`?`, or nothing if no known name is close."""
    near = closest(name, known, prefix=prefix)
    return f"did you mean `{near}`?" if near else ""


@dataclass
class Proposals:
    """`did_you_mean` for a limited number of names, because each is compared with all known names."""

    left: int = 20

    def __call__(self, name: str, known: Iterable[str], *, prefix: str = "") -> str:
        if self.left == 0:
            return ""
        self.left -= 1
        return did_you_mean(name, known, prefix=prefix)


def _place(span: Span) -> str:
    if not span.source.has_places:
        return str(span.source.path)
    line, column = span.source.position(span.start)
    return f"{span.source.path}:{line}:{column}"


def _excerpt(span: Span) -> Iterator[str]:
    """The line in which a span begins (a part of a very long one), with carets below; nothing if it is blank."""
    line, column = span.source.position(span.start)
    whole = span.source.line(line)
    cut = column - 1 - _EXCERPT // 2 if len(whole) > _EXCERPT and column > _EXCERPT // 2 else 0
    text = whole[cut : cut + _EXCERPT]
    before = text[: column - 1 - cut]
    if text.strip():
        width = max(1, min(span.end - span.start, len(text) - len(before)))
        yield f"    {text}"
        yield f"    {''.join(char if char == chr(9) else ' ' for char in before)}{'^' * width}"


def _printable(text: str) -> str:
    """The text without characters that would move a terminal's cursor, which binary files may contain."""
    return "".join(char if char.isprintable() or char in "\n\t" else "\N{REPLACEMENT CHARACTER}" for char in text)


_EXCERPT = 160
"""Characters shown of a line."""
