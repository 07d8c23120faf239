"""The kind of each word of a text, for its colour: of names by their definitions, of keywords by their place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..dsl.comments import find_comments
from ..dsl.idsl.check import BUILTIN
from ..dsl.source import Source, Span
from ..dsl.syntax import Grammar
from .index import Index
from .outline import Kind

TYPES = (
    "comment",
    "keyword",
    "string",
    "number",
    "type",
    "namespace",
    "struct",
    "enum",
    "enumMember",
    "interface",
    "class",
    "method",
    "parameter",
    "property",
    "variable",
)
MODIFIERS = ("declaration", "defaultLibrary")

_OF_KINDS = {
    Kind.MODULE: "namespace",
    Kind.STRUCT: "struct",
    Kind.ENUM: "enum",
    Kind.ENUMERATOR: "enumMember",
    Kind.EXCEPTION: "class",
    Kind.SEQUENCE: "type",
    Kind.DICTIONARY: "type",
    Kind.CONST: "variable",
    Kind.FIELD: "property",
    Kind.INTERFACE: "interface",
    Kind.OPERATION: "method",
    Kind.ARGUMENT: "parameter",
    Kind.COMPONENT: "class",
    Kind.TIMER: "method",
    Kind.PARAMETERS: "class",
    Kind.LIST: "property",
    Kind.PARAMETER: "property",
    Kind.CHOICE: "enumMember",
    Kind.DEPLOYMENT: "namespace",
    Kind.HOST: "variable",
    Kind.SYSTEM: "namespace",
    Kind.INSTANCE: "variable",
    Kind.NAMED: "variable",
    Kind.MACHINE: "class",
    Kind.STATE: "enumMember",
}

_WORD = re.compile(r'"[^"\n]*"?|[A-Za-z_]\w*|[+-]?\d[\w.+-]*')


@dataclass(frozen=True, slots=True)
class Coloured:
    """A word on one line."""

    span: Span
    type: str
    modifiers: tuple[str, ...] = ()


def colours(index: Index, path: Path, text: str) -> list[Coloured]:
    """Every word of a text that has a colour, in order. In an unreadable text, the form of words decides."""
    source = Source(path, text)
    comments = find_comments(source)
    named = _named(index, path, source)
    keywords = set(Grammar(path.suffix.lower().removeprefix(".")).keywords.values())
    found = [Coloured(line, "comment") for each in comments.spans for line in _lines(each)]
    for word in _WORD.finditer(comments.bare):
        span = source.span(word.start(), word.end())
        coloured = named.get(span.start) or _by_looks(span, keywords, path.suffix.lower())
        if coloured:
            found.append(coloured)
    return sorted(found, key=lambda each: each.span.start)


def _named(index: Index, path: Path, source: Source) -> dict[int, Coloured]:
    made = index.outline(path)
    if made is None or made.source.text != source.text:
        return {}
    found = {}
    for use in made.uses:
        symbols = index.resolve(use)
        if symbols and not use.implied:
            found[use.name.span.start] = Coloured(use.name.span, _OF_KINDS[symbols[0].kind])
    for symbol in made.walk():
        found[symbol.name.span.start] = Coloured(symbol.name.span, _OF_KINDS[symbol.kind], ("declaration",))
    return found


def _by_looks(span: Span, keywords: set[str], ending: str) -> Coloured | None:
    word = span.text
    if word[0] == '"':
        return Coloured(span, "string")
    if word[0] in "+-0123456789":
        return Coloured(span, "number")
    if ending == ".idsl" and (word in BUILTIN or word == "void"):
        return Coloured(span, "type", ("defaultLibrary",))
    return Coloured(span, "keyword") if word in keywords or word.lower() in keywords else None


def _lines(span: Span) -> Iterator[Span]:
    """The parts of a span that are on one line each."""
    start = span.start
    for line in span.text.splitlines(keepends=True):
        yield span.source.span(start, start + len(line.rstrip("\r\n")))
        start += len(line)
