"""Text to model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lark import Token, Tree

from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Grammar, Parsed, name_of, tree_span
from . import model as m

_GRAMMAR = Grammar("ddsl")


def parse(source: Source, report: Report) -> m.Deployment | None:
    """The model of a file, without what could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed, report).deployment(parsed.tree) if parsed.tree is not None else None


class _Builder:
    def __init__(self, parsed: Parsed, report: Report) -> None:
        self._parsed, self._source, self._report = parsed, parsed.source, report

    def deployment(self, tree: Tree[Token]) -> m.Deployment:
        *imports, deployment = tree.children
        assert isinstance(deployment, Tree)
        name, *items = deployment.children
        model = m.Deployment(
            self._source,
            tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree)),
            self._name(name),
            tuple(self._instance(each) for each in items if isinstance(each, Tree) and each.data == "component"),
            skipped=self._parsed.skipped,
        )
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
        names = [child for child in tree.children if isinstance(child, Token)]
        kind = self._name(names[1]) if len(names) > 1 else None
        instance = m.Instance(self._name(names[0]), tree_span(self._source, tree), kind)
        seen: dict[str, Tree[Any]] = {}
        for clause in tree.children:
            if not isinstance(clause, Tree):
                continue
            first = seen.setdefault(clause.data, clause)
            if first is not clause and clause.data in _ONCE:
                related = ("first here", tree_span(self._source, first))
                message = f"`{clause.data}` is given twice"
                self._report.error("duplicate", message, tree_span(self._source, clause), "", related)
            instance = getattr(self, f"_{clause.data}")(instance, [self._name(each) for each in clause.children])
        return instance

    def _path(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, path=names[0])

    def _ip(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, ip=names[0])

    def _port(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, port=names[0])

    def _config(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, config=names[0])

    def _dependences(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, dependences=(*instance.dependences, *names))

    def _middleware(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, middleware=names[0])

    def _env(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, env=(*instance.env, m.Variable(*names)))

    def _args(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, args=(*instance.args, *names))

    def _wiring(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, wirings=(*instance.wirings, m.Wiring(*names)))

    def _later(self, instance: m.Instance, names: list[Name]) -> m.Instance:
        return replace(instance, later=(*instance.later, names[0]))

    def _name(self, token: Any) -> Name:
        return name_of(self._source, token) if isinstance(token, Token) else Name("", tree_span(self._source, token))


_ONCE = ("path", "ip", "port", "config", "middleware")
