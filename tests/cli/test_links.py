"""`rc links` says what carries the messages of a network, and why."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy.auto import can_be_opened
from robocomp_py.transports.shm import node, room

LASER = 'import "Laser.idsl"; Component laser { Communications { implements Laser; }; language python; };'
DRIVER = 'import "Laser.idsl"; Component driver { Communications { requires Laser; }; language python; };'
NETWORK = """
import "laser/laser.cdsl"; import "driver/driver.cdsl";
Deployment net
{
    Component laser { process body; };
    Component near : driver { process body; };
    Component far : driver { };
    Component own : driver { middleware dds; };
};
"""


@pytest.fixture
def network(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[str]:
    for name, text in (("laser", LASER), ("driver", DRIVER)):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.cdsl").write_text(text)
        assert rcgen([str(tmp_path / name / f"{name}.cdsl")]) == 0
    (tmp_path / "net.ddsl").write_text(NETWORK)
    capsys.readouterr()
    can_be_opened.cache_clear()
    yield str(tmp_path / "net.ddsl")
    can_be_opened.cache_clear()


def test_each_link_is_a_line_with_its_reason(network: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["links", network]) == 0
    _, *lines = (line.split(maxsplit=4) for line in capsys.readouterr().out.splitlines())
    assert [line[:4] for line in lines] == [
        ["near", "Laser", "laser", "inproc"],
        ["far", "Laser", "laser", "shm"],
        ["own", "Laser", "laser", "dds"],
    ]
    assert [line[4].split()[0] for line in lines] == ["one", "one", "named"]


def test_for_machines_each_operation_is_a_line(network: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["links", network, "--json"]) == 0
    ways = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {(way["client"], way["middleware"]) for way in ways if way["operation"] == "getLaserData"} == {
        ("near", "inproc"),
        ("far", "shm"),
        ("own", "dds"),
    }


def test_an_unusable_middleware_is_reported_in_one_line_with_its_replacement(
    network: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(node, "SHARED_MEMORY", str(tmp_path / "nowhere"))
    assert rc(["links", network, "--middleware", "auto(zenoh)"]) == 0
    said = capsys.readouterr()
    assert "zenoh" in said.out
    [note] = said.err.splitlines()
    assert note.startswith("note: shm is not used for ")
    assert f"over zenoh instead: {tmp_path}/nowhere is not there, or cannot be written to" in note


def test_too_little_shared_memory_is_reported_with_a_remedy(
    network: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "CONNECTION", 1 << 60)
    assert rc(["links", network]) == 0
    said = capsys.readouterr()
    assert ["far", "Laser", "laser", "zeromq", "no", "shm:", "1", "connection"] in [
        line.split()[:8] for line in said.out.splitlines()
    ]
    assert "MB of shared memory, and /dev/shm has" in said.err
    assert "--shm-size=2g" in said.err


def test_a_network_that_is_wrong_is_no_table(network: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["links", network, "--middleware", "inproc"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert "error[unfit-middleware]" in said.err
    assert rc(["links", network, "--middleware", "nothing"]) == 2


@pytest.mark.parametrize("main", [lambda *words: rc(["links", *words]), lambda *words: rcdeploy(words)])
def test_a_component_is_no_network(main: Callable[..., int], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main("laser/laser.cdsl")
    assert ended.value.code == 2
    assert (
        "`laser/laser.cdsl` is not a network; give it a file that begins a Deployment (.ddsl)"
        in capsys.readouterr().err
    )
