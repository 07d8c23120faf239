"""Comments: taken out of a text before it is parsed, and given back as documentation."""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from .source import Source, Span

_FAR = 1000
"""Longest gap, in characters, between a node and its comment. The limit keeps the search linear."""

_COMMENT = re.compile(r'"[^"\n]*"|//[^\n]*|/\*.*?\*/|/\*.*', re.DOTALL)


@dataclass(frozen=True)
class Comments:
    """The comments of a text, in order."""

    source: Source
    spans: tuple[Span, ...] = ()

    @property
    def endless(self) -> Span | None:
        """The last comment, if it is not closed."""
        last = self.spans[-1] if self.spans else None
        return last if last and last.text.startswith("/*") and not last.text[2:].endswith("*/") else None

    @cached_property
    def bare(self) -> str:
        """The text with spaces in their place."""
        parts, done = list[str](), 0
        for span in self.spans:
            parts += [self.source.text[done : span.start], re.sub(r"[^\n]", " ", span.text)]
            done = span.end
        return "".join([*parts, self.source.text[done:]])

    def doc(self, span: Span) -> str:
        """The comment that belongs to a node: on the lines directly above it, or after it on its line."""
        index = bisect.bisect_left(self._starts, span.start)
        above = _clean(self._above(span, index))
        if above:
            return above
        behind = self._behind(span, bisect.bisect_left(self._starts, span.end, index))
        return _clean([behind.text]) if behind else ""

    def _above(self, span: Span, index: int) -> list[str]:
        """The comments directly before a node; `index` is the first comment after the node's start."""
        found: list[str] = []
        start = span.start
        while index:
            index -= 1
            comment = self.spans[index]
            if start - comment.end > _FAR:
                break
            gap = self.source.text[comment.end : start]
            if gap.strip() or gap.count("\n") > 1 or not self._alone(comment):
                break
            found.insert(0, comment.text)
            start = comment.start
        return found

    def _behind(self, span: Span, index: int) -> Span | None:
        """The comment directly after a node, if it is the one at `index`."""
        if index == len(self.spans) or self._starts[index] - span.end > _FAR:
            return None
        gap = self.source.text[span.end : self._starts[index]]
        return self.spans[index] if "\n" not in gap and not gap.strip(" \t;,)") else None

    @cached_property
    def _starts(self) -> list[int]:
        return [span.start for span in self.spans]

    def _alone(self, comment: Span) -> bool:
        """Whether nothing stands before it on its line."""
        line, column = self.source.position(comment.start)
        return not self.source.line(line)[: column - 1].strip()


def find_comments(source: Source) -> Comments:
    found = _COMMENT.finditer(source.text)
    return Comments(source, tuple(source.span(each.start(), each.end()) for each in found if each[0][0] == "/"))


def _clean(comments: list[str]) -> str:
    """Comments as prose: without their marks and without Doxygen's commands."""
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
