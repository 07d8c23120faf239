"""Lays out statements and blocks on lines.

A statement takes one line. A statement that is too long is broken: before `feedback` and `throws`, and then after the
commas of its lists. The braces of a block have their own lines. Empty braces, and a list that fits, stay on the line of
their statement:

    module RoboCompArm
    {
        enum Side { left, right };

        struct Pose
        {
            float x;
        };
    };

Blank lines are kept, at most one in a row. A block inside another one has one above it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from .page import BREAK, Break, Group, Page
from .words import END, Remark, Word

_NO_SPACE_BEFORE = frozenset({",", ";", ")", "]", ">", "<", "::", "/"})
_OPENERS = frozenset({"(", "[", "<"})
_NO_SPACE_BEHIND = frozenset({*_OPENERS, "::", "/"})
_CONTINUES = frozenset({"THROWS", "EXTENDS", "FEEDBACK"})
"""The kinds of words that begin a new line if the statement is too long."""


@dataclass(frozen=True)
class Customs:
    """What differs between the languages."""

    tight: frozenset[str] = frozenset()
    """Marks without spaces around them, besides those that have none in any language."""
    apart: bool = True
    """Whether a blank line stands above each block inside another one."""
    goes_on: bool = False
    """Whether a statement continues after a list in braces."""


def lay_out(words: Sequence[Word], customs: Customs) -> str:
    """The text of these words, the last of which is the `END`. It consumes them."""
    return _Layout(words, customs).file()


class _Layout:
    def __init__(self, words: Sequence[Word], customs: Customs) -> None:
        self._words, self._customs = words, customs
        self._next = 0
        self._page = Page()

    def file(self) -> str:
        self._statements()
        self._comments_above(self._peek)
        return self._page.text()

    def _statements(self) -> None:
        """All up to the end of the block, or of the file."""
        begin = self._next
        while self._peek.text != "}" and self._peek.kind != END:
            self._statement(first=self._next == begin)

    def _statement(self, first: bool) -> None:
        head = self._take()
        if self._peek.text != "{" or (head and head[-1].text == ";"):
            self._above(head[0], first)
            self._line(head)
        elif self._begins_list():
            self._list(head, first)
        else:
            self._block(head, first)

    def _list(self, head: Sequence[Word], first: bool) -> None:
        """A statement with a list in braces."""
        opening, inside, closing = self._pop(), self._take(), self._pop()
        tail = self._tail(closing, self._customs.goes_on)
        whole = [*head, opening, *inside, closing, *tail]
        if self._page.fits(_group(whole, self._customs.tight)) and not _is_spread(opening, inside, closing):
            self._above(whole[0], first)
            self._line(whole)
        else:
            self._above(whole[0], first, apart=self._customs.apart)
            self._opened(head, opening)
            self._items(inside)
            self._closed(closing, tail)

    def _block(self, head: Sequence[Word], first: bool) -> None:
        """A statement with statements in braces."""
        opening = self._pop()
        comments = [*opening.after, *self._peek.before, *((*head[-1].after, *opening.before) if head else ())]
        is_empty = self._peek.text == "}" and not comments
        apart = self._page.level == 0 or (self._customs.apart and not is_empty)
        self._above((*head, opening)[0], first, apart)
        if is_empty:
            closing = self._pop()
            self._line([*head, opening, closing, *self._tail(closing)])
        else:
            self._opened(head, opening)
            begin = self._next
            self._statements()
            has_none = self._next == begin
            closing = self._pop()
            self._closed(closing, self._tail(closing), first=has_none)

    # Parts of statements, in the order in which they stand.

    def _above(self, word: Word, first: bool, apart: bool = False) -> None:
        """The blank line and the comments above a statement."""
        blanks = [word.blank, *(remark.blank for remark in word.before if remark.fresh)]
        if apart and not first and not any(blanks):
            self._page.skip()
        self._comments_above(word, first)
        if word.blank and (word.before or not first):
            self._page.skip()

    def _comments_above(self, word: Word, first: bool = False) -> None:
        for index, remark in enumerate(word.before):
            if remark.fresh:
                if remark.blank and (index or not first):
                    self._page.skip()
                self._page.line()
            self._page.trail(remark)

    def _line(self, words: Sequence[Word]) -> None:
        """Words on a new line, or on several if they do not fit, with the comments after the last one."""
        self._page.line()
        self._page.group(_group(words, self._customs.tight))
        for remark in words[-1].after:
            self._page.trail(remark)

    def _opened(self, head: Sequence[Word], opening: Word) -> None:
        """The head of a block, and its brace. A comment after the brace moves to the head."""
        if head and not head[-1].after and not opening.before:
            head[-1].after = opening.after
            opening.after = []
        if head:
            self._line(head)
            self._comments_above(opening)
        self._line([opening])
        self._page.level += 1

    def _items(self, words: Sequence[Word]) -> None:
        """A list, one item a line."""
        begin = 0
        for index, word in enumerate(words):
            if word.text == "," or index + 1 == len(words):
                self._above(words[begin], first=begin == 0)
                self._line(words[begin : index + 1])
                begin = index + 1

    def _closed(self, closing: Word, tail: Sequence[Word], first: bool = False) -> None:
        """The comments at the end of a block, its brace, and what follows it."""
        self._comments_above(closing, first)
        self._page.level -= 1
        self._line([closing, *tail])

    # Taking words.

    @property
    def _peek(self) -> Word:
        return self._words[self._next]

    def _pop(self) -> Word:
        self._next += 1
        return self._words[self._next - 1]

    def _take(self) -> list[Word]:
        """The words up to a semicolon, or before a brace."""
        taken: list[Word] = []
        while self._peek.text not in ("{", "}") and self._peek.kind != END:
            taken.append(self._pop())
            if taken[-1].text == ";":
                break
        return taken

    def _tail(self, closing: Word, goes_on: bool = False) -> list[Word]:
        """The end of the statement after a brace: a semicolon, which is added if it is missing."""
        if self._peek.text == ";" or goes_on:
            return self._take()
        comments, closing.after = closing.after, []
        return [Word(";", "SEMICOLON", after=comments)]

    def _begins_list(self) -> bool:
        """Whether the next braces contain items, not statements."""
        ahead = self._next + 1
        while self._words[ahead].text not in ("{", ";", "}"):
            ahead += 1
        return self._words[ahead].text == "}" and ahead > self._next + 1


def _is_spread(opening: Word, inside: Sequence[Word], closing: Word) -> bool:
    """Whether a list was written one item a line for a reason: groups of items, comments, or a comma at its end."""
    comments = [*opening.after, *closing.before, *(r for word in inside for r in (*word.before, *word.after))]
    return bool(comments) or inside[-1].text == "," or any(b.text == "," and w.blank for b, w in pairwise(inside))


def _group(words: Sequence[Word], tight: frozenset[str]) -> Group:
    """A statement, with the places where it can be broken: after commas, and before words that continue it."""
    root = Group(hangs=False)
    inside = [root]
    before: Word | None = None
    for word in _without_idle_commas(words):
        if word.kind in _CONTINUES or word.text == ";":
            del inside[1:]
        if before is not None:
            inside[-1].parts += _between(before, word)
        if word.text == ")":
            inside.pop()
        inside[-1].parts.append(_space(before, word, tight) + word.text)
        if before is None or word.kind in _CONTINUES or word.text in ("(", "=>"):
            inner = Group()
            inside[-1].parts.append(inner)
            inside.append(inner)
        before = word
    return root


def _between(before: Word, word: Word) -> list[str | Remark | Break]:
    """The comments between two words of a statement, and whether it can be broken there.

    A comment that does not end its line is like a word.
    """
    comments = [*before.after, *word.before]
    ending = 0
    for index in reversed(range(len(comments))):
        if index + 1 < len(comments) and comments[index + 1].breaks:  # nothing but comments follows it on its line
            comments[index] = replace(comments[index], ends=True)
        if comments[index].breaks and index < len(before.after):
            ending = max(ending, index + 1)
    parts: list[str | Remark | Break] = [each if each.breaks else f" {each.text}" for each in comments]
    if comments and before.text in _OPENERS:
        parts[0] = parts[0].lstrip() if isinstance(parts[0], str) else parts[0]
    if before.text == "," or word.kind in _CONTINUES:
        parts.insert(ending, BREAK)
    return parts


def _without_idle_commas(words: Sequence[Word]) -> list[Word]:
    """The words without trailing commas."""
    kept: list[Word] = []
    for word in words:
        while len(kept) > 1 and kept[-1].text == "," and word.text in (";", ")"):
            comma = kept.pop()
            word.before[:0] = [*comma.before, *comma.after]
        kept.append(word)
    return kept


def _space(before: Word | None, word: Word, tight: frozenset[str]) -> str:
    if before is None or word.text in _NO_SPACE_BEFORE:
        return ""
    if before.after or word.before:
        return " "
    if before.text in _NO_SPACE_BEHIND or before.text in tight or word.text in tight:
        return ""
    return "" if word.text == "(" and before.kind != "GUI" else " "
