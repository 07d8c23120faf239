"""A message that is small as octets is not large as objects: it is checked against the contract while it is read."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest

from robocomp_py.contract.types import FLOAT32, INT32, STRING, Dictionary, Field, Sequence, Struct, Type
from robocomp_py.errors import DecodeError, EncodeError
from robocomp_py.testing import everything as e
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import Codec, Payload
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.items import MAX_ITEMS, counter
from robocomp_py.wire.messagepack import MAX_TREE, MessagePack
from robocomp_py.wire.stream import PIECE, SHORT

from .codecs import every_wire, one

NAMED = Struct("Test::Named", (Field("name", STRING), Field("others", Sequence(STRING))))
KINDS: list[Type] = [
    Sequence(STRING),
    Sequence(NAMED),
    Sequence(Sequence(STRING)),
    Sequence(Sequence(FLOAT32)),
    Sequence(e.Nothing.__contract__),
    Sequence(e.Point.__contract__),
    Dictionary(STRING, Sequence(STRING)),
    Sequence(FLOAT32),
    STRING,
]
TINY = [b"\x80", b"\x90", b"\xa0", b"\xc0", b"\x00", b"\xc4\x00", b"\x81\xa0\xc0", b"\x92\xa0\x90", b"\xa2no"]
"""MessagePack's smallest objects: empty dictionaries, lists and texts, nothing, a number, no octets, and so on."""


def refused(codec: Codec, kind: Type, payload: Payload, mebibytes: float) -> None:
    """Have a payload refused, within so much memory."""
    decode = codec.decoder(one(kind))
    with pytest.raises(DecodeError):
        decode([b""] if codec.name == "messagepack" else b"")  # the first time, functions are compiled
    tracemalloc.start()
    try:
        with pytest.raises(DecodeError):
            decode(payload)
        assert tracemalloc.get_traced_memory()[1] < mebibytes * 2**20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("tiny", TINY, ids=repr)
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_megabytes_of_tiny_objects_are_refused_before_they_are_objects(kind: Type, tiny: bytes) -> None:
    count = MAX_TREE // len(tiny) - 8
    refused(MessagePack(), kind, [b"\x91\xdd" + struct.pack(">I", count) + tiny * count], 10)


@pytest.mark.parametrize("begin", [b"\x91", b"\x81", b"\x81\xa0", b"\xdd\0\0\x40\0", b"\xdf\0\0\x40\0"], ids=repr)
def test_deep_nesting_is_refused_where_it_is_deeper_than_the_contract(begin: bytes) -> None:
    for kind in KINDS:
        refused(MessagePack(), kind, [b"\x91" + begin * (MAX_TREE // len(begin) - 1)], 10)


@pytest.mark.parametrize(
    ("size", "mebibytes"),
    [(256, 1), (SHORT, 3), (SHORT + 1, 1), (8 * 1024, 2), (PIECE, 8), (PIECE + 1, 8), (2 * PIECE, 8)],
)
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_claims_and_tiny_objects_take_little_memory_in_messages_of_any_size(
    kind: Type, size: int, mebibytes: int
) -> None:
    lists = b"\xdc" + struct.pack(">H", min(size - 1, 0xFFFF))
    for begin in (lists * 500, b"\x91" + lists, b"\x91\xdd" + struct.pack(">I", size - 6)):
        for tiny in (lists, b"\x80", b"\x81\x00"):
            refused(MessagePack(), kind, [(begin + tiny * size)[:size]], mebibytes)


def many_items(codec: Codec, inner: int, outer: int) -> Payload:
    """A sequence of so many sequences, each of so many empty texts: as the contract says, and small as octets."""
    match codec:
        case MessagePack():
            return [
                b"\x91\xdd" + struct.pack(">I", outer) + (b"\xdd" + struct.pack(">I", inner) + b"\xa0" * inner) * outer
            ]
        case Cdr():
            return b"\0\1\0\0" + struct.pack("<I", outer) + (struct.pack("<I", inner) + bytes(4 * inner)) * outer
        case Ice():
            body = b"\xff" + struct.pack("<i", outer) + (b"\xff" + struct.pack("<i", inner) + bytes(inner)) * outer
            return struct.pack("<iBB", 6 + len(body), 1, 1) + body
    raise AssertionError(codec.name)


@every_wire
def test_the_items_of_a_message_are_counted_together(codec: Codec) -> None:
    texts = one(Sequence(Sequence(STRING)))
    (there,) = codec.decoder(texts)(many_items(codec, 1000, 1000))
    assert [len(there), len(there[0])] == [1000, 1000]
    with pytest.raises(DecodeError, match="1048576 items"):
        codec.decoder(texts)(many_items(codec, 1000, 1049))
    refused(codec, Sequence(Sequence(STRING)), many_items(codec, MAX_ITEMS, 2), 40)


@every_wire
def test_structs_of_fixed_size_are_counted(codec: Codec) -> None:
    kind = Sequence(e.Nothing.__contract__)
    for count, fits in ((1000, True), (MAX_ITEMS + 1, False)):
        match codec:
            case MessagePack():
                payload: Payload = [b"\x91\xdd" + struct.pack(">I", count) + b"\x90" * count]
            case Cdr():
                payload = b"\0\1\0\0" + struct.pack("<I", count) + bytes(count)
            case _:
                payload = struct.pack("<iBBBi", 11 + count, 1, 1, 255, count) + bytes(count)
        if fits:
            assert len(codec.decoder(one(kind))(payload)[0]) == count
        else:
            refused(codec, kind, payload, 4)


@every_wire
@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Sequence(STRING), lambda: [""] * (MAX_ITEMS + 1)),
        (Sequence(Sequence(STRING)), lambda: [[""] * 1000] * 1100),
        (Dictionary(INT32, Sequence(STRING)), lambda: dict.fromkeys(range(10), [""] * 110_000)),
    ],
    ids=["texts", "lists", "dictionary"],
)
def test_a_sender_gets_an_error_for_too_many_items(codec: Codec, kind: Type, values: Callable[[], Any]) -> None:
    with pytest.raises(EncodeError, match="1048576 items"):
        codec.encoder(one(kind))((values(),))


def test_numbers_in_arrays_are_no_items() -> None:
    assert counter(Sequence(FLOAT32)) is None
    count = counter(Sequence(Sequence(FLOAT32)))
    assert count
    assert count([[1.0] * 100] * 3) == 3
