"""What a .pdsl file says, and where. Values are texts; `check` says whether they make sense."""

from __future__ import annotations

from dataclasses import dataclass

from ..source import Name, Source, Span

MOST_ITEMS = 1000
"""The most items that a list may demand: its example configuration holds all of them."""


@dataclass(frozen=True, slots=True)
class Param:
    name: Name
    kind: str
    default: Name
    span: Span
    range: tuple[Name, Name] | None = None
    values: tuple[Name, ...] = ()
    mandatory: bool = False
    dynamic: bool = False
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Scope:
    """Parameters and lists under one name: a file, or a list's item."""

    name: Name
    span: Span
    params: tuple[Param, ...]
    lists: tuple[List, ...]


@dataclass(frozen=True, slots=True)
class List:
    scope: Scope
    items: tuple[Name, Name] | None = None
    doc: str = ""


@dataclass(frozen=True, slots=True)
class File:
    source: Source
    imports: tuple[Name, ...]
    scope: Scope
