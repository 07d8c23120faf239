"""Tools find programs with Ice alone that a running network describes, and call them."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py import connect
from robocomp_py.cli import rc, rcgen
from robocomp_py.deploy.client import Connection
from robocomp_py.errors import Timeout
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.announced import channels, told_in_files
from robocomp_py.tools.recording.reader import Recording

from ...cli.programs import running
from ...transports.ice.icestorm import icestorm

pytestmark = pytest.mark.tool

HERE = Path(__file__).parent
NETWORK = """
import "workshop.cdsl";

Deployment yard
{{
    namespace depot;
    Component mill : workshop
    {{
        existing "{program} stay 'tcp -h 127.0.0.1 -p {port}'";
        restart always(delay 3600, max_delay 3600);
        middleware ice;
        port {port};
    }};
}};
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a program with Ice alone needs, and its CDSL; nothing is generated for it."""
    folder = tmp_path_factory.mktemp("described")
    for name in ("Workshop.idsl", "workshop.cdsl", "tools.py"):
        shutil.copy(HERE / name, folder)
    idsl = folder / "Workshop.idsl"
    idsl.write_text(idsl.read_text().replace("[command] void tidy", "[command] [confirm] void tidy"))
    assert rcgen.main([str(idsl), "--to", "slice", "-o", str(folder)]) == 0
    subprocess.run(["slice2py", "--output-dir", str(folder), str(folder / "Workshop.ice")], check=True)
    return folder


@pytest.fixture
def yard(folder: Path, free_port: int, own_runtime_folder: Path) -> Iterator[None]:
    """The network, which runs."""
    network = folder / "yard.ddsl"
    program = f"{sys.executable} -I {folder / 'tools.py'}"
    network.write_text(NETWORK.format(program=program, port=free_port))
    with running("rcdeploy", network) as deployer:
        wait_until(lambda: listed() or deployer.poll() is not None)
        try:
            yield
        finally:
            deployer.send_signal(signal.SIGTERM)


def said_quietly(*arguments: str) -> str:
    """What a command prints, however it ends."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()):
        rc.main(list(arguments))
    return out.getvalue()


def listed() -> list[dict[str, Any]]:
    return [json.loads(line) for line in said_quietly("list", "--json").splitlines()]


def called(capsys: pytest.CaptureFixture[str], name: str, *words: str, code: int = 0) -> Any:
    """What `rc call` prints: JSON, or a message."""
    capsys.readouterr()
    patience = ("--timeout", f"{SOON:g}", "--deadline", f"{SOON:g}")
    assert rc.main(["call", name, *words, *patience]) == code, capsys.readouterr()
    out, err = capsys.readouterr()
    return json.loads(out) if out else err


@pytest.mark.usefixtures("yard")
def test_a_program_of_a_running_network_is_listed_and_called_as_if_it_announced_itself(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Connection("yard") as connection:
        [process] = connection.status().processes
    [found] = listed()
    assert found == {
        "owner": "depot/mill",
        "pid": process.pid,
        "host": "",
        "middlewares": ["ice"],
        "offers": ["Workshop"],
        "uses": [],
    }
    assert "int32 divide(int32 dividend, int32 divisor, out int32 rest) throws Trouble;" in said_quietly(
        "info", "mill/Workshop/divide"
    )
    assert "depot/mill/Workshop/divide" in channels(told_in_files(), ("serves",))  # what a shell completes
    assert called(capsys, "mill/Workshop/divide", "dividend=17", "divisor=5") == {"ret": 3, "rest": 2}
    assert called(capsys, "tools", "least=good")["weights"] == [1.5]  # Ice refuses it if it is not sent as idempotent
    assert "stops or moves something; confirm it" in called(capsys, "tidy", "shelf=3", code=2)
    called(capsys, "tidy", "shelf=3", "--yes")
    wait_until(lambda: called(capsys, "tidied") == 1)
    with connect("yard") as net:
        assert net.depot.mill.Workshop.divide(17, 5).rest == 2


@pytest.mark.usefixtures("yard")
def test_its_declared_exceptions_are_shown_with_all_their_fields(capsys: pytest.CaptureFixture[str]) -> None:
    divided = called(capsys, "mill/Workshop/divide", "dividend=1", "divisor=0", code=1)
    assert divided == 'rc call: RoboCompWorkshop.Trouble: {"what": "division by zero"}\n'
    saw = {"name": "saw", "quality": "bad", "weight": 0.5}
    borrowed = called(capsys, "borrow", json.dumps({"tool": saw}), code=1)
    fields = {"what": "not there", "tool": saw, "shelf": 7}
    assert borrowed == f"rc call: RoboCompWorkshop.Missing: {json.dumps(fields)}\n"


@pytest.mark.usefixtures("yard")
def test_a_wrong_name_a_hanging_and_a_killed_program_are_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["call", "mil/Workshop/tidied", "--timeout", "0.01"]) == 1
    assert "did you mean `mill/Workshop/tidied`?" in capsys.readouterr().err
    assert called(capsys, "mill/Workshop/tidied") == 0
    [found] = listed()
    os.kill(found["pid"], signal.SIGSTOP)
    with connect("yard") as net, pytest.raises(Timeout):
        net.depot.mill.Workshop.tidied(deadline=0.2)
    os.kill(found["pid"], signal.SIGKILL)
    wait_until(lambda: not listed())
    assert rc.main(["call", "mill/Workshop/tidied", "--timeout", "0.01"]) == 1
    assert "`mill/Workshop/tidied` is not there" in capsys.readouterr().err


PUBLISHES = """
import "station.cdsl";

Deployment observatory
{{
    namespace depot;
    Component gauge : station
    {{
        existing "{program} publish '{storm}' Readings";
        restart always(delay 3600, max_delay 3600);
        middleware ice;
        config "gauge.config";
    }};
}};
"""


@pytest.fixture
def observatory(folder: Path, own_runtime_folder: Path) -> Iterator[None]:
    """A network with a program that publishes through IceStorm. It runs."""
    for name in ("Readings.idsl", "Readings.ice", "station.cdsl", "rehearse.py"):
        shutil.copy(HERE / name, folder)
    subprocess.run(["slice2py", "--output-dir", str(folder), str(folder / "Readings.ice")], check=True)
    with icestorm() as storm:
        network = folder / "observatory.ddsl"
        (folder / "gauge.config").write_text(f"TopicManager.Proxy = {storm}\n")
        network.write_text(PUBLISHES.format(program=f"{sys.executable} -P {folder / 'rehearse.py'}", storm=storm))
        with running("rcdeploy", network) as deployer:
            wait_until(lambda: listed() or deployer.poll() is not None, SOON * 3)
            try:
                yield
            finally:
                deployer.send_signal(signal.SIGTERM)


@pytest.mark.usefixtures("observatory")
def test_topics_of_a_program_are_listed_heard_measured_and_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [found] = listed()
    assert (found["owner"], found["offers"], found["middlewares"]) == ("depot/gauge", ["Readings"], ["ice"])
    names = [json.loads(line)["channel"] for line in said_quietly("list", "--topics", "--json").splitlines()]
    assert names == ["depot/gauge/Readings/reading", "depot/gauge/Readings/silence"]
    patience = ("--timeout", f"{SOON:g}")
    capsys.readouterr()
    assert rc.main(["echo", "gauge/Readings/reading", "-n", "1", "--json", *patience]) == 0
    shown = capsys.readouterr()
    heard = json.loads(shown.out)["message"]
    assert (heard["what"]["name"], heard["what"]["counts"], shown.err) == ("Mauer", {"doors": 2}, "")
    assert rc.main(["hz", "Readings/reading", "--for", "1", "--json", *patience]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["messages"] > 1
    assert rc.main(["record", "gauge", "-o", str(tmp_path / "run"), "--for", "1", *patience]) == 0
    with Recording(tmp_path / "run") as recording:
        kinds = {each.topic.name for each in recording.messages()}
    assert kinds == set(names)
    with connect("observatory") as net:
        assert net.depot.gauge.Readings.reading.latest(SOON).what.name == "Mauer"
