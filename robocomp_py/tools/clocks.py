"""The clocks that networks follow, and how they are driven: `ClockControl` of the components that lead them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import RobocompError, Timeout
from ..lockstep.RoboCompClock import CLOCKCONTROL_INTERFACE
from .access import Access
from .network import Channel, Network

INTERFACE = CLOCKCONTROL_INTERFACE.short

_LOOK = 0.02
"""Seconds between two looks if the clock stands still."""


@dataclass(frozen=True)
class Clock:
    """How a clock stands."""

    leader: str
    """The whole name of the instance that leads it."""
    now: int
    """Nanoseconds since the start of the run."""
    speed: float
    """Seconds of the clock in one second; 0 for as fast as possible."""
    paused: bool
    followers: tuple[str, ...]

    @property
    def seconds(self) -> float:
        return self.now / 1e9


def leaders(network: Network) -> list[str]:
    """The whole names of the instances that lead a clock."""
    return network.offering(INTERFACE, [each.name for each in CLOCKCONTROL_INTERFACE.operations])


def state(access: Access, network: Network, leader: str, deadline: float) -> Clock:
    """How the clock of a leader stands. Raises what any call raises, and ValueError if the answer makes no sense."""
    channel = _channel(network, leader, "state")
    (told,) = access.ask_again(channel, (), deadline)
    (output,) = channel.operation.outputs
    try:
        found = dict(zip((each.name for each in output.type.fields), told, strict=True))  # type: ignore[union-attr]
        followers = tuple(map(str, found["followers"]))
        return Clock(leader, int(found["now"]), float(found["speed"]), bool(found["paused"]), followers)
    except (AttributeError, KeyError, TypeError, ValueError) as exc:
        raise ValueError(f"{channel.name}: the answer is not that of {INTERFACE}") from exc


def drive(
    access: Access, network: Network, leader: str, operation: str, arguments: Sequence[Any], deadline: float
) -> None:
    """Call an operation of `ClockControl`. After a pause or a step, wait until the clock stands still.

    Raises what any call raises, and Timeout.
    """
    end = time.monotonic() + deadline
    answer = access.ask(_channel(network, leader, operation), tuple(arguments), deadline)
    until = answer[0] if operation == "step" else 0
    if until:  # a clock that passes by itself takes its time
        now = state(access, network, leader, deadline)
        end += max(0, until - now.now) / 1e9 / now.speed if now.speed else 0.0
    while operation in ("pause", "step"):
        now = state(access, network, leader, max(0.1, end - time.monotonic()))
        if now.paused and now.now >= until:
            return
        if time.monotonic() > end:
            raise Timeout(
                f"the clock of {leader} does not stand still after {deadline:g} s, but is at {now.seconds:g} s"
            )
        time.sleep(_LOOK)


def _channel(network: Network, leader: str, operation: str) -> Channel:
    wanted = f"{leader}/{INTERFACE}/{operation}"
    found = next((each for each in network.stock(INTERFACE) if each.name == wanted and each.providers), None)
    if found is None:
        raise RobocompError(f"{leader} has no {INTERFACE}.{operation}")
    return found
