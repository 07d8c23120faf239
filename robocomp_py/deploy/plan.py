"""A deployment to the processes that make it up, or to all that is wrong with it.

Nothing is started here, and nothing is started at all while there is an error.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import Any

from .. import installed
from ..contract.component import Component, Port
from ..contract.interface import Verb, differences
from ..contract.parameters import Complaint
from ..dsl.cdsl.qos import read_qos
from ..dsl.ddsl.model import Deployment, Instance, Quality, Wiring
from ..dsl.ddsl.order import process_dependences, processes_of, start_order
from ..dsl.diagnostics import Diagnostic, Report, did_you_mean, mistyped
from ..dsl.numbers import whole
from ..dsl.source import Name, Source
from ..dsl.workspace import LinkedComponent, Workspace, nearby
from ..errors import ConfigurationError
from ..runtime import settings
from ..runtime.document import Document, NotToml
from ..runtime.effective import toml
from ..runtime.notify import BETWEEN
from ..spelling import unknown
from .auto import Choice, Usable, Way, choose, installed_here, unsupported_by_others
from .configuration import check_text, span_of
from .policy import Escalation, Restart
from .qos import unsupported
from .routes import (
    Configured,
    check_routes,
    generated_for,
    providers,
    stays_inside,
    unfit,
    unmet,
    unshared,
    worth_telling,
)
from .waiting import Requirement, endless

LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class Member:
    """An instance in a process that has a name of its own."""

    name: str
    component: str


@dataclass(frozen=True)
class Process:
    """One process to run."""

    name: str
    component: str
    """Of what it is an instance; several, if it has several members."""
    command: tuple[str, ...]
    cwd: Path
    env: Mapping[str, str] = field(default_factory=dict)
    after: tuple[str, ...] = ()
    """Those that must be ready before it is started."""
    notifies: bool = True
    """Whether it says itself when it is ready; else it counts as ready once it runs."""
    members: tuple[Member, ...] = ()
    """Those that are in it, in the order in which they start; none if it is that of the instance it is called like."""
    host: str = ""
    """Which of the plan's hosts it runs on; "" for the one that launches the network."""
    restart: Restart = field(default_factory=Restart)
    grace: float | None = None
    """Seconds it has to end by itself, if the network says so."""
    system: tuple[str, ...] = ()
    """The systems around it, the outermost first."""
    files: tuple[Path, ...] = ()
    """What its command names of the files here, whole arguments: folders of components, configurations, a program."""

    @property
    def instances(self) -> tuple[str, ...]:
        """Which instances of the network run in it."""
        return tuple(member.name for member in self.members) or (self.name,)


@dataclass(frozen=True)
class Link:
    """An interface that one instance offers and another one uses."""

    interface: str
    provider: str
    client: str
    verb: Verb


@dataclass(frozen=True)
class OpenedTransport:
    """A middleware with its options; components with the same ones meet."""

    middleware: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Host:
    """A machine that is reached over SSH."""

    name: str
    address: str
    user: str = ""
    """"" for whom SSH's own configuration names."""
    port: int = 0
    """Of its SSH server; 0 for what SSH's own configuration says."""
    workdir: str = ""
    """Where processes run; "" for a folder of its own below the user's home."""
    python: str = "python3"
    keep: bool = False
    """Whether processes there go on when whoever launched them is gone."""


class Security(StrEnum):
    """Who may take part in a network."""

    LOCAL = "local"
    """Who is this user on this machine: loopback, sockets and shared memory of one folder."""
    LAN = "lan"
    """Who has a key that `rcdeploy keys` made; everything is encrypted."""
    OPEN = "open"
    """Everybody who reaches it."""


@dataclass(frozen=True)
class Plan:
    """A network, checked. `processes` are in an order in which they can be started."""

    name: str
    middleware: str
    processes: tuple[Process, ...]
    links: tuple[Link, ...]
    transports: tuple[OpenedTransport, ...] = ()
    """What carries its messages, as its components will open it."""
    ways: tuple[Way, ...] = ()
    """What carries each operation between each two instances that we know."""
    notes: tuple[str, ...] = ()
    """Why something is not carried by what would be fastest."""
    hosts: tuple[Host, ...] = ()
    """Those besides the one that launches it."""
    escalations: Mapping[tuple[str, ...], Escalation] = field(default_factory=dict)
    """By system; that of the whole network by the empty one."""
    security: Security = Security.LOCAL

    @property
    def carriers(self) -> tuple[str, ...]:
        """The middlewares of its links; without links, those of its components."""
        return tuple(dict.fromkeys(way.middleware for way in self.ways)) or tuple(
            dict.fromkeys(each.middleware for each in self.transports)
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "middleware": self.middleware,
            "processes": [
                {
                    "name": each.name,
                    "component": each.component,
                    "instances": list(each.instances),
                    "command": list(each.command),
                    "cwd": str(each.cwd),
                    "env": dict(each.env),
                    "after": list(each.after),
                }
                for each in self.processes
            ],
            "links": [
                {"interface": each.interface, "provider": each.provider, "client": each.client, "verb": str(each.verb)}
                for each in self.links
            ],
            "ways": [asdict(each) for each in self.ways],
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class Overrides:
    """What the command line says about a network: `--middleware`, and `--set INSTANCE.KEY=VALUE`."""

    middleware: str | None = None
    settings: tuple[tuple[str, str], ...] = ()

    def of(self, instance: str) -> list[str]:
        """The assignments for one instance; `*` is for all."""
        return [assignment for name, assignment in self.settings if name in (instance, "*")]


@dataclass
class Node:
    """An instance and what it is an instance of."""

    instance: Instance
    linked: LinkedComponent
    wires: dict[str, str] = field(default_factory=dict)
    """The instance to use, by the name of the port that uses it."""
    qos: dict[str, Quality] = field(default_factory=dict)
    """What the network says, by the name of the port."""
    places: dict[str, Name] = field(default_factory=dict)
    """Where the network speaks of a port, by its name."""

    def place(self, port: str = "") -> Name:
        """Where to tell what is wrong with it, or with one of its ports."""
        return self.places.get(port) or self.instance.config or self.instance.name

    @property
    def name(self) -> str:
        return self.instance.name.text

    @property
    def component(self) -> Component:
        return self.linked.component


def make_plan(
    path: Path, workspace: Workspace, overrides: Overrides | None = None, usable: Usable = installed_here
) -> Plan | None:
    """The plan of a DDSL file; None if anything is wrong, which the workspace's report then says.

    `usable` tells which middlewares may be chosen where the network leaves that open.
    """
    model = workspace.deployment(path)
    if model is None:
        return None
    with installed.asked_once():
        plan = _Planner(model, workspace, overrides or Overrides(), usable).plan()
    return None if workspace.report.errors else plan


class _Planner:
    def __init__(self, model: Deployment, workspace: Workspace, overrides: Overrides, usable: Usable) -> None:
        self._model, self._workspace, self._overrides, self._usable = model, workspace, overrides, usable
        self._report: Report = workspace.report
        self._folder = model.source.path.parent
        self._instances = [instance.name.text for instance in model.instances]
        self._together = processes_of(model)
        self._links: list[Link] = []
        self._configured: list[Configured] = []
        self._programs: list[Configured] = []
        self._choice = Choice()
        self._unfit: set[str] = set()
        """Middlewares that were complained about where the network names them."""

    def plan(self) -> Plan:
        self._check_network()
        nodes = self._nodes()
        for node in nodes:
            self._wire(node, nodes)
            self._read_qos(node)
        ordered = self._in_order(nodes)
        for node in (node for together in ordered.values() for node in together):
            if node.instance.path:
                self._note_program(node)
            else:
                self._configure(node)
        self._check_routes(nodes)
        self._check_waiting()
        self._choice = choose([*self._configured, *self._programs], self._usable)
        processes = [self._process(name, together) for name, together in ordered.items()]
        named = self._overrides.middleware or (self._model.middleware.text if self._model.middleware else "")
        return Plan(
            self._model.name.text,
            named or settings.AUTO,
            tuple(each for each in processes if each),
            tuple(self._links),
            tuple(self._transports()),
            self._choice.ways,
            self._choice.notes,
        )

    # The network as a whole.

    def _check_network(self) -> None:
        model = self._model
        named = [instance for instance in model.instances if instance.middleware]
        self._check_middleware(model.middleware, [each for each in model.instances if each not in named])
        if self._overrides.middleware:
            self._check_middleware(Name(self._overrides.middleware, model.name.span), model.instances, override=True)
        for word in (*model.later, *(word for instance in model.instances for word in instance.later)):
            self._error("not-yet", f"`{word}` is not understood by this version yet", word)
        for instance in model.instances:
            self._check_instance(instance)
        own_programs = {instance.name.text: instance.path for instance in model.instances if instance.path}
        for name, _ in self._overrides.settings:
            if name != "*" and name not in self._instances:
                message = f"--set {name}.…: {unknown('instance', name, self._instances)}"
                self._error("unknown-instance", message, model.name)
            elif name in own_programs:
                message = f"--set {name}.…: `{name}` is a program of your own, which is not configured from here"
                self._error("configuration", message, own_programs[name], "give it `args` or `env`")
        if not model.instances and not self._report.errors:
            self._report.warning("empty-deployment", "there is nothing to run", model.name.span)

    def _check_instance(self, instance: Instance) -> None:
        self._check_middleware(instance.middleware, [instance])
        if instance.ip and instance.ip.text not in LOOPBACK:
            hint = "use localhost"
            self._error(
                "not-yet", f"`{instance.ip}`: other hosts are not reached by this version yet", instance.ip, hint
            )
        for name in (instance.path, instance.config):
            file = self._folder / name.text if name else None
            if name and file and not file.is_file():
                self._error("missing-file", f"there is no file {file}", name, nearby(file, name.text))
            elif name and file and name is instance.path and not os.access(file, os.X_OK):
                self._error("not-executable", f"{file} is not executable", name)

    def _check_middleware(self, name: Name | None, users: Iterable[Instance], *, override: bool = False) -> None:
        """Whether a middleware can carry what those send for whom the network names it."""
        carried = settings.carrier(name.text, "") if name else ""
        if name is None or not carried:
            return
        fault = unfit(carried)
        if fault is None and override is bool(self._overrides.middleware) and stays_inside(carried):
            alone = [each.name.text for each in users if not each.path and not self._shared(each)]
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
        for path in self._workspace.components_of_model(self._model):
            linked = self._workspace.component(path)
            if linked:
                known[linked.component.name.lower()] = linked
        read = {linked.path.stem for linked in known.values()}
        unread = {PurePosixPath(name.text).stem for name in self._model.imports} - read
        complete = len(known) == len(self._model.imports)
        nodes = []
        for instance in self._model.instances:
            found = known.get(instance.component.text.lower())
            if found:
                nodes.append(Node(instance, found))
                continue
            hint = did_you_mean(instance.component.text, [each.component.name for each in known.values()])
            if complete or (hint and not mistyped(instance.component.text, unread)):
                message = f"unknown component `{instance.component}`"
                self._error("unknown-component", message, instance.component, hint or "import its .cdsl")
        return nodes

    # Who uses whom.

    def _wire(self, node: Node, nodes: Sequence[Node]) -> None:
        wirings: dict[str, Wiring] = {}
        astray: set[Verb] = set()
        """Of wirings whose port is not there: they may be meant for any port that has none."""
        for wiring in node.instance.wirings:
            port = self._wired_port(node, wiring)
            if port:
                wirings[port.name] = wiring
                node.places[port.name] = wiring.instance
            else:
                astray.add(Verb(wiring.verb.text))
        there = {other.name for other in nodes}
        complete = len(nodes) == len(self._model.instances)
        for port in node.component.ports:
            given = wirings.get(port.name)
            lost = given.instance.text not in there if given else port.verb in astray
            if not port.verb.provides and not lost:
                self._wire_port(node, port, given, nodes, complete)

    def _wired_port(self, node: Node, wiring: Wiring) -> Port | None:
        verb = Verb(wiring.verb.text)
        ports = {port.label: port for port in node.component.ports if port.verb is verb}
        if wiring.port.text not in ports:
            message = f"`{node.component.name}` has no `{verb} {wiring.port}`"
            hint = did_you_mean(wiring.port.text, ports) or (f"it has: {', '.join(ports)}" if ports else "")
            self._error("unknown-port", message, wiring.port, hint)
        return ports.get(wiring.port.text)

    def _wire_port(self, node: Node, port: Port, wiring: Wiring | None, nodes: Sequence[Node], complete: bool) -> None:
        others = nodes if wiring else [other for other in nodes if other is not node]
        offers = [(other, theirs) for other in others for theirs in _offered(other, port)]
        at = wiring.instance if wiring else node.instance.name
        if wiring:
            offers = [offer for offer in offers if offer[0].name == wiring.instance.text]
            if not offers:
                what = "implement" if port.verb is Verb.REQUIRES else "publish"
                self._error("nobody-provides", f"`{wiring.instance}` does not {what} `{port.interface.short}`", at)
                return
        if not offers:
            self._report_nobody(node, port, complete)
            return
        providers = list(dict.fromkeys(other.name for other, _ in offers))
        if len(providers) > 1 and port.verb is Verb.REQUIRES:
            names = ", ".join(f"`{name}`" for name in providers)
            likely = providers[min(int(port.number or 0), len(providers) - 1)]
            hint = f"write in its block: requires {port.label} from {likely};"
            message = f"`{port.label}` for `{node.name}`: {names} implement it"
            ones = dict.fromkeys(other.instance.name for other, _ in offers)
            self._error("ambiguous-provider", message, at, hint, *(("one is here", name) for name in ones))
            return
        for other, theirs in offers:
            self._check_match(node, port, other, theirs, at)
            self._links.append(Link(port.interface.short, other.name, node.name, port.verb))
        if len(providers) == 1:
            segments = list(dict.fromkeys(other.component.segment(theirs) for other, theirs in offers))
            exact = segments[0] != port.interface.short
            node.wires[port.name] = f"{providers[0]}/{segments[0]}" if exact else providers[0]

    def _report_nobody(self, node: Node, port: Port, complete: bool) -> None:
        if not complete:
            return  # an instance that could not be read may provide it
        if port.verb is Verb.REQUIRES:
            message = f"`{node.name}` requires `{port.interface.short}`, which nobody implements"
            self._error("nobody-provides", message, node.instance.name)
        else:
            message = f"`{node.name}` subscribes to `{port.interface.short}`, which nobody publishes"
            self._report.warning("nobody-publishes", message, node.instance.name.span)

    def _check_match(self, node: Node, port: Port, other: Node, theirs: Port, at: Name) -> None:
        offered = {operation.name: operation for operation, _ in theirs.interface.under(theirs.verb)}
        for operation, _ in port.interface.under(port.verb):
            match = offered.get(operation.name)
            if match is None or match.fingerprint != operation.fingerprint:
                what = "; ".join(differences(operation.text, match.text)) if match else "it is absent there"
                message = f"`{port.interface.short}.{operation.name}` means something else in `{other.name}`: {what}"
                hint = "generate both from the same IDSL"
                self._error("contract-mismatch", message, at, hint, ("the other one", other.instance.name))
                return
        if port.verb.is_topic and (node.instance.path or other.instance.path):  # the others are compared as configured
            for fault in unmet(port, port.qos, other.name, theirs.qos):
                self._error(fault.code, fault.message, at, fault.hint, ("the publisher", other.instance.name))

    # QoS.

    def _read_qos(self, node: Node) -> None:
        for quality in node.instance.qos:
            if node.instance.path:
                message = f"`{node.name}` is a program of your own, whose QoS is not set from here"
                self._error("configuration", message, quality.port, "remove it")
            elif port := self._port_of(node, quality):
                node.qos[port.name] = quality
                node.places[port.name] = quality.port

    def _port_of(self, node: Node, quality: Quality) -> Port | None:
        """The one whose QoS is said; None, and reported, if it is none, or may be two."""
        verbs = [Verb(quality.verb.text)] if quality.verb else [Verb.PUBLISHES, Verb.SUBSCRIBES]
        there = [port for port in node.component.ports if port.verb in verbs]
        named = [port for port in there if port.label == quality.port.text]
        if len(named) == 1:
            return named[0]
        at = quality.port
        calls = [port.label for port in node.component.ports if not port.verb.is_topic]
        if named:
            ways = " or ".join(f"`qos {port.verb} {at}(…)`" for port in named)
            message = f"`{node.component.name}` publishes and subscribes to `{at}`"
            self._error("ambiguous-port", message, at, f"write {ways}")
        elif at.text in calls and not quality.verb:
            self._error("qos-of-calls", "only what is published or subscribed to has a QoS", at)
        else:
            what = " or ".join(f"`{verb} {at}`" for verb in verbs)
            labels = dict.fromkeys(port.label for port in there)
            hint = did_you_mean(at.text, labels) or (f"it has: {', '.join(labels)}" if labels else "")
            self._error("unknown-port", f"`{node.component.name}` has no {what}", at, hint)
        return None

    # In which order, and how.

    def _in_order(self, nodes: Sequence[Node]) -> dict[str, list[Node]]:
        """Processes, and who is in them: those others depend on first; else as written."""
        first, _ = start_order({node.name: node.instance.dependences for node in nodes})
        by_name = {node.name: node for node in nodes}
        together: dict[str, list[Node]] = {}
        for node in map(by_name.__getitem__, first):
            together.setdefault(node.instance.runs_in.text, []).append(node)
        order, _ = start_order(process_dependences(self._model))
        return {name: together[name] for name in order if name in together}

    def _process(self, name: str, together: Sequence[Node]) -> Process | None:
        commands = [command for node in together if (command := self._command(node))]
        if len(commands) < len(together):
            return None
        *_, only = together
        return Process(
            name,
            ", ".join(node.component.name for node in together),
            tuple(_joined(commands)),
            self._folder.resolve() if only.instance.path else Path.cwd(),
            self._variables(only),
            tuple(dict.fromkeys(other.text for other in process_dependences(self._model)[name])),
            notifies=only.instance.path is None,
            members=tuple(Member(node.name, node.component.name) for node in together) if only.instance.process else (),
            files=tuple(dict.fromkeys(file for node in together for file in self._files(node))),
        )

    def _files(self, node: Node) -> Iterator[Path]:
        """What the command of an instance names of the files here."""
        if node.instance.path:
            yield (self._folder / node.instance.path.text).resolve()
            return
        yield node.linked.path.parent.resolve()
        config = self._config(node)
        if node.instance.config and config:
            yield config.resolve()

    def _variables(self, node: Node) -> dict[str, str]:
        """The environment that the network gives to the process of an instance."""
        together = self._together[node.instance.runs_in.text]
        return {variable.name.text: variable.value.text for each in together for variable in each.env}

    def _command(self, node: Node) -> list[str] | None:
        """What starts an instance that has a process of its own."""
        arguments = [name.text for name in node.instance.args]
        if node.instance.path:
            return [str((self._folder / node.instance.path.text).resolve()), *arguments]
        folder = node.linked.path.parent
        config = self._config(node)
        assignments = [*(each for each, _ in self._assignments(node)), *self._choice.settings.get(node.name, ())]
        if not (folder / "generic" / "genericworker.py").is_file():
            hint = f"run: rcgen {node.linked.path}"
            self._error("not-generated", f"`{node.component.name}` has not been generated", node.instance.name, hint)
            return None
        command = [*_RUN, str(folder.resolve()), "--name", node.name]
        command += ["--config", str(config.resolve())] if node.instance.config and config else []
        here = [each.name.text for each in self._together[node.instance.runs_in.text]]
        command += [part for name in node.instance.dependences if name.text in here for part in ("--after", name.text)]
        return [*command, *(part for each in assignments for part in ("--set", each)), *arguments]

    def _config(self, node: Node) -> Path | None:
        if node.instance.config:
            path = self._folder / node.instance.config.text
            return path if path.is_file() else None
        return settings.find(node.linked.path.parent)

    def _assignments(self, node: Node) -> Iterator[tuple[str, str]]:
        """What the deployment sets, weakest first, and who says so."""
        network = str(self._model.source.path)
        if self._model.namespace:
            yield f"namespace={self._model.namespace}", network
        named = node.instance.middleware or self._model.middleware
        if self._overrides.middleware:
            yield f"middleware={self._overrides.middleware}", f"--middleware {self._overrides.middleware}"
        elif named:
            yield f"middleware={named}", network
        if node.instance.port:
            yield f"transports.zeromq.bind=tcp://127.0.0.1:{whole(node.instance.port.text)}", network
        for port, source in node.wires.items():
            yield f"ports.{port}.from={source}", network
        for port, quality in node.qos.items():
            line, _ = self._model.source.position(quality.span.start)
            yield f"ports.{port}.qos={toml(read_qos(quality.settings, Report()))}", f"{network}:{line}"
        for assignment in self._overrides.of(node.name) if not node.instance.path else ():
            yield assignment, f"--set {assignment}"

    def _note_program(self, node: Node) -> None:
        """What is known of a program of somebody's own: what the network says of it."""
        document = Document()
        for assignment, origin in self._assignments(node):
            settings.override(document, assignment, origin)
        known, _ = settings.examine(node.component, document, node.name)
        middleware = generated_for(node.linked.path.parent)
        self._programs.append(Configured(node.name, node.component, known, document, middleware, is_program=True))

    def _configure(self, node: Node) -> None:
        at = node.place()
        config = self._config(node)
        try:
            params = node.component.params
            document = settings.read(config, params) if config else Document(params=params)
            settings.environment(document, node.component, {**os.environ, **self._variables(node)})
            for assignment, origin in self._assignments(node):
                settings.override(document, assignment, origin)
        except NotToml:
            source = self._workspace.source(config) if config else None
            if source:
                check_text(source, node.component, self._workspace)
            return
        except ConfigurationError as exc:
            self._error("configuration", f"`{node.name}` is configured wrongly: {exc}", at)
            return
        checked, complaints = settings.examine(node.component, document, node.name)
        for each in complaints:
            self._report.extend([_complaint(node, config, document, each)])
        if complaints:
            return
        middleware = generated_for(node.linked.path.parent)
        shared = self._shared(node.instance)
        self._configured.append(Configured(node.name, node.component, checked, document, middleware, shared))

    def _transports(self) -> Iterator[OpenedTransport]:
        found: list[OpenedTransport] = []
        for each in self._configured:
            chosen = {way.middleware for way in self._choice.ways if each.name in (way.client, way.provider)}
            for name in sorted((each.middlewares() | chosen) - {""}):
                opened = OpenedTransport(name, each.settings.transports.get(name, {}))
                if opened not in found:
                    found.append(opened)
                    yield opened

    def _check_routes(self, nodes: Sequence[Node]) -> None:
        named = {node.name: node for node in nodes}
        faults = check_routes(self._configured, self._instances, self._unfit)
        unkept = (*unsupported(self._configured), *unsupported_by_others(self._configured))
        for fault in (*faults, *worth_telling(unkept)):
            blame = [("the publisher", named[fault.other].instance.name)] if fault.other else []
            at = named[fault.instance].place(fault.port)
            self._error(fault.code, fault.message, at, fault.hint, *blame)

    def _check_waiting(self) -> None:
        for each in endless(self._model, self._requirements()):
            what = each.requirement
            message = (
                f"`{each.waiting}` would never start: `{each.name}` is not ready before that, "
                f"since `{what.client}` requires `{what.interface}` of `{what.provider}`"
            )
            hint = "components find each other in whatever order they start: leave this out"
            self._error("dependence-cycle", message, each.name, hint)

    def _requirements(self) -> Iterator[Requirement]:
        """For whom each instance waits, where it is one that it waits for."""
        for client in self._configured:
            for port, operation in client.operations(providing=False):
                own, *_ = client.aims(port, operation)
                servers = [server.name for server, offers in providers(client, port, own, self._configured) if offers]
                if port.verb is Verb.REQUIRES and len(servers) == 1:
                    yield Requirement(client.name, port.interface.short, servers[0])

    def _error(self, code: str, message: str, at: Name, hint: str = "", *related: tuple[str, Name]) -> None:
        self._report.error(code, message, at.span, hint, *((text, name.span) for text, name in related))


def _complaint(node: Node, config: Path | None, document: Document, complaint: Complaint) -> Diagnostic:
    """Something wrong with a configuration, in its file, or else where the instance stands that somebody set it for."""
    origin = document.overridden(complaint.key) if complaint.key else ""
    if config and not origin:
        source = Source(config, document.text)
        return Diagnostic(complaint.code, complaint.message, span_of(source, document, complaint))
    message = f"`{node.name}` is configured wrongly: {f'{origin}: ' if origin else ''}{complaint.message}"
    return Diagnostic(complaint.code, message, node.place().span)


def _offered(node: Node, wanted: Port) -> list[Port]:
    """The ports of an instance that offer what a port uses."""
    verb = Verb.IMPLEMENTS if wanted.verb is Verb.REQUIRES else Verb.PUBLISHES
    return [p for p in node.component.ports if p.verb is verb and p.interface.short == wanted.interface.short]


_RUN = (sys.executable, "-m", "robocomp_py.cli.rc", "run")


def _joined(commands: Sequence[Sequence[str]]) -> list[str]:
    """One command for several instances, from those that would run each of them alone."""
    first, *others = commands
    return [*first, *(part for command in others for part in (BETWEEN, *command[len(_RUN) :]))]
