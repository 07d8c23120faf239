"""What installed packages add to this one, by their entry points."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import reduce
from importlib import import_module
from importlib.machinery import PathFinder
from typing import Any, NamedTuple

TRANSPORTS, DEPLOYMENTS = "robocomp_py.transports", "robocomp_py.deployments"

_OURS = "robocomp_py."
"""What the names of our groups begin with."""


class EntryPoint(NamedTuple):
    """One entry point of an installed package."""

    group: str
    name: str
    value: str

    def load(self) -> Any:
        """What it names, imported. Raises ImportError, and AttributeError if the module has no such thing."""
        module, _, attribute = self.value.partition("[")[0].partition(":")
        names = filter(None, attribute.strip().split("."))
        return reduce(getattr, names, import_module(module.strip()))


def entry_points() -> list[EntryPoint]:
    """The entry points of our groups. Of packages with one name, the first on the path counts.

    Where all packages are in plain folders, this reads their files itself: importing `importlib.metadata` takes a
    third of the time that a command such as `rc list` computes.
    """
    is_plain = not any(hasattr(each, "find_distributions") for each in sys.meta_path if each is not PathFinder)
    if is_plain and not any(str(each).endswith(".egg") or os.path.isfile(each) for each in sys.path):
        return [found for folder in _folders() for found in _read(folder)]
    from importlib import metadata

    every = metadata.entry_points()
    groups = [group for group in every.groups if group.startswith(_OURS)]
    return [EntryPoint(group, each.name, each.value) for group in groups for each in every.select(group=group)]


def _folders() -> Iterator[str]:
    """The folders with the metadata of installed packages."""
    known = set()
    for place in dict.fromkeys(sys.path):
        try:
            names = os.listdir(place or ".")
        except OSError:
            continue  # no folder, or not readable
        for name in names:
            stem, ending = os.path.splitext(name.lower())
            package = stem.partition("-")[0].replace(".", "_")
            if ending in (".dist-info", ".egg-info") and package not in known:
                known.add(package)
                yield os.path.join(place, name)


def _read(folder: str) -> Iterator[EntryPoint]:
    try:
        with open(os.path.join(folder, "entry_points.txt"), "rb") as file:
            text = file.read()
    except OSError:
        return  # it has none
    if _OURS.encode() not in text:
        return
    group = ""
    for line in map(str.strip, text.decode().splitlines()):
        if line.startswith("["):
            group = line.strip("[]")
        elif group.startswith(_OURS) and "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            yield EntryPoint(group, name.strip(), value.strip())


class _Known:
    def __init__(self) -> None:
        self.entries: dict[str, Mapping[str, EntryPoint]] = {}
        """By group."""
        self.loaded: dict[tuple[str, str], Any] = {}
        self._every: list[EntryPoint] | None = None
        """Those of all groups: to look through all that is installed takes long."""

    def of(self, group: str) -> Mapping[str, EntryPoint]:
        if group not in self.entries:
            found = [entry for entry in self.extensions() if entry.group == group]
            self.entries[group] = {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}
        return self.entries[group]

    def extensions(self) -> list[EntryPoint]:
        if self._every is None:
            self._every = entry_points()
        return self._every

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
