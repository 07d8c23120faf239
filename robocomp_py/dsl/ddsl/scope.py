"""Scopes of an instance, for settings and names: its own block, then the systems around it, then the network."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Protocol

from ..source import Name
from . import model as m

HERE = ("localhost", "127.0.0.1", "::1")
"""The addresses of this machine."""


class _Saying(Protocol):
    @property
    def host(self) -> Name | None: ...

    @property
    def restart(self) -> m.Restart | None: ...


def whole(system: tuple[str, ...], name: str) -> str:
    """The full name of an instance or system."""
    return "/".join((*system, name))


def around(system: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """A system and those around it, from the inside out; the last is the whole network, ()."""
    return (system[:depth] for depth in range(len(system), -1, -1))


def meanings(written: str, system: tuple[str, ...], known: Collection[str]) -> list[str]:
    """The full names that match a name used in a system. The first is the one it resolves to."""
    if written.startswith("/"):
        return [written[1:]] if written[1:] in known else []
    return [name for each in around(system) if (name := whole(each, written)) in known]


def offered(instances: Iterable[m.Instance]) -> dict[str, str]:
    """The full names of named instances, by what may be written for them: `left/front`, or `left/world/front`."""
    found: dict[str, str] = {}
    for each in instances:
        for offer in each.offers:
            found[offer.name.text] = found[whole((each.name.text,), offer.local)] = offer.name.text
    return found


def host_of(model: m.Deployment, instance: m.Instance) -> Name | None:
    """The `host` or `ip` of an instance; None for the host that launches the network."""
    return next((said for each in _saying(model, instance) if (said := _host(each))), None)


def place_of(model: m.Deployment, instance: m.Instance) -> str:
    """The host of an instance, as its file names it; "" for the host that launches the network."""
    said = host_of(model, instance)
    return "" if said is None or said.text in HERE else said.text


def _host(each: _Saying) -> Name | None:
    return each.host or (each.ip if isinstance(each, m.Instance) else None)


def restart_of(model: m.Deployment, instance: m.Instance) -> m.Restart | None:
    """The `restart` clause of an instance, possibly of a scope around it."""
    return next((each.restart for each in _saying(model, instance) if each.restart), model.restart)


def _saying(model: m.Deployment, instance: m.Instance) -> Iterator[_Saying]:
    yield instance
    systems = {each.name.text: each for each in model.systems}
    for path in around(instance.system):
        if each := systems.get("/".join(path)):
            yield each
