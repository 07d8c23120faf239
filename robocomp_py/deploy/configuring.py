"""The configuration of each instance: its file, its environment, and what the network and the command line set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from ..contract.component import Port
from ..contract.middleware import generated_for
from ..contract.parameters import Complaint
from ..dsl.cdsl.qos import read_qos as qos_of
from ..dsl.ddsl.model import Deployment, Instance
from ..dsl.ddsl.programs import environment_of
from ..dsl.diagnostics import Diagnostic, Report
from ..dsl.source import Name, Source
from ..dsl.workspace import Workspace
from ..errors import ConfigurationError
from ..runtime import settings
from ..runtime.document import Document, NotToml
from ..runtime.effective import toml
from ..transports.deployment import deployments
from . import placing
from .configuration import check_text, span_of
from .plan import Overrides
from .routes import Configured
from .uses import Node


class Configurations:
    """Configures the instances of one network. What is wrong goes to the report of its workspace."""

    def __init__(
        self,
        model: Deployment,
        workspace: Workspace,
        overrides: Overrides,
        environ: Mapping[str, str],
        together: Mapping[str, Sequence[Instance]],
    ) -> None:
        """`environ` is the environment of `rcdeploy`. `together` are the instances of each process."""
        self._model, self._workspace, self._overrides = model, workspace, overrides
        self._report = workspace.report
        self._environ, self._together = environ, together
        self._folder = model.source.path.parent
        self.configured: list[Configured] = []
        """The instances of components that rcgen generated."""
        self.programs: list[Configured] = []
        """The foreign programs."""
        self._blamed: dict[tuple[str, str, str, str], list[str]] = {}
        """The instances that an error outside of all files concerns, by name, code, message and hint."""

    def is_outside(self, node: Node, port: Port) -> bool:
        """Whether all that a port uses is found outside of the network, as its configuration says."""
        if node.instance.program:
            return False
        try:
            document = self._document(node, self.config(node))
        except ConfigurationError:
            return False  # reported when it is configured
        checked, complaints = settings.examine(node.component, document, node.instance.local)
        each = Configured(node.name, node.component, checked, document, generated_for(node.linked.path.parent))
        names = port.interface.called(port.verb)
        return not complaints and all(each.outside(port, name, aim) for name in names for aim in each.aims(port, name))

    def configure(self, node: Node) -> None:
        """Add an instance to `configured`, or say what is wrong with its configuration."""
        at = node.place()
        config = self.config(node)
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
            if not self.blames(origin, "configuration", message, "", node):
                self._report.error("configuration", f"`{node.name}` has a wrong configuration: {exc}", at.span)
            return
        checked, complaints = settings.examine(node.component, document, node.instance.local)
        complaints = [*complaints, *_undeclared(node, checked)]
        for each in complaints:
            origin = document.overridden(each.key) if each.key else ""
            if not self.blames(origin, each.code, each.message, "", node):
                self._report.extend([_complaint(node, config, document, each)])
        if complaints:
            return
        middleware = generated_for(node.linked.path.parent)
        shared = self.shared(node.instance)
        carriers = {port: name.text for port, name in self._carriers(node).items()}
        self.configured.append(
            Configured(node.name, node.component, checked, document, middleware, shared, False, node.host, carriers)
        )

    def note_program(self, node: Node) -> None:
        """Add a foreign program to `programs`: its clauses in the network, and its own configuration file.

        Of its file, only the transports count whose interfaces have ports of their own: that is where it is called.
        """
        middleware = generated_for(node.linked.path.parent)
        document = Document()
        config = self.config(node) if node.instance.config else None
        own = [name for name, each in deployments().items() if each.ports_of_interfaces]
        try:
            theirs = settings.read_for(config, node.component) if config else Document()
            for name in own:
                settings.settle(theirs, node.component, name)
        except ConfigurationError as exc:
            self._report.error("configuration", f"`{node.name}` has a wrong configuration: {exc}", node.place().span)
            return
        transports = theirs.data.get("transports", {})
        if said := {name: transports[name] for name in own if transports.get(name)}:
            document.data["transports"] = said
        for assignment, origin in self.assignments(node):
            settings.override(document, assignment, origin)
        known, complaints = settings.examine(node.component, document, node.instance.local)
        wrong = [each for each in complaints if each.key[:1] == ("transports",) and each.key[1] in own]
        self._report.extend(_complaint(node, config, theirs, each) for each in wrong)
        if wrong:
            return
        self.programs.append(
            Configured(node.name, node.component, known, document, middleware, is_program=True, host=node.host)
        )

    def shared(self, instance: Instance) -> str:
        """The process that it shares with others; "" if it has one of its own."""
        name = instance.runs_in.text
        return name if len(self._together[name]) > 1 else ""

    def blames(self, origin: str, code: str, message: str, hint: str, node: Node) -> bool:
        """Whether an environment variable or an option is the cause, which is reported once for all instances."""
        variable = origin.removeprefix(settings.VARIABLE)
        is_variable = variable != origin and variable not in self._variables(node)
        if is_variable or origin.startswith("--"):
            self._blamed.setdefault((origin, code, message, hint), []).append(node.name)
        return is_variable or origin.startswith("--")

    def tell_blamed(self) -> None:
        """Report each wrong variable or option once, with the instances that it concerns."""
        for (origin, code, message, hint), instances in self._blamed.items():
            span = Source(Path(origin), "", has_places=False).span(0, 0)
            names = ", ".join(f"`{name}`" for name in dict.fromkeys(instances))
            self._report.error(code, f"{message} (for {names})", span, hint)

    def assignments(self, node: Node) -> Iterator[tuple[str, str]]:
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
            yield from ((assignment, network) for assignment in at_port(port))
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

    def config(self, node: Node) -> Path | None:
        """The configuration file of an instance: the one that the network names, or else its component's."""
        if node.instance.config:
            path = self._folder / node.instance.config.text
            return path if path.is_file() else None
        return settings.find(node.linked.path.parent)

    def _carriers(self, node: Node) -> Mapping[str, Name]:
        """The middlewares of single links, by the port that uses; the command line counts more than they do."""
        return {} if self._overrides.middleware else node.carriers

    def _variables(self, node: Node) -> dict[str, str]:
        """The environment that the network gives to the process of an instance."""
        return environment_of(self._model, self._together[node.instance.runs_in.text])

    def _document(self, node: Node, config: Path | None) -> Document:
        """Everything that is set for an instance; raises ConfigurationError."""
        component = node.component
        document = settings.read_for(config, component) if config else Document(params=component.params)
        settings.environment(document, component, {**self._environ, **self._variables(node)})
        for assignment, origin in self.assignments(node):
            settings.override(document, assignment, origin)
        settings.settle(document, component, generated_for(node.linked.path.parent))
        return document


def at_port(port: int, provider: Configured | None = None) -> Iterator[str]:
    """The meaning of the port that the network gives to an instance; if the provider is known, for what it provides."""
    for name, each in deployments().items():
        wanted = port if provider is None or _provides_over(name, provider) else 0
        yield from (f"transports.{name}.{key}={toml(value)}" for key, value in each.at_port(wanted).items())


def _provides_over(middleware: str, each: Configured) -> bool:
    """Whether a middleware carries anything that it provides."""
    provided = ((part, at) for part in each.parts for at in part.operations(providing=True))
    return any(middleware in part.settings.middlewares(*at, part.generated_for) for part, at in provided)


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
