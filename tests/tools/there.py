"""`python -m tests.tools.there`: components of another host. They end with their standard input."""

from __future__ import annotations

import sys

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.testing import everything as e
from robocomp_py.transports.base import find_transport

from ..runtime.components import RELIABLE, Diary, Station
from ..runtime.running import make, running

HEARD: list[str] = []
"""What the listener was told from outside."""


class Talker(Station):
    component = Station.component
    number = 0
    text = "hello"

    def compute(self) -> None:
        self.number += 1
        self.everything_proxy.news(self.number, self.text)

    def Everything_work(self, task: str) -> str:
        return f"{task} {HEARD}"

    def Everything_poke(self, number: int) -> None:
        self.text = "x" * number


class Listener(Diary):
    component = Component("listener", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),), period=0.02)

    def Everything_news(self, number: int, text: str) -> None:
        if number < 0:
            HEARD.append(text)


if __name__ == "__main__":
    with (
        running(make(Talker, find_transport, "middleware=shm", name="talker")),
        running(make(Listener, find_transport, "middleware=shm", name="listener")),
    ):
        print("ready", flush=True)
        sys.stdin.read()
