"""How many samples DDS may keep for the reader or writer of a topic: its policy RESOURCE_LIMITS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ...contract.qos import History
from ...errors import ConfigurationError
from ..base import KEEP_ALL_DEPTH, Channel

UNLIMITED = -1
"""DDS's value for no limit."""


class Limits(NamedTuple):
    """The fields are named as in DDS, and as the options of the transport."""

    max_samples: int = UNLIMITED
    max_instances: int = UNLIMITED
    max_samples_per_instance: int = UNLIMITED

    @property
    def room(self) -> int:
        """Maximum number of samples of a topic. Our topics have no key, so each has one instance."""
        return _least(self.max_samples, self.max_samples_per_instance)

    def check(self, channel: Channel) -> None:
        """Raise ConfigurationError if a topic's depth exceeds the limits."""
        qos = channel.qos
        if qos.history is History.KEEP_ALL or self.room == UNLIMITED or qos.depth <= self.room:
            return
        name = "max_samples" if self.max_samples == self.room else "max_samples_per_instance"
        raise ConfigurationError(
            f"{channel.name}: its qos has depth {qos.depth}, but transport option `{name}` of dds is {self.room}; "
            "raise the option or lower the depth"
        )

    def keeping_all(self) -> Limits:
        """The limits of a topic with history KEEP_ALL, which is always bounded."""
        return Limits(
            _least(self.max_samples, KEEP_ALL_DEPTH),
            self.max_instances,
            _least(self.max_samples_per_instance, self.max_samples, KEEP_ALL_DEPTH),
        )


DEFAULTS = Limits()._asdict()
"""The options of the transport."""


def limits_of(options: Mapping[str, Any]) -> Limits:
    """The limits set by the options. Raises ConfigurationError if they are invalid."""
    for name in DEFAULTS:
        value = options[name]
        if type(value) is not int or (value != UNLIMITED and not 1 <= value < 2**31):
            raise ConfigurationError(
                f"transport option `{name}` must be an integer from 1 to {2**31 - 1}, or -1 for no limit, not {value!r}"
            )
    limits = Limits(**{name: options[name] for name in DEFAULTS})
    if UNLIMITED < limits.max_samples < limits.max_samples_per_instance:
        raise ConfigurationError(
            f"transport option `max_samples_per_instance` is {limits.max_samples_per_instance}, which is more than "
            f"`max_samples` = {limits.max_samples} of all instances"
        )
    return limits


def _least(*limits: int) -> int:
    return min((each for each in limits if each != UNLIMITED), default=UNLIMITED)
