"""How instances on several hosts find each other. Pure: computed from their hosts and links.

The deployment side of each transport (`transports.deployment`) says what its instances need. Only what crosses between
hosts leaves loopback: an instance that is used on its own host alone gets no setting.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..runtime.effective import toml
from ..transports.deployment import deployment_of, deployments
from ..transports.network import Fault, Helper, Network, Refusal, named


@dataclass(frozen=True)
class Wiring:
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By instance, `key=value`."""
    helpers: tuple[Helper, ...] = ()
    faults: tuple[Fault, ...] = ()


@dataclass(frozen=True)
class Placement:
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By instance, `key=value`."""
    taken: Mapping[str, int] = field(default_factory=dict)
    """By instance, how many ports from its `port` on are those of its interfaces."""
    faults: tuple[Fault, ...] = ()
    helpers: tuple[Helper, ...] = ()
    programs: Mapping[str, Mapping[tuple[str, str], str]] = field(default_factory=dict)
    """By transport, as `publishers`: see `transports.network.Placement`."""
    publishers: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)


def wire(network: Network) -> Wiring:
    """The settings that let instances on several hosts meet, and what is wrong with that."""
    names = sorted(
        {way.middleware for way in network.ways} - {""}
    )  # "": not generated yet, which is reported elsewhere
    wirings = {name: deployment_of(name).wire(network.over(name)) for name in names}
    if refusals := {each.message: each for wiring in wirings.values() for each in wiring.refusals}:
        return Wiring(faults=tuple(map(_fault, refusals.values())))
    settings: dict[str, tuple[str, ...]] = {}
    for name, wiring in wirings.items():
        for instance, options in wiring.options.items():
            given = (f"transports.{name}.{key}={toml(value)}" for key, value in options.items())
            settings[instance] = (*settings.get(instance, ()), *given)
    helpers = tuple(helper for wiring in wirings.values() for helper in wiring.helpers)
    return Wiring(settings, helpers, tuple(_shared_ports(network, helpers)))


def place(network: Network) -> Placement:
    """The places of interfaces with ports of their own, of all transports."""
    taken: dict[str, int] = {}
    settings: dict[str, list[str]] = {}
    faults: list[Fault] = []
    helpers: list[Helper] = []
    programs: dict[str, Mapping[tuple[str, str], str]] = {}
    publishers: dict[str, Mapping[str, Mapping[str, Any]]] = {}
    for name, each in deployments().items():
        if not each.ports_of_interfaces:
            continue
        found = each.place(network.over(name))
        for instance, count in found.taken.items():
            taken[instance] = taken.get(instance, 0) + count
        for instance, options in found.options.items():
            given = (f"transports.{name}.{key}={toml(value)}" for key, value in options)
            settings.setdefault(instance, []).extend(given)
        faults += found.faults
        helpers += found.helpers
        if found.programs:
            programs[name] = found.programs
        if found.publishers:
            publishers[name] = found.publishers
    told = {name: tuple(each) for name, each in settings.items()}
    return Placement(told, taken, tuple(faults), tuple(helpers), programs, publishers)


def _shared_ports(network: Network, helpers: Sequence[Helper]) -> Iterator[Fault]:
    """A network has one port for a helper of each host, and one folder of keys."""
    first: dict[str | None, Helper] = {}
    for helper in (each for each in helpers if each.addresses or _names(each.options, network.helper_port)):
        other = first.setdefault(helper.host, helper)
        if other is not helper:
            way = next(way for way in network.over(helper.middleware).crossing())
            both = f"`{other.middleware}` and `{helper.middleware}`"
            message = f"{both} each need a helper {named(helper.host or '')}, but there is a port for only one of them"
            yield Fault("unfit-middleware", message, "use one of them between hosts", way.client, other=way.provider)


def _names(options: Any, port: int) -> bool:
    """Whether options name a port: as a number, or in a text such as `tcp://10.0.0.1:20000`."""
    if isinstance(options, Mapping):
        return any(_names(each, port) for each in options.values())
    if isinstance(options, list | tuple):
        return any(_names(each, port) for each in options)
    return bool(re.search(rf"(?<!\d){port}(?!\d)", str(options)))


def _fault(refusal: Refusal) -> Fault:
    way = refusal.way
    return Fault(refusal.code, refusal.message, refusal.hint, way.client, other=way.provider, port=way.port)


def addresses_of(
    hosts: Mapping[str, str], resolve: Callable[[str], str], towards: Callable[[str], str]
) -> dict[str, str]:
    """The number at which the others reach each host, including this one.

    `resolve` gives the number of a name, and `towards` this machine's number on the route to one; both raise OSError.
    """
    found = {name: resolve(address) for name, address in hosts.items()}
    return {"": towards(next(iter(found.values()))), **found} if found else {}
