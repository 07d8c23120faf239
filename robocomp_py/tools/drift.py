"""The difference between what a network declares and what runs. Pure.

declared, and runs             present
declared, and does not run     missing: an instance, or a use that is not connected over the declared middleware
declared, and not visible      unseen: on a host that is not looked at, within one process, or without contracts
runs, and is not declared      undeclared: what uses the instances of the network, or is used by them

Beside these uses, there are the topics of instances to which nothing subscribes, and is not declared to.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ..contract.interface import Pattern, Verb
from ..wire import names
from .actions import offered
from .network import Channel, End, Network, Process

_BEHAVIOR = "CommonBehavior"
"""Every component provides it, so it tells which ones are there."""


class Presence(StrEnum):
    PRESENT = "present"
    MISSING = "missing"
    UNSEEN = "unseen"
    UNDECLARED = "undeclared"


@dataclass(frozen=True, slots=True)
class Instance:
    name: str
    """The network's name for it; of one that is not declared, its own with its process, as `spy (process 8)`."""
    presence: Presence
    processes: frozenset[Process] = frozenset()
    prefix: str = ""
    """The prefix of its channels, its own name for itself."""

    @property
    def pids(self) -> frozenset[int]:
        return frozenset(each.pid for each in self.processes)


@dataclass(frozen=True, slots=True)
class Use:
    """One operation that a client uses of a provider, or one topic that a subscriber hears of a publisher."""

    client: str
    """"" for a topic that has no subscriber."""
    provider: str
    channel: str
    middleware: str
    is_topic: bool
    presence: Presence
    pid: int = 0
    """The process of the client, or of the publisher if there is no client; 0 if not exactly one is known."""
    owner: str = ""
    """The client's own name, if the use is not declared; "?" if it has none."""

    @property
    def interface(self) -> str:
        return names.segment(self.channel)


@dataclass(frozen=True)
class Drift:
    network: str
    instances: tuple[Instance, ...]
    uses: tuple[Use, ...]
    unheard: tuple[Use, ...] = ()
    """The topics without a subscriber. Subscribers within the publisher's process are not announced."""

    def uses_of(self, presence: Presence) -> list[Use]:
        return [each for each in self.uses if each.presence is presence]

    def presence_of(self, name: str) -> Presence:
        return next((each.presence for each in self.instances if each.name == name), Presence.UNSEEN)


def compare(plan: Mapping[str, Any], network: Network, tellers: Mapping[str, Collection[str]] | None = None) -> Drift:
    """What a network declares, as `Plan.to_json`, beside what runs.

    `tellers` are the middlewares that could tell what uses them, by the hosts that were looked at, "" being this one;
    None means all of this host. Raises ValueError if the plan is of another version.
    """
    try:
        comparison = _Comparison(plan, network, tellers)
        instances, declared = comparison.declared_instances(), list(comparison.declared_uses())
        undeclared = list(comparison.undeclared_uses())
        unheard = tuple(comparison.unheard())
    except (KeyError, TypeError, AttributeError, ValueError) as exc:
        raise ValueError(f"the plan of a network is of another version ({exc!r})") from exc
    return Drift(
        comparison.name,
        (*instances, *comparison.strangers.values()),
        tuple(dict.fromkeys((*declared, *undeclared))),
        unheard,
    )


def unheard(network: Network) -> list[Channel]:
    """The topics that are published and have no subscriber. An action may have no client now, so its parts are left
    out."""
    parts = {part.name for each in offered(network).values() for part in each.parts.values()}
    return [
        channel
        for channel in network.channels.values()
        if channel.pattern is Pattern.PUBLISH
        and channel.providers
        and not channel.users
        and channel.name not in parts
        and all(each.supplement is None for each in channel.providers)  # what hears a foreign program is not known
    ]


def _unheard(channel: Channel, provider: End, name: str, presence: Presence) -> Use:
    """One topic of a publisher, whatever it is announced over."""
    over = {each.middleware for each in channel.providers if each.process == provider.process}
    middleware = provider.middleware if len(over) == 1 else ""
    return Use("", name, channel.name, middleware, True, presence, provider.told.pid)


def observed(network: Network) -> Drift:
    """The same for what runs without any declaration: everything is present."""
    called = _names_of(network)
    instances = (
        Instance(name, Presence.PRESENT, frozenset((process,)), owner) for (owner, process), name in called.items()
    )
    uses = (
        Use(
            called[user.told.owner, user.process],
            called[provider.told.owner, provider.process],
            channel.name,
            user.middleware,
            channel.pattern is Pattern.PUBLISH,
            Presence.PRESENT,
            user.told.pid,
        )
        for channel in network.channels.values()
        for provider in channel.providers
        for user in channel.users
        if (provider.told.owner, provider.process) != (user.told.owner, user.process)
    )
    without = (
        _unheard(channel, each, called[each.told.owner, each.process], Presence.PRESENT)
        for channel in unheard(network)
        for each in channel.providers
    )
    return Drift("", tuple(instances), tuple(dict.fromkeys(uses)), tuple(dict.fromkeys(without)))


def _names_of(network: Network) -> dict[tuple[str, Process], str]:
    """What each component is called, by its owner and process: with the process only if two have one name."""
    owners: dict[str, set[Process]] = {}
    stock = [end for each in network.stock(_BEHAVIOR) for end in each.providers]
    for end in (*network.ends, *stock):
        owners.setdefault(end.told.owner, set()).add(end.process)
    return {
        (owner, each): owner if owner and len(processes) == 1 else _with_process(owner, each)
        for owner, processes in sorted(owners.items())
        for each in sorted(processes)
    }


def _with_process(owner: str, process: Process) -> str:
    return f"{owner or '?'} (process {process})"


class _Comparison:
    def __init__(
        self, plan: Mapping[str, Any], network: Network, tellers: Mapping[str, Collection[str]] | None
    ) -> None:
        self.name = str(plan["name"])
        self.strangers: dict[tuple[str, Process], Instance] = {}
        self._network = network
        self._tellers: Mapping[str, Collection[str] | None] = {"": None} if tellers is None else tellers
        self._ways = list(plan["ways"])
        ours = plan["ours"]
        self._prefixes = {str(name): str(each["channels"]) for name, each in ours.items()}
        self._over = {name: [str(one).partition(" ")[0] for one in ours[name]["over"]] for name in self._prefixes}
        served = [each for programs in plan.get("programs", ()) for each in programs["serve"]]
        self._described: dict[str, set[str]] = {}
        """The channels of programs that announce nothing, by the instance: nothing else of them can be seen."""
        for each in served:
            self._described.setdefault(str(each["instance"]), set()).add(str(each["channel"]))
            self._prefixes[str(each["instance"])] = str(each["owner"])
        self._hosts = {str(name): str(each["host"]) for each in plan["processes"] for name in each["instances"]}
        self._names = [str(name) for each in plan["processes"] for name in each["instances"]]
        providers = self._providers()
        self._processes = {name: providers.get(prefix, set()) for name, prefix in self._prefixes.items()}
        self._inside: dict[Process, list[str]] = {}
        for name, processes in self._processes.items():
            for process in processes:
                self._inside.setdefault(process, []).append(name)
        self._used: dict[Process, list[End]] = {}
        for end in network.ends:
            if not end.provides:
                self._used.setdefault(end.process, []).append(end)

    def declared_instances(self) -> list[Instance]:
        return [
            Instance(
                name, self._presence(name), frozenset(self._processes.get(name, ())), self._prefixes.get(name, name)
            )
            for name in self._names
        ]

    def declared_uses(self) -> Iterator[Use]:
        for way in self._ways:
            client, provider, over = str(way["client"]), str(way["provider"]), str(way["middleware"])
            processes = self._processes.get(client, set())
            channels = _channels_of(way)
            presence = self._presence_of_use(client, provider, [name for name, _ in channels], over)
            pid = next(iter(processes)).pid if len(processes) == 1 else 0
            for channel, is_topic in channels:
                yield Use(client, provider, channel, over, is_topic, presence, pid)

    def undeclared_uses(self) -> Iterator[Use]:
        """Those of which one side at least is an instance of the network, except those within one process."""
        declared: dict[tuple[str, str], list[tuple[str, str]]] = {}
        for way in self._ways:
            for name, _ in _channels_of(way):
                to = str(way["provider"]), str(way["middleware"])
                declared.setdefault((str(way["client"]), name), []).append(to)
        for channel in self._network.channels.values():
            providers = [each for each in channel.providers if each.process in self._inside] or channel.providers
            for user in channel.users if providers else ():
                inside = self._inside.get(user.process, [])
                if any(
                    self._is_declared(name, channel.name, declared.get((name, channel.name), ())) for name in inside
                ):
                    continue
                if providers[0].process == user.process or not (inside or providers[0].process in self._inside):
                    continue
                yield self._undeclared(channel, providers[0], user)

    def unheard(self) -> Iterator[Use]:
        """The topics without a subscriber, of declared instances and of strangers that are noted already.

        Those that are declared to have one are uses.
        """
        declared = {(str(way["provider"]), name) for way in self._ways for name, _ in _channels_of(way)}
        found: dict[Use, None] = {}
        for channel in unheard(self._network):
            for each in channel.providers:
                is_stranger = each.process not in self._inside
                if is_stranger and (each.told.owner, each.process) not in self.strangers:
                    continue
                name = self._instance_of(each)
                if (name, channel.name) not in declared:
                    presence = Presence.UNDECLARED if is_stranger else Presence.PRESENT
                    found[_unheard(channel, each, name, presence)] = None
        yield from found

    def _is_declared(self, client: str, channel: str, ways: Sequence[tuple[str, str]]) -> bool:
        """Whether a client uses a channel as it is declared, or does so where it cannot be seen."""
        return any(not self._tells(over, client, to) or self._connects(client, to, channel, over) for to, over in ways)

    def _undeclared(self, channel: Channel, provider: End, user: End) -> Use:
        client, source = self._instance_of(user), self._instance_of(provider)
        is_topic = channel.pattern is Pattern.PUBLISH
        owner = user.told.owner or "?"
        return Use(client, source, channel.name, user.middleware, is_topic, Presence.UNDECLARED, user.told.pid, owner)

    def _instance_of(self, end: End) -> str:
        """The instance of an end: a declared one of its process, or a stranger, which is noted."""
        owner, process = end.told.owner, end.process
        if inside := self._inside.get(process):
            fitting = (name for name in inside if _last(self._prefixes[name]) == _last(owner))
            return next(fitting, inside[0])
        stranger = Instance(_with_process(owner, process), Presence.UNDECLARED, frozenset((process,)), owner)
        return self.strangers.setdefault((owner, process), stranger).name

    def _presence(self, name: str) -> Presence:
        if self._processes.get(name):
            return Presence.PRESENT
        host, over = self._hosts.get(name, ""), self._over.get(name, ())
        is_visible = host in self._tellers and any(self._tells(each, name) for each in over)
        return Presence.MISSING if is_visible else Presence.UNSEEN

    def _presence_of_use(self, client: str, provider: str, channels: Sequence[str], middleware: str) -> Presence:
        """Of an action, it is enough if one of its channels is connected."""
        described = self._described.get(provider)
        if client in self._described or (described is not None and described.isdisjoint(channels)):
            return Presence.UNSEEN
        ends = {self._presence(client), self._presence(provider)}
        if Presence.MISSING in ends:
            return Presence.MISSING
        if Presence.UNSEEN in ends or not self._tells(middleware, client, provider):
            return Presence.UNSEEN
        return (
            Presence.PRESENT
            if any(self._connects(client, provider, each, middleware) for each in channels)
            else Presence.MISSING
        )

    def _connects(self, client: str, provider: str, channel: str, over: str) -> bool:
        known, offering = self._network.channels.get(channel), self._processes.get(provider, ())
        offered = known.providers if known else ()
        if not any(end.process in offering and end.middleware == over for end in offered):
            return False
        used = (end for each in self._processes.get(client, ()) for end in self._used.get(each, ()))
        return any(end.middleware == over and names.matches(end.told.channel, channel) for end in used)

    def _providers(self) -> dict[str, set[Process]]:
        """The processes that provide channels, by the prefix of these."""
        found: dict[str, set[Process]] = {}
        for each in (*self._network.channels.values(), *self._network.stock(_BEHAVIOR)):
            prefix = each.name.rsplit("/", 2)[0]
            found.setdefault(prefix, set()).update(end.process for end in each.providers)
        return found

    def _tells(self, middleware: str, *names: str) -> bool:
        """Whether a middleware told what uses it on the hosts of these instances, as far as they were looked at."""
        return all(self._tells_on(self._hosts.get(each, ""), middleware) for each in names)

    def _tells_on(self, host: str, middleware: str) -> bool:
        known = self._tellers.get(host, self._tellers.get("", ()))
        return known is None or middleware in known


def _channels_of(way: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """The channels of a way, each with whether it is a topic. An action has one for each of its parts."""
    name = str(way["channel"])
    parts = [(name + str(behind), Verb(verb).is_topic) for behind, verb in way["parts"]]
    return parts or [(name, Verb(way["verb"]).is_topic)]


def _last(name: str) -> str:
    return name.rpartition("/")[2]
