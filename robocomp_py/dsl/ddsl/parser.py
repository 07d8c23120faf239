"""Text to model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lark import Token, Tree

from ..cdsl.parser import setting_of
from ..diagnostics import Report
from ..source import Name, Source, Span
from ..syntax import Grammar, Parsed, name_of, tree_span
from . import model as m

_GRAMMAR = Grammar("ddsl")


def parse(source: Source, report: Report) -> m.Deployment | None:
    """The model of a file, without what could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).deployment(parsed.tree) if parsed.tree is not None else None


class _Builder:
    def __init__(self, parsed: Parsed) -> None:
        self._parsed, self._source = parsed, parsed.comments.source

    def deployment(self, tree: Tree[Token]) -> m.Deployment:
        *imports, deployment = tree.children
        assert isinstance(deployment, Tree)
        name, *items = deployment.children
        trees = [each for each in items if isinstance(each, Tree)]
        clauses = [each for each in trees if each.data != "component"]
        model = m.Deployment(
            self._source,
            tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree)),
            self._name(name),
            self._span(deployment),
            tuple(self._instance(each) for each in trees if each.data == "component"),
            clauses=self._clauses(clauses),
            skipped=self._parsed.skipped,
        )
        for clause in clauses:
            match clause.data:
                case "middleware":
                    model = replace(model, middleware=_middleware([self._name(each) for each in clause.children]))
                case "namespace":
                    model = replace(model, namespace="/".join(map(str, clause.children)))
                case "later":
                    model = replace(model, later=(*model.later, self._name(clause.children[0])))
        return model

    def _instance(self, tree: Tree[Any]) -> m.Instance:
        names = [self._name(child) for child in tree.children if isinstance(child, Token)]
        clauses = [child for child in tree.children if isinstance(child, Tree)]
        instance = m.Instance(
            names[0], self._span(tree), names[1] if len(names) > 1 else None, clauses=self._clauses(clauses)
        )
        for clause in clauses:
            instance = self._with(instance, clause)
        return instance

    def _with(self, instance: m.Instance, clause: Tree[Any]) -> m.Instance:
        """The instance with what a clause says of it."""
        names, span = [self._name(each) for each in clause.children if isinstance(each, Token)], self._span(clause)
        changed: dict[str, Any]
        match str(clause.data):
            case "dependences" | "args" as many:
                changed = {many: (*getattr(instance, many), *names)}
            case "env":
                changed = {"env": (*instance.env, m.Variable(names[0], names[1], span))}
            case "wiring":
                changed = {"wirings": (*instance.wirings, m.Wiring(names[0], names[1], names[2], span))}
            case "qos":
                *verb, port = names
                settings = tuple(setting_of(self._source, each) for each in clause.children if isinstance(each, Tree))
                changed = {"qos": (*instance.qos, m.Quality(verb[0] if verb else None, port, settings, span))}
            case "later":
                changed = {"later": (*instance.later, names[0])}
            case "middleware":
                changed = {"middleware": _middleware(names)}
            case one:  # path, ip, port, config, process
                changed = {one: names[0]}
        return replace(instance, **changed)

    def _clauses(self, trees: list[Tree[Any]]) -> tuple[m.Clause, ...]:
        return tuple(m.Clause(str(each.data), self._span(each)) for each in trees)

    def _name(self, token: Any) -> Name:
        return name_of(self._source, token)

    def _span(self, tree: Tree[Any]) -> Span:
        return tree_span(self._source, tree)


def _middleware(names: list[Name]) -> Name:
    """`zenoh`, or `auto(zenoh)` as one name."""
    first, *inner = names
    return Name(f"{first}({inner[0]})", first.span.to(inner[0].span)) if inner else first
