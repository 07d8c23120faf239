"""The page in the browser: a server of viser on 127.0.0.1 that lets in only browsers that know its token."""

from __future__ import annotations

import contextlib
import hmac
import http
import io
import secrets
import socket
from collections.abc import Callable
from urllib.parse import parse_qs

from ...closing import Closing
from ...errors import ConfigurationError

try:
    import viser

    from .unsafe import Request, Respond, Response, ServerConnection, serving
except ImportError as exc:
    raise ConfigurationError(f"a scene in the browser needs viser: pip install 'robocomp-py[viewer]' ({exc})") from exc

ADDRESS = "127.0.0.1"


class _Server(viser.ViserServer):
    """A server that does not let its pages be shown by a server elsewhere."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        return None


class Page(Closing):
    """A page, and what is on it: `server`. It is served until `close`."""

    def __init__(self, title: str, port: int = 0) -> None:
        """Serve a page at a port, 0: any free one. Raises OSError if it is taken, and ConfigurationError."""
        self._token = secrets.token_urlsafe(16)
        listener = socket.create_server((ADDRESS, port))
        self.port: int = listener.getsockname()[1]
        with serving(listener, _guard(self.port, self._token)), contextlib.redirect_stdout(io.StringIO()):
            self.server = _Server(ADDRESS, self.port, label=title, verbose=False)
        if listener.fileno() < 0 or self.server.get_port() != self.port:
            self.close()
            raise ConfigurationError(f"viser {viser.__version__} cannot be used: it serves at a port of its own choice")
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)

    def dock(self) -> None:
        """Put the panel beside the scene. A panel that is not docked covers a part of the scene."""
        self.server.gui.main_panel.dock_right()

    @property
    def url(self) -> str:
        return f"http://{ADDRESS}:{self.port}/?token={self._token}"

    def close(self) -> None:
        """Stop, and let the port go. Idempotent."""
        with contextlib.redirect_stdout(io.StringIO()):  # it prints that it has stopped
            self.server.stop()


def _guard(port: int, token: str) -> Callable[[Respond], Respond]:
    """Refuses browsers that do not know the token, and pages from elsewhere in a browser that does.

    A page that is opened with the token in its URL gets a cookie, which its connections bring along.
    """
    host, cookie = f"{ADDRESS}:{port}", f"rc-sim-{port}"

    def knows(request: Request) -> bool:
        told = parse_qs(request.path.partition("?")[2]).get("token", [])
        for each in request.headers.get_all("Cookie"):
            told += [
                value for name, _, value in (part.strip().partition("=") for part in each.split(";")) if name == cookie
            ]
        return any(hmac.compare_digest(each.encode(), token.encode()) for each in told)

    def guard(respond: Respond) -> Respond:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            is_page = not request.headers.get_all("Upgrade")
            origins = [] if is_page else [f"http://{host}"]
            if request.headers.get_all("Host") != [host] or request.headers.get_all("Origin") != origins:
                return connection.respond(http.HTTPStatus.FORBIDDEN, "This address is for its own page only.\n")
            if not knows(request):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "Open the URL that `rc sim` has printed.\n")
            response = respond(connection, request)
            if response is not None:
                response.headers["Set-Cookie"] = f"{cookie}={token}; HttpOnly; SameSite=Strict; Path=/"
            return response

        return answer

    return guard
