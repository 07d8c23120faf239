"""Networks that use Ice, or whose programs do: where clients find servers."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.told import operation
from robocomp_py.deploy.plan import Overrides, Plan

from .planned import errors, plan, planned

pytestmark = pytest.mark.tool  # needs Ice for Python

ONBOARD = 'host onboard { address "192.168.1.10"; };'
PROGRAM = 'existing "sleep 1000"; middleware ice;'
OVER_ICE = Overrides(settings=(("driver", "ports.laser.middleware=ice"),))


def told(folder: Path, body: str, overrides: Overrides | None = None) -> list[str]:
    """What is wrong, with what to do."""
    _, diagnostics = plan(folder, body, overrides)
    return [f"{each.code}: {each.message}; {each.hint}" for each in diagnostics if each.severity == "error"]


def options(found: Plan, instance: str, middleware: str = "ice") -> dict[str, Any]:
    """What an instance is told of a transport, the later one counting."""
    [process] = [each for each in found.processes if each.name == instance]
    told: dict[str, Any] = {}
    for word in process.command:
        if word.startswith(f"transports.{middleware}."):
            key, _, value = word.removeprefix(f"transports.{middleware}.").partition("=")
            *tables, last = key.split(".")
            table = told
            for each in tables:
                table = table.setdefault(each, {})
            table[last] = tomllib.loads(f"value = {value}")["value"] if value[:1] in '"{[' else value
    return told


def over(found: Plan) -> dict[tuple[str, str], str]:
    return {(way.client, way.interface): way.middleware for way in found.ways}


# On one host.


def test_a_whole_network_can_use_ice(folder: Path) -> None:
    found = planned(folder, "middleware ice; Component sensor { }; Component driver { };")
    assert set(over(found).values()) == {"ice"}
    assert options(found, "driver") == options(found, "sensor") == {}  # they find each other
    assert len(found.helpers) == 1


def test_ice_is_never_chosen_but_taken_where_a_port_names_it(folder: Path) -> None:
    body = "Component sensor { }; Component driver { };"
    assert "ice" not in over(planned(folder, body)).values()
    found = planned(folder, body, OVER_ICE)
    assert over(found) == {("driver", "Laser"): "ice", ("driver", "LaserPub"): "shm"}
    [sensor, _] = found.processes
    assert 'ports.Laser.also=["ice"]' in sensor.command
    assert found.helpers == ()  # no topic goes over it


@pytest.mark.parametrize(
    ("driver", "overrides"),
    [
        ('config "mixed.toml";', None),
        ('env ROBOCOMP__PORTS__LASER__MIDDLEWARE "ice";', None),
        ("", OVER_ICE),
        ("middleware ice;", Overrides(settings=(("driver", "ports.LaserPub.middleware=zeromq"),))),
    ],
)
def test_one_port_goes_over_ice_and_another_one_does_not(
    folder: Path, driver: str, overrides: Overrides | None
) -> None:
    (folder / "mixed.toml").write_text('[ports.laser]\nmiddleware = "ice"\n')
    body = f"middleware zeromq; Component sensor {{ middleware auto; }}; Component driver {{ {driver} }};"
    found = planned(folder, body, overrides)
    assert over(found) == {("driver", "Laser"): "ice", ("driver", "LaserPub"): "zeromq"}


def test_a_lone_publisher_or_subscriber_needs_icestorm_too(folder: Path) -> None:
    assert len(planned(folder, "middleware ice; Component sensor { };").helpers) == 1
    assert len(planned(folder, "middleware ice; Component recorder { };").helpers) == 1
    assert planned(folder, "Component recorder { };").helpers == ()


@pytest.mark.parametrize(
    ("option", "says"),
    [
        (
            'storm = "IceStorm/TopicManager:tcp -p 9899"',
            "through the IceStorm at `IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9899`",
        ),
        ('topics.LaserPub = "zed/LaserPub"', "by the topic `zed/LaserPub` of IceStorm, but `sensor` publishes it as"),
    ],
)
def test_a_subscriber_that_would_never_hear_its_publisher_is_an_error(folder: Path, option: str, says: str) -> None:
    (folder / "other.toml").write_text(f"[transports.ice]\n{option}\n")
    driver = 'Component driver { config "other.toml"; };'
    [said] = told(folder, f"middleware ice; Component sensor {{ }}; {driver}")
    assert said.startswith("middleware-mismatch: `driver` subscribes to `LaserPub`")
    assert says in said
    assert errors(folder, f'middleware ice; Component sensor {{ config "other.toml"; }}; {driver}') == []


def test_an_icestorm_is_the_same_however_its_address_is_written(folder: Path) -> None:
    (folder / "other.toml").write_text('[transports.ice]\nstorm = "IceStorm/TopicManager:default -h localhost -p 9999"')
    assert not errors(folder, 'middleware ice; Component sensor { }; Component driver { config "other.toml"; };')


def test_a_port_of_the_network_is_that_of_the_interface_over_ice(folder: Path) -> None:
    found = planned(folder, "middleware ice; Component sensor { port 10003; }; Component driver { };")
    assert options(found, "sensor") == {"endpoints": {"Laser": "tcp -p 10003"}}
    assert options(found, "sensor", "zeromq") == {"bind": ""}


def test_what_goes_over_zeromq_beside_it_has_the_next_port(folder: Path) -> None:
    found = planned(folder, "Component sensor { port 10003; }; Component driver { };", OVER_ICE)
    assert options(found, "sensor") == {"endpoints": {"Laser": "tcp -p 10003"}}
    assert options(found, "sensor", "zeromq") == {"bind": "tcp://127.0.0.1:10004"}


def test_two_instances_that_are_configured_for_one_port_are_an_error(folder: Path) -> None:
    (folder / "old.config").write_text("Laser.Endpoints = tcp -p 10003\n")
    body = 'middleware ice; Component a : sensor { config "old.config"; }; Component b : sensor { port 10003; };'
    [said] = told(folder, body)
    assert said.startswith("port-clash: port 10003 over Ice is given to both `Laser` and `Laser`, of `a` and `b`")


# Programs of one's own.


def test_clients_of_a_program_get_its_address(folder: Path) -> None:
    found = planned(folder, f"Component sensor {{ {PROGRAM} port 10003; }}; Component driver {{ }};")
    assert set(over(found).values()) == {"ice"}
    assert options(found, "driver") == {"proxies": {"sensor/Laser": "laser:tcp -h 127.0.0.1 -p 10003"}}


def test_tools_are_told_what_programs_serve_and_where(folder: Path) -> None:
    (folder / "their.config").write_text("Laser.Endpoints = tcp -p 11000\n")
    body = f"""
    security open; {ONBOARD} namespace robot1;
    Component sensor {{ {PROGRAM} port 10003; }};
    Component onboard : sensor {{ {PROGRAM} config "their.config"; host onboard; }};
    """
    found, _ = planned(folder, body).programs
    assert found.middleware == "ice"
    assert found.options == {
        "proxies": {
            "/robot1/sensor/Laser": "laser:tcp -h 127.0.0.1 -p 10003",
            "/robot1/onboard/Laser": "laser:tcp -h 192.168.1.10 -p 11000",
        },
        "storm": "IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9999",
        "host": "127.0.0.1",
        "topics": {"/robot1/sensor/LaserPub": "LaserPub"},
    }
    each = found.serve[0]
    assert (each.instance, each.owner, each.pattern) == ("sensor", "robot1/sensor", "query")
    assert each.channel == "robot1/sensor/Laser/getLaserData"
    assert operation(each.text).fingerprint == each.fingerprint


def test_tools_are_told_nothing_of_programs_without_a_known_place_and_of_components(folder: Path) -> None:
    [found] = planned(folder, f"Component sensor {{ {PROGRAM} }};").programs
    assert [each.channel for each in found.serve] == ["sensor/LaserPub/pushLaserData"]
    assert planned(folder, "middleware ice; Component sensor { port 10003; };").programs == ()
    assert planned(folder, 'Component sensor { existing "sleep 1000"; middleware zeromq; port 10003; };').programs == ()


def heard(folder: Path, body: str) -> dict[str, tuple[str, str, str]]:
    """By program: the IceStorm of its topic, where a tool listens, and what IceStorm calls the topic."""
    return {
        each.instance: (found.options["storm"], found.options["host"], *found.options["topics"].values())
        for found in planned(folder, body).programs
        for each in found.serve
        if each.pattern == "publish"
    }


def test_tools_are_told_through_which_icestorm_programs_publish(folder: Path) -> None:
    here = "IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9999"
    assert heard(folder, f"Component sensor {{ {PROGRAM} }};") == {"sensor": (here, "127.0.0.1", "LaserPub")}
    their = "LaserPubTopic = zed/LaserPub\nTopicManager.Proxy = IceStorm/TopicManager:default -p 9899\n"
    (folder / "their.config").write_text(their)
    there = here.replace("9999", "9899").replace("tcp", "default")
    own = f'Component sensor {{ {PROGRAM} config "their.config"; }};'
    assert heard(folder, own) == {"sensor": (there, "127.0.0.1", "zed/LaserPub")}


def test_a_program_that_names_no_icestorm_has_that_of_its_peers_or_of_its_host(folder: Path) -> None:
    (folder / "own.toml").write_text('[transports.ice]\nstorm = "IceStorm/TopicManager:tcp -p 9899"\n')
    peer = 'Component driver { config "own.toml"; };'
    [(storm, *_)] = heard(folder, f"Component sensor {{ {PROGRAM} port 10003; }}; {peer}").values()
    assert storm == "IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9899"
    abroad = f"security open; {ONBOARD} Component sensor {{ {PROGRAM} host onboard; }};"
    [(storm, host, _)] = heard(folder, abroad).values()
    assert (storm, host) == ("IceStorm/TopicManager:tcp -h 192.168.1.10 -p 9999", "127.0.0.1")


def test_a_program_is_where_its_own_configuration_says(folder: Path) -> None:
    (folder / "their.config").write_text("Laser.Endpoints = tcp -h 127.0.0.2 -p 11000\nOther = x\n")
    found = planned(folder, f'Component sensor {{ {PROGRAM} config "their.config"; }}; Component driver {{ }};')
    assert options(found, "driver") == {"proxies": {"sensor/Laser": "laser:tcp -h 127.0.0.2 -p 11000"}}


def test_a_subscriber_of_a_program_is_given_the_programs_topic_name(folder: Path) -> None:
    (folder / "their.config").write_text("Laser.Endpoints = tcp -p 1\nLaserPubTopic = zed/LaserPub\n")
    sensor = f"Component sensor {{ {PROGRAM} port 10003; }};"
    found = planned(folder, f"namespace robot1; {sensor} Component driver {{ }};")
    assert options(found, "driver")["topics"] == {"/robot1/sensor/LaserPub": "LaserPub"}  # as RoboComp has it
    sensor = f'Component sensor {{ {PROGRAM} config "their.config"; }};'
    found = planned(folder, f"{sensor} Component driver {{ }};")
    assert options(found, "driver")["topics"] == {"sensor/LaserPub": "zed/LaserPub"}
    (folder / "own.toml").write_text('[transports.ice.topics]\nLaserPub = "front/LaserPub"\n')
    found = planned(folder, f'{sensor} Component driver {{ config "own.toml"; }};')
    assert "topics" not in options(found, "driver")  # which it knows by itself


def test_a_publisher_for_a_program_uses_the_programs_topic_name(folder: Path) -> None:
    (folder / "their.config").write_text("LaserProxy = laser:tcp -p 10003\n")
    program = f'Component driver {{ {PROGRAM} config "their.config"; }};'
    found = planned(folder, f"namespace robot1; middleware ice; Component sensor {{ }}; {program}")
    assert options(found, "sensor")["topics"] == {"/robot1/sensor/LaserPub": "LaserPub"}


def test_a_program_that_asks_another_icestorm_is_an_error(folder: Path) -> None:
    their = "LaserProxy = laser:tcp -p 10003\nTopicManager.Proxy = IceStorm/TopicManager:default -p 9899\n"
    (folder / "their.config").write_text(their)
    (folder / "own.toml").write_text('[transports.ice]\nstorm = "IceStorm/TopicManager:tcp -p 9899"\n')
    program = f'Component driver {{ {PROGRAM} config "their.config"; }};'
    assert errors(folder, f"middleware ice; {program} Component sensor {{ }};") == ["middleware-mismatch"]
    assert errors(folder, f'middleware ice; {program} Component sensor {{ config "own.toml"; }};') == []


def test_an_error_in_the_configuration_of_a_program_is_reported_there(folder: Path) -> None:
    (folder / "their.config").write_text("\nLaser.Endpoints = laser:tcp -p 11000\n")
    body = f'Component sensor {{ {PROGRAM} config "their.config"; }}; Component driver {{ }};'
    _, diagnostics = plan(folder, body)
    [found] = [each for each in diagnostics if each.severity == "error"]
    source = found.span.source
    assert (found.code, source.path.name) == ("config-bad-address", "their.config")
    assert source.position(found.span.start)[0] == 2


def test_a_program_of_which_nothing_says_where_it_is_is_an_error(folder: Path) -> None:
    [said] = told(folder, f"Component sensor {{ {PROGRAM} }}; Component driver {{ }};")
    assert said.startswith(
        "no-address: the port at which the program `sensor` serves `Laser` for `driver` is unknown; add its port"
    )


def test_a_proxy_in_the_components_own_configuration_is_kept(folder: Path) -> None:
    (folder / "old.config").write_text("LaserProxy = laser:tcp -p 12000\n")
    body = f'Component sensor {{ {PROGRAM} }}; Component driver {{ middleware ice; config "old.config"; }};'
    found = planned(folder, body)
    assert options(found, "driver")["proxies"]["sensor/Laser"] == "laser:tcp -p 12000"


def test_what_a_program_uses_is_served_where_that_expects_it(folder: Path) -> None:
    (folder / "their.config").write_text("LaserProxy = laser:tcp -h localhost -p 10003\n")
    body = "Component sensor {{ {} }}; Component driver {{ " + PROGRAM + ' config "their.config"; }};'
    body = body.replace("{{", "{").replace("}}", "}")
    assert options(planned(folder, body.replace("{}", "")), "sensor") == {"endpoints": {"Laser": "tcp -p 10003"}}
    [said] = told(folder, body.replace("{}", "port 10005;"))
    assert said.startswith("no-address: `driver` expects `Laser` at port 10003, but `sensor` has 10005")


def test_a_program_that_uses_a_provider_with_unknown_port_is_an_error(folder: Path) -> None:
    [said] = told(folder, f"Component sensor {{ }}; Component driver {{ {PROGRAM} }};")
    assert said.startswith("no-address: `driver` uses `Laser` of `sensor`, whose port is unknown")


def test_what_runs_outside_of_the_network_is_found_by_its_proxy(folder: Path) -> None:
    (folder / "old.config").write_text("LaserProxy = laser:tcp -h localhost -p 10003\n")
    body = 'Component driver { config "old.config"; };'
    found = planned(folder, body, OVER_ICE)
    note = "`driver` finds `Laser` over ice outside of the network: laser:tcp -h localhost -p 10003"
    assert [each for each in found.notes if "outside" in each] == [note]
    assert errors(folder, body) == ["no-provider"]  # it does not go over Ice


# On several.


def test_between_hosts_both_ends_get_addresses(folder: Path) -> None:
    body = f"security open; middleware ice; {ONBOARD} Component sensor {{ host onboard; }}; Component driver {{ }};"
    found = planned(folder, body)
    sensor, driver = options(found, "sensor"), options(found, "driver")
    assert sensor["host"] == "192.168.1.10"
    [endpoint] = sensor["endpoints"].values()
    assert driver["proxies"] == {"sensor/Laser": f"laser:{endpoint.replace('tcp', 'tcp -h 192.168.1.10')}"}
    assert (
        sensor["storm"]
        == driver["storm"]
        == found.helpers[0].options["storm"]
        == "IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9999"
    )


def test_an_icestorm_at_another_port_is_the_same_one_for_all_hosts(folder: Path) -> None:
    for name in ("sensor", "driver"):
        (folder / f"{name}.toml").write_text('[transports.ice]\nstorm = "IceStorm/TopicManager:tcp -p 9899"\n')
    body = f"""
    security open; middleware ice; {ONBOARD}
    Component sensor {{ host onboard; config "sensor.toml"; }}; Component driver {{ config "driver.toml"; }};
    """
    found = planned(folder, body)
    [helper] = found.helpers
    storm = helper.options["storm"]
    assert options(found, "sensor")["storm"] == options(found, "driver")["storm"] == storm
    assert "-h 127.0.0.1" in storm  # of who launches it


def test_an_instance_of_a_system_is_found_by_its_full_name(folder: Path) -> None:
    body = f"""
    security open; middleware ice; {ONBOARD}
    System left {{ Component sensor {{ host onboard; port 10003; }}; Component driver {{ }}; }};
    """
    found = planned(folder, body)
    assert options(found, "left/driver")["proxies"] == {"/left/sensor/Laser": "laser:tcp -h 192.168.1.10 -p 10003"}


def test_the_security_clause_decides_whether_ice_may_cross_hosts(folder: Path) -> None:
    body = f"middleware ice; {ONBOARD} Component sensor {{ host onboard; }}; Component driver {{ }};"
    assert errors(folder, body) == ["insecure"]
    assert errors(folder, f"security open; {body}") == []
    said = told(folder, f"security lan; {body}")
    assert all("Ice as RoboComp's programs speak it has neither authentication nor encryption" in each for each in said)
    assert all("use zeromq or zenoh, or `security open;`" in each for each in said)


def test_a_proxy_on_another_machine_needs_the_network_to_be_open(folder: Path) -> None:
    (folder / "old.config").write_text("LaserProxy = laser:tcp -h 10.0.0.2 -p 10003\n")
    body = 'Component driver { config "old.config"; };'
    [said] = told(folder, body, OVER_ICE)
    assert said.startswith("insecure: `driver` connects to tcp://10.0.0.2:10003, which `security local` does not allow")
    assert "or write `security open;`" in said
    assert "security lan" not in said
    assert errors(folder, f"security open; {body}", OVER_ICE) == []
