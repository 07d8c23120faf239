"""`rc monitor` from outside."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from contextlib import closing
from http.client import HTTPConnection
from urllib.parse import urlsplit

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.testing.patience import SOON

from ..leftovers import killed_on_failure

COMMAND = [sys.executable, "-m", "robocomp_py.cli.rc", "monitor", "--middleware", "shm"]


def test_it_prints_the_address_of_a_page_and_ends_with_an_interrupt() -> None:
    with killed_on_failure([*COMMAND, "--json"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        url = urlsplit(json.loads(process.stdout.readline())["url"])
        with closing(HTTPConnection(url.netloc, timeout=SOON)) as connection:
            connection.request("GET", f"{url.path}?{url.query}")
            with connection.getresponse() as page:
                assert page.status == 200
            connection.request("GET", f"/events?{url.query}")
            with connection.getresponse() as stream:
                while not stream.readline().startswith(b"event: look"):
                    pass
                look = json.loads(stream.readline().removeprefix(b"data: "))
        process.send_signal(signal.SIGINT)
        assert process.wait(SOON) == 130
    assert (look["name"], look["troubles"]) == ("what runs here", [])
    assert look["summary"].endswith("no model to compare with")


def test_a_port_that_is_taken_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert rc(["monitor", "--port", str(port)]) == 1
    assert capsys.readouterr().err == f"rc monitor: port {port}: Address already in use; choose another --port\n"


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["nowhere"], 1, "network `nowhere` is not running on this machine; give it a DDSL file"),
        (["nowhere.ddsl"], 1, "nowhere.ddsl cannot be read"),
        (["--allow-control"], 1, "--allow-control is for a network that rcdeploy runs here"),
        (["--middleware", "smoke"], 2, "unknown middleware `smoke`"),
    ],
)
def test_what_cannot_be_watched_is_told_at_once(
    words: list[str], code: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rc(["monitor", *words]) == code
    assert text in capsys.readouterr().err


@pytest.mark.parametrize("port", ["70000", "-1", "x"])
def test_a_port_is_a_number(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        rc(["monitor", f"--port={port}"])
    assert ended.value.code == 2
    assert "is not a port" in capsys.readouterr().err
