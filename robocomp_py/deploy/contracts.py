"""The contracts that the instances of a network run, compared with each other and with the generated ones.

An interface may be changed, and its components generated again, while the network runs. From then on, a component that
starts has the new contract, and running ones have the old contract: they cannot communicate.

Pure, except for `generated` and `generated_contracts`, which read generic parts.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # `rcdeploy status` is quick to import
    from .snapshot import ProcessStatus

Operations = Mapping[str, str]
"""As `Component.fingerprints` returns them."""

Contracts = Mapping[str, Operations]
"""By instance."""


@dataclass(frozen=True, slots=True)
class BrokenLink:
    """Two instances that are linked by an interface, but have different contracts of it."""

    interface: str
    provider: str
    client: str


@dataclass(frozen=True, slots=True)
class RestartEffect:
    """The effect of restarting some instances of a network."""

    broken: tuple[BrokenLink, ...]
    """The links that would stop working."""
    together: tuple[str, ...]
    """The other instances that must restart with them, so that these links work."""


def generated(folder: Path) -> dict[str, str] | None:
    """The contracts in the generic part of a component; None if it has none, as for some middlewares."""
    files = sorted((folder / "generic").glob("*/channels.json"))
    found: dict[str, str] = {}
    try:
        for file in files:
            channels = json.loads(file.read_text(encoding="utf-8"))["channels"]
            found |= {str(each["operation"]): str(each["fingerprint"]) for each in channels}
    except (OSError, ValueError, TypeError, KeyError):  # incomplete, or by another version
        return None
    return found or None


def outdated(running: Contracts, current: Contracts) -> dict[str, list[str]]:
    """The instances whose contract differs from the generated one, with the interfaces that differ."""
    found = {
        name: sorted({_interface(each) for each in _differing(operations, current[name])})
        for name, operations in running.items()
        if name in current
    }
    return {name: interfaces for name, interfaces in found.items() if interfaces}


def broken_links(links: Iterable[Mapping[str, Any]], running: Contracts) -> list[BrokenLink]:
    """The links whose two ends have different contracts. `links` are those of a plan, as JSON."""
    found = []
    for link in links:
        client, provider = running.get(link["client"]), running.get(link["provider"])
        if client is None or provider is None:
            continue
        wanted = {name: client[name] for name in client if _interface(name) == link["interface"]}
        if any(provider.get(name) != fingerprint for name, fingerprint in wanted.items()):
            found.append(BrokenLink(link["interface"], link["provider"], link["client"]))
    return found


def effect_of_restart(
    links: Sequence[Mapping[str, Any]], running: Contracts, current: Contracts, restarted: Collection[str]
) -> RestartEffect:
    """The effect on the links of restarting some instances with their generated contracts."""
    before, group = broken_links(links, running), dict.fromkeys(restarted)
    old = outdated(running, current)

    def newly_broken() -> list[BrokenLink]:
        after = broken_links(links, {**running, **{name: current[name] for name in group if name in current}})
        return [each for each in after if each not in before]

    first = newly_broken()
    while more := [end for link in newly_broken() for end in (link.provider, link.client) if end in old.keys() - group]:
        group |= dict.fromkeys(more)
    return RestartEffect(tuple(first), tuple(name for name in group if name not in restarted))


def running_contracts(processes: Iterable[ProcessStatus]) -> dict[str, Operations]:
    """The contracts of the running instances."""
    return {name: each.contracts[name] for each in processes if not each.state.gone for name in each.contracts}


def generated_contracts(plan: Mapping[str, Any]) -> dict[str, Operations]:
    """The contracts that the instances of a plan, as JSON, would have after a restart; reads their generic parts.

    An instance on another host would run the copy that was sent there when the network started.
    """
    remote = {name for each in plan.get("processes", ()) if each["host"] for name in each["instances"]}
    ours = plan.get("ours", {})
    there = {folder: generated(Path(folder)) for folder in {each["folder"] for each in ours.values()}}
    found: dict[str, Operations] = {}
    for name, contract in ours.items():
        operations = contract["operations"] if name in remote else there[contract["folder"]]
        if operations:
            found[name] = operations
    return found


def sentences(network: str, broken: Iterable[BrokenLink], outdated: Mapping[str, Sequence[str]]) -> list[str]:
    """Messages about broken links and outdated instances; `network` is the network as the user names it."""
    told = [
        f"{each.client} uses `{each.interface}` of {each.provider}, but they have different contracts of it: "
        "calls between them fail"
        for each in broken
    ]
    for name, interfaces in outdated.items():
        said = ", ".join(f"`{each}`" for each in interfaces)
        told.append(f"{name} runs an older contract of {said} than the generated one")
    if outdated:
        told.append(f"to restart with the new contract: rcdeploy restart {shlex.join((network, *outdated))}")
    return told


def _differing(one: Operations, other: Operations) -> set[str]:
    return {name for name in one.keys() | other.keys() if one.get(name) != other.get(name)}


def _interface(operation: str) -> str:
    """`Laser` for `RoboCompLaser::Laser.getLaserData`."""
    return operation.rpartition(".")[0].rpartition("::")[2]
