"""Text to model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from lark import Token, Tree

from ...contract.interface import Verb
from ..diagnostics import Report
from ..numbers import real
from ..source import Source
from ..syntax import Builder, Grammar, name_of, tree_span
from . import model as m

_GRAMMAR = Grammar("cdsl", {r"language\s+\w+\s*//.*": "the `//` starts a comment: write one language, then `;`"})
_VERBS = {verb.value.lower(): verb for verb in Verb}


def parse(source: Source, report: Report) -> m.Component | None:
    """The model of a file, without the parts that could not be read; None if the component itself could not."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).component(parsed.tree) if parsed.tree is not None else None


class _Builder(Builder):
    def component(self, tree: Tree[Token]) -> m.Component:
        *imports, component = tree.children
        assert isinstance(component, Tree)
        name, *rest = component.children
        blocks = [each for each in rest if isinstance(each, Tree) and each.data == "communications"]
        clauses = [each for each in rest if isinstance(each, Tree) and each.data != "communications"]
        return m.Component(
            self._source,
            tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree)),
            self._name(name),
            self._span(component),
            tuple(item for block in blocks for statement in block.children for item in self._items(statement)),
            tuple(map(self._clause, clauses)),
            self._parsed.comments.doc(self._span(component)),
            self._parsed.skipped,
        )

    def _items(self, statement: Any) -> Iterator[m.Item]:
        verb, *items = statement.children
        for item in items:
            name, *extras = item.children
            yield m.Item(
                _VERBS[str(verb).lower()],
                self._name(name),
                self._span(item),
                next((self._name(each.children[0]) for each in extras if each.data == "marker"), None),
                any(each.data == "concurrent" for each in extras),
                tuple(
                    setting_of(self._source, each) for extra in extras if extra.data == "qos" for each in extra.children
                ),
                next((self._span(each) for each in extras if each.data == "concurrent"), None),
                next((self._span(each) for each in extras if each.data == "each"), None),
                tuple(
                    (self._name(each.children[0]), self._name(each.children[1]))
                    for extra in extras
                    if extra.data == "policies"
                    for each in extra.children
                ),
            )

    def _clause(self, tree: Tree[Any]) -> m.Clause:
        names = tuple(self._name(each) for each in tree.children if isinstance(each, Token))
        amounts = [amount_of(self._source, each) for each in tree.children if isinstance(each, Tree)]
        return m.Clause(str(tree.data), self._span(tree), names, amounts[0] if amounts else None)


def setting_of(source: Source, tree: Tree[Any]) -> m.Setting:
    """One word of a QoS, which other languages write in the same way."""
    name: Any
    name, *value = tree.children
    words = [name_of(source, each) for each in value if isinstance(each, Token)]
    amounts = [amount_of(source, each) for each in value if isinstance(each, Tree)]
    return m.Setting(
        name_of(source, name), tree_span(source, tree), words[0] if words else None, amounts[0] if amounts else None
    )


def amount_of(source: Source, tree: Tree[Any]) -> m.Amount:
    number: Any
    unit: list[Any]
    number, *unit = tree.children
    return m.Amount(real(str(number)), name_of(source, unit[0]) if unit else None, tree_span(source, tree))
