"""Deployment over Ice. `places` computes the addresses of the objects in a network."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..deployment import Completion, Deployment, Incomplete, Reached

if TYPE_CHECKING:
    from ...contract.parameters import Complaint
    from ..iceoptions import IceEndpoint, IceOptions
    from ..network import Network, Placement, Wiring


class IceDeployment(Deployment):
    summary = "ZeroC Ice, as RoboComp's own programs speak it"
    colour = "#0e7490"
    directory = "ice"
    crosses_hosts = True
    unprotected = "Ice as RoboComp's programs speak it has neither authentication nor encryption"
    ports_of_interfaces = True
    shares = False  # topics need IceStorm, and calls need nothing
    modules = (("Ice", "zeroc-ice"),)

    def place(self, network: Network) -> Placement:
        from . import places  # only for a network with something to place

        return places.find(network)

    def wire(self, network: Network) -> Wiring:
        from ..network import Wiring

        return Wiring()

    def examine(self, options: Mapping[str, Any]) -> Iterator[Complaint]:
        from ..iceoptions import examine  # only a component that may use Ice needs these options

        return examine(options)

    def complete(self, options: Mapping[str, Any], of: Incomplete) -> Iterator[Complaint | Completion]:
        from . import ports  # only for a component that may use Ice

        return ports.complete(options, of)

    def observing(self, options: Mapping[str, Any], address: str) -> Mapping[str, Any]:
        """IceStorm calls those that hear topics, also from another host."""
        if "storm" not in options:
            return {}
        host = options.get("host") or address
        return {"storm": options["storm"], **({"host": host} if host else {})}

    def outside(self, options: Mapping[str, Any], channel: str) -> str:
        from ..iceoptions import read

        return read(options).proxy_of(channel) or ""

    def reaching(self, programs: Mapping[str, str]) -> Mapping[str, Any]:
        from ..iceoptions import key_of

        return {"proxies": {key_of(channel): proxy for channel, proxy in programs.items()}}

    def hearing(self, topics: Mapping[str, Mapping[str, Any]]) -> Iterable[tuple[Mapping[str, Any], Sequence[str]]]:
        """RoboComp's programs have no namespaces: their topics are called as their interfaces, unless they say more."""
        from ...wire import names
        from ..iceoptions import key_of

        by_storm: dict[tuple[str, str], dict[str, str]] = {}
        for channel, program in topics.items():
            name = program["topics"].get(names.segment(channel), names.segment(channel))
            by_storm.setdefault((program["storm"], program["host"]), {})[channel] = name
        for (storm, host), called in by_storm.items():
            said = {key_of(channel): name for channel, name in called.items()}
            yield {"storm": storm, "host": host, "topics": said}, list(called)

    def published(self, options: Mapping[str, Any], channels: Collection[str]) -> Collection[str]:
        from ..iceoptions import read
        from .storm import Place

        told = read(options)
        known = Place.of(told).topics({told.topic_of(each) for each in channels})
        return [each for each in channels if told.topic_of(each) in known]

    def reached(self, options: Mapping[str, Any]) -> Iterator[Reached]:
        from .. import iceoptions

        told = iceoptions.read(options)
        served = [each for text in told.endpoints.values() for each in iceoptions.parse_endpoints(text)]
        for each in (iceoptions.IceEndpoint("tcp", told.host), *served):
            yield Reached("listens at", _address(each, told))
        said = [] if told.storm == iceoptions.STORM else [told.storm]  # else it is wherever we are
        for text in (*told.proxies.values(), *said):
            for each in iceoptions.parse_proxy(text).endpoints:
                yield Reached("connects to", _address(each, told))


def _address(endpoint: IceEndpoint, options: IceOptions) -> str:
    host = endpoint.host or options.host
    return f"tcp://{f'[{host}]' if ':' in host else host}:{endpoint.port or '*'}"
