"""The hosts that a tool looks at: this one, and those of running networks, by their scouts."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from ..closing import Closing
from ..errors import ConfigurationError, DeploymentError, Refused, TransportError
from ..spelling import unknown
from ..transports.deployment import deployment_of
from ..transports.runtime_folder import runtime_dir
from .census import Seen, check_names, of_programs, take_census, take_each
from .network import Channel, End, Network

if TYPE_CHECKING:
    from .posts import Line, Post

Options = Mapping[str, Mapping[str, Any]]
"""Of middlewares, by their names."""


class Hosts(Closing):
    """What runs on this host, and on the other hosts of networks that run here. Closing it ends their scouts.

    For any number of threads.
    """

    def __init__(
        self,
        network: str | None,
        tell: Callable[[str], object],
        *,
        here: bool = True,
        others: Sequence[str] | None = None,
        keys: str | None = None,
        running: bool = True,
    ) -> None:
        """`network` is a network by its name or file, None for all that run here. Unless `running`, it need not run.

        `here` is whether this host is looked at, and `others` names the other ones, by default all. `keys` is the
        folder of an operator's keys, by default that of the network. `tell` gets warnings for people. Nothing is looked
        at before `renew`.
        """
        self._network, self._tell, self._others, self._keys, self._running = network, tell, others, keys, running
        self.here = here
        self._lock = threading.Lock()
        self._known: dict[tuple[str, str], Post] = {}
        """By the names of a network and a host."""
        self._host_of: Mapping[str, str] = {}
        self._options: Options = {}
        self._visited: Options = {}
        """Of the middlewares in which tools take part as an operator."""
        self._told: set[str] = set()
        """The warnings of clashing names that were given."""
        self.posts: Sequence[Post] = ()
        self.lost: Mapping[str, str] = {}
        """The hosts that the last look could not ask, and why."""

    def renew(self) -> Self:
        """Find the hosts of the networks that run now. Raises RobocompError."""
        with self._lock:
            plans = self._plans()
            self._running = False  # it may end meanwhile
            hosts, clashes = network_of_hosts(plans)
            for each in clashes:
                if each not in self._told:
                    self._told.add(each)
                    self._tell(each)
            check_hosts(self._others or (), hosts)
            opened = _opened(plans)
            self._visited = self._operator(plans)
            self._options = {**opened.get("", {}), **self._visited}
            wanted = [name for name in hosts if self._others is None or name in self._others]
            self.posts = [self._post(hosts[name], name, opened.get(name, {})) for name in wanted]
            self._host_of = places(plans)
        return self

    @property
    def instances(self) -> Collection[str]:
        """Those of the network that is named, and what the names of their channels begin with; none if it does not
        run."""
        return self._host_of.keys()

    def check_publishing(self, channel: Channel) -> None:
        """Raise Refused if messages could only be sent with the keys of an operator, which publish nothing."""
        ways = channel.ways
        if ways and all(way.via is None and way.middleware in self._visited for way in ways):
            raise Refused(
                f"{channel.name}: the keys of an operator publish nothing; let a component of the network publish it"
            )

    def census(
        self, middlewares: Sequence[str], *, own: bool = False, meanwhile: Callable[[], object] = lambda: None
    ) -> Network:
        """As `take_census`. What cannot be asked on another host is told, once."""
        if not self.posts:
            self.lost = {}
            chosen = self._others is not None
            network = take_census(middlewares, own=own or chosen, options=self._options, meanwhile=meanwhile)
            return Network(self._looked_at(network.ends), own=own) if chosen else network
        check_names(middlewares)
        if self.here:
            here = list(take_census(middlewares, own=True, options=self._options, meanwhile=meanwhile).ends)
        else:
            here = of_programs(middlewares, self._options)
        known = self.lost
        seen, lost = self._merged(Seen(here), middlewares)
        for text in [why for host, why in lost.items() if host not in known] + seen.troubles:
            self._tell(text)
        return Network(seen.ends, own=own)

    def look(self, middlewares: Sequence[str]) -> Seen:
        """As `take_each`. Hosts that cannot be asked are among the troubles."""
        here = take_each(middlewares, self._options) if self.here else Seen()
        if not self.posts:
            self.lost = {}
            return replace(here, ends=self._looked_at(here.ends))
        if not self.here:
            here = Seen(of_programs(middlewares, self._options))
        seen, lost = self._merged(here, middlewares)
        return replace(seen, troubles=[*lost.values(), *seen.troubles])

    def close(self) -> None:
        """End all scouts. Idempotent."""
        with self._lock:
            posts, self._known, self.posts = list(self._known.values()), {}, ()
        for each in posts:
            each.close()

    def _merged(self, here: Seen, middlewares: Sequence[str]) -> tuple[Seen, Mapping[str, str]]:
        from .survey import merged, survey

        there, lost = survey(self.posts, middlewares)
        self.lost = lost
        near = self._looked_at(here.ends)
        ends = merged(near, there.ends, self._host_of, lambda name: bool(deployment_of(name).directory))
        return Seen(ends, {**here.tellers, **there.tellers}, [*here.troubles, *there.troubles]), lost

    def _looked_at(self, ends: Iterable[End]) -> list[End]:
        """Without programs of hosts that are left out: a network on this host describes those of all its hosts."""
        if self._others is None:
            return list(ends)
        hosts = {*self._others, *([""] if self.here else ())}
        return [each for each in ends if each.host in hosts]

    def _post(self, network: str, host: str, options: Options) -> Post:
        from .posts import Post  # a tool on a single host does without

        key = network, host
        if key not in self._known:
            self._known[key] = Post(host, partial(_connected, network, host))
        self._known[key].options = options
        return self._known[key]

    def _operator(self, plans: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
        """The options of middlewares with which a tool takes part in a network with keys, as its operator."""
        if not (self._network or self._keys):
            return {}
        from ..transports.permissions import OPERATOR  # with no such network, a tool does without

        helpers = [each for plan in plans.values() for each in plan.get("helpers", ()) if each["keys"]]
        found: dict[str, Mapping[str, Any]] = {}
        for each in sorted(helpers, key=lambda each: bool(each["host"])):  # that of this host first
            folder = Path(self._keys or Path(each["keys"]).parent, OPERATOR)
            if not (folder / "certificate.pem").is_file():
                continue
            visiting = deployment_of(each["middleware"]).visiting(
                each["options"], str(folder), is_here=not each["host"]
            )
            if visiting:
                found.setdefault(each["middleware"], visiting)
        if self._keys and not found:
            if not Path(self._keys, OPERATOR, "certificate.pem").is_file():
                raise DeploymentError(
                    f"{self._keys} has no keys of an operator; make them: rcdeploy keys NET.ddsl --operator"
                )
            raise DeploymentError("no network that needs an operator runs here")
        return found

    def _plans(self) -> dict[str, Any]:
        """The plans of the network that is named, or of all running ones that have other hosts, by name.

        What makes a connection takes long to import, so plans are looked into first.
        """
        if not self._network:
            try:
                if not any(map(_has_hosts, runtime_dir("deploy").glob("*/plan.json"))):
                    return {}
            except (ConfigurationError, TransportError):
                return {}  # a census says so, too
        from ..deploy.client import NotRunning, network_of, networks, not_running, running_plan

        found = {}
        for name in [network_of(self._network)] if self._network else networks():
            try:
                plan = running_plan(name)
            except DeploymentError as exc:
                if self._network:
                    raise
                self._tell(str(exc))
                continue
            if self._network and plan is None and self._running:
                raise NotRunning(not_running(name))
            if plan and (plan.get("hosts") or self._network):
                found[name] = plan
        return found


def check_hosts(names: Iterable[str], known: Collection[str]) -> None:
    """Raise DeploymentError if one of these names is not that of a known host."""
    for name in names:
        if not known:
            raise DeploymentError(f"host {name}: no network with other hosts runs here")
        if name not in known:
            raise DeploymentError(unknown("host", name, known))


def _opened(plans: Mapping[str, Any]) -> Mapping[str, Options]:
    """By host, the options of middlewares with which a tool there meets components; "" is this host.

    Those with keys admit operators only.
    """
    if not plans:
        return {}
    import tomllib  # without a plan, a tool does without

    found: dict[str, dict[str, Mapping[str, Any]]] = {}
    for plan in plans.values():
        keyed = {each["middleware"] for each in plan.get("helpers", ()) if each["keys"]}
        addresses = {each["name"]: each.get("address", "") for each in plan.get("hosts", ())}
        for process in plan.get("processes", ()):
            words = process.get("command", ())
            set_ = (word for before, word in pairwise(words) if before == "--set" and word.startswith("transports."))
            said = {word.partition("=")[0]: word for word in set_}  # components that share a process have the same
            for name, options in tomllib.loads("\n".join(said.values())).get("transports", {}).items():
                host = process.get("host", "")
                needed = {} if name in keyed else deployment_of(name).observing(options, addresses.get(host, ""))
                if needed:
                    found.setdefault(host, {}).setdefault(name, needed)
    return found


def network_of_hosts(plans: Mapping[str, Any]) -> tuple[Mapping[str, str], Sequence[str]]:
    """The network of each host, by the name of the host; and a warning for each name that means different machines."""
    found: dict[str, tuple[str, str]] = {}
    clashes = []
    for network, plan in plans.items():
        for host in plan.get("hosts", ()):
            name, address = host["name"], host.get("address", "")
            before, other = found.get(name, (network, address))
            if address != other:
                clashes.append(
                    f"host {name} of {before} is left out, because {name} of {network} is another machine; "
                    f"look at it with --network {before}"
                )
            found[name] = network, address
    return {name: network for name, (network, _) in found.items()}, clashes


def places(plans: Mapping[str, Any]) -> Mapping[str, str]:
    """The hosts of instances, and of the names of their channels; not of those that networks have on different ones."""
    found: dict[str, set[str]] = {}
    for plan in plans.values():
        processes = plan.get("processes", ())
        own = {instance: each.get("host", "") for each in processes for instance in each.get("instances", ())}
        ours = plan.get("ours", {})  # some are not called as their channels are
        own |= {each["channels"].strip("/"): own[name] for name, each in ours.items() if name in own}
        served = [each for programs in plan.get("programs", ()) for each in programs["serve"]]
        own |= {each["owner"].strip("/"): own[each["instance"]] for each in served if each["instance"] in own}
        for name, host in own.items():
            found.setdefault(name, set()).add(host)
    return {name: hosts.pop() for name, hosts in found.items() if len(hosts) == 1}


def _connected(network: str, host: str) -> Line:
    from ..deploy.client import ScoutLine

    return ScoutLine(network, host)


def _has_hosts(plan: Path) -> bool:
    try:
        return bool(json.loads(plan.read_text(encoding="utf-8")).get("hosts"))
    except (OSError, ValueError, AttributeError):
        return False
