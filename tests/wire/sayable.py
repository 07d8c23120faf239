"""Messages that Slice can say: types, values, and the IDSL of which our generator makes Slice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import make_dataclass
from enum import IntEnum
from typing import Any

from hypothesis import strategies as st

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import (
    UINT8,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
)

from .messages import message_types, values


@st.composite
def sayable_messages(draw: st.DrawFn) -> tuple[Struct, tuple[Any, ...]]:
    """A message whose types Slice has, too, and one message of it."""
    message = Struct("Any::Message", tuple(_sayable_fields(draw(message_types()).fields)))
    return message, draw(st.tuples(*(values(field.type) for field in message.fields)))


def _sayable_fields(fields: tuple[Field, ...]) -> Iterator[Field]:
    return (Field(field.name, _sayable(field.type)) for field in fields)


def _sayable(kind: Type) -> Type:
    """A type like this one, without what Slice lacks: structs without fields, enumerators below 0, nameless structs."""
    match kind:
        case Struct(name=name, fields=fields):
            inside = tuple(_sayable_fields(fields or (Field("octet", UINT8),)))
            attributes = [(field.attribute, object) for field in inside]
            return Struct(name, inside, make_dataclass(name.rpartition("::")[2], attributes))
        case Enumeration(name=name, members=members, python=python):
            numbers = {number & 0x7FFFFFFF for _, number in members}
            kept = tuple((f"m{place}", number) for place, number in enumerate(numbers))
            return Enumeration(name, kept, IntEnum(name.rpartition("::")[2], kept) if python else None)
        case Sequence(item):
            return Sequence(_sayable(item))
        case Dictionary(key, value):
            return Dictionary(_sayable(key), _sayable(value))
        case Primitive():
            return kind


# As IDSL.


def in_idsl(operation: Operation[Any]) -> str:
    """A module with this operation, its interface, and all it uses, whatever modules the types are of."""
    return _Writer().module(operation)


class _Writer:
    def __init__(self) -> None:
        self._definitions: list[str] = []
        self._names: dict[int, str] = {}
        """By identity: types live as long as the operation does."""

    def module(self, operation: Operation[Any]) -> str:
        module, _, interface = operation.interface.rpartition("::")
        for kind in operation.raises:
            self._exception(kind)
        returned = [field for field in operation.outputs if field.name == "ret"]
        given = [f"{self._spelt(field.type)} {field.name}" for field in operation.inputs]
        given += [f"out {self._spelt(field.type)} {field.name}" for field in operation.outputs if field not in returned]
        throws = f" throws {', '.join(_short(kind.name) for kind in operation.raises)}" if operation.raises else ""
        result = self._spelt(returned[0].type) if returned else "void"
        work = f"{result} {operation.name}({', '.join(given)}){throws};"
        return "\n".join([f"module {module} {{", *self._definitions, f"interface {interface} {{ {work} }}; }};"])

    def _exception(self, kind: ExceptionType) -> None:
        if id(kind) in self._names:
            return
        self._names[id(kind)] = _short(kind.name)
        if kind.base:
            self._exception(kind.base)
        extends = f" extends {_short(kind.base.name)}" if kind.base else ""
        place = len(kind.all_fields) - len(kind.fields)
        self._definitions.append(f"exception {_short(kind.name)}{extends} {{ {self._fields(kind.fields, place)} }};")

    def _fields(self, fields: tuple[Field, ...], place: int = 0) -> str:
        return " ".join(f"{self._spelt(field.type)} f{number};" for number, field in enumerate(fields, place))

    def _spelt(self, kind: Type) -> str:
        if isinstance(kind, Primitive):
            return kind.value
        if isinstance(kind, Sequence):
            return f"sequence<{self._spelt(kind.item)}>"
        if id(kind) not in self._names:
            self._names[id(kind)] = self._defined(kind)
        return self._names[id(kind)]

    def _defined(self, kind: Struct | Enumeration | Dictionary) -> str:
        match kind:
            case Struct():
                name = _short(kind.name)
                text = f"struct {name} {{ {self._fields(kind.fields)} }};"
            case Enumeration():
                name = _short(kind.name)  # which its enumerators have in front, since all of a module share their names
                members = ", ".join(f"{name.lower()}{member} = {number}" for member, number in kind.members)
                text = f"enum {name} {{ {members} }};"
            case Dictionary(key, value):
                inside = f"{self._spelt(key)}, {self._spelt(value)}"
                name = f"D{len(self._definitions)}"
                text = f"dictionary<{inside}> {name};"
        self._definitions.append(text)
        return name


def _short(name: str) -> str:
    return name.rpartition("::")[2]
