"""All checks, in the order in which their findings are of use."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Protocol

from . import (
    clocks,
    complaints,
    contracts,
    disk,
    failures,
    files,
    inotify,
    leftovers,
    losses,
    memory,
    overruns,
    plan,
    processes,
    qos,
    servers,
    silent,
    twice,
    unheard,
)
from .facts import Facts, Finding


class Check(Protocol):
    NAME: str
    HELP: str

    def find(self, facts: Facts) -> Iterator[Finding]: ...


CHECKS: tuple[Check, ...] = (
    files,
    inotify,
    memory,
    disk,
    clocks,
    leftovers,
    processes,
    complaints,
    silent,
    twice,
    plan,
    contracts,
    qos,
    servers,
    unheard,
    overruns,
    losses,
    failures,
)


_OF_EACH_HOST: tuple[Check, ...] = (files, inotify, memory, disk, leftovers)
"""Those that look at machines."""


def examine(facts: Facts, names: Collection[str] = ()) -> Iterator[tuple[str, Finding]]:
    """What these checks find (all, if none is named), each with the name of its check."""
    for check in CHECKS:
        if not names or check.NAME in names:
            for finding in check.find(facts):
                yield check.NAME, finding
            for place in facts.places if check in _OF_EACH_HOST else ():
                for finding in check.find(facts.on(place)):
                    yield check.NAME, replace(finding, host=place.host)
