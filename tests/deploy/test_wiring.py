"""How instances on several hosts find each other."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy import wiring
from robocomp_py.deploy.wiring import Wiring, addresses_of, wire
from robocomp_py.transports.dds.deployment import FIRST_DOMAIN
from robocomp_py.transports.deployment import Deployment, deployment_of
from robocomp_py.transports.network import PORTS, Helper, Network, Site, Way, block_of, free_ports, ports_of
from robocomp_py.transports.network import Wiring as Wired

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


def test_a_zeromq_server_for_another_host_binds_to_its_own_hosts_address():
    wiring = wire(network([LASER, WANDER], way("wander", "laser", "zeromq")))
    bind = read(wiring, "laser")["zeromq"]["bind"]
    assert bind.startswith(f"tcp://{ROBOT}:")
    assert read(wiring, "wander")["zeromq"] == {"connect": {"laser": bind}}


@pytest.mark.parametrize("middleware", ["zeromq", "zenoh", "dds", "shm"])
def test_a_server_for_its_own_host_stays_on_loopback(middleware: str):
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


def bound(count: int, name: str, **more: Any) -> list[int]:
    """The ports of so many instances that are used from another host."""
    sites = [site(f"laser{number}", "robot", **more) for number in range(count)]
    wiring = wire(network([*sites, WANDER], *(way("wander", each.instance, "zeromq") for each in sites), name=name))
    return [int(read(wiring, each.instance)["zeromq"]["bind"].rpartition(":")[2]) for each in sites]


def test_more_instances_than_a_block_has_ports_use_no_port_of_another_block():
    one, next_to_it = "Net1", "Net50"
    assert block_of(next_to_it) == block_of(one) + 1
    ports, others = bound(1099, one), bound(99, next_to_it)
    assert len({*ports, *others}) == 1099 + 99
    assert ports[:99] == bound(99, one)
    assert set(ports) < {port for each in ports_of(one, PORTS) for port in each}
    assert free_ports(one, 98) == ports[98:]
    assert not {*ports, *others} & set(range(32768, 61000))  # which systems give away


def test_an_instance_for_which_there_is_no_port_is_named():
    sites = [site(f"laser{number}", "robot") for number in range(1100)]
    ways = way("wander", "laser1098", "zeromq"), way("wander", "laser1099", "zeromq")
    (fault,) = wire(network([*sites, WANDER], *ways)).faults
    assert (fault.code, fault.other) == ("no-address", "laser1099")
    assert str(fault).startswith("`laser1099` needs a port, and the network has only those for 1099 instances")
    sites[-1] = site("laser1099", "robot", port=7411)
    assert not wire(network([*sites, WANDER], *ways)).faults


def test_two_hosts_of_one_address_cannot_have_a_router_each():
    sites, addresses = [LASER, WANDER], {"": HERE, "robot": ROBOT, "base": ROBOT}
    (fault,) = wire(Network("Patrol", addresses, sites, [way("wander", "laser", "zenoh")])).faults
    assert fault.code == "unfit-middleware"
    assert f"on `robot` and on `base`, which are both at {ROBOT}" in fault.message
    assert not wire(Network("Patrol", addresses, sites, [way("wander", "laser", "zeromq")])).faults


def test_an_instance_of_a_system_has_its_full_name():
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
    routers = {each.host: each.options["router"] for each in wiring.helpers}
    assert set(routers) == {"", "robot", "base"}
    listening = {host: router["listen/endpoints"][0] for host, router in routers.items()}
    assert listening["robot"].startswith(f"tcp/{ROBOT}:")
    assert routers[""]["connect/endpoints"] == []
    assert routers["robot"]["connect/endpoints"] == [listening[""]]
    assert routers["base"]["connect/endpoints"] == [listening[""], listening["robot"]]


def test_a_host_without_links_to_other_hosts_needs_no_router():
    sites = [LASER, WANDER, site("map"), site("view")]
    wiring = wire(network(sites, way("wander", "laser", "zenoh"), way("view", "map", "zenoh")))
    assert {each.host for each in wiring.helpers} == {"robot", "base"}


def test_routers_and_components_speak_tls_in_a_network_that_is_encrypted():
    wiring = wire(network([LASER, WANDER], way("wander", "laser", "zenoh"), encrypted=True))
    own = read(wiring, "laser")["zenoh"]["connect"]
    assert own.startswith("tls/127.0.0.1:")
    routers = {each.host: each.options["router"] for each in wiring.helpers}
    assert own in routers["robot"]["listen/endpoints"]
    assert all(each.startswith("tls/") for each in routers["base"]["connect/endpoints"])


def test_over_dds_instances_use_the_address_of_their_host_and_know_the_others():
    wiring = wire(network([LASER, WANDER], way("wander", "laser", "dds")))
    found = read(wiring, "laser")["dds"]
    assert found["interface"] == ROBOT
    assert found["peers"] == [ROBOT, BASE]
    assert FIRST_DOMAIN <= found["domain"] == read(wiring, "wander")["dds"]["domain"]


def test_a_dds_peer_of_a_component_with_remote_peers_uses_the_hosts_address_too():
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


def test_a_middleware_without_a_deployment_side_is_not_wired_between_hosts():
    (fault,) = wire(network([LASER, WANDER], way("wander", "laser", "carrierpigeon"))).faults
    assert "`carrierpigeon` does not reach other hosts (its transport has no deployment side)" in fault.message
    assert "name another one, zeromq say" in fault.hint


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


def many(ways: Sequence[Way], **options: Any) -> Wiring:
    """The wiring of instances of one host; `options` are those that one of them has for DDS."""
    names = dict.fromkeys(end for each in ways for end in (each.client, each.provider))
    return wire(network([site(name, options={"dds": options} if name == "a0" else {}) for name in names], *ways))


def test_many_dds_participants_get_the_option_many():
    told = many([*(way(f"a{n}", f"b{n}", "dds") for n in range(13)), way("c", "d", "zeromq")])
    assert read(told, "a0")["dds"] == {"many": True}
    assert told.settings["b12"] == ("transports.dds.many=true",)
    assert "c" not in told.settings


def test_many_dds_participants_on_several_hosts_get_the_option_many_too():
    sites = [LASER, *(site(f"a{n}") for n in range(30))]
    found = read(wire(network(sites, *(way(f"a{n}", "laser", "dds") for n in range(30)))), "a0")["dds"]
    assert found.keys() == {"domain", "interface", "peers", "many"}


def test_as_many_changes_nothing_for_a_few_or_over_other_middlewares():
    few = [way(f"a{n}", f"b{n}", "dds") for n in range(12)]
    others = [way(f"a{n}", f"b{n}", "zenoh") for n in range(50)]
    assert many([*few, *others]) == Wiring()


def test_an_instance_that_sets_many_itself_keeps_its_setting():
    ways = [way(f"a{n}", f"b{n}", "dds") for n in range(13)]
    assert many(ways, many=False).settings.keys() == {
        name for each in ways for name in (each.client, each.provider)
    } - {"a0"}


def test_two_transports_with_a_helper_each_do_not_share_a_host(monkeypatch: pytest.MonkeyPatch):
    class Relayed(Deployment):
        def wire(self, network: Network) -> Wired:
            helpers = (Helper(network.middleware, host, {}, "x-y", "X", (host,)) for host in network.addresses)
            return Wired(helpers=tuple(helpers))

    monkeypatch.setattr(wiring, "deployment_of", lambda name: Relayed() if name == "pigeon" else deployment_of(name))
    ways = way("wander", "laser", "zenoh"), way("wander", "laser", "pigeon")
    (first, *_) = wire(network([LASER, WANDER], *ways)).faults
    assert "`pigeon` and `zenoh` each need a helper" in first.message
    assert not wire(network([LASER, WANDER], ways[1])).faults


@pytest.mark.parametrize("form", [int, "tcp://10.0.0.10:{}".format, lambda port: {"relay": [f":{port}"]}])
def test_two_helpers_at_one_port_are_an_error_without_certificates_too(
    monkeypatch: pytest.MonkeyPatch, form: Callable[[int], Any]
):
    class Relayed(Deployment):
        offset = 0

        def wire(self, network: Network) -> Wired:
            options = {"listen": form(network.helper_port + self.offset)}
            return Wired(helpers=tuple(Helper(network.middleware, each, options, "x-y", "X") for each in ("robot",)))

    class Elsewhere(Relayed):
        offset = 1

    sides = {"pigeon": Relayed(), "parrot": Elsewhere()}
    monkeypatch.setattr(wiring, "deployment_of", lambda name: sides.get(name) or deployment_of(name))
    router, relay, other = (way("wander", "laser", name) for name in ("zenoh", "pigeon", "parrot"))
    (fault,) = wire(network([LASER, WANDER], router, relay)).faults
    assert "`pigeon` and `zenoh` each need a helper on `robot`" in fault.message
    assert not wire(network([LASER, WANDER], router, other)).faults
