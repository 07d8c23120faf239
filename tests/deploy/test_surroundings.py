"""What keeps a network from being started on this machine is told before anything starts."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.deploy.place import Place
from robocomp_py.deploy.plan import Overrides, Plan
from robocomp_py.deploy.planner import make_plan
from robocomp_py.deploy.surroundings import hindrances
from robocomp_py.dsl.workspace import Workspace

Said = pytest.CaptureFixture[str]


def network(folder: Path, name: str, said: str = "", instance: str = "sensor") -> Path:
    path = folder / f"{name}.ddsl"
    path.write_text(
        f'import "sensor/sensor.cdsl"; Deployment {name} {{ {said} Component {instance} : sensor {{ }}; }};'
    )
    return path


def planned(path: Path, middleware: str | None = None) -> Plan:
    found = make_plan(path, Workspace(), Overrides(middleware))
    assert found
    return found


@contextmanager
def running(plan: Plan) -> Iterator[None]:
    place = Place(plan.name)
    place.take()
    try:
        place.plan.write_text(json.dumps(plan.to_json()))
        yield
    finally:
        place.plan.unlink()
        place.release()


def test_an_instance_that_runs_in_another_network_is_named(
    folder: Path, own_runtime_folder: Path, capsys: Said
) -> None:
    with running(planned(network(folder, "house"))):
        garden = network(folder, "garden")
        assert rcdeploy([str(garden)]) == 1
        said = capsys.readouterr()
        assert "`sensor` is already running in the network house" in said.err
        assert "rename the instance, write `namespace garden;`" in said.err
        assert "rcdeploy down house" in said.err
        assert "already served" not in said.out + said.err, "nothing was started"
        assert rcdeploy(["plan", str(garden)]) == 0
        assert "it cannot be started as it is: `sensor` is already running" in capsys.readouterr().err


def test_other_names_namespaces_and_middlewares_are_not_in_the_way(folder: Path, own_runtime_folder: Path) -> None:
    with running(planned(network(folder, "house"))):
        assert hindrances(planned(network(folder, "garden", "namespace garden;"))) == []
        assert hindrances(planned(network(folder, "garden", instance="other"))) == []
        assert hindrances(planned(network(folder, "garden"), "dds")) == []
        assert hindrances(planned(network(folder, "house"))) == [], "which is told in other words"
        assert len(hindrances(planned(network(folder, "garden")))) == 1


@pytest.mark.parametrize(("middleware", "fits"), [("zeromq", False), ("dds", True)])
def test_a_runtime_folder_with_too_long_a_path_is_reported_once(
    folder: Path, own_runtime_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said, middleware: str, fits: bool
) -> None:
    deep = own_runtime_folder / ("x" * (80 - len(os.fsencode(own_runtime_folder)) - 1))
    deep.mkdir(mode=0o700)
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(deep))
    told = hindrances(planned(network(folder, "deep"), middleware))
    assert bool(told) is not fits
    if told:
        assert f"run-time folder {deep}: paths of sockets of zeromq in it would have 111 bytes" in told[0]
        assert told[0].endswith("shorter by 4 bytes")
        assert rcdeploy([str(folder / "deep.ddsl"), "--middleware", middleware]) == 1
        assert capsys.readouterr().err.count("run-time folder") == 1
