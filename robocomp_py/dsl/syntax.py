"""Grammars: text to trees, with every independent syntax error said for people, and the comments kept.

After an error the text is mended, and parsed again, so that one pass tells of several mistakes, and
what is right is still there to be checked.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from typing import Any

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken
from lark.lark import PostLex

from .comments import Comments, find_comments
from .diagnostics import Diagnostic, Report
from .mistakes import (
    END,
    Mistake,
    Ways,
    explain_character,
    explain_end,
    explain_endless,
    explain_stray,
    explain_token,
    find_stray,
    misspelt,
    without_stray,
)
from .source import Name, Source, Span

MAX_CHARACTERS = 1_000_000
MAX_NESTING = 100
MAX_DIGITS = 40
MAX_SYNTAX_ERRORS = 20
MAX_PARSED = 3_000_000
"""Characters to parse for one file, all attempts together; one attempt is always made."""

_WORDS = {
    "$END": END,
    "NAME": "a name",
    "STRING": "a text in double quotes",
    "INT": "an integer",
    "NUMBER": "a number",
    "LANGUAGE": "a language",
    "ADDRESS": "an address",
}
_UNADVERTISED = ("LEGACY", "LATER")
"""Keywords whose terminals' names begin so are read, but not proposed."""

_MARKS = (";", ",", ")", ">", "}", "{", "(")
_TOKEN = re.compile(r'\s*("[^"\n]*"|\w+|\S)')
_LIMITED = re.compile(rf'"[^"\n]*"|//[^\n]*|/\*.*?\*/|/\*.*|[{{}}<>()]|\b\d{{{MAX_DIGITS},}}', re.DOTALL)


@dataclass(frozen=True)
class Parsed:
    """A tree (None if nothing could be made of the text), its comments, and the words left out of it."""

    tree: Tree[Token] | None
    comments: Comments
    skipped: frozenset[str] = frozenset()


class Grammar:
    """One language's grammar. `name` is the package that holds its grammar.lark.

    `hints` are for mistakes that many make: what the text around a syntax error on its line looks like, and what
    to say then.
    """

    def __init__(self, name: str, hints: Mapping[str, str] | None = None) -> None:
        self._name, self._hints = name, hints or {}

    @cached_property
    def _lark(self) -> Lark:
        return Lark(
            files(f"{__package__}.{self._name}").joinpath("grammar.lark").read_text(),
            parser="lalr",
            propagate_positions=True,
            maybe_placeholders=False,
            import_paths=[str(files(__package__))],
            postlex=_WholeWords(),
        )

    @cached_property
    def _patterns(self) -> dict[str, tuple[str, str]]:
        return {each.name: (each.pattern.type, each.pattern.value) for each in self._lark.terminals}

    def parse(self, source: Source, report: Report) -> Parsed:
        """The tree of a text; what is wrong with its syntax goes into the report."""
        limit = _beyond(source)
        if limit:
            report.diagnostics.append(limit)
            return Parsed(None, Comments(source))
        comments = find_comments(source)
        text, tree, skipped = without_stray(comments.bare), None, set[str]()
        report.diagnostics += [explain_stray(source, at) for at in find_stray(comments.bare)[:MAX_SYNTAX_ERRORS]]
        mistakes = [explain_endless(source, comments.endless)] if comments.endless else []
        for _ in range(max(1, min(MAX_SYNTAX_ERRORS, MAX_PARSED // max(1, len(text))))):
            try:
                tree = self._lark.parse(text)
                break
            except UnexpectedInput as error:
                mistake = self._explain(source, text, error)
                if mistake.start < len(source.text) or not mistakes or (mistake.instead and not comments.endless):
                    mistakes.append(self._hinted(mistake.diagnostic))
                if not mistake.instead:
                    skipped |= set(re.findall(r"\w+", text[mistake.start : mistake.end]))
                text, before = without_stray(mistake.mend(text)), text
                if text == before:
                    break
        report.diagnostics += mistakes
        return Parsed(tree, comments, frozenset(skipped))

    def _explain(self, source: Source, text: str, error: UnexpectedInput) -> Mistake:
        if isinstance(error, UnexpectedCharacters):
            return explain_character(source, text, error.pos_in_stream or 0)
        assert isinstance(error, UnexpectedToken)
        expected = self._expected(error)
        if error.token.type == "$END":
            return explain_end(source, text, expected)
        return explain_token(source, text, span_of(source, error.token), expected, self._ways(text, error, expected))

    def _hinted(self, diagnostic: Diagnostic) -> Diagnostic:
        line, column = diagnostic.span.source.position(diagnostic.span.start)
        for pattern, hint in self._hints.items():
            for found in re.finditer(pattern, diagnostic.span.source.line(line), re.IGNORECASE):
                if found.start() < column <= found.end():
                    return replace(diagnostic, hint=hint)
        return diagnostic

    def _ways(self, text: str, error: UnexpectedToken, expected: list[str]) -> Ways:
        """How a token can be made sense of, together with the one behind it."""
        following = _TOKEN.match(text, error.token.end_pos or 0)
        behind = self._terminals(following[1]) if following else {"$END"}
        meant = misspelt(str(error.token), expected)
        parser = error.interactive_parser.copy()  # type: ignore[no-untyped-call]  # lark has not typed it
        return Ways(
            ";" if expected == ["`;`"] else self._missing(error, behind),
            bool(meant) and _feed(parser, self._terminals(meant) - {"NAME"}) and bool(behind & parser.accepts()),
            bool((behind - {"NAME", "LANGUAGE"}) & error.accepts),
        )

    def _missing(self, error: UnexpectedToken, behind: set[str]) -> str:
        """The mark that would make sense of a token, and of the one behind it, if it stood before it."""
        own = self._terminals(str(error.token))
        for kinds in (own - {"NAME"}, own & {"NAME"}):  # a keyword is likely to be meant as one
            for mark in _MARKS:
                parser = error.interactive_parser.copy()  # type: ignore[no-untyped-call]  # lark has not typed it
                if _feed(parser, self._terminals(mark)) and _feed(parser, kinds) and behind & parser.accepts():
                    return mark
        return ""

    def _terminals(self, word: str) -> set[str]:
        """What a word could be."""
        found = {name for name, (_, value) in self._patterns.items() if value.lower() == word.lower()}
        if word[0].isalpha() or word[0] == "_":
            return {*found, "NAME", "LANGUAGE"}
        return {*found, "STRING"} if word[0] == '"' else {*found, "INT", "NUMBER"} if word[-1].isdigit() else found

    def _expected(self, error: UnexpectedToken) -> list[str]:
        """What could stand there, as people say it; keywords in back-quotes."""
        said = {word for terminal in error.accepts for word in self._said(terminal)}
        return sorted(said, key=lambda text: (text.startswith("`"), text))

    def _said(self, terminal: str) -> list[str]:
        kind, value = self._patterns.get(terminal, ("", ""))
        if kind == "str":
            return [] if terminal.startswith(_UNADVERTISED) else [f"`{value}`"]
        return [_WORDS[terminal]] if terminal in _WORDS else []


def _feed(parser: Any, kinds: set[str]) -> bool:
    """Give a parser a token of one of these kinds, if it accepts any."""
    for kind in sorted(kinds & parser.accepts()):
        parser.feed_token(Token(kind, ""))
        return True
    return False


class _WholeWords(PostLex):
    """Has names accepted everywhere by the lexer, so that a keyword never matches the beginning of a longer word."""

    always_accept = ("NAME",)

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        return stream


def span_of(source: Source, token: Token) -> Span:
    return source.span(token.start_pos or 0, token.end_pos or 0)


def name_of(source: Source, token: Token) -> Name:
    """A word; a text in quotes without them."""
    span = span_of(source, token)
    if token.type == "STRING":
        return Name(str(token)[1:-1], source.span(span.start + 1, span.end - 1))
    return Name(str(token), span)


def tree_span(source: Source, tree: Tree[Token]) -> Span:
    """From the first to the last token of a tree; nothing at the start of the file if it has none."""
    if tree.meta.empty:
        return source.span(0, 0)
    start = tree.meta.start_pos
    while source.text[start : start + 1].isspace():  # a mended keyword may begin there
        start += 1
    return source.span(start, tree.meta.end_pos)


def _beyond(source: Source) -> Diagnostic | None:
    """What would take too much to read."""
    if len(source.text) > MAX_CHARACTERS:
        message = f"the file has more than {MAX_CHARACTERS} characters"
        return Diagnostic("too-large", message, source.span(0, 0))
    depth = 0
    for found in _LIMITED.finditer(source.text):
        token, span = found[0], source.span(found.start(), found.end())
        if token in "{<(":
            depth += 1
        elif token in "}>)":
            depth = max(0, depth - 1)
        elif token[0].isdigit():
            return Diagnostic("too-long", f"a number of more than {MAX_DIGITS} digits", span)
        if depth > MAX_NESTING:
            return Diagnostic("too-deep", f"nested deeper than {MAX_NESTING} levels", span)
    return None
