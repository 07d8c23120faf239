"""What a leader and a follower need of the connections of a component, or of a program that leads in its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from ..contract.component import Port
from .answering import Answers
from .RoboCompLockstep import Counter


class Serves(Protocol):
    def serve(self, port: Port, handlers: object) -> None: ...


class Reaches(Serves, Protocol):
    def reach(self, port: Port, instance: str) -> tuple[Any, Callable[[], None]]:
        """A proxy for an interface of another component, and what closes its links."""
        ...


class Hears(Protocol):
    def hear(self, port: Port, handlers: object, instance: str) -> None:
        """Subscribe to an interface of another component."""
        ...


class Publishes(Serves, Protocol):
    def publish(self, port: Port) -> tuple[Any, Callable[[], None]]:
        """A proxy for a topic, and what closes its links."""
        ...


class LocalComponent(Answers, Protocol):
    """The component that leads, as its leader asks it; see `Member`."""

    instance: str
    """Its whole name, as `/robot1/world`."""

    def counters(self) -> Sequence[Counter]: ...
