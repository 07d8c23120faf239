"""A configuration with several statements that are no TOML is told all of them, and what is right is still read."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.mending import MOST_CHARACTERS, MOST_MENDED, mend

HERE = Path("config.toml")

WRONG = {
    "a text without quotes": "mode = fast",
    "a text that is not closed": 'mode = "fast',
    "a value forgotten": "mode =",
    "an equals sign forgotten": "mode fast",
    "a key twice": "before = 2",
    "a list that is not closed": "list = [1, 2",
    "a wrong item in a list of several lines": "list = [\n  1,\n  two,\n  3,\n]",
    "a table in a line that is not closed": "table = { a = 1, b = 2",
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_statement_is_reported_once_and_the_rest_is_read(name: str) -> None:
    statement = WRONG[name]
    text = f"before = 1\n{statement}\nafter = 2\n[table2]\nx = 3\n"
    mended = mend(text, HERE)
    assert len(mended.errors) == 1
    assert tomllib.loads(mended.text) == {"before": 1, "after": 2, "table2": {"x": 3}}
    assert len(mended.text) == len(text)
    assert mended.text.index("after") == text.index("after")
    assert not mended.lacks_header


def test_several_errors_are_reported_each_at_its_place() -> None:
    text = "a = x\nb = 1\nc = y z\n[t]\nd = [1,\n  e]\nf = 2\n"
    mended = mend(text, HERE)
    assert [text.count("\n", 0, each.offset) + 1 for each in mended.errors] == [1, 3, 6]
    assert tomllib.loads(mended.text) == {"b": 1, "t": {"f": 2}}


def test_what_was_left_out_is_known() -> None:
    mended = mend("max_speed = fast\n", HERE)
    assert mended.removed_name("max_speed")
    assert not mended.removed_name("speed")


def test_a_broken_table_header_is_noted_as_missing() -> None:
    assert mend("[params\nx = 1\n", HERE).lacks_header


def test_the_first_error_of_a_very_long_text_is_reported() -> None:
    text = "a = x\n" * MOST_CHARACTERS
    assert len(mend(text, HERE).errors) == 1


def test_a_right_text_is_left_as_it_is() -> None:
    assert mend("a = 1\n", HERE).text == "a = 1\n"
    assert mend("a = 1\n", HERE).errors == ()


@given(st.text(alphabet="a1=[]{}\"\n'#., \r", max_size=60))
def test_any_text_is_reported_and_no_offset_moves(text: str) -> None:
    mended = mend(text, HERE)
    assert len(mended.text) == len(text)
    assert len(mended.errors) <= MOST_MENDED
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        assert mended.errors
    else:
        assert not mended.errors
