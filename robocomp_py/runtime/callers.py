"""`self.caller`: the instance that made the call, or sent the message, which a handler handles.

Links note the senders of messages only for classes with `reads_caller = True`, so others spend nothing on it.
"""

from __future__ import annotations

import threading
from functools import cached_property
from types import TracebackType
from typing import Any, Protocol

from ..errors import ComponentError
from ..transports.base import Reply
from ..transports.senders import Sender, delivered
from ..wire.codec import Decoder
from .calls import Handler


class _Handling(threading.local):
    sender: Sender | None = None


_handling = _Handling()


class ReadsCaller(Protocol):
    reads_caller: bool


def caller_for(handlers: ReadsCaller) -> str:
    """The sender of the message that this thread handles; "" if it is not known, or if it handles none.

    Raises ComponentError if the class of `handlers` does not read it.
    """
    if not handlers.reads_caller:
        raise ComponentError(f"callers are not noted; write in {type(handlers).__name__}: reads_caller = True")
    sender = _handling.sender
    return sender().rpartition("/")[2] if sender else ""  # transports announce instances with their namespaces


class SignedHandler(Handler):
    """A handler whose method may ask for the caller."""

    @cached_property
    def decode(self) -> Decoder:
        decode = self._codec.decoder(self.operation.request)
        return lambda payload: (delivered(), decode(payload))  # on the thread that delivers the message

    def answer(self, arguments: tuple[Any, ...]) -> Reply:
        sender, plain = arguments
        with _Handled(sender):
            return super().answer(plain)

    def take(self, arguments: tuple[Any, ...]) -> bool:
        sender, plain = arguments
        with _Handled(sender):
            return super().take(plain)


class _Handled:
    """While entered, this thread handles a message of that sender."""

    def __init__(self, sender: Sender | None) -> None:
        self._sender, self._before = sender, _handling.sender

    def __enter__(self) -> None:
        _handling.sender = self._sender

    def __exit__(self, kind: type[BaseException] | None, exc: BaseException | None, at: TracebackType | None) -> None:
        _handling.sender = self._before
