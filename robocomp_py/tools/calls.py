"""Calls that components tell of, decoded by the contracts that are announced."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

from ..contract.types import Field, Struct
from ..errors import DecodeError
from ..printable import printable
from ..wire import json, names
from ..wire.cdr import Cdr
from ..wire.codec import Decoder
from . import asking
from .network import Channel, Network


@dataclass(frozen=True, slots=True)
class Seen:
    """One query or command that has ended."""

    time: float
    """When it began, in seconds since 1970, by the clock of its host."""
    caller: str
    """The whole name of the component that called; "" if the server tells of it."""
    channel: str
    """As its side names it; of a client that uses any server, with `*`."""
    middleware: str
    took: float
    """In s."""
    status: str
    """`ok`, or how it failed."""
    error: str
    request: Any
    """As JSON; a text that says why, if it cannot be decoded."""
    response: Any
    """None unless the status is `ok`, and for commands."""

    @property
    def told(self) -> dict[str, Any]:
        """For machines."""
        return asdict(self)


def tellers(network: Network, channels: Iterable[Channel], *, served: bool) -> list[str]:
    """The whole names of the components that call these channels, or that serve them."""
    known = asking.components(network)
    ends = [end for each in channels for end in (each.providers if served else each.users)]
    owners = {end.told.owner.rpartition("/")[2] for end in ends}
    return [name for name in known if name.rpartition("/")[2] in owners]


def seen(channels: Iterable[Channel], message: Any, *, served: bool) -> tuple[Seen | None, int]:
    """A message of `IntrospectionPub.called` as JSON, and the number of calls before it that are not told.

    None if it is a call of another channel, if the other side tells of it, or if it is not a call: another process
    may send anything.
    """
    call = message.get("call") if isinstance(message, Mapping) else None
    if not isinstance(call, Mapping):
        return None, 0
    missing = call.get("dropped")
    dropped = missing if isinstance(missing, int) else 0
    if any(not isinstance(call.get(name), kind) for name, kind in _FIELDS.items()):
        return None, dropped
    channel = next((each for each in channels if names.matches(call["channel"], each.name)), None)
    if channel is None or served == bool(call["caller"]):
        return None, dropped
    operation, is_fine = channel.operation, call["status"] == "ok"
    response = (
        _decoded(operation.response, operation.outputs, call["response"]) if is_fine and call["response"] else None
    )
    found = Seen(
        call["begun"] / 1e9,
        printable(call["caller"]),
        printable(call["channel"]),
        printable(call["middleware"]),
        float(call["took"]),
        printable(call["status"]),
        printable(call["error"]),
        _decoded(operation.request, operation.inputs, call["request"]),
        response["ret"] if isinstance(response, dict) and list(response) == ["ret"] else response or None,
    )
    return found, dropped


_FIELDS: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("caller", "channel", "middleware", "status", "error", "request", "response"), str),
    "begun": int,
    "took": (int, float),
}


def _decoded(message: Struct, fields: tuple[Field, ...], octets: str) -> Any:
    try:
        return json.show_fields(fields, _decoder(message)(base64.b64decode(octets, validate=True)))
    except (DecodeError, binascii.Error) as exc:
        return f"not understood: {exc}"


@lru_cache(maxsize=64)
def _decoder(message: Struct) -> Decoder:
    return Cdr().decoder(message)
