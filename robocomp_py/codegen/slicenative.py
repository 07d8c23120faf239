"""Contracts as Slice, for programs of Ice that talk to a component: a file for each IDSL module.

What `slice` makes of IDSL files, made of what is left of them in a contract: the same types and names, inherited
operations beside the others, and only what the component uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ..contract import types as t
from ..contract.interface import Interface, Operation
from .names import module_of, short
from .slicewords import NOTED, SPELLED, TYPES_OF_ITS_OWN, WIDTH, comment, escaped, indented, macro

RETURNED = "ret"
"""The first of the outputs, if the operation returns something."""


def slices(interfaces: Iterable[Interface], head: str) -> dict[str, str]:
    """Slice files by name; `head` is the first line of each."""
    every = {each.name: each for each in interfaces}.values()
    writer = _Writer({name.lower() for each in every for name in (each.name, *_names_in(each))})
    for each in every:
        writer.interface(each)
    return {f"{module}.ice": writer.file(module, head) for module in writer.modules}


def _names_in(interface: Interface) -> Iterator[str]:
    """The types that an interface uses, as far as they have names."""

    def visit(kind: t.Type) -> Iterator[str]:
        if not isinstance(kind, t.Primitive) and kind.name:
            yield kind.name
        for child in t.children(kind):
            yield from visit(child)

    for operation in interface.operations:
        for each in (*operation.inputs, *operation.outputs, *(f for e in operation.raises for f in e.all_fields)):
            yield from visit(each.type)
        for thrown in operation.raises:
            yield from thrown.lineage


class _Writer:
    def __init__(self, taken: set[str]) -> None:
        self.modules: dict[str, list[list[str]]] = {}
        """Definitions by module, in an order in which each comes before those that use it."""
        self._includes: dict[str, dict[str, None]] = {}
        self._known: dict[object, str] = {}
        """What types are called, with their modules."""
        self._taken = taken
        """Names that no sequence may get, in lower case."""
        self._operations: set[str] = set()
        """Those of the interface at hand, in lower case: a type called so needs its whole name."""

    def file(self, module: str, head: str) -> str:
        lines = [f"// {' '.join(head.split())}", "", f"#ifndef {macro(module)}_ICE", f"#define {macro(module)}_ICE", ""]
        body: list[str] = []
        for definition in self.modules[module]:
            body += ["", *definition] if body else definition
        if any("_" in line for line in body):
            lines += ['[["underscore"]]', ""]
        if included := list(self._includes.get(module, ())):
            lines += [*(f'#include "{each}.ice"' for each in included), ""]
        lines += [f"module {escaped(module)}", "{", *(f"    {line}".rstrip() for line in body), "};", ""]
        return "\n".join([*lines, f"#endif  // {macro(module)}_ICE"]) + "\n"

    def _add(self, module: str, definition: Iterable[str]) -> None:
        self.modules.setdefault(module, []).append(list(definition))

    # Definitions.

    def interface(self, interface: Interface) -> None:
        module = interface.module
        for operation in interface.operations:
            for each in (*operation.inputs, *operation.outputs):
                self._define(each.type, module)
            for kind in operation.raises:
                self._exception(kind, module)
        self._operations = {operation.name.lower() for operation in interface.operations}
        lines = [*comment(interface.doc, 4), f"interface {escaped(interface.short)}", "{"]
        for operation in interface.operations:
            lines += indented(self._operation(operation, module))
        self._add(module, [*lines, "};"])
        self._operations = set()

    def _operation(self, operation: Operation[Any], module: str) -> Iterator[str]:
        outputs = operation.outputs
        result = "void"
        if outputs and outputs[0].name == RETURNED:
            result, outputs = self._name(outputs[0].type, module), outputs[1:]
        about = " ".join(filter(None, (f"[{operation.pattern}]" if operation.pattern else "", operation.doc)))
        yield from comment(about, 8)
        for note in sorted({note for each in (*operation.inputs, *operation.outputs) if (note := _note(each.type))}):
            yield f"// {note}"
        given = [f"{self._name(each.type, module)} {escaped(each.name)}" for each in operation.inputs]
        given += [f"out {self._name(each.type, module)} {escaped(each.name)}" for each in outputs]
        head = f"{'idempotent ' if operation.idempotent else ''}{result} {escaped(operation.name)}"
        thrown = ", ".join(self._whole(kind.name, module) for kind in operation.raises)
        line = f"{head}({', '.join(given)}){f' throws {thrown}' if thrown else ''};"
        if len(line) + 8 <= WIDTH or not given:
            yield line
            return
        yield f"{head}("
        yield from (f"    {each}," for each in given[:-1])
        yield f"    {given[-1]}){f' throws {thrown}' if thrown else ''};"

    def _exception(self, kind: t.ExceptionType, user: str) -> None:
        module = module_of(kind.name)
        if self._is_known(kind.name, module, user):
            return
        if kind.base:
            self._exception(kind.base, module)
        for each in kind.fields:
            self._define(each.type, module)
        base = f" extends {self._whole(kind.base.name, module)}" if kind.base else ""
        lines = [*comment(kind.doc, 4), f"exception {escaped(short(kind.name))}{base}"]
        self._add(module, [*lines, *self._fields(kind.fields, module)])

    def _define(self, kind: t.Type, user: str) -> None:
        """Whatever has to be there before a module can name a type."""
        match kind:
            case t.Primitive():
                return
            case t.Sequence(name="") as sequence:
                self._define(sequence.item, user)
                self._unnamed(sequence, user)
                return
            case t.Dictionary(name=""):
                raise ValueError("a dictionary has no name, and Slice has none without")
        module = module_of(kind.name)
        if self._is_known(kind.name, module, user):
            return
        for child in t.children(kind):
            self._define(child, module)
        name = escaped(short(kind.name))
        match kind:
            case t.Struct(fields=fields, doc=doc):
                nothing = t.Field("structureNeedsAtLeastOneMember", t.UINT8)
                self._add(module, [*comment(doc, 4), f"struct {name}", *self._fields(fields or (nothing,), module)])
            case t.Enumeration(members=members, doc=doc):
                said = [f"    {escaped(member)} = {max(value, 0)}" for member, value in members]
                commas = [f"{line}{',' if line is not said[-1] else ''}" for line in said]
                self._add(module, [*comment(doc, 4), f"enum {name}", "{", *commas, "};"])
            case t.Sequence(item):
                self._add(module, [f"sequence<{self._name(item, module)}> {name};{_behind(item)}"])
            case t.Dictionary(key, value):
                types = f"{self._name(key, module)}, {self._name(value, module)}"
                self._add(module, [f"dictionary<{types}> {name};{_behind(key) or _behind(value)}"])

    def _fields(self, fields: Iterable[t.Field], module: str) -> Iterator[str]:
        yield "{"
        for each in fields:
            yield from indented(comment(each.doc, 8))
            yield f"    {self._name(each.type, module)} {escaped(each.name)};{_behind(each.type)}"
        yield "};"

    def _is_known(self, name: str, module: str, user: str) -> bool:
        """Whether a definition is there already; from now on it is, and included where it is used."""
        if module != user:
            self._includes.setdefault(user, {})[module] = None
        known = name in self._known
        self._known[name] = name
        return known

    def _unnamed(self, kind: t.Sequence, module: str) -> None:
        """A sequence that has no name in the IDSL gets one: `FloatSeq`."""
        key = module, t.spell(kind)
        if key in self._known:
            return
        words = self._name(kind.item, module).replace("\\", "").split("::")
        base = "".join(f"{word[:1].upper()}{word[1:]}" for word in words) + "Seq"
        name, number = base, 1
        while f"{module}::{name}".lower() in self._taken:
            name, number = f"{base}{number + 1}", number + 1
        self._taken.add(f"{module}::{name}".lower())
        self._known[key] = f"{module}::{name}"
        self._add(module, [f"sequence<{self._name(kind.item, module)}> {name};{_behind(kind.item)}"])

    # Names.

    def _name(self, kind: t.Type, module: str) -> str:
        match kind:
            case t.Primitive():
                return SPELLED[kind]
            case t.Sequence(name=""):
                return self._whole(self._known[module, t.spell(kind)], module)
            case _:
                return self._whole(kind.name, module)

    def _whole(self, name: str, module: str) -> str:
        """A type's name; with all that is in front of it where its own would mean something else."""
        own, where = short(name), module_of(name)
        if own.lower() in self._operations or own in TYPES_OF_ITS_OWN:
            return f"::{where}::{own}"
        return escaped(own) if where == module else f"{escaped(where)}::{escaped(own)}"


def _note(kind: t.Type) -> str:
    """What is to be said of a type that is not written as the IDSL has it."""
    while isinstance(kind, t.Sequence) and not kind.name:
        kind = kind.item
    return NOTED.get(kind, "") if isinstance(kind, t.Primitive) else ""


def _behind(kind: t.Type) -> str:
    return f"  // {note}" if (note := _note(kind)) else ""
