"""Text to model."""

from __future__ import annotations

from typing import Any

from lark import Token, Tree

from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Builder, Grammar
from . import model as m

_GRAMMAR = Grammar(
    "smdsl",
    {
        r"\w+\s*(?:-+>|==+>|>|=(?!>))\s*\w+": "a transition is written `one => two, three;`",
        r"^\s*\[.*": "brackets are of the syntax's description: they enclose what may be left out",
        r"^\s*end_state\s+\w+\s*,.*": "one end state is named; others are written `end_state other;`",
    },
)


def parse(source: Source, report: Report) -> m.File | None:
    """The model of a file, without the parts that could not be read; None if nothing could."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).file(parsed.tree) if parsed.tree is not None else None


class _Builder(Builder):
    def file(self, tree: Tree[Token]) -> m.File:
        blocks = tuple(map(self._block, tree.children))
        machine: Any = tree.children[0]
        return m.File(self._source, self._name(machine.children[0]), blocks, self._parsed.skipped)

    def _block(self, tree: Any) -> m.Block:
        name, *rest = tree.children
        initial, states, end = (self._names(rest, kind) for kind in ("initial", "states", "end"))
        return m.Block(
            None if tree.data == "machine" else self._name(name),
            self._span(tree),
            tuple(m.State(each, each in end) for each in (*initial, *states, *end)),
            tuple(initial),
            tuple(
                m.Transition(self._name(source), self._name(target))
                for clause in rest
                if clause.data == "transitions"
                for source, *targets in (each.children for each in clause.children if isinstance(each, Tree))
                for target in targets
            ),
            any(clause.data == "parallel" for clause in rest),
        )

    def _names(self, clauses: Any, kind: str) -> list[Name]:
        return [self._name(name) for clause in clauses if clause.data == kind for name in clause.children]
