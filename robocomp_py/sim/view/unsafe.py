"""How a server of viser is made to listen where it is told, and to refuse what it is told. It has no option for either.

what       changes                                     if viser starts its server otherwise
serving    websockets.asyncio.server.serve, for the    the port is another one, which `page` refuses to use
           time in which a server starts
"""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection as ServerConnection
from websockets.http11 import Request as Request
from websockets.http11 import Response as Response

Respond = Callable[[ServerConnection, Request], Response | None]
"""Answers a request; None: it becomes a connection."""

_changing = threading.Lock()


@contextlib.contextmanager
def serving(listener: socket.socket, guard: Callable[[Respond], Respond]) -> Iterator[None]:
    """While entered, a server of viser that starts listens at this socket, and answers what the guard lets through."""
    with _changing:
        original: Any = websockets.asyncio.server.serve

        def serve(handler: Any, host: str, port: int, *, process_request: Respond, **options: Any) -> Any:
            return original(handler, sock=listener, process_request=guard(process_request), **options)

        websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]
