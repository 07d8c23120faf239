"""What an agent may see and do in a network, from the plan that it runs by. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Permissions:
    """The names are those of channels: with the namespace, and the systems around an instance."""

    network: str
    instances: frozenset[str]
    """The instances of the network, by the beginning of the names of their channels."""
    calls: Sequence[str] = field(default=())
    """The queries and commands that may be called: `robot1/wander/GotoPoint/go`."""
    goals: Sequence[str] = field(default=())
    """The actions whose goals may be begun: `robot1/arm/Navigation/goTo`."""
    publications: Sequence[str] = field(default=())
    """The topics that may be published, by the instance that subscribes to them: `robot1/base/SpeedPub/wanted`."""

    @property
    def all(self) -> tuple[str, ...]:
        return (*self.calls, *self.goals, *self.publications)

    def has(self, instance: str) -> bool:
        return instance.strip("/") in self.instances


def permissions_of(plan: Mapping[str, Any]) -> Permissions:
    """Those of a plan as JSON, such as `deploy.client.running_plan` reads."""
    named = {name: dict(_named(plan, name)) for name in _instances(plan)}
    prefixes = {name: _prefix(plan, name) for name in named}
    everywhere = {*prefixes.values(), *(each for names in named.values() for each in names.values())}
    allowed: dict[str, list[str]] = {"call": [], "goal": [], "publication": []}
    for each in plan.get("allow", ()):
        prefix = _beside(_prefix(plan, each["instance"]), each["named"])
        allowed[each["kind"]].append(f"{prefix}/{each['interface']}/{each['operation']}")
    everywhere |= {path.rsplit("/", 2)[0] for paths in allowed.values() for path in paths}
    return Permissions(str(plan.get("name", "")), frozenset(everywhere), *map(tuple, allowed.values()))


def _instances(plan: Mapping[str, Any]) -> list[str]:
    return [each for process in plan.get("processes", ()) for each in process.get("instances", ())]


def _prefix(plan: Mapping[str, Any], instance: str) -> str:
    """What its channels begin with; of a foreign program its name, since it chooses them itself."""
    channels = plan.get("ours", {}).get(instance, {}).get("channels", instance)
    return str(channels).strip("/")


def _named(plan: Mapping[str, Any], instance: str) -> Iterator[tuple[str, str]]:
    """The named instances of an instance that others use, and what their channels begin with."""
    for link in plan.get("links", ()):
        if link.get("provider") == instance and link.get("named"):
            yield link["named"], _beside(_prefix(plan, instance), link["named"])


def _beside(prefix: str, named: str) -> str:
    """A named instance stands beside the one that offers it."""
    above = prefix.rpartition("/")[0]
    return "/".join(filter(None, (above, named))) if named else prefix
