"""A deployment to the plan of its network, or to all that is wrong with it.

Nothing is started here, and nothing is started at all while there is an error.
"""

from __future__ import annotations

import dataclasses
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Protocol, TypeVar

from .. import installed
from ..contract.component import Component, Port
from ..contract.interface import Pattern, Verb
from ..contract.middleware import AUTO, carrier, generated_for
from ..contract.parameters import Complaint, ParameterSet
from ..contract.told import supplement
from ..dsl.cdsl.qos import read_qos as qos_of
from ..dsl.ddsl.hosts import check_ports
from ..dsl.ddsl.model import Deployment, Instance
from ..dsl.ddsl.order import process_dependences, processes_of
from ..dsl.ddsl.programs import environment_of
from ..dsl.diagnostics import Diagnostic, Report, did_you_mean, mistyped
from ..dsl.nearby import nearby
from ..dsl.source import Name, Source
from ..dsl.workspace import LinkedComponent, Workspace
from ..errors import ConfigurationError
from ..runtime import settings
from ..runtime.document import Document, NotToml
from ..runtime.effective import toml
from ..runtime.keys import KEYS
from ..runtime.notify import BETWEEN
from ..spelling import unknown
from ..transports.deployment import deployment_of, deployments
from ..transports.network import LOOPBACK, Fault, Network, Site
from ..transports.network import Way as Carried
from ..wire import names
from . import placing, security
from .auto import Choice, Usable, choose, installed_here, unsupported_by_others
from .configuration import check_text, span_of
from .offers import read_offers
from .plan import Link, OpenedTransport, Ours, Overrides, Plan, Programs, Security, Served
from .process import Member, Process
from .qos import unsupported
from .routes import (
    ByChannel,
    Configured,
    check_routes,
    providers,
    stays_inside,
    unfit,
    unshared,
    worth_telling,
)
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
        self._instances = [instance.name.text for instance in model.instances]
        self._environ = dict(os.environ)  # which is slow to read again for each instance
        self._together, self._dependences = processes_of(model), process_dependences(model)
        self._links: list[Link] = []
        self._imported: list[Component] = []
        """The components that it may have instances of."""
        self._configured: list[Configured] = []
        self._programs: list[Configured] = []
        self._choice, self._wiring, self._placement = Choice(), Wiring(), Placement()
        self._start = start_of(model, (), (), self._dependences)
        self._blamed: dict[tuple[str, str, str, str], list[str]] = {}
        """The instances that an error outside of all files concerns, by name, code, message and hint."""
        self._unfit: set[str] = set()
        """Middlewares that have been reported where the network names them."""

    def plan(self) -> Plan:
        self._check_network()
        nodes = self._nodes()
        self._check_overrides(nodes)
        read_offers(nodes, self._report)
        self._links = wire(nodes, self._model, self._report, self._is_outside, self._imported)
        for node in nodes:
            read_qos(node, self._report)
        self._start = start_of(self._model, nodes, self._links, self._dependences)
        ordered = self._start.processes
        in_order = [node for together in ordered.values() for node in together]
        for node in self._watch(in_order, "instances configured"):
            if node.instance.program:
                self._note_program(node)
            else:
                self._configure(node)
        self._check_routes(nodes)
        self._check_waiting()
        self._choice = choose([*_parts(self._configured), *_parts(self._programs)], self._usable)
        if addresses := self._host_addresses(ordered):
            self._place_interfaces(ordered, addresses)
            self._wire_hosts(ordered, addresses)
        self._check_security(nodes)
        self._tell_blamed()
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
            ours={each.name: self._ours(each, folders[each.name]) for each in self._configured},
            programs=tuple(self._served()),
            **placing.of_plan(self._model, {node.name: node.component for node in nodes}, self._report),
        )

    def _ours(self, each: Configured, folder: Path) -> Ours:
        over = {
            f"{name} {each.settings.transports.get(name, {}).get('domain', '')}".strip()
            for name in (each.middlewares() | self._choice.carriers.get(each.name, frozenset())) - {""}
        }
        topics = tuple(
            "/".join((part.channels, part.component.segment(port), name))
            for part in each.parts
            for port in part.component.ports
            if port.verb.provides
            for name in _topics(port)
        )
        return Ours(folder.resolve(), each.component.fingerprints(), each.channels, tuple(sorted(over)), topics)

    def _served(self) -> Iterator[Programs]:
        """What foreign programs serve at known places, and publish, for tools: they announce nothing themselves."""
        for middleware in dict.fromkeys((*self._placement.programs, *self._placement.publishers)):
            calls, topics = self._reached(middleware), list(self._heard(middleware))
            if calls and topics:
                first, *topics = topics  # a tool opens the middleware once for each set of options
                calls = Programs(middleware, {**calls.options, **first.options}, (*calls.serve, *first.serve))
            yield from ([calls] if calls else [])
            yield from topics

    def _reached(self, middleware: str) -> Programs | None:
        """The queries and commands of foreign programs."""
        places = self._placement.programs.get(middleware, {})
        found: list[Served] = []
        at: dict[str, str] = {}
        for each, part, port in _provided(self._programs, Verb.IMPLEMENTS):
            segment = part.component.segment(port)
            place = places.get((each.name, names.within(part.instance if part.owner else "", segment)))
            for served in _described(each, part, port) if place else ():
                found.append(served)
                at[served.channel] = str(place)
        return Programs(middleware, deployment_of(middleware).reaching(at), tuple(found)) if found else None

    def _heard(self, middleware: str) -> Iterator[Programs]:
        """The topics of foreign programs."""
        publishers = self._placement.publishers.get(middleware, {})
        topics = {
            served.channel: served
            for each, part, port in _provided(self._programs, Verb.PUBLISHES)
            if each.name in publishers
            for served in _described(each, part, port)
        }
        by_channel = {channel: publishers[each.instance] for channel, each in topics.items()}
        for options, channels in deployment_of(middleware).hearing(by_channel):
            yield Programs(middleware, options, tuple(topics[each] for each in channels))

    # The network as a whole.

    def _check_network(self) -> None:
        model = self._model
        named = [instance for instance in model.instances if instance.middleware]
        self._check_middleware(model.middleware, [each for each in model.instances if each not in named])
        if self._overrides.middleware:
            self._check_middleware(Name(self._overrides.middleware, model.name.span), model.instances, override=True)
        for instance in model.instances:
            self._check_instance(instance)
        if not model.instances and not self._report.errors:
            self._report.warning("empty-deployment", "there is nothing to run", model.name.span)

    def _check_overrides(self, nodes: Sequence[Node]) -> None:
        own_programs = {each.name.text: each.program for each in self._model.instances if each.program}
        diaries = self._overrides.diaries
        for name, assignment in (*self._overrides.settings, *diaries):
            is_diary = (name, assignment) in diaries
            origin = Source(Path(self._overrides.option(name, assignment)), "", has_places=False).span(0, 0)
            if name in own_programs:
                what = "it writes no diary" if is_diary else "its configuration cannot be set here"
                message, hint = f"`{name}` is your own program; {what}", "" if is_diary else "give it `args` or `env`"
                self._report.error("configuration", message, origin, hint, ("it is this one", own_programs[name].span))
            elif (is_diary or name != "*") and name not in self._instances:
                whole = "" if is_diary else _with_instance(name, assignment.partition("=")[0], nodes)
                message = f"unknown instance `{name}`" if whole else unknown("instance", name, self._instances)
                hint = f"write the instance first, as in {whole}" if whole else ""
                self._report.error("unknown-instance", message, origin, hint)

    def _check_instance(self, instance: Instance) -> None:
        for name in (instance.middleware, *(wiring.middleware for wiring in instance.wirings)):
            self._check_middleware(name, [instance])
        for name in (instance.path, instance.config):
            file = self._folder / name.text if name else None
            if name is None or file is None or (name is instance.path and self._is_elsewhere(instance)):
                continue
            if not file.is_file():
                configs = {each.config.text for each in self._model.instances if each.config}
                hint = nearby(file, name.text, configs if name is instance.config else (), instance.local)
                self._error("missing-file", f"there is no file {file}", name, hint or "write it, or correct the name")
            elif name is instance.path and not os.access(file, os.X_OK):
                self._error("not-executable", f"{file} is not executable", name)
        for argument in instance.args if not instance.program else ():
            if argument.text == BETWEEN:
                message = f"`{BETWEEN}` separates the components of one process and cannot be an argument"
                self._error("configuration", message, argument, "call it otherwise, or set a parameter")
        command, here = instance.existing, not placing.host_name(self._model, instance)
        words = placing.existing_command(command.text) if command else []
        if command and words and here and not self._program(words[0], instance):
            message = f"there is no program `{words[0]}` on this host"
            self._error("missing-file", message, command, "install it, or write its path")

    def _is_elsewhere(self, instance: Instance) -> bool:
        """Whether its program is installed on its host, rather than a file beside the network."""
        return bool(instance.path and Path(instance.path.text).is_absolute()) and bool(
            placing.host_name(self._model, instance)
        )

    def _program(self, word: str, instance: Instance) -> Path | None:
        env = {each.name.text: each.value.text for each in instance.env}
        return placing.find_program(word, self._folder, {**self._environ, **env})

    def _check_middleware(self, name: Name | None, users: Iterable[Instance], *, override: bool = False) -> None:
        """Whether the network's middleware can carry the messages of the instances that it is named for."""
        carried = carrier(name.text, "") if name else ""
        if name is None or not carried:
            return
        fault = unfit(carried)
        if fault is None and override is bool(self._overrides.middleware) and stays_inside(carried):
            alone = [each.name.text for each in users if not each.program and not self._shared(each)]
            fault = unshared(carried, alone[0]) if alone else None
        if fault:
            self._unfit.add(name.text)
            message = f"--middleware {name}: {fault.message}" if override else fault.message
            self._error(fault.code, message, name, fault.hint)

    def _shared(self, instance: Instance) -> str:
        """The process that it shares with others; "" if it has one of its own."""
        name = instance.runs_in.text
        return name if len(self._together[name]) > 1 else ""

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

    def _is_outside(self, node: Node, port: Port) -> bool:
        """Whether all that a port uses is found outside of the network, as its configuration says."""
        if node.instance.program:
            return False
        try:
            document = self._document(node, self._config(node))
        except ConfigurationError:
            return False  # reported when it is configured
        checked, complaints = settings.examine(node.component, document, node.instance.local)
        each = Configured(node.name, node.component, checked, document, generated_for(node.linked.path.parent))
        names = port.interface.called(port.verb)
        return not complaints and all(each.outside(port, name, aim) for name in names for aim in each.aims(port, name))

    # Processes.

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
        if node.instance.path and not self._is_elsewhere(node.instance):
            yield (self._folder / node.instance.path.text).resolve()
        if node.instance.program:
            return
        yield node.linked.path.parent.resolve()
        if node.instance.config and (config := self._config(node)):
            yield config.resolve()

    def _variables(self, node: Node) -> dict[str, str]:
        """The environment that the network gives to the process of an instance."""
        return environment_of(self._model, self._together[node.instance.runs_in.text])

    def _command(self, node: Node) -> list[str] | None:
        """What starts an instance that has a process of its own."""
        arguments = [name.text for name in node.instance.args]
        if node.instance.existing:
            return [*self._existing(node), *arguments]
        if node.instance.path and self._is_elsewhere(node.instance):
            return [node.instance.path.text, *arguments]
        if node.instance.path:
            file = self._folder / node.instance.path.text
            return [str(file.resolve()), *arguments] if file.is_file() else None
        folder = node.linked.path.parent
        config = self._config(node)
        assignments = [*(each for each, _ in self._assignments(node)), *self._choice.settings.get(node.name, ())]
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

    def _config(self, node: Node) -> Path | None:
        if node.instance.config:
            path = self._folder / node.instance.config.text
            return path if path.is_file() else None
        return settings.find(node.linked.path.parent)

    def _assignments(self, node: Node) -> Iterator[tuple[str, str]]:
        """The settings of the deployment, weakest first, each with its origin."""
        network = str(self._model.source.path)
        if node.namespace or self._model.systems:
            yield f"namespace={node.namespace}", network
        named = node.instance.middleware or self._model.middleware
        if self._overrides.middleware:
            yield f"middleware={self._overrides.middleware}", f"--middleware {self._overrides.middleware}"
        elif named:
            yield f"middleware={named}", network
        for assignment in placing.clock_of(self._model, node.instance, self._overrides.speed):
            yield assignment, network
        if port := placing.port(node.instance):
            yield from ((assignment, network) for assignment in _at_port(port))
        if node.component.named:
            yield "offers={}", network
        for name, provided in node.offers.items():
            yield from ((f"offers.{name}.{each.name}={{}}", network) for each in provided)
        for used, (source, *others) in node.wires.items():
            yield f"ports.{used}.from={source}", network
            if others:
                yield f"ports.{used}.also={toml([{'from': each} for each in others])}", network
        for used, middleware in self._carriers(node).items():
            line, _ = self._model.source.position(middleware.span.start)
            yield f"ports.{used}.middleware={middleware}", f"{network}:{line}"
        for told, quality in node.qos.items():
            line, _ = self._model.source.position(quality.span.start)
            yield f"ports.{told}.qos={toml(qos_of(quality.settings, Report()))}", f"{network}:{line}"
        for assignment in self._overrides.of(node.name) if not node.instance.program else ():
            yield assignment, self._overrides.option(node.name, assignment)

    def _carriers(self, node: Node) -> Mapping[str, Name]:
        """The middlewares of single links, by the port that uses; the command line counts more than they do."""
        return {} if self._overrides.middleware else node.carriers

    def _note_program(self, node: Node) -> None:
        """Note a foreign program: its clauses in the network, and its own configuration file.

        Of its file, only the transports count whose interfaces have ports of their own: that is where it is called.
        """
        middleware = generated_for(node.linked.path.parent)
        document = Document()
        config = self._config(node) if node.instance.config else None
        own = [name for name, each in deployments().items() if each.ports_of_interfaces]
        try:
            theirs = settings.read_for(config, node.component) if config else Document()
            for name in own:
                settings.settle(theirs, node.component, name)
        except ConfigurationError as exc:
            self._error("configuration", f"`{node.name}` has a wrong configuration: {exc}", node.place())
            return
        transports = theirs.data.get("transports", {})
        if said := {name: transports[name] for name in own if transports.get(name)}:
            document.data["transports"] = said
        for assignment, origin in self._assignments(node):
            settings.override(document, assignment, origin)
        known, complaints = settings.examine(node.component, document, node.instance.local)
        wrong = [each for each in complaints if each.key[:1] == ("transports",) and each.key[1] in own]
        self._report.extend(_complaint(node, config, theirs, each) for each in wrong)
        if wrong:
            return
        self._programs.append(
            Configured(node.name, node.component, known, document, middleware, is_program=True, host=node.host)
        )

    def _configure(self, node: Node) -> None:
        at = node.place()
        config = self._config(node)
        if node.instance.config and not config:
            return  # which has been reported
        try:
            document = self._document(node, config)
        except NotToml:
            source = self._workspace.source(config) if config else None
            if source:
                check_text(source, node.component, self._workspace, node.linked.path.parent)
            return
        except ConfigurationError as exc:
            origin, _, message = str(exc).partition(": ")
            if not self._blames(origin, "configuration", message, "", node):
                self._error("configuration", f"`{node.name}` has a wrong configuration: {exc}", at)
            return
        checked, complaints = settings.examine(node.component, document, node.instance.local)
        complaints = [*complaints, *_undeclared(node, checked)]
        for each in complaints:
            origin = document.overridden(each.key) if each.key else ""
            if not self._blames(origin, each.code, each.message, "", node):
                self._report.extend([_complaint(node, config, document, each)])
        if complaints:
            return
        middleware = generated_for(node.linked.path.parent)
        shared = self._shared(node.instance)
        carriers = {port: name.text for port, name in self._carriers(node).items()}
        self._configured.append(
            Configured(node.name, node.component, checked, document, middleware, shared, False, node.host, carriers)
        )

    def _blames(self, origin: str, code: str, message: str, hint: str, node: Node) -> bool:
        """Whether an environment variable or an option is the cause, which is reported once for all instances."""
        variable = origin.removeprefix(settings.VARIABLE)
        is_variable = variable != origin and variable not in self._variables(node)
        if is_variable or origin.startswith("--"):
            self._blamed.setdefault((origin, code, message, hint), []).append(node.name)
        return is_variable or origin.startswith("--")

    def _tell_blamed(self) -> None:
        for (origin, code, message, hint), instances in self._blamed.items():
            span = Source(Path(origin), "", has_places=False).span(0, 0)
            names = ", ".join(f"`{name}`" for name in dict.fromkeys(instances))
            self._report.error(code, f"{message} (for {names})", span, hint)

    def _document(self, node: Node, config: Path | None) -> Document:
        """Everything that is set for an instance; raises ConfigurationError."""
        component = node.component
        document = settings.read_for(config, component) if config else Document(params=component.params)
        settings.environment(document, component, {**self._environ, **self._variables(node)})
        for assignment, origin in self._assignments(node):
            settings.override(document, assignment, origin)
        settings.settle(document, component, generated_for(node.linked.path.parent))
        return document

    def _transports(self) -> Iterator[OpenedTransport]:
        found: list[OpenedTransport] = []
        for each in self._configured:
            for name in sorted((each.middlewares() | self._choice.carriers.get(each.name, frozenset())) - {""}):
                opened = OpenedTransport(name, each.settings.transports.get(name, {}))
                if opened not in found:
                    found.append(opened)
                    yield opened

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
        faults = check_routes(parts, channels.values(), self._unfit)
        unkept = (*unsupported(parts), *unsupported_by_others(parts))
        for fault in (*faults, *worth_telling(unkept)):
            blame = [("the publisher", named[fault.other].instance.name)] if fault.other else []
            node = named[fault.instance]
            if not self._blames(fault.origin, fault.code, fault.reason, fault.hint, node):
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
            each.name: (*found.settings.get(each.name, ()), *_at_port(self._port(named[each.name]), each))
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


def _with_instance(part: str, rest: str, nodes: Sequence[Node]) -> str:
    """The full key for a key without an instance, if an instance has such a parameter; "" if none has."""
    if part not in KEYS:
        return ""
    name = re.split(r"[.\[]", rest)[0]
    having = [each.name for each in nodes if part == "params" and _has(each.component.params, name)]
    return next((f"`{each}.{part}.{rest}`" for each in (*having, *(node.name for node in nodes))), "")


def _has(params: ParameterSet | None, name: str) -> bool:
    return params is not None and name in [
        *(each.name for each in params.parameters),
        *(each.name for each in params.lists),
    ]


def _topics(port: Port) -> Iterator[str]:
    """What a port publishes, parts of actions included."""
    for operation, pattern in port.interface.under(port.verb):
        if pattern is Pattern.PUBLISH:
            yield operation.name
    for action in port.interface.actions_under(port.verb):
        yield from (part.name for part in action.topics)


def _at_port(port: int, provider: Configured | None = None) -> Iterator[str]:
    """The meaning of the port that the network gives to an instance; if the provider is known, for what it provides."""
    for name, each in deployments().items():
        wanted = port if provider is None or _provides_over(name, provider) else 0
        yield from (f"transports.{name}.{key}={toml(value)}" for key, value in each.at_port(wanted).items())


def _provides_over(middleware: str, each: Configured) -> bool:
    """Whether a middleware carries anything that it provides."""
    provided = ((part, at) for part in each.parts for at in part.operations(providing=True))
    return any(middleware in part.settings.middlewares(*at, part.generated_for) for part, at in provided)


def _parts(configured: Iterable[Configured]) -> list[Configured]:
    """The instances, each without its named instances, and these."""
    return [part for each in configured for part in each.parts]


def _provided(configured: Iterable[Configured], verb: Verb) -> Iterator[tuple[Configured, Configured, Port]]:
    """The interfaces that instances implement or publish: each with the instance, and with the part that offers it."""
    for each in configured:
        for part in each.parts:
            yield from ((each, part, port) for port in part.component.ports if port.verb is verb)


def _described(program: Configured, part: Configured, port: Port) -> Iterator[Served]:
    """The channels of an interface of a foreign program."""
    for operation, pattern in port.interface.under(port.verb):
        channel = "/".join((part.channels, part.component.segment(port), operation.name))
        contract = operation.fingerprint, operation.text, supplement(operation)
        yield Served(program.name, program.channels, channel, pattern, *contract)


def _undeclared(node: Node, checked: settings.Settings) -> Iterator[Complaint]:
    """Complaints about named instances that are configured and that the network does not declare."""
    for name, ports in (checked.offers or {}).items():
        if name not in node.offers:
            interfaces = ", ".join(port.interface.short for port in node.component.named if (port.name,) in ports)
            message = f"the network does not declare `{name}`; write in the block of `{node.name}`: offers {name}"
            yield Complaint(("offers", name), f"{message} : {interfaces};", "config-unknown-key")


def _complaint(node: Node, config: Path | None, document: Document, complaint: Complaint) -> Diagnostic:
    """Report a wrong configuration at its place in the file, or else at the instance."""
    origin = document.overridden(complaint.key) if complaint.key else ""
    if config and not origin:
        source = Source(config, document.text)
        return Diagnostic(complaint.code, complaint.message, span_of(source, document, complaint))
    message = f"`{node.name}` has a wrong configuration: {f'{origin}: ' if origin else ''}{complaint.message}"
    return Diagnostic(complaint.code, message, node.place().span)


_RUN = (sys.executable, "-m", "robocomp_py.cli.rc", "run")


def _joined(commands: Sequence[Sequence[str]]) -> list[str]:
    """One command for several instances, made of their single commands."""
    first, *others = commands
    return [*first, *(part for command in others for part in (BETWEEN, *command[len(_RUN) :]))]
