"""Text to model."""

from __future__ import annotations

from typing import Any

from lark import Token, Tree

from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Grammar, Parsed, name_of, tree_span
from . import model as m

_GRAMMAR = Grammar("pdsl")


def parse(source: Source, report: Report) -> m.File | None:
    """The model of a file, without what could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).file(parsed.tree) if parsed.tree is not None else None


class _Builder:
    def __init__(self, parsed: Parsed) -> None:
        self._parsed, self._source = parsed, parsed.source

    def file(self, tree: Tree[Token]) -> m.File:
        *imports, scope = tree.children
        names = tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree))
        return m.File(self._source, names, self._scope(scope))

    def _scope(self, tree: Any) -> m.Scope:
        name, *rest = tree.children
        return m.Scope(
            self._name(name),
            tuple(self._param(each) for each in rest if each.data == "param"),
            tuple(self._list(each) for each in rest if each.data == "list"),
        )

    def _list(self, tree: Any) -> m.List:
        own = {each.data: each for each in tree.children if isinstance(each, Tree)}
        low_high = tuple(map(self._name, own["items"].children)) if "items" in own else None
        return m.List(self._scope(tree), low_high, self._doc(tree))  # type: ignore[arg-type]  # the grammar has two

    def _param(self, tree: Any) -> m.Param:
        name, *rest = tree.children
        mandatory = isinstance(rest[-1], Token)
        kind: Tree[Any] = rest[-2] if mandatory else rest[-1]
        given = list(kind.children)
        word = str(given.pop(0)) if kind.data == "number" else str(kind.data)
        low_high = tuple(map(self._name, given[1].children)) if word in _NUMERIC and len(given) > 1 else None
        return m.Param(
            self._name(name),
            word,
            self._name(given[0]),
            low_high,  # type: ignore[arg-type]  # the grammar has two
            tuple(map(self._name, given[1:])) if word == "enum" else (),
            mandatory,
            self._doc(tree),
        )

    def _doc(self, tree: Any) -> str:
        for child in tree.children:
            if isinstance(child, Tree) and child.data == "doc":
                return self._name(child.children[0]).text
        return self._parsed.doc(tree_span(self._source, tree))

    def _name(self, token: Any) -> Name:
        return name_of(self._source, token)


_NUMERIC = ("int", "float", "double")
