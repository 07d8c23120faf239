"""The sender of the message that is being handled, for handlers that ask for it, on every transport.

A channel that is `signed` passes each message as a `From` to the sink or service, which `signing` has wrapped. Other
channels pass plain payloads, so nothing is spent on them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple

from ..wire import names
from ..wire.codec import Payload

Sender = Callable[[], str]
"""Returns the instance that sent a message, with or without its namespace; "" if it is not known. Called when a handler
asks for it."""


class From(NamedTuple):
    """A payload and its sender."""

    sender: Sender
    payload: Payload


class _Delivering(threading.local):
    sender: Sender | None = None  # on the class: a failed attribute lookup takes a microsecond


_delivering = _Delivering()


def delivered() -> Sender | None:
    """The sender of the message that this thread of a transport is delivering; None if that is not known."""
    return _delivering.sender


def signing(deliver: Callable[..., Any]) -> Callable[..., Any]:
    """A sink or a service that takes payloads with their senders, and plain ones as well."""

    @wraps(deliver)
    def run(payload: Payload, *rest: Any) -> Any:
        sender = None
        if type(payload) is From:
            sender, payload = payload
        before = _delivering.sender
        _delivering.sender = sender
        try:
            return deliver(payload, *rest)
        finally:
            _delivering.sender = before

    return run


def publisher(channel: str) -> Sender:
    """The instance that publishes on a channel; unknown if that has `*` for the instance."""

    def sender() -> str:
        found = names.instance(channel)
        return "" if found == names.ANY else found

    return sender
