"""Text to model."""

from __future__ import annotations

import re
from typing import Any

from lark import Token, Tree

from ..diagnostics import Report
from ..source import Name, Source
from ..syntax import Builder, Grammar, span_of
from . import model as m

_GRAMMAR = Grammar(
    "idsl",
    {
        r"\w\s*\[\s*\d*\s*\]": "arrays are sequences: define `sequence<float> Values;`, then use `Values`",
        r"\w+\s+\w+\s*,(?!.*\))": "one name each: `int x; int y;`",
        r"\bunsigned\b.*": "write uint8, uint16, uint32 or uint64",
        r"\bin\s+\w+\s+\w+": "inputs have no `in`; remove it",
        r"\b(vector|list|map)\s*<": "write `sequence<…>` or `dictionary<…, …>`",
        r"(?:^|[;{}])\s*\w+\s*\(": "an operation begins with the type that it returns: `void stop();`",
        r"\)\s*=\s*0": "remove `= 0`: operations have no body",
        r"\w\s*[&*]": "values are passed: remove the `&` or `*`",
        r"[(,]\s*(?:out\s+)?[\w:]+\s*[,)]": "a parameter has a type and a name",
    },
)


def parse(source: Source, report: Report) -> m.File | None:
    """The model of a file, without the parts that could not be read; None if the module itself could not."""
    parsed = _GRAMMAR.parse(source, report)
    return _Builder(parsed).file(parsed.tree) if parsed.tree is not None else None


class _Builder(Builder):
    def file(self, tree: Tree[Token]) -> m.File:
        *imports, module = _trees(tree)
        name, *definitions = module.children
        return m.File(
            self._source,
            tuple(self._name(_token(each)) for each in imports),
            self._name(name),
            tuple(getattr(self, f"_{each.data}")(each) for each in definitions if isinstance(each, Tree)),
            self._parsed.skipped,
        )

    def _struct(self, tree: Tree[Token]) -> m.Struct:
        name, *fields = tree.children
        return m.Struct(self._name(name), self._fields(fields), self._span(tree), self._doc(tree))

    def _enum(self, tree: Tree[Token]) -> m.Enum:
        name, *members = tree.children
        return m.Enum(self._name(name), tuple(map(self._enumerator, members)), self._span(tree), self._doc(tree))

    def _enumerator(self, tree: Any) -> m.Enumerator:
        name, *value = tree.children
        literal = m.Literal(str(value[0]), span_of(self._source, value[0])) if value else None
        return m.Enumerator(self._name(name), self._span(tree), literal)

    def _exception(self, tree: Tree[Token]) -> m.Exception_:
        name, *rest = tree.children
        bases, fields = self._extends(rest)
        return m.Exception_(self._name(name), bases, self._fields(fields), self._span(tree), self._doc(tree))

    def _dictionary(self, tree: Tree[Token]) -> m.Dictionary:
        key, value, name = tree.children
        return m.Dictionary(self._name(name), self._type(key), self._type(value), self._span(tree), self._doc(tree))

    def _sequence(self, tree: Tree[Token]) -> m.Sequence:
        *records, item, name = tree.children
        made = self._type(item)
        return m.Sequence(self._name(name), made, self._span(tree), self._doc(tree), bool(records))

    def _const(self, tree: Tree[Token]) -> m.Const:
        kind, name, value = tree.children
        return m.Const(self._name(name), self._type(kind), self._literal(value), self._span(tree), self._doc(tree))

    def _interface(self, tree: Tree[Token]) -> m.Interface:
        name, *rest = tree.children
        bases, operations = self._extends(rest)
        made = tuple(map(self._operation, operations))
        return m.Interface(self._name(name), bases, made, self._span(tree), self._doc(tree))

    def _operation(self, tree: Any) -> m.Operation:
        rest = list(tree.children)
        pattern = self._name(_token(rest.pop(0))) if _is(rest[0], "pattern") else None
        confirm = bool(_is(rest[0], "confirm") and rest.pop(0))
        idempotent = _is(rest[0], "IDEMPOTENT")
        result, name, *rest = rest[1:] if idempotent else rest
        throws = tuple(map(self._qualified, rest.pop().children)) if rest and _is(rest[-1], "throws") else ()
        feedback = rest.pop() if rest and _is(rest[-1], "feedback") else None
        span = self._span(tree)
        return m.Operation(
            pattern,
            idempotent,
            self._type(result),
            self._name(name),
            tuple(map(self._param, rest)),
            throws,
            span,
            self._doc(tree),
            _one_line(self._parsed.comments.bare[span.start : span.end]),
            tuple(map(self._param, feedback.children)) if feedback else (),
            self._span(feedback) if feedback else None,
            confirm,
        )

    def _param(self, tree: Any) -> m.Param:
        out = _is(tree.children[0], "OUT")
        kind, name, *default = tree.children[out:]
        return m.Param(out, self._type(kind), self._name(name), self._span(tree), self._default(default))

    def _fields(self, trees: list[Any]) -> tuple[m.Field, ...]:
        return tuple(map(self._field, trees))

    def _field(self, tree: Any) -> m.Field:
        kind, name, *default = tree.children
        value = self._default(default)
        return m.Field(self._type(kind), self._name(name), self._span(tree), value, self._doc(tree))

    def _default(self, trees: list[Any]) -> m.Literal | None:
        return self._literal(trees[0].children[0]) if trees else None

    def _extends(self, rest: list[Any]) -> tuple[tuple[Name, ...], list[Any]]:
        if rest and _is(rest[0], "extends"):
            return tuple(map(self._qualified, rest[0].children)), rest[1:]
        return (), rest

    def _type(self, tree: Any) -> m.TypeName:
        if tree.data == "sequence_of":
            *records, item = tree.children
            return m.SequenceOf(self._type(item), self._span(tree), bool(records))
        return self._qualified(tree)

    def _qualified(self, tree: Any) -> Name:
        return Name("::".join(map(str, tree.children)), self._span(tree))

    def _literal(self, tree: Any) -> m.Literal:
        if tree.children[0].type == "STRING":
            return m.Literal(str(tree.children[0])[1:-1], self._span(tree), quoted=True)
        return m.Literal("::".join(map(str, tree.children)), self._span(tree))


def _one_line(text: str) -> str:
    """A declaration without its `;`."""
    return re.sub(r"\s+(?=[,);])", "", " ".join(text.split())).rstrip(";")


def _trees(tree: Tree[Token]) -> list[Tree[Token]]:
    return [child for child in tree.children if isinstance(child, Tree)]


def _token(tree: Tree[Token] | Token) -> Token:
    """The first token of a tree."""
    while isinstance(tree, Tree):
        tree = tree.children[0]
    return tree


def _is(node: Any, kind: str) -> bool:
    return (node.data if isinstance(node, Tree) else node.type) == kind
