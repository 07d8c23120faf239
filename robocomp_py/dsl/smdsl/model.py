"""What a .smdsl or .scxml file says, and where."""

from __future__ import annotations

from dataclasses import dataclass

from ..source import Name, Source, Span


@dataclass(frozen=True, slots=True)
class State:
    """A state that a block declares."""

    name: Name
    final: bool = False


@dataclass(frozen=True, slots=True)
class Transition:
    source: Name
    target: Name
    events: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Block:
    """The inside of the machine, or of one of its states."""

    parent: Name | None
    """None for the machine itself."""
    span: Span
    states: tuple[State, ...] = ()
    initial: tuple[Name, ...] = ()
    """Those that are said to be it."""
    transitions: tuple[Transition, ...] = ()
    parallel: bool = False


@dataclass(frozen=True, slots=True)
class File:
    source: Source
    name: Name
    blocks: tuple[Block, ...]
    """The machine itself comes first."""
    skipped: frozenset[str] = frozenset()
    """The words that syntax errors left out of the model."""
