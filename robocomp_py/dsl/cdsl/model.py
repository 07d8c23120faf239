"""What a .cdsl file says, and where."""

from __future__ import annotations

from dataclasses import dataclass

from ...contract.interface import Verb
from ..source import Name, Source, Span


@dataclass(frozen=True, slots=True)
class Setting:
    """One word of a QoS, with its value if it has one: `depth 1`, `deadline 50 ms` (in seconds here)."""

    name: Name
    word: str = ""
    number: float | None = None


@dataclass(frozen=True, slots=True)
class Item:
    """One use of an interface."""

    verb: Verb
    interface: Name
    marker: Name | None = None
    concurrent: bool = False
    qos: tuple[Setting, ...] = ()


@dataclass(frozen=True, slots=True)
class Legacy:
    """A clause that older generators knew."""

    word: Name
    span: Span


@dataclass(frozen=True, slots=True)
class Component:
    source: Source
    imports: tuple[Name, ...]
    name: Name
    items: tuple[Item, ...] = ()
    language: Name | None = None
    gui: Name | None = None
    options: tuple[Name, ...] = ()
    statemachine: Name | None = None
    params: Name | None = None
    period: float | None = None
    """Seconds."""
    period_span: Span | None = None
    legacy: tuple[Legacy, ...] = ()
    doc: str = ""
    skipped: str = ""
