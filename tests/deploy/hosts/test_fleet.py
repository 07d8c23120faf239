"""What of a network is each host's business."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.hosts import fleet
from robocomp_py.deploy.hosts.fleet import check_ssh, keeping, needs, share_of
from robocomp_py.deploy.plan import Host, Plan
from robocomp_py.deploy.process import Process
from robocomp_py.errors import DeploymentError
from robocomp_py.transports.ice.places import icestorm
from robocomp_py.transports.network import Helper
from robocomp_py.transports.zenoh.deployment import router

ROBOT, BASE = Host("robot", "10.0.0.10"), Host("base", "10.0.0.11")


def plan(middleware: str, *helpers: Helper) -> Plan:
    processes = tuple(
        Process(name, name, ("x",), Path("/"), host=host) for name, host in (("laser", "robot"), ("map", "base"))
    )
    way = Way("map", "laser", "laser", Verb.REQUIRES, "Laser", "getLaserData", middleware, "")
    return Plan("Patrol", "auto", processes, (), ways=(way,), hosts=(ROBOT, BASE), helpers=helpers)


def test_a_host_gets_its_own_processes():
    share = share_of(plan("zeromq"), ROBOT)
    assert [process.name for process in share.processes] == ["laser"]


@pytest.mark.parametrize(
    ("middleware", "modules"),
    [("zeromq", {"numpy", "zmq", "msgpack"}), ("zenoh", {"numpy", "zenoh"}), ("dds", {"numpy", "cyclonedds"})],
)
def test_a_host_needs_what_its_own_components_use(middleware: str, modules: set[str]):
    assert share_of(plan(middleware), ROBOT).needs.keys() == modules


def test_what_is_needed_is_named_with_the_versions_that_we_need():
    assert needs(["zenoh"])["zenoh"].startswith("eclipse-zenoh>=")


def test_an_agent_runs_the_router_of_its_host():
    options = {"connect": "here/Patrol", "router": {"listen/endpoints": ["tcp/10.0.0.10:20000"]}}
    assert share_of(plan("zenoh", router("robot", options)), ROBOT).hosted == (("zenoh", options),)
    assert share_of(plan("zeromq"), ROBOT).hosted == ()


def test_an_agent_runs_icestorm_for_ice_components_at_an_address_that_others_reach():
    abroad, loopback = (f"IceStorm/TopicManager:tcp -h {host} -p 9999" for host in ("10.0.0.10", "127.0.0.1"))
    network = replace(plan("ice"), helpers=(icestorm(abroad), icestorm(loopback, 1, "")))
    assert share_of(network, ROBOT).hosted == (("ice", {"storm": abroad}),)
    assert share_of(replace(plan("zeromq"), helpers=(icestorm(abroad),)), ROBOT).hosted == ()


def test_a_host_gets_the_keys_of_its_own_router_alone(tmp_path: Path):
    helpers = []
    for name in ("robot", "base"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "key.pem").write_text(name)
        helpers.append(replace(router(name, {}), keys=str(folder)))
    share = share_of(plan("zenoh", *helpers), ROBOT)
    assert share.keys == {tmp_path / "robot" / "key.pem": "key.pem"}
    assert share.keys_folder == tmp_path / "robot"


def test_networks_on_this_machine_need_no_ssh(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fleet, "find_spec", lambda name: None)
    with pytest.raises(DeploymentError, match=r"pip install 'robocomp-py\[ssh\]'"):
        check_ssh()
    assert importlib.util.find_spec("asyncssh")  # the rest of the tests has it


def test_the_hosts_that_go_on_alone_are_known(tmp_path: Path):
    (tmp_path / "echo.cdsl").write_text("Component Echo { language python; };")
    net = tmp_path / "net.ddsl"
    net.write_text(
        'import "echo.cdsl"; Deployment Patrol { security open; host robot { address "10.0.0.10"; lost keep; };'
        ' host base { address "10.0.0.11"; }; Component a : Echo { host robot; }; Component b : Echo { host base; }; };'
    )
    found = keeping(net)
    assert found
    assert (found[0], list(found[1])) == ("Patrol", ["robot"])
