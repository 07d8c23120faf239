"""Contracts as people read them, much as an IDSL file has them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from ..contract.interface import Operation
from ..contract.types import Enumeration, Field, Struct, spell, walk


def declared(operation: Operation[Any]) -> Iterator[str]:
    """The operation and its types, much as an IDSL file has them."""
    outputs = list(operation.outputs)
    returned = _word(outputs.pop(0)) if outputs and outputs[0].name == "ret" else "void"
    given = [f"{_word(each)} {each.name}" for each in operation.inputs]
    given += [f"out {_word(each)} {each.name}" for each in outputs]
    thrown = ", ".join(_short(each.name) for each in operation.raises)
    yield f"{returned} {operation.name}({', '.join(given)}){' throws ' + thrown if thrown else ''};"
    fields = [each for kind in operation.raises for each in kind.fields]
    for kind in walk(*(each.type for each in (*operation.inputs, *operation.outputs, *fields))):
        match kind:
            case Struct():
                yield f"struct {_short(kind.name)} {{{_members(kind.fields)}}};"
            case Enumeration(members=members):
                yield f"enum {_short(kind.name)} {{ {', '.join(name for name, _ in members)} }};"
    for exception in operation.raises:
        yield f"exception {_short(exception.name)} {{{_members(exception.fields)}}};"


def _members(fields: tuple[Field, ...]) -> str:
    return "".join(f" {_word(each)} {each.name};" for each in fields) + " "


def _word(field: Field) -> str:
    """The type of a field, without the names of modules."""
    return re.sub(r"\w+::", "", spell(field.type))


def _short(name: str) -> str:
    return name.rpartition("::")[2]
