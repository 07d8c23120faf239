"""`self.caller`: handlers learn which instance called, or sent a message."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.errors import ComponentError
from robocomp_py.runtime import settings
from robocomp_py.runtime.run import Running
from robocomp_py.testing.callers import CallersConformance, Echo, Hub, Peer
from robocomp_py.testing.instances import TellerHandler
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import find_transport
from robocomp_py.virtual.simulation import Simulation
from tests.transports.over import OverDDS, OverInproc, OverShm, OverZenoh, OverZeroMQ
from tests.virtual.parts import part


@pytest.fixture(autouse=True)
def alone(own_runtime_folder: Path) -> None:
    """No test meets the components of another one."""


class TestInproc(OverInproc, CallersConformance):
    pass


class TestShm(OverShm, CallersConformance):
    pass


class TestZeroMQ(OverZeroMQ, CallersConformance):
    pass


class TestDDS(OverDDS, CallersConformance):
    pass


class TestZenoh(OverZenoh, CallersConformance):
    pass


def test_a_class_that_does_not_announce_it_is_told_what_to_write() -> None:
    kind = type("Caught", (Hub,), {"reads_caller": False})
    worker = Running(kind, settings.check(kind.component, settings.Document(), "hub"), find_transport).worker
    with pytest.raises(ComponentError, match="callers are not noted; write in Caught: reads_caller = True"):
        _ = worker.caller
    with pytest.raises(ComponentError, match="write in Handling: reads_caller = True"):
        _ = Handling().caller


class Handling(TellerHandler):
    def tell(self, what: str) -> str:
        return self.caller

    def note(self, number: int) -> None:
        pass


def test_components_that_do_not_ask_import_nothing_of_it() -> None:
    code = "import sys, robocomp_py.runtime.run; assert 'robocomp_py.runtime.callers' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=SOON * 6)


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
