"""ZeroMQ as a deployment sees it: a provider binds at its host's address, and its clients are told where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ..deployment import Deployment, Reached

if TYPE_CHECKING:
    from ..network import Network, Site, Wiring


class ZeroMQDeployment(Deployment):
    summary = "bytes through sockets of ZeroMQ"
    colour = "#b3261e"
    directory = "zeromq"
    crosses_hosts = keyed = True
    unprotected = ""  # other machines are let in only by their keys
    shares = False
    longest_socket = "zeromq/4194304-01234567-router"
    modules = (("zmq", "pyzmq"), ("msgpack", "msgpack"))

    def wire(self, network: Network) -> Wiring:
        from ..network import PORTS, Refusal, Wiring  # only plans need these

        crossing = network.crossing()
        lacking = {site.instance for site in network.without_port(network.sites)}
        hint = "give it one of its own: port 7411;"
        refusals = tuple(
            Refusal(
                way,
                f"`{way.provider}` needs a port, and the network has only those for {PORTS - 1} instances",
                hint,
                "no-address",
            )
            for way in crossing
            if way.provider in lacking
        )
        if refusals:
            return Wiring(refusals=refusals)

        def bind(site: Site) -> str:
            return f"tcp://{network.endpoint(site.host, network.port(site))}"

        options: dict[str, dict[str, Any]] = {}
        for site in network.configured:  # also those of one process have each their own
            if any(way.provider == site.instance for way in crossing):
                options.setdefault(site.instance, {})["bind"] = bind(site)
            used = sorted({way.provider for way in crossing if way.client == site.instance})
            if used:
                there = {provider: bind(network.by_name[provider]) for provider in used}
                options.setdefault(site.instance, {})["connect"] = there
        return Wiring(options)

    def at_port(self, port: int) -> Mapping[str, Any]:
        return {"bind": f"tcp://127.0.0.1:{port}" if port else ""}

    def reached(self, options: Mapping[str, Any]) -> Iterator[Reached]:
        if bind := options.get("bind"):
            yield Reached("listens at", str(bind))
        connect = options.get("connect")
        for address in connect.values() if isinstance(connect, Mapping) else ():
            yield Reached("connects to", str(address))

    def key_pair(self) -> tuple[bytes, bytes]:
        import zmq  # the middleware itself, to make keys

        public, secret = zmq.curve_keypair()
        return public, secret
