"""Of two networks whose names give them the same ports, the second one is told."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.neighbours import warnings
from robocomp_py.deploy.place import Place
from robocomp_py.deploy.plan import Host, Plan
from robocomp_py.deploy.process import Process
from robocomp_py.deploy.wiring import block_of

SAME = "Patrol", "Net"


def network(name: str, host: str = "robot") -> Plan:
    processes = tuple(
        Process(each, "Laser", ("laser",), Path("/"), host=where) for each, where in (("laser", host), ("wander", ""))
    )
    way = Way("wander", "laser", "laser", Verb.REQUIRES, "Laser", "getLaserData", "zeromq", "")
    return Plan(name, "zeromq", processes, (), ways=(way,), hosts=(Host("robot", "10.0.0.2"),))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tmp_path.chmod(0o700)
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path))


@pytest.fixture
def running() -> Iterator[Place]:
    """The first of the two."""
    place = Place(SAME[0])
    place.take()
    place.plan.write_text(json.dumps(network(SAME[0]).to_json()))
    yield place
    place.release()


def test_a_network_that_has_the_same_ports_and_runs_is_named(running: Place):
    assert block_of(SAME[0]) == block_of(SAME[1])
    (told,) = warnings(network(SAME[1]))
    assert told.startswith("Patrol runs here, and its name gives it the same ports between hosts as Net: ")


@pytest.mark.parametrize("plan", [network("Other"), network(SAME[0]), network(SAME[1], "")])
def test_other_ports_itself_and_what_stays_on_one_host_are_no_trouble(running: Place, plan: Plan):
    assert warnings(plan) == []


def test_what_has_ended_or_is_not_understood_is_no_trouble(running: Place):
    running.plan.write_text("{}")
    assert warnings(network(SAME[1])) == []
    running.release()
    assert warnings(network(SAME[1])) == []
