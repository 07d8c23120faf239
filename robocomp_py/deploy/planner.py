"""A deployment to the plan of its network, or to all that is wrong with it.

Nothing is started here, and nothing is started at all while there is an error.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Protocol, TypeVar

from .. import installed
from ..contract.component import Component
from ..contract.interface import Verb
from ..contract.middleware import AUTO
from ..dsl.ddsl.hosts import check_ports
from ..dsl.ddsl.model import Deployment, Instance
from ..dsl.ddsl.order import process_dependences, processes_of
from ..dsl.diagnostics import Report, did_you_mean, mistyped
from ..dsl.source import Name
from ..dsl.workspace import LinkedComponent, Workspace
from ..runtime.notify import BETWEEN
from ..transports.deployment import deployments
from ..transports.network import LOOPBACK, Fault, Network, Site
from ..transports.network import Way as Carried
from . import placing, security
from .auto import Choice, Usable, choose, installed_here, unsupported_by_others
from .checking import Checks
from .configuring import Configurations, at_port
from .described import describe_ours, describe_programs
from .offers import read_offers
from .plan import Link, OpenedTransport, Overrides, Plan, Security
from .process import Member, Process
from .qos import unsupported
from .routes import ByChannel, Configured, check_routes, providers, worth_telling
from .starting import start_of
from .uses import Node, node_of, read_qos, wire
from .waiting import Requirement, endless
from .wiring import Placement, Wiring, place
from .wiring import wire as wire_hosts

Addresses = Callable[[Mapping[str, str]], Mapping[str, str]]
"""Maps each host and its written address to the number at which the others reach it; "" is this host."""


def as_written(hosts: Mapping[str, str]) -> Mapping[str, str]:
    """For commands that start nothing: no address is looked up."""
    return {"": "127.0.0.1", **hosts}


def nowhere(address: str) -> bool:
    """The same without looking up addresses: as `ip`, only `localhost` is this machine's."""
    return False


T = TypeVar("T")


class Watch(Protocol):
    """Yields the items, and may show how many are done."""

    def __call__(self, items: Sequence[T], doing: str, /) -> Iterable[T]: ...


def unwatched(items: Sequence[T], doing: str, /) -> Iterable[T]:
    return items


def make_plan(
    path: Path,
    workspace: Workspace,
    overrides: Overrides | None = None,
    usable: Usable = installed_here,
    addresses: Addresses = as_written,
    is_here: Callable[[str], bool] = nowhere,
    watch: Watch = unwatched,
) -> Plan | None:
    """The plan of a DDSL file; None if anything is wrong, which the workspace's report then says.

    `usable` says which middlewares may be chosen where the network leaves that open. `addresses` finds the numbers of
    hosts, and may raise OSError. `is_here` says whether an `ip` is this machine's.
    """
    written = workspace.deployment(path)
    if written is None:
        return None
    model = placing.on_this_machine(written, is_here)
    if overrides and (overrides.clock is not None or overrides.speed is not None):
        model = placing.with_clock(model, overrides, workspace.report)
    if model is not written and not workspace.report.errors:
        check_ports(model, workspace.report)  # two instances that are on one machine now may have the same port
    with installed.asked_once():
        plan = _Planner(model, workspace, overrides or Overrides(), usable, addresses, watch).plan()
    return None if workspace.report.errors else plan


class _Planner:
    def __init__(
        self,
        model: Deployment,
        workspace: Workspace,
        overrides: Overrides,
        usable: Usable,
        addresses: Addresses,
        watch: Watch,
    ) -> None:
        self._model, self._workspace, self._overrides = model, workspace, overrides
        self._usable, self._addresses, self._watch = usable, addresses, watch
        self._report: Report = workspace.report
        self._folder = model.source.path.parent
        self._environ = dict(os.environ)  # which is slow to read again for each instance
        self._together, self._dependences = processes_of(model), process_dependences(model)
        self._links: list[Link] = []
        self._imported: list[Component] = []
        """The components that it may have instances of."""
        self._choice, self._wiring, self._placement = Choice(), Wiring(), Placement()
        self._start = start_of(model, (), (), self._dependences)
        self._configurations = Configurations(model, workspace, overrides, self._environ, self._together)
        self._configured, self._programs = self._configurations.configured, self._configurations.programs
        self._checks = Checks(model, overrides, self._report, self._configurations.shared, self._program)

    def plan(self) -> Plan:
        self._checks.network()
        nodes = self._nodes()
        self._checks.options(nodes)
        read_offers(nodes, self._report)
        self._links = wire(nodes, self._model, self._report, self._configurations.is_outside, self._imported)
        for node in nodes:
            read_qos(node, self._report)
        self._start = start_of(self._model, nodes, self._links, self._dependences)
        ordered = self._start.processes
        in_order = [node for together in ordered.values() for node in together]
        for node in self._watch(in_order, "instances configured"):
            if node.instance.program:
                self._configurations.note_program(node)
            else:
                self._configurations.configure(node)
        self._check_routes(nodes)
        self._check_waiting()
        self._choice = choose([*_parts(self._configured), *_parts(self._programs)], self._usable)
        if addresses := self._host_addresses(ordered):
            self._place_interfaces(ordered, addresses)
            self._wire_hosts(ordered, addresses)
        self._check_security(nodes)
        self._configurations.tell_blamed()
        processes = [self._process(name, together) for name, together in ordered.items()]
        folders = {node.name: node.linked.path.parent for node in nodes}
        named = self._overrides.middleware or (self._model.middleware.text if self._model.middleware else "")
        return Plan(
            self._model.name.text,
            named or AUTO,
            tuple(each for each in processes if each),
            tuple(self._links),
            tuple(self._transports()),
            self._choice.ways,
            (*self._choice.notes, *dict.fromkeys(self._outside()), *self._start.circles()),
            placing.hosts_of(self._model, self._model.instances),
            helpers=(*self._wiring.helpers, *self._placement.helpers),
            ours={
                each.name: describe_ours(each, folders[each.name], self._opened_by(each)) for each in self._configured
            },
            programs=tuple(describe_programs(self._programs, self._placement)),
            **placing.of_plan(self._model, {node.name: node.component for node in nodes}, self._report),
        )

    def _program(self, word: str, instance: Instance) -> Path | None:
        env = {each.name.text: each.value.text for each in instance.env}
        return placing.find_program(word, self._folder, {**self._environ, **env})

    def _nodes(self) -> list[Node]:
        """The instances whose component could be read."""
        known: dict[str, LinkedComponent] = {}
        paths = self._workspace.components_of_model(self._model)
        complete = len(paths) == len(self._model.imports)
        for path in self._watch(paths, "components read"):
            linked = self._workspace.component(path)
            if linked:
                known[linked.component.name.lower()] = linked
                self._imported.append(linked.component)
            complete = complete and linked is not None
        read = {linked.path.stem for linked in known.values()}
        unread = {PurePosixPath(name.text).stem for name in self._model.imports} - read
        nodes = []
        for instance in self._model.instances:
            found = known.get(instance.component.text.lower())
            if found:
                nodes.append(node_of(self._model, instance, found))
                continue
            hint = did_you_mean(instance.component.text, [each.component.name for each in known.values()])
            if complete or (hint and not mistyped(instance.component.text, unread)):
                message = f"unknown component `{instance.component}`"
                self._error("unknown-component", message, instance.component, hint or "import its .cdsl")
        return nodes

    def _process(self, name: str, together: Sequence[Node]) -> Process | None:
        commands = [command for node in together if (command := self._command(node))]
        if len(commands) < len(together):
            return None
        *_, only = together
        own = only.instance.program is not None
        return Process(
            name,
            ", ".join(node.component.name for node in together),
            tuple(_joined(commands)),
            self._folder.resolve() if own else Path.cwd(),
            after=tuple(dict.fromkeys(other.text for other in self._dependences[name])),
            ready_after=self._start.between.ready_after.get(name, ()),
            stops_before=self._start.between.stops_before.get(name, ()),
            is_program=own,
            members=tuple(Member(node.name, node.component.name) for node in together) if only.instance.process else (),
            host=only.host,
            files=tuple(dict.fromkeys(path for node in together for path in self._files(node))),
            **placing.of_process(self._model, [node.instance for node in together]),
        )

    def _files(self, node: Node) -> Iterator[Path]:
        """The local files that the command of an instance names."""
        if node.instance.path and not placing.is_elsewhere(self._model, node.instance):
            yield (self._folder / node.instance.path.text).resolve()
        if node.instance.program:
            return
        yield node.linked.path.parent.resolve()
        if node.instance.config and (config := self._configurations.config(node)):
            yield config.resolve()

    def _command(self, node: Node) -> list[str] | None:
        """What starts an instance that has a process of its own."""
        arguments = [name.text for name in node.instance.args]
        if node.instance.existing:
            return [*self._existing(node), *arguments]
        if node.instance.path and placing.is_elsewhere(self._model, node.instance):
            return [node.instance.path.text, *arguments]
        if node.instance.path:
            file = self._folder / node.instance.path.text
            return [str(file.resolve()), *arguments] if file.is_file() else None
        folder = node.linked.path.parent
        config = self._configurations.config(node)
        assignments = [
            *(each for each, _ in self._configurations.assignments(node)),
            *self._choice.settings.get(node.name, ()),
        ]
        assignments += self._wiring.settings.get(node.name, ())
        if not (folder / "generic" / "genericworker.py").is_file():
            hint = f"run: rcgen {node.linked.path}"
            self._error("not-generated", f"`{node.component.name}` has not been generated", node.instance.name, hint)
            return None
        command = [*_RUN, str(folder.resolve()), "--name", node.instance.local]
        command += ["--config", str(config.resolve())] if node.instance.config and config else []
        process = node.instance.runs_in.text
        here = {each.name.text: each.local for each in self._together[process]}
        before = [here[name.text] for name in node.instance.dependences if name.text in here]
        if not any(process in circle for circle in self._start.between.circles):  # else it may never start
            needed = self._start.inside[process].ready_after.get(node.name, ())
            before += [here[name] for name in needed if here[name] not in before]
        command += [part for name in before for part in ("--after", name)]
        return [*command, *(part for each in assignments for part in ("--set", each)), *arguments]

    def _existing(self, node: Node) -> list[str]:
        """The command of an existing program; a relative path starts at the network's folder."""
        words = placing.existing_command(node.instance.existing.text) if node.instance.existing else []
        if words and not node.host and "/" in words[0] and (found := self._program(words[0], node.instance)):
            return [str(found), *words[1:]]
        return words

    def _transports(self) -> Iterator[OpenedTransport]:
        found: list[OpenedTransport] = []
        for each in self._configured:
            for name in self._opened_by(each):
                opened = OpenedTransport(name, each.settings.transports.get(name, {}))
                if opened not in found:
                    found.append(opened)
                    yield opened

    def _opened_by(self, each: Configured) -> list[str]:
        """The middlewares that an instance opens, including those that `auto` chose."""
        return sorted((each.middlewares() | self._choice.carriers.get(each.name, frozenset())) - {""})

    def _outside(self) -> Iterator[str]:
        """What is found outside of the network, in words."""
        by_channel = ByChannel([*_parts(self._configured), *_parts(self._programs)])
        for each in self._configured:
            for port, name in each.operations(providing=False):
                for aim in each.aims(port, name):
                    proxy = each.outside(port, name, aim)
                    if proxy and not any(offers for _, offers in providers(each, port, aim, by_channel)):
                        over = aim.middleware or each.middleware(port, name)
                        yield f"`{each.name}` finds `{port.label}` over {over} outside of the network: {proxy}"

    def _check_routes(self, nodes: Sequence[Node]) -> None:
        parts, programs = _parts(self._configured), _parts(self._programs)
        named = {node.name: node for node in nodes}
        named = {each.name: named[each.runs_as] for each in (*parts, *programs)} | named
        channels = {
            name: channel for each in self._model.instances for name, channel in placing.channels(self._model, each)
        }
        channels.update((each.name, each.channels) for each in (*parts, *programs))
        faults = check_routes(parts, channels.values(), self._checks.unfit)
        unkept = (*unsupported(parts), *unsupported_by_others(parts))
        for fault in (*faults, *worth_telling(unkept)):
            blame = [("the publisher", named[fault.other].instance.name)] if fault.other else []
            node = named[fault.instance]
            if not self._configurations.blames(fault.origin, fault.code, fault.reason, fault.hint, node):
                self._error(fault.code, fault.message, node.place(fault.port), fault.hint, *blame)

    def _host_addresses(self, ordered: Mapping[str, Sequence[Node]]) -> Mapping[str, str]:
        """The number at which each host is reached; "" is this host. Empty if one is unknown."""
        hosts = placing.hosts_of(self._model, self._model.instances)
        if not hosts:
            return {"": LOOPBACK} if all(not node.host for each in ordered.values() for node in each) else {}
        if not self._is_placed(ordered):
            return {}
        try:
            return self._addresses({host.name: host.address for host in hosts})
        except OSError as exc:
            self._error("bad-host", f"the addresses of its hosts are not known: {exc}", self._model.name)
            return {}

    def _wire_hosts(self, ordered: Mapping[str, Sequence[Node]], addresses: Mapping[str, str]) -> None:
        """How instances reach each other, except through ports of single interfaces."""
        named = {node.name: node for together in ordered.values() for node in together}
        configured = {each.name: each.settings.transports for each in self._configured}
        sites = [
            Site(
                node.name,
                process,
                node.host,
                self._port(node),
                node.instance.program is not None,
                configured.get(node.name, {}),
            )
            for process, together in ordered.items()
            for node in together
        ]
        encrypted = placing.security(self._model) is Security.LAN
        network = Network(self._model.name.text, addresses, sites, self._choice.ways, encrypted)
        wiring = wire_hosts(network)
        once = {(fault.code, fault.instance, fault.other): fault for fault in reversed(wiring.faults)}
        for fault in reversed(once.values()):
            self._fault(fault, named)
        further = self._placement.settings
        names = (*further, *wiring.settings)
        merged = {name: (*further.get(name, ()), *wiring.settings.get(name, ())) for name in names}
        self._wiring = dataclasses.replace(wiring, settings=merged)

    def _place_interfaces(self, ordered: Mapping[str, Sequence[Node]], addresses: Mapping[str, str]) -> None:
        """Find where transports serve interfaces that have ports of their own."""
        named = {node.name: node for together in ordered.values() for node in together}
        over = [name for name, each in deployments().items() if each.ports_of_interfaces]
        ways = self._choice.ways
        provided: dict[str, list[Carried]] = {}
        for way in ways:
            provided.setdefault(way.provider, []).append(way)
        sites = [
            Site(
                each.name,
                each.process,
                each.host,
                placing.port(named[each.name].instance),
                each.is_program,
                each.settings.transports,
                {name: each.interfaces_over(name, provided.get(each.name, ())) for name in over},
                frozenset(filter(each.has_topics_over, over)),
                placing.ports_of_offers(named[each.name].instance),
                each.document.peers,
            )
            for each in (*self._configured, *self._programs)
        ]
        self._placement = found = place(Network(self._model.name.text, addresses, sites, ways))
        for fault in worth_telling(found.faults):
            self._fault(fault, named)
        moved = {
            each.name: (*found.settings.get(each.name, ()), *at_port(self._port(named[each.name]), each))
            for each in self._configured
            if each.name in found.taken
        }
        self._placement = dataclasses.replace(found, settings={**found.settings, **moved})

    def _port(self, node: Node) -> int:
        """Its port for other transports, which follows those of its interfaces."""
        first = placing.port(node.instance)
        return first + self._placement.taken.get(node.name, 0) if first else 0

    def _fault(self, fault: Fault, named: Mapping[str, Node]) -> None:
        related = [("the other end", named[fault.other].instance.name)] if fault.other else []
        self._error(fault.code, fault.message, named[fault.instance].place(fault.port), fault.hint, *related)

    def _is_placed(self, ordered: Mapping[str, Sequence[Node]]) -> bool:
        """Whether the host of every instance is known."""
        known = self._known_hosts()
        return all(node.host in known for together in ordered.values() for node in together)

    def _known_hosts(self) -> set[str]:
        """The names of the hosts that exist and have an address; "" is this host."""
        return {"", *(host.name for host in placing.hosts_of(self._model, self._model.instances))}

    def _check_security(self, nodes: Sequence[Node]) -> None:
        """Whether the security of the network allows everything that instances open."""
        allowed = placing.security(self._model)
        ways, wired = self._choice.ways, self._wiring
        openings = list(security.openings_of(self._configured, self._choice.carriers, wired.settings))
        hosts, known = {node.name: node.host for node in nodes}, self._known_hosts()
        crossing = []
        for way in ways:
            between = {hosts[way.client], hosts[way.provider]}
            if len(between) == 1 or not between <= known:  # of an unknown host, that alone is told
                continue
            crossing.append(way)
            used = [each for each in wired.helpers if each.middleware == way.middleware and each.host in between]
            openings += [security.Opening(way.client, way.middleware, each.options) for each in used]
        faults = worth_telling(security.faults(allowed, openings, ways, crossing))
        named = {node.name: node for node in nodes}
        for fault in faults[:1] if allowed is Security.LOCAL else faults:  # there is one way out for all of them
            self._error(fault.code, fault.message, named[fault.instance].place(), fault.hint)

    def _check_waiting(self) -> None:
        for each in endless(self._model, self._requirements()):
            what = each.requirement
            message = (
                f"`{each.waiting}` would never start: `{each.name}` is not ready before that, "
                f"since `{what.client}` requires `{what.interface}` of `{what.provider}`"
            )
            hint = "components find each other in any starting order: leave this out"
            self._error("dependence-cycle", message, each.name, hint)

    def _requirements(self) -> Iterator[Requirement]:
        """The instances that each instance waits for at its start."""
        by_channel = ByChannel(_parts(self._configured))
        for client in self._configured:
            for port, operation in client.operations(providing=False):
                own, *_ = client.aims(port, operation)
                servers = [server.runs_as for server, offers in providers(client, port, own, by_channel) if offers]
                if port.verb is Verb.REQUIRES and len(servers) == 1:
                    yield Requirement(client.name, port.interface.short, servers[0])

    def _error(self, code: str, message: str, at: Name, hint: str = "", *related: tuple[str, Name]) -> None:
        self._report.error(code, message, at.span, hint, *((text, name.span) for text, name in related))


def _parts(configured: Iterable[Configured]) -> list[Configured]:
    """The instances, each without its named instances, and these."""
    return [part for each in configured for part in each.parts]


_RUN = (sys.executable, "-m", "robocomp_py.cli.rc", "run")


def _joined(commands: Sequence[Sequence[str]]) -> list[str]:
    """One command for several instances, made of their single commands."""
    first, *others = commands
    return [*first, *(part for command in others for part in (BETWEEN, *command[len(_RUN) :]))]
