"""How instances on several hosts find each other: pure, from where they run and who uses whom.

The deployment side of each transport (`transports.deployment`) says what its instances need. Only what crosses between
hosts leaves loopback: an instance that is used on its own host alone gets no setting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ..runtime.effective import toml
from ..transports.deployment import deployment_of
from ..transports.network import Helper, Network, Refusal, named
from .routes import Fault


@dataclass(frozen=True)
class Wiring:
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By instance, `key=value`."""
    helpers: tuple[Helper, ...] = ()
    faults: tuple[Fault, ...] = ()


def wire(network: Network) -> Wiring:
    """The settings that let instances on several hosts meet, and what is wrong with that."""
    names = sorted({way.middleware for way in network.ways} - {""})  # "": not generated yet, which is said elsewhere
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


def _shared_ports(network: Network, helpers: Sequence[Helper]) -> Iterator[Fault]:
    """A network has one port for a helper of each host, and one folder of keys."""
    first: dict[str | None, Helper] = {}
    for helper in (each for each in helpers if each.addresses):
        other = first.setdefault(helper.host, helper)
        if other is not helper:
            way = next(way for way in network.over(helper.middleware).crossing())
            both = f"`{other.middleware}` and `{helper.middleware}`"
            message = f"{both} each need a helper {named(helper.host or '')}, and there is a port for one of them"
            yield Fault("unfit-middleware", message, "use one of them between hosts", way.client, other=way.provider)


def _fault(refusal: Refusal) -> Fault:
    way = refusal.way
    return Fault(refusal.code, refusal.message, refusal.hint, way.client, other=way.provider, port=way.port)


def addresses_of(
    hosts: Mapping[str, str], resolve: Callable[[str], str], towards: Callable[[str], str]
) -> dict[str, str]:
    """By host, also this one, the number at which the others reach it.

    `resolve` gives the number of a name, and `towards` our own number on the way to one; both raise OSError.
    """
    found = {name: resolve(address) for name, address in hosts.items()}
    return {"": towards(next(iter(found.values()))), **found} if found else {}
