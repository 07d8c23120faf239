"""Model to diagnostics: what is wrong with a component, given the interfaces it can use."""

from __future__ import annotations

import keyword
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...contract.component import MAX_SECONDS, TAKEN, Port, numbers
from ...contract.goal import POLICIES
from ...contract.interface import Interface, Verb
from ...contract.statemachine import StateMachine
from ...spelling import enumerated
from ..diagnostics import Proposals, Report, did_you_mean
from ..source import Name
from . import model as m
from .qos import read_qos

OPTIONS = ("dsr", "agmagent", "innermodelviewer")
"""Options that RoboComp's generators know; only `agmagent` has an effect here."""

FOREIGN = ("ros",)
"""Markers that RoboComp's generators know; they have no effect here."""

_ONCE = ("language", "gui", "statemachine", "params", "period")


@dataclass(frozen=True)
class Surroundings:
    """What a component is checked against."""

    interfaces: Mapping[str, Sequence[Interface]]
    """What its imports (and theirs) define, by unqualified name."""
    importable: Collection[str]
    """The names of the IDSL files that could be imported, without their ending."""
    middlewares: Collection[str]
    """What is installed."""
    machine: StateMachine | None = None
    """The component's own, if it has one without errors."""
    has_window: bool = False
    """Whether a `gui` has an effect for its files."""


def check(model: m.Component, around: Surroundings, report: Report) -> None:
    _Checker(model, around, report).check()


@dataclass
class _Checker:
    model: m.Component
    around: Surroundings
    report: Report

    def check(self) -> None:
        self.propose = Proposals()
        if self.model.name.text.startswith("__"):
            message = "names that begin with two underscores are reserved by Python"
            self.report.error("reserved-name", message, self.model.name.span, "give it another name")
        elif keyword.iskeyword(self.model.name.text):
            message = f"`{self.model.name}` is a keyword of Python, so no module can be imported by this name"
            self.report.warning("keyword-name", message, self.model.name.span, "give it another name")
        for item in self.model.ports:
            self._check_item(item)
        self._check_port_names()
        self._check_attributes()
        self._check_clauses()
        self._check_language()
        if self.model.period:
            self._check_period("period", self.model.period)
        self._check_timers()

    # Ports.

    def _check_item(self, item: m.Item) -> None:
        self._check_extras(item)
        found = self.around.interfaces.get(item.interface.text, ())
        if not found:
            self._report_unknown(item.interface)
            return
        if len(found) > 1:
            message = f"`{item.interface}` is {enumerated(each.name for each in found)}"
            self.report.error("ambiguous-interface", message, item.interface.span, "import one of them only")
        interface = found[0]
        self._check_policies(item, interface)
        if item.each and item.verb is Verb.IMPLEMENTS and interface.actions:
            message = f"`{item.interface}` has actions, which named instances cannot have"
            self.report.error("wrong-each", message, item.each, "remove it, or move its actions to another interface")
        if not (interface.operations or interface.actions):
            self.report.warning("empty-interface", f"`{item.interface}` has no operations", item.interface.span)
        else:
            self._check_verb(item, interface)

    def _check_extras(self, item: m.Item) -> None:
        """Check what follows the interface; the interface does not matter for it."""
        if item.qos and not item.verb.is_topic:
            message = "only publications and subscriptions have a QoS"
            self.report.error("qos-of-calls", message, item.qos[0].span.to(item.qos[-1].span))
        elif item.qos:
            read_qos(item.qos, self.report)
        if item.concurrent and item.verb.has_proxy:
            message = "only implemented and subscribed interfaces can be concurrent"
            self.report.error("concurrent-proxy", message, item.concurrent_at or item.interface.span, "remove it")
        if item.each and not item.verb.provides:
            message = "only implemented and published interfaces have named instances"
            self.report.error("wrong-each", message, item.each, "remove it")
        if item.marker:
            self._check_marker(item.marker)

    def _check_policies(self, item: m.Item, interface: Interface) -> None:
        actions = [each.name for each in interface.actions]
        seen: dict[str, Name] = {}
        for action, policy in item.policies:
            if item.verb is not Verb.IMPLEMENTS:
                message = "the component that implements an action decides about its goals"
                self.report.error("wrong-policy", message, action.span.to(policy.span), "remove it")
                continue
            if action.text not in actions:
                hint = did_you_mean(action.text, actions) or (f"its actions: {', '.join(actions)}" if actions else "")
                message = f"`{action}` is no action of `{item.interface}`"
                self.report.error("wrong-policy", message, action.span, hint or "it has no actions: remove it")
            first = seen.setdefault(action.text, action)
            if first is not action:
                message = f"`{action}` has two policies"
                self.report.error("wrong-policy", message, action.span, "remove one", ("first here", first.span))
            if policy.text.lower() not in POLICIES:
                hint = did_you_mean(policy.text.lower(), POLICIES) or f"write one of {', '.join(POLICIES)}"
                message = f"`{policy}` does not tell what happens to a goal while another one is active"
                self.report.error("wrong-policy", message, policy.span, hint)

    def _check_verb(self, item: m.Item, interface: Interface) -> None:
        left_out = [operation for operation in interface.operations if not operation.carried(item.verb)]
        twoway = [f"`{operation.name}`" for operation in left_out if operation.pattern is None]
        if twoway and len(left_out) == len(interface.operations):
            message = (
                f"this port is empty: no operation of `{item.interface}` can be published, because all return something"
            )
            instead = Verb.REQUIRES if item.verb is Verb.SUBSCRIBES else Verb.IMPLEMENTS
            hint = f"write `{instead} {item.interface};`, or remove it"
            self.report.warning("empty-port", message, item.interface.span, hint)
        elif twoway:
            message = f"{', '.join(twoway)} cannot be published: a publication returns nothing"
            hint = f"`{item.verb}` leaves {'it' if len(twoway) == 1 else 'them'} out"
            self.report.warning("not-a-publication", message, item.interface.span, hint)
        elif len(left_out) == len(interface.operations) and not interface.actions_under(item.verb):
            self.report.error(
                "wrong-verb",
                f"no operation of `{item.interface}` takes part in `{item.verb}`",
                item.interface.span,
                "it has no publications" if item.verb.is_topic else "it has publications only",
            )

    def _check_marker(self, marker: Name) -> None:
        name = marker.text.lower()
        if name in self.around.middlewares:
            return
        if name in FOREIGN:
            message = f"middleware `{marker}` is not supported; that of the component is used"
            self.report.warning("foreign-middleware", message, marker.span)
            return
        known = sorted(self.around.middlewares)
        hint = did_you_mean(name, known) or f"installed: {', '.join(known)}"
        self.report.error("unknown-middleware", f"no middleware `{marker}`", marker.span, hint)

    def _report_unknown(self, name: Name) -> None:
        if name.text in self.model.skipped:
            return
        if name.text in self.around.importable:
            hint = f'add: import "{name}.idsl";'
            self.report.error("missing-import", f"interface `{name}` is not imported", name.span, hint)
            return
        hint = self.propose(name.text, [*self.around.importable, *self.around.interfaces])
        if any(each.text.endswith(f"{name}.idsl") for each in self.model.imports):
            hint = f"`{name}.idsl` is imported, but has no interface of this name" + (f"; {hint}" if hint else "")
        self.report.error("unknown-interface", f"unknown interface `{name}`", name.span, hint)

    def _check_port_names(self) -> None:
        """`Laser` used twice and `Laser1` would share a name."""
        self._check_each_alone()
        seen: dict[tuple[bool, str], m.Item] = {}
        uses = [(item.verb, item.interface.text) for item in self.model.ports]
        for item, number in zip(self.model.ports, numbers(uses), strict=True):
            proxy = item.verb.has_proxy
            name = (item.interface.text.lower() if proxy else item.interface.text) + number
            first = seen.setdefault((proxy, name), item)
            if first is not item:
                message = f"`{item.interface}` and `{first.interface}` are both called `{name}` here"
                related = ("first here", first.interface.span)
                self.report.error("same-port-name", message, item.interface.span, "", related)

    def _check_each_alone(self) -> None:
        """`implements Laser each` and `implements Laser` would share their names."""
        seen: dict[tuple[Verb, str], m.Item] = {}
        for item in self.model.ports:
            first = seen.setdefault((item.verb, item.interface.text), item)
            if first is not item and (first.each or item.each):
                message = f"`{item.verb} {item.interface} each` stands for any number of instances"
                related = ("first here", first.interface.span)
                self.report.error("same-port-name", message, item.interface.span, "remove one of them", related)

    def _check_attributes(self) -> None:
        """`B_c` of `A` and `c` of `A_B` would be one method, `A_B_c`."""
        seen: dict[str, tuple[m.Item, Port, str]] = {}
        uses = [(item.verb, item.interface.text) for item in self.model.ports]
        for item, number in zip(self.model.ports, numbers(uses), strict=True):
            for interface in self.around.interfaces.get(item.interface.text, ())[:1]:
                port = Port(item.verb, interface, number, each=item.each is not None and item.verb.provides)
                for name, what in _attributes(port):
                    if name in TAKEN:
                        message = f"{what} would be called `{name}` in Python, as a method that every component has"
                        hint = "give the operation or the interface another name"
                        self.report.error("same-attribute", message, item.interface.span, hint)
                    first, other, known = seen.setdefault(name, (item, port, what))
                    said = other.name == port.name and other.verb.has_proxy == port.verb.has_proxy  # of the ports
                    if first is not item and not said:
                        message = f"{what} and {known} are both called `{name}` in Python"
                        related = ("first here", first.interface.span)
                        self.report.error("same-attribute", message, item.interface.span, "rename one", related)
        self._check_others({name: item.interface for name, (item, _, _) in seen.items()})

    def _check_others(self, handlers: Mapping[str, Name]) -> None:
        """`one` of an interface `sm` and a state `one` would be one method, `sm_one`; timers likewise."""
        machine = self.around.machine
        for name in (*(state.method for state in machine.every_state()), *machine.triggers()) if machine else ():
            if name in handlers:
                message = f"this and the state machine both have a `{name}` in Python"
                self.report.error("same-attribute", message, handlers[name].span, "rename one")
        for timer in self.model.timers:
            if timer.method in handlers:
                message = f"this timer and `{handlers[timer.method]}` both have a `{timer.method}` in Python"
                related = ("here", handlers[timer.method].span)
                self.report.error("same-attribute", message, timer.name.span, "rename one", related)

    # Clauses.

    def _check_clauses(self) -> None:
        for kind in _ONCE:
            clauses = self.model.all(kind)
            for extra in clauses[1:]:
                related = ("first here", clauses[0].span)
                self.report.error("duplicate", f"`{kind}` is given twice", extra.span, "", related)
        for option in (name for clause in self.model.all("options") for name in clause.names):
            if option.text.lower() == "agmagent":
                self._check_agent(option)
            elif option.text.lower() in OPTIONS:
                self.report.warning("ineffective-option", f"option `{option}` has no effect here", option.span)
            else:
                hint = did_you_mean(option.text, OPTIONS)
                self.report.warning("unknown-option", f"unknown option `{option}`", option.span, hint)
        for clause in () if self.around.has_window else self.model.all("gui"):
            self.report.warning("ineffective-gui", "a `gui` has no effect yet", clause.span)
        for clause in self.model.all("legacy"):
            message = f"`{clause.names[0]}` is from an older RoboComp and has no effect"
            self.report.warning("legacy-clause", message, clause.span, _instead_of(clause))

    def _check_agent(self, option: Name) -> None:
        missing = [f"{name}.idsl" for _, name in self.model.unnamed_agent_ports]
        if missing:
            message = f"option `{option}` adds no ports for {', '.join(missing)}: no such file is found"
            self.report.warning("ineffective-option", message, option.span, "name their folder with -I")

    def _check_language(self) -> None:
        language = self.model.language
        hint = "write `language python;`"
        if language is None and "language" not in {word.lower() for word in self.model.skipped}:
            self.report.warning("no-language", "no language is given", self.model.name.span, hint)
        elif language and "python" not in language.text.lower():
            message = f"`language {language}`: a Python component is generated anyway"
            self.report.warning("not-python", message, language.span, hint)

    def _check_timers(self) -> None:
        seen: dict[str, Name] = {}
        for timer in self.model.timers:
            self._check_period("timer", timer.period, f"timer {timer.name}")
            first = seen.setdefault(timer.name.text, timer.name)
            if first is not timer.name:
                related = ("first here", first.span)
                self.report.error(
                    "duplicate", f"timer `{timer.name}` is declared twice", timer.name.span, "rename one", related
                )
            if timer.name.text.startswith("_"):
                message = "names of timers do not begin with an underscore"
                self.report.error("reserved-name", message, timer.name.span, "give it another name")
            elif keyword.iskeyword(timer.name.text):
                message = f"`{timer.name}` is a keyword of Python"
                self.report.error("reserved-name", message, timer.name.span, "give it another name")

    def _check_period(self, kind: str, period: m.Amount, clause: str = "period") -> None:
        units = ", ".join(m.SECONDS)
        if period.unit is None:
            hint = f"write `{clause} {period.span.text} ms;` (units: {units})"
            self.report.error("bad-period", f"a {kind} needs a unit", period.span, hint)
        elif period.seconds is None:
            message = f"`{period.unit}` is not a unit of time; allowed: {units}"
            self.report.error("bad-period", message, period.unit.span, did_you_mean(period.unit.text, m.SECONDS))
        elif not 0 < period.seconds <= MAX_SECONDS:
            message = f"a period must be positive, and at most {MAX_SECONDS:g} s"
            self.report.error("bad-period", message, period.span)


def _instead_of(legacy: m.Clause) -> str:
    """The present form of a clause of an older RoboComp."""
    word, *values = (name.text.lower() for name in legacy.names)
    if values and values[0] in ("false", "none"):
        return "remove it: this is the default"
    match word:
        case "useqt" | "qtversion":
            return "write `gui Qt;`"
        case "innermodelviewer":
            return "write `options InnerModelViewer;`"
        case "worker":
            return "remove it: a worker has threads anyway; `period 50 ms;` says how often it computes"
        case _:
            return "remove it, and import what the component needs in its specificworker.py"


def _attributes(port: Port) -> Iterator[tuple[str, str]]:
    """The names a port adds to the worker, and what each stands for."""
    if port.each:
        yield port.attribute, f"`{port.interface.short} each`"
        return
    if port.verb.has_proxy:
        yield port.attribute, f"the proxy of `{port.interface.short}`"
        return
    for name in port.interface.called(port.verb):
        yield port.handler(name), f"`{name}` of `{port.interface.short}`"
