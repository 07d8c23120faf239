"""Dataclasses as JSON and back."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.deploy.asjson import from_json, to_json
from robocomp_py.deploy.hosts.lines import process_of, told
from robocomp_py.deploy.policy import Escalation, Restart, When
from robocomp_py.deploy.process import Member, Process

EVERYTHING = Process(
    "left/laser",
    "Laser",
    ("python3", "-m", "laser"),
    Path("/nets"),
    {"A": "ö"},
    after=("left/base",),
    notifies=False,
    is_program=True,
    members=(Member("left/laser", "Laser"),),
    host="robot",
    restart=Restart(When.ALWAYS, 3, 2.0, 0.5, 4.0),
    grace=2.5,
    ready_after=("map",),
    stops_before=("map",),
    system=("left",),
    files=(Path("/nets/laser.cdsl"),),
)


def test_a_process_comes_back_as_it_was() -> None:
    told_of_it = json.loads(json.dumps(to_json(EVERYTHING)))
    assert from_json(Process, told_of_it) == EVERYTHING
    assert {each.name for each in fields(Process)} == set(told_of_it)


def test_the_example_sets_every_field() -> None:
    least = Process("a", "A", ("a",), Path("/"))
    unset = [each.name for each in fields(Process) if getattr(EVERYTHING, each.name) == getattr(least, each.name)]
    assert unset == []


def test_what_is_missing_has_its_default() -> None:
    least = {"name": "a", "component": "A", "command": ["a"], "cwd": "/"}
    assert from_json(Process, least) == Process("a", "A", ("a",), Path("/"))


@pytest.mark.parametrize(
    ("name", "wrong", "where"),
    [
        ("grace", "soon", "Process.grace"),
        ("grace", True, "Process.grace"),
        ("notifies", 1, "Process.notifies"),
        ("command", "python3", "Process.command"),
        ("env", {"A": 1}, "Process.env.A"),
        ("members", [{"name": "a"}], "Process.members has no `component`"),
        ("restart", {"when": "sometimes"}, "sometimes"),
    ],
)
def test_what_does_not_fit_is_named(name: str, wrong: Any, where: str) -> None:
    with pytest.raises(ValueError, match=where):
        from_json(Process, to_json(EVERYTHING) | {name: wrong})


def test_systems_are_keys() -> None:
    assert to_json({("left", "arm"): Escalation.ONE_FOR_ALL, (): Escalation.ONE_FOR_ONE}) == {
        "left/arm": "one_for_all",
        "": "one_for_one",
    }


def test_an_agent_knows_every_field_but_those_of_the_supervisor() -> None:
    """A new clause of the network needs nothing here to reach another host."""
    there = process_of(json.loads(json.dumps(told(EVERYTHING, EVERYTHING.command, "/home/robot"))))
    lost = {each.name for each in fields(Process) if getattr(there, each.name) != getattr(EVERYTHING, each.name)}
    assert lost == {"cwd", "after", "restart", "ready_after", "stops_before", "files", "is_program"}
