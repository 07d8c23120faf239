"""Text to model."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from lark import Token, Tree

from ...contract.interface import Verb
from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Grammar, Parsed, name_of, tree_span
from . import model as m

_GRAMMAR = Grammar("cdsl")
_VERBS = {verb.value.lower(): verb for verb in Verb}


def parse(source: Source, report: Report) -> m.Component | None:
    """The model of a file, without what could not be read; None if not even its component could."""
    found = Report()
    parsed = _GRAMMAR.parse(source, found)
    for each in found.diagnostics:
        line = source.line(source.position(each.span.start)[0])
        if re.match(r"\s*language\s+\w+\s*//", line, re.IGNORECASE):
            each = replace(each, hint="the `//` starts a comment: write one language, then `;`")
        report.diagnostics.append(each)
    return _Builder(parsed).component(parsed.tree) if parsed.tree is not None else None


class _Builder:
    def __init__(self, parsed: Parsed) -> None:
        self._parsed, self._source = parsed, parsed.source

    def component(self, tree: Tree[Token]) -> m.Component:
        *imports, component = tree.children
        assert isinstance(component, Tree)
        name, *clauses = component.children
        model = m.Component(
            self._source,
            tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree)),
            self._name(name),
            doc=self._parsed.doc(tree_span(self._source, component)),
            skipped=self._parsed.skipped,
        )
        for clause in clauses:
            assert isinstance(clause, Tree)
            model = getattr(self, f"_{clause.data}")(model, clause)
        return model

    def _communications(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        items = []
        for statement in clause.children:
            verb = _VERBS[str(statement.children[0]).lower()]
            items += [self._item(verb, each) for each in statement.children[1:]]
        return replace(model, items=(*model.items, *items))

    def _item(self, verb: Verb, tree: Tree[Any]) -> m.Item:
        name, *extras = tree.children
        item = m.Item(verb, self._name(name))
        for extra in extras:
            match extra.data:
                case "marker":
                    item = replace(item, marker=self._name(extra.children[0]))
                case "concurrent":
                    item = replace(item, concurrent=True)
                case "qos":
                    item = replace(item, qos=tuple(self._setting(each) for each in extra.children))
        return item

    def _setting(self, tree: Tree[Any]) -> m.Setting:
        name, *value = tree.children
        if not value:
            return m.Setting(self._name(name))
        if isinstance(value[0], Tree):
            return m.Setting(self._name(name), number=_seconds(value[0]))
        return m.Setting(self._name(name), word=str(value[0]))

    def _language(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        return replace(model, language=self._name(clause.children[0]))

    def _gui(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        return replace(model, gui=self._name(clause.children[-1]))

    def _options(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        return replace(model, options=(*model.options, *map(self._name, clause.children)))

    def _statemachine(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        return replace(model, statemachine=self._name(clause.children[0]))

    def _params(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        return replace(model, params=self._name(clause.children[0]))

    def _period(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        return replace(model, period=_seconds(clause.children[0]), period_span=tree_span(self._source, clause))

    def _legacy(self, model: m.Component, clause: Tree[Any]) -> m.Component:
        legacy = m.Legacy(self._name(clause.children[0]), tree_span(self._source, clause))
        return replace(model, legacy=(*model.legacy, legacy))

    def _name(self, token: Any) -> Name:
        return name_of(self._source, token)


def _seconds(duration: Tree[Any]) -> float:
    """A number with a unit in seconds; without one it is the number itself."""
    number, *unit = duration.children
    value = float(str(number).rstrip("fF"))
    return value / 1000 if unit and str(unit[0]).lower() == "ms" else value
