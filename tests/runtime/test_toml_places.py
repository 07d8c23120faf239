"""Where keys and values of TOML texts stand."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.runtime.effective import toml
from robocomp_py.runtime.toml_places import Key, locate

TEXT = r'''# nothing = here
plain = 1 # plain = 2
dotted.key = "x # ]"
"quoted.name" . 'other' = [1, { k = 2, l = [3] }, "]",
  4 # four
]
long = """
[no.table]
""\"\\""""
raw = \'\'\'a''\'\'\'
date = 1979-05-27 07:32:00 # a blank inside
[table]
x = true
[[list]]
name = 'le"ft'
[[list.inner]]
k = 1
[[list]]
[[list.inner]]
k = 2
[[list.inner]]
k = 3
[list.table]
x = 0x10
'''.replace("\\'", "'")


def places(text: str) -> dict[Key, tuple[str, str]]:
    found = {key: (text[slice(*spot.key)], text[slice(*spot.value)]) for key, spot in locate(text).items()}
    return found


@pytest.mark.parametrize(
    ("key", "written", "value"),
    [
        (("plain",), "plain", "1"),
        (("dotted",), "dotted", '"x # ]"'),
        (("dotted", "key"), "key", '"x # ]"'),
        (("quoted.name", "other", 0), "1", "1"),
        (("quoted.name", "other", 1, "k"), "k", "2"),
        (("quoted.name", "other", 1, "l", 0), "3", "3"),
        (("quoted.name", "other", 2), '"]"', '"]"'),
        (("quoted.name", "other", 3), "4", "4"),
        (("long",), "long", '"""\n[no.table]\n""\\"\\\\""""'),
        (("raw",), "raw", "'''a'''''"),
        (("date",), "date", "1979-05-27 07:32:00"),
        (("table",), "table", "[table]"),
        (("table", "x"), "x", "true"),
        (("list",), "list", "[[list]]"),
        (("list", 1), "list", "[[list]]"),
        (("list", 0, "inner"), "inner", "[[list.inner]]"),
        (("list", 1, "table"), "table", "[list.table]"),
        (("list", 0, "name"), "name", "'le\"ft'"),
        (("list", 0, "inner", 0, "k"), "k", "1"),
        (("list", 1, "inner", 0, "k"), "k", "2"),
        (("list", 1, "inner", 1, "k"), "k", "3"),
        (("list", 1, "table", "x"), "x", "0x10"),
    ],
)
def test_every_key_and_every_value_has_its_place(key: Key, written: str, value: str) -> None:
    tomllib.loads(TEXT)
    assert places(TEXT)[key] == (written, value)


def test_keys_in_comments_and_strings_have_no_position() -> None:
    assert {("nothing",), ("no",), ("no", "table")} & set(places(TEXT)) == set()


Words = st.text(max_size=8).filter(lambda text: not any(0xD800 <= ord(char) < 0xE000 for char in text))
Scalars = st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | Words
Values = st.recursive(Scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(Words, inner, max_size=3))


def leaves(value: Any, at: Key) -> dict[Key, Any]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = {key: each for name, part in inner for key, each in leaves(part, (*at, name)).items()}
    return {at: value, **found}


@given(st.dictionaries(Words, Values, max_size=4))
def test_the_text_at_the_place_of_a_value_is_that_value(data: dict[str, Any]) -> None:
    text = "".join(f"{toml(name)} = {toml(each)} # {{[\n" for name, each in data.items())
    assert tomllib.loads(text) == data
    wanted = {key: each for name, value in data.items() for key, each in leaves(value, (name,)).items()}
    found = {key: tomllib.loads(f"x = {value}")["x"] for key, (_, value) in places(text).items()}
    assert found == wanted
