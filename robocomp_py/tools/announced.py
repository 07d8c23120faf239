"""What processes announce and networks describe, by names alone, so that a shell can ask at every press of a key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..errors import ConfigurationError, TransportError
from ..transports.census import Told
from ..wire import names

PROVIDERS = frozenset(("publishes", "receives", "serves"))
"""The roles whose channels have the name of their own instance."""

OWN = frozenset(
    ("CommonBehavior", "Introspection", "IntrospectionPub", "LockstepLeader", "LockstepFollower", "ClockControl")
)
"""Interfaces of the framework, which are shown only if they are asked for."""


def told_in_files() -> list[Told]:
    """The ends that files on this host tell of, those of the framework's interfaces last.

    Only these can be read in no time: other middlewares, such as DDS, have to be opened for it. What cannot be read
    counts as not there, because a shell that completes a name can show no error.
    """
    found = [told for _, told in told_by_transport()]
    return sorted(found, key=lambda each: (names.segment(each.channel) in OWN, each.channel))


def told_by_transport() -> list[tuple[str, Told]]:
    """The same, each with its transport, in no order."""
    from ..transports.directory import announcing, census
    from .programs import described

    try:
        announced = [(transport, each) for transport in announcing() for each in census(transport)]
        return announced + [(each.middleware, each.told) for each in described(running=False)]
    except (ConfigurationError, TransportError):
        return []


def channels(ends: Iterable[Told], roles: Iterable[str]) -> list[str]:
    """The names of the channels at whose ends something has one of these roles."""
    wanted = frozenset(roles)
    known = (each.channel for each in ends if each.role in wanted and names.instance(each.channel) != names.ANY)
    return list(dict.fromkeys(each for each in known if each.isprintable()))


def fitting(known: Iterable[str], beginning: str) -> Iterator[str]:
    """The names that begin so, or else their last parts that do: `Laser/getLaserData` for `La`.

    The interfaces of the framework need their first letters, since every component has them.
    """
    every = list(known)
    whole = [each for each in every if each.startswith(beginning)]
    asked = [each for each in whole if (own := _own(each)) is None or own in beginning]
    if whole or not beginning:
        yield from asked or whole
        return
    tails = (each.split("/", at)[at] for each in every for at in range(1, each.count("/") + 1))
    yield from dict.fromkeys(each for each in tails if each.startswith(beginning))


def _own(name: str) -> str | None:
    """The interface of the framework to which a channel belongs. A topic of a recording may have a shorter name."""
    parts = name.split("/")
    return parts[-2] if len(parts) > 1 and parts[-2] in OWN else None


def components(ends: Iterable[Told], beginning: str) -> Iterator[str]:
    """The names of components that begin so, or else the last parts of their names that do."""
    every = dict.fromkeys(each.owner for each in ends if each.owner.isprintable() and each.owner)
    whole = [each for each in every if each.startswith(beginning)]
    yield from whole or (tail for each in every if (tail := each.rpartition("/")[2]).startswith(beginning))
