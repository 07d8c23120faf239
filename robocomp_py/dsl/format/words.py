"""A text as its words, each with the comments around it. White space is dropped, except where it has a meaning.

A comment on the line of a word belongs to that word and stays behind it; one on a line of its own belongs to the
word that follows. That is also how documentation is found (`dsl.comments`), so that it stays with what it describes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

from lark import Token

from ..source import Span

TAB = 4
"""Columns from one tab stop to the next."""

END = "END"
"""The kind of the word after the last one, which has the comments at the end of the text."""

_BEGINNINGS = frozenset({"{", "}", ";", ",", "("})
"""Marks after which a list, or an item of a list, begins."""
_BLANK_LINE = re.compile(r"\n[ \t\f\r]*\n")


@dataclass(frozen=True, slots=True)
class Remark:
    """A comment, and where it stands in the text."""

    text: str
    column: int
    gap: int
    """Columns between it and the text before it on its line."""
    fresh: bool
    """Whether it is the first thing on its line."""
    ends: bool
    """Whether it is the last thing on its line."""
    blank: bool
    """Whether there is a blank line above it."""

    @property
    def breaks(self) -> bool:
        """Whether the line must end after it."""
        return self.ends or self.text.startswith("//") or "\n" in self.text

    def lines(self, column: int) -> list[str]:
        """Its text when it begins in that column: all its lines move by the same distance."""
        first, *rest = (line.rstrip(" \t\r") for line in self.text.split("\n"))
        if all(line.lstrip(" \t").startswith("*") for line in rest):
            return [first, *(" " * (column + 1) + line.lstrip(" \t") for line in rest)]
        return [first, *(_shifted(line, column - self.column) for line in rest)]


@dataclass(slots=True)
class Word:
    """A word or a mark. `kind` is its type in the grammar."""

    text: str
    kind: str
    blank: bool = False
    """Whether there is a blank line above it."""
    before: list[Remark] = field(default_factory=list)
    """Comments on lines above it."""
    after: list[Remark] = field(default_factory=list)
    """Comments behind it, on its line."""

    def settle(self, following: Word) -> None:
        """Bring comments and commas into an order in which they can be laid out.

        A comma goes before comments that end its line. A comment between a comma and the next word on the same
        line belongs to that word.
        """
        comments = [*self.after, *following.before]
        if following.text == "," and self.text not in _BEGINNINGS and any(each.breaks for each in comments):
            if following.after and comments[-1].text.startswith("//"):  # nothing can follow that on its line
                following.after[0] = replace(following.after[0], fresh=True)
            following.after[:0] = comments
            self.after, following.before = [], []
        elif self.text == ",":
            is_broken = any(each.breaks for each in self.after)
            below = next((n for n, each in enumerate(self.after) if each.fresh or not is_broken), len(self.after))
            following.before[:0] = self.after[below:]
            self.after = self.after[:below]


def read_words(text: str, tokens: Iterable[Token], comments: Iterable[Span], keywords: Mapping[str, str]) -> list[Word]:
    """The words of a text. Between words and comments there is only white space, and semicolons that end
    nothing. The last word is the `END`.
    """
    things = [*_in_order(tokens, comments), Token(END, "", start_pos=len(text), end_pos=len(text))]
    ends = [0, *(_place(thing)[1] for thing in things)]
    gaps = [text[end : _place(thing)[0]] for end, thing in zip(ends, things, strict=False)]
    words: list[Word] = []
    before: list[Remark] = []
    separate = False
    column = 0
    for index, (thing, gap) in enumerate(zip(things, gaps, strict=True)):
        fresh = index == 0 or "\n" in gap
        # Without a semicolon that ends nothing, a comment could become documentation.
        blank = bool(_BLANK_LINE.search(gap)) or separate or (";" in gap and bool(before) and before[-1].fresh)
        behind, column = column, moved(column, gap)
        if isinstance(thing, Token):
            words.append(Word(keywords.get(thing.type, str(thing)), thing.type, blank, before))
            before, separate = [], False
            column = moved(column, str(thing))
        else:
            last = "\n" in gaps[index + 1] or index + 2 == len(things)
            remark = Remark(thing.text.rstrip(" \t\r"), column, 0 if fresh else column - behind, fresh, last, blank)
            (before if fresh or before or not words else words[-1].after).append(remark)
            separate = fresh and ";" in gap.rpartition("\n")[2]
            column = moved(column, thing.text)
    for word, following in pairwise(words):
        word.settle(following)
    return words


def _in_order(tokens: Iterable[Token], comments: Iterable[Span]) -> Iterator[Token | Span]:
    """Words and comments in the order of the text."""
    waiting = iter(comments)
    comment = next(waiting, None)
    for token in tokens:
        while comment and comment.start < _place(token)[0]:
            yield comment
            comment = next(waiting, None)
        yield token
    if comment:
        yield comment
    yield from waiting


def _place(thing: Token | Span) -> tuple[int, int]:
    if isinstance(thing, Token):
        return thing.start_pos or 0, thing.end_pos or 0
    return thing.start, thing.end


def moved(column: int, text: str) -> int:
    """The column after a text that begins in that column."""
    if "\n" not in text and "\t" not in text:
        return column + len(text)
    _, newline, line = text.rpartition("\n")
    begin = 0 if newline else column
    return begin + len((" " * (begin % TAB) + line).expandtabs(TAB)) - begin % TAB


def _shifted(line: str, by: int) -> str:
    bare = line.lstrip(" \t")
    return " " * max(0, moved(0, line[: len(line) - len(bare)]) + by) + bare if bare else ""
