"""Text to model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from lark import Token, Tree

from ..diagnostics import Report
from ..source import Name, Source, Span
from ..syntax import Grammar, Parsed, name_of, tree_span
from . import model as m

_GRAMMAR = Grammar("ddsl")


def parse(source: Source, report: Report) -> m.Deployment | None:
    """The model of a file, without what could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed, report).deployment(parsed.tree) if parsed.tree is not None else None


class _Builder:
    def __init__(self, parsed: Parsed, report: Report) -> None:
        self._parsed, self._source, self._report = parsed, parsed.comments.source, report

    def deployment(self, tree: Tree[Token]) -> m.Deployment:
        *imports, deployment = tree.children
        assert isinstance(deployment, Tree)
        name, *items = deployment.children
        model = m.Deployment(
            self._source,
            tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree)),
            self._name(name),
            self._span(deployment),
            tuple(self._instance(each) for each in items if isinstance(each, Tree) and each.data == "component"),
            skipped=self._parsed.skipped,
        )
        self._check_once(items)
        for item in items:
            assert isinstance(item, Tree)
            match item.data:
                case "middleware":
                    model = replace(model, middleware=self._name(item.children[0]))
                case "namespace":
                    model = replace(model, namespace="/".join(map(str, item.children)))
                case "later":
                    model = replace(model, later=(*model.later, self._name(item.children[0])))
        return model

    def _instance(self, tree: Tree[Any]) -> m.Instance:
        names = [self._name(child) for child in tree.children if isinstance(child, Token)]
        instance = m.Instance(names[0], self._span(tree), names[1] if len(names) > 1 else None)
        self._check_once(tree.children)
        for clause in tree.children:
            if isinstance(clause, Tree):
                words = [self._name(each) for each in clause.children if isinstance(each, Token)]
                instance = getattr(self, f"_{clause.data}")(instance, words, self._span(clause))
        return instance

    def _check_once(self, clauses: Sequence[Any]) -> None:
        seen: dict[str, Tree[Any]] = {}
        for clause in clauses:
            if isinstance(clause, Tree) and clause.data in _ONCE:
                first = seen.setdefault(clause.data, clause)
                if first is not clause:
                    related = ("first here", self._span(first))
                    self._report.error("duplicate", f"`{clause.data}` is given twice", self._span(clause), "", related)

    def _path(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, path=names[0])

    def _ip(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, ip=names[0])

    def _port(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, port=names[0])

    def _config(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, config=names[0])

    def _dependences(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, dependences=(*instance.dependences, *names))

    def _middleware(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, middleware=names[0])

    def _env(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, env=(*instance.env, m.Variable(names[0], names[1], span)))

    def _args(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, args=(*instance.args, *names))

    def _wiring(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, wirings=(*instance.wirings, m.Wiring(names[0], names[1], names[2], span)))

    def _later(self, instance: m.Instance, names: list[Name], span: Span) -> m.Instance:
        return replace(instance, later=(*instance.later, names[0]))

    def _name(self, token: Any) -> Name:
        return name_of(self._source, token)

    def _span(self, tree: Tree[Any]) -> Span:
        return tree_span(self._source, tree)


_ONCE = ("path", "ip", "port", "config", "middleware", "namespace")
