"""Types: their widths, their names, and what is inside them."""

from __future__ import annotations

import numpy as np
import pytest

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_MAX,
    FLOAT64,
    FLOATS,
    INT8,
    INT32,
    INTEGERS,
    STRING,
    TIME,
    UINT8,
    UINT64,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    children,
    dtypes,
    integer_range,
    is_key,
    python_name,
    spell,
    walk,
)

COLOUR = Enumeration("Test::Colour", (("red", 0), ("green", 1)))
POINT = Struct("Test::Point", (Field("x", FLOAT64), Field("colour", COLOUR)))
CLOUD = Struct("Test::Cloud", (Field("points", Sequence(POINT)), Field("by_name", Dictionary(STRING, POINT))))


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [
        (INT8, -128, 127),
        (UINT8, 0, 255),
        (INT32, -(2**31), 2**31 - 1),
        (UINT64, 0, 2**64 - 1),
        (TIME, -2147483648_000000000, 2147483647_999999999),
    ],
)
def test_integers_have_the_range_of_their_width(kind: Primitive, low: int, high: int) -> None:
    assert integer_range(kind) == (low, high)


def test_every_primitive_is_in_exactly_one_family() -> None:
    families = [INTEGERS, FLOATS, {BOOL, STRING, TIME}]
    assert sorted(kind for family in families for kind in family) == sorted(Primitive)


def test_sequences_of_numbers_and_bools_are_arrays_little_endian() -> None:
    for kind in Primitive:
        dtype = Sequence(kind).dtype
        assert dtype == (np.dtype(kind.value).newbyteorder("<") if kind not in (STRING, TIME) else None)
    assert set(dtypes()) == INTEGERS | FLOATS | {BOOL}


@pytest.mark.parametrize("item", [STRING, TIME, COLOUR, POINT, Sequence(INT8), Dictionary(STRING, INT8)])
def test_other_sequences_are_lists(item: Type) -> None:
    assert Sequence(item).dtype is None


def test_the_largest_float32_is_that_of_ieee_754() -> None:
    assert float(np.float32(FLOAT32_MAX)) == FLOAT32_MAX == (2 - 2**-23) * 2.0**127


def test_equal_definitions_are_equal_types() -> None:
    assert Struct("A", (Field("x", INT32),)) == Struct("A", (Field("x", INT32),))
    assert hash(Sequence(POINT)) == hash(Sequence(POINT))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (Struct("A", (Field("x", INT32),)), Struct("B", (Field("x", INT32),))),
        (Struct("A", (Field("x", INT32),)), Struct("A", (Field("y", INT32),))),
        (Struct("A", (Field("x", INT32),)), Struct("A", (Field("x", INT8),))),
        (Struct("A", (Field("x", INT32),)), Struct("A", (Field("x", INT32, default=1),))),
        (Enumeration("E", (("a", 0),)), Enumeration("E", (("a", 1),))),
        (Sequence(INT32), Sequence(INT8)),
        (Dictionary(STRING, INT32), Dictionary(INT32, STRING)),
    ],
)
def test_different_definitions_are_different_types(one: Type, other: Type) -> None:
    assert one != other


def test_neither_documentation_nor_the_name_of_an_alias_makes_a_difference() -> None:
    assert Struct("A", (Field("x", INT32, doc="metres"),), doc="a thing") == Struct("A", (Field("x", INT32),))
    assert Sequence(INT32, "Test::Numbers") == Sequence(INT32)
    assert Dictionary(STRING, INT32, "Test::Table") == Dictionary(STRING, INT32)


@pytest.mark.parametrize("kind", [*sorted(INTEGERS), BOOL, STRING, COLOUR])
def test_keys_are_integers_bools_strings_and_enumerators(kind: Type) -> None:
    assert is_key(kind)


@pytest.mark.parametrize("kind", [FLOAT32, FLOAT64, TIME, POINT, Sequence(UINT8), Dictionary(STRING, INT32)])
def test_nothing_else_is_a_key(kind: Type) -> None:
    assert not is_key(kind)


@pytest.mark.parametrize(
    ("name", "spelt"),
    [("x", "x"), ("lambda", "lambda_"), ("None", "None_"), ("self", "self_"), ("match", "match"), ("Lambda", "Lambda")],
)
def test_names_that_are_words_of_python_get_an_underscore(name: str, spelt: str) -> None:
    assert python_name(name) == spelt
    assert Field(name, INT32).attribute == spelt


def test_the_children_of_a_type_are_the_types_directly_in_it() -> None:
    assert children(POINT) == (FLOAT64, COLOUR)
    assert children(Sequence(POINT)) == (POINT,)
    assert children(Dictionary(STRING, POINT)) == (STRING, POINT)
    assert children(INT32) == children(COLOUR) == ()


def test_walking_finds_each_named_type_once_and_those_used_first() -> None:
    assert list(walk(CLOUD, Sequence(POINT), INT32)) == [COLOUR, POINT, CLOUD]


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (FLOAT32, "float32"),
        (POINT, "Test::Point"),
        (COLOUR, "Test::Colour"),
        (Sequence(Sequence(UINT8, "Test::Row")), "sequence<sequence<uint8>>"),
        (Dictionary(STRING, Sequence(POINT)), "dictionary<string,sequence<Test::Point>>"),
    ],
)
def test_a_type_is_spelt_by_the_names_of_what_is_in_it(kind: Type, text: str) -> None:
    assert spell(kind) == text


def test_an_exception_has_the_fields_of_its_bases_first() -> None:
    base = ExceptionType("Test::Failed", (Field("what", STRING),))
    middle = ExceptionType("Test::Worse", (), base)
    derived = ExceptionType("Test::Worst", (Field("code", INT32),), middle)
    assert [field.name for field in derived.all_fields] == ["what", "code"]
    assert derived.lineage == ("Test::Worst", "Test::Worse", "Test::Failed")
    assert base.lineage == ("Test::Failed",)
