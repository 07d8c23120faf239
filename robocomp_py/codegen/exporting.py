"""Shared by the exporters to foreign formats: IDSL files, and lookup of their definitions.

Exporters start from the syntax of a file, not from its contract. So they can keep names, inheritance and comments, and
report the place of everything that a format cannot express.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

from ..contract.module import Definition, Module
from ..dsl.idsl import model as m
from ..dsl.idsl.check import module_of, qualified
from ..dsl.idsl.link import link
from ..dsl.source import Name
from ..version import __version__
from .layout import on_one_line


@dataclass(frozen=True)
class Files:
    """IDSL files without mistakes, with all imported files. Each file stands after those that it imports."""

    all: tuple[m.File, ...]

    @cached_property
    def clash(self) -> str:
        """A message about a name that two files define; "" if there is none."""
        seen: dict[str, m.File] = {}
        for file in self.all:
            for each in file.definitions:
                name = qualified(each.name.text, file.module.text)
                first = seen.setdefault(name, file)
                if first is not file:
                    return f"{first.source.path} and {file.source.path} both define {name}"
        return ""

    @cached_property
    def scope(self) -> dict[str, m.Definition]:
        """Every definition, by qualified name."""
        return {qualified(each.name.text, file.module.text): each for file in self.all for each in file.definitions}

    @cached_property
    def modules(self) -> dict[str, list[m.Definition]]:
        """The definitions of each module, which may be several files."""
        found: dict[str, list[m.Definition]] = {}
        for name, definition in self.scope.items():
            found.setdefault(module_of(name), []).append(definition)
        return found

    @cached_property
    def contracts(self) -> tuple[Module, ...]:
        """The contracts of the files; files of the same module are merged."""
        known: dict[str, Definition] = {}
        found: dict[str, Module] = {}
        for file in self.all:
            module = link(file, known)
            known |= {each.name: each for each in module.definitions}
            before = found.get(module.name, Module(module.name, ()))
            definitions = (*before.definitions, *module.definitions)
            found[module.name] = Module(module.name, definitions, (*before.files, *module.files))
        return tuple(found.values())

    def bases(self, definition: m.Interface | m.Exception_, module: str) -> Iterator[tuple[str, m.Definition]]:
        """Its direct and indirect bases, each once and with its module."""
        waiting, seen = [(base.text, module) for base in definition.bases], set[str]()
        while waiting:
            name = qualified(*waiting.pop(0))
            if name not in seen:
                seen.add(name)
                found = self.scope[name]
                yield module_of(name), found
                if isinstance(found, m.Interface | m.Exception_):
                    waiting += [(base.text, module_of(name)) for base in found.bases]


def in_order(file: m.File) -> list[m.Definition]:
    """The definitions of a file in its order, but each after those it uses."""
    module = file.module.text
    own = {qualified(each.name.text, module): each for each in file.definitions}
    done: dict[str, m.Definition] = {}

    def visit(name: str) -> None:
        if name in own and name not in done:
            for used in _uses(own[name]):
                visit(qualified(used.text, module))
            done[name] = own[name]

    for name in own:
        visit(name)
    return list(done.values())


def _uses(definition: m.Definition) -> Iterator[Name]:
    match definition:
        case m.Struct(fields=fields):
            kinds: Iterable[m.TypeName] = (each.type for each in fields)
        case m.Exception_(fields=fields, bases=bases):
            kinds = (*bases, *(each.type for each in fields))
        case m.Sequence(item=item):
            kinds = (item,)
        case m.Dictionary(key=key, value=value):
            kinds = (key, value)
        case m.Const(type=kind):
            kinds = (kind,)
        case m.Enum():
            kinds = ()
        case m.Interface(bases=bases, operations=operations):
            used: list[m.TypeName] = [*bases]
            for each in operations:
                used += [each.result, *(param.type for param in each.params), *each.throws]
            kinds = used
    yield from map(innermost, kinds)


def innermost(kind: m.TypeName) -> Name:
    """The item type of nested sequences; any other type itself."""
    while isinstance(kind, m.SequenceOf):
        kind = kind.item
    return kind


def heading(file: str) -> str:
    """The first line of a generated file."""
    return f"Generated from {on_one_line(file)} by rcgen {__version__}: edits are lost."
