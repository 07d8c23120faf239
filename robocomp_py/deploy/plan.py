"""A deployment to the processes that make it up, or to all that is wrong with it.

Nothing is started here, and nothing is started at all while there is an error.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from .. import installed
from ..contract.component import Component, Port
from ..contract.interface import Verb, differences
from ..contract.parameters import Complaint
from ..dsl.ddsl.model import Deployment, Instance, Wiring
from ..dsl.ddsl.order import start_order
from ..dsl.diagnostics import Diagnostic, Report, did_you_mean, mistyped
from ..dsl.numbers import whole
from ..dsl.source import Name, Source
from ..dsl.workspace import LinkedComponent, Workspace, nearby
from ..errors import ConfigurationError
from ..runtime import settings
from ..runtime.document import Document, NotToml
from ..spelling import unknown
from .configuration import check_text, span_of
from .routes import Configured, check_routes, generated_for, unfit

LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class Process:
    """One process to run."""

    name: str
    component: str
    command: tuple[str, ...]
    cwd: Path
    env: Mapping[str, str] = field(default_factory=dict)
    after: tuple[str, ...] = ()
    """Those that must be ready before it is started."""
    notifies: bool = True
    """Whether it says itself when it is ready; else it counts as ready once it runs."""


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
class Plan:
    """A network, checked. `processes` are in an order in which they can be started."""

    name: str
    middleware: str
    processes: tuple[Process, ...]
    links: tuple[Link, ...]
    transports: tuple[OpenedTransport, ...] = ()
    """What carries its messages, as its components will open it."""

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "middleware": self.middleware,
            "processes": [
                {
                    "name": each.name,
                    "component": each.component,
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

    @property
    def name(self) -> str:
        return self.instance.name.text

    @property
    def component(self) -> Component:
        return self.linked.component


def make_plan(path: Path, workspace: Workspace, overrides: Overrides | None = None) -> Plan | None:
    """The plan of a DDSL file; None if anything is wrong, which the workspace's report then says."""
    model = workspace.deployment(path)
    if model is None:
        return None
    with installed.asked_once():
        plan = _Planner(model, workspace, overrides or Overrides()).plan()
    return None if workspace.report.errors else plan


class _Planner:
    def __init__(self, model: Deployment, workspace: Workspace, overrides: Overrides) -> None:
        self._model, self._workspace, self._overrides = model, workspace, overrides
        self._report: Report = workspace.report
        self._folder = model.source.path.parent
        self._instances = [instance.name.text for instance in model.instances]
        self._links: list[Link] = []
        self._configured: list[Configured] = []
        self._unfit: set[str] = set()
        """Middlewares that were complained about where the network names them."""

    def plan(self) -> Plan:
        self._check_network()
        nodes = self._nodes()
        for node in nodes:
            self._wire(node, nodes)
        processes = [self._process(node) for node in self._in_order(nodes)]
        self._check_routes(nodes)
        middleware = self._overrides.middleware or (self._model.middleware.text if self._model.middleware else "")
        return Plan(
            self._model.name.text,
            middleware,
            tuple(each for each in processes if each),
            tuple(self._links),
            tuple(self._transports()),
        )

    # The network as a whole.

    def _check_network(self) -> None:
        model = self._model
        self._check_middleware(model.middleware)
        if self._overrides.middleware:
            self._check_middleware(Name(self._overrides.middleware, model.name.span))
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
        self._check_middleware(instance.middleware)
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

    def _check_middleware(self, name: Name | None) -> None:
        fault = unfit(name.text) if name else None
        if name and fault:
            self._unfit.add(name.text)
            self._error(fault.code, fault.message, name, fault.hint)

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
            self._check_match(port, other, theirs, at)
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

    def _check_match(self, port: Port, other: Node, theirs: Port, at: Name) -> None:
        offered = {operation.name: operation for operation, _ in theirs.interface.under(theirs.verb)}
        for operation, _ in port.interface.under(port.verb):
            match = offered.get(operation.name)
            if match is None or match.fingerprint != operation.fingerprint:
                what = "; ".join(differences(operation.text, match.text)) if match else "it is absent there"
                message = f"`{port.interface.short}.{operation.name}` means something else in `{other.name}`: {what}"
                hint = "generate both from the same IDSL"
                self._error("contract-mismatch", message, at, hint, ("the other one", other.instance.name))
                return
        for asked, given, word in (
            (port.qos.reliable, theirs.qos.reliable, "reliable"),
            (port.qos.latched, theirs.qos.latched, "transient_local"),
        ):
            if port.verb.is_topic and asked and not given:
                message = f"`{port.interface.short}` is asked for as {word}, but `{other.name}` does not offer that"
                hint = f"publish it with qos({word})"
                self._error("qos-mismatch", message, at, hint, ("the publisher", other.instance.name))

    # In which order, and how.

    def _in_order(self, nodes: Sequence[Node]) -> list[Node]:
        """Those others depend on first; else as written."""
        order, _ = start_order({node.name: node.instance.dependences for node in nodes})
        by_name = {node.name: node for node in nodes}
        return [by_name[name] for name in order]

    def _process(self, node: Node) -> Process | None:
        command = self._command(node)
        if command is None:
            return None
        return Process(
            node.name,
            node.component.name,
            tuple(command),
            self._folder.resolve() if node.instance.path else Path.cwd(),
            {variable.name.text: variable.value.text for variable in node.instance.env},
            tuple(name.text for name in node.instance.dependences),
            notifies=node.instance.path is None,
        )

    def _command(self, node: Node) -> list[str] | None:
        arguments = [name.text for name in node.instance.args]
        if node.instance.path:
            return [str((self._folder / node.instance.path.text).resolve()), *arguments]
        folder = node.linked.path.parent
        config = self._config(node)
        assignments = list(self._assignments(node))
        self._configure(node, config, assignments)
        if not (folder / "generic" / "genericworker.py").is_file():
            hint = f"run: rcgen {node.linked.path}"
            self._error("not-generated", f"`{node.component.name}` has not been generated", node.instance.name, hint)
            return None
        command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(folder.resolve()), "--name", node.name]
        command += ["--config", str(config.resolve())] if node.instance.config and config else []
        return [*command, *(part for each, _ in assignments for part in ("--set", each)), *arguments]

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
        for assignment in self._overrides.of(node.name):
            yield assignment, f"--set {assignment}"

    def _configure(self, node: Node, config: Path | None, assignments: Iterable[tuple[str, str]]) -> None:
        at = node.instance.config or node.instance.name
        try:
            params = node.component.params
            document = settings.read(config, params) if config else Document(params=params)
            variables = {variable.name.text: variable.value.text for variable in node.instance.env}
            settings.environment(document, node.component, {**os.environ, **variables})
            for assignment, origin in assignments:
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
        self._configured.append(Configured(node.name, node.component, checked, document, middleware))

    def _transports(self) -> Iterator[OpenedTransport]:
        found: list[OpenedTransport] = []
        for each in self._configured:
            for name in sorted(each.middlewares()):
                opened = OpenedTransport(name, each.settings.transports.get(name, {}))
                if opened not in found:
                    found.append(opened)
                    yield opened

    def _check_routes(self, nodes: Sequence[Node]) -> None:
        at = {node.name: node.instance.config or node.instance.name for node in nodes}
        for fault in check_routes(self._configured, self._instances, self._unfit):
            self._error(fault.code, fault.message, at[fault.instance], fault.hint)

    def _error(self, code: str, message: str, at: Name, hint: str = "", *related: tuple[str, Name]) -> None:
        self._report.error(code, message, at.span, hint, *((text, name.span) for text, name in related))


def _complaint(node: Node, config: Path | None, document: Document, complaint: Complaint) -> Diagnostic:
    """Something wrong with a configuration, in its file, or else where the instance stands that somebody set it for."""
    origin = document.overridden(complaint.key) if complaint.key else ""
    if config and not origin:
        source = Source(config, document.text)
        return Diagnostic(complaint.code, complaint.message, span_of(source, document, complaint))
    message = f"`{node.name}` is configured wrongly: {f'{origin}: ' if origin else ''}{complaint.message}"
    return Diagnostic(complaint.code, message, (node.instance.config or node.instance.name).span)


def _offered(node: Node, wanted: Port) -> list[Port]:
    """The ports of an instance that offer what a port uses."""
    verb = Verb.IMPLEMENTS if wanted.verb is Verb.REQUIRES else Verb.PUBLISHES
    return [p for p in node.component.ports if p.verb is verb and p.interface.short == wanted.interface.short]
