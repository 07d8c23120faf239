"""What installed packages add to this one, by their entry points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.metadata import EntryPoint, entry_points

_known: ContextVar[Mapping[str, EntryPoint] | None] = ContextVar("known", default=None)


def transports() -> Mapping[str, EntryPoint]:
    """Every transport there is, by the name of its middleware; none is imported."""
    known = _known.get()
    return _look_up() if known is None else known


@contextmanager
def asked_once() -> Iterator[None]:
    """For who asks often: while this is entered, `transports` are those there were at its beginning.

    Otherwise all that is installed is looked through each time, and something new is found at once.
    """
    token = _known.set(transports())
    try:
        yield
    finally:
        _known.reset(token)


def _look_up() -> dict[str, EntryPoint]:
    entries = entry_points(group="robocomp_py.transports")
    return {entry.name: entry for entry in sorted(entries, key=lambda entry: entry.name)}
