"""Contexts of requests, and replies that are not results. Payloads are encapsulations. No I/O here.

context of a request   rc       our header (`wire.header`), in hexadecimal digits
                       rc-max   maximum size in bytes of the reply's payload, if it is not the default
answer                 a payload, or an exception that the operation declares, as it is; of all other outcomes
                       clients that sent `rc` get the exception `::robocomp::Refusal`, others get Ice's own

    module robocomp
    {
        sequence<byte> Octets;
        exception Refusal { byte status; Octets detail; }
    }
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

from ...contract.types import BOOL, STRING, Field, Sequence, Struct
from ...errors import DecodeError
from ...wire.header import REQUEST_BYTES, Request, read_request
from ...wire.ice import Ice
from ..base import STATUSES, Reply, Status

RC, RC_MAX = "rc", "rc-max"

OBJECT = "::Ice::Object"
"""The base interface of all objects."""

NOTHING = b"\6\0\0\0\1\1"
"""The encapsulation of no values."""

LEFT = 255
"""A status of replies: the server left before it had answered."""

REPLY_HEAD = 19
"""Bytes of a reply before its payload."""

_ANSWER = struct.Struct("<iBBB")
_LAST_SLICE = 0x20
_TYPE = b"\x13::robocomp::Refusal"
_HEAD = _ANSWER.size + len(_TYPE)


def request_head(identity: str, operation: str, context: Mapping[str, str]) -> int:
    """Maximum number of bytes of a request before its payload."""
    texts = (identity, operation, *context.keys(), *context.values())
    return 32 + sum(5 + len(text.encode()) for text in texts)


_LENGTHS = (2 * REQUEST_BYTES, 2 * (REQUEST_BYTES + 4))


def is_ours(context: Mapping[str, str]) -> bool:
    """Whether a request seems to be ours, by a quick check; other programs may use the same key."""
    return len(context.get(RC, "")) in _LENGTHS


def header(context: Mapping[str, str]) -> Request | None:
    """The header of a request; None if another program sent it."""
    told = context.get(RC)
    if told is None:
        return None
    try:
        return read_request(bytes.fromhex(told))
    except (ValueError, DecodeError):
        return None


def room(context: Mapping[str, str], usual: int) -> int:
    """Maximum size of a reply's payload in bytes."""
    told = context.get(RC_MAX, "")
    return min(int(told), usual) if told.isascii() and told.isdecimal() and len(told) < 12 else usual


def refusal(status: int, detail: bytes) -> bytes:
    """The exception that reports the outcome of a request to a client of ours."""
    size = bytes([len(detail)]) if len(detail) < 255 else b"\xff" + struct.pack("<i", len(detail))
    total = _HEAD + 1 + len(size) + len(detail)
    return b"".join((_ANSWER.pack(total, 1, 1, _LAST_SLICE), _TYPE, bytes([status]), size, detail))


def read_refusal(payload: bytes) -> tuple[int, bytes] | None:
    """Status and detail of a refusal; None for another exception. Raises DecodeError."""
    if payload[_ANSWER.size : _HEAD] != _TYPE:
        return None
    status, length, begin = payload[_HEAD : _HEAD + 1], payload[_HEAD + 1 : _HEAD + 2], _HEAD + 2
    if length == b"\xff":
        length, begin = payload[begin : begin + 4], begin + 4
    if not status or begin + int.from_bytes(length, "little") != len(payload):
        raise DecodeError("not a ::robocomp::Refusal")
    return status[0], payload[begin:]


def reply_of(ok: bool, payload: bytes) -> Reply | None:
    """The reply in an Ice answer; None if the server left before it had answered. Raises DecodeError."""
    if ok:
        return Reply(Status.OK, payload)
    refused = read_refusal(payload)
    if refused is None:
        return Reply(Status.THROWN, payload)
    status, detail = refused
    if status == LEFT:
        return None
    if status not in STATUSES:
        raise DecodeError(f"status {status}")
    return Reply(STATUSES[status], detail)


_FAILURE = Struct("Failure", (Field("type", STRING), Field("message", STRING), Field("traceback", STRING)))
"""The payload of FAILED."""
_encode, _decode = Ice().encoder(_FAILURE), Ice().decoder(_FAILURE)


_TEXT, _TEXTS, _FLAG = (Struct("About", (Field("value", kind),)) for kind in (STRING, Sequence(STRING), BOOL))
_encode_text, _encode_texts, _encode_flag = (Ice().encoder(kind) for kind in (_TEXT, _TEXTS, _FLAG))
_decode_text = Ice().decoder(_TEXT)


def text_of(payload: bytes) -> str:
    """The string in a payload. Raises DecodeError."""
    (value,) = _decode_text(payload)
    return str(value)


def text(value: str) -> bytes:
    return bytes(_encode_text((value,)))


def texts(values: list[str]) -> bytes:
    return bytes(_encode_texts((values,)))


def flag(value: bool) -> bytes:
    return bytes(_encode_flag((value,)))


def failed(kind: str, reason: str, trace: str = "") -> Reply:
    texts = (text.encode(errors="backslashreplace").decode() for text in (kind, reason, trace))
    return Reply(Status.FAILED, _encode(tuple(texts)))


def failure_told(unknown: str) -> Reply:
    """The failure that a foreign server reports by an undeclared exception.

    Ice for Python sends the traceback, with the exception after its last frame; other programs send any text.
    """
    text = unknown.strip()
    lines = text.split("\n")
    begins = [number for number, line in enumerate(lines) if line.startswith("Traceback ")]
    if begins[:1] == [0]:
        end = next((n for n in range(begins[-1] + 1, len(lines)) if not lines[n].startswith(" ")), len(lines))
        kind, _, reason = "\n".join(lines[end:]).partition(": ")
        if kind.replace(".", "_").isidentifier():
            return failed(kind.rpartition(".")[2], reason, "\n".join(lines[:end]))
    return failed("UnknownException", text or "no reason given")


def failure_text(payload: bytes | None) -> str:
    """The text about a failure for a foreign client."""
    try:
        kind, reason, trace = _decode(payload or b"")
    except DecodeError:  # the service itself failed
        return "no reason given"
    return f"{kind}: {reason}\n{trace}".strip()
