"""Arrays of records in place of lists of flat structs."""

from __future__ import annotations

from dataclasses import make_dataclass
from enum import IntEnum
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.classic.workers.slices import received
from robocomp_py.contract.interface import Operation, differences
from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT32,
    INT64,
    STRING,
    TIME,
    UINT8,
    UINT16,
    UINT32,
    Dictionary,
    Enumeration,
    Field,
    Sequence,
    Struct,
    Type,
    dtypes,
    spell,
)
from robocomp_py.errors import DecodeError, EncodeError
from robocomp_py.runtime.api import dtype_of, objects_of
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.identity import Identity
from robocomp_py.wire.messagepack import MessagePack

from .codecs import every_codec, every_wire
from .messages import patiently


class Kind(IntEnum):
    ground = 0
    wall = 1
    sky = 7


KIND = Enumeration("Test::Kind", (("ground", 0), ("wall", 1), ("sky", 7)), Kind)
FAR = Enumeration("Test::Far", (("near", -3), ("far", 700)))


POINT = Struct(
    "Test::Point",
    (
        Field("x", FLOAT32),
        Field("y", FLOAT32),
        Field("distance", FLOAT64),
        Field("kind", KIND),
        Field("valid", BOOL),
    ),
    make_dataclass("Point", [(n, Any) for n in ("x", "y", "distance", "kind", "valid")], slots=True),
)
P: Any = POINT.python
P.__contract__ = POINT

RECORDS = Struct("Test::Scan", (Field("points", Sequence(POINT, records=True)),))
LIST = Struct("Test::Scan", (Field("points", Sequence(POINT)),))


def some(count: int) -> list[Any]:
    return [P(n / 2, -n, n * 1.1, list(Kind)[n % 3], n % 2 == 0) for n in range(count)]


def array_of(points: list[Any]) -> np.ndarray[Any, Any]:
    array = np.zeros(len(points), dtype_of(P))
    for name in array.dtype.names or ():
        array[name] = [getattr(point, name) for point in points]
    return array


def octets(payload: Any) -> bytes:
    return b"".join(map(bytes, payload)) if isinstance(payload, list) else bytes(payload)


def lists(array: np.ndarray[Any, Any]) -> list[Any]:
    return array.tolist()  # type: ignore[no-any-return]  # of tuples


def sent(codec: Codec, kind: Struct, points: Any, to: Struct | None = None) -> Any:
    (found,) = codec.decoder(to or kind)(codec.encoder(kind)((points,)))
    return found


@every_codec
@pytest.mark.parametrize("count", [0, 1, 2, 40, 5000])
def test_an_array_arrives_as_an_array(codec: Codec, count: int) -> None:
    array = array_of(some(count))
    found = sent(codec, RECORDS, array)
    assert isinstance(found, np.ndarray)
    assert not found.flags.writeable
    assert found.dtype.names == array.dtype.names
    assert lists(found) == lists(array)


@every_codec
@pytest.mark.parametrize("count", [0, 1, 2, 40, 3000])
def test_a_list_is_sent_as_records(codec: Codec, count: int) -> None:
    assert lists(sent(codec, RECORDS, some(count))) == lists(array_of(some(count)))


@every_codec
@pytest.mark.parametrize("count", [0, 1, 2, 40, 3000])
def test_an_array_is_sent_as_a_list_where_the_contract_has_one(codec: Codec, count: int) -> None:
    (found,) = codec.decoder(LIST)(codec.encoder(LIST)((array_of(some(count)),)))
    (wanted,) = codec.decoder(LIST)(codec.encoder(LIST)((some(count),)))
    assert found == wanted
    assert all(isinstance(each.kind, Kind) for each in found)


@every_codec
def test_what_is_received_can_be_sent_again(codec: Codec) -> None:
    found = sent(codec, RECORDS, some(50))
    assert lists(sent(codec, RECORDS, found)) == lists(found)


def test_received_records_are_passed_on_without_a_copy_within_a_process() -> None:
    codec = Identity()
    found = sent(codec, RECORDS, array_of(some(50)))
    assert np.shares_memory(sent(codec, RECORDS, found), found)


@every_codec
def test_what_happens_to_records_after_they_were_encoded_does_not_show(codec: Codec) -> None:
    array = array_of(some(10_000))
    payload = codec.encoder(RECORDS)((array,))
    array["x"] = 99.0
    if codec.name == "cdr":
        payload = bytes(payload)
    (found,) = codec.decoder(RECORDS)(payload)
    assert lists(found) == lists(array_of(some(10_000)))


@every_codec
def test_fields_are_found_by_name(codec: Codec) -> None:
    wanted = array_of(some(20))
    other = np.zeros((4, 5), np.dtype([(n, wanted.dtype[n].newbyteorder(">")) for n in reversed(wanted.dtype.names)]))
    for name in wanted.dtype.names or ():
        other[name] = wanted[name].reshape(4, 5)
    assert lists(sent(codec, RECORDS, other)) == lists(wanted)
    assert lists(sent(codec, RECORDS, wanted[::2])) == lists(wanted[::2])
    assert lists(sent(codec, RECORDS, wanted.view(np.recarray))) == lists(wanted)


@every_codec
@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros(2, [("x", "f4")]), r"points must be records of Point, not ndarray .*: it has no field `distance`"),
        (np.zeros(2), "float64 has no fields"),
        (np.zeros(2, [*dtype_of(P).descr, ("more", "f4")]), "Point has no field `more`"),
        (np.zeros(2, [*dtype_of(P).descr[:-1], ("valid", "f4")]), "`valid`: float32 values"),
        (np.zeros(2, [*dtype_of(P).descr[:-1], ("valid", "?", (2,))]), "`valid` is not one number"),
        (np.array([(1e300, 0.0, 0.0, 0, False)], [("x", "f8"), *dtype_of(P).descr[1:]]), "`x`: values exceed"),
        (np.array([(0.0, 0.0, 0.0, 5, False)], dtype_of(P)), "`kind` has a value that its type does not have"),
        (np.zeros((), dtype_of(P)), "0 dimensions"),
        ([P(1.0, 2.0, "3", Kind.sky, True)], "`distance`: required argument is not a float"),
        ([P(1.0, 2.0, 3.0, 5, True)], "`kind`: 5"),
        ([P(1.0, 2.0, 3.0, Kind.sky, 1)], "`valid`: int is not a bool"),
        ([1.5], "float"),
        ("text", "str is not a list"),
        (None, "points must be records of Point"),
    ],
    ids=str,
)
def test_what_does_not_fit_is_refused(codec: Codec, value: Any, message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        codec.encoder(RECORDS)((value,))


@every_codec
def test_an_array_that_does_not_fit_a_list_is_refused_by_field(codec: Codec) -> None:
    with pytest.raises(EncodeError, match=r"points must be records of Point, .*: it has no field `distance`"):
        codec.encoder(LIST)((np.zeros(2, [("x", "f4")]),))


def test_records_are_views_of_a_payload_without_padding() -> None:
    flat = flat_struct(FLOAT32, FLOAT32, FLOAT32, INT32, UINT32)
    message = Struct("Test::M", (Field("points", Sequence(flat, records=True)),))
    payload = Cdr().encoder(message)((np.ones(1000, flat.dtype),))
    (found,) = Cdr().decoder(message)(payload)
    assert np.shares_memory(found, np.frombuffer(payload, np.uint8))
    assert found.dtype is flat.dtype


def test_records_are_views_of_a_payload_whose_records_are_padded_alike() -> None:
    flat = flat_struct(INT64, UINT8)
    message = Struct("Test::M", (Field("points", Sequence(flat, records=True)),))
    payload = Cdr().encoder(message)((np.ones(1000, flat.dtype),))
    (found,) = Cdr().decoder(message)(payload)
    assert np.shares_memory(found, np.frombuffer(payload, np.uint8))
    assert lists(found) == [(1, 1)] * 1000


@every_wire
def test_a_payload_that_is_short_is_refused(codec: Codec) -> None:
    payload = codec.encoder(RECORDS)((some(3),))
    whole = octets(payload)
    for end in range(len(whole)):
        with pytest.raises(DecodeError):
            codec.decoder(RECORDS)([whole[:end]] if isinstance(payload, list) else whole[:end])


@every_wire
def test_invalid_bools_and_enumerators_are_refused(codec: Codec) -> None:
    loose = Struct(
        "Test::Point",
        tuple(
            Field(f.name, UINT8 if f.type in (BOOL,) or (f.type is KIND and codec.name == "ice") else INT32)
            if f.type in (BOOL, KIND)
            else f
            for f in POINT.fields
        ),
    )
    message = Struct("Test::Scan", (Field("points", Sequence(loose, records=True)),))
    for kind, valid, wrong in ((7, 1, ""), (5, 1, "kind"), (1, 2, "valid")):
        payload = codec.encoder(message)(([(0.0, 0.0, 0.0, 0, 0), (1.0, 2.0, 3.0, kind, valid)],))
        if wrong:
            with pytest.raises(DecodeError, match=f"`{wrong}` has a value"):
                codec.decoder(RECORDS)(payload)
        else:
            codec.decoder(RECORDS)(payload)


@pytest.mark.parametrize("codec", [Cdr(), Ice()], ids=lambda each: each.name)
def test_a_count_beyond_the_payload_allocates_nothing(codec: Codec) -> None:
    message = Struct("Test::M", (Field("count", INT32),))
    payload = bytearray(codec.encoder(message)((2**31 - 1,)))
    if codec.name == "ice":
        payload = bytearray(b"\x0b\0\0\0\1\1\xff" + payload[-4:])
    with pytest.raises(DecodeError):
        codec.decoder(RECORDS)(bytes(payload))


def test_a_block_of_messagepack_is_packed() -> None:
    [payload] = MessagePack().encoder(RECORDS)((array_of(some(3)),))
    assert payload == b"\x91\xc4" + bytes([63]) + array_of(some(3)).tobytes()


def test_a_large_block_of_messagepack_is_a_buffer_of_its_own() -> None:
    array = array_of(some(5000))
    head, block = MessagePack().encoder(RECORDS)((array,))
    assert len(head) < 16
    assert bytes(block) == array.tobytes()
    (found,) = MessagePack().decoder(RECORDS)([head, block])
    assert np.shares_memory(found, np.frombuffer(block, np.uint8))


@pytest.mark.parametrize("block", [[1, 2, 3], b"123", "text", {}, 5])
def test_another_block_of_messagepack_is_refused(block: Any) -> None:
    with pytest.raises(DecodeError):
        MessagePack().decoder(RECORDS)([msgpack.packb([block])])


def flat_struct(*kinds: Type) -> Struct:
    fields = tuple(Field(f"f{number}", kind) for number, kind in enumerate(kinds))
    return Struct("Test::Flat", fields, make_dataclass("Flat", [(f.attribute, object) for f in fields], slots=True))


@st.composite
def flat_messages(draw: st.DrawFn) -> tuple[Struct, Struct, tuple[Any, ...]]:
    """A message with records, the same with a list, and values for it; the records begin anywhere."""
    kinds = draw(st.lists(st.sampled_from([*dtypes(), KIND, FAR]), min_size=1, max_size=6))
    flat = flat_struct(*kinds)
    count = draw(st.integers(0, 5))
    assert flat.python
    values = [flat.python(*(draw(number(kind)) for kind in kinds)) for _ in range(count)]
    before = draw(st.lists(st.sampled_from([UINT8, UINT16, INT32, FLOAT64]), max_size=4))
    more = draw(st.sampled_from([UINT8, FLOAT64, STRING]))
    head = tuple(Field(f"b{place}", kind) for place, kind in enumerate(before))
    tail = Field("tail", more)
    ours, theirs = (
        Struct("Test::M", (*head, Field("points", Sequence(flat, records=records)), tail)) for records in (True, False)
    )
    return ours, theirs, (*(kind.python(1) for kind in before), values, more.python(2))


def number(kind: Type) -> st.SearchStrategy[Any]:
    if isinstance(kind, Enumeration):
        return st.sampled_from([kind.python(value) if kind.python else value for _, value in kind.members])
    dtype = dtypes()[kind]  # type: ignore[index]  # a number, or a bool
    match dtype.kind:
        case "b":
            return st.booleans()
        case "f":
            return st.floats(width=8 * dtype.itemsize, allow_nan=False)
        case _:
            return st.integers(int(np.iinfo(dtype).min), int(np.iinfo(dtype).max))


@patiently
@pytest.mark.parametrize("codec", [Cdr(), Cdr(room=40), Ice()], ids=["cdr", "cdr with room", "ice"])
@given(message=flat_messages())
def test_records_and_lists_have_the_same_octets(codec: Codec, message: tuple[Struct, Struct, tuple[Any, ...]]) -> None:
    with_records, with_list, values = message
    payload = codec.encoder(with_list)(values)
    found = codec.decoder(with_records)(payload)
    array = found[-2]
    assert octets(codec.encoder(with_records)(values)) == octets(payload)
    assert octets(codec.encoder(with_records)(found)) == octets(payload)
    assert octets(codec.encoder(with_list)((*values[:-2], array.copy(), values[-1]))) == octets(payload)
    assert codec.decoder(with_list)(payload)[-2] == values[-2]
    assert [list(row) for row in lists(array)] == [
        [getattr(each, name) for name in array.dtype.names] for each in values[-2]
    ]


@patiently
@pytest.mark.parametrize("codec", [MessagePack()], ids=["messagepack"])
@given(message=flat_messages())
def test_records_survive_messagepack(codec: Codec, message: tuple[Struct, Struct, tuple[Any, ...]]) -> None:
    with_records, _, values = message
    found = codec.decoder(with_records)(codec.encoder(with_records)(values))
    assert octets(codec.encoder(with_records)(found)) == octets(codec.encoder(with_records)(values))


@every_codec
def test_records_are_parts_of_other_types(codec: Codec) -> None:
    inner = Sequence(POINT, records=True)
    python = make_dataclass("Box", ["name", "points"])
    box = Struct("Test::Box", (Field("name", STRING), Field("points", inner)), python)
    message = Struct("Test::M", (Field("boxes", Sequence(box)), Field("named", Dictionary(STRING, inner))))
    boxes, named = codec.decoder(message)(
        codec.encoder(message)(([python("a", some(2)), python("b", array_of(some(3)))], {"c": some(4)}))
    )
    assert [lists(each.points) for each in boxes] == [lists(array_of(some(n))) for n in (2, 3)]
    assert lists(named["c"]) == lists(array_of(some(4)))


def test_an_array_reads_like_a_list() -> None:
    points = objects_of(array_of(some(3000)), P)
    assert len(points) == 3000
    assert points[7] == some(8)[7]
    assert points[-1].kind is some(3000)[-1].kind
    assert list(points[3:5]) == some(5)[3:5]
    assert some(9)[8] in points
    assert [each.distance for each in points] == [each.distance for each in some(3000)]
    with pytest.raises(IndexError):
        points[3000]


def test_only_flat_structs_have_records() -> None:
    for kind in (STRING, TIME, POINT, Sequence(FLOAT32)):
        outer = Struct("Test::Outer", (Field("x", FLOAT32), Field("inner", kind)))
        with pytest.raises(ValueError, match="Test::Outer is not a flat struct"):
            Sequence(outer, records=True)
    with pytest.raises(ValueError, match="not a flat struct"):
        Sequence(Struct("Test::Empty", ()), records=True)
    with pytest.raises(TypeError, match="int is not a generated struct"):
        dtype_of(int)


def test_records_differ_from_lists_in_the_text_of_a_contract() -> None:
    assert spell(Sequence(POINT, records=True)) == "records<Test::Point>"
    assert Sequence(POINT, records=True) != Sequence(POINT)
    ours, theirs = (Operation("Test::Lidar", "scan", message.fields) for message in (RECORDS, LIST))
    assert ours.fingerprint != theirs.fingerprint
    assert differences(ours.text, theirs.text) == [
        "Test::LidarScanRequest.points: records<Test::Point> here, sequence<Test::Point> there"
    ]


def test_a_worker_of_robocomp_gets_a_list() -> None:
    convert = received(Sequence(POINT, records=True))
    assert convert is not None
    assert convert(array_of(some(3))) == some(3)
