"""Ice's encoding 1.1, octet by octet; what Ice itself says of it is in `test_ice_itself`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    INT64,
    LINEAGE,
    STRING,
    TIME,
    UINT8,
    UINT16,
    UINT32,
    UINT64,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Response,
    Sequence,
    Struct,
    Type,
    thrown,
)
from robocomp_py.errors import DecodeError, EncodeError, RemoteFailure
from robocomp_py.runtime.calls import Call, Handler
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import assert_same
from robocomp_py.testing.everything import Colour, Nothing, Point
from robocomp_py.transports.base import Reply, Status
from robocomp_py.wire.codec import MAX_BYTES
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.values import RANGES

from .codecs import RICH, one, rich
from .messages import patiently

CODEC = Ice()
FAR = Enumeration("Test::Far", (("here", 0), ("last", 254), ("first", 255), ("farthest", 2**31 - 1)))


def message(*kinds: Type) -> Struct:
    return Struct("Test::Message", tuple(Field(f"f{number}", kind) for number, kind in enumerate(kinds)))


def whole(body: str) -> bytes:
    """An encapsulation with this in it."""
    octets = bytes.fromhex(body)
    return (6 + len(octets)).to_bytes(4, "little") + b"\x01\x01" + octets


BYTES: list[tuple[Struct, tuple[Any, ...], str]] = [
    (message(), (), ""),
    (message(BOOL, INT8, UINT8), (True, -1, 255), "01 ff ff"),
    (message(INT16, UINT16), (-2, 65535), "feff ffff0000"),
    (message(INT32, UINT32), (-2, 2**32 - 1), "feffffff ffffffff00000000"),
    (message(UINT8, INT64, UINT64), (1, -2, 2**63), "01 feffffffffffffff 0000000000000080"),
    (message(FLOAT32, FLOAT64), (0.1, 0.5), "cdcccc3d 000000000000e03f"),
    (message(STRING, STRING), ("é", ""), "02 c3a9 00"),
    (message(STRING), ("a" * 254,), "fe" + "61" * 254),
    (message(STRING, UINT8), ("a" * 255, 7), "ff ff000000" + "61" * 255 + "07"),
    (message(TIME), (-1,), "ffffffffffffffff"),
    (message(FAR, FAR, FAR, FAR), (0, 254, 255, 2**31 - 1), "00 fe ffff000000 ffffffff7f"),
    (message(Colour.__contract__), (Colour.ultraviolet,), "ff f9ffffff"),
    (message(UINT8, Nothing.__contract__, UINT8), (1, Nothing(), 2), "01 00 02"),
    (message(Sequence(UINT8), UINT16), (b"abc", 1), "03 616263 01000000"),
    (message(Sequence(UINT16)), ([1, 65535],), "02 01000000 ffff0000"),
    (message(Sequence(UINT32)), ([2**32 - 1],), "01 ffffffff00000000"),
    (message(Sequence(BOOL)), ([True, False],), "02 01 00"),
    (message(Sequence(FLOAT64)), ([0.5],), "01 000000000000e03f"),
    (message(Sequence(UINT8)), (bytes(255),), "ff ff000000" + "00" * 255),
    (message(Sequence(STRING)), (["a", ""],), "02 01 61 00"),
    (message(Sequence(FAR)), ([0, 255],), "02 00 ffff000000"),
    (message(Sequence(Nothing.__contract__)), ([Nothing()] * 3,), "03 000000"),
    (message(Dictionary(INT8, INT16)), ({1: 2, 3: 4},), "02 01 0200 03 0400"),
    (Response("Test::Out", (Field("ret", UINT8), Field("a", STRING), Field("b", INT8))), (1, "a", 2), "01 61 02 01"),
    (Response("Test::Out", (Field("a", UINT8), Field("b", INT8))), (1, 2), "01 02"),
    (Struct("Test::In", (Field("ret", UINT8), Field("a", UINT8))), (1, 2), "01 02"),
]


@pytest.mark.parametrize(("kind", "values", "body"), BYTES)
def test_the_layout_is_that_of_ice(kind: Struct, values: tuple[Any, ...], body: str) -> None:
    payload = CODEC.encoder(kind)(values)
    assert (type(payload), payload.hex()) == (bytes, whole(body).hex())
    assert CODEC.encoder(kind)(CODEC.decoder(kind)(payload)) == payload


@pytest.mark.parametrize("length", [0, 1, 253, 254, 255, 256, 70_000])
@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (STRING, "x"),
        (Sequence(UINT8), [1]),
        (Sequence(UINT16), [1]),
        (Sequence(FLOAT64), [0.5]),
        (Sequence(STRING), ["x"]),
        (Sequence(Point.__contract__), [Point(1.0, 2.0)]),
        (Sequence(FAR), [255]),
    ],
)
def test_short_and_long_sizes_mean_the_same(kind: Type, value: Any, length: int) -> None:
    around = message(kind, UINT8, kind)
    payload = CODEC.encoder(around)((value * length, 7, value * length))
    first, between, last = CODEC.decoder(around)(payload)
    assert (len(first), between, len(last)) == (length, 7, length)
    assert CODEC.encoder(around)((first, 7, last)) == payload


def test_any_buffer_is_a_payload() -> None:
    payload = CODEC.encoder(RICH)(rich())
    for buffer in (bytearray(payload), memoryview(payload), np.frombuffer(payload, np.uint8)):
        assert_same(list(CODEC.decoder(RICH)(buffer)), list(rich()))


def test_received_arrays_are_aligned_wherever_they_begin() -> None:
    for before in range(8):
        kind = message(STRING, *(Sequence(item) for item in (INT16, FLOAT32, FLOAT64)))
        payload = CODEC.encoder(kind)(("x" * before, [1, 2], [0.5], [0.5, 1.0]))
        assert all(array.flags.aligned for array in CODEC.decoder(kind)(payload)[1:])


def test_the_encapsulation_counts_as_part_of_the_size() -> None:
    octets = np.zeros(MAX_BYTES - len("sizeee") - len("fsize") + 1, np.uint8)
    with pytest.raises(EncodeError, match=f"{MAX_BYTES + 1} bytes"):
        CODEC.encoder(one(Sequence(UINT8)))((octets,))


WRONG: list[tuple[Type, str, str]] = [
    (BOOL, "02", "IndexError"),
    (UINT16, "00000100", "65536 is not from 0 to 65535"),
    (UINT16, "ffffffff", "is not from 0 to 65535"),
    (UINT32, "0000000001000000", "4294967296 is not from"),
    (TIME, "ffffffffffffff7f", f"is not from {RANGES[TIME][0]} to"),
    (Sequence(BOOL), "02 00 02", "a bool is neither 0 nor 1"),
    (Sequence(UINT16), "02 00000000 00000100", "values from 0 to 65536 are not from 0 to 65535"),
    (Sequence(UINT16), "01 ffffffff", "values from -1 to -1 are not"),
    (Sequence(UINT32), "01 0000000001000000", "values from 4294967296"),
    (STRING, "02 ff00", "UnicodeDecodeError"),
    (STRING, "09 61", "8 bytes are missing"),
    (STRING, "ff ffffffff", "a size of -1"),
    (STRING, "ff 05000000 61", "a size of 5 in 1 bytes"),
    (STRING, "ff 0500", "unpack_from requires"),
    (Colour.__contract__, "02", "KeyError: 2"),
    (FAR, "ff ffffffff", "KeyError: -1"),
    (Sequence(FLOAT64), "02 0000000000000000", "2 of float64 exceed the payload"),
    (Sequence(Point.__contract__), "05 00000000", "5 items exceed the payload"),
    (Sequence(STRING), "05 00000000", "5 items in 4 bytes"),
    (Dictionary(INT32, INT32), "05 00000000", "5 items in 4 bytes"),
    (Dictionary(STRING, INT64), "01 ff", "unpack_from requires"),
]


@pytest.mark.parametrize(("kind", "body", "reason"), WRONG)
def test_a_value_that_does_not_fit_is_refused(kind: Type, body: str, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        CODEC.decoder(one(kind))(whole(body))
    with pytest.raises(DecodeError, match=reason):
        CODEC.decoder(one(kind), prefix=True)(whole(body))


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        ("07000000 01 00 05", "encoding 1.0 of Ice instead of 1.1"),
        ("07000000 02 00 05", "encoding 2.0 of Ice"),
        ("08000000 01 01 05", "an encapsulation of 8 bytes in 7"),
        ("06000000 01 01 05", "an encapsulation of 6 bytes in 7"),
        ("00000000 01 01 05", "an encapsulation of 0 bytes in 7"),
        ("ffffffff 01 01 05", "an encapsulation of -1 bytes in 7"),
        ("08000000 01 01 05 06", "1 bytes left over"),
    ],
)
def test_what_is_no_encapsulation_or_more_than_one_is_refused(payload: str, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        CODEC.decoder(one(UINT8))(bytes.fromhex(payload))


# Exceptions.

BASE = ExceptionType("Test::Base", (Field("code", INT16),))
MIDDLE = ExceptionType("Test::Middle", (), BASE)
DERIVED = ExceptionType("Test::Derived", (Field("why", STRING),), MIDDLE)
LINES = {kind: LINEAGE.join(kind.lineage) for kind in (BASE, MIDDLE, DERIVED)}


def text(word: str) -> str:
    return f"{len(word):02x} {word.encode().hex()} "


COMPACT = f"00 {text('::Test::Derived')} 02 686d 00 {text('::Test::Middle')} 20 {text('::Test::Base')} 0500"
SLICED = (
    f"10 {text('::Test::Derived')} 07000000 02 686d "
    f"10 {text('::Test::Middle')} 04000000 30 {text('::Test::Base')} 06000000 0500"
)


def test_an_exception_without_a_base_is_written_as_ice_does() -> None:
    assert CODEC.encoder(thrown(BASE))((LINES[BASE], 5)) == whole(f"20 {text('::Test::Base')} 0500")


def test_one_with_a_base_is_written_in_slices_that_can_be_left_out() -> None:
    assert CODEC.encoder(thrown(DERIVED))((LINES[DERIVED], 5, "hm")) == whole(SLICED)


def test_long_names_and_slices_are_written_and_read() -> None:
    base = ExceptionType("Test::" + "B" * 300, (Field("text", STRING),))
    kind = ExceptionType("Test::" + "C" * 300, (Field("more", STRING),), base)
    values = (LINEAGE.join(kind.lineage), "x" * 1000, "y" * 1000)
    payload = CODEC.encoder(thrown(kind))(values)
    assert CODEC.decoder(thrown(kind))(payload) == values
    assert CODEC.decoder(thrown(base))(payload) == (base.name, "x" * 1000)


@pytest.mark.parametrize("body", [COMPACT, SLICED], ids=["compact", "sliced"])
def test_both_formats_are_read(body: str) -> None:
    assert CODEC.decoder(thrown(DERIVED))(whole(body)) == (LINES[DERIVED], 5, "hm")


def test_classes_that_are_not_known_are_left_out_if_slices_say_their_size() -> None:
    assert CODEC.decoder(thrown(), prefix=True)(whole(SLICED)) == (LINES[DERIVED],)
    assert CODEC.decoder(thrown(MIDDLE))(whole(SLICED)) == (LINES[MIDDLE], 5)
    assert CODEC.decoder(thrown(BASE))(whole(SLICED)) == (LINES[BASE], 5)


def test_otherwise_only_the_first_is_reported() -> None:
    assert CODEC.decoder(thrown(), prefix=True)(whole(COMPACT)) == ("Test::Derived",)
    with pytest.raises(DecodeError, match=r"a Test::Derived that is no Test::Base"):
        CODEC.decoder(thrown(BASE))(whole(COMPACT))


def test_members_that_are_not_known_are_ignored_in_a_slice_that_says_its_size() -> None:
    longer = SLICED.replace("06000000 0500", "09000000 0500 c0 ff ff")
    assert CODEC.decoder(thrown(BASE))(whole(longer)) == (LINES[BASE], 5)


def test_one_whose_bases_are_not_known_is_read_with_all_fields_if_slices_say_their_size() -> None:
    kind = ExceptionType(DERIVED.name, DERIVED.all_fields)
    assert CODEC.decoder(thrown(kind), prefix=True)(whole(SLICED)) == (DERIVED.name, 5, "hm")
    assert CODEC.decoder(thrown(ExceptionType(MIDDLE.name, MIDDLE.all_fields)))(whole(SLICED)) == (MIDDLE.name, 5)
    longer = SLICED.replace("07000000 02 686d", "08000000 02 686d ff")
    with pytest.raises(DecodeError, match="1 bytes left over"):
        CODEC.decoder(thrown(kind))(whole(longer))


WRONG_EXCEPTIONS = [
    ("", "IndexError"),
    ("20", "IndexError"),
    (f"28 {text('::Test::Base')} 0500", "Test::Base refers to objects of classes"),
    (f"24 {text('::Test::Base')} 0500 ff", "Test::Base has optional members"),
    (f"20 {text('::Test::Other')} 0500", "a Test::Other that is no Test::Base"),
    (f"20 {text('::Test::Base')}", "unpack_from requires"),
    (f"20 {text('::Test::Base')} 0500 00", "1 bytes left over"),
    (f"30 {text('::Test::Base')} 05000000 0500", "the fields of Test::Base are longer than its slice"),
    (f"30 {text('::Test::Base')} 07000000 0500", "a slice of 7 bytes in 6"),
    (f"30 {text('::Test::Base')} 03000000 0500", "a slice of 3 bytes in 6"),
    (f"30 {text('::Test::Base')} 00000080 0500", "a slice of -2147483648 bytes in 6"),
    (f"10 {text('::Test::Other')} 04000000", "IndexError"),
    (f"10 {text('::Test::Other')} 04000000" * 200, "more than 128 slices"),
    ("20 ff ffffff7f", "a size of 2147483647"),
    ("20 02 ff00", "UnicodeDecodeError"),
]


@pytest.mark.parametrize(("body", "reason"), WRONG_EXCEPTIONS)
def test_what_is_no_exception_of_that_kind_is_refused(body: str, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        CODEC.decoder(thrown(BASE))(whole(body))


def test_a_slice_of_another_base_is_refused() -> None:
    body = f"00 {text('::Test::Middle')} 20 {text('::Test::Other')} 0500"
    with pytest.raises(DecodeError, match="a slice of Test::Other instead of one of Test::Base"):
        CODEC.decoder(thrown(MIDDLE))(whole(body))


@pytest.mark.parametrize(("values", "complaint"), [(("", 5, 7), "why must be a str"), (("", 5), "expected 3 values")])
def test_fields_that_do_not_fit_are_refused_in_the_words_of_all_codecs(values: Any, complaint: str) -> None:
    with pytest.raises(EncodeError, match=f"Test::Derived: {complaint}"):
        CODEC.encoder(thrown(DERIVED))(values)


def test_exceptions_above_the_limit_are_not_sent() -> None:
    kind = ExceptionType("Test::Large", (Field("data", Sequence(UINT8)),))
    with pytest.raises(EncodeError, match=f"a message may have {MAX_BYTES}"):
        CODEC.encoder(thrown(kind))(("Test::Large", np.zeros(MAX_BYTES - 11, np.uint8)))


@patiently
@given(body=st.sampled_from([COMPACT, SLICED]), data=st.data())
def test_damaged_exceptions_are_decode_errors_or_exceptions(body: str, data: st.DataObject) -> None:
    damaged = bytearray.fromhex(body)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(damaged)))
        damaged[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    payload = whole(damaged.hex())
    for kind in (None, BASE, MIDDLE, DERIVED):
        try:
            values = CODEC.decoder(thrown(kind), prefix=True)(payload)
        except DecodeError:
            continue
        if kind:
            CODEC.encoder(thrown(kind))(values)


# Calls.


class Asked:
    """An operation that raises, through the codec."""

    def __init__(self, error: Exception, raises: tuple[ExceptionType, ...]) -> None:
        self._error = error
        self.operation: Operation[Any] = Operation("Test::Peer", "work", raises=raises)

    def _raise(self) -> None:
        raise self._error

    def reply(self) -> Reply:
        return Handler(self.operation, CODEC, self._raise).answer(())

    def result(self, reply: Reply) -> Any:
        return Call(self.operation, CODEC).result(reply)


def test_what_is_declared_arrives_as_the_class_that_was_raised() -> None:
    asked = Asked(e.FailedBadly("worse", 8, e.Point(1.0, 2.0)), (e.Failed.__contract__,))
    reply = asked.reply()
    assert reply.status is Status.THROWN
    with pytest.raises(e.FailedBadly) as raised:
        asked.result(reply)
    assert_same(raised.value.where, e.Point(1.0, 2.0))


def test_a_class_the_caller_does_not_know_arrives_as_the_nearest_it_does() -> None:
    reply = Asked(e.FailedBadly("worse", 8, e.Point(1.0, 2.0)), (e.Failed.__contract__,)).reply()
    unknown = reply.payload.replace(b"::Conformance::FailedBadly", b"::Conformance::FailedOddly")
    with pytest.raises(e.Failed) as raised:
        Asked(KeyError(), (e.Failed.__contract__,)).result(Reply(Status.THROWN, unknown))
    assert (type(raised.value), raised.value.what, raised.value.code) == (e.Failed, "worse", 8)


def test_what_is_not_declared_there_is_a_failure_that_names_it() -> None:
    reply = Asked(e.FailedBadly("worse", 8, e.Point(1.0, 2.0)), (e.Failed.__contract__,)).reply()
    with pytest.raises(RemoteFailure, match=r"Conformance::FailedBadly.*does not declare"):
        Asked(KeyError(), (BASE,)).result(reply)


def test_an_exception_of_a_handler_is_reported_by_the_codec_too() -> None:
    asked = Asked(KeyError("on purpose"), ())
    reply = asked.reply()
    assert reply.status is Status.FAILED
    with pytest.raises(RemoteFailure, match=r"KeyError.*on purpose"):
        asked.result(reply)
