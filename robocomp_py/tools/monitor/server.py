"""Serves the page of a monitor to browsers of this machine.

The server listens on loopback, and answers nothing but 403 to what does not come from its own page: to another `Host`
(a page elsewhere whose name leads here), another `Origin`, or without the token of its URL. It only tells, unless it
is given a `control`: then its page may restart, stop and start processes. The numbers of connections and of readers are
bounded, and each wait has a deadline. The page makes no request to anywhere else.
"""

from __future__ import annotations

import contextlib
import hmac
import json
import logging
import math
import re
import secrets
import socket
import sys
import threading
import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

from ...errors import RobocompError

READERS = 16
"""Maximum number of pages that are told what happens."""

_CONNECTIONS = 2 * READERS
"""Maximum number of connections at the same time."""

_REQUEST_S = 5.0
"""Seconds in which a request must have come."""

_WRITE_S = 5.0
"""Seconds in which a reader must take what it is told."""

_QUIET_S = 2.0
"""Seconds after which a reader is told something, so that one that is gone is noticed."""

_LONGEST = 2000
"""Maximum number of octets of what the page asks for."""

_READ = 64 * 1024
"""Octets of a longer one that are read all the same: a connection with unread input is reset, and its answer lost."""

_LOOPBACK = "127.0.0.1"

Control = Callable[[str, str], None]
"""Does `restart`, `stop` or `start` to a process. Raises RobocompError, with a sentence for people."""

DEEDS = "restart", "stop", "start"

log = logging.getLogger("robocomp.monitor")


@dataclass(frozen=True)
class Shown:
    """What the page shows: a picture, what changes in it, and what went wrong."""

    number: int = 0
    picture_number: int = 0
    """Changes with the picture."""
    picture: str = ""
    """SVG."""
    look: Mapping[str, Any] = field(default_factory=dict)
    event: bytes = b""
    """The look as all readers get it."""


class Board:
    """What all readers see. Safe to use from any thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._shown, self._readers, self._closed = Shown(), 0, False

    def show(self, look: Mapping[str, Any], picture: str | None = None) -> None:
        """Tell all readers; without a picture, the last one stays."""
        event = _event("look", look)
        with self._changed:
            before = self._shown
            new = picture is not None and picture != before.picture
            self._shown = Shown(
                before.number + 1,
                before.picture_number + new,
                before.picture if picture is None else picture,
                look,
                event,
            )
            self._changed.notify_all()

    def newer(self, number: int, timeout_s: float) -> Shown | None:
        """Wait for what is shown after that number. None after `timeout_s` seconds, and once the board is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._shown.number > number, timeout_s)
            return self._shown if self._shown.number > number and not self._closed else None

    def wait_reader(self, timeout_s: float) -> bool:
        """Whether anything reads it, or does within this time."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._readers > 0, timeout_s)
            return self._readers > 0

    @property
    def is_closed(self) -> bool:
        with self._changed:
            return self._closed

    def enter(self) -> bool:
        """Become a reader, if there is room for one more."""
        with self._changed:
            if self._readers >= READERS or self._closed:
                return False
            self._readers += 1
            self._changed.notify_all()
            return True

    def leave(self) -> None:
        with self._changed:
            self._readers -= 1

    def rest(self, seconds: float) -> None:
        """Wait, but not if it is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed, max(0.0, seconds))

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class Server:
    """Serves a board until it is closed. Raises OSError if the port is taken."""

    def __init__(self, board: Board, port: int = 0, control: Control | None = None) -> None:
        """With port 0, the system chooses one. Without `control`, nothing can be changed from the page."""
        self._board = board
        self._token = secrets.token_urlsafe(16)
        self._http = _Http(board, self._token, port, control)
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.2,), name="monitor", daemon=False)

    @property
    def port(self) -> int:
        return int(self._http.server_address[1])

    @property
    def url(self) -> str:
        """The address of the page, with the token."""
        return f"http://{_LOOPBACK}:{self.port}/?token={self._token}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop and wait; all connections are closed."""
        self._board.close()
        self._http.shutdown()
        self._thread.join()
        self._http.end_connections()
        self._http.server_close()  # waits for the threads


class _Http(ThreadingHTTPServer):
    daemon_threads = False
    block_on_close = True
    allow_reuse_address = True
    request_queue_size = _CONNECTIONS

    def __init__(self, board: Board, token: str, port: int, control: Control | None) -> None:
        self.board, self.token, self.control = board, token, control
        self._lock = threading.Lock()
        self._open: dict[socket.socket, float] = {}
        """All connections, each with the time by which its request must have come."""
        super().__init__((_LOOPBACK, port), _Handler)
        self.hosts = tuple(f"{name}:{self.server_address[1]}" for name in (_LOOPBACK, "localhost"))

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            crowded = len(self._open) >= _CONNECTIONS
            if not crowded:
                self._open[request] = time.monotonic() + _REQUEST_S
        if not crowded:
            super().process_request(request, client_address)
            return
        with contextlib.suppress(OSError):
            request.settimeout(0.0)  # never waits here: it is the thread that accepts
            request.send(b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n")
        self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def has_come(self, request: Any) -> None:
        """A request has been read, so its connection may stay open."""
        with self._lock:
            self._open[request] = math.inf

    def service_actions(self) -> None:
        """Called a few times a second: ends connections whose requests do not come."""
        now = time.monotonic()
        with self._lock:
            for each, due in self._open.items():
                if due < now:
                    with contextlib.suppress(OSError):
                        each.shutdown(socket.SHUT_RDWR)

    def end_connections(self) -> None:
        with self._lock:
            for each in self._open:
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):  # the client has gone
            log.exception("a request failed")


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "robocomp", ""
    timeout = _REQUEST_S
    server: _Http

    def do_GET(self) -> None:
        self.server.has_come(self.connection)
        self.close_connection = True
        self.connection.settimeout(_WRITE_S)
        url = urlsplit(self.path)
        with contextlib.suppress(ConnectionError, TimeoutError):  # the browser has gone, or takes nothing
            if why := self._refused(parse_qs(url.query)):
                self._answer(HTTPStatus.FORBIDDEN, why)
            elif url.path == "/":
                self._page()
            elif url.path == "/events":
                self._events()
            else:
                self._answer(HTTPStatus.NOT_FOUND, "there is nothing but / and /events")

    def do_POST(self) -> None:
        self.server.has_come(self.connection)
        self.close_connection = True
        self.connection.settimeout(_WRITE_S)
        url = urlsplit(self.path)
        length = self.headers.get("Content-Length", "")
        size = int(length) if length.isascii() and length.isdecimal() and len(length) < 10 else 0
        with contextlib.suppress(ConnectionError, TimeoutError):
            body = self.rfile.read(min(size, _READ))
            if self.server.control is None:
                self._answer(HTTPStatus.NOT_IMPLEMENTED, "nothing can be changed: start rc monitor --allow-control")
            elif why := self._refused(parse_qs(url.query)):
                self._answer(HTTPStatus.FORBIDDEN, why)
            elif url.path != "/control":
                self._answer(HTTPStatus.NOT_FOUND, "there is nothing but /control")
            else:
                self._control(self.server.control, body)

    def _control(self, control: Control, body: bytes) -> None:
        if len(body) > _LONGEST or self.headers.get("Content-Type") != "application/json":
            self._answer(HTTPStatus.BAD_REQUEST, f"a request is JSON of at most {_LONGEST} octets")
            return
        try:
            match json.loads(body):
                case {"do": str(do), "process": str(process)} if do in DEEDS:
                    control(do, process)
                    self._answer(HTTPStatus.OK, "")
                case _:
                    self._answer(HTTPStatus.BAD_REQUEST, f"`do` is one of {', '.join(DEEDS)}, `process` a name")
        except (ValueError, RecursionError):
            self._answer(HTTPStatus.BAD_REQUEST, "a request is JSON")
        except RobocompError as exc:
            self._answer(HTTPStatus.CONFLICT, str(exc))

    def _refused(self, query: Mapping[str, list[str]]) -> str:
        """Why this request is not answered; "" if it is."""
        own = [f"http://{host}" for host in self.server.hosts]
        hosts, origins = self.headers.get_all("Host", []), self.headers.get_all("Origin", [])
        if len(hosts) != 1 or hosts[0] not in self.server.hosts:
            return "this Host is not the one of the monitor"
        if any(each not in own for each in origins):
            return "this Origin is not the page of the monitor"
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return "this request comes from another page"
        if not hmac.compare_digest(query.get("token", [""])[0].encode(), self.server.token.encode()):
            return "the token is missing or wrong: open the URL that rc monitor prints"
        return ""

    def _page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        page = (files(__package__) / "page.html").read_text(encoding="utf-8").replace("{{nonce}}", nonce)
        page = page.replace("{{control}}", "true" if self.server.control else "false")
        rules = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; connect-src 'self'; "
            "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        self._answer(HTTPStatus.OK, page, "text/html", {"Content-Security-Policy": rules})

    def _events(self) -> None:
        board = self.server.board
        if not board.enter():
            self._answer(HTTPStatus.SERVICE_UNAVAILABLE, f"there are {READERS} readers already; close one of them")
            return
        try:
            self.send_response(HTTPStatus.OK)
            packs = "gzip" in re.split(r"[\s,;]+", self.headers.get("Accept-Encoding", ""))
            self._headers({"Content-Type": "text/event-stream", **({"Content-Encoding": "gzip"} if packs else {})})
            self._tell(_packed() if packs else bytes)
        finally:
            board.leave()

    def _tell(self, pack: Callable[[bytes], bytes]) -> None:
        board = self.server.board
        shown = Shown()
        self.wfile.write(pack(b"retry: 1000\n\n"))
        while not board.is_closed:
            newer = board.newer(shown.number, _QUIET_S)
            if newer is None:
                self.wfile.write(pack(b": still here\n\n"))
                continue
            if newer.picture_number != shown.picture_number:
                self.wfile.write(pack(_event("picture", newer.picture)))
            self.wfile.write(pack(newer.event))
            shown = newer

    def _answer(
        self, status: HTTPStatus, text: str, kind: str = "text/plain", more: Mapping[str, str] | None = None
    ) -> None:
        content = text.encode()
        self.send_response(status)
        self._headers({"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(content)), **(more or {})})
        self.wfile.write(content)

    def _headers(self, more: Mapping[str, str]) -> None:
        fixed = {
            "Cache-Control": "no-store",
            "Connection": "close",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        for name, value in {**fixed, **more}.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:
        """Not on the terminal, which has the URL."""
        log.debug(format, *arguments)


def _packed() -> Callable[[bytes], bytes]:
    """What compresses the pieces of a stream, each so that it can be read at once."""
    packer = zlib.compressobj(_FAST, zlib.DEFLATED, zlib.MAX_WBITS | _GZIP)
    return lambda piece: packer.compress(piece) + packer.flush(zlib.Z_SYNC_FLUSH)


_FAST, _GZIP = 1, 16
"""The level of compression, and what makes zlib write gzip."""


def _event(name: str, value: Any) -> bytes:
    return f"event: {name}\ndata: {json.dumps(value)}\n\n".encode()
