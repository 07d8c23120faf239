"""What a codec is.

A codec compiles, once per message type, a function that encodes and one that decodes; at run time
nothing looks at types any more. A message's Python form is the tuple of its fields. A payload is a
snapshot, unless asked otherwise: what happens to the values after they were encoded does not show in it.

Messages are structs like others. A codec whose format has its own form of an operation's results or of
an exception knows them by their classes, `Response` and `Thrown`; the values are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from ..contract.types import Struct
from ..errors import DecodeError, EncodeError
from .explain import explain
from .items import TooManyItems

Payload = Any
"""What a codec makes of a message: buffers on every wire, the value itself in-process."""

Encoder = Callable[[tuple[Any, ...]], Payload]
Decoder = Callable[[Payload], tuple[Any, ...]]

MAX_BYTES = 256 * 1024 * 1024
"""A message of more bytes is refused by both sides."""


class Codec(Protocol):
    """Values to payloads and back. Knows types, never transports."""

    @property
    def name(self) -> str: ...

    def __hash__(self) -> int: ...

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        """A function from the message's fields to a payload. It raises EncodeError, naming the field.

        Without `snapshot`, a payload may share memory with large arrays among the values: for what
        is sent before they can change.
        """
        ...

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        """A function from a payload to the message's fields. It raises DecodeError, whatever is wrong.

        With `prefix`, whatever follows the last field is ignored.
        """
        ...


# Encoders and decoders catch everything themselves, and raise one of these: a function around them would cost more
# than what it guards.


def refused(message: Struct, values: Any, exc: Exception) -> EncodeError:
    """Which field holds what instead of what; found by looking again, slowly."""
    if isinstance(exc, TooManyItems):
        return EncodeError(f"{message.name}: {exc}")
    return EncodeError(explain(message, values) or f"{message.name}: {exc}")


def unreadable(message: Struct, exc: Exception) -> DecodeError:
    """What hostile bytes led to: anything, but callers get one kind."""
    return DecodeError(f"not a {message.name}: {type(exc).__name__}: {exc}")


def check_size(size: int) -> None:
    """Whether a message may have so many bytes."""
    if size > MAX_BYTES:
        raise ValueError(f"{size} bytes; a message may have {MAX_BYTES}")
