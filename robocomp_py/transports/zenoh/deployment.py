"""Deployment over Zenoh: one router on each host, connected to each other; components use their host's router."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..census import Told
from ..deployment import Deployment, Reached

if TYPE_CHECKING:
    from ..network import Helper, Network, Refusal, Wiring
    from ..permissions import Graph


class ZenohDeployment(Deployment):
    summary = "for hosts that are linked by thin or changing networks"
    colour = "#7b3fb5"
    crosses_hosts = keyed = True
    unprotected = ""  # the routers admit other machines only by certificate
    longest_socket = "zenoh/router.sock"
    modules = (("zenoh", "eclipse-zenoh"),)

    def census(self, options: Mapping[str, Any]) -> list[Told]:
        from ..runtime_folder import runtime_dir

        if not options and not (runtime_dir("zenoh") / "router.sock").exists():
            return []  # without a router, nothing can be there
        from .census import census  # imports the middleware, which takes long

        return census(options)

    def wire(self, network: Network) -> Wiring:
        from ..network import Wiring  # only plans need it

        crossing = network.crossing()
        refusals = tuple(_clashes(network))
        hosts, encrypted = network.hosts(crossing), network.encrypted
        if not hosts or refusals:
            return Wiring(refusals=refusals)
        kind, port = "tls" if encrypted else "tcp", network.helper_port
        here = f"tls/127.0.0.1:{port}" if encrypted else f"here/{network.name}"
        routers = [f"{kind}/{network.endpoint(host, port)}" for host in hosts]
        helpers = tuple(
            router(
                host,
                {
                    "connect": f"here/{network.name}",
                    "router": {
                        "listen/endpoints": [routers[number], *([here] if encrypted else [])],
                        "connect/endpoints": routers[:number],  # of each pair, the later one connects
                    },
                },
                network.addresses[host],
            )
            for number, host in enumerate(hosts)
        )
        processes = {network.by_name[end].process for way in network.ways for end in (way.client, way.provider)}
        options = {
            site.instance: {"connect": here}
            for site in network.configured
            if site.host in hosts and site.process in processes
        }
        return Wiring(options, helpers)

    def reached(self, options: Mapping[str, Any]) -> Iterator[Reached]:
        """Where components connect to, and where a router listens: its components connect from any host."""
        listening = options.get("router", {}).get("listen/endpoints", ())
        for each in filter(None, (options.get("connect"), *listening)):
            instead = "write tls/ADDRESS:PORT, which `security lan` requires, or remove it: rcdeploy sets it"
            yield Reached("connects to", str(each), "" if str(each).startswith("tls/") else instead)

    def visiting(self, options: Mapping[str, Any], keys: str, *, is_here: bool) -> Mapping[str, Any]:
        listening = options.get("router", {}).get("listen/endpoints", ())
        endpoints = [str(each) for each in listening if str(each).startswith("tls/")]
        if not endpoints:
            return {}
        return {"connect": endpoints[-1 if is_here else 0], "keys": keys}  # the last one is that of its own host

    def secured(self, helper: Helper, graph: Graph, folder: Path, numbers: Mapping[str, int]) -> Mapping[str, Any]:
        from .access import access_control

        tls = {
            "root_ca_certificate": f"{folder}/ca.pem",
            "listen_certificate": f"{folder}/certificate.pem",
            "listen_private_key": f"{folder}/key.pem",
            "connect_certificate": f"{folder}/certificate.pem",
            "connect_private_key": f"{folder}/key.pem",
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
        settings = {
            **helper.options.get("router", {}),
            **{f"transport/link/tls/{key}": value for key, value in tls.items()},
            "transport/link/protocols": ["tls", "unixsock-stream"],
            "access_control": access_control(graph, helper.host or "", numbers),
        }
        return {**helper.options, "router": settings}


def router(host: str, options: Mapping[str, Any], *addresses: str) -> Helper:
    """The router of a host."""
    from ..network import Helper

    return Helper("zenoh", host, options, "zenoh-router", "Zenoh", (*addresses, "127.0.0.1"))


def _clashes(network: Network) -> Iterator[Refusal]:
    from ..network import Refusal, named

    first: dict[str, str] = {}
    crossing = network.crossing()
    for host in network.hosts(crossing):
        address = network.addresses[host]
        other = first.setdefault(address, host)
        if other != host:
            way = next(each for each in crossing if host in network.hosts([each]))
            both = f"{named(other)} and {named(host)}, which are both at {address}"
            message = f"`{network.middleware}` needs a router {both}: only one of the two can listen there"
            hint = (
                f"make them one `host`, or name another middleware than `{network.middleware}`, {network.default} say"
            )
            yield Refusal(way, message, hint)
