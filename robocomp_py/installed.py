"""What installed packages add to this one, by their entry points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
from typing import Any


@dataclass
class _Known:
    entries: Mapping[str, EntryPoint]
    loaded: dict[str, Any] = field(default_factory=dict)


_known: ContextVar[_Known | None] = ContextVar("known", default=None)


def transports() -> Mapping[str, EntryPoint]:
    """Every transport there is, by the name of its middleware; none is imported."""
    known = _known.get()
    return known.entries if known else _look_up()


def transport(name: str) -> Any:
    """What the entry of one of them names, imported. Raises ImportError."""
    known = _known.get() or _Known(_look_up())
    if name not in known.loaded:
        known.loaded[name] = known.entries[name].load()
    return known.loaded[name]


@contextmanager
def asked_once() -> Iterator[None]:
    """For who asks often: while this is entered, `transports` are those there were at its beginning.

    Otherwise all that is installed is looked through each time, and something new is found at once.
    """
    token = _known.set(_known.get() or _Known(_look_up()))
    try:
        yield
    finally:
        _known.reset(token)


def _look_up() -> dict[str, EntryPoint]:
    entries = entry_points(group="robocomp_py.transports")
    return {entry.name: entry for entry in sorted(entries, key=lambda entry: entry.name)}
