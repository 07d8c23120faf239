"""MessagePack as other languages see it."""

from __future__ import annotations

import math
import struct
from typing import Any

import msgpack
import numpy as np
import pytest

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    STRING,
    TIME,
    UINT8,
    UINT64,
    Dictionary,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    dtypes,
    spell,
)
from robocomp_py.errors import DecodeError, EncodeError
from robocomp_py.testing.conformance import assert_same
from robocomp_py.testing.everything import Colour, Nothing, Point
from robocomp_py.wire.messagepack import MAX_TREE, MessagePack
from robocomp_py.wire.packed_arrays import APART
from robocomp_py.wire.stream import PIECE

from .codecs import one, there_and_back

CODEC = MessagePack()
POINT, COLOUR = Point.__contract__, Colour.__contract__


def sent(kind: Type, value: Any) -> Any:
    """What a program in another language unpacks."""
    (packed,) = CODEC.encoder(one(kind))((value,))
    (tree,) = msgpack.unpackb(packed, strict_map_key=False)
    return tree


def received(kind: Type, tree: Any, *frames: bytes) -> Any:
    """What arrives of what a program in another language packs."""
    (value,) = CODEC.decoder(one(kind))([msgpack.packb([tree]), *frames])
    return value


FORMS: list[tuple[Type, Any, Any]] = [
    (BOOL, True, True),
    (UINT64, 2**64 - 1, 2**64 - 1),
    (FLOAT32, 0.5, 0.5),
    (STRING, "é", "é"),
    (TIME, -1, -1),
    (COLOUR, Colour.ultraviolet, -7),
    (POINT, Point(1.0, 2.0), [1.0, 2.0]),
    (Nothing.__contract__, Nothing(), []),
    (Sequence(POINT), [Point()], [[0.0, 0.0]]),
    (Dictionary(INT32, STRING), {-1: "x"}, {-1: "x"}),
    (Dictionary(COLOUR, POINT), {Colour.green: Point()}, {1: [0.0, 0.0]}),
    (Sequence(UINT8), b"\x00\xff", b"\x00\xff"),
    (Sequence(BOOL), [True, False], msgpack.ExtType(1, b"?\x01\x00")),
    (Sequence(Primitive.INT8), [-1], msgpack.ExtType(1, b"b\xff")),
    (Sequence(INT16), [1, -1], msgpack.ExtType(1, b"h\x01\x00\xff\xff")),
    (Sequence(Primitive.UINT16), [1], msgpack.ExtType(1, b"H\x01\x00")),
    (Sequence(INT32), [1], msgpack.ExtType(1, b"i\x01\x00\x00\x00")),
    (Sequence(Primitive.UINT32), [1], msgpack.ExtType(1, b"I\x01\x00\x00\x00")),
    (Sequence(Primitive.INT64), [1], msgpack.ExtType(1, b"q\x01" + bytes(7))),
    (Sequence(UINT64), [1], msgpack.ExtType(1, b"Q\x01" + bytes(7))),
    (Sequence(FLOAT32), [0.5], msgpack.ExtType(1, b"f" + struct.pack("<f", 0.5))),
    (Sequence(FLOAT64), [0.5], msgpack.ExtType(1, b"d" + struct.pack("<d", 0.5))),
    (Sequence(FLOAT64), [], msgpack.ExtType(1, b"d")),
]


@pytest.mark.parametrize(("kind", "value", "tree"), FORMS)
def test_every_type_has_one_form(kind: Type, value: Any, tree: Any) -> None:
    assert sent(kind, value) == tree
    assert_same(received(kind, tree), there_and_back(CODEC, kind, value))


def test_a_message_is_the_list_of_its_fields() -> None:
    message = Struct("Test::Message", (Field("a", INT32), Field("b", STRING)))
    assert CODEC.encoder(message)((1, "x")) == [b"\x92\xd2\x00\x00\x00\x01\xa1x"]
    assert CODEC.encoder(Struct("Test::Empty", ()))(()) == [b"\x90"]


def test_large_arrays_travel_in_buffers_of_their_own() -> None:
    message = Struct(
        "Test::Message", tuple(Field(n, Sequence(k)) for n, k in (("a", UINT8), ("b", FLOAT32), ("c", UINT8)))
    )
    values = (np.ones(APART, np.uint8), np.ones(APART // 4, np.float32), np.ones(APART - 1, np.uint8))
    packed, first, second = CODEC.encoder(message)(values)
    tree = msgpack.unpackb(packed)
    assert tree[0] == msgpack.ExtType(2, b"B\x01\x00\x00\x00")
    assert tree[1] == msgpack.ExtType(2, b"f\x02\x00\x00\x00")
    assert tree[2] == values[2].tobytes()
    assert (bytes(first), bytes(second)) == (values[0].tobytes(), values[1].tobytes())


@pytest.mark.parametrize("kind", [BOOL, INT8, UINT8])
@pytest.mark.parametrize("size", [254, 255, 256, APART - 2, APART - 1, APART])
def test_arrays_of_any_size_come_back(kind: Primitive, size: int) -> None:
    message = one(Sequence(kind))
    payload = CODEC.encoder(message)((np.ones(size, dtypes()[kind]),))
    (array,) = CODEC.decoder(message)(payload)
    assert (array.size, array.dtype) == (size, dtypes()[kind])
    assert len(payload) == (1 if size < APART else 2)


def test_arrays_are_received_without_a_copy() -> None:
    payload = [bytes(part) for part in CODEC.encoder(one(Sequence(FLOAT64)))((np.ones(APART),))]
    (array,) = CODEC.decoder(one(Sequence(FLOAT64)))(payload)
    assert np.shares_memory(array, np.frombuffer(payload[1], np.uint8))


def test_read_only_arrays_are_sent_without_a_copy() -> None:
    for frozen in (np.arange(float(APART)), np.ones((2, APART))):
        frozen.flags.writeable = False
        payload = CODEC.encoder(one(Sequence(FLOAT64)))((frozen,))
        assert np.shares_memory(np.frombuffer(payload[1]), frozen)
    received_ = CODEC.decoder(one(Sequence(FLOAT64)))([bytes(part) for part in payload])
    again = CODEC.encoder(one(Sequence(FLOAT64)))(received_)
    assert np.shares_memory(np.frombuffer(again[1]), received_[0])


@pytest.mark.parametrize("size", [3, APART])
def test_received_arrays_are_aligned(size: int) -> None:
    for kind, dtype in dtypes().items():
        assert there_and_back(CODEC, Sequence(kind), np.zeros(size, dtype)).flags.aligned


LENIENT: list[tuple[Type, Any, Any]] = [
    (FLOAT64, 1, 1.0),
    (FLOAT32, 2**64 - 1, 2.0**64),
    (FLOAT32, math.inf, math.inf),
    (FLOAT32, 0.1, 0.1),
    (POINT, [1, 2], Point(1.0, 2.0)),
    (Sequence(POINT), [[1, 2.5]], [Point(1.0, 2.5)]),
    (Sequence(UINT8), [0, 255], np.array([0, 255], np.uint8)),
    (Sequence(INT16), [1, -1], np.array([1, -1], np.int16)),
    (Sequence(UINT64), [2**64 - 1], np.array([2**64 - 1], np.uint64)),
    (Sequence(FLOAT32), [1, 0.5], np.array([1, 0.5], np.float32)),
    (Sequence(BOOL), [True], np.array([True])),
    (Sequence(FLOAT64), [], np.array([])),
]


@pytest.mark.parametrize(("kind", "tree", "value"), LENIENT)
def test_plain_numbers_and_lists_of_them_are_taken(kind: Type, tree: Any, value: Any) -> None:
    found = received(kind, tree)
    assert_same(found, value)
    assert not isinstance(found, np.ndarray) or not found.flags.writeable


WRONG: list[tuple[Type, Any, str]] = [
    (BOOL, 1, "expected a bool, found int"),
    (INT32, True, "expected int32, found bool"),
    (INT32, 2**31, "expected int32, found int"),
    (INT32, 1.0, "expected int32, found float"),
    (FLOAT64, True, "expected a number, found bool"),
    (FLOAT64, "1", "expected a number, found str"),
    (FLOAT32, True, "expected a number, found bool"),
    (FLOAT32, 1e39, "OverflowError"),
    (STRING, b"text", "expected a string, found bytes"),
    (STRING, None, "expected a string, found NoneType"),
    (TIME, 2**63, "expected time, found int"),
    (TIME, msgpack.Timestamp(1), "expected time, found Timestamp"),
    (COLOUR, 5, "KeyError: 5"),
    (COLOUR, True, "expected an enumerator, found bool"),
    (COLOUR, 1.0, "expected an enumerator, found float"),
    (COLOUR, [], "expected an enumerator, found list"),
    (POINT, [1.0], "not enough values"),
    (POINT, [1.0, 2.0, 3.0], "too many values"),
    (POINT, "xy", "expected a list, found str"),
    (POINT, {0: 1.0, 1: 2.0}, "expected a list, found dict"),
    (Sequence(POINT), ["xy"], "expected a list of lists, found list"),
    (Sequence(POINT), {}, "expected a list of lists, found dict"),
    (Sequence(POINT), [[1.0]], "not enough values"),
    (Sequence(STRING), "text", "expected a list, found str"),
    (Sequence(STRING), {"a": 1}, "expected a list, found dict"),
    (Dictionary(STRING, INT32), ["a", 1], "expected a map, found list"),
    (Dictionary(INT32, INT32), {1.0: 1}, "expected int32, found float"),
    (Sequence(INT16), b"ab", "expected an array of int16, found one of uint8"),
    (Sequence(INT16), [1, None], "expected an array of int16, found list"),
    (Sequence(INT16), [[1], [2]], "expected an array of int16, found list"),
    (Sequence(INT16), ["a" * 1000] * 1000, "expected an array of numbers, found a list of something else"),
    (Sequence(INT16), [2**15], "values from 32768 to 32768"),
    (Sequence(INT16), [0.5], "float64 values"),
    (Sequence(INT16), None, "expected an array of int16, found NoneType"),
    (Sequence(INT16), msgpack.ExtType(1, b"H\x01\x00"), "expected an array of int16, found one of uint16"),
    (Sequence(INT16), msgpack.ExtType(1, b"h\x01\x00\x02"), "1 bytes more than 1 of int16"),
    (Sequence(INT16), msgpack.ExtType(1, b""), "IndexError"),
    (Sequence(INT16), msgpack.ExtType(1, b"z\x01\x00"), "KeyError"),
    (Sequence(INT16), msgpack.ExtType(3, b"h\x01\x00"), "expected an array of int16, found ExtType"),
    (Sequence(BOOL), msgpack.ExtType(1, b"?\x02"), "a bool is neither 0 nor 1"),
    (Sequence(INT16), msgpack.ExtType(2, b"h\x00\x00\x00\x00"), "buffer 0, which holds no array"),
    (Sequence(INT16), msgpack.ExtType(2, b"h\x02\x00\x00\x00"), "IndexError"),
    (Sequence(INT16), msgpack.ExtType(2, b"h\xff\xff\xff\xff"), "IndexError"),
    (Sequence(INT16), msgpack.ExtType(2, b"H\x01\x00\x00\x00"), "expected an array of int16, found one of uint16"),
    (Sequence(INT16), msgpack.ExtType(2, b"h\x01"), "unpack requires a buffer of 5 bytes"),
]


@pytest.mark.parametrize(("kind", "tree", "reason"), WRONG)
def test_a_tree_of_another_type_is_refused(kind: Type, tree: Any, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        received(kind, tree, b"\x01\x00")


def test_an_array_apart_must_be_whole() -> None:
    with pytest.raises(DecodeError, match="1 bytes more than 1 of int16"):
        received(Sequence(INT16), msgpack.ExtType(2, b"h\x01\x00\x00\x00"), b"\x01\x00\x02")


def test_two_arrays_may_refer_to_one_buffer() -> None:
    reference = msgpack.ExtType(2, b"h\x01\x00\x00\x00")
    arrays = received(Sequence(Sequence(INT16)), [reference, reference], b"\x01\x00")
    assert [array.tolist() for array in arrays] == [[1], [1]]


def test_what_is_not_a_large_array_has_a_limit_of_its_own() -> None:
    with pytest.raises(EncodeError, match="bytes besides large arrays"):
        there_and_back(CODEC, STRING, "x" * MAX_TREE)
    with pytest.raises(DecodeError, match="bytes besides large arrays"):
        CODEC.decoder(one(STRING))([b"\x90" * (MAX_TREE + 1)])
    array = np.zeros(MAX_TREE + 1, np.uint8)
    assert_same(there_and_back(CODEC, Sequence(UINT8), array), array)


LONG, TAGS = "x" * (PIECE + 1), Sequence(STRING)
TAGGED = Struct("Test::Tagged", (Field("name", STRING), Field("tags", TAGS), Field("index", Dictionary(STRING, INT32))))
LARGE: list[tuple[Type, Any]] = [
    (STRING, LONG),
    (TAGS, ["tag"] * PIECE),
    (TAGS, ["a", LONG, "", LONG, *["b"] * 1000]),
    (TAGS, ["tag" * 10_000] * 20),
    (Sequence(TAGS), [["tag"] * PIECE, [], [LONG], *[["a", "b"]] * PIECE]),
    (Dictionary(STRING, STRING), {f"key {n}": "value" for n in range(10_000)}),
    (Dictionary(STRING, STRING), {"a": "b", LONG: LONG, "c": "d"}),
    (Dictionary(INT32, TAGS), {1: ["a"], 2: ["tag"] * PIECE, 3: []}),
    (TAGGED, ("name", ["tag"] * PIECE, {f"key {n}": n for n in range(10_000)})),
    (Sequence(TAGGED), [("a", ["b"], {"c": 1}), (LONG, [], {}), *[("d", ["e", "f"], {"g": 2})] * 10_000]),
    (Sequence(Sequence(INT16)), [np.arange(100, dtype=np.int16)] * 1000),
]


@pytest.mark.parametrize(("kind", "value"), LARGE, ids=[spell(kind) for kind, _ in LARGE])
def test_values_of_any_size_come_back(kind: Type, value: Any) -> None:
    message = Struct("Test::Message", (Field("before", INT32), Field("value", kind), Field("after", STRING)))
    payload = CODEC.encoder(message)((1, value, "x"))
    assert len(payload[0]) > PIECE
    assert_same(list(CODEC.decoder(message)(payload)), [1, value, "x"])
    longer = [msgpack.packb([*msgpack.unpackb(payload[0], strict_map_key=False), "more"])]
    assert_same(list(CODEC.decoder(message, prefix=True)(longer)), [1, value, "x"])
    for wrong in (longer[0], payload[0] + b"\x00", payload[0][:-1], b"\x94" + payload[0][1:]):
        with pytest.raises(DecodeError):
            CODEC.decoder(message)([wrong])


@pytest.mark.parametrize("there", [10, 3_000, 100_000])
def test_a_list_of_numbers_in_place_of_an_array_must_be_whole(there: int) -> None:
    decode = CODEC.decoder(one(Sequence(INT16)))
    assert len(decode([b"\x91\xdd" + struct.pack(">I", there) + b"\x01" * there])[0]) == there
    with pytest.raises(DecodeError):
        decode([b"\x91\xdd" + struct.pack(">I", there + 1) + b"\x01" * there])


def test_numbers_in_a_list_that_is_larger_than_a_piece_are_an_array() -> None:
    numbers = list(range(30_000))
    assert_same(received(Sequence(INT16), numbers), np.array(numbers, np.int16))
    arrays = received(Sequence(Sequence(INT16)), [[1], numbers, [2]])
    assert_same(arrays, [np.array(each, np.int16) for each in ([1], numbers, [2])])


def test_every_dtype_has_a_letter() -> None:
    for kind, dtype in dtypes().items():
        array = np.zeros(APART, dtype)
        assert_same(there_and_back(CODEC, Sequence(kind), array), array)


def test_a_payload_that_is_sent_at_once_need_not_copy_large_arrays() -> None:
    array = np.zeros(APART, np.uint8)
    message = one(Sequence(UINT8))
    _, shared = CODEC.encoder(message, snapshot=False)((array,))
    _, kept = CODEC.encoder(message)((array,))
    array[0] = 7
    assert (bytes(shared)[0], bytes(kept)[0]) == (7, 0)
