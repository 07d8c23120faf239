"""Makes the types of our DDS topics from contracts, and reads and writes the bytes of samples.

    publication   {PublicationHeader header; fields of the message}           topic rc/<channel>
    request       {RequestHeader header; fields of the request}               topic rc/<channel>Request
    reply         {ReplyHeader header; fields of the response; octets error}  topic rc/<channel>Reply
    credit        {reader, source, sequence, window}                          topic rc/<channel>Credit

Other DDS programs see every field, and can read and write every sample. A reply that is not OK
holds an empty response, and its payload as `error`. All headers have the same size, a multiple of 8.
So the bytes of our codec's payload become a sample when the header is filled in. The library's own
codec is not used. A message whose fields are not known is sent as octets.
"""

from __future__ import annotations

import re
import struct
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as idl

from ...contract.types import STRING, TIME, Dictionary, Enumeration, Primitive, Sequence, Struct, Type, spell
from ...errors import DecodeError
from ...wire.cdr import ENCAPSULATION, TAIL, Cdr
from ...wire.codec import Payload
from ...wire.header import VERSION

ROOM = 40
"""Size of a header in bytes."""

BODY = len(ENCAPSULATION) + ROOM
"""Offset of a message's fields in a sample."""

CODEC = Cdr(ROOM)

BEFORE_TAIL = -len(TAIL)
"""End of the part of a sample that is sent, except for replies."""

DdsType = type[IdlStruct]

_NUMBERS: dict[str, Any] = {
    "b": idl.int8, "B": idl.uint8, "h": idl.int16, "H": idl.uint16, "i": idl.int32, "I": idl.uint32,
    "q": idl.int64, "Q": idl.uint64, "f": idl.float32, "d": idl.float64,
}  # fmt: skip
"""The library's number types, by our codes."""

_made: dict[tuple[str, int], tuple[object, DdsType]] = {}
_making = threading.RLock()


# -- headers ------------------------------------------------------------------


class Request(NamedTuple):
    """The fields of a request's header."""

    start: bytes
    flags: int
    remaining_ms: int
    fingerprint: int
    client: int
    sequence: int
    stamp: int


class Grant(NamedTuple):
    """A reader of a reliable topic has consumed a source's messages up to `sequence`, and accepts `window` more."""

    reader: int
    source: int
    sequence: int
    window: int


_REQUEST, _REPLY = struct.Struct("<5sBxxIQQQq"), struct.Struct("<5sB6xQQQq")
_PUBLICATION, _CREDIT = struct.Struct("<5s7xQQQq"), struct.Struct("<4sQQQI")
_U32 = struct.Struct("<I")

START = ENCAPSULATION + bytes((VERSION,))
"""The first bytes of every sample with a header."""

# Bound methods of `struct`, without a wrapper, since every message uses them.

fill_request, fill_reply, fill_publication = _REQUEST.pack_into, _REPLY.pack_into, _PUBLICATION.pack_into
"""Write a header: `fill_reply(sample, 0, START, status, client, sequence, server, stamp)`; all fields: `_HEADERS`."""

request_fields, reply_fields, publication_fields = (
    _REQUEST.unpack_from, _REPLY.unpack_from, _PUBLICATION.unpack_from
)  # fmt: skip
"""Read the same fields, the first of which must be `START`. Raise `struct.error` if it is short."""


def pack_grant(grant: Grant) -> bytes:
    return _CREDIT.pack(ENCAPSULATION, *grant)


def unreadable(sample: bytes) -> DecodeError:
    return DecodeError(f"not a version {VERSION} sample in little-endian XCDR1: {len(sample)} bytes")


def read_grant(sample: bytes) -> Grant:
    if len(sample) != _CREDIT.size or not sample.startswith(ENCAPSULATION):
        raise DecodeError(f"not a credit: {len(sample)} bytes")
    return Grant._make(_CREDIT.unpack(sample)[1:])


# -- messages -----------------------------------------------------------------


class Message:
    """Converts payloads of one message to samples, and back. `kind` is None if the fields are not known."""

    def __init__(self, kind: Struct | None) -> None:
        self.kind = kind
        self.plain = kind is not None
        """Whether payloads and samples have the same bytes."""
        self._empty = _zero(kind) if kind else TAIL
        """An empty message, padded up to the count of the octets that follow."""

    def sample(self, payload: Payload) -> bytearray:
        """A sample with this payload, followed by an empty sequence (`TAIL`); the caller fills in the header."""
        if type(payload) is bytearray and self.kind is not None:
            return payload
        if self.kind is None:
            octets = b"" if payload is None else bare(payload)
            return bytearray(b"").join((bytes(BODY), _counted(octets), TAIL))
        if payload is None:
            return bytearray(b"").join((bytes(BODY), self._empty, TAIL))
        return bytearray(b"").join((payload, bytes(-len(payload) & 3), TAIL))  # a received payload

    def payload(self, sample: bytes) -> Payload:
        """The payload in a sample and the bytes after it, not copied. Raises DecodeError."""
        return sample if self.plain else dressed(_octets(sample, BODY))

    def failure(self, payload: Payload) -> bytearray:
        """A sample with an empty message and a payload of another type after it."""
        octets = b"" if payload is None else bare(payload)
        return bytearray(b"").join((bytes(BODY), self._empty, _counted(octets)))

    def why(self, sample: bytes) -> Payload:
        """The payload of another type in a sample; empty if there is none. Raises DecodeError."""
        octets = _octets(sample, BODY + len(self._empty))
        return dressed(octets) if len(octets) else None


def bare(payload: Payload) -> memoryview:
    """The fields of a payload, without padding and tail."""
    fields = memoryview(payload)[BODY:]
    return fields[: -len(TAIL)] if type(payload) is bytearray else fields


def dressed(octets: memoryview | bytes) -> Payload:
    """A payload whose fields are these octets."""
    return b"".join((ENCAPSULATION, bytes(ROOM), octets))


def _counted(octets: memoryview | bytes) -> bytes:
    return b"".join((_U32.pack(len(octets)), octets, bytes(-len(octets) & 3)))


def _octets(sample: bytes, start: int) -> memoryview:
    if len(sample) < start + 4:
        raise DecodeError(f"a sample of {len(sample)} bytes has no octets behind {start}")
    (count,) = _U32.unpack_from(sample, start)
    if count > len(sample) - start - 4:
        raise DecodeError(f"{count} octets in a sample of {len(sample)} bytes")
    return memoryview(sample)[start + 4 : start + 4 + count]


def _zero(kind: Struct) -> bytes:
    """The encoding of a struct whose fields are all zero or empty, padded to a multiple of four."""
    out = bytearray()
    _append_zero(kind, out)
    return bytes(out) + bytes(-len(out) & 3)


def _append_zero(kind: Type, out: bytearray) -> None:
    match kind:
        case Struct(fields=fields) if fields:
            for field in fields:
                _append_zero(field.type, out)
        case Struct():
            out += b"\0"
        case Primitive() if kind is STRING:
            out += bytes(-len(out) & 3) + b"\1\0\0\0\0"
        case Primitive() if kind is TIME:
            out += bytes((-len(out) & 3) + 8)
        case Primitive():
            size = struct.calcsize(kind.letter)
            out += bytes(-len(out) % size + size)
        case Enumeration() | Sequence() | Dictionary():
            out += bytes((-len(out) & 3) + 4)


# -- types --------------------------------------------------------------------


def publication_type(name: str, message: Struct | None) -> DdsType:
    """The type of a publication. It has another name than a request with the same fields: their headers differ."""
    name = f"{name.removesuffix('Request')}Publication"
    return _cached("publication", name, message, lambda: _message(name, "PublicationHeader", message))


def request_type(name: str, message: Struct | None) -> DdsType:
    return _cached("request", name, message, lambda: _message(name, "RequestHeader", message))


def reply_type(name: str, message: Struct | None) -> DdsType:
    return _cached("reply", name, message, lambda: _message(name, "ReplyHeader", message, error=_sequence(idl.uint8)))


def credit_type() -> DdsType:
    fields = {"reader": idl.uint64, "source": idl.uint64, "sequence": idl.uint64, "window": idl.uint32}
    return _cached("credit", "", None, lambda: _struct("robocomp::Credit", fields))


def announcement_type() -> DdsType:
    return _cached("announcement", "", None, lambda: _struct("robocomp::Announcement", {"id": idl.uint64}))


_HEADERS: dict[str, dict[str, Any]] = {
    "PublicationHeader": {
        "version": idl.uint8, "fingerprint": idl.uint64, "source": idl.uint64, "sequence": idl.uint64,
        "stamp": idl.int64,
    },
    "RequestHeader": {
        "version": idl.uint8, "flags": idl.uint8, "remaining_ms": idl.uint32, "fingerprint": idl.uint64,
        "client": idl.uint64, "sequence": idl.uint64, "stamp": idl.int64,
    },
    "ReplyHeader": {
        "version": idl.uint8, "status": idl.uint8, "client": idl.uint64, "sequence": idl.uint64,
        "server": idl.uint64, "stamp": idl.int64,
    },
}  # fmt: skip


def _cached(role: str, name: str, message: Struct | None, make: Callable[[], DdsType]) -> DdsType:
    """One class per message and role for all transports: the library compares classes by identity."""
    key = (f"{role} {name}", id(message))
    with _making:  # the library builds types on a global stack
        if key not in _made:
            _made[key] = message, make()
        return _made[key][1]


def _message(name: str, header: str, message: Struct | None, **more: Any) -> DdsType:
    made: dict[str, DdsType] = {}
    fields: dict[str, Any] = {}
    first = _cached("header", header, None, lambda: _struct(f"robocomp::{header}", _HEADERS[header]))
    _add(fields, "header", first)
    if message is None:
        _add(fields, "data", _sequence(idl.uint8))
    else:
        for member, kind in _members(message, made).items():
            _add(fields, member, kind)
    for member, kind in more.items():
        _add(fields, member, kind)
    return _struct(name, fields)


def _add(fields: dict[str, Any], name: str, kind: Any) -> None:
    while name in fields:
        name += "_"
    fields[name] = kind


def _members(kind: Struct, made: dict[str, DdsType]) -> dict[str, Any]:
    found = {field.name: _type(field.type, made) for field in kind.fields}
    return found or {"structure_needs_at_least_one_member": idl.uint8}


def _type(kind: Type, made: dict[str, DdsType]) -> Any:
    match kind:
        case Primitive() if kind is TIME:
            return _once("robocomp::Time", lambda: {"sec": idl.int32, "nanosec": idl.uint32}, made)
        case Primitive():
            return _NUMBERS.get(kind.letter, kind.python)
        case Enumeration():
            return idl.int32
        case Struct(name=name):
            return _once(name, lambda: _members(kind, made), made)
        case Sequence(item):
            return _sequence(_type(item, made))
        case Dictionary(key, value, name):
            name = f"{name}Entry" if name else "robocomp::Entry_" + re.sub(r"\W+", "_", spell(kind))
            return _sequence(_once(name, lambda: {"key": _type(key, made), "value": _type(value, made)}, made))


def _once(name: str, members: Callable[[], dict[str, Any]], made: dict[str, DdsType]) -> DdsType:
    if name not in made:
        made[name] = _struct(name, members())
    return made[name]


def _sequence(item: Any) -> Any:
    return idl.sequence[item]  # type: ignore[misc]  # it becomes an annotation; only the library knows how


def _struct(name: str, fields: dict[str, Any]) -> DdsType:
    made = make_idl_struct(name.rpartition("::")[2], name, fields, dataclassify=False)
    made.__init__ = _init  # type: ignore[assignment]  # no dataclass: a member may be called `lambda`
    return made


def _init(self: IdlStruct, **members: Any) -> None:
    """For reading samples with the library's codec, as the tests do."""
    vars(self).update(members)


# Making the first type takes ten times as long as others. Done at import, forked processes inherit it.
announcement_type().__idl__.fill_type_data()
