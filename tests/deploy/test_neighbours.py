"""Of two networks whose names give them the same ports, the second one is told."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.neighbours import warnings
from robocomp_py.deploy.place import Place
from robocomp_py.deploy.plan import Host, Plan
from robocomp_py.deploy.process import Process
from robocomp_py.transports.network import PORTS, block_of, ports_of

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
    assert told.startswith("Patrol also runs here, and its name yields the same ports between hosts as Net: ")


def test_large_networks_may_have_the_same_further_ports(running: Place):
    def large(name: str) -> Plan:
        more = tuple(Process(f"p{number}", "Laser", ("laser",), Path("/")) for number in range(100))
        return replace(network(name), processes=(*network(name).processes, *more))

    (_, further), names = ports_of(SAME[0], PORTS), map("Net{}".format, range(1000))
    other = next(each for each in names if ports_of(each, PORTS)[1] == further and block_of(each) != block_of(SAME[0]))
    assert warnings(large(other)) == []
    running.plan.write_text(json.dumps(large(SAME[0]).to_json()))
    (told,) = warnings(large(other))
    first, *_, last = ports_of(other, PORTS)[1]
    assert f"the same ports between hosts as {other}: {first} to {last}; " in told


@pytest.mark.parametrize("plan", [network("Other"), network(SAME[0]), network(SAME[1], "")])
def test_other_ports_itself_and_what_stays_on_one_host_are_no_trouble(running: Place, plan: Plan):
    assert warnings(plan) == []


def test_what_has_ended_or_is_not_understood_is_no_trouble(running: Place):
    running.plan.write_text("{}")
    assert warnings(network(SAME[1])) == []
    running.release()
    assert warnings(network(SAME[1])) == []
