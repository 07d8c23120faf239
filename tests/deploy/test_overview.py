"""A plan as people see it, and what is different between two of them."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.changes import Change, Kind, changes
from robocomp_py.deploy.overview import difference, overview
from robocomp_py.deploy.plan import Host, Link, Plan
from robocomp_py.deploy.policy import Escalation, Restart, When
from robocomp_py.deploy.process import Member, Process
from robocomp_py.deploy.table import text
from robocomp_py.transports.ice.places import icestorm
from robocomp_py.transports.network import Helper
from robocomp_py.transports.zenoh.deployment import router

from .test_asjson import EVERYTHING


def process(name: str, **more: Any) -> Process:
    given: dict[str, Any] = {"component": name, "command": ("run", name, "--set", "params.x=1"), "cwd": Path("/")}
    return Process(name=name, **given | more)


PLAN = Plan(
    "Patrol",
    "auto",
    (
        process("laser", host="onboard", restart=Restart(When.ON_FAILURE, 5, 60.0)),
        process("body", members=(Member("arm", "limb"), Member("leg", "limb")), after=("laser",)),
        process("brain", after=("body",), command=("run", "--set", 'transports.zeromq.bind="tcp://192.168.1.2:7501"')),
    ),
    (Link("Laser", "laser", "brain", Verb.REQUIRES),),
    ways=(Way("brain", "Laser", "laser", Verb.REQUIRES, "RoboCompLaser.Laser", "get", "zeromq", "two hosts"),),
    hosts=(Host("onboard", "192.168.1.10", "robot", 2222, "/home/robot"),),
    escalations={(): Escalation.REST_FOR_ONE},
)


def lines(plan: Plan) -> list[str]:
    return [text(line) for line in overview(plan)]


def test_a_plan_lists_hosts_start_order_and_links() -> None:
    assert lines(PLAN) == [
        "Patrol: 4 components in 3 processes over zeromq; escalation rest_for_one; security local",
        "host onboard: robot@192.168.1.10:2222, python3, in /home/robot",
        "",
        "order  instance  component  process  host     starts after  restart                address                    "
        "    uses",
        "1      laser     laser               onboard                on_failure, 5 in 60 s",
        "2      arm       limb       body     here     laser",
        "2      leg       limb       body     here     laser",
        "3      brain     brain               here     body                                 zeromq "
        "tcp://192.168.1.2:7501  Laser of laser over zeromq",
    ]


def test_a_plan_says_which_icestorm_its_topics_need() -> None:
    proxy = "IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9999"
    plan = Plan("One", "ice", (process("arm"),), (), helpers=(icestorm(proxy),))
    assert lines(plan)[1:3] == [f"IceStorm: {proxy}, run with the network if that is here and none answers there", ""]


def test_a_plan_says_where_its_helpers_run_and_listen() -> None:
    listening = {"router": {"listen/endpoints": ["tcp/192.168.1.10:25800"]}}
    helpers = router("onboard", listening, "192.168.1.10"), Helper("unknown", "", {"port": 1}, "an-other", "Other")
    plan = Plan("One", "zenoh", (process("arm"),), (), helpers=helpers)
    assert lines(plan)[1:3] == ["Zenoh: helper on `onboard`, tcp/192.168.1.10:25800", "Other: helper on this machine"]


def test_columns_in_which_nothing_stands_are_left_out() -> None:
    assert lines(Plan("One", "auto", (process("arm", component="limb"),), ())) == [
        "One: 1 component; security local",
        "",
        "order  instance  component",
        "1      arm       limb",
    ]


def test_an_overview_shows_every_field_of_a_process_but_these() -> None:
    """A field of a new clause has its column, or is added here."""
    least = Process("a", "A", ("a",), Path("/"))
    hosts = (Host("robot", "192.168.1.10"), Host("", "192.168.1.11"))

    def without(field: str) -> Plan:
        return Plan(
            "One", "auto", (dataclasses.replace(EVERYTHING, **{field: getattr(least, field)}),), (), hosts=hosts
        )

    whole = lines(Plan("One", "auto", (EVERYTHING,), (), hosts=hosts))
    hidden = {each.name for each in dataclasses.fields(Process) if lines(without(each.name)) == whole}
    internal = {"command", "cwd", "env", "files", "is_program", "notifies", "stops_before", "system", "grace"}
    assert hidden == internal | {"component"}, "a process with members shows their names"


def differing(before: Plan, after: Plan) -> list[Change]:
    return changes(*(json.loads(json.dumps(each.to_json())) for each in (before, after)))


def with_process(name: str, **changed: Any) -> Plan:
    return dataclasses.replace(
        PLAN,
        processes=tuple(dataclasses.replace(each, **changed) if each.name == name else each for each in PLAN.processes),
    )


def test_the_same_plan_is_not_different() -> None:
    assert differing(PLAN, PLAN) == []
    assert difference([]) == []


def test_what_is_new_and_what_is_gone_is_said() -> None:
    other = dataclasses.replace(PLAN, processes=(*PLAN.processes[:2], process("head")))
    assert differing(PLAN, other) == [
        Change(Kind.REMOVED, "brain", removed=("brain",)),
        Change(Kind.ADDED, "head", added=("head",)),
    ]


def test_of_a_command_only_what_differs_is_said() -> None:
    other = with_process("laser", command=("run", "laser", "--set", "params.x=2", "--set", "params.y=1"))
    assert differing(PLAN, other) == [
        Change(Kind.CHANGED, "laser", "command", ("--set params.x=1",), ("--set params.x=2", "--set params.y=1"))
    ]


def test_another_host_or_restart_or_order_is_a_change() -> None:
    assert differing(PLAN, with_process("laser", host="")) == [Change(Kind.CHANGED, "laser", "host", ("onboard",))]
    [change] = differing(PLAN, with_process("laser", restart=Restart(When.ALWAYS, 5, 60.0)))
    assert (change.of, change.removed, change.added) == ("restart", ("when=on_failure",), ("when=always",))
    [change] = differing(PLAN, with_process("brain", after=("laser",)))
    assert (change.of, change.removed, change.added) == ("after", ("body",), ("laser",))
    [change] = differing(PLAN, with_process("brain", grace=3.0, env={}))
    assert (change.of, change.added) == ("grace", ("3.0",))
    [change] = differing(PLAN, with_process("brain", notifies=False))
    assert (change.of, change.removed, change.added) == ("notifies", ("yes",), ("no",))


def test_what_holds_for_the_whole_network_is_a_change_of_it() -> None:
    other = dataclasses.replace(PLAN, hosts=(Host("onboard", "192.168.1.11"),), escalations={})
    assert [(each.what, each.of) for each in differing(PLAN, other)] == [("", "hosts"), ("", "escalation")]


def test_a_plan_of_another_version_can_be_compared() -> None:
    assert [each.what for each in changes({}, json.loads(json.dumps(PLAN.to_json())))][-3:] == [
        "laser",
        "body",
        "brain",
    ]


def test_differences_look_like_those_of_texts() -> None:
    said = difference(
        [
            Change(Kind.ADDED, "head", added=("skull",)),
            Change(Kind.REMOVED, "leg", removed=("limb",)),
            Change(Kind.CHANGED, "arm", "command", ("--set x=1",), ("--set x=2",)),
            Change(Kind.CHANGED, "", "security", ("local",), ("lan",)),
        ]
    )
    assert [text(line) for line in said] == [
        "+ head: skull", "- leg: limb", "~ arm: command", "    - --set x=1", "    + --set x=2",
        "~ the network: security", "    - local", "    + lan",
    ]  # fmt: skip
    assert [line[0][1] for line in said] == ["green", "red", "yellow", "red", "green", "yellow", "red", "green"]
