"""What a message looks like: one frame, and behind it one for each large array.

    request, command, publication     channel's name · NUL · header · packed values
    reply                             header · packed values
    publication for one latecomer     NUL · eight octets, its own topic · header · packed values
    welcome to one subscriber         octet 1 · eight octets, what it subscribed to

One frame instead of three is less work for both sides and for ZeroMQ's own threads, which short calls notice.
"""

from __future__ import annotations

import struct
from typing import Any

from ...wire.codec import Payload
from ...wire.header import (
    PUBLICATION_BYTES,
    REPLY_BYTES,
    VERSION,
    ReplyHeader,
    Request,
    publication_at,
    publication_fields_at,
    reply_at,
    request_at,
    request_bytes,
)

Frames = list[Any]

OWN_TOPIC_BYTES = 9

_LONGEST_NAME = 4096
"""The name of a channel, and its NUL, are among the first octets of a message."""

_SHORT = 4096
"""What has fewer bytes is copied sooner than looked at through a view."""


def topic(channel: str) -> bytes:
    """What the messages of a channel begin with."""
    return channel.encode() + b"\0"


def welcome_topic(subscriber: str, publication: str = "0") -> bytes:
    """What a subscriber of that address subscribes to, to be told that it is connected; empty if that is no address.

    A subscriber of a channel with `*` may be connected to several publications of one socket. `publication` is how the
    address of the one that is meant ends.
    """
    try:
        return b"\1" + (int(subscriber, 16) ^ int(publication, 16)).to_bytes(8, "little")
    except (ValueError, OverflowError):  # of another program, which wants no welcome
        return b""


def is_welcome(named: Any) -> bool:
    """Whether that is what a subscriber is told by, or subscribes to."""
    return len(named) == OWN_TOPIC_BYTES and named[0] == 1


def topic_of(first: Any) -> bytes:
    """The topic that a first frame begins with; empty if there is none."""
    begin = bytes(first[:_LONGEST_NAME])
    return begin[: begin.find(b"\0") + 1]


def joined(begin: bytes, payload: Payload) -> Frames:
    """A message that begins so."""
    return [begin + payload[0], *payload[1:]] if payload else [begin]


def read_request_frames(frames: Frames) -> tuple[bytes, Request, Frames]:
    """The topic, the header and the payload of a request or command. Raises DecodeError."""
    first = frames[0]
    begin = first if type(first) is bytes else bytes(first[:_LONGEST_NAME])
    at = begin.find(b"\0") + 1
    request = request_at(first, at)
    return begin[:at], request, _payload(frames, at + request_bytes(request))


def read_reply_frames(frames: Frames) -> tuple[ReplyHeader, Frames]:
    """The header and the payload of a reply. Raises DecodeError."""
    return reply_at(frames[0], 0), _payload(frames, REPLY_BYTES)


def read_publication_frames(frames: Frames) -> tuple[tuple[int, int, int, int, int], Frames]:
    """The fields of the header, and the payload of a publication. Raises DecodeError."""
    first = frames[0]
    at = (first if type(first) is bytes else bytes(first[:_LONGEST_NAME])).find(b"\0") + 1
    if at == 1:
        at = OWN_TOPIC_BYTES
    try:
        header = publication_fields_at(first, at)
    except struct.error:
        header = (-1, 0, 0, 0, 0)
    if header[0] != VERSION:
        publication_at(first, at)  # which says what is wrong
    at += PUBLICATION_BYTES
    if at < len(first) < _SHORT and len(frames) == 1:
        return header, [first[at:]]
    return header, _payload(frames, at)


def _payload(frames: Frames, at: int) -> Frames:
    """What follows the header: nothing, or the packed values and the arrays."""
    first = frames[0]
    if at == len(first):
        return []
    packed = first[at:] if len(first) < _SHORT else memoryview(first)[at:]
    return [packed, *frames[1:]]
