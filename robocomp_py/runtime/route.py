"""Where the messages of an operation go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..contract.component import Port
from ..contract.interface import Operation
from ..contract.qos import QoS
from ..transports.base import Transport


@dataclass(frozen=True)
class Route:
    """The transport and channel of one operation of one port."""

    transport: Transport
    middleware: str
    channel: str
    qos: QoS
    deadline: float
    also: tuple[Route, ...] = ()
    """Further routes: over other middlewares, or to other publishers of a subscription."""

    @property
    def all(self) -> tuple[Route, ...]:
        return (self, *self.also)


Router = Callable[[Port, Operation[Any]], Route]
"""Returns the route of an operation of a port."""
