"""Dictionaries that are written as two columns."""

from __future__ import annotations

import struct
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT64,
    STRING,
    TIME,
    UINT16,
    Dictionary,
    Field,
    Sequence,
    Struct,
    Type,
    spell,
)
from robocomp_py.errors import DecodeError, EncodeError
from robocomp_py.testing import everything as e
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.columns import has_columns

from .codecs import one

COLUMNS, ENTRIES = Cdr(columns=True), Cdr()

COLOUR = e.Colour.__contract__

ITEMS: dict[Any, st.SearchStrategy[Any]] = {
    STRING: st.text(st.characters(exclude_categories=["Cs"])),
    BOOL: st.booleans(),
    INT8: st.integers(-128, 127),
    UINT16: st.integers(0, 65535),
    INT64: st.integers(-(2**63), 2**63 - 1),
    FLOAT32: st.floats(width=32, allow_nan=False),
    FLOAT64: st.floats(allow_nan=False),
    COLOUR: st.sampled_from(e.Colour),
}
KEYS = [STRING, BOOL, INT8, UINT16, INT64, COLOUR]


def there_and_back(kind: Dictionary, value: Any, codec: Cdr = COLUMNS) -> Any:
    message = one(kind)
    (back,) = codec.decoder(message)(codec.encoder(message)((value,)))
    return back


@pytest.mark.parametrize("item", ITEMS, ids=spell)
@pytest.mark.parametrize("key", KEYS, ids=spell)
def test_columns_hold_what_entries_hold(key: Any, item: Any) -> None:
    kind = Dictionary(key, item)

    @hypothesis.settings(max_examples=15)
    @given(st.dictionaries(ITEMS[key], ITEMS[item], max_size=20))
    def check(value: dict[Any, Any]) -> None:
        columns, entries = there_and_back(kind, value), there_and_back(kind, value, ENTRIES)
        assert columns == entries == value
        assert [*map(type, columns), *map(type, columns.values())] == [
            *map(type, entries),
            *map(type, entries.values()),
        ]
        assert list(columns) == list(value)

    check()


@pytest.mark.parametrize("before", range(9))
def test_columns_are_aligned_wherever_they_begin(before: int) -> None:
    message = Struct("Test::Message", (*_fields(STRING, Dictionary(INT8, FLOAT64), Dictionary(STRING, INT64)),))
    values = "x" * before, {1: 0.5, 2: 1.5, 3: 2.5}, {"a": 1, "bcd": 2}
    assert COLUMNS.decoder(message)(COLUMNS.encoder(message)(values)) == values


def _fields(*kinds: Type) -> list[Any]:
    return [Field(f"f{number}", kind) for number, kind in enumerate(kinds)]


@pytest.mark.parametrize("keys", [["a\0b"], ["", "\0"], ["\0\0", "x", "\0"], ["é\0", "日本"]], ids=repr)
def test_strings_may_contain_a_nul(keys: list[str]) -> None:
    value = {key: key for key in keys}
    assert there_and_back(Dictionary(STRING, STRING), value) == value


def test_values_of_numpy_and_floats_for_float32_are_converted_as_in_entries() -> None:
    value = {"a": np.float64(0.1), "b": 1, "c": np.int16(3)}
    kind = Dictionary(STRING, FLOAT32)
    assert there_and_back(kind, value) == there_and_back(kind, value, ENTRIES)


def test_only_dictionaries_of_flat_types_have_columns() -> None:
    assert has_columns(Dictionary(STRING, FLOAT32))
    assert has_columns(Dictionary(COLOUR, STRING))
    for item in (TIME, Sequence(FLOAT32), e.Point.__contract__, Dictionary(STRING, FLOAT32)):
        assert not has_columns(Dictionary(STRING, item))
        value = {"a": {TIME: 5}.get(item, 0)} if item is TIME else {}
        assert there_and_back(Dictionary(STRING, item), value) == value


@pytest.mark.parametrize("wrong", [{1: 0.5}, {"a": "b"}, {"a": 1e39}, {"\ud800": 1.0}, {"a": None}], ids=repr)
def test_what_does_not_fit_is_refused(wrong: Any) -> None:
    with pytest.raises(EncodeError, match="value"):
        COLUMNS.encoder(one(Dictionary(STRING, FLOAT32)))((wrong,))


def _payload(kind: Dictionary, value: Any) -> bytearray:
    return bytearray(COLUMNS.encoder(one(kind))((value,)))


def test_damaged_columns_are_refused() -> None:
    kind = Dictionary(STRING, BOOL)
    decode = COLUMNS.decoder(one(kind))
    good = _payload(kind, {"ab": True, "cd": False})
    places = {
        "more entries": (4, struct.pack("<I", 3)),
        "fewer entries": (4, struct.pack("<I", 1)),
        "a huge number": (4, struct.pack("<I", 2**32 - 1)),
        "long strings": (8, struct.pack("<I", 2**31)),
        "short strings": (8, struct.pack("<I", 4)),
        "lengths that are not there": (12, struct.pack("<I", 1)),
        "not UTF-8": (16, b"\xff"),
        "no NUL between": (18, b"x"),
        "no bool": (21, b"\x02"),
    }
    assert decode(good) == ({"ab": True, "cd": False},)
    for what, (place, octets) in places.items():
        bad = bytearray(good)
        bad[place : place + len(octets)] = octets
        with pytest.raises(DecodeError):
            print(what, decode(bad))
    for end in range(len(good)):
        with pytest.raises(DecodeError):
            decode(good[:end])


def test_an_unknown_enumerator_is_refused() -> None:
    kind = Dictionary(STRING, COLOUR)
    bad = _payload(kind, {"a": e.Colour.green})
    bad[-4:] = struct.pack("<i", 99)
    with pytest.raises(DecodeError):
        COLUMNS.decoder(one(kind))(bad)
