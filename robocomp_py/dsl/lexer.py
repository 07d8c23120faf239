"""The words of a text, as the state of its parser has them: a keyword is one only where it can stand, else a name.

One regular expression finds the words that all languages share. Kinds of words that a single language has (an
address, a programming language) are tried first, where they can stand.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from lark import Token

STRANGE, END = "STRANGE", "$END"
"""The kinds of a character that begins no word, and of what comes last."""

_SHARED = ("NAME", "STRING", "INT", "NUMBER", "WS")
_SPACE = r"[ \t\f\r\n]*"
_NOTHING = r"(?!)"


class Terminal(NamedTuple):
    """A kind of words: those that always say the same, keywords and marks, and those that match an expression."""

    name: str
    value: str
    fixed: bool
    in_any_case: bool


class Word(Token):
    """A token that knows its offsets only: lines and columns are counted for what is reported."""

    __slots__ = ()
    line = column = end_line = end_column = None


def make_word(kind: str, text: str, start: int, end: int) -> Word:
    made = str.__new__(Word, text)  # Token's own constructor takes longer than all the rest of lexing
    made.type, made.value, made.start_pos, made.end_pos = kind, text, start, end
    return made


class Lexer:
    """The words of one language. `states` say which kinds of words can come next, by number."""

    def __init__(self, terminals: Sequence[Terminal], states: Mapping[int, Collection[str]]) -> None:
        self._states = states
        self._marks = {each.value: each.name for each in terminals if each.fixed and not each.value[0].isalpha()}
        self._exact: dict[str, list[str]] = {}
        self._folded: dict[str, list[str]] = {}
        for each in terminals:
            if each.fixed and each.value[0].isalpha():
                known, key = (self._folded, each.value.lower()) if each.in_any_case else (self._exact, each.value)
                known.setdefault(key, []).append(each.name)
        patterns = {each.name: each.value for each in terminals if not each.fixed}
        self._integer = re.compile(patterns["INT"]).fullmatch if "INT" in patterns else None
        self._only_integers = "NUMBER" not in patterns
        marks = "|".join(map(re.escape, sorted(self._marks, key=len, reverse=True))) or _NOTHING
        number = patterns.get("NUMBER") or patterns.get("INT") or _NOTHING
        self._find = re.compile(
            rf"{_SPACE}(?:(?P<NAME>[A-Za-z_][A-Za-z0-9_]*)|(?P<STRING>\"[^\"\n]*\")|(?P<NUMBER>{number})"
            rf"|(?P<MARK>{marks})|(?P<{STRANGE}>[^ \t\f\r\n]))"
        ).match
        own = {name: re.compile(rf"{_SPACE}({value})").match for name, value in patterns.items() if name not in _SHARED}
        self._own = {state: [(name, own[name]) for name in own if name in kinds] for state, kinds in states.items()}

    def words(self, text: str, stack: Sequence[int]) -> Iterator[Word]:
        """The words of a text, in order, and its end. `stack` ends with the state that its parser is in."""
        own, find = self._own, self._find
        at = 0
        while True:
            state = stack[-1]
            for name, match in own[state]:
                if found := match(text, at):
                    start, at = found.span(1)
                    kind = name
                    break
            else:
                found = find(text, at)
                if found is None:
                    break
                start, at = found.span(found.lastindex or 0)
                kind = self._kind(found.lastgroup or "", text[start:at], state)
            yield make_word(kind, text[start:at], start, at)
        yield make_word(END, "", len(text), len(text))

    def _kind(self, group: str, text: str, state: int) -> str:
        match group:
            case "MARK":
                return self._marks[text]
            case "NAME":
                named = self._exact.get(text) or (self._folded.get(text.lower()) if self._folded else None)
                return next((each for each in named or () if each in self._states[state]), group)
            case "NUMBER" if self._only_integers:
                return "INT"
            case "NUMBER" if "NUMBER" not in self._states[state] and self._integer and self._integer(text):
                return "INT"
            case _:
                return group
