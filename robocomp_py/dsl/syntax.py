"""Grammars: text to trees, with a message for every independent syntax error, and with the comments.

After an error the text is mended and parsed again. So one run reports several errors, and the correct
parts can still be checked.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

from lark import Token, Tree

from .comments import Comments, find_comments
from .diagnostics import Diagnostic, Report
from .mistakes import (
    END,
    Mistake,
    Ways,
    explain_character,
    explain_conflict,
    explain_end,
    explain_endless,
    explain_stray,
    explain_token,
    find_conflicts,
    find_stray,
    is_open,
    misspelt,
    without_conflicts,
    without_stray,
)
from .parsing import STRANGE, Parser, State, Unexpected
from .source import Name, Source, Span
from .tables import read_grammar

MAX_CHARACTERS = 4_000_000
MAX_NESTING = 100
MAX_DIGITS = 40
MAX_SYNTAX_ERRORS = 20
MAX_PARSED = 10_000_000
"""The most characters to parse for one file, in all attempts; one attempt is always made."""

_WORDS = {
    "$END": END,
    "NAME": "a name",
    "STRING": "a text in double quotes",
    "INT": "an integer",
    "NUMBER": "a number",
    "LANGUAGE": "a language",
    "ADDRESS": "an address",
}
_UNADVERTISED = ("LEGACY",)
"""Keywords whose terminals have this prefix are read, but not proposed."""

_HINTS = {r"\bimport\s+[^\s\"].*": 'the name of a file stands in double quotes: `import "Laser.idsl";`'}
_MARKS = (";", ",", ")", ">", "}", "{", "(", ");")
_AROUND = 300
"""Characters of a line before and after an error in which hints are searched for."""

_WORD = re.compile(r"\w+")
_TOKEN = re.compile(r'\s*("[^"\n]*"|\w+|=>|::|\S)')
_NO_BRACKETS = re.compile(r'"[^"\n]*"|//[^\n]*|/\*.*?\*/|/\*.*|[^{}<>()"/]+|["/]', re.DOTALL)
_LONG_NUMBER = re.compile(rf"\d{{{MAX_DIGITS}}}")
_LIMITED = re.compile(rf'"[^"\n]*"|//[^\n]*|/\*.*?\*/|/\*.*|[{{}}<>()]|\b\d{{{MAX_DIGITS},}}', re.DOTALL)


@dataclass(frozen=True)
class Parsed:
    """A tree (None if the text could not be parsed), its comments, and the words left out of it."""

    tree: Tree[Token] | None
    comments: Comments
    skipped: frozenset[str] = frozenset()


class Grammar:
    """One language's grammar. `name` is the package that holds its grammar.lark.

    `hints` are for common mistakes: a pattern for the text around a syntax error on its line, and the hint.
    """

    def __init__(self, name: str, hints: Mapping[str, str] | None = None) -> None:
        self._name, self._hints = name, {**_HINTS, **(hints or {})}

    @cached_property
    def _parser(self) -> Parser:
        return _parser(self._name)

    def parse(self, source: Source, report: Report) -> Parsed:
        """The tree of a text; syntax errors go into the report."""
        limit = _beyond(source)
        if limit:
            report.diagnostics.append(limit)
            return Parsed(None, Comments(source))
        comments = find_comments(source)
        conflicts = find_conflicts(comments.bare)
        bare = without_conflicts(comments.bare, conflicts)
        skipped = {word for each in conflicts for word in _WORD.findall(source.text, each.middle, each.end)}
        report.diagnostics += [explain_conflict(source, each) for each in conflicts[:MAX_SYNTAX_ERRORS]]
        report.diagnostics += [explain_stray(source, *at) for at in find_stray(bare)[:MAX_SYNTAX_ERRORS]]
        text, tree = without_stray(bare), None
        mistakes = [explain_endless(source, comments.endless)] if comments.endless else []
        for _ in range(max(1, min(MAX_SYNTAX_ERRORS, MAX_PARSED // max(1, len(text))))):
            try:
                tree = self._parser.parse(text)
                break
            except Unexpected as error:
                mistake = self._explain(source, text, error)
                diagnostic = self._hinted(mistake.diagnostic)
                if diagnostic in mistakes:  # the correction did not help: continue after the word
                    mistake = Mistake(diagnostic, error.word.start_pos or 0, error.word.end_pos or 0)
                elif diagnostic.span.end <= len(source.text) and (  # or it is about what was added there
                    mistake.start < len(source.text) or not mistakes or (mistake.instead and not comments.endless)
                ):
                    mistakes.append(diagnostic)
                if not mistake.instead:
                    skipped |= set(_WORD.findall(text, mistake.start, mistake.end))
                text, before = without_stray(mistake.mend(text)), text
                if text == before:
                    break
        report.diagnostics += mistakes
        return Parsed(tree, comments, frozenset(skipped))

    def tokens(self, source: Source, comments: Comments) -> list[Token] | None:
        """The words of a text, without semicolons that end nothing; None if its syntax is wrong.

        Keywords have types of their own: see `keywords`.
        """
        if _beyond(source) or comments.endless:
            return None
        tokens: list[Token] = []
        try:
            self._parser.parse(without_stray(comments.bare), tokens.append)
        except Unexpected:
            return None
        return tokens

    @cached_property
    def keywords(self) -> Mapping[str, str]:
        """The keywords in their usual case, by the types of their tokens."""
        return {name: word for name, word in self._parser.fixed.items() if word[0].isalpha()}

    def words_behind(self, source: Source) -> list[str]:
        """The keywords that can follow a text that is still being written, even if it has errors further up."""
        text = "" if _beyond(source) else without_stray(find_comments(source).bare)
        for _ in range(MAX_SYNTAX_ERRORS):
            try:
                self._parser.parse(text)
                break
            except Unexpected as error:
                if error.word.type == "$END":
                    accepted = self._parser.accepted(error.state)
                    return [
                        word
                        for kind, word in self.keywords.items()
                        if kind in accepted and not kind.startswith(_UNADVERTISED)
                    ]
                text, before = without_stray(self._explain(source, text, error).mend(text)), text
                if text == before:
                    break
        return []

    def _explain(self, source: Source, text: str, error: Unexpected) -> Mistake:
        expected = self._expected(error.state)
        match error.word.type:
            case "$END":
                return explain_end(source, text, expected)
            case _ if error.word.type == STRANGE:
                return explain_character(source, text, error.word.start_pos or 0, expected)
            case _:
                span = span_of(source, error.word)
                return explain_token(source, text, span, expected, self._ways(text, error, expected))

    def _hinted(self, diagnostic: Diagnostic) -> Diagnostic:
        line, column = diagnostic.span.source.position(diagnostic.span.start)
        cut = max(0, column - _AROUND)  # of a line without end: patterns look ahead
        near = diagnostic.span.source.line(line)[cut : column + _AROUND]
        for pattern, hint in self._hints.items():
            for found in re.finditer(pattern, near, re.IGNORECASE):
                if found.start() < column - cut <= found.end():
                    return replace(diagnostic, hint=hint)
        return diagnostic

    def _ways(self, text: str, error: Unexpected, expected: list[str]) -> Ways:
        """How a word, together with the next ones, could make sense."""
        behind = self._behind(text, error.word.end_pos or 0)
        meant = misspelt(str(error.word), expected)
        marks = _MARKS if is_open(text) else [each for each in _MARKS if each != "}"]
        return Ways(
            ";"
            if expected == ["`;`"]
            else self._missing(error, behind, marks) or self._missing(error, behind[:1], marks),
            bool(meant) and self._fits(error.state, self._kinds(meant) - {"NAME"}, behind[0]),
            bool((behind[0] - {"NAME", "LANGUAGE"}) & self._parser.accepted(error.state)),
            self._parser.fixed.values(),
        )

    def _behind(self, text: str, at: int) -> list[set[str]]:
        """What the next two words could be, or the next one if it is the last."""
        first = _TOKEN.match(text, at)
        second = _TOKEN.match(text, first.end()) if first else None
        return [self._kinds(each[1]) for each in (first, second) if each] or [{"$END"}]

    def _missing(self, error: Unexpected, behind: list[set[str]], possible: Sequence[str]) -> str:
        """The mark, or marks, before a word that would make the word and the next ones valid."""
        own = self._kinds(str(error.word))
        for kinds in (own - {"NAME"}, own & {"NAME"}):  # a keyword is likely to be meant as one
            for marks in possible:
                if self._fits(error.state, *map(self._kinds, marks), kinds, *behind):
                    return marks
        return ";" if self._begins_misspelt(error, behind) else ""

    def _begins_misspelt(self, error: Unexpected, behind: list[set[str]]) -> bool:
        """Whether a misspelt word seems to begin a statement after one that is not ended: two mistakes."""
        if not self._fits(error.state, self._kinds(";")):
            return False
        [ending] = self._kinds(";") & self._parser.accepted(error.state)
        meant = misspelt(str(error.word), self._expected(self._parser.after(error.state, ending)))
        return bool(meant) and self._fits(error.state, {ending}, self._kinds(meant) - {"NAME"}, *behind)

    def _fits(self, state: State, *words: set[str]) -> bool:
        """Whether words of these kinds can follow one another."""
        for kinds in words:
            accepted = kinds & self._parser.accepted(state)
            if not accepted:
                return False
            state = self._parser.after(state, min(accepted))
        return True

    def _kinds(self, word: str) -> set[str]:
        """The kinds that a word could have."""
        fixed = self._parser.fixed
        found = {name for name, value in fixed.items() if value.lower() == word.lower()}
        if word[0].isalpha() or word[0] == "_":
            return {*found, "NAME", "LANGUAGE"}
        if word[0] == '"':
            return {*found, "STRING"}
        return {*found, *({"INT", "NUMBER"} - set(fixed))} if word[-1].isdigit() else found  # `int` is PDSL's INT

    def _expected(self, state: State) -> list[str]:
        """The words expected in a state, for messages; keywords in back-quotes."""
        said = {word for kind in self._parser.accepted(state) for word in self._said(kind)}
        return sorted(said, key=lambda text: (text.startswith("`"), text))

    def _said(self, kind: str) -> list[str]:
        if kind in self._parser.fixed:
            return [] if kind.startswith(_UNADVERTISED) else [f"`{self._parser.fixed[kind]}`"]
        return [_WORDS[kind]] if kind in _WORDS else []


@cache
def _parser(name: str) -> Parser:
    return Parser(read_grammar(name))


def span_of(source: Source, token: Token) -> Span:
    return source.span(token.start_pos or 0, token.end_pos or 0)


def name_of(source: Source, token: Token) -> Name:
    """A word; a quoted text without its quotes."""
    span = span_of(source, token)
    if token.type == "STRING":
        return Name(str(token)[1:-1], source.span(span.start + 1, span.end - 1))
    return Name(str(token), span)


def tree_span(source: Source, tree: Tree[Token]) -> Span:
    """From the first to the last token of a tree; nothing at the start of the file if it has none."""
    start, text = tree.meta.start_pos, source.text
    while text[start : start + 1].isspace():  # a mended keyword may begin there
        start += 1
    return source.span(start, tree.meta.end_pos)


class Builder:
    """Base of the classes that make a model of a tree, with a method for each kind of node."""

    def __init__(self, parsed: Parsed) -> None:
        self._parsed, self._source = parsed, parsed.comments.source

    def _name(self, token: Any) -> Name:
        return name_of(self._source, token)

    def _span(self, tree: Tree[Any]) -> Span:
        return tree_span(self._source, tree)

    def _doc(self, tree: Tree[Any]) -> str:
        return self._parsed.comments.doc(self._span(tree))


def _beyond(source: Source) -> Diagnostic | None:
    """An error if the file is too expensive to read."""
    if len(source.text) > MAX_CHARACTERS:
        message = f"the file has more than {MAX_CHARACTERS} characters"
        return Diagnostic("too-large", message, source.span(0, 0))
    if _deepest(_NO_BRACKETS.sub("", source.text)) <= MAX_NESTING and not _LONG_NUMBER.search(source.text):
        return None
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


def _deepest(brackets: str) -> int:
    """How deeply brackets of all shapes are nested."""
    depth = most = 0
    for bracket in brackets:
        if bracket in "{<(":
            depth += 1
            most = max(most, depth)
        elif depth:
            depth -= 1
    return most
