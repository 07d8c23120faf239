"""Quality of service, in ROS 2's words and with its presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum


class Reliability(StrEnum):
    """`RELIABLE`: sending waits (until its deadline) rather than lose; `BEST_EFFORT`: it never waits."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best_effort"


class Durability(StrEnum):
    """`TRANSIENT_LOCAL`: who subscribes late still gets the last `depth` messages ("latched")."""

    VOLATILE = "volatile"
    TRANSIENT_LOCAL = "transient_local"


class History(StrEnum):
    """How many messages wait for a slow reader: the newest `depth`, or all (bounded by memory limits)."""

    KEEP_LAST = "keep_last"
    KEEP_ALL = "keep_all"


class Liveliness(StrEnum):
    AUTOMATIC = "automatic"
    MANUAL_BY_TOPIC = "manual_by_topic"


@dataclass(frozen=True, slots=True)
class QoS:
    """What a topic promises. Times are in seconds; None means without limit."""

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
        return self.reliability is Reliability.RELIABLE

    @property
    def latched(self) -> bool:
        return self.durability is Durability.TRANSIENT_LOCAL


DEFAULT_QOS = QoS()
"""Best effort, the newest ten."""

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
