"""Text to model."""

from __future__ import annotations

from typing import Any

from lark import Token, Tree

from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Builder, Grammar
from . import model as m

_GRAMMAR = Grammar(
    "pdsl",
    {
        r"^\s*(lists?|Lits|Lst|Lis)\s+\w+": "did you mean `List`?",
        r"^\s*(int|float|double|string|bool|enum)\s+\w+": "the name comes first: `speed float 0.5;`",
        r"\bList\b[^{;]*\[[^\]]*\]": "a list's range has two whole numbers: `List motors [1:6] { … };`",
        r"\b(mandatory|T|dynamic)\s+[-+.\d]+\s*:": "a range stands behind the default: `speed float 0.5 0:2 T;`",
        r"^\s*(mandatory|dynamic)\s+\w+\s+(int|float|double|string|bool|enum)": "it comes last: `x float 0.5 dynamic;`",
        r"\[[^\]]*:[^\]]*\]": "a range has no brackets: `speed float 0.5 0:2;`",
    },
)


def parse(source: Source, report: Report) -> m.File | None:
    """The model of a file, without the parts that could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).file(parsed.tree) if parsed.tree is not None else None


class _Builder(Builder):
    def file(self, tree: Tree[Token]) -> m.File:
        *imports, scope = tree.children
        names = tuple(self._name(each.children[0]) for each in imports if isinstance(each, Tree))
        return m.File(self._source, names, self._scope(scope))

    def _scope(self, tree: Any) -> m.Scope:
        name, *rest = tree.children
        return m.Scope(
            self._name(name),
            self._span(tree),
            tuple(self._param(each) for each in rest if each.data == "param"),
            tuple(self._list(each) for each in rest if each.data == "list"),
        )

    def _list(self, tree: Any) -> m.List:
        items = [each for each in tree.children if isinstance(each, Tree) and each.data == "items"]
        return m.List(self._scope(tree), self._pair(items), self._doc(tree))

    def _param(self, tree: Any) -> m.Param:
        name, *rest = tree.children
        kind = next(each for each in rest if each.data in ("number", "string", "bool", "enum"))
        word, *values = kind.children if kind.data == "number" else (kind.data, *kind.children)
        return m.Param(
            self._name(name),
            str(word),
            self._name(values[0]),
            self._span(tree),
            self._pair([each for each in values if isinstance(each, Tree)]),
            tuple(map(self._name, values[1:])) if word == "enum" else (),
            any(each.data == "mandatory" for each in rest),
            any(each.data == "dynamic" for each in rest),
            self._doc(tree),
        )

    def _pair(self, trees: list[Tree[Any]]) -> tuple[Name, Name] | None:
        """The two numbers of a range, if there is one."""
        for tree in trees:
            low, high = map(self._name, tree.children)
            return low, high
        return None

    def _doc(self, tree: Any) -> str:
        for child in tree.children:
            if isinstance(child, Tree) and child.data == "doc":
                return self._name(child.children[0]).text
        return super()._doc(tree)
