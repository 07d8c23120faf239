"""Two components for tests of tools: one publishes, the other one hears it."""

from __future__ import annotations

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.testing import everything as e

from ..runtime.components import RELIABLE, Diary, Station


class Talker(Station):
    """Publishes all the time."""

    component = Station.component
    number = 0
    texts = ("hello",)

    def compute(self) -> None:
        self.number += 1
        self.everything_proxy.news(self.number, self.texts[self.number % len(self.texts)])

    def Everything_poke(self, number: int) -> None:
        self.entries.append(f"poked {number}")


class Listener(Diary):
    component = Component("listener", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),), period=0.005)

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"{number} {text}")
