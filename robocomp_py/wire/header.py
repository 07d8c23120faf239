"""The header that travels with every message of the `native` profile, little-endian, unpadded.

    request       version u8 · flags u8 · fingerprint u64 · client u64 · sequence u64 · remaining_ms u32 (· sent_ms u32)
    reply         version u8 · status u8 · client u64 · sequence u64 · server u64
    publication   version u8 · fingerprint u64 · source u64 · sequence u64 · stamp i64

`client` and `source` are random and belong to one link of one process, so sequences count that
link's messages from 1 without gaps; `server` is random per process start. `remaining_ms` is
what is left of the caller's deadline when it sends; `stamp` is nanoseconds since the Unix epoch.

A request to a server that announced the `clock` of the same host has the flag `SENT`, and says when it was sent:
milliseconds of that clock, without their highest bits. The reader subtracts the time since then from `remaining_ms`,
so a request that waited in a queue while its server was stopped does not count as new.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import DecodeError

VERSION = 1
NO_DEADLINE = 0xFFFFFFFF


class Flag:
    """`ONEWAY`: no reply is wanted. `IDEMPOTENT`: executing it twice does no harm. `SENT`: see above.

    Plain integers: an enumeration would double the time that a header takes.
    """

    NONE = 0
    ONEWAY = 1
    IDEMPOTENT = 2
    SENT = 4


_FLAG_SENT = Flag.SENT


class Request(NamedTuple):
    version: int
    flags: int
    fingerprint: int
    client: int
    sequence: int
    remaining_ms: int


class ReplyHeader(NamedTuple):
    version: int
    status: int
    client: int
    sequence: int
    server: int


class Publication(NamedTuple):
    version: int
    fingerprint: int
    source: int
    sequence: int
    stamp: int


_REQUEST, _REPLY, _PUBLICATION = struct.Struct("<BBQQQI"), struct.Struct("<BBQQQ"), struct.Struct("<BQQQq")
_SENT = struct.Struct("<BBQQQII")
_SENT_BYTES = _SENT.size - _REQUEST.size
_CLOCK = 0xFFFFFFFF
REQUEST_BYTES, REPLY_BYTES, PUBLICATION_BYTES = _REQUEST.size, _REPLY.size, _PUBLICATION.size


def pack_request(flags: int, fingerprint: int, client: int, sequence: int, remaining: float | None) -> bytes:
    """`remaining` in seconds; None, or more than fits (seven weeks), means without deadline."""
    ms = NO_DEADLINE
    if remaining is not None and remaining * 1000 < NO_DEADLINE:
        ms = int(remaining * 1000) if remaining > 0.0 else 0
    if flags & _FLAG_SENT:
        return _SENT.pack(VERSION, flags, fingerprint, client, sequence, ms, int(time.monotonic() * 1000) & _CLOCK)
    return _REQUEST.pack(VERSION, flags, fingerprint, client, sequence, ms)


def client_of(request: bytes) -> int:
    """The client in the header of a request, which is not checked."""
    return int.from_bytes(request[10:18], "little")


def pack_reply(status: int, client: int, sequence: int, server: int) -> bytes:
    return _REPLY.pack(VERSION, status, client, sequence, server)


def pack_publication(fingerprint: int, source: int, sequence: int, stamp: int) -> bytes:
    return _PUBLICATION.pack(VERSION, fingerprint, source, sequence, stamp)


def publications_of(begin: bytes, fingerprint: int, source: int) -> Callable[[int, int], bytes]:
    """A function from sequence and stamp to `begin` and the header of such a publication, by one `struct` call."""
    return partial(struct.Struct(f"<{len(begin)}sBQQQq").pack, begin, VERSION, fingerprint, source)


def read_request(data: bytes) -> Request:
    request = request_at(data, 0)
    _check_length(data, request_bytes(request))
    return request


def request_bytes(request: Request) -> int:
    """How long its header is."""
    return REQUEST_BYTES + _SENT_BYTES if request.flags & _FLAG_SENT else REQUEST_BYTES


def read_reply(data: bytes) -> ReplyHeader:
    _check_length(data, REPLY_BYTES)
    return reply_at(data, 0)


def read_publication(data: bytes) -> Publication:
    _check_length(data, PUBLICATION_BYTES)
    return publication_at(data, 0)


publication_fields: Callable[[bytes], tuple[int, int, int, int, int]] = _PUBLICATION.unpack
"""Like `read_publication`, but does not check the version and raises struct's error for a wrong length.

For links with tens of thousands of messages per second."""

publication_fields_at: Callable[[bytes, int], tuple[int, int, int, int, int]] = _PUBLICATION.unpack_from
"""The same at an offset, where more may follow."""

# At an offset within a message; more may follow.


def request_at(data: bytes, at: int) -> Request:
    if len(data) < at + REQUEST_BYTES or data[at] != VERSION:
        raise _unreadable(data, at)
    if data[at + 1] & _FLAG_SENT:
        return _sent(data, at)
    header: Request = _new(Request, _REQUEST.unpack_from(data, at))
    return header


def _sent(data: bytes, at: int) -> Request:
    if len(data) < at + _SENT.size:
        raise _unreadable(data, at)
    version, flags, fingerprint, client, sequence, ms, sent = _SENT.unpack_from(data, at)
    if ms != NO_DEADLINE:
        under_way = (int(time.monotonic() * 1000) - sent) & _CLOCK
        if under_way <= _CLOCK // 2:  # else the clock was read by another core
            ms = ms - under_way if under_way < ms else 0
    header: Request = _new(Request, (version, flags, fingerprint, client, sequence, ms))
    return header


def reply_at(data: bytes, at: int) -> ReplyHeader:
    if len(data) < at + REPLY_BYTES or data[at] != VERSION:
        raise _unreadable(data, at)
    header: ReplyHeader = _new(ReplyHeader, _REPLY.unpack_from(data, at))
    return header


def publication_at(data: bytes, at: int) -> Publication:
    if len(data) < at + PUBLICATION_BYTES or data[at] != VERSION:
        raise _unreadable(data, at)
    header: Publication = _new(Publication, _PUBLICATION.unpack_from(data, at))
    return header


_new: Any = tuple.__new__
"""Makes a named tuple of unpacked values in half the time of its constructor."""


@cache
def clock() -> str:
    """This host's clock, as a trait that servers announce: `t` and a number that changes at each boot."""
    try:
        return f"t{int(Path('/proc/sys/kernel/random/boot_id').read_text()[:8], 16)}"
    except (OSError, ValueError):
        return f"t{int.from_bytes(os.urandom(4))}"  # equal to that of no other host


def random_id() -> int:
    """64 random bits: a client, a source, or one life of a server."""
    return int.from_bytes(os.urandom(8))


def _check_length(data: bytes, length: int) -> None:
    if len(data) != length:
        raise _unreadable(data, 0)


def _unreadable(data: bytes, at: int) -> DecodeError:
    version = data[at] if len(data) > at else "none"
    return DecodeError(f"not a version {VERSION} header: {max(0, len(data) - at)} bytes, version {version}")
