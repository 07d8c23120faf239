"""Text to model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lark import Token, Tree

from ..cdsl.model import Setting
from ..cdsl.parser import amount_of, setting_of
from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Builder, Grammar, Parsed
from . import model as m
from .scope import meanings, offered, whole

_DESCRIBE = "describe it next to the components: host onboard { … }; and write here: host onboard;"
_HINTS = {
    r"\b(?:address|ip|user)\s+\w[\w-]*[.@-]\S*": 'a name with dots or dashes needs double quotes: "robot.local"',
    r"\b(?-i:host)\s+\w+\s*;?\s*\{": _DESCRIBE,
    r"\bhost\s+\w+\s*;": 'say where it is: host onboard { address "192.168.1.10"; };',
    r"\bescalation\b": "write it for the network or for a `System`",
    r"\b(?:security|namespace|clock)\b": "write it once, for the whole network",
    r"\bmiddleware\b": "write it for the network or for a component",
    r"\boffers\s+\w+\s*;": "name its interfaces: offers front : Laser;",
    r"\boffers\b": "write it in the block of the component that provides it: offers front : Laser;",
    r"\bgrace\b|\b(?-i:notifies)\s*;": "write it in the block of each component",
    r"\w\s+/\s*\w|\w\s*/\s+\w": "there are no spaces around the slash: left/arm",
    r"\brestart\s+\w+\s+\d\S*": "settings have names and are written in parentheses: restart on_failure(intensity 5);",
    r"\brestart\s+\w+\s*\([^);]*\d\s+\w+\s+\d": "separate settings by commas: (intensity 5, period 60)",
}
_GRAMMAR = Grammar("ddsl", _HINTS)
_BLOCKS = ("component", "system", "machine")


def parse(source: Source, report: Report) -> m.Deployment | None:
    """The model of a file, without the parts that could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).deployment(parsed.tree) if parsed.tree is not None else None


class _Builder(Builder):
    def __init__(self, parsed: Parsed) -> None:
        super().__init__(parsed)
        self._instances: list[m.Instance] = []
        self._systems: list[m.System] = []

    def deployment(self, tree: Tree[Token]) -> m.Deployment:
        *imports, deployment = tree.children
        assert isinstance(deployment, Tree)
        name, *items = deployment.children
        trees = [each for each in items if isinstance(each, Tree)]
        self._read_blocks(trees, ())
        clauses = [each for each in trees if each.data not in _BLOCKS]
        model = m.Deployment(
            self._source,
            tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree)),
            self._name(name),
            self._span(deployment),
            self._resolved(),
            hosts=tuple(self._host(each) for each in trees if each.data == "machine"),
            systems=tuple(self._systems),
            clauses=self._clauses(clauses),
            skipped=self._parsed.skipped,
        )
        for clause in clauses:
            model = replace(model, **self._said(clause))
        if model.clock:
            leader = self._meant(model.clock.leader, ())
            model = replace(model, clock=replace(model.clock, leader=leader))
        return model

    def _read_blocks(self, trees: list[Tree[Any]], system: tuple[str, ...]) -> None:
        """The instances and systems of a system, or of the network, in the order of the file."""
        for tree in trees:
            if tree.data == "component":
                self._instances.append(self._instance(tree, system))
            elif tree.data == "system":
                inside = [each for each in tree.children if isinstance(each, Tree)]
                clauses = [each for each in inside if each.data not in _BLOCKS]
                name = self._within(self._name(tree.children[0]), system)
                found = m.System(name, self._span(tree), clauses=self._clauses(clauses))
                for clause in clauses:
                    found = replace(found, **self._said(clause))
                self._systems.append(found)
                self._read_blocks(inside, tuple(name.text.split("/")))

    def _host(self, tree: Tree[Any]) -> m.Host:
        name, *clauses = tree.children
        host = m.Host(self._name(name), self._span(tree), clauses=self._clauses(clauses))
        for clause in clauses:
            host = replace(host, **self._said(clause))
        return host

    def _instance(self, tree: Tree[Any], system: tuple[str, ...]) -> m.Instance:
        names = [self._name(child) for child in tree.children if isinstance(child, Token)]
        clauses = [child for child in tree.children if isinstance(child, Tree)]
        kind = names[1] if len(names) > 1 else None
        instance = m.Instance(self._within(names[0], system), self._span(tree), kind, clauses=self._clauses(clauses))
        for clause in clauses:
            instance = self._with(instance, clause)
        return instance

    def _with(self, instance: m.Instance, clause: Tree[Any]) -> m.Instance:
        """The instance with the content of a clause added."""
        names, span = [self._name(each) for each in clause.children if isinstance(each, Token)], self._span(clause)
        changed: dict[str, Any]
        match str(clause.data):
            case "dependences" | "args" as many:
                changed = {many: (*getattr(instance, many), *names)}
            case "env":
                changed = {"env": (*instance.env, m.Variable(names[0], names[1], span))}
            case "wiring":
                verb, port, provider, *middleware = names
                wiring = m.Wiring(verb, port, provider, span, middleware[0] if middleware else None)
                changed = {"wirings": (*instance.wirings, wiring)}
            case "qos":
                *verbs, port = names
                quality = m.Quality(verbs[0] if verbs else None, port, self._settings(clause), span)
                changed = {"qos": (*instance.qos, quality)}
            case "offers":
                name, *rest = names
                numbers = [each for each in rest if each.text.isdecimal()]
                interfaces = tuple(each for each in rest if each not in numbers)
                offer = m.Offer(self._within(name, instance.system), interfaces, span, next(iter(numbers), None))
                changed = {"offers": (*instance.offers, offer)}
            case "process":
                changed = {"process": self._within(names[0], instance.system)}
            case _:
                changed = self._said(clause)
        return replace(instance, **changed)

    def _said(self, clause: Tree[Any]) -> dict[str, Any]:
        """The fields that a simple clause sets, by name."""
        names = [self._name(each) for each in clause.children if isinstance(each, Token)]
        match str(clause.data):
            case "middleware":
                return {"middleware": _middleware(names)}
            case "namespace":
                return {"namespace": "/".join(name.text for name in names)}
            case "restart":
                return {"restart": m.Restart(names[0], self._settings(clause), self._span(clause))}
            case "clock":
                return {"clock": m.Clock(names[0], self._settings(clause), self._span(clause))}
            case "grace":
                return {"grace": amount_of(self._source, clause.children[0])}
            case "notifies":
                return {"notifies": m.Clause("notifies", self._span(clause))}
            case one:  # it has the name of the field
                return {one: names[0]}

    def _resolved(self) -> tuple[m.Instance, ...]:
        """The instances, with references replaced by full names. An unknown name stays as it is written."""

        def meant(name: Name, instance: m.Instance) -> Name:
            return self._meant(name, instance.system)

        def provider(name: Name, instance: m.Instance) -> Name:
            found = meanings(name.text, instance.system, providers)
            return Name(providers[found[0]] if found else name.text, name.span)

        providers = {each.name.text: each.name.text for each in self._instances} | offered(self._instances)
        return tuple(
            replace(
                instance,
                dependences=tuple(meant(name, instance) for name in instance.dependences),
                wirings=tuple(replace(each, instance=provider(each.instance, instance)) for each in instance.wirings),
            )
            for instance in self._instances
        )

    def _meant(self, name: Name, system: tuple[str, ...]) -> Name:
        """The full name that a name stands for in a system."""
        known = {each.name.text for each in self._instances}
        return Name(next(iter(meanings(name.text, system, known)), name.text), name.span)

    def _within(self, name: Name, system: tuple[str, ...]) -> Name:
        return Name(whole(system, name.text), name.span)

    def _settings(self, clause: Tree[Any]) -> tuple[Setting, ...]:
        return tuple(setting_of(self._source, each) for each in clause.children if isinstance(each, Tree))

    def _clauses(self, trees: list[Tree[Any]]) -> tuple[m.Clause, ...]:
        return tuple(m.Clause(str(each.data), self._span(each)) for each in trees)


def _middleware(names: list[Name]) -> Name:
    """`zenoh`, or `auto(zenoh)` as one name."""
    first, *inner = names
    return Name(f"{first}({inner[0]})", first.span.to(inner[0].span)) if inner else first
