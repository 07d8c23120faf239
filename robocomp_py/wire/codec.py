"""What a codec is.

For each message type, a codec compiles one function that encodes and one that decodes; at run time
no code inspects types. A message's Python form is the tuple of its fields. A payload is a snapshot
unless asked otherwise: later changes to the encoded values do not affect it.

Messages are structs like others. A codec whose format has its own form of an operation's results or of
an exception knows them by their classes, `Response` and `Thrown`; the values are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from ..contract.types import Struct
from ..errors import DecodeError, EncodeError
from .items import TooManyItems

Payload = Any
"""An encoded message: buffers on every wire, the value itself in-process."""

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

        Without `snapshot`, a payload may share memory with large arrays among the values; it must be sent
        before they change.
        """
        ...

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        """A function from a payload to the message's fields. Any failure raises DecodeError.

        With `prefix`, whatever follows the last field is ignored.
        """
        ...


# Encoders and decoders catch everything themselves, and raise one of these: a function around them would cost more
# than what it guards.


def refused(message: Struct, values: Any, exc: Exception) -> EncodeError:
    """An error that names the wrong field; found by checking all fields again, slowly."""
    if isinstance(exc, TooManyItems):
        return EncodeError(f"{message.title}: {exc}")
    from .explain import explain  # it needs numpy, which tools do without

    return EncodeError(explain(message, values) or f"{message.title}: {exc}")


def unreadable(message: Struct, exc: Exception) -> DecodeError:
    """A DecodeError for any exception that received bytes caused."""
    return DecodeError(f"not a {message.name}: {type(exc).__name__}: {exc}")


def check_size(size: int) -> None:
    """Raise ValueError if a message has too many bytes."""
    if size > MAX_BYTES:
        raise ValueError(f"{size} bytes; a message may have {MAX_BYTES}")
