"""Subscribers that ask for more than their publishers offer."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from typing import Any

from ...contract.qos import (
    PRESETS,
    Durability,
    History,
    Liveliness,
    QoS,
    Reliability,
    from_traits,
    shortfalls,
)
from ...runtime.RoboCompIntrospection import End
from ...wire import names
from .facts import Facts, Finding, Weight

NAME = "qos"
HELP = "subscribers that ask for more than their publishers offer"


def find(facts: Facts) -> Iterator[Finding]:
    for component in facts.components:
        for end in component.description.ends if component.description else ():
            asked = asked_by(end) if end.verb == "subscribesTo" else None
            if asked:
                yield from _unmatched(facts, component.name, end, asked)


def asked_by(end: End) -> QoS | None:
    """The QoS of an end; None if another version wrote it in a way that is not understood."""
    try:
        found = tomllib.loads(f"qos = {end.qos}")["qos"]
        if isinstance(found, str):
            return PRESETS[found]
        known = {each.name for each in fields(QoS)}
        said = {name: _WORDS.get(name, _same)(value) for name, value in found.items() if name in known}
        return QoS(**said)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _same(value: Any) -> Any:
    return value


_WORDS: Mapping[str, Callable[[Any], Any]] = {
    "reliability": Reliability,
    "durability": Durability,
    "history": History,
    "liveliness": Liveliness,
}


def _unmatched(facts: Facts, name: str, end: End, asked: QoS) -> Iterator[Finding]:
    told: set[str] = set()
    for channel in facts.network.channels.values():
        if not _hears(end, channel.name):
            continue
        for publisher in channel.providers:
            for short in shortfalls(asked, from_traits(publisher.told.traits)) if publisher.told.traits else ():
                text = f"{name} gets less than it asks for from {channel.name}: {short}"
                if text not in told:
                    told.add(text)
                    yield Finding(Weight.ERROR, text, f"offer it, or set in {name}'s configuration: {short.less}")


def _hears(end: End, channel: str) -> bool:
    return names.matches(end.channel.lstrip("/"), channel)
