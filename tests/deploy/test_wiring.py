"""How instances on several hosts find each other."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.wiring import DDS_DOMAIN, Network, Site, Wiring, addresses_of, wire, with_crowds

HERE, ROBOT, BASE = "10.0.0.1", "10.0.0.10", "10.0.0.11"


def way(client: str, provider: str, middleware: str) -> Way:
    return Way(client, "laser", provider, Verb.REQUIRES, "Laser", "getLaserData", middleware, "")


def network(sites: Sequence[Site], *ways: Way, name: str = "Patrol", **more: Any) -> Network:
    return Network(name, {"": HERE, "robot": ROBOT, "base": BASE}, sites, ways, **more)


def site(instance: str, host: str = "", **more: Any) -> Site:
    return Site(instance, more.pop("process", instance), host, **more)


def read(wiring: Wiring, instance: str) -> Mapping[str, Any]:
    """The settings of an instance, as it will read them."""
    found = tomllib.loads("\n".join(wiring.settings.get(instance, ())))
    return dict(found.get("transports", {}))


LASER, WANDER = site("laser", "robot"), site("wander", "base")


def test_who_is_used_over_zeromq_from_another_host_binds_at_the_address_of_its_own():
    wiring = wire(network([LASER, WANDER], way("wander", "laser", "zeromq")))
    bind = read(wiring, "laser")["zeromq"]["bind"]
    assert bind.startswith(f"tcp://{ROBOT}:")
    assert read(wiring, "wander")["zeromq"] == {"connect": {"laser": bind}}


@pytest.mark.parametrize("middleware", ["zeromq", "zenoh", "dds", "shm"])
def test_who_is_used_on_its_own_host_alone_stays_on_loopback(middleware: str):
    wiring = wire(network([LASER, site("wander", "robot")], way("wander", "laser", middleware)))
    assert wiring == Wiring()


def test_this_machine_is_one_of_the_hosts():
    wiring = wire(network([LASER, site("wander")], way("laser", "wander", "zeromq")))
    assert read(wiring, "wander")["zeromq"]["bind"].startswith(f"tcp://{HERE}:")


def test_addresses_are_the_same_each_time_and_differ_between_networks():
    sites = [LASER, WANDER]
    first, again, other = (wire(network(sites, way("wander", "laser", "zeromq"), name=name)) for name in "aab")
    assert first == again
    assert read(first, "laser") != read(other, "laser")


def test_instances_of_one_process_have_a_port_each():
    sites = [site("laser", "robot", process="front"), site("sonar", "robot", process="front"), WANDER]
    wiring = wire(network(sites, way("wander", "laser", "zeromq"), way("wander", "sonar", "zeromq")))
    assert read(wiring, "laser")["zeromq"]["bind"] != read(wiring, "sonar")["zeromq"]["bind"]
    assert set(read(wiring, "wander")["zeromq"]["connect"]) == {"laser", "sonar"}


def test_two_hosts_of_one_address_cannot_have_a_router_each():
    sites, addresses = [LASER, WANDER], {"": HERE, "robot": ROBOT, "base": ROBOT}
    (fault,) = wire(Network("Patrol", addresses, sites, [way("wander", "laser", "zenoh")])).faults
    assert fault.code == "unfit-middleware"
    assert f"on `robot` and on `base`, which are both at {ROBOT}" in fault.message
    assert not wire(Network("Patrol", addresses, sites, [way("wander", "laser", "zeromq")])).faults


def test_an_instance_of_a_system_is_named_whole():
    wiring = wire(network([site("left/arm", "robot"), WANDER], way("wander", "left/arm", "zeromq")))
    assert set(read(wiring, "wander")["zeromq"]["connect"]) == {"left/arm"}


def test_a_port_that_the_network_gives_is_taken():
    wiring = wire(network([site("laser", "robot", port=7411), WANDER], way("wander", "laser", "zeromq")))
    assert read(wiring, "laser")["zeromq"]["bind"] == f"tcp://{ROBOT}:7411"


def test_addresses_of_ipv6_are_bracketed():
    there = Network("Patrol", {"robot": "fd00::10", "base": BASE}, [LASER, WANDER], [way("wander", "laser", "zeromq")])
    assert read(wire(there), "laser")["zeromq"]["bind"].startswith("tcp://[fd00::10]:")


def test_components_that_meet_over_zenoh_use_the_router_of_their_host():
    wiring = wire(network([LASER, WANDER, site("map", "base")], way("wander", "laser", "zenoh")))
    assert read(wiring, "laser")["zenoh"] == read(wiring, "wander")["zenoh"] == {"connect": "here/Patrol"}
    assert read(wiring, "map") == {}


def test_of_two_zenoh_routers_one_connects_to_the_other():
    wiring = wire(network([LASER, WANDER, site("map")], way("wander", "laser", "zenoh"), way("map", "laser", "zenoh")))
    routers = {host: options["router"] for host, options in wiring.routers.items()}
    assert set(routers) == {"", "robot", "base"}
    listening = {host: router["listen/endpoints"][0] for host, router in routers.items()}
    assert listening["robot"].startswith(f"tcp/{ROBOT}:")
    assert routers[""]["connect/endpoints"] == []
    assert routers["robot"]["connect/endpoints"] == [listening[""]]
    assert routers["base"]["connect/endpoints"] == [listening[""], listening["robot"]]


def test_a_host_whose_components_meet_nobody_elsewhere_needs_no_router():
    sites = [LASER, WANDER, site("map"), site("view")]
    wiring = wire(network(sites, way("wander", "laser", "zenoh"), way("view", "map", "zenoh")))
    assert set(wiring.routers) == {"robot", "base"}


def test_routers_and_components_speak_tls_in_a_network_that_is_encrypted():
    wiring = wire(network([LASER, WANDER], way("wander", "laser", "zenoh"), encrypted=True))
    own = read(wiring, "laser")["zenoh"]["connect"]
    assert own.startswith("tls/127.0.0.1:")
    assert own in wiring.routers["robot"]["router"]["listen/endpoints"]
    assert all(each.startswith("tls/") for each in wiring.routers["base"]["router"]["connect/endpoints"])


def test_those_that_meet_over_dds_are_on_the_address_of_their_host_and_know_the_others():
    wiring = wire(network([LASER, WANDER], way("wander", "laser", "dds")))
    found = read(wiring, "laser")["dds"]
    assert found["interface"] == ROBOT
    assert found["peers"] == [ROBOT, BASE]
    assert DDS_DOMAIN <= found["domain"] == read(wiring, "wander")["dds"]["domain"]


def test_who_talks_over_dds_to_somebody_who_talks_to_another_host_has_to_meet_both():
    sites = [LASER, site("filter", "robot"), WANDER, site("view")]
    ways = way("wander", "laser", "dds"), way("filter", "laser", "dds")
    wiring = wire(network(sites, *ways))
    assert read(wiring, "filter")["dds"]["interface"] == ROBOT
    assert read(wiring, "view") == {}


@pytest.mark.parametrize("middleware", ["shm", "inproc"])
def test_what_reaches_no_other_host_is_refused_between_hosts(middleware: str):
    wiring = wire(network([LASER, WANDER], way("wander", "laser", middleware)))
    (fault,) = wiring.faults
    assert (fault.instance, fault.other) == ("wander", "laser")
    assert f"`{middleware}` does not reach other hosts" in fault.message
    assert "on `robot`" in fault.message
    assert wiring.settings == {}


def test_a_middleware_of_somebody_elses_is_not_wired_between_hosts():
    (fault,) = wire(network([LASER, WANDER], way("wander", "laser", "carrierpigeon"))).faults
    assert "`carrierpigeon`" in fault.message
    assert "zeromq, zenoh or dds" in fault.hint


def test_dds_is_not_wired_between_addresses_of_ipv6():
    there = Network("Patrol", {"robot": "fd00::10", "base": BASE}, [LASER, WANDER], [way("wander", "laser", "dds")])
    (fault,) = wire(there).faults
    assert "IPv4" in fault.message


def test_a_program_of_ones_own_is_given_no_settings():
    sites = [site("laser", "robot", is_program=True), WANDER]
    wiring = wire(network(sites, way("wander", "laser", "zeromq")))
    assert set(wiring.settings) == {"wander"}


def test_the_address_of_this_machine_is_the_one_on_the_way_to_the_others():
    numbers = {"onboard.local": ROBOT}
    found = addresses_of({"robot": "onboard.local"}, numbers.__getitem__, {ROBOT: HERE}.__getitem__)
    assert found == {"": HERE, "robot": ROBOT}


def test_a_network_without_hosts_has_no_addresses():
    assert addresses_of({}, str, str) == {}


def test_many_that_meet_over_dds_are_told_so_beside_what_they_are_told_else():
    ways = [way(f"a{n}", f"b{n}", "dds") for n in range(13)]
    told = with_crowds(Wiring({"a0": ("transports.dds.domain=3",)}), [*ways, way("c", "d", "zeromq")])
    assert read(told, "a0")["dds"] == {"domain": 3, "many": True}
    assert told.settings["b12"] == ("transports.dds.many=true",)
    assert "c" not in told.settings


def test_as_many_changes_nothing_for_a_few_or_over_other_middlewares():
    few = [way(f"a{n}", f"b{n}", "dds") for n in range(12)]
    others = [way(f"a{n}", f"b{n}", "zenoh") for n in range(50)]
    assert with_crowds(Wiring(), [*few, *others]) == Wiring()


def test_who_says_itself_whether_many_meet_is_not_told():
    ways = [way(f"a{n}", f"b{n}", "dds") for n in range(13)]
    told = with_crowds(Wiring(), ways, settled={"a0"})
    assert told.settings.keys() == {name for each in ways for name in (each.client, each.provider)} - {"a0"}
