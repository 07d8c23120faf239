"""Every clause of DDSL reaches the plan of a network: a row in the table of clauses is enough for that."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.dsl.ddsl.clauses import CLAUSES, Block, ClauseType

from .planned import plan

INSTEAD = {
    "existing": ('existing "sleep 60";', ""),
    "path": ('path "driver/program.sh";', ""),
    "config": ('config "driver/other.toml";', ""),
    "notifies": ('existing "sleep 60"; notifies;', 'existing "sleep 60";'),
    "ip": ("ip 10.0.0.2;", ""),
    "wiring": ("requires Laser from lidar;", "requires Laser from spare;"),
    "allow": ("allow Laser/getLaserData;", ""),
    "address": ('address "10.0.0.5";', ""),
}
"""Clauses that need another one or a file, and what is there without them."""
ELSEWHERE = {
    "offers": "needs a component whose interfaces are marked with `each`: test_offers.py",
    "qos": "the component reads its own; what cannot work is told by the planner: test_qos.py",
}


def within(block: Block) -> list[Any]:
    """The clauses of a block, for tests."""
    return [pytest.param(each, id=each.name) for each in CLAUSES if block in each.where and each.name not in ELSEWHERE]


def planned(folder: Path, body: str) -> dict[str, Any]:
    found, diagnostics = plan(folder, body)
    assert found is not None, [each.message for each in diagnostics]
    return found.to_json()


@cache
def plan_of_instances(folder: Path) -> dict[str, Any]:
    """Each clause in a component of its own, beside one without it."""
    program = folder / "driver" / "program.sh"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    (folder / "driver" / "other.toml").write_text("")
    pairs = []
    for each in CLAUSES:
        if Block.INSTANCE in each.where and each.name not in ELSEWHERE:
            kind, wired = ("driver", "subscribesTo LaserPub from lidar;") if each.name == "wiring" else ("sensor", "")
            for name, clause in zip(("with", "less"), INSTEAD.get(each.name, (each.example, "")), strict=True):
                pairs.append(f"Component {name}_{each.name} : {kind} {{ {wired} {clause} }};")
    found = 'host onboard { address "10.0.0.2"; }; Component lidar : sensor { }; Component spare : sensor { };'
    return planned(folder, f"{found} {' '.join(pairs)}")


@pytest.mark.parametrize("clause", within(Block.INSTANCE))
def test_every_clause_of_an_instance_reaches_the_plan(folder: Path, clause: ClauseType) -> None:
    found = plan_of_instances(folder)

    def told(name: str) -> str:
        processes = [each for each in found["processes"] if name in each["instances"]]
        links = [each for each in found["links"] if each["client"] == name]
        allowed = [each for each in found["allow"] if each["instance"] == name]
        return json.dumps([processes, links, allowed]).replace("with_", "less_")

    assert told(f"with_{clause.name}") != told(f"less_{clause.name}")


@cache
def plan_of_hosts(folder: Path) -> dict[str, Any]:
    hosts = []
    for number, each in enumerate(each for each in CLAUSES if Block.HOST in each.where):
        at = "" if each.name == "address" else f'address "10.0.0.{10 + number}";'
        clause, _ = INSTEAD.get(each.name, (each.example, ""))
        hosts.append(f"host at_{each.name} {{ {at} {clause} }};")
        hosts.append(f"Component c_{each.name} : sensor {{ host at_{each.name}; }};")
    plain = 'host plain { address "10.0.0.2"; }; Component plain : sensor { host plain; };'
    return planned(folder, " ".join((plain, *hosts)))


@pytest.mark.parametrize("clause", within(Block.HOST))
def test_every_clause_of_a_host_reaches_the_plan(folder: Path, clause: ClauseType) -> None:
    hosts = {each["name"]: each for each in plan_of_hosts(folder)["hosts"]}
    different = {key for key, value in hosts[f"at_{clause.name}"].items() if value != hosts["plain"][key]}
    assert different - {"name", "address"} or clause.name == "address"


@pytest.mark.parametrize("clause", within(Block.NETWORK))
def test_every_clause_of_a_network_reaches_the_plan(folder: Path, clause: ClauseType) -> None:
    assert told(folder, clause.example, "") != told(folder, "", "")


@pytest.mark.parametrize("clause", within(Block.SYSTEM))
def test_every_clause_of_a_system_reaches_the_plan(folder: Path, clause: ClauseType) -> None:
    assert told(folder, "", clause.example) != told(folder, "", "")


@cache
def told(folder: Path, network: str, system: str) -> str:
    onboard = 'host onboard { address "10.0.0.2"; };' if "onboard" in system else ""
    restarted = "" if "restart" in system else "restart always;"  # without which an escalation is a mistake
    inside = f"System left {{ {system} Component lidar : sensor {{ {restarted} }}; }};"
    return json.dumps(planned(folder, f"{onboard} {network} Component lidar : sensor {{ }}; {inside}"))
