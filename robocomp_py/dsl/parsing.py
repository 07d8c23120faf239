"""LALR parsing: lark reads a grammar and makes its tables; here they are followed, and trees built.

A loop of our own, because most of lark's time would go to what nobody asks for: the lines and columns of every word and
branch. And because the tables tell what can come next, after any number of words, without a tree being built or copied.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from lark import Token, Tree

from .lexer import Lexer, Word
from .tables import Rule, read_tables


class Node(Tree[Token]):
    """A branch that knows its offsets: those of its first and last word, whether the grammar keeps these or not."""

    _meta = None

    def __init__(self, data: str, children: list[Any], start_pos: int, end_pos: int) -> None:
        self.data, self.children, self.start_pos, self.end_pos = data, children, start_pos, end_pos


class Unexpected(Exception):  # not an error of the tree in errors.py: it never leaves the languages
    """A word that cannot come after what the stack stands for."""

    def __init__(self, word: Word, stack: Sequence[int]) -> None:
        super().__init__(str(word))
        self.word, self.stack = word, stack


class Parser:
    """The parser of one language. `name` is the package that holds its grammar.lark."""

    def __init__(self, name: str) -> None:
        tables = read_tables(name)
        self.fixed: dict[str, str] = {each.name: each.value for each in tables.terminals if each.fixed}
        """Keywords and marks, by their kinds."""
        rules = [_Reduction(rule) for rule in tables.rules]
        self._steps: dict[int, dict[str, int | _Reduction]] = {}
        """By state and kind of word: the next state, or what is complete."""
        self._after: dict[int, dict[str, int]] = {}
        """By state and rule: the next state, once the rule is complete."""
        origins = {rule.origin for rule in tables.rules}
        for state, row in tables.states.items():
            self._after[state] = {name: to for name, to in row.items() if name in origins}
            self._steps[state] = {
                kind: to if to >= 0 else rules[~to] for kind, to in row.items() if kind not in origins
            }
        self._start, self._end = tables.start, tables.end
        self._lexer = Lexer(tables.terminals, self._steps)

    def parse(self, text: str, see: Callable[[Word], object] | None = None) -> Node:
        """The tree of a text. Shows every word on the way; raises Unexpected at the first that fits nowhere."""
        steps, after, end = self._steps, self._after, self._end
        stack, values = self.after_nothing, list[Any]()
        for word in self._lexer.words(text, stack):
            kind = word.type
            while True:
                to = steps[stack[-1]].get(kind)
                if isinstance(to, _Reduction):
                    made = to.branch(values[-to.size :])
                    del stack[-to.size :], values[-to.size :]
                    values.append(made)
                    stack.append(after[stack[-1]][to.origin])
                    if stack[-1] == end:
                        return made
                elif to is None:
                    raise Unexpected(word, stack)
                else:
                    stack.append(to)
                    values.append(word)
                    break
            if see:
                see(word)
        raise AssertionError("a text ends with a word that is its end")

    @property
    def after_nothing(self) -> list[int]:
        """The stack in front of a text."""
        return [self._start]

    def accepted(self, stack: Sequence[int]) -> set[str]:
        """The kinds of words that can come next."""
        return {kind for kind in self._steps[stack[-1]] if self.after(stack, kind)}

    def after(self, stack: Sequence[int], kind: str) -> list[int]:
        """The stack behind a word of a kind; empty if it cannot come."""
        states = list(stack)
        while True:
            to = self._steps[states[-1]].get(kind)
            if to is None:
                return []
            if isinstance(to, int):
                return [*states, to]
            del states[-to.size :]
            states.append(self._after[states[-1]][to.origin])
            if states[-1] == self._end:
                return states


class _Reduction:
    """What becomes of the words and branches of a rule that has been read."""

    __slots__ = ("_first", "_kept", "_name", "origin", "size")

    def __init__(self, rule: Rule) -> None:
        self.size, self.origin, self._name = rule.size, rule.origin, rule.name
        dissolves = bool(rule.kept) and rule.kept[0][1]
        self._first = rule.kept[0][0] if dissolves else None
        """A branch whose children come first. Repetitions are such: the list grows, and is never copied."""
        self._kept = rule.kept[1:] if dissolves else rule.kept

    def branch(self, values: list[Any]) -> Node:
        children = [] if self._first is None else values[self._first].children
        for at, dissolved in self._kept:
            if dissolved:
                children += values[at].children
            else:
                children.append(values[at])
        return Node(self._name, children, values[0].start_pos, values[-1].end_pos)
