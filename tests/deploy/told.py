"""What an agent tells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robocomp_py.deploy.agents import Listener


class Told(Listener):
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[Any, ...]] = []

    def output(self, name: str, line: str) -> None:
        self.told.append(("output", name, line))

    def ready(self, name: str) -> None:
        self.told.append(("ready", name))

    def status(self, name: str, text: str) -> None:
        self.told.append(("status", name, text))

    def left(self, name: str, instance: str) -> None:
        self.told.append(("left", name, instance))

    def contract(self, name: str, instance: str, operations: Mapping[str, str]) -> None:
        self.told.append(("contract", name, instance, operations))

    def hung(self, name: str) -> None:
        self.told.append(("hung", name))

    def exited(self, name: str, code: int) -> None:
        self.told.append(("exited", name, code))

    def lost(self, host: str, why: str) -> None:
        self.told.append(("lost", host, why))

    def back(self, host: str) -> None:
        self.told.append(("back", host))
