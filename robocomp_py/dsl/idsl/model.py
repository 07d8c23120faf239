"""What an .idsl file says, and where. Names are not resolved here."""

from __future__ import annotations

from dataclasses import dataclass

from ..source import Name, Source, Span


@dataclass(frozen=True, slots=True)
class SequenceOf:
    """A sequence written where a type is expected."""

    item: TypeName
    span: Span
    records: bool = False


TypeName = Name | SequenceOf

ACTION = "action"
"""Stands where other operations have a pattern."""


@dataclass(frozen=True, slots=True)
class Literal:
    """A number, text or word; what it means depends on the type it is for."""

    text: str
    span: Span
    quoted: bool = False


@dataclass(frozen=True, slots=True)
class Field:
    type: TypeName
    name: Name
    span: Span
    default: Literal | None = None
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Struct:
    name: Name
    fields: tuple[Field, ...]
    span: Span
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Enumerator:
    name: Name
    span: Span
    value: Literal | None = None


@dataclass(frozen=True, slots=True)
class Enum:
    name: Name
    members: tuple[Enumerator, ...]
    span: Span
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Exception_:
    name: Name
    bases: tuple[Name, ...]
    fields: tuple[Field, ...]
    span: Span
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Sequence:
    name: Name
    item: TypeName
    span: Span
    doc: str = ""
    records: bool = False


@dataclass(frozen=True, slots=True)
class Dictionary:
    name: Name
    key: TypeName
    value: TypeName
    span: Span
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Const:
    name: Name
    type: TypeName
    value: Literal
    span: Span
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Param:
    out: bool
    type: TypeName
    name: Name
    span: Span
    default: Literal | None = None


@dataclass(frozen=True, slots=True)
class Operation:
    pattern: Name | None
    idempotent: bool
    result: TypeName
    name: Name
    params: tuple[Param, ...]
    throws: tuple[Name, ...]
    span: Span
    doc: str = ""
    text: str = ""
    """Its declaration on one line, without comments."""
    feedback: tuple[Param, ...] = ()
    feedback_at: Span | None = None
    """Where its `feedback` is, if it has one."""
    confirm: bool = False
    """Whether a person is asked before it is called by hand."""

    @property
    def is_action(self) -> bool:
        return self.pattern is not None and self.pattern.text == ACTION

    @property
    def returns(self) -> bool:
        return not (isinstance(self.result, Name) and self.result.text == "void")

    @property
    def gives_back(self) -> bool:
        """Whether it returns something or has outputs."""
        return self.returns or any(param.out for param in self.params)


@dataclass(frozen=True, slots=True)
class Interface:
    name: Name
    bases: tuple[Name, ...]
    operations: tuple[Operation, ...]
    span: Span
    doc: str = ""


Definition = Struct | Enum | Exception_ | Sequence | Dictionary | Const | Interface


@dataclass(frozen=True, slots=True)
class File:
    source: Source
    imports: tuple[Name, ...]
    module: Name
    definitions: tuple[Definition, ...]
    skipped: frozenset[str] = frozenset()
    """The words that syntax errors left out of the model."""
