"""Deployment over DDS: participants use their host's address and know all peers' addresses; no multicast."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..census import Told
from ..deployment import Deployment, Reached

if TYPE_CHECKING:
    from ..network import Network, Wiring

FIRST_DOMAIN = 100
"""First domain of networks on several hosts. Only programs configured for such a domain join it."""

MANY = 24
"""With more instances than this, option `many` is set: in DDS each one talks to all others."""


class DDSDeployment(Deployment):
    summary = "for tools of DDS, which see every topic"
    colour = "#c06a00"
    crosses_hosts = True
    unprotected = "DDS as pip installs it has neither authentication nor encryption"
    shares = False
    modules = (("cyclonedds", "cyclonedds"),)

    def census(self, options: Mapping[str, Any]) -> list[Told]:
        with self.asking(options) as heard:
            return heard()

    @contextmanager
    def asking(self, options: Mapping[str, Any]) -> Iterator[Callable[[], list[Told]]]:
        from ..runtime_folder import runtime_dir

        if not options and not any(runtime_dir("dds").glob("served-*/*")):
            yield list  # nothing: each component serves something
            return
        from .census import asking  # imports the middleware, which takes long

        with asking(options) as heard:
            yield heard

    def wire(self, network: Network) -> Wiring:
        from ..network import Refusal, Wiring, block_of  # only plans need these

        refusals = tuple(
            Refusal(
                way,
                f"`{network.middleware}` supports IPv4 addresses only, but has to carry `{way.interface}` "
                f"between {network.between(way)}",
                "give the hosts IPv4 addresses",
            )
            for way in network.crossing()
            if any(":" in network.address(network.by_name[end]) for end in (way.client, way.provider))
        )
        options: dict[str, dict[str, Any]] = {}
        for processes in _connected(network):
            sites = [site for site in network.sites if site.process in processes]
            peers = [network.addresses[host] for host in dict.fromkeys(site.host for site in sites)]
            for site in sites if len(peers) > 1 else ():
                if not site.is_program:
                    domain, interface = FIRST_DOMAIN + block_of(network.name), network.address(site)
                    options[site.instance] = {"domain": domain, "interface": interface, "peers": peers}
        users = {end for way in network.ways for end in (way.client, way.provider)}
        for name in sorted(users) if len(users) > MANY else ():
            if "many" not in network.by_name[name].options.get(network.middleware, {}):
                options.setdefault(name, {})["many"] = True
        return Wiring({} if refusals else options, refusals=refusals)

    def reached(self, options: Mapping[str, Any]) -> Iterator[Reached]:
        if (interface := options.get("interface", "lo")) != "lo":
            yield Reached("uses the network interface", str(interface) or "that DDS chooses")


def _connected(network: Network) -> list[set[str]]:
    """The groups of processes that are connected, directly or through others."""
    groups: list[set[str]] = []
    for way in network.ways:
        pair = {network.by_name[end].process for end in (way.client, way.provider)}
        touched: Iterable[set[str]] = [group for group in groups if group & pair]
        groups = [group for group in groups if group not in touched] + [pair.union(*touched)]
    return groups
