"""Where the processes of a network run, and what becomes of them when they end."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
from collections.abc import Mapping
from pathlib import Path

import pytest

from robocomp_py.deploy.hosts import addresses
from robocomp_py.deploy.plan import Host, Overrides, Plan, Process, Security
from robocomp_py.deploy.planner import make_plan
from robocomp_py.deploy.policy import Escalation, Restart, When
from robocomp_py.dsl.workspace import Workspace

from .planned import command, errors, plan

ONBOARD = 'host onboard { address "192.168.1.10"; user robot; port 2222; workdir "/opt/x"; lost keep; };'
BASE = 'host base { address "192.168.1.11"; python "python3.12"; };'


def planned(folder: Path, body: str) -> Plan:
    found, diagnostics = plan(folder, body)
    assert found is not None, [each.message for each in diagnostics]
    return found


def by_name(found: Plan) -> dict[str, Process]:
    return {each.name: each for each in found.processes}


def carriers(found: Plan) -> dict[tuple[str, str], str]:
    """What carries the messages from one instance to another."""
    return {(way.client, way.provider): way.middleware for way in found.ways}


# Hosts.


def test_a_process_runs_on_the_host_of_its_instance(folder: Path) -> None:
    body = f"security lan; {ONBOARD} {BASE} Component sensor {{ host onboard; }}; Component driver {{ }};"
    found = planned(folder, body)
    assert {name: each.host for name, each in by_name(found).items()} == {"sensor": "onboard", "driver": ""}
    assert found.hosts == (Host("onboard", "192.168.1.10", "robot", 2222, "/opt/x", keep=True),)  # nobody is on base


def test_an_address_that_is_no_loopback_is_a_host_without_a_name(folder: Path) -> None:
    found = planned(folder, 'security lan; Component sensor { ip "192.168.1.12"; }; Component driver { };')
    assert found.hosts == (Host("192.168.1.12", "192.168.1.12"),)
    assert by_name(found)["sensor"].host == "192.168.1.12"


def test_an_address_of_this_machine_or_its_name_is_this_machine(folder: Path) -> None:
    def found(place: str, blocks: str = "") -> Plan:
        (folder / "net.ddsl").write_text(
            'import "sensor/sensor.cdsl"; import "driver/driver.cdsl"; '
            f"Deployment net {{ {blocks} Component sensor {{ {place} }}; Component driver {{ }}; }};"
        )
        plan = make_plan(folder / "net.ddsl", Workspace(), is_here=lambda address: address in ("10.0.0.7", "robot7"))
        assert plan
        return plan

    here = found("")
    for own in ('ip "10.0.0.7";', "ip robot7;", "ip localhost;"):
        plan = found(own)
        assert (plan.hosts, plan.processes, plan.ways) == ((), here.processes, here.ways)
    block = 'security lan; host onboard { address "10.0.0.7"; user "robot"; };'
    assert by_name(found('ip "10.0.0.7";', block))["sensor"].host == "onboard"  # which is reached as another user
    assert by_name(found('ip "10.0.0.8";', "security lan;"))["sensor"].host == "10.0.0.8"


def test_on_this_machine_a_port_is_taken_once_whatever_it_is_called(folder: Path) -> None:
    body = 'Component sensor { ip "10.0.0.7"; port 10003; }; Component driver { ip localhost; port 10003; };'
    (folder / "net.ddsl").write_text(
        f'import "sensor/sensor.cdsl"; import "driver/driver.cdsl"; Deployment net {{ {body} }};'
    )
    workspace = Workspace()
    assert make_plan(folder / "net.ddsl", workspace, is_here=lambda address: address == "10.0.0.7") is None
    assert [each.code for each in workspace.report.errors] == ["port-clash"]


def own_address() -> str:
    """A number of this machine's; that of loopback if it has no other one."""
    with contextlib.suppress(OSError):
        return addresses.towards("192.0.2.1")
    return "127.0.0.1"


def test_this_machine_knows_its_addresses_and_its_name() -> None:
    name = socket.gethostname()
    assert addresses.is_own(own_address())
    assert all(
        map(addresses.is_own, ("127.0.0.1", "127.0.1.1", "::1", name, name.upper(), f"{name.partition('.')[0]}.local"))
    )
    assert not any(
        map(addresses.is_own, ("192.0.2.77", "0.0.0.0", "2001:db8::7", "robot.invalid", "", "-", "999.1.1.1"))
    )
    assert addresses.is_here("localhost")


def test_the_address_of_a_host_is_that_host(folder: Path) -> None:
    body = f"security lan; {ONBOARD} Component sensor {{ ip 192.168.1.10; }}; Component driver {{ host onboard; }};"
    found = planned(folder, body)
    assert {each.host for each in found.processes} == {"onboard"}
    assert [each.name for each in found.hosts] == ["onboard"]


def test_shared_memory_and_objects_stay_on_a_host(folder: Path) -> None:
    body = f"""
    security lan; middleware auto(zeromq); {ONBOARD} {BASE}
    Component sensor {{ host onboard; process p; }};
    Component inside : driver {{ host onboard; process p; }};
    Component beside : driver {{ host onboard; }};
    Component far : driver {{ host base; }};
    Component here : driver {{ }};
    """
    assert carriers(planned(folder, body)) == {
        ("inside", "sensor"): "inproc",
        ("beside", "sensor"): "shm",
        ("far", "sensor"): "zeromq",
        ("here", "sensor"): "zeromq",
    }


@pytest.mark.parametrize("middleware", ["inproc", "shm"])
def test_what_stays_on_a_host_is_refused_between_two(folder: Path, middleware: str) -> None:
    body = (
        f"middleware {middleware}; {ONBOARD} Component sensor {{ host onboard; process p; }}; Component driver {{ }};"
    )
    assert "unfit-middleware" in errors(folder, body)


def test_a_process_that_is_on_two_hosts_is_one_mistake(folder: Path) -> None:
    body = f"{ONBOARD} Component sensor {{ host onboard; process p; }}; Component driver {{ process p; }};"
    assert "unfit-middleware" not in (found := errors(folder, f"security lan; {body}"))
    assert "unshared-process" in found


def test_what_was_not_generated_is_not_said_to_go_by_the_wrong_way(folder: Path, tmp_path: Path) -> None:
    new = shutil.copytree(folder, tmp_path / "new", ignore=shutil.ignore_patterns("generic"))
    body = f"security lan; {ONBOARD} Component sensor {{ host onboard; }}; Component driver {{ }};"
    assert errors(new, body) == ["not-generated", "not-generated"]


def test_a_server_for_another_host_gets_an_address_and_its_client_gets_it_too(folder: Path) -> None:
    body = f"""
    security lan; middleware zeromq; {ONBOARD}
    Component sensor {{ host onboard; port 7501; }}; Component driver {{ }};
    """
    found = planned(folder, body)
    assert 'transports.zeromq.bind="tcp://192.168.1.10:7501"' in command(found, "sensor")
    assert 'transports.zeromq.connect={ sensor = "tcp://192.168.1.10:7501" }' in command(found, "driver")


def test_host_names_are_resolved_when_the_network_starts(folder: Path) -> None:
    body = 'security lan; middleware zeromq; host base { address "base.local"; }; Component sensor { host base; };'
    plan(folder, f"{body} Component driver {{ }};")  # writes it

    def addresses(hosts: Mapping[str, str]) -> Mapping[str, str]:
        assert dict(hosts) == {"base": "base.local"}
        return {"": "10.0.0.1", "base": "10.0.0.2"}

    found = make_plan(folder / "net.ddsl", Workspace(), addresses=addresses)
    assert "tcp://10.0.0.2:" in command(found, "driver")


def test_a_host_name_that_cannot_be_resolved_is_an_error(folder: Path) -> None:
    plan(folder, 'security lan; host base { address "base.local"; }; Component sensor { host base; };')

    def addresses(hosts: Mapping[str, str]) -> Mapping[str, str]:
        raise OSError("base.local: nobody knows that name")

    workspace = Workspace()
    assert make_plan(folder / "net.ddsl", workspace, addresses=addresses) is None
    [found] = workspace.report.errors
    assert (found.code, found.message) == (
        *("bad-host", "the addresses of its hosts are not known: base.local: nobody knows that name"),
    )


def test_one_port_may_be_taken_on_two_hosts(folder: Path) -> None:
    body = f"""
    security lan; {ONBOARD} {BASE}
    Component a : sensor {{ host onboard; port 7501; }}; Component b : sensor {{ host base; port 7501; }};
    """
    assert errors(folder, body) == []


# Security.


@pytest.mark.parametrize("middleware", ["zeromq", "zenoh", "dds"])
def test_links_between_hosts_need_a_security_clause(folder: Path, middleware: str) -> None:
    body = f"middleware {middleware}; {ONBOARD} Component sensor {{ host onboard; }}; Component driver {{ }};"
    assert errors(folder, body) == ["insecure"]
    assert errors(folder, f"security open; {body}") == []


def test_a_network_without_links_between_hosts_needs_no_security(folder: Path) -> None:
    body = f"{ONBOARD} Component sensor {{ }}; Component far : sensor {{ host onboard; }};"
    assert errors(folder, body) == []


def test_dds_has_no_keys_and_what_to_use_instead_is_said(folder: Path) -> None:
    body = f"security lan; middleware dds; {ONBOARD} Component sensor {{ host onboard; }}; Component driver {{ }};"
    found, diagnostics = plan(folder, body)
    assert found is None
    assert {each.code for each in diagnostics} == {"insecure"}
    assert all("neither authentication nor encryption" in each.message for each in diagnostics)
    assert all(each.hint.startswith("use zeromq or zenoh") for each in diagnostics)


@pytest.mark.parametrize("middleware", ["inproc", "shm", "auto(zeromq)"])
def test_what_stays_on_a_host_needs_no_keys(folder: Path, middleware: str) -> None:
    body = (
        f"security lan; middleware {middleware}; Component sensor {{ process p; }}; Component driver {{ process p; }};"
    )
    assert errors(folder, body) == []


@pytest.mark.parametrize("security", list(Security))
def test_the_plan_holds_the_security_of_the_network(folder: Path, security: Security) -> None:
    assert planned(folder, f"security {security}; Component sensor {{ }};").security is security
    assert planned(folder, "Component sensor { };").security is Security.LOCAL


# When something ends.


def test_whether_a_process_is_started_again_is_said_by_it_or_by_its_network(folder: Path) -> None:
    found = planned(
        folder,
        """
        restart on_failure(intensity 3, period 1 min, delay 200 ms, max_delay 7);
        escalation rest_for_one;
        Component sensor { };
        Component driver { restart never; };
        Component recorder : driver { restart always; grace 2.5; };
        """,
    )
    processes = by_name(found)
    assert processes["sensor"].restart == Restart(When.ON_FAILURE, 3, 60.0, 0.2, 7.0)
    assert processes["driver"].restart.when is When.NEVER
    assert processes["recorder"].restart == Restart(When.ALWAYS)
    assert found.escalations == {(): Escalation.REST_FOR_ONE}
    assert [each.grace for each in found.processes] == [None, None, 2.5]


def test_nothing_is_restarted_by_default(folder: Path) -> None:
    found = planned(folder, "Component sensor { };")
    assert (found.processes[0].restart, found.escalations) == (Restart(), {})


def test_each_instance_of_a_process_has_the_longest_grace_of_them_to_end(folder: Path) -> None:
    body = "Component sensor { process p; grace 10; }; Component driver { process p; grace 3 s; };"
    assert planned(folder, body).processes[0].grace == 20


# Programs that are there already.


def test_the_command_of_a_program_is_split_into_words_and_no_shell_sees_it(folder: Path) -> None:
    found = planned(folder, 'Component sensor { existing "sleep 60 \'a b\' \'$HOME\' \\;"; args "--c d", "\'"; };')
    [process] = found.processes
    assert process.command == ("sleep", "60", "a b", "$HOME", ";", "--c d", "'")
    assert (process.notifies, process.files, process.cwd) == (False, (), folder.resolve())


def test_a_program_is_looked_for_where_it_is_going_to_run(folder: Path) -> None:
    (folder / "tools").mkdir(exist_ok=True)
    (folder / "tools" / "own").write_text("#!/bin/sh\n")
    (folder / "tools" / "own").chmod(0o755)
    found = planned(folder, 'Component sensor { existing "tools/own -x"; };')
    assert found.processes[0].command == (str(folder.absolute() / "tools" / "own"), "-x")
    assert errors(folder, 'Component sensor { existing "own"; };') == ["missing-file"]
    assert errors(folder, f'Component sensor {{ existing "own"; env PATH "{folder}/tools"; }};') == []
    assert errors(folder, f'{ONBOARD} Component sensor {{ existing "own"; host onboard; }};') == []


def test_a_program_with_an_absolute_path_is_looked_for_on_its_host(folder: Path) -> None:
    found = planned(folder, f'{ONBOARD} Component sensor {{ path "/opt/lidar/run"; args "-v"; host onboard; }};')
    [process] = found.processes
    assert (process.command, process.files) == (("/opt/lidar/run", "-v"), ())
    assert errors(folder, f'{ONBOARD} Component sensor {{ path "run"; host onboard; }};') == ["missing-file"]
    assert errors(folder, 'Component sensor { path "/opt/lidar/run"; };') == ["missing-file"]


def test_what_others_use_of_an_existing_program_is_checked_like_anything_else(folder: Path) -> None:
    body = 'Component sensor { existing "sleep 60"; }; Component recorder { };'
    assert errors(folder, body) == ["qos-mismatch"]
    assert errors(folder, 'Component driver { existing "sleep 60"; };') == ["no-provider"]


def test_an_existing_program_is_not_configured_from_here(folder: Path) -> None:
    overrides = Overrides(settings=(("sensor", "params.range=5"),))
    assert errors(folder, 'Component sensor { existing "sleep 60"; };', overrides) == ["configuration"]


# What a machine reads.


def test_all_of_a_plan_can_be_written_down(folder: Path) -> None:
    body = f"""
    security lan; middleware zenoh; restart always; escalation one_for_all; {ONBOARD}
    Component sensor {{ host onboard; grace 3; }}; System left {{ Component driver {{ }}; escalation one_for_one; }};
    """
    found = json.loads(json.dumps(planned(folder, body).to_json()))
    assert found["security"] == "lan"
    assert [each["name"] for each in found["hosts"]] == ["onboard"]
    assert found["escalations"] == {"": "one_for_all", "left": "one_for_one"}
    sensor, driver = found["processes"]
    assert (sensor["host"], sensor["grace"], sensor["restart"]["when"]) == ("onboard", 3, "always")
    assert sensor["files"] == [str((folder / "sensor").resolve())]
    assert (driver["name"], driver["system"], driver["instances"]) == ("left/driver", ["left"], ["left/driver"])
    assert [(each["name"], each["host"]) for each in found["helpers"]] == [
        ("zenoh-router", ""),
        ("zenoh-router", "onboard"),
    ]
