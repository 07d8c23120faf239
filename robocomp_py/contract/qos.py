"""Quality of service, in ROS 2's words and with its presets."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any


class Reliability(StrEnum):
    """`RELIABLE`: sending waits (until its deadline) rather than lose; `BEST_EFFORT`: it never waits."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best_effort"


class Durability(StrEnum):
    """`TRANSIENT_LOCAL`: a late subscriber still gets the last `depth` messages ("latched")."""

    VOLATILE = "volatile"
    TRANSIENT_LOCAL = "transient_local"


class History(StrEnum):
    """How many messages wait for a slow reader: the newest `depth`, or all (bounded by memory limits)."""

    KEEP_LAST = "keep_last"
    KEEP_ALL = "keep_all"


class Liveliness(StrEnum):
    """A publisher is alive while its process is (`AUTOMATIC`), or while it sends a message every `lease` seconds."""

    AUTOMATIC = "automatic"
    MANUAL_BY_TOPIC = "manual_by_topic"


@dataclass(frozen=True, slots=True)
class QoS:
    """What a topic promises. Times are in seconds; None means without limit.

    `deadline`: the longest time from one message to the next. `lifespan`: older messages are not
    delivered. `lease`: a publisher without a sign of life for this time counts as lost.
    """

    reliability: Reliability = Reliability.BEST_EFFORT
    durability: Durability = Durability.VOLATILE
    history: History = History.KEEP_LAST
    depth: int = 10
    deadline: float | None = None
    lifespan: float | None = None
    liveliness: Liveliness = Liveliness.AUTOMATIC
    lease: float | None = None

    @property
    def reliable(self) -> bool:
        """Whether no message may be lost; `KEEP_ALL` implies it."""
        return self.reliability is Reliability.RELIABLE or self.history is History.KEEP_ALL

    @property
    def latched(self) -> bool:
        return self.durability is Durability.TRANSIENT_LOCAL


DEFAULT_QOS = QoS()
"""Best effort, the newest ten."""

WORDS = {each.name: type(each.default) for each in fields(QoS) if isinstance(each.default, StrEnum)}
"""The settings that are one of a few words, with these."""

TIMES = tuple(each.name for each in fields(QoS) if each.default is None)
"""The settings that are times."""

DEPTHS = range(1, 1_000_001)
"""The depths that are allowed."""

_RELIABLE = QoS(Reliability.RELIABLE)
PRESETS: dict[str, QoS] = {
    "default": DEFAULT_QOS,
    "system_default": DEFAULT_QOS,
    "sensor_data": QoS(depth=5),
    "services_default": _RELIABLE,
    "parameters": replace(_RELIABLE, depth=1000),
    "latched": QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=1),
}
"""Names usable wherever a QoS is written."""


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A policy of which a publisher offers less than a subscriber asks for."""

    policy: str
    asked: str
    """As written in a CDSL file."""
    offered: str
    """Likewise; "" if nothing is offered."""
    less: str
    """What the subscriber would have to set in its configuration."""

    def __str__(self) -> str:
        return f"`{self.asked}` is asked for, {f'`{self.offered}`' if self.offered else 'none'} is offered"


def shortfalls(asked: QoS, offered: QoS) -> list[Shortfall]:
    """The QoS that a publisher fails to offer to a subscriber, by the rules of DDS.

    A lifespan is no promise: the shorter one holds. Nor is history: each side keeps its own.
    """
    found = []
    if asked.reliability is Reliability.RELIABLE and not offered.reliable:
        found.append(Shortfall("reliability", "reliable", "best_effort", 'reliability = "best_effort"'))
    if asked.latched and not offered.latched:
        found.append(Shortfall("durability", "transient_local", "volatile", 'durability = "volatile"'))
    for name in ("deadline", "lease"):
        most, least = getattr(asked, name), getattr(offered, name)
        if most is not None and (least is None or least > most + _NEARLY):
            given = (f"{name} {duration(least)}", f"{name} = {least:g}") if least else ("", f"no `{name}`")
            found.append(Shortfall(name, f"{name} {duration(most)}", *given))
    if asked.liveliness is Liveliness.MANUAL_BY_TOPIC and offered.liveliness is not asked.liveliness:
        words = ("liveliness manual_by_topic", "liveliness automatic", 'liveliness = "automatic"')
        found.append(Shortfall("liveliness", *words))
    return found


_NEARLY = 1e-9
"""Times that differ by less, in seconds, are equal: they are announced in nanoseconds."""


def duration(seconds: float) -> str:
    """A time as written in a CDSL file."""
    return f"{seconds:g} s" if seconds >= 1 else f"{seconds * 1000:g} ms"


def traits(qos: QoS) -> str:
    """A QoS as both sides of a topic announce it: letters and digits that fit into any name; never empty."""
    flags = {"r": qos.reliable, "l": qos.latched, "m": qos.liveliness is Liveliness.MANUAL_BY_TOPIC}
    written = "".join(letter for letter, flag in flags.items() if flag)
    for letter, name in _LETTERS.items():
        seconds = getattr(qos, name)
        if seconds is not None:
            written += f"{letter}{max(1, round(seconds * 1e9))}"
    kept = 0 if qos.history is History.KEEP_ALL else qos.depth
    if kept != DEFAULT_QOS.depth:
        written += f"k{kept}"
    return written or "-"


def from_traits(text: str) -> QoS:
    """The QoS with these traits; unknown letters are ignored."""
    values = {letter: int(number or 0) for letter, number in re.findall(r"([a-z])([0-9]{0,18})", text, re.ASCII)}
    times: dict[str, Any] = {name: values[letter] / 1e9 for letter, name in _LETTERS.items() if values.get(letter)}
    kept = values.get("k", DEFAULT_QOS.depth)
    return QoS(
        Reliability.RELIABLE if "r" in values else Reliability.BEST_EFFORT,
        Durability.TRANSIENT_LOCAL if "l" in values else Durability.VOLATILE,
        History.KEEP_LAST if kept else History.KEEP_ALL,
        min(kept, DEPTHS[-1]) or DEFAULT_QOS.depth,
        liveliness=Liveliness.MANUAL_BY_TOPIC if "m" in values else Liveliness.AUTOMATIC,
        **times,
    )


_LETTERS = {"d": "deadline", "s": "lifespan", "e": "lease"}
"""How `traits` writes each of the times, in nanoseconds."""
