"""Keys are made from the graph: for each process its own, for each edge what it needs, and nothing twice."""

from __future__ import annotations

import json
import stat
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy import certificates
from robocomp_py.deploy.keys import (
    contents,
    files_of,
    folder_of,
    graph_of,
    has_operator,
    make_keys,
    numbers,
    troubles,
)
from robocomp_py.deploy.plan import Allowed, Ours, Plan
from robocomp_py.errors import DeploymentError
from robocomp_py.transports.keyfiles import read_public
from robocomp_py.transports.permissions import OPERATOR
from robocomp_py.transports.zenoh.access import access_control
from robocomp_py.transports.zenoh.deployment import router
from robocomp_py.transports.zeromq.curve import key_pair

from .security_network import DAY, NOW, made, network, process, way


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "keys"


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_each_process_gets_a_certificate_in_its_own_name_that_the_authority_signed(folder: Path) -> None:
    made(network(), folder)
    authority = (folder / "ca" / "ca.pem").read_bytes()
    for name in ("camera", "viewer", "other"):
        pem = (folder / name / "certificate.pem").read_bytes()
        found = certificates.read(pem)
        assert (found.name, found.addresses) == (name, frozenset())
        assert found.expires == NOW + 365 * DAY
        assert certificates.is_signed_by(pem, authority)
        assert (folder / name / "ca.pem").read_bytes() == authority


def test_only_their_owner_can_read_them(folder: Path) -> None:
    made(network(router="tls/10.0.0.1:20000"), folder)
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.rglob("*"))}
    assert {path for path, mode in modes.items() if mode != (0o700 if path.is_dir() else 0o600)} == set()


def test_a_second_time_nothing_is_made(folder: Path) -> None:
    plan = network(router="tls/10.0.0.1:20000")
    assert all(each.is_new for each in made(plan, folder))
    before = snapshot(folder)
    assert not any(each.is_new for each in made(plan, folder))
    assert snapshot(folder) == before


def test_renew_makes_everything_again_but_the_authority_and_the_identities(folder: Path) -> None:
    made(network(), folder)
    before = snapshot(folder)
    made(network(), folder, renew=True)
    after = snapshot(folder)
    same = {name for name in before if before[name] == after[name]}
    assert same == {".gitignore", "ca/ca.key", "ca/ca.pem"} | {
        f"{name}/{file}" for name in ("camera", "viewer", "other") for file in ("ca.pem", "identity.json")
    }


@pytest.mark.parametrize(("days", "left", "again"), [(365, 31, False), (365, 29, True), (3, 2, False), (3, 0.9, True)])
def test_what_will_soon_expire_is_made_again(folder: Path, days: float, left: float, again: bool) -> None:
    made(network(), folder, days=days)
    found = {each.what: each.is_new for each in made(network(), folder, now=NOW + (days - left) * DAY)}
    assert found["certificate of camera"] is again
    assert not found["the authority"]


def test_a_server_admits_exactly_those_that_the_graph_connects_to_it_for_exactly_that(folder: Path) -> None:
    plan = network(
        way("viewer", "camera", "divide"),
        way("viewer", "camera", "count"),
        way("other", "camera", "news", Verb.SUBSCRIBES),
    )
    made(plan, folder)
    admitted = {path.name: read_public(path) for path in (folder / "camera" / "admitted").iterdir()}
    assert {name: set(rights.channels or ()) for name, (_, rights) in admitted.items()} == {
        "viewer.key": {"robot/camera/Everything/divide", "robot/camera/Everything/count"},
        "other.key": {"robot/camera/Everything/news"},
    }
    assert admitted["viewer.key"][0] == key_pair(folder / "viewer" / "curve.key_secret")[0]
    key, rights = read_public(folder / "other" / "peers" / "camera.key")
    assert key == key_pair(folder / "camera" / "curve.key_secret")[0]
    assert set(rights.channels or ()) == {"robot/camera/Everything/news"}
    assert not list((folder / "viewer" / "admitted").iterdir())


def test_the_permissions_follow_the_graph(folder: Path) -> None:
    made(network(), folder)
    changed = network(way("other", "camera", "divide"))
    assert "older version" in troubles(changed, folder, NOW)[0][0]
    made(changed, folder)
    assert [path.name for path in (folder / "camera" / "admitted").iterdir()] == ["other.key"]
    assert not list((folder / "viewer" / "peers").iterdir())
    assert troubles(changed, folder, NOW) == ([], [])


def test_keys_of_removed_instances_are_deleted_and_other_folders_stay(folder: Path) -> None:
    made(network(), folder)
    (folder / "notes").mkdir()
    (folder / "notes" / "todo.txt").write_text("mine")
    told = made(network(names=("camera", "viewer")), folder)
    assert [each.what for each in told if "removed" in each.what] == [
        "other removed: it is no longer part of the network"
    ]
    assert sorted(path.name for path in folder.iterdir()) == [".gitignore", "ca", "camera", "notes", "viewer"]


def test_what_will_be_in_a_folder_is_known_before_it_is_there(folder: Path) -> None:
    plan = network(way("viewer", "left/arm", "divide"), names=("left/arm", "viewer"), router="tls/10.0.0.1:20000")
    known = contents(graph_of(plan))
    made(plan, folder)
    assert {name: set(files) for name, files in known.items()} == {
        each.name: {str(path.relative_to(each)) for path in each.rglob("*") if path.is_file()}
        for each in folder.iterdir()
        if each.is_dir() and each.name != "ca"
    }
    assert "admitted/viewer.key" in known["left.arm"]


def test_a_host_gets_the_keys_of_its_own_processes_and_never_that_of_the_authority(folder: Path) -> None:
    plan = network(router="tls/10.0.0.1:20000")
    plan = replace(
        plan,
        processes=(*plan.processes, process("left/arm", "onboard")),
        helpers=(*plan.helpers, router("onboard", {}, "10.0.0.2")),
    )
    made(plan, folder)
    assert files_of(plan, "onboard", folder) == (folder / "left.arm", folder / "router@onboard")
    shipped = {path.name for each in files_of(plan, "onboard", folder) for path in each.rglob("*") if path.is_file()}
    assert shipped == {
        "identity.json", "ca.pem", "certificate.pem", "key.pem", "curve.key", "curve.key_secret"
    }  # fmt: skip
    assert (folder / "ca" / "ca.key").is_file()


def test_a_router_is_believed_at_the_addresses_where_it_listens(folder: Path) -> None:
    plan = network(router="tls/10.0.0.1:20000")
    made(plan, folder)
    found = certificates.read((folder / "router@" / "certificate.pem").read_bytes())
    assert found.addresses == {"10.0.0.1", "127.0.0.1"}
    moved = network(router="tls/10.0.0.9:20000")
    assert "is not for 10.0.0.9" in troubles(moved, folder, NOW)[0][0]
    assert {each.what for each in made(moved, folder) if each.is_new} == {"certificate of router@"}


def test_numbers_of_processes_are_their_own(folder: Path) -> None:
    names = tuple(f"p{number}" for number in range(40))
    made(network(way("p1", "p2", "divide"), names=names), folder)
    numbers = [json.loads((folder / name / "identity.json").read_text())["number"] for name in names]
    assert len(set(numbers)) == len(names)


def test_long_names_fit_into_certificates_and_stay_apart(folder: Path) -> None:
    long = "s/" * 40
    names = (f"{long}camera", f"{long}viewer")
    made(network(way(names[1], names[0], "divide"), names=names), folder)
    found = [certificates.read((folder_of(folder, name) / "certificate.pem").read_bytes()).name for name in names]
    assert len(set(found)) == 2
    assert all(len(name) <= 64 for name in found)


@pytest.mark.parametrize("names", [("left/arm", "left.arm"), ("ca", "x"), ("..", "x"), ("../x", "x")])
def test_names_that_would_share_a_folder_or_escape_it_are_refused(folder: Path, names: tuple[str, ...]) -> None:
    with pytest.raises(DeploymentError, match="cannot be the name of a process with keys"):
        made(network(way(names[0], names[1], "divide"), names=names), folder)


def test_processes_are_known_by_one_identity_whatever_runs_in_them() -> None:
    plan = network(way("viewer", "camera", "divide"), way("camera", "camera", "count"))
    assert [(edge.client, edge.provider, edge.channel) for edge in graph_of(plan).edges] == [
        ("viewer", "camera", "robot/camera/Everything/divide")
    ]


# At deployment.


def test_a_network_without_keys_is_not_started_and_the_remedy_is_printed(folder: Path) -> None:
    errors, _ = troubles(network(), folder, NOW)
    assert errors == [f"there are no keys in {folder}; run: rcdeploy keys NET.ddsl -o {folder}"]


def test_expired_keys_are_reported_with_a_remedy(folder: Path) -> None:
    made(network(), folder, days=10)
    errors, _ = troubles(network(), folder, NOW + 11 * DAY)
    assert len(errors) == 3
    assert f"expired on {NOW + 10 * DAY:%Y-%m-%d}" in errors[0]
    assert errors[0].endswith("--renew")


def test_keys_that_expire_soon_are_reported_and_the_network_starts(folder: Path) -> None:
    made(network(), folder)
    errors, warnings = troubles(network(), folder, NOW + 340 * DAY)
    assert not errors
    assert len(warnings) == 3
    assert "expires on" in warnings[0]


def test_a_certificate_of_another_authority_is_named_and_made_again(folder: Path) -> None:
    made(network(), folder)
    (folder / "ca" / "ca.key").unlink()
    made(network(names=("camera", "viewer")), folder)  # by a new authority
    assert troubles(network(names=("camera", "viewer")), folder, NOW) == ([], [])
    foreign = certificates.issue(certificates.make_authority("x", NOW), "viewer", (), NOW, 30, serves=False)
    (folder / "viewer" / "certificate.pem").write_bytes(foreign.certificate)
    errors, _ = troubles(network(names=("camera", "viewer")), folder, NOW)
    assert len(errors) == 1
    assert "the certificate of `viewer` was not issued by the authority" in errors[0]
    assert "certificate of viewer" in {each.what for each in made(network(), folder) if each.is_new}


def test_a_missing_certificate_is_named(folder: Path) -> None:
    made(network(), folder)
    (folder / "viewer" / "certificate.pem").unlink()
    errors, _ = troubles(network(), folder, NOW)
    assert len(errors) == 1
    assert "`viewer`" in errors[0]


def test_a_folder_that_others_can_read_is_refused(folder: Path) -> None:
    made(network(), folder)
    folder.chmod(0o755)
    errors, _ = troubles(network(), folder, NOW)
    assert errors == [f"{folder} is open to other users; chmod 700 {folder}"]


def test_a_folder_with_other_things_in_it_is_not_touched(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o755)
    (folder / "net.ddsl").write_text("mine")
    with pytest.raises(DeploymentError, match=r"keys: .* contains other files"):
        made(network(), folder)
    assert snapshot(folder) == {"net.ddsl": b"mine"}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o755


def test_a_place_that_cannot_be_written_is_an_error_that_names_it(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DeploymentError, match="file"):
        make_keys(network(), tmp_path / "file" / "keys", NOW)


# What Zenoh's routers are told.


def test_the_rules_of_a_router_are_the_edges_and_nothing_else() -> None:
    plan = network(way("viewer", "camera", "divide"), way("other", "camera", "news", Verb.SUBSCRIBES))
    rules = access_control(graph_of(plan), "", {"camera": 0xCA, "viewer": 0x1, "other": 0x2})
    assert (rules["enabled"], rules["default_permission"]) == (True, "deny")
    may = allowed(rules)
    assert may["viewer"] == {
        "declare_liveliness_subscriber rc_lv/*/**",
        "liveliness_query rc_lv/*/**",
        *(f"liveliness_token rc_lv/*/{role}/*/*/*/0001$*/robot/camera/Everything/divide"
          for role in ("calls", "commands", "subscribes")),
        "declare_subscriber rc_ack/*/0001$*/*",
        "declare_subscriber rc_to/*/0001$*/*/**",
        "declare_queryable rc_ask/*/0001$*/*/*/**",
        "reply rc_ask/*/0001$*/*/*/**",
        "query rc_ask/*/00ca$*/*/text",
        "query rc/*/robot/camera/Everything/divide",
        "put rc/*/robot/camera/Everything/divide",
        "put rc_to/*/00ca$*/*/robot/camera/Everything/divide",
    }  # fmt: skip
    assert "declare_subscriber rc/*/robot/camera/Everything/news" in may["other"]
    assert not any("divide" in each for each in may["other"])
    assert "put rc/*/robot/camera/**" in may["camera"]
    assert not any("rc/*/robot/camera" in each and each.startswith("put") for each in may["other"])


def test_of_another_host_its_router_may_what_its_processes_may() -> None:
    plan = network(router="tls/10.0.0.1:20000")
    onboard = {"viewer": "onboard"}
    plan = replace(
        plan,
        processes=tuple(replace(each, host=onboard.get(each.name, "")) for each in plan.processes),
        helpers=(*plan.helpers, router("onboard", {}, "10.0.0.2")),
    )
    numbers = {"camera": 0xCA, "viewer": 0x1, "other": 0x2}
    here, there = (allowed(access_control(graph_of(plan), host, numbers)) for host in ("", "onboard"))
    assert set(here) == {"camera", "other", "router@onboard"}
    assert set(there) == {"viewer", "router@"}
    routers = {f"{what} rc_router/*" for what in ("declare_queryable", "query", "reply")}
    assert here["router@onboard"] == there["viewer"] | routers
    assert there["router@"] == here["camera"] | here["other"] | routers


# The operator.


def watched() -> Plan:
    """A network whose camera publishes news, and whose `other` has no connection."""
    ours = {
        name: Ours(Path("/x"), {}, f"robot/{name}", ("zenoh",), topics)
        for name, topics in (("camera", ("robot/camera/Everything/news",)), ("viewer", ()), ("other", ()))
    }
    return replace(network(router="tls/10.0.0.1:20000"), ours=ours)


def test_an_operator_may_hear_all_topics_and_ask_what_components_are_and_nothing_else() -> None:
    graph = graph_of(watched(), operator=True)
    may = {(edge.channel, edge.verb) for edge in graph.uses(OPERATOR)}
    assert may == {
        *((f"robot/{name}/Introspection/{asked}", Verb.REQUIRES)
          for name in ("camera", "viewer", "other") for asked in ("describe", "measure", "watch")),
        *((f"robot/{name}/IntrospectionPub/{told}", Verb.SUBSCRIBES)
          for name in ("camera", "viewer", "other") for told in ("called", "logged")),
        ("robot/camera/Everything/news", Verb.SUBSCRIBES),
    }  # fmt: skip
    assert graph.used_by(OPERATOR) == ()
    rules = allowed(access_control(graph, "", {"camera": 0xCA, "viewer": 1, "other": 2, OPERATOR: 3}))
    sent = {each for each in rules[OPERATOR] if each.startswith(("put", "query")) and "/text" not in each}
    assert all("Introspection/" in each or "rc_ack" in each or "history" in each or "who" in each for each in sent), (
        sent
    )
    assert "reply rc_ask/*/*/*/who" in rules["other"]
    assert "liveliness_token rc_lv/*/serves/*/*/*/0002$*/robot/other/**" in rules["other"]


def test_an_operator_may_call_what_the_network_allows_tools_to_call() -> None:
    allow = (Allowed("camera", "", "Everything", "divide", "call"), Allowed("other", "lens", "Focus", "turn", "goal"))
    allow += (Allowed("viewer", "", "Everything", "news", "publication"),)
    graph = graph_of(replace(watched(), allow=allow), operator=True)
    without = graph_of(watched(), operator=True)
    more = {(edge.channel, edge.verb) for edge in set(graph.uses(OPERATOR)) - set(without.uses(OPERATOR))}
    assert more == {
        ("robot/camera/Everything/divide", Verb.REQUIRES),
        *((f"robot/lens/Focus/turn-{part}", Verb.REQUIRES) for part in ("start", "result", "cancel")),
        *((f"robot/lens/Focus/turn-{part}", Verb.SUBSCRIBES) for part in ("feedback", "status")),
    }
    rules = allowed(access_control(graph, "", {"camera": 0xCA, "viewer": 1, "other": 2, OPERATOR: 3}))
    assert "query rc/*/robot/camera/Everything/divide" in rules[OPERATOR]
    assert "query rc/*/robot/camera/Everything/work" not in rules[OPERATOR]
    assert "declare_queryable rc/*/robot/lens/**" in rules["other"]
    assert graph_of(replace(watched(), allow=allow)) == graph_of(watched())


def test_without_an_operator_no_rule_is_for_one(folder: Path) -> None:
    plan = watched()
    made(plan, folder)
    assert not graph_of(plan).has_operator
    assert not has_operator(folder)
    assert "who" not in str(access_control(graph_of(plan), "", numbers(plan, folder)))


def test_keys_of_an_operator_are_made_kept_and_removed_on_request(folder: Path) -> None:
    plan = watched()
    make_keys(plan, folder, NOW, operator=True)
    assert has_operator(folder)
    assert (folder / "camera" / "admitted" / f"{OPERATOR}.key").is_file()
    assert troubles(plan, folder, NOW) == ([], [])
    assert not any(each.is_new for each in make_keys(plan, folder, NOW))
    assert has_operator(folder)
    make_keys(plan, folder, NOW, operator=False)
    assert not (folder / OPERATOR).exists()
    assert not (folder / "camera" / "admitted" / f"{OPERATOR}.key").exists()
    assert troubles(plan, folder, NOW) == ([], [])


def test_no_host_gets_the_keys_of_an_operator(folder: Path) -> None:
    plan = watched()
    make_keys(plan, folder, NOW, operator=True)
    assert OPERATOR not in {each.name for each in files_of(plan, "", folder)}


def allowed(rules: dict[str, Any]) -> dict[str, set[str]]:
    """What each common name may send to a router: messages and keys."""
    by_id = {rule["id"]: rule for rule in rules["rules"]}
    names = {subject["id"]: subject["cert_common_names"] for subject in rules["subjects"]}
    found: dict[str, set[str]] = {}
    for policy in rules["policies"]:
        for rule in (by_id[each] for each in policy["rules"] if by_id[each]["flows"] == ["ingress"]):
            for name in (name for subject in policy["subjects"] for name in names[subject]):
                acts = found.setdefault(name, set())
                acts |= {f"{message} {key}" for message in rule["messages"] for key in rule["key_exprs"]}
    return found
