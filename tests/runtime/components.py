"""Small components for tests, as generated code and a user would write them."""

from __future__ import annotations

import threading
from typing import Any, ClassVar

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.parameters import Parameter, ParameterKind, Parameters, ParameterSet
from robocomp_py.contract.qos import PRESETS
from robocomp_py.runtime.ports import Proxy
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON

MIDDLEWARES = ("inproc", "zeromq", "dds", "zenoh", "shm")
RELIABLE = PRESETS["services_default"]


class EverythingProxy(Proxy):
    interface = e.EVERYTHING

    def divide(self, dividend: int, divisor: int, *, deadline: float | None = None) -> tuple[int, int]:
        return self._ask(e.divide, (dividend, divisor), deadline)

    def work(self, task: str, *, deadline: float | None = None) -> str:
        return self._ask(e.work, (task,), deadline)

    def poke(self, number: int, *, deadline: float | None = None) -> None:
        self._send(e.poke, (number,), deadline)


class EverythingPublisher(Proxy):
    interface = e.EVERYTHING

    def news(self, number: int, text: str) -> None:
        self._send(e.news, (number, text), None)


class Diary(Worker[None]):
    """Writes down what is called."""

    component = Component("diary", period=0.005)
    middleware = "inproc"

    def __init__(self) -> None:
        self.entries: list[str] = []

    def initialize(self) -> None:
        self.entries.append("initialize")

    def compute(self) -> None:
        self.entries.append("compute")

    def emergency(self) -> None:
        self.entries.append("emergency")

    def restore(self) -> None:
        self.entries.append("restore")

    def finish(self) -> None:
        self.entries.append("finish")

    @property
    def story(self) -> list[str]:
        """The entries without repetitions."""
        return [each for n, each in enumerate(self.entries) if n == 0 or self.entries[n - 1] != each]


class Calculator(Diary):
    component = Component("calculator", (Port(Verb.IMPLEMENTS, e.EVERYTHING),), period=0.005)

    def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
        return value

    def Everything_echo_arrays(self, value: e.Arrays) -> e.Arrays:
        return value

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        if divisor == 0:
            raise e.Failed("division by zero", 7)
        return divmod(dividend, divisor)

    def Everything_work(self, task: str) -> str:
        self.entries.append(f"work {task}")
        return task

    def Everything_poke(self, number: int) -> None:
        self.entries.append(f"poke {number}")


class Stuck(Calculator):
    """Does its work once it is released."""

    def __init__(self) -> None:
        super().__init__()
        self.begun, self.released = threading.Event(), threading.Event()

    def Everything_work(self, task: str) -> str:
        self.begun.set()
        self.released.wait(10 * SOON)
        return super().Everything_work(task)


class Pupil(Diary):
    component = Component("pupil", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.005)
    everything_proxy: EverythingProxy


class Params(Parameters):
    """What a generated params.py holds, without the dataclass around it."""

    __spec__: ClassVar[ParameterSet]

    def __init__(self, **values: Any) -> None:
        self.__dict__.update(values)


PARAMS = ParameterSet(
    "tuned",
    (
        Parameter("max_speed", ParameterKind.FLOAT, 0.5, 0.0, 2.0, dynamic=True),
        Parameter("device", ParameterKind.STRING, "", mandatory=True),
        Parameter("verbose", ParameterKind.BOOL, False, dynamic=True),
    ),
    python=Params,
)
Params.__spec__ = PARAMS


class Tuned(Diary):
    component = Component("tuned", params=PARAMS, period=0.005)


class Station(Calculator):
    """Serves, and publishes what it was poked with."""

    component = Component(
        "station",
        (
            Port(Verb.IMPLEMENTS, e.EVERYTHING),
            Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=RELIABLE),
        ),
        period=0.005,
    )
    everything_proxy: EverythingPublisher

    def Everything_poke(self, number: int) -> None:
        self.everything_proxy.news(number, "poked")
