"""Text to model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from lark import Token, Tree

from ..cdsl.parser import amount_of, setting_of
from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Builder, Grammar, Parsed
from . import model as m
from .clauses import Block, Written, clause_type, misplaced_hints
from .scope import meanings, offered, whole

_DESCRIBE = "describe it next to the components: host onboard { … }; and write here: host onboard;"
_HINTS = {
    r"\b(?:address|ip|user)\s+\w[\w-]*[.@-]\S*": 'a name with dots or dashes needs double quotes: "robot.local"',
    r"\b(?-i:host)\s+\w+\s*;?\s*\{": _DESCRIBE,
    r"\bhost\s+\w+\s*;": 'say where it is: host onboard { address "192.168.1.10"; };',
    r"\boffers\s+\w+\s*;": "name its interfaces: offers front : Laser;",
    r"\boffers\s+\w+\s*,": "each name has a clause of its own: offers front : Laser; offers back : Laser;",
    r"\b(?:requires|subscribesTo)\s+\w+\s*;": "name the instance that provides it: requires Laser from front;",
    **misplaced_hints(),
    r"\w\s+/\s*\w|\w\s*/\s+\w": "there are no spaces around the slash: left/arm",
    r"\brestart\s+\w+\s+\d\S*": "settings have names and are written in parentheses: restart on_failure(intensity 5);",
    r"\brestart\s+\w+\s*\([^);]*\d\s+\w+\s+\d": "separate settings by commas: (intensity 5, period 60)",
}
_GRAMMAR = Grammar("ddsl", _HINTS)
_BLOCKS = ("component", "system", "machine")

_B = TypeVar("_B", bound=m.Deployment | m.System | m.Instance | m.Host)


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
        model = self._with(model, clauses, Block.NETWORK, ())
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
                path = tuple(name.text.split("/"))
                self._systems.append(self._with(found, clauses, Block.SYSTEM, path))
                self._read_blocks(inside, path)

    def _host(self, tree: Tree[Any]) -> m.Host:
        name, *clauses = tree.children
        host = m.Host(self._name(name), self._span(tree), clauses=self._clauses(clauses))
        return self._with(host, clauses, Block.HOST, ())

    def _instance(self, tree: Tree[Any], system: tuple[str, ...]) -> m.Instance:
        names = [self._name(child) for child in tree.children if isinstance(child, Token)]
        clauses = [child for child in tree.children if isinstance(child, Tree)]
        kind = names[1] if len(names) > 1 else None
        instance = m.Instance(self._within(names[0], system), self._span(tree), kind, clauses=self._clauses(clauses))
        return self._with(instance, clauses, Block.INSTANCE, system)

    def _with(self, block: _B, clauses: list[Tree[Any]], kind: Block, system: tuple[str, ...]) -> _B:
        """The block with the content of its clauses. `system` is where their names are looked up."""
        for tree in clauses:
            clause = clause_type(str(tree.data), kind)
            value = clause.read(self._written(tree, system))
            if clause.many:
                value = (*getattr(block, clause.in_model), *value)
            block = replace(block, **{clause.in_model: value})
        return block

    def _written(self, tree: Tree[Any], system: tuple[str, ...]) -> Written:
        trees = [each for each in tree.children if isinstance(each, Tree)]
        return Written(
            tuple(self._name(each) for each in tree.children if isinstance(each, Token)),
            tuple(setting_of(self._source, each) for each in trees if each.data == "setting"),
            tuple(amount_of(self._source, each) for each in trees if each.data == "duration"),
            self._span(tree),
            system,
        )

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

    def _clauses(self, trees: list[Tree[Any]]) -> tuple[m.Clause, ...]:
        return tuple(m.Clause(str(each.data), self._span(each)) for each in trees)
