"""Lists of structs of numbers, which codecs pack and read by the column."""

from __future__ import annotations

import gc
import random
from dataclasses import dataclass, make_dataclass
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT16,
    INT32,
    TIME,
    UINT8,
    Field,
    Sequence,
    Struct,
    Type,
    dtypes,
)
from robocomp_py.errors import DecodeError, EncodeError
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import assert_same
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.messagepack import MessagePack

from .codecs import every_codec, every_wire, one, there_and_back
from .messages import messages, patiently
from .second_opinions import by_pycdr2, by_rosbags
from .test_cdr import encoded

COUNTS = (0, 1, 31, 32, 33, 1000)
"""Few, many, and where that begins."""


def record(*kinds: Type) -> Struct:
    """A struct with a class as generated modules have it."""
    fields = tuple(Field(f"f{number}", kind) for number, kind in enumerate(kinds))
    python: Any = make_dataclass("Row", [(field.attribute, object) for field in fields], slots=True)
    python.__contract__ = Struct("Test::Row", fields, python)
    contract: Struct = python.__contract__
    return contract


NUMBERS = [kind for kind in dtypes() if kind is not BOOL]
INNER = record(INT32, FLOAT64)
KINDS = {
    **{kind.value: record(kind, kind, kind) for kind in NUMBERS},
    "one number": record(FLOAT32),
    "all numbers": record(*NUMBERS),
    "an octet behind": record(FLOAT64, UINT8),
    "a bool between": record(FLOAT32, BOOL, FLOAT32),
    "a time and an enumerator": record(TIME, e.Colour.__contract__, INT32),
    "a struct": record(UINT8, INNER, FLOAT32),
    "nothing": record(e.Nothing.__contract__, UINT8, e.Nothing.__contract__),
    "twenty": record(*[FLOAT32] * 20),
    "nothing at all": e.Nothing.__contract__,
    "a tuple": Struct("Test::Tuple", (Field("a", FLOAT32), Field("b", INT32))),
}


def some(kind: Type, dice: random.Random) -> Any:
    match kind:
        case Struct(fields=fields, python=python):
            values = [some(field.type, dice) for field in fields]
            return python(*values) if python else tuple(values)
        case e.Colour.__contract__:
            return dice.choice(list(e.Colour))
        case _ if kind is BOOL:
            return dice.random() < 0.5
        case _ if kind in (FLOAT32, FLOAT64):
            return float(np.float32(dice.uniform(-1e6, 1e6)))
        case _ if kind is TIME:
            return dice.randrange(-(10**18), 10**18)
    information = np.iinfo(dtypes()[kind])  # type: ignore[index]  # an integer, by now
    return dice.randint(int(information.min), int(information.max))


def rows(kind: Type, count: int) -> list[Any]:
    dice = random.Random(count)
    return [some(kind, dice) for _ in range(count)]


@every_codec
@pytest.mark.parametrize("name", KINDS)
def test_however_many_there_are_they_come_back(codec: Codec, name: str) -> None:
    kind = KINDS[name]
    for count in COUNTS:
        for first in (UINT8, FLOAT64):  # so that they begin at different alignments
            message = Struct("Test::Message", (Field("first", first), Field("rows", Sequence(kind))))
            sent = (1, rows(kind, count))
            assert_same(codec.decoder(message)(codec.encoder(message)(sent))[1], sent[1])


@pytest.mark.parametrize("name", KINDS)
def test_others_write_the_same_octets_of_them(name: str) -> None:
    message = one(Sequence(KINDS[name]))
    sent = (rows(KINDS[name], 50),)
    payload = encoded(message, *sent)
    assert payload == by_pycdr2(message, sent)
    assert payload == by_rosbags(message, sent)


@every_codec
@pytest.mark.parametrize("count", [3, 100])
@pytest.mark.parametrize("wrong", ["1.0", None, 1e39])
def test_an_item_that_does_not_fit_is_named(codec: Codec, count: int, wrong: Any) -> None:
    kind = KINDS["float32"]
    items = rows(kind, count)
    items[count - 2].f1 = wrong
    with pytest.raises(EncodeError, match=rf"value\[{count - 2}\].f1 must be a float"):
        codec.encoder(one(Sequence(kind)))((items,))


@every_codec
def test_what_a_class_does_when_it_is_made_is_done(codec: Codec) -> None:
    @dataclass(slots=True)
    class Counted:
        x: float = 0.0
        total: int = 0

        def __post_init__(self) -> None:
            self.total += 1

    kind = Struct("Test::Counted", (Field("x", FLOAT64), Field("total", INT32)), Counted)
    Counted.__contract__ = kind  # type: ignore[attr-defined]
    sent = [Counted(1.0) for _ in range(40)]
    assert [each.total for each in there_and_back(codec, Sequence(kind), sent)] == [2] * 40


@every_codec
@pytest.mark.parametrize("collects", [True, False])
def test_python_collects_garbage_afterwards_if_it_did_before(codec: Codec, collects: bool) -> None:
    kind = KINDS["float32"]
    message = one(Sequence(kind))
    decode, payload = codec.decoder(message), codec.encoder(message)((rows(kind, 1000),))
    before = gc.isenabled()
    try:
        (gc.enable if collects else gc.disable)()
        decode(payload)
        assert gc.isenabled() == collects
    finally:
        (gc.enable if before else gc.disable)()


@every_wire
@pytest.mark.parametrize("count", [3, 40])
def test_damage_anywhere_is_a_decode_error_or_a_message(codec: Codec, count: int) -> None:
    message = one(Sequence(KINDS["a bool between"]))
    decode, encode = codec.decoder(message), codec.encoder(message)
    payload = encode((rows(KINDS["a bool between"], count),))
    whole = payload[0] if isinstance(payload, list) else payload
    refused = 0
    for at in range(len(whole)):
        damaged = bytearray(whole)
        damaged[at] ^= 0xFF
        try:
            encode(decode([bytes(damaged)] if isinstance(payload, list) else bytes(damaged)))
        except DecodeError:
            refused += 1
    assert refused >= count  # every bool, at least


@settings(patiently, max_examples=50)
@given(messages())
def test_packed_by_a_library_in_its_own_widths_it_is_the_same_message(sent: tuple[Struct, tuple[Any, ...]]) -> None:
    message, values = sent
    packed, *frames = MessagePack().encoder(message)(values)
    again = msgpack.packb(msgpack.unpackb(packed, strict_map_key=False))
    assert_same(list(MessagePack().decoder(message)([again, *frames])), list(values))


@settings(patiently, max_examples=50)
@given(kind=st.sampled_from(sorted(KINDS)), count=st.sampled_from([2, 40]), data=st.data())
def test_what_can_be_read_means_the_same_to_a_library(kind: str, count: int, data: st.DataObject) -> None:
    fields = (Field("rows", Sequence(KINDS[kind])), Field("scale", FLOAT32), Field("numbers", Sequence(INT16)))
    message = Struct("Test::Message", fields)
    decode = MessagePack().decoder(message)
    (packed,) = MessagePack().encoder(message)((rows(KINDS[kind], count), 0.5, [1, 2]))
    damaged = bytearray(packed)
    damaged[data.draw(st.integers(0, len(packed) - 1))] = data.draw(st.integers(0, 255))
    try:
        found = decode([bytes(damaged)])
    except DecodeError:
        return
    again = msgpack.packb(msgpack.unpackb(bytes(damaged), strict_map_key=False))
    assert_same(list(decode([again])), list(found))
