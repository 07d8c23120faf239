"""The tables beside each grammar; codegen/test_golden.py tests that they are those that lark makes from it."""

from __future__ import annotations

from dataclasses import replace

import lark
import pytest

from robocomp_py.dsl.parsing import Parser, Unexpected
from robocomp_py.dsl.tables import load, read_grammar, text_of

from .tables import LANGUAGES


@pytest.mark.parametrize("language", LANGUAGES)
def test_loaded_tables_are_written_as_those_that_were_made(language: str) -> None:
    grammar = read_grammar(language)
    loaded = load(grammar)
    assert loaded is not None, "`make golden` for this version of lark"
    assert text_of(grammar, loaded) == grammar.tables


def test_tables_are_for_one_grammar_and_one_version_of_lark() -> None:
    grammar = read_grammar("smdsl")
    assert load(replace(grammar, own=grammar.own + "\n")) is None
    assert load(replace(grammar, shared=grammar.shared + "\n")) is None
    assert load(replace(grammar, tables=grammar.tables.replace(f'"{lark.__version__}"', '"1.0"'))) is None
    assert load(replace(grammar, tables="{}")) is None


@pytest.mark.parametrize(
    "text", ["machine { states a; ", "machine m { initial_state 3; };", "machine m { end_state é; };"]
)
def test_a_grammar_without_tables_finds_the_same_errors(text: str) -> None:
    grammar = read_grammar("smdsl")
    loaded, made = (_error(Parser(each), text) for each in (grammar, replace(grammar, tables="{}")))
    assert loaded == made


def _error(parser: Parser, text: str) -> tuple[str, str, int | None, set[str]]:
    with pytest.raises(Unexpected) as caught:
        parser.parse(text)
    word = caught.value.word
    return word.type, str(word), word.start_pos, parser.accepted(caught.value.state)
