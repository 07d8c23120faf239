"""What installed packages add to this one, by their entry points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.metadata import EntryPoint, entry_points
from typing import Any

TRANSPORTS, DEPLOYMENTS = "robocomp_py.transports", "robocomp_py.deployments"


class _Known:
    def __init__(self) -> None:
        self.entries: dict[str, Mapping[str, EntryPoint]] = {}
        """By group."""
        self.loaded: dict[tuple[str, str], Any] = {}
        self._every: Any = None
        """All that is installed, of all groups: to look through it takes long."""

    def of(self, group: str) -> Mapping[str, EntryPoint]:
        if group not in self.entries:
            self._every = self._every or entry_points()
            found = self._every.select(group=group)
            self.entries[group] = {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}
        return self.entries[group]

    def extensions(self) -> list[EntryPoint]:
        self._every = self._every or entry_points()
        groups = [group for group in self._every.groups if group.startswith("robocomp_py.")]
        return [each for group in groups for each in self._every.select(group=group)]

    def load(self, group: str, name: str) -> Any:
        if (group, name) not in self.loaded:
            self.loaded[group, name] = self.of(group)[name].load()
        return self.loaded[group, name]


_known: ContextVar[_Known | None] = ContextVar("known", default=None)


def transports() -> Mapping[str, EntryPoint]:
    """Every transport there is, by the name of its middleware; none is imported."""
    return entries(TRANSPORTS)


def transport(name: str) -> Any:
    """What the entry of one of them names, imported. Raises ImportError."""
    return load(TRANSPORTS, name)


def entries(group: str) -> Mapping[str, EntryPoint]:
    """The entry points of a group by their names; none is imported."""
    return _now().of(group)


def find(group: str, name: str) -> Any:
    """What an entry point names, imported; None if there is none of that name. Raises ImportError."""
    known = _now()
    return known.load(group, name) if name in known.of(group) else None


def extensions() -> list[EntryPoint]:
    """The entry points of all groups of ours; none is imported."""
    return _now().extensions()


def load(group: str, name: str) -> Any:
    """What an entry point names, imported. Raises ImportError."""
    return _now().load(group, name)


@contextmanager
def asked_once() -> Iterator[None]:
    """While this is entered, the entry points are those that there were when they were first asked for.

    Otherwise all that is installed is looked through each time, and something new is found at once.
    """
    token = _known.set(_now())
    try:
        yield
    finally:
        _known.reset(token)


def _now() -> _Known:
    return _known.get() or _Known()
