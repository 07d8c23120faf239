"""Model to contract: names become the things they name. For files in which `check` found no error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from ...contract import interface as c
from ...contract import types as t
from ...contract.interface import Action
from ...contract.module import Constant, Definition, Module
from ...contract.naming import feedback_struct
from ..source import Name
from . import model as m
from .check import BUILTIN, enum_values, qualified
from .literals import literal_value

Known = Mapping[str, Definition]
"""The definitions of imported modules, by qualified name."""


def link(file: m.File, imported: Known) -> Module:
    """The module a file defines."""
    linker = _Linker(file, imported)
    return Module(file.module.text, tuple(linker.all()), (file.source.path.name,))


class _Linker:
    def __init__(self, file: m.File, imported: Known) -> None:
        self._module = file.module.text
        self._known: dict[str, Definition] = dict(imported)
        self._own = {qualified(each.name.text, self._module): each for each in file.definitions}
        self._made: dict[str, Definition] = {}

    def all(self) -> list[Definition]:
        """Every definition, after those it uses."""
        for name in self._own:
            self._definition(name)
        return list(self._made.values())

    def _definition(self, name: str) -> Definition:
        if name in self._known:
            return self._known[name]
        made = self._make(name, self._own[name])
        self._known[name] = self._made[name] = made
        return made

    def _make(self, name: str, definition: m.Definition) -> Definition:
        match definition:
            case m.Struct(fields=fields, doc=doc):
                return t.Struct(name, self._fields(fields), doc=doc)
            case m.Enum(members=members, doc=doc):
                names = (member.name.text for member in members)
                return t.Enumeration(name, tuple(zip(names, enum_values(definition), strict=True)), doc=doc)
            case m.Exception_(bases=bases, fields=fields, doc=doc):
                base = self._exception(bases[0]) if bases else None
                return t.ExceptionType(name, self._fields(fields), base, doc=doc)
            case m.Sequence(item=item, records=records):
                return t.Sequence(self._type(item), name, records)
            case m.Dictionary(key=key, value=value):
                return t.Dictionary(self._type(key), self._type(value), name)
            case m.Const(type=kind, value=value, doc=doc):
                return Constant(name, self._type(kind), self._literal(kind, value), doc)
            case m.Interface(doc=doc):
                operations = tuple(self._operations(name, definition))
                return c.Interface(name, operations, doc, tuple(self._actions(name, definition)))

    def _fields(self, fields: tuple[m.Field, ...]) -> tuple[t.Field, ...]:
        return tuple(
            t.Field(each.name.text, self._type(each.type), self._default(each.type, each.default), each.doc)
            for each in fields
        )

    def _type(self, kind: m.TypeName) -> t.Type:
        if isinstance(kind, m.SequenceOf):
            return t.Sequence(self._type(kind.item), records=kind.records)
        if kind.text in BUILTIN:
            return BUILTIN[kind.text]
        found = self._definition(qualified(kind.text, self._module))
        assert isinstance(found, t.Struct | t.Enumeration | t.Sequence | t.Dictionary)
        return found

    def _exception(self, name: Name) -> t.ExceptionType:
        found = self._definition(qualified(name.text, self._module))
        assert isinstance(found, t.ExceptionType)
        return found

    def _default(self, kind: m.TypeName, literal: m.Literal | None) -> Any:
        return self._literal(kind, literal) if literal else None

    def _literal(self, kind: m.TypeName, literal: m.Literal) -> Any:
        assert isinstance(kind, Name)
        if kind.text in BUILTIN:
            return literal_value(BUILTIN[kind.text], literal)
        return literal.text.rpartition("::")[2]  # an enumerator, by name

    def _operations(self, interface: str, definition: m.Interface) -> Iterable[c.Operation[Any]]:
        """Inherited ones first. An operation inherited twice occurs once."""
        found: dict[str, c.Operation[Any]] = {}
        for base in definition.bases:
            inherited = self._definition(qualified(base.text, self._module))
            assert isinstance(inherited, c.Interface)
            found |= {each.name: replace(each, interface=interface) for each in inherited.operations}
        own = (each for each in definition.operations if not each.is_action)
        found |= {each.name.text: self._operation(interface, each) for each in own}
        return found.values()

    def _actions(self, interface: str, definition: m.Interface) -> Iterable[Action]:
        """Inherited ones first."""
        found: dict[str, Action] = {}
        for base in definition.bases:
            inherited = self._definition(qualified(base.text, self._module))
            assert isinstance(inherited, c.Interface)
            found |= {each.name: each.inherited(interface) for each in inherited.actions}
        own = (each for each in definition.operations if each.is_action)
        found |= {each.name.text: self._action(interface, each) for each in own}
        return found.values()

    def _action(self, interface: str, action: m.Operation) -> Action:
        made = self._operation(interface, action)
        feedback = None
        if action.feedback:
            name = qualified(feedback_struct(interface.rpartition("::")[2], action.name.text), self._module)
            fields = tuple(
                t.Field(each.name.text, self._type(each.type), self._default(each.type, each.default))
                for each in action.feedback
            )
            feedback = t.Struct(name, fields, doc=f"The feedback of `{action.name}`.")
            self._known[name] = self._made[name] = feedback
        return Action(
            interface,
            made.name,
            made.inputs,
            made.outputs,
            feedback,
            made.raises,
            confirm=made.confirm,
            doc=made.doc,
            source=made.source,
        )

    def _operation(self, interface: str, operation: m.Operation) -> c.Operation[Any]:
        returned = (t.Field("ret", self._type(operation.result)),) if operation.returns else ()
        params = [
            (each.out, t.Field(each.name.text, self._type(each.type), self._default(each.type, each.default)))
            for each in operation.params
        ]
        return c.Operation(
            interface,
            operation.name.text,
            inputs=tuple(field for out, field in params if not out),
            outputs=(*returned, *(field for out, field in params if out)),
            raises=tuple(self._exception(each) for each in operation.throws),
            pattern=c.Pattern(operation.pattern.text) if operation.pattern and not operation.is_action else None,
            idempotent=operation.idempotent,
            confirm=operation.confirm,
            doc=operation.doc,
            source=operation.text,
        )
