"""Other networks that run on this machine, and whose ports between hosts are those of this one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..spelling import enumerated
from ..transports.deployment import deployments
from ..transports.network import PORTS, ports_of
from .place import Place, running
from .plan import Plan


def warnings(plan: Plan) -> list[str]:
    """A note about them for the start of this network. Raises DeploymentError if there is no run-time folder."""
    mine = _ports(plan.to_json())
    if not mine:
        return []
    found = []
    for other, theirs in running(Place(plan.name).folder.parent, _ports):
        same = [each for each in theirs if each in mine]
        if other != plan.name and same:
            which = enumerated(f"{each[0]} to {each[-1]}" for each in same)
            found.append(
                f"{other} also runs here, and its name yields the same ports between hosts as {plan.name}: {which}; "
                "if one of them cannot listen there, rename the network"
            )
    return found


def _ports(told: Mapping[str, Any]) -> tuple[range, ...]:
    """The ports that a network may give to its instances, and to interfaces with one of their own."""
    if not _crosses(told):
        return ()
    own = {name for name, each in deployments().items() if each.ports_of_interfaces}
    further = {(way["provider"], way["interface"]) for way in told["ways"] if way["middleware"] in own}
    count = 1 + sum(len(process["instances"]) for process in told["processes"]) + len(further)
    return ports_of(str(told["name"]), min(count, PORTS))


def _crosses(told: Mapping[str, Any]) -> bool:
    """Whether anything of a network is carried from one host to another."""
    host = {name: process["host"] for process in told["processes"] for name in process["instances"]}
    return any(host.get(way["client"]) != host.get(way["provider"]) for way in told["ways"])
