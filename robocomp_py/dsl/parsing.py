"""LALR parsing by lark, and the words that can follow any prefix of a text."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable

from lark import Token, Tree, UnexpectedInput, UnexpectedToken
from lark.parsers.lalr_interactive_parser import InteractiveParser

from .tables import Grammar, load, make

STRANGE, END = "STRANGE", "$END"
"""The kinds of a character that begins no word, and of what comes last."""

State = InteractiveParser
"""The state of a parser after some words."""


class Unexpected(Exception):  # not derived from the errors in errors.py: it stays within the languages
    """A word that the parser cannot accept in its state."""

    def __init__(self, word: Token, state: State) -> None:
        super().__init__(str(word))
        self.word, self.state = word, state


class Parser:
    """The parser of one language."""

    def __init__(self, grammar: Grammar) -> None:
        tables = load(grammar) or make(grammar)
        self._lark = tables.lark
        self.fixed = tables.fixed
        """Keywords and marks, by their kinds."""
        marks = sorted((each for each in self.fixed.values() if not each[0].isalpha()), key=len, reverse=True)
        patterns = {each.name: each.pattern.value for each in self._lark.terminals}
        number = patterns.get("NUMBER") or patterns.get("INT") or "(?!)"
        shared = (r"[A-Za-z_]\w*", r'"[^"\n]*"', number, "|".join(map(re.escape, marks)))
        self._word = re.compile("|".join(f"(?:{each})" for each in shared), re.ASCII)

    def parse(self, text: str, see: Callable[[Token], object] | None = None) -> Tree[Token]:
        """The tree of a text. Passes every word to `see`; raises Unexpected at the first that does not fit."""
        if see is None:
            with contextlib.suppress(UnexpectedInput):  # the next attempt explains it
                return self._lark.parse(text)
        state, last = self._lark.parse_interactive(text), None
        try:
            for last in state.iter_parse():
                if see:
                    see(last)
            tree: Tree[Token] = state.feed_token(Token(END, "", start_pos=len(text), end_pos=len(text)))
        except UnexpectedInput as exc:
            raise Unexpected(self._unexpected(text, exc, last), state) from exc
        return tree

    def _unexpected(self, text: str, error: UnexpectedInput, last: Token | None) -> Token:
        """The word at an error. Its kind is the lexer's choice if the lexer accepted it."""
        if isinstance(error, UnexpectedToken) and (error.token is last or error.token.type == END):
            word: Token = error.token
            return word
        at = error.pos_in_stream or 0
        found = self._word.match(text, at)
        if found is None or not found[0]:
            return Token(STRANGE, text[at : at + 1], start_pos=at, end_pos=at + 1)
        return Token("WORD", found[0], start_pos=at, end_pos=found.end())

    def accepted(self, state: State) -> set[str]:
        """The kinds of words that can come next."""
        kinds: set[str] = state.accepts()  # type: ignore[no-untyped-call]  # lark has types for few of its methods
        return kinds

    def after(self, state: State, kind: str) -> State:
        """The state of the parser after a word of a kind that can come next."""
        behind: State = state.copy(deepcopy_values=False)  # type: ignore[no-untyped-call]  # likewise
        behind.feed_token(Token(kind, ""))
        return behind
