"""`rc sim view` and `rc sim edit` from outside."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.testing.patience import SOON

from ..leftovers import killed_on_failure

SCENE = '<innerModel><plane id="floor" size="4000,10,4000"/></innerModel>'


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "house.xml"
    path.write_text(SCENE)
    return path


@pytest.mark.parametrize("action", ["view", "edit"])
def test_it_prints_the_address_of_a_page_and_ends_with_an_interrupt(scene: Path, action: str) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "sim", action, str(scene)]
    with killed_on_failure(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout
        url = urlsplit(process.stdout.readline().strip())
        with closing(HTTPConnection(url.netloc, timeout=SOON)) as connection:
            connection.request("GET", f"{url.path}?{url.query}")
            with connection.getresponse() as page:
                assert page.status == 200
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=SOON)
        assert process.returncode == 130
    assert said == ("", "")


def test_a_port_that_is_taken_is_told(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert rc(["sim", "view", str(scene), "--port", str(port)]) == 1
    assert capsys.readouterr().err == f"rc sim view: port {port}: Address already in use; choose another --port\n"


def test_a_wrong_scene_is_told_as_lint_tells_it(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_text('<innerModel>\n  <plan id="floor"/>\n</innerModel>')
    assert rc(["lint", str(scene)]) == 1
    linted = capsys.readouterr().err
    assert rc(["sim", "view", str(scene)]) == 1
    said = capsys.readouterr().err
    assert "house.xml:2:3: error[unknown-tag]" in said
    assert linted.startswith(said)
    assert rc(["sim", "edit", str(scene)]) == 1
    assert capsys.readouterr().err == said


def test_a_scene_that_is_not_there_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["sim", "view", str(tmp_path / "hous.xml")]) == 1
    assert "hous.xml" in (said := capsys.readouterr().err)
    assert "cannot be read: No such file or directory" in said


def test_what_is_edited_is_a_file_of_a_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["sim", "edit", "house"]) == 1
    assert capsys.readouterr().err == "rc sim edit: house: give it the file of a scene (.xml)\n"
    assert rc(["sim", "edit", "arm.urdf"]) == 1
    assert capsys.readouterr().err.endswith("(.xml); to make one: rc sim import arm.urdf\n")


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["nowhere"], 1, "network `nowhere` is not running on this machine; start it with rcdeploy, or give the file"),
        (["nowhere.ddsl"], 1, "nowhere.ddsl cannot be read"),
        (["arm.urdf"], 2, "(.xml), or a network; to make one: rc sim import arm.urdf"),
        (["house.dae"], 2, "house.dae: give it the file of a scene (.xml), or a network"),
        (["--middleware", "smoke"], 2, "unknown middleware `smoke`"),
        (["--component", "nothing", "--middleware", "shm"], 1, "unknown component with a scene `nothing`"),
    ],
)
def test_what_cannot_be_shown_is_told(
    words: list[str], code: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rc(["sim", "view", *words]) == code
    assert text in capsys.readouterr().err


def test_without_viser_the_error_names_what_to_install(scene: Path) -> None:
    code = "import sys; sys.modules['viser'] = None; from robocomp_py.cli.rc import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "sim", "view", str(scene)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("rc sim view: a scene in the browser needs viser: pip install 'robocomp-py[viewer]'")
