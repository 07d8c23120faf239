"""`self.caller`: handlers learn which instance called, or sent a message."""

from __future__ import annotations

import functools
import importlib
import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.errors import ComponentError
from robocomp_py.runtime import settings
from robocomp_py.runtime.asking import reads_caller
from robocomp_py.runtime.run import Running
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.callers import CallersConformance, CallersSuite, Echo, Hub, Peer
from robocomp_py.testing.instances import TellerHandler
from robocomp_py.transports.base import Transport, TransportConfig, find_transport
from robocomp_py.transports.inproc import InprocTransport
from robocomp_py.virtual.simulation import Simulation
from tests.transports.domains import DOMAIN
from tests.virtual.test_simulation import part

_buses = itertools.count()


@pytest.fixture(autouse=True)
def alone(own_runtime_folder: Path) -> None:
    """No test meets the components of another one."""


class OverInproc(CallersSuite):
    @pytest.fixture(autouse=True)
    def bus(self) -> None:
        self.bus_name = f"callers-{next(_buses)}"

    def open_transport(self, owner: str = "test") -> Transport:
        return InprocTransport(TransportConfig({"bus": self.bus_name}, owner))


class TestInproc(OverInproc, CallersConformance):
    pass


class TestShm(CallersConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("shm")(TransportConfig(owner=owner))


class TestZeroMQ(CallersConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("zeromq")(TransportConfig(owner=owner))


class TestDDS(CallersConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("dds")(TransportConfig({"domain": DOMAIN}, owner))


class TestZenoh(CallersConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("zenoh")(TransportConfig(owner=owner))


def test_code_outside_of_the_package_must_be_announced() -> None:
    kind = type("Caught", (Hub,), {"reads_caller": False, "__module__": Hub.__module__})
    worker = Running(kind, settings.check(kind.component, settings.Document(), "hub"), find_transport).worker
    with pytest.raises(ComponentError, match="write in Caught: reads_caller = True"):
        _ = worker.caller


class Curious(Worker[None]):
    """Has the name in a lambda in a method."""

    def compute(self) -> None:
        self.after(1.0, lambda: self.caller)


class Named(Worker[None]):
    """Has the name in a text."""

    def compute(self) -> None:
        getattr(self, "caller")  # noqa: B009


def decorated(method: Any) -> Any:
    @functools.wraps(method)
    def run(self: Any) -> Any:
        return method(self)

    return run


class Decorated(Worker[None]):
    @decorated
    def compute(self) -> None:
        print(self.caller)


class Handling(TellerHandler):
    def tell(self, what: str) -> str:
        return self.caller

    def note(self, number: int) -> None:
        pass


def test_classes_that_have_the_name_are_found() -> None:
    assert [reads_caller(kind) for kind in (Curious, Named, Decorated, Handling)] == [True] * 4
    assert not reads_caller(Peer)


def test_modules_of_the_package_are_looked_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package, text in (("asks", "def who(worker): return worker.caller"), ("silent", "def who(worker): ...")):
        (tmp_path / package / "generic").mkdir(parents=True)
        (tmp_path / package / "__init__.py").touch()
        (tmp_path / package / "generic" / "__init__.py").write_text("def caller(self): self.caller")
        (tmp_path / package / "helper.py").write_text(text)
        (tmp_path / package / "specificworker.py").write_text(
            "from . import generic, helper\nclass SpecificWorker:\n    def compute(self): helper.who(self)\n"
        )
    monkeypatch.syspath_prepend(tmp_path)
    kinds = [importlib.import_module(f"{name}.specificworker").SpecificWorker for name in ("asks", "silent")]
    assert [reads_caller(kind) for kind in kinds] == [True, False]


def test_components_that_do_not_ask_import_nothing_of_it() -> None:
    code = "import sys, robocomp_py.runtime.run; assert 'robocomp_py.runtime.callers' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_callers_in_virtual_time() -> None:
    story = []
    for _ in range(2):
        sets = {"ports__teller__from": "echo"}
        parts = [part(Echo, "echo"), part(Hub, "hub", **sets), part(Asker, "asker", ports__teller__from="hub")]
        with Simulation(parts) as sim:
            assert sim.run(0.05)
            hub = sim["hub"].worker
            story.append((sim["asker"].worker.answers, list(hub.noted.queue), list(hub.heard.queue), set(hub.outside)))
    assert story[0] == story[1]
    answers, noted, heard, outside = story[0]
    assert set(answers) == {"asker inner of hub asker"}
    assert set(noted) == {("asker", 1)}
    assert set(heard) == {("asker", 1)}
    assert outside == {""}


class Asker(Peer):
    def __init__(self) -> None:
        super().__init__()
        self.answers: list[str] = []

    def initialize(self) -> None:
        self.news.add("asker")

    def compute(self) -> None:
        self.answers.append(self.teller_proxy.tell("nested"))
        self.teller_proxy.note(1)
        self.news["asker"].push(1)
