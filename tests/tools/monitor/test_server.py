"""The server of `rc monitor`: who may read, how many, and what they are told."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, closing
from http.client import HTTPConnection, HTTPResponse
from importlib.resources import files
from typing import Any
from urllib.parse import urlsplit

import pytest

from robocomp_py.errors import DeploymentError
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.monitor import server as module
from robocomp_py.tools.monitor.server import READERS, Board, Server


@pytest.fixture
def board() -> Board:
    return Board()


@pytest.fixture
def server(board: Board) -> Iterator[Server]:
    with Server(board) as made:
        yield made


def asked(server: Server, path: str = "/", token: bool = True, method: str = "GET", **headers: str) -> HTTPResponse:
    """The answer to one request; with the right token, if there is any."""
    query = urlsplit(server.url).query if token else ""
    connection = HTTPConnection("127.0.0.1", server.port, timeout=SOON)
    try:
        given = {name.replace("_", "-"): each for name, each in headers.items()}
        connection.request(method, f"{path}?{query}", headers=given)
        return connection.getresponse()
    except OSError:
        connection.close()
        raise


def told(stream: HTTPResponse) -> tuple[str, Any]:
    """The next event of a stream, with its data."""
    name = ""
    while True:
        line = stream.readline().decode().rstrip("\n")
        assert line or stream.fp, "the stream ended"
        if line.startswith("event: "):
            name = line.removeprefix("event: ")
        elif line.startswith("data: "):
            return name, json.loads(line.removeprefix("data: "))


# Who may read.


def test_the_url_with_its_token_shows_a_page_that_asks_nothing_of_others(server: Server) -> None:
    assert urlsplit(server.url).hostname == "127.0.0.1"
    answer = asked(server)
    page = answer.read().decode()
    assert (answer.status, answer.headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert "<h1" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    rules = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in rules
    nonce = rules.partition("'nonce-")[2].partition("'")[0]
    assert f'<script nonce="{nonce}">' in page


def test_the_page_is_small() -> None:
    assert len((files("robocomp_py.tools.monitor") / "page.html").read_bytes()) < 100_000


@pytest.mark.parametrize("path", ["/", "/events", "/elsewhere"])
def test_without_the_token_nothing_is_told(server: Server, path: str) -> None:
    assert asked(server, path, token=False).status == 403
    connection = HTTPConnection("127.0.0.1", server.port, timeout=SOON)
    connection.request("GET", f"{path}?token=%E2%82%AC")
    assert connection.getresponse().status == 403


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example", ""])
@pytest.mark.parametrize("path", ["/", "/events"])
def test_another_host_is_refused(server: Server, host: str, path: str) -> None:
    assert asked(server, path, Host=host).status == 403


def test_two_hosts_or_none_are_refused(server: Server) -> None:
    query = urlsplit(server.url).query
    own = f"Host: 127.0.0.1:{server.port}\r\n"
    for headers in ("", own + "Host: evil.example\r\n"):
        with socket.create_connection(("127.0.0.1", server.port), SOON) as raw:
            raw.sendall(f"GET /?{query} HTTP/1.1\r\n{headers}\r\n".encode())
            assert b" 403 " in raw.recv(100)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1"])
def test_another_origin_is_refused(server: Server, origin: str) -> None:
    assert asked(server, "/events", Origin=origin).status == 403
    assert asked(server, "/", Sec_Fetch_Site="cross-site").status == 403
    assert asked(server, "/", Sec_Fetch_Site="same-site").status == 403


def test_its_own_origin_and_localhost_are_served(server: Server) -> None:
    own = f"127.0.0.1:{server.port}"
    assert asked(server, Origin=f"http://{own}", Sec_Fetch_Site="same-origin").status == 200
    assert asked(server, Host=f"localhost:{server.port}", Sec_Fetch_Site="none").status == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "HEAD"])
def test_nothing_can_be_changed(server: Server, method: str) -> None:
    assert asked(server, method=method).status == 501


def test_there_is_nothing_else(server: Server) -> None:
    assert asked(server, "/../server.py").status == 404


# What a page may do, if it is allowed.


@pytest.fixture
def done() -> list[tuple[str, str]]:
    return []


@pytest.fixture
def controlled(board: Board, done: list[tuple[str, str]]) -> Iterator[Server]:
    def control(do: str, process: str) -> None:
        if process == "ghost":
            raise DeploymentError("home has no `ghost`")
        done.append((do, process))

    with Server(board, control=control) as made:
        yield made


def posted(
    server: Server, body: object, token: bool = True, path: str = "/control", **headers: str
) -> tuple[int, bytes]:
    """The status and the text of the answer."""
    query = urlsplit(server.url).query if token else "token=no"
    given = {"Content-Type": "application/json"} | {name.replace("_", "-"): each for name, each in headers.items()}
    text = body if isinstance(body, str) else json.dumps(body)
    with closing(HTTPConnection("127.0.0.1", server.port, timeout=SOON)) as connection:
        connection.request("POST", f"{path}?{query}", text, given)
        with connection.getresponse() as answer:
            return answer.status, answer.read()


@pytest.mark.parametrize("do", ["restart", "stop", "start"])
def test_a_process_is_controlled_from_the_page(controlled: Server, done: list[tuple[str, str]], do: str) -> None:
    assert posted(controlled, {"do": do, "process": "laser"})[0] == 200
    assert done == [(do, "laser")]
    assert 'mayControl = "true"' in asked(controlled).read().decode()


def test_without_permission_the_page_offers_nothing(server: Server) -> None:
    assert posted(server, {"do": "stop", "process": "laser"})[0] == 501
    assert 'mayControl = "false"' in asked(server).read().decode()


def test_nothing_is_done_for_another_page(controlled: Server, done: list[tuple[str, str]]) -> None:
    wish = {"do": "stop", "process": "laser"}
    assert posted(controlled, wish, token=False)[0] == 403
    assert posted(controlled, wish, Host="evil.example")[0] == 403
    assert posted(controlled, wish, Origin="http://evil.example")[0] == 403
    assert posted(controlled, wish, Sec_Fetch_Site="cross-site")[0] == 403
    assert posted(controlled, wish, path="/")[0] == 404
    assert done == []


@pytest.mark.parametrize(
    "body", ["", "nonsense", "[" * 1000, "x" * 5000, {"do": "kill", "process": "laser"}, {"do": "stop"}, {"do": 7}]
)
def test_a_wish_that_is_not_understood_is_refused(
    controlled: Server, done: list[tuple[str, str]], body: object
) -> None:
    assert posted(controlled, body)[0] == 400
    assert done == []


def test_a_wish_of_another_kind_is_refused(controlled: Server, done: list[tuple[str, str]]) -> None:
    assert posted(controlled, {"do": "stop", "process": "laser"}, Content_Type="text/plain")[0] == 400
    assert done == []


def test_the_reason_of_a_refusal_is_told(controlled: Server) -> None:
    assert posted(controlled, {"do": "stop", "process": "ghost"}) == (409, b"home has no `ghost`")


# What readers are told.


def test_a_reader_gets_what_is_shown_and_then_each_change(board: Board, server: Server) -> None:
    board.show({"at": 1}, "<svg>one</svg>")
    with closing(asked(server, "/events")) as stream:
        assert stream.headers["Content-Type"] == "text/event-stream"
        assert told(stream) == ("picture", "<svg>one</svg>")
        assert told(stream) == ("look", {"at": 1})
        board.show({"at": 2})
        assert told(stream) == ("look", {"at": 2})
        board.show({"at": 3}, "<svg>two\n\nlines</svg>")
        assert told(stream) == ("picture", "<svg>two\n\nlines</svg>")
        assert told(stream) == ("look", {"at": 3})


def test_a_reader_that_unpacks_gets_each_change_at_once_and_in_fewer_octets(board: Board, server: Server) -> None:
    unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
    with closing(asked(server, "/events", Accept_Encoding="br, gzip;q=1")) as stream:
        assert stream.headers["Content-Encoding"] == "gzip"
        heard, packed = b"", 0
        for number in range(2):
            board.show({"at": number, "components": [{"name": "world", "state": "compute"}] * 1000})
            while not heard.endswith(b"}]}\n\n"):
                piece = stream.read1(1 << 16)
                assert piece, "the stream ended"
                heard, packed = heard + unpacker.decompress(piece), packed + len(piece)
            name, _, data = heard.strip().rpartition(b"data: ")
            assert name.endswith(b"event: look\n")
            assert json.loads(data)["at"] == number
            assert packed < len(heard) / 10
            heard, packed = b"", 0


def test_there_are_at_most_sixteen_readers(board: Board, server: Server) -> None:
    with ExitStack() as streams:
        readers = [streams.enter_context(closing(asked(server, "/events"))) for _ in range(READERS)]
        assert {each.status for each in readers} == {200}
        assert asked(server, "/events").status == 503
        assert asked(server, "/").status == 200
        board.show({"at": 1})
        assert [told(each) for each in readers] == [("look", {"at": 1})] * READERS


def test_a_reader_that_leaves_makes_room(server: Server) -> None:
    for _ in range(READERS):
        asked(server, "/events").close()
    with ExitStack() as streams:

        def is_served() -> bool:
            stream = streams.enter_context(closing(asked(server, "/events")))
            return stream.status == 200

        wait_until(is_served)


def test_a_board_knows_whether_it_is_read(board: Board, server: Server) -> None:
    assert not board.wait_reader(0.0)
    with closing(asked(server, "/events")):
        assert board.wait_reader(SOON)
    wait_until(lambda: not board.wait_reader(0.0))


# Bounds.


def test_connections_that_ask_nothing_are_ended(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_REQUEST_S", 0.3)
    with Server(board) as server, socket.create_connection(("127.0.0.1", server.port), SOON) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\nHost: ")
        assert raw.recv(100) == b""


def test_there_is_a_bound_on_connections_and_the_page_is_served_afterwards(server: Server) -> None:
    with ExitStack() as idle:
        for _ in range(module._CONNECTIONS):
            idle.enter_context(socket.create_connection(("127.0.0.1", server.port), SOON))
        with contextlib.suppress(ConnectionError):  # it may be gone before it has read the answer
            assert asked(server).status == 503
    wait_until(lambda: asked(server).status == 200)


def test_a_reader_that_takes_nothing_is_ended(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_WRITE_S", 0.3)
    with Server(board) as server, closing(asked(server, "/events")):
        assert board.wait_reader(SOON)
        board.show({}, "x" * 50_000_000)
        wait_until(lambda: not board.wait_reader(0.0))


def test_nothing_is_logged_of_a_client_that_goes_before_its_answer(
    board: Board, caplog: pytest.LogCaptureFixture
) -> None:
    at_once = struct.pack("ii", 1, 0)
    with Server(board) as server:
        for request in (b"BREW / HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\nHost"):
            with socket.create_connection(("127.0.0.1", server.port), SOON) as client:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, at_once)
                client.sendall(request)
        assert asked(server).status == 200
    assert not caplog.records


def test_closing_ends_all_connections_and_threads(board: Board) -> None:
    with Server(board) as server:
        stream = asked(server, "/events")
        assert stream.readline() == b"retry: 1000\n"
        idle = socket.create_connection(("127.0.0.1", server.port), SOON)
    with idle, contextlib.suppress(ConnectionResetError):  # if it was still waiting to be accepted
        assert idle.recv(1) == b""
    assert stream.read() in (b"\n", b"\n: still here\n\n")
    stream.close()
    assert not any(each.name.startswith("monitor") for each in threading.enumerate())
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", server.port), SOON)


def test_a_port_that_is_taken_is_an_error(server: Server) -> None:
    with pytest.raises(OSError, match="in use"):
        Server(Board(), server.port)
