"""What every codec promises: it is a round trip, a snapshot, and deaf to nonsense."""

from __future__ import annotations

import array
import contextlib
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT32,
    MAX_DEPTH,
    STRING,
    TIME,
    UINT8,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    dtypes,
)
from robocomp_py.errors import CodecError, DecodeError, EncodeError
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import assert_same
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import MAX_BYTES, Codec, Payload
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.messagepack import MessagePack

from .codecs import CODECS, RICH, WIRES, every_codec, every_wire, one, rich, there_and_back
from .messages import messages, patiently

HEADS = {"cdr": b"\x00\x01\x00\x00", "ice": b"\x00\x00\x00\x00\x01\x01"}
"""How payloads begin that are one piece; that of `ice` with its size, which `_payload` puts in."""


# There and back.


@patiently
@given(messages())
@example((Struct("Test::Empty", ()), ()))
def test_what_is_encoded_is_decoded_again_by_every_codec(sent: tuple[Struct, tuple[Any, ...]]) -> None:
    message, values = sent
    for codec in CODECS:
        back = codec.decoder(message)(codec.encoder(message)(values))
        assert isinstance(back, tuple)
        assert_same(list(back), list(values), codec.name)


@every_codec
def test_every_type_comes_back_as_it_was(codec: Codec) -> None:
    back = codec.decoder(RICH)(codec.encoder(RICH)(rich()))
    assert_same(list(back), list(rich()))


@every_codec
def test_structs_without_a_class_are_tuples(codec: Codec) -> None:
    inner = Struct(
        "Test::Inner", (Field("number", INT32), Field("text", STRING), Field("none", Struct("Test::No", ())))
    )
    kind = Struct("Test::Outer", (Field("inners", Sequence(inner)), Field("inner", inner)))
    value = ([(1, "one", ()), (2, "two", ())], (3, "three", ()))
    assert there_and_back(codec, kind, value) == value


@every_codec
def test_enumerations_without_a_class_are_ints(codec: Codec) -> None:
    kind = Enumeration("Test::Level", (("low", -1), ("high", 5)))
    assert_same(there_and_back(codec, Sequence(kind), [-1, 5]), [-1, 5])


@every_codec
def test_a_module_generated_anew_understands_the_old_one(codec: Codec) -> None:
    class Shade(IntEnum):
        red = 0
        green = 1
        ultraviolet = -7

    @dataclass
    class Spot:
        x: float
        y: float
        shade: Shade

    new = Struct(
        "Test::Spot",
        (Field("x", FLOAT64), Field("y", FLOAT64), Field("shade", Enumeration("Test::Shade", _members(Shade), Shade))),
        Spot,
    )
    old = Struct("Test::Spot", (*new.fields[:2], Field("shade", e.Colour.__contract__)), _old_spot)
    payload = codec.encoder(one(Sequence(new)))(([Spot(1.0, 2.0, Shade.green)],))
    (received,) = codec.decoder(one(Sequence(old)))(payload)
    assert received == [("old", 1.0, 2.0, e.Colour.green)]
    again = codec.encoder(one(e.Colour.__contract__))((Shade.green,))
    assert codec.decoder(one(e.Colour.__contract__))(again) == (e.Colour.green,)


def _members(python: type[IntEnum]) -> tuple[tuple[str, int], ...]:
    return tuple((member.name, member.value) for member in python)


def _old_spot(x: float, y: float, shade: e.Colour) -> tuple[str, float, float, e.Colour]:
    return "old", x, y, shade


@every_codec
def test_fields_named_like_python_keywords_travel(codec: Codec) -> None:
    @dataclass
    class Wave:
        lambda_: float
        self_: int

    kind = Struct("Test::Wave", (Field("lambda", FLOAT64), Field("self", INT32)), Wave)
    assert there_and_back(codec, Sequence(kind), [Wave(0.5, 1)]) == [Wave(0.5, 1)]


@every_codec
def test_a_prefix_of_the_fields_can_be_read_alone(codec: Codec) -> None:
    message = Struct(
        "Test::Thrown", (Field("name", STRING), Field("code", INT32), Field("where", e.Point.__contract__))
    )
    payload = codec.encoder(message)(("name", 7, e.Point()))
    first = Struct("Test::Name", message.fields[:1])
    assert codec.decoder(first, prefix=True)(payload) == ("name",)
    assert codec.decoder(message, prefix=True)(payload) == ("name", 7, e.Point())
    with pytest.raises(DecodeError):
        codec.decoder(first)(payload)


# Nesting.


def _nested(levels: int, wrap: Callable[[Type], Type]) -> Struct:
    kind: Type = STRING
    for _ in range(levels - 1):  # the message is a level, too
        kind = wrap(kind)
    return one(kind)


WRAPS: dict[str, tuple[Callable[[Type], Type], Callable[[Any], Any]]] = {
    "sequences": (Sequence, lambda value: [value]),
    "dictionaries": (lambda kind: Dictionary(STRING, kind), lambda value: {"key": value}),
    "structs": (lambda kind: Struct("Test::Wrap", (Field("inside", kind),)), lambda value: (value,)),
}


@every_codec
@pytest.mark.parametrize("way", WRAPS)
def test_types_may_nest_as_deep_as_the_languages_allow(codec: Codec, way: str) -> None:
    wrap, put = WRAPS[way]
    message, value = _nested(MAX_DEPTH, wrap), "deep"
    for _ in range(MAX_DEPTH - 1):
        value = put(value)
    assert codec.decoder(message)(codec.encoder(message)((value,))) == (value,)


@every_codec
@pytest.mark.parametrize("way", WRAPS)
def test_deeper_types_are_refused_at_once(codec: Codec, way: str) -> None:
    message = _nested(MAX_DEPTH + 1, WRAPS[way][0])
    for compile_one in (codec.encoder, codec.decoder):
        with pytest.raises(CodecError, match=f"Test::Message: types nest deeper than {MAX_DEPTH} levels"):
            compile_one(message)


# Snapshots.

LARGE, SMALL = 20_000, 20


def _view(frozen: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    view = frozen[:]
    view.flags.writeable = False
    return view


SOURCES: dict[str, Callable[[np.ndarray[Any, Any]], Any]] = {
    "the array": lambda base: base,
    "every other item": lambda base: base[::2],
    "two dimensions": lambda base: base.reshape(2, -1),
    "a read-only view": _view,
    "a memoryview": memoryview,
    "a read-only memoryview": lambda base: memoryview(base).toreadonly(),
}


@every_codec
@pytest.mark.parametrize("size", [SMALL, LARGE])
@pytest.mark.parametrize("way", SOURCES)
def test_what_happens_to_an_array_after_it_was_encoded_does_not_show(codec: Codec, size: int, way: str) -> None:
    base = np.arange(size, dtype=np.float64)
    given_ = SOURCES[way](base)
    expected = np.array(given_).reshape(-1)
    payload = codec.encoder(one(Sequence(FLOAT64)))((given_,))
    base[:] = -1
    (received,) = codec.decoder(one(Sequence(FLOAT64)))(payload)
    np.testing.assert_array_equal(received, expected)


@every_codec
@pytest.mark.parametrize("size", [SMALL, LARGE * 8])
@pytest.mark.parametrize("make", [bytearray, lambda data: array.array("B", data)], ids=["bytearray", "array"])
def test_what_happens_to_a_buffer_after_it_was_encoded_does_not_show(
    codec: Codec, size: int, make: Callable[[bytes], Any]
) -> None:
    buffer = make(bytes(size))
    payload = codec.encoder(one(Sequence(UINT8)))((buffer,))
    buffer[0] = 1
    (received,) = codec.decoder(one(Sequence(UINT8)))(payload)
    assert not received.any()


@every_codec
def test_what_happens_to_lists_dicts_and_structs_after_they_were_encoded_does_not_show(codec: Codec) -> None:
    sent, expected = rich(), rich()
    payload = codec.encoder(RICH)(sent)
    nested = sent[0]
    nested.scalars.text = "vandalised"
    nested.points[0].x = -1.0
    nested.points.clear()
    nested.by_name["new"] = e.Point()
    nested.rows[1].append(e.Point())
    assert_same(list(codec.decoder(RICH)(payload)), list(expected))


@every_codec
def test_receivers_of_one_payload_share_nothing_they_can_change(codec: Codec) -> None:
    payload = codec.encoder(RICH)(rich())
    decode = codec.decoder(RICH)
    first: Any = decode(payload)
    first[0].points.clear()
    first[0].by_name.clear()
    first[0].scalars.text = "vandalised"
    second: Any = decode(payload)
    assert_same(list(second), list(rich()))
    assert first[1].doubles is not second[1].doubles  # whose shape could be set in place


@every_codec
@pytest.mark.parametrize("kind", dtypes())
@pytest.mark.parametrize("size", [0, SMALL, LARGE * 8])
def test_received_arrays_are_read_only(codec: Codec, kind: Primitive, size: int) -> None:
    received = there_and_back(codec, Sequence(kind), np.zeros(size, dtypes()[kind]))
    assert received.dtype == dtypes()[kind]
    assert not received.flags.writeable
    if size:
        with pytest.raises(ValueError, match="WRITEABLE"):
            received.flags.writeable = True


@every_codec
def test_a_received_message_can_be_sent_on(codec: Codec) -> None:
    received = codec.decoder(RICH)(codec.encoder(RICH)(rich()))
    for other in CODECS:
        assert_same(list(other.decoder(RICH)(other.encoder(RICH)(received))), list(rich()))


# Size.


@every_codec
def test_messages_above_the_limit_are_not_sent(codec: Codec) -> None:
    huge = np.zeros(MAX_BYTES + 1, np.uint8)
    huge.flags.writeable = False  # so that no codec need copy it
    with pytest.raises(EncodeError, match=f"Test::Message: .* a message may have {MAX_BYTES}"):
        codec.encoder(one(Sequence(UINT8)))((huge,))


@every_codec
def test_many_arrays_above_the_limit_are_not_sent(codec: Codec) -> None:
    half = np.zeros(MAX_BYTES // 2 + 1, np.uint8)
    half.flags.writeable = False
    with pytest.raises(EncodeError, match=f"a message may have {MAX_BYTES}"):
        codec.encoder(one(Sequence(Sequence(UINT8))))(([half, half],))


@pytest.mark.parametrize(
    ("codec", "payload"),
    [
        (Cdr(), lambda: memoryview(np.zeros(MAX_BYTES + 1, np.uint8))),
        (Ice(), lambda: memoryview(np.zeros(MAX_BYTES + 1, np.uint8))),
        (MessagePack(), lambda: [b"\x91\x90", memoryview(np.zeros(MAX_BYTES, np.uint8))]),
    ],
    ids=["cdr", "ice", "messagepack, apart"],
)
def test_messages_above_the_limit_are_not_received(codec: Codec, payload: Callable[[], Payload]) -> None:
    sent = payload()
    if codec.name in HEADS:
        sent[: len(HEADS[codec.name])] = HEADS[codec.name]
    with pytest.raises(DecodeError, match=f"a message may have {MAX_BYTES}"):
        codec.decoder(one(Sequence(STRING)))(sent)


# Nonsense.

DECODED = [
    RICH,
    one(Sequence(e.Point.__contract__)),
    one(Sequence(e.Nothing.__contract__)),
    one(Sequence(Sequence(Sequence(STRING)))),
    one(Dictionary(Primitive.INT8, Dictionary(BOOL, TIME))),
    one(Sequence(FLOAT32)),
]


def _buffers(payload: Payload) -> list[bytes]:
    return [bytes(part) for part in payload] if isinstance(payload, list) else [payload]


def _payload(codec: Codec, buffers: list[bytes]) -> Payload:
    """A payload with nothing wrong but what is wrong in these."""
    if codec.name == "messagepack":
        return buffers
    whole = b"".join(buffers)
    return len(whole).to_bytes(4, "little") + whole[4:] if codec.name == "ice" else whole


def _survives(codec: Codec, message: Struct, payload: Payload) -> None:
    """Whatever the bytes are, there is either a DecodeError, or a message that could have been sent."""
    with contextlib.suppress(DecodeError):
        codec.encoder(message)(codec.decoder(message)(payload))


@every_wire
@patiently
@given(kind=st.sampled_from(DECODED), junk=st.binary(max_size=200), more=st.lists(st.binary(max_size=50), max_size=3))
def test_junk_is_a_decode_error_or_a_message(codec: Codec, kind: Struct, junk: bytes, more: list[bytes]) -> None:
    for head in (b"", *HEADS.values(), b"\x91", b"\x92"):  # how real ones begin
        _survives(codec, kind, _payload(codec, [head + junk, *more]))


@patiently
@given(sent=messages(), data=st.data())
def test_damaged_messages_are_decode_errors_or_messages(
    sent: tuple[Struct, tuple[Any, ...]], data: st.DataObject
) -> None:
    message, values = sent
    for codec in WIRES:
        buffers = _buffers(codec.encoder(message)(values))
        damaged = bytearray(buffers[0])
        for _ in range(data.draw(st.integers(1, 3))):
            at = data.draw(st.integers(0, max(0, len(damaged) - 1)))
            piece = data.draw(
                st.binary(max_size=4) | st.sampled_from([b"\xff" * 4, b"\x00" * 4, b"\xdd\xff\xff\xff\xff"])
            )
            damaged[at : at + data.draw(st.integers(0, 4))] = piece
        _survives(codec, message, _payload(codec, [bytes(damaged), *buffers[1:]]))


@every_wire
def test_a_message_cut_short_anywhere_is_a_decode_error(codec: Codec) -> None:
    nested = rich()[0]
    message = one(e.Nested.__contract__)
    decode = codec.decoder(message)
    (whole,) = _buffers(codec.encoder(message)((nested,)))
    for length in range(len(whole)):
        with pytest.raises(DecodeError):
            decode(_payload(codec, [whole[:length]]))


@every_wire
def test_a_message_with_something_behind_it_is_a_decode_error(codec: Codec) -> None:
    message = one(e.Nested.__contract__)
    (whole,) = _buffers(codec.encoder(message)((rich()[0],)))
    with pytest.raises(DecodeError):
        codec.decoder(message)(_payload(codec, [whole + b"\xc0\xc0\xc0\xc0"]))


@every_codec
@pytest.mark.parametrize("payload", [None, 7, "text", b"", [], [[]], [b""], [None], (), {}, ...], ids=repr)
def test_what_is_no_payload_at_all_is_a_decode_error(codec: Codec, payload: Any) -> None:
    with pytest.raises(DecodeError, match="not a Test::Rich: "):
        codec.decoder(RICH)(payload)


COUNTS = [2**32 - 1, 2**31, 2**31 - 1, 10**6]
ITEMS: list[Type] = [UINT8, FLOAT64, BOOL, STRING, TIME, e.Point.__contract__, e.Nothing.__contract__]
ITEMS += [e.Colour.__contract__, e.Scalars.__contract__, Sequence(FLOAT64), Sequence(STRING), Dictionary(INT32, INT32)]


BOMBS = (2000, 10_000, 500_000)


def _claims(codec: Codec, count: int) -> list[Payload]:
    if codec.name in HEADS:
        size = count.to_bytes(4, "little")
        return [_payload(codec, [HEADS[codec.name] + before + size + bytes(1000)]) for before in (b"", b"\xff")]
    number = count.to_bytes(4, "big")
    claims = [b"\xdd" + number, b"\xdf" + number, b"\xdb" + number, b"\xc6" + number, b"\xc9" + number + b"\x01"]
    bombs = [(b"\xdd" + (size - 10).to_bytes(4, "big")) * (min(size, 5000) // 5) for size in BOMBS]
    padded = [bomb + bytes(size - len(bomb)) for bomb, size in zip(bombs, BOMBS, strict=True)]
    return [[b"\x91" + claim + bytes(1000)] for claim in claims] + [[bomb] for bomb in padded]


@every_wire
@pytest.mark.parametrize("count", COUNTS)
def test_claimed_counts_cause_no_allocation(codec: Codec, count: int) -> None:
    decoders = [codec.decoder(one(wrap)) for item in ITEMS for wrap in (Sequence(item), Dictionary(INT32, item))]
    decoders.append(codec.decoder(one(STRING)))
    for payload in _claims(codec, count):
        tracemalloc.start()
        try:
            for decode in decoders:
                with pytest.raises(DecodeError):
                    decode(payload)
            assert tracemalloc.get_traced_memory()[1] < 8_000_000
        finally:
            tracemalloc.stop()


@every_wire
@pytest.mark.parametrize("message", DECODED, ids=range(len(DECODED)))
@pytest.mark.parametrize("byte", [b"\x91", b"\x81", b"\xdd", b"\xff", b"\x00", b"\x01"])
def test_endless_nesting_is_a_decode_error(codec: Codec, message: Struct, byte: bytes) -> None:
    _survives(codec, message, _payload(codec, [HEADS.get(codec.name, b"") + byte * 50_000]))
