"""Changes of texts, as values."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from ..dsl.comments import find_comments
from ..dsl.source import Source, Span

_IMPORT = re.compile(r'\bimport\s*"[^"\n]*"\s*;?', re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Edit:
    """A new text for a span."""

    span: Span
    text: str


def insert(source: Source, at: int, text: str) -> Edit:
    return Edit(source.span(at, at), text)


def apply(text: str, edits: Iterable[Edit]) -> str:
    """The text after these edits, which must not overlap."""
    for each in sorted(edits, key=lambda edit: edit.span.start, reverse=True):
        text = text[: each.span.start] + each.text + text[each.span.end :]
    return text


def add_import(source: Source, name: str) -> Edit:
    """Add an import: below the others, or else above everything except the comments at the top."""
    bare = find_comments(source).bare
    end = "\r\n" if "\r\n" in source.text else "\n"
    imports = list(_IMPORT.finditer(bare))
    if imports:
        return insert(source, imports[-1].end(), f'{end}import "{name}";')
    at = len(bare) - len(bare.lstrip())
    return insert(source, at, f'import "{name}";{end}{end}')


def whole_lines(span: Span) -> Span:
    """The lines of a span, if they hold nothing else; otherwise the span itself."""
    text = span.source.text
    start = text.rfind("\n", 0, span.start) + 1
    end = text.find("\n", span.end)
    end = len(text) if end < 0 else end + 1
    alone = not text[start : span.start].strip() and not text[span.end : end].strip()
    return span.source.span(start, end) if alone else span
