"""Which values fit a type: the same for every codec, and what is wrong with the others is said in the same words."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import make_dataclass
from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    INT64,
    STRING,
    TIME,
    UINT8,
    UINT64,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    dtypes,
    spell,
)
from robocomp_py.errors import EncodeError
from robocomp_py.testing.conformance import assert_same
from robocomp_py.testing.everything import Colour, Nested, Nothing, Point, Scalars
from robocomp_py.wire.arrays import as_array
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.explain import explain
from robocomp_py.wire.values import RANGES

from .codecs import CODECS, every_codec, one, there_and_back
from .oddities import FLOAT32_LIMIT, ODDITIES, Direction, Mood, Place, Text

TIME_MIN, TIME_MAX = RANGES[TIME]
TIME_WORDS = f"an int, nanoseconds since 1970, from {TIME_MIN} to {TIME_MAX}"

LEVEL = Enumeration("Test::Level", (("low", 0), ("high", 1)))
PAIR = Struct("Test::Pair", (Field("number", INT32), Field("name", STRING)))
POINT, COLOUR, NOTHING = Point.__contract__, Colour.__contract__, Nothing.__contract__

KINDS: list[Type] = [
    *Primitive,
    COLOUR,
    LEVEL,
    POINT,
    NOTHING,
    PAIR,
    *map(Sequence, dtypes()),
    *map(Sequence, (STRING, TIME, POINT, COLOUR, NOTHING, PAIR, Sequence(INT32))),
    Dictionary(STRING, INT32),
    Dictionary(INT8, STRING),
    Dictionary(BOOL, STRING),
    Dictionary(COLOUR, FLOAT32),
]

_BESIDE = make_dataclass("Beside", [("value", object), ("other", object)], slots=True)


def _places(kind: Type) -> Iterator[tuple[Type, Callable[[Any], Any]]]:
    """Where a type can stand, and how a value is put there: each is compiled in another way."""
    beside = Struct("Test::Beside", (Field("value", kind), Field("other", FLOAT32)), _BESIDE)
    yield kind, lambda value: value
    yield beside, lambda value: _BESIDE(value, 0.5)
    yield Sequence(beside), lambda value: [_BESIDE(value, 0.5)]
    yield Dictionary(STRING, kind), lambda value: {"key": value}
    if not (isinstance(kind, Primitive) and kind in dtypes()):
        yield Sequence(kind), lambda value: [value]


def _outcome(codec: Codec, kind: Type, value: Any) -> Any:
    """What arrives, or in which words it is refused, but for addresses in memory."""
    try:
        return there_and_back(codec, kind, value)
    except EncodeError as refused:
        return re.sub("0x[0-9a-f]+", "0x", str(refused))


@pytest.mark.parametrize("kind", KINDS, ids=spell)
def test_what_one_codec_takes_all_take_and_what_one_refuses_all_refuse(
    kind: Type, monkeypatch: pytest.MonkeyPatch
) -> None:
    explained: list[str | None] = []

    def explain_once(message: Struct, values: Any) -> str | None:
        """To explain takes longer than all else, and the codecs ask for the same explanation."""
        if not explained:
            explained.append(explain(message, values))
        return explained[0]

    monkeypatch.setattr("robocomp_py.wire.explain.explain", explain_once)
    first, *others = CODECS
    for place, put in _places(kind):
        encoders = {id(codec): _Compiled(codec, place) for codec in CODECS}
        for make in ODDITIES:
            explained.clear()
            expected = _outcome(encoders[id(first)], place, put(make()))
            for other in others:
                assert_same(
                    _outcome(encoders[id(other)], place, put(make())), expected, f"{other.name}, {spell(place)}"
                )


class _Compiled:
    """A codec that compiles one message once."""

    def __init__(self, codec: Codec, kind: Type) -> None:
        self.name = codec.name
        self._encoder, self._decoder = codec.encoder(one(kind)), codec.decoder(one(kind))

    def encoder(self, message: Struct) -> Any:
        return self._encoder

    def decoder(self, message: Struct, *, prefix: bool = False) -> Any:
        return self._decoder


def _single(value: float) -> float:
    return float(np.float32(value))


ACCEPTED: list[tuple[Type, Any, Any]] = [
    (BOOL, np.True_, True),
    (INT32, True, 1),
    (INT32, np.int64(-5), -5),
    (INT32, Colour.ultraviolet, -7),
    (UINT8, np.uint64(255), 255),
    (UINT64, 2**64 - 1, 2**64 - 1),
    (FLOAT64, 1, 1.0),
    (FLOAT64, True, 1.0),
    (FLOAT64, np.float32(0.1), _single(0.1)),
    (FLOAT64, 2**64, 2.0**64),
    (FLOAT32, 0.1, _single(0.1)),
    (FLOAT32, 3, 3.0),
    (FLOAT32, 5e-324, 0.0),
    (FLOAT32, math.inf, math.inf),
    (FLOAT32, math.nan, math.nan),
    (FLOAT32, -0.0, -0.0),
    (FLOAT32, math.nextafter(FLOAT32_LIMIT, 0), _single(3.4028234663852886e38)),
    (STRING, Text("é"), "é"),
    (STRING, np.str_("text"), "text"),
    (STRING, Mood.good, "good"),
    (STRING, Place.here, "here"),
    (STRING, "\N{ROBOT FACE}\0", "\N{ROBOT FACE}\0"),
    (TIME, -1, -1),
    (TIME, TIME_MIN, TIME_MIN),
    (TIME, TIME_MAX, TIME_MAX),
    (TIME, np.uint64(1_500_000_000), 1_500_000_000),
    (COLOUR, 1, Colour.green),
    (COLOUR, np.int8(-7), Colour.ultraviolet),
    (COLOUR, Direction.one, Colour.green),
    (LEVEL, Colour.green, 1),
    (POINT, Point(1, np.float32(0.5)), Point(1.0, 0.5)),
    (Sequence(STRING), ("a", Text("b")), ["a", "b"]),
    (Sequence(STRING), np.array(["a", "b"]), ["a", "b"]),
    (Sequence(COLOUR), np.array([0, -7]), [Colour.red, Colour.ultraviolet]),
    (Sequence(POINT), (Point(), Point()), [Point(), Point()]),
    (Dictionary(INT8, STRING), {np.int8(1): Text("x"), True + 1: "y"}, {1: "x", 2: "y"}),
    (Dictionary(COLOUR, FLOAT32), {0: 0.1}, {Colour.red: _single(0.1)}),
]


@every_codec
@pytest.mark.parametrize(("kind", "given", "arrives"), ACCEPTED)
def test_what_fits_arrives_as_the_plain_python_type(codec: Codec, kind: Type, given: Any, arrives: Any) -> None:
    assert_same(there_and_back(codec, kind, given), arrives)
    assert_same(there_and_back(codec, Dictionary(STRING, kind), {"key": given}), {"key": arrives})


ARRAYS: list[tuple[Primitive, Any, list[Any]]] = [
    (UINT8, b"\0\xff", [0, 255]),
    (UINT8, bytearray(b"ab"), [97, 98]),
    (UINT8, memoryview(b"ab"), [97, 98]),
    (UINT8, [0, 255], [0, 255]),
    (UINT8, np.arange(6).reshape(2, 3), [0, 1, 2, 3, 4, 5]),
    (UINT8, np.asfortranarray(np.arange(6, dtype=np.uint8).reshape(2, 3)), [0, 1, 2, 3, 4, 5]),
    (INT16, np.array([1, -1], ">i4"), [1, -1]),
    (INT16, range(3), [0, 1, 2]),
    (INT16, [np.int64(1), Colour.green], [1, 1]),
    (INT64, np.arange(6)[::-2], [5, 3, 1]),
    (INT64, [], []),
    (INT64, np.zeros(0), []),
    (UINT64, [2**64 - 1], [2**64 - 1]),
    (FLOAT64, (1, 2.5), [1.0, 2.5]),
    (FLOAT64, np.array([1, 2], np.float16), [1.0, 2.0]),
    (FLOAT64, np.ones((2, 2)), [1.0] * 4),
    (FLOAT32, [0.1, math.inf], [_single(0.1), math.inf]),
    (FLOAT32, np.array([0.1, 1e-300]), [_single(0.1), 0.0]),
    (BOOL, [True, np.False_], [True, False]),
]


@every_codec
@pytest.mark.parametrize(("item", "given", "arrives"), ARRAYS)
def test_numbers_and_bools_arrive_as_an_array(codec: Codec, item: Primitive, given: Any, arrives: list[Any]) -> None:
    assert_same(there_and_back(codec, Sequence(item), given), np.array(arrives, dtypes()[item]))


REFUSED: list[tuple[Type, Any, str]] = [
    (BOOL, 1, "value must be a bool, not int 1"),
    (BOOL, None, "value must be a bool, not NoneType None"),
    (INT8, 128, "value must be an int from -128 to 127, not int 128"),
    (INT32, 1.0, "value must be an int from -2147483648 to 2147483647, not float 1.0"),
    (INT32, "1", "value must be an int from -2147483648 to 2147483647, not str '1'"),
    (UINT8, -1, "value must be an int from 0 to 255, not int -1"),
    (UINT64, 2**64, "value must be an int from 0 to 18446744073709551615, not int 18446744073709551616"),
    (FLOAT64, "1.5", "value must be a float (float64), not str '1.5'"),
    (FLOAT64, None, "value must be a float (float64), not NoneType None"),
    (FLOAT32, FLOAT32_LIMIT, "value must be a float (float32), not float 3.4028235677973366e+38"),
    (STRING, b"text", "value must be a str that encodes to UTF-8, not bytes b'text'"),
    (STRING, "\ud800", "value must be a str that encodes to UTF-8, not str '\\ud800'"),
    (TIME, TIME_MAX + 1, f"value must be {TIME_WORDS}, not int 2147483648000000000"),
    (TIME, 1.5, f"value must be {TIME_WORDS}, not float 1.5"),
    (COLOUR, 2, "value must be a Colour, not int 2"),
    (COLOUR, "red", "value must be a Colour, not str 'red'"),
    (COLOUR, 0.0, "value must be a Colour, not float 0.0"),
    (COLOUR, [], "value must be a Colour, not list []"),
    (POINT, None, "value must be a Point, not NoneType None"),
    (POINT, (1.0, 2.0), "value must be a Point, not tuple (1.0, 2.0)"),
    (POINT, Point(1.0, "2"), "value.y must be a float (float64), not str '2'"),
    (PAIR, (1,), "value must be a tuple of 2, the fields of Pair, not tuple (1,)"),
    (PAIR, [1, "a"], "value must be a tuple of 2, the fields of Pair, not list [1, 'a']"),
    (Sequence(STRING), "text", "value must be a list, not str 'text'"),
    (Sequence(STRING), {"a", "b"} - {"b"}, "value must be a list, not set {'a'}"),
    (Sequence(STRING), {"a": 1}, "value must be a list, not dict {'a': 1}"),
    (Sequence(STRING), None, "value must be a list, not NoneType None"),
    (Sequence(STRING), ["a", 1], "value[1] must be a str that encodes to UTF-8, not int 1"),
    (Sequence(Sequence(POINT)), [[], [Point(), 3]], "value[1][1] must be a Point, not int 3"),
    (Sequence(UINT8), [1, 256], "value must be an array of uint8, not list [1, 256]: values from 1 to 256"),
    (Sequence(UINT8), [1.5], "value must be an array of uint8, not list [1.5]: float64 values"),
    (Sequence(INT32), b"ab", "value must be an array of int32, not bytes b'ab': bytes is for sequences of octets"),
    (Sequence(INT32), "12", "value must be an array of int32, not str '12': str is not an array"),
    (Sequence(INT32), {1}, "value must be an array of int32, not set {1}: set is not an array"),
    (Sequence(INT32), 1, "value must be an array of int32, not int 1: int is not an array"),
    (Sequence(INT32), [[1], [2]], "value must be an array of int32, not list [[1], [2]]: 2 dimensions"),
    (Sequence(INT32), np.array(1), "value must be an array of int32, not ndarray array(1): 0 dimensions"),
    (
        Sequence(UINT8),
        np.zeros((200, 300)),
        "value must be an array of uint8, not ndarray of float64, shape (200, 300): float64 values",
    ),
    (POINT, np.zeros(9, [("x", "f4"), ("z", "i2")]), "value must be a Point, not ndarray of fields x, z, shape (9,)"),
    (Sequence(FLOAT32), [1e39], "value must be an array of float32, not list [1e+39]: values exceed float32"),
    (Sequence(FLOAT64), [None], "value must be an array of float64, not list [None]: object values"),
    (Sequence(BOOL), [0, 1], "value must be an array of bool, not list [0, 1]: int64 values"),
    (Dictionary(STRING, INT32), [("a", 1)], "value must be a dict, not list [('a', 1)]"),
    (Dictionary(STRING, INT32), {"a": "1"}, "value['a'] must be an int from -2147483648 to 2147483647, not str '1'"),
    (Dictionary(STRING, INT32), {1: 1}, "key 1 of value must be a str that encodes to UTF-8, not int 1"),
    (Dictionary(INT8, INT8), {1.0: 1}, "key 1.0 of value must be an int from -128 to 127, not float 1.0"),
    (Dictionary(COLOUR, INT8), {5: 1}, "key 5 of value must be a Colour, not int 5"),
]


@every_codec
@pytest.mark.parametrize(("kind", "given", "complaint"), REFUSED)
def test_what_does_not_fit_is_refused_in_words(codec: Codec, kind: Type, given: Any, complaint: str) -> None:
    with pytest.raises(EncodeError) as refused:
        codec.encoder(one(kind))((given,))
    assert str(refused.value) == f"Test::Message: {complaint}"


@pytest.mark.parametrize("item", dtypes())
def test_an_array_of_numpys_own_is_taken_as_it_is(item: Primitive) -> None:
    array = np.zeros(3, item.value)
    assert as_array(array, dtypes()[item]) is array
    assert (array.dtype is dtypes()[item]) == (sys.byteorder == "little"), "it takes longer to see that it fits"


@every_codec
def test_generators_are_refused_because_they_could_be_sent_only_once(codec: Codec) -> None:
    for kind in (Sequence(STRING), Sequence(INT32)):
        generator = (each for each in ())
        with pytest.raises(EncodeError, match=r"value must be .*, not generator"):
            codec.encoder(one(kind))((generator,))


@every_codec
def test_the_complaint_leads_to_the_field_however_deep(codec: Codec) -> None:
    message = Struct("Test::Deep", (Field("ok", INT32), Field("nested", Nested.__contract__)))
    cases: list[tuple[Nested, str]] = [
        (Nested(scalars=Scalars(u16=-1)), "nested.scalars.u16 must be an int from 0 to 65535, not int -1"),
        (Nested(points=[Point(), None]), "nested.points[1] must be a Point, not NoneType None"),
        (Nested(by_name={"a": 1}), "nested.by_name['a'] must be a Point, not int 1"),
        (Nested(rows=[[Point("", 0)]]), "nested.rows[0][0].x must be a float (float64), not str ''"),
    ]
    for value, complaint in cases:
        with pytest.raises(EncodeError, match=re.escape(f"Test::Deep: {complaint}")):
            codec.encoder(message)((1, value))


@every_codec
def test_a_wrong_number_of_values_is_refused(codec: Codec) -> None:
    for values in ((), (1, 2), None, 1):
        with pytest.raises(EncodeError, match="Test::Message: expected 1 values, got "):
            codec.encoder(one(INT32))(values)


@every_codec
def test_large_wrong_values_are_shown_in_part(codec: Codec) -> None:
    with pytest.raises(EncodeError) as refused:
        codec.encoder(one(INT32))((["x" * 1000] * 1000,))
    assert len(str(refused.value)) < 600
