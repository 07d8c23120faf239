"""What leaves this machine is what the security of the network allows, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.deploy.plan import Security
from robocomp_py.deploy.security import Opening, faults, secured, warning, why_not
from robocomp_py.transports.deployment import is_loopback

from .security_network import network, way


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:5555", "tcp://localhost:1", "tcp://[::1]:5555", "tls/127.0.0.1:7447", "tcp/127.9.9.9:7447",
     "here/Patrol", "unixsock-stream//run/x.sock", "tcp://127.0.0.1:*", "tcp/127.0.0.1:1?a=b"],
)  # fmt: skip
def test_loopback_is_what_only_this_machine_reaches(address: str) -> None:
    assert is_loopback(address)


@pytest.mark.parametrize(
    "address",
    ["tcp://0.0.0.0:5555", "tcp://*:5555", "tcp://192.168.1.10:5555", "tcp/robot.local:7447", "tcp://[::]:5555",
     "tls/10.0.0.1:7447", "udp/10.0.0.1:1", "eth0", "", "serial//dev/ttyS0", "tcp://127.0.0.1.example.com:1"],
)  # fmt: skip
def test_everything_else_is_not(address: str) -> None:
    assert not is_loopback(address)


def told(security: Security, middleware: str, **options: Any) -> list[str]:
    return [fault.message for fault in faults(security, [Opening("laser", middleware, options)], [])]


BEYOND = [
    ("zeromq", {"bind": "tcp://0.0.0.0:5555"}),
    ("zeromq", {"connect": {"camera": "tcp://10.0.0.2:5555"}}),
    ("zenoh", {"connect": "tcp/10.0.0.2:7447"}),
    ("dds", {"interface": "eth0"}),
    ("dds", {"interface": ""}),
    ("ice", {"host": "0.0.0.0"}),
    ("ice", {"endpoints": {"Laser": "tcp -h 10.0.0.2 -p 10003"}}),
    ("ice", {"proxies": {"Laser": "laser:tcp -h robot.local -p 10003"}}),
    ("ice", {"storm": "IceStorm/TopicManager:tcp -h 10.0.0.2 -p 9999"}),
]


@pytest.mark.parametrize(("middleware", "options"), BEYOND)
def test_local_is_this_machine(middleware: str, options: dict[str, Any]) -> None:
    (message,) = told(Security.LOCAL, middleware, **options)
    assert "`laser`" in message
    assert "security local" in message


@pytest.mark.parametrize(("middleware", "options"), BEYOND)
def test_open_is_everything(middleware: str, options: dict[str, Any]) -> None:
    assert told(Security.OPEN, middleware, **options) == []


@pytest.mark.parametrize("security", Security)
@pytest.mark.parametrize(
    ("middleware", "options"),
    [("zeromq", {}), ("zeromq", {"bind": "tcp://127.0.0.1:5555"}), ("zenoh", {}), ("zenoh", {"connect": "here/x"}),
     ("shm", {}), ("inproc", {})],
)  # fmt: skip
def test_what_stays_on_this_machine_is_always_allowed(
    security: Security, middleware: str, options: dict[str, Any]
) -> None:
    assert told(security, middleware, **options) == []


def test_lan_lets_zeromq_out_which_then_has_keys_and_zenoh_if_it_is_encrypted() -> None:
    assert told(Security.LAN, "zeromq", bind="tcp://192.168.1.10:5555") == []
    assert told(Security.LAN, "zenoh", connect="tls/192.168.1.10:7447") == []
    (message,) = told(Security.LAN, "zenoh", connect="tcp/192.168.1.10:7447")
    assert "not encrypted" in message


@pytest.mark.parametrize("middleware", ["dds", "ice"])
def test_lan_refuses_what_has_no_keys_and_says_why_and_what_to_do(middleware: str) -> None:
    (fault,) = faults(Security.LAN, [Opening("laser", middleware, {})], [])
    assert "neither authentication nor encryption" in fault.message
    assert "use zeromq or zenoh" in fault.hint
    (by_way,) = faults(Security.LAN, [], [replace(way("viewer", "camera", "divide"), middleware=middleware)])
    assert by_way.message.startswith(f"`viewer` and `camera` use `{middleware}`, which")
    assert told(Security.LOCAL, middleware) == []


def test_what_many_do_is_one_error_that_names_the_first_of_them() -> None:
    (fault,) = faults(Security.LAN, [Opening(f"n{number}", "dds", {}) for number in range(500)], [])
    assert fault.message.startswith("`n0`, `n1`, `n2`, `n3`, `n4` and 495 more use `dds`")


def test_open_needs_a_word_on_the_command_line_besides_and_is_loud() -> None:
    plan = replace(network(), security=Security.OPEN)
    assert "add --insecure" in why_not(plan, insecure=False)
    assert not why_not(plan, insecure=True)
    assert "WITHOUT SECURITY" in warning(plan)
    for security in (Security.LAN, Security.LOCAL):
        quiet = replace(plan, security=security)
        assert (why_not(quiet, insecure=False), warning(quiet)) == ("", "")


def test_each_process_of_a_lan_gets_the_place_of_its_keys_and_no_secret(tmp_path: Path) -> None:
    found = secured(network(), tmp_path)
    camera = found.processes[0]
    assert camera.command[-4:] == ("--name", "camera", "--keys", str(tmp_path / "camera"))
    assert tmp_path / "camera" in camera.files


def test_each_instance_of_a_shared_process_is_reported(tmp_path: Path) -> None:
    plan = network()
    first = plan.processes[0]
    both = replace(first, command=(*first.command, "--set", "a=--name", "+", "/components/b", "--name", "b"))
    words = secured(replace(plan, processes=(both,)), tmp_path).processes[0].command
    assert [words[at - 1] for at, word in enumerate(words) if word == "--keys"] == ["camera", "b"]


def test_programs_of_ones_own_and_local_networks_are_left_as_they_are(tmp_path: Path) -> None:
    plan = network()
    program = replace(plan.processes[0], is_program=True)
    assert secured(replace(plan, processes=(program,)), tmp_path).processes == (program,)
    local = replace(plan, security=Security.LOCAL)
    assert secured(local, tmp_path) is local
