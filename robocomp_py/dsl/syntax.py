"""Grammars: text to trees, with every independent syntax error said for people, and the comments kept.

After an error the statement it stands in is blanked and the text parsed again, so that one pass
tells of several mistakes, and what is right is still there to be checked.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from .diagnostics import Diagnostic, Report, did_you_mean
from .source import Name, Source, Span

MAX_CHARACTERS = 1_000_000
MAX_NESTING = 100
MAX_SYNTAX_ERRORS = 20

_BRACKETS = re.compile(r'"[^"\n]*"|//[^\n]*|/\*.*?\*/|[{}<>(]|\)', re.DOTALL)
_STATEMENT_END = re.compile(r'"[^"\n]*"|//[^\n]*|/\*.*?\*/|[{};]', re.DOTALL)
_DIRECTIVE = re.compile(r"^[ \t]*#[^\n]*", re.MULTILINE)
_WORDS = {
    "$END": "the end of the file",
    "NAME": "a name",
    "STRING": "a text in double quotes",
    "INT": "an integer",
    "NUMBER": "a number",
    "LANGUAGE": "a language",
}
_UNADVERTISED = {"COMMENT", "WS", "LEGACY", "LATER"}


@dataclass
class Parsed:
    """A tree (None if nothing could be made of the text), its comments, and what was left out of it."""

    source: Source
    tree: Tree[Token] | None
    comments: list[Span] = field(default_factory=list)
    skipped: str = ""

    def doc(self, span: Span) -> str:
        """The comment that belongs to a node: on the lines right above it, or behind it on its line."""
        above = _clean(self._above(span))
        behind = self._behind(span)
        return above or (_clean([behind.text]) if behind else "")

    def _above(self, span: Span) -> list[str]:
        found: list[str] = []
        start = span.start
        for index in range(self._first_after(span.start) - 1, -1, -1):
            comment = self.comments[index]
            gap = self.source.text[comment.end : start]
            if gap.strip() or gap.count("\n") > 1 or not self._alone(comment):
                break
            found.insert(0, comment.text)
            start = comment.start
        return found

    def _behind(self, span: Span) -> Span | None:
        index = self._first_after(span.end)
        if index == len(self.comments):
            return None
        gap = self.source.text[span.end : self.comments[index].start]
        return self.comments[index] if "\n" not in gap and not gap.strip(" \t;,})") else None

    def _first_after(self, offset: int) -> int:
        return bisect.bisect_left(self.comments, offset, key=lambda comment: comment.start)

    def _alone(self, comment: Span) -> bool:
        """Whether nothing stands before it on its line."""
        line, column = self.source.position(comment.start)
        return not self.source.line(line)[: column - 1].strip()


class Grammar:
    """One language's grammar. `name` is the package that holds its grammar.lark."""

    def __init__(self, name: str) -> None:
        self._name = name

    @cached_property
    def _lark(self) -> Lark:
        return Lark(
            files(f"{__package__}.{self._name}").joinpath("grammar.lark").read_text(),
            parser="lalr",
            propagate_positions=True,
            maybe_placeholders=False,
            import_paths=[str(files(__package__))],
            lexer_callbacks={"COMMENT": self._keep_comment},
        )

    def _keep_comment(self, token: Token) -> Token:
        self._comments.append(token)
        return token

    def parse(self, source: Source, report: Report) -> Parsed:
        """The tree of a text; what is wrong with its syntax goes into the report."""
        if len(source.text) > MAX_CHARACTERS:
            report.error("too-large", f"the file has more than {MAX_CHARACTERS} characters", source.span(0, 0))
            return Parsed(source, None)
        if deep := _too_deep(source):
            report.error("too-deep", f"nested deeper than {MAX_NESTING} levels", deep)
            return Parsed(source, None)
        text, parsed = source.text, Parsed(source, None)
        for directive in _DIRECTIVE.finditer(text):
            span = source.span(directive.start() + len(directive[0]) - len(directive[0].lstrip()), directive.end())
            report.error("stray-directive", "there is no preprocessor", span, "remove the line")
            text = _blank(text, directive.start(), directive.end())
        for _ in range(MAX_SYNTAX_ERRORS):
            try:
                self._comments: list[Token] = []
                parsed.tree = self._lark.parse(text)
                break
            except UnexpectedInput as error:
                diagnostic = self._explain(source, text, error)
                report.diagnostics.append(diagnostic)
                start, end = _statement(text, diagnostic.span.start)
                parsed.skipped += text[start:end] + "\n"
                if not text[start:end].strip():
                    break
                text = _blank(text, start, end)
        parsed.comments = [span_of(source, token) for token in self._comments]
        return parsed

    def _explain(self, source: Source, text: str, error: UnexpectedInput) -> Diagnostic:
        expected = self._expected(error)
        if isinstance(error, UnexpectedToken) and error.token.type != "$END":
            found, start, end = f"`{error.token}`", error.token.start_pos or 0, error.token.end_pos or 0
        elif isinstance(error, UnexpectedCharacters):
            start = error.pos_in_stream or 0
            end = start + 1
            found = f"`{text[start]}`"
            if text[start] == '"':
                return Diagnostic("syntax", "this text has no end", source.span(start, end), hint='close it by `"`')
            if text.startswith("/*", start):
                return Diagnostic(
                    "syntax", "this comment has no end", source.span(start, start + 2), hint="close it by `*/`"
                )
        else:
            found, start, end = "the end of the file", max(0, len(text.rstrip()) - 1), len(text.rstrip())
        if found == "`;`" and text[:start].rstrip().endswith(";"):
            return Diagnostic("stray-semicolon", "a `;` too many", source.span(start, end), hint="remove it")
        if expected == ["`;`"] or ("`;`" in expected and "\n" in text[len(text[:start].rstrip()) : start]):
            at = len(text[:start].rstrip())
            return Diagnostic("syntax", f"expected `;` before {found}", source.span(at - 1, at), hint="add `;` here")
        place = source.span(start, end)
        if not expected or (found != "the end of the file" and expected == ["the end of the file"]):
            hint = "a file has one definition; remove what follows it"
            return Diagnostic("trailing-text", f"unexpected {found} after the end", place, hint=hint)
        hint = did_you_mean(text[start:end], [word.strip("`") for word in expected if word[1:2].isalpha()])
        return Diagnostic("syntax", f"unexpected {found}; expected {_listed(expected)}", place, hint=hint)

    def _expected(self, error: UnexpectedInput) -> list[str]:
        """What could stand there, as people say it; keywords in back-quotes."""
        names = next(filter(None, (getattr(error, key, None) for key in ("accepts", "expected", "allowed"))), ())
        said = {word for name in names for word in self._said(name)}
        return sorted(said, key=lambda text: (not text.startswith("a"), text))

    def _said(self, terminal: str) -> list[str]:
        if terminal in _WORDS:
            return [_WORDS[terminal]]
        pattern = {each.name: each.pattern for each in self._lark.terminals}[terminal]
        if pattern.type == "str":
            return [f"`{pattern.value}`"]
        words = re.findall(r"\w+", re.sub(r"\(\?i?:", "(", pattern.value))
        return [f"`{word}`" for word in words] if terminal not in _UNADVERTISED else []


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
    return source.span(tree.meta.start_pos, tree.meta.end_pos)


def _listed(words: list[str]) -> str:
    if len(words) > 6:
        words = [*words[:6], "…"]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " or " + words[-1]


def _blank(text: str, start: int, end: int) -> str:
    """The text with that part replaced by spaces; lines stay where they are."""
    hole = re.sub(r"[^\n]", " ", text[start:end])
    return text[:start] + hole + text[end:]


def _statement(text: str, at: int) -> tuple[int, int]:
    """The statement around an offset: from behind the last `;`, `{` or `}` to its `;`, a block of its own included."""
    start = 0
    for found in _STATEMENT_END.finditer(text, 0, at):
        if found[0] in "{};":
            start = found.end()
    depth = 0
    for found in _STATEMENT_END.finditer(text, at):
        match found[0]:
            case ";" if depth == 0:
                return start, found.end()
            case "{":
                depth += 1
            case "}" if depth == 0:
                return start, found.start() if found.start() > at else found.end()
            case "}":
                depth -= 1
                if depth == 0:
                    rest = re.match(r"\s*;", text[found.end() :])
                    return start, found.end() + (rest.end() if rest else 0)
    return start, len(text)


def _too_deep(source: Source) -> Span | None:
    depth = 0
    for found in _BRACKETS.finditer(source.text):
        if found[0] in "{<(":
            depth += 1
        elif found[0] in "}>)":
            depth -= 1
        if depth > MAX_NESTING:
            return source.span(found.start(), found.end())
    return None


def _clean(comments: list[str]) -> str:
    """Comments as prose: without their marks, Doxygen's words included."""
    return "\n".join(_lines(comments)).strip()


def _lines(comments: list[str]) -> Iterator[str]:
    for comment in comments:
        body = comment[2:-2] if comment.startswith("/*") else comment[2:]
        for line in body.splitlines():
            line = re.sub(r"^\s*[*/!<]*\s?", "", line).rstrip(" \t*/")
            line = re.sub(r"[\\@](brief|note|details)\s*", "", line)
            if re.match(r"\s*[\\@](struct|interface|class|enum|file|author|date)\b", line):
                continue
            yield re.sub(r"[\\@](return|returns|param)\s+", lambda found: f"{found[1].capitalize()} ", line).strip()
