"""The header that travels with every message, byte by byte."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.errors import DecodeError
from robocomp_py.testing.patience import SOON
from robocomp_py.wire import header

U8, U32, U64 = st.integers(0, 2**8 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
I64 = st.integers(-(2**63), 2**63 - 1)


def test_a_request_is_laid_out_as_the_protocol_says() -> None:
    flags = header.Flag.ONEWAY | header.Flag.IDEMPOTENT
    packed = header.pack_request(flags, 0x1122334455667788, 0x99, 0xAABB, 1.5)
    assert packed.hex(" ", 1) == (
        "01 03 88 77 66 55 44 33 22 11 99 00 00 00 00 00 00 00 bb aa 00 00 00 00 00 00 dc 05 00 00"
    )


def test_a_reply_is_laid_out_as_the_protocol_says() -> None:
    packed = header.pack_reply(4, 0x99, 0xAABB, 0x1122334455667788)
    assert packed.hex(" ") == "01 04 99 00 00 00 00 00 00 00 bb aa 00 00 00 00 00 00 88 77 66 55 44 33 22 11"


def test_a_publication_is_laid_out_as_the_protocol_says() -> None:
    packed = header.pack_publication(0x1122334455667788, 0x99, 0xAABB, -2)
    assert packed.hex(" ") == (
        "01 88 77 66 55 44 33 22 11 99 00 00 00 00 00 00 00 bb aa 00 00 00 00 00 00 fe ff ff ff ff ff ff ff"
    )


@given(U8.filter(lambda flags: not flags & header.Flag.SENT), U64, U64, U64, st.integers(0, 2**32 - 2))
def test_a_request_is_read_as_it_was_written(flags: int, fingerprint: int, client: int, number: int, ms: int) -> None:
    packed = header.pack_request(flags, fingerprint, client, number, ms / 1000)
    read = header.read_request(packed)
    assert read[:5] == (1, flags, fingerprint, client, number)
    assert abs(read.remaining_ms - ms) <= 1


@given(U8, U64, U64, U64)
def test_a_reply_is_read_as_it_was_written(status: int, client: int, number: int, server: int) -> None:
    assert header.read_reply(header.pack_reply(status, client, number, server)) == (1, status, client, number, server)


@given(U64, U64, U64, I64)
def test_a_publication_is_read_as_it_was_written(fingerprint: int, source: int, number: int, stamp: int) -> None:
    packed = header.pack_publication(fingerprint, source, number, stamp)
    assert header.read_publication(packed) == (1, fingerprint, source, number, stamp)


REMAINING = [
    (None, header.NO_DEADLINE),
    (math.inf, header.NO_DEADLINE),
    (1e9, header.NO_DEADLINE),
    (0.0, 0),
    (-3.0, 0),
    (0.0015, 1),
    (2.0, 2000),
    ((header.NO_DEADLINE - 1) / 1000, header.NO_DEADLINE - 1),
]


@pytest.mark.parametrize(("seconds", "ms"), REMAINING)
def test_what_remains_of_a_deadline_is_in_whole_milliseconds(seconds: float | None, ms: int) -> None:
    assert header.read_request(header.pack_request(0, 0, 0, 0, seconds)).remaining_ms == ms


def test_of_a_request_that_says_when_it_was_sent_the_time_on_its_way_is_over() -> None:
    flags = header.Flag.SENT | header.Flag.IDEMPOTENT
    packed = bytearray(header.pack_request(flags, 7, 8, 9, 5.0))
    assert len(packed) == header.REQUEST_BYTES + 4
    read = header.read_request(bytes(packed))
    assert read[:5] == (1, flags, 7, 8, 9)
    assert 5000 - SOON * 1000 < read.remaining_ms <= 5000
    (sent,) = struct.unpack("<I", packed[-4:])
    for ago, least, most in ((3000, 2000 - SOON * 1000, 2000), (6000, 0, 0), (-3000, 5000, 5000)):
        packed[-4:] = struct.pack("<I", (sent - ago) % 2**32)
        assert least <= header.read_request(bytes(packed)).remaining_ms <= most
    with pytest.raises(DecodeError):
        header.read_request(bytes(packed[:-1]))
    forever = header.pack_request(flags, 7, 8, 9, None)
    assert header.read_request(forever).remaining_ms == header.NO_DEADLINE


READERS = [header.read_request, header.read_reply, header.read_publication]
PACKED = [header.pack_request(0, 0, 0, 0, None), header.pack_reply(0, 0, 0, 0), header.pack_publication(0, 0, 0, 0)]


@pytest.mark.parametrize(("read", "packed"), list(zip(READERS, PACKED, strict=True)))
def test_a_header_of_another_version_or_length_is_refused(read: Callable[[bytes], object], packed: bytes) -> None:
    for length in range(len(packed)):
        with pytest.raises(DecodeError, match=f"not a version 1 header: {length} bytes"):
            read(packed[:length])
    with pytest.raises(DecodeError, match=f"{len(packed)} bytes, version 2"):
        read(b"\x02" + packed[1:])
    with pytest.raises(DecodeError, match=f"{len(packed) + 1} bytes"):
        read(packed + b"\x00")


@given(st.binary(max_size=60))
def test_junk_is_refused_or_read(junk: bytes) -> None:
    for read, packed in zip(READERS, PACKED, strict=True):
        if len(junk) == len(packed) and junk[0] == header.VERSION:
            read(junk)
        else:
            with pytest.raises(DecodeError):
                read(junk)


def test_random_ids_fit_and_differ() -> None:
    ids = {header.random_id() for _ in range(100)}
    assert len(ids) == 100
    assert all(0 <= each < 2**64 for each in ids)
