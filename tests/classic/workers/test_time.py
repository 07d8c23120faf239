"""The timers of components of RoboComp's generators follow the clock of the component."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.runtime.load import load_worker
from robocomp_py.testing.components import ComponentTest
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.testing.simulation import Simulation
from robocomp_py.transports.base import find_transport

from ...lockstep.test_lockstep import Sun, leading
from ...runtime.running import make, running
from .components import BARE, CLIENT, SERVER, Form, made

TIMED = """\
from PySide2.QtCore import QTimer
from genericworker import *

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map)
        self.Period = 100
        self.number = self.always = 0
        self.once = []
        self.timer.timeout.connect(self.compute)
        self.timer.start(self.Period)
        self.idle = QTimer(self)
        self.idle.timeout.connect(self.count)
        self.idle.start(0)
        QTimer.singleShot(250, self.note)

    def setParams(self, params):
        return True

    @QtCore.Slot()
    def compute(self):
        self.number += 1
        self.touch_proxy.touched([1.5], self.number)

    def count(self):
        self.always += 1

    def note(self):
        self.once.append(self.number)
"""
HEARING = (
    BARE
    + """
    def Touch_touched(self, forces, number):
        self.seen.append(number)
"""
)


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("timed")
    made(root / "arm", Form(SERVER, TIMED))
    made(root / "asker", Form(CLIENT.replace("requires Arm; ", ""), HEARING))
    instances = "Component arm { }; Component asker { };"
    text = f'import "arm/arm.cdsl"; import "asker/arm.cdsl"; Deployment net {{ {instances} }};'
    (root / "net.ddsl").write_text(text)
    return root


def test_in_virtual_time_they_compute_as_often_as_their_period_says(network: Path) -> None:
    hashes = []
    for _ in range(2):
        with Simulation(network / "net.ddsl") as sim:
            assert sim.run(2.0)
            arm, asker = (sim[name].worker._user for name in ("arm", "asker"))
            assert (arm.number, arm.once, arm.always) == (20, [2], 2000)
            assert asker.seen == [*range(1, 21)]
            arm.setPeriod(500)
            assert sim.run(2.0)
            assert arm.number == 24
            assert arm.idle.remainingTime() == 1
        assert not sim.failed
        hashes.append(sim.hash)
    assert hashes[0] == hashes[1]


def test_rcdeploy_simulates_them(network: Path) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "simulate", str(network / "net.ddsl"), "--for", "2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6, check=False)
    assert done.returncode == 0, done.stderr
    assert "\n20 messages, hash " in done.stdout
    assert "machine" not in done.stderr


def test_in_lock_step_they_follow_the_leader(network: Path) -> None:
    kind = load_worker(network / "arm", afresh=True)
    with (
        running(make(Sun, find_transport, "middleware=inproc", *leading("arm"), name="sun"), ready=False) as sun,
        running(make(kind, find_transport, "middleware=inproc", "clock.leader=sun", name="arm"), ready=False) as arm,
    ):
        told: list[tuple[int, int]] = []
        compute = sun.compute

        def noting() -> None:
            compute()
            if len(told) < 40:  # the arm ends first
                told.append((sun.ms, arm._user.number))

        sun.compute = noting
        wait_until(lambda: len(told) == 40)
    assert (sun.outcome, arm.outcome) == (True, True)
    assert all(number == max(0, ms - 1) // 100 for ms, number in told)


def test_what_waits_for_the_machine_is_told_except_in_real_time(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    code = TIMED.replace("        self.always += 1\n", "        time.sleep(0.0)\n").replace(
        "from gen", "import time\nfrom gen"
    )
    worker = load_worker(made(tmp_path / "arm", Form(SERVER, code)), afresh=True)
    told = "src/specificworker.py:27: `time.sleep` waits for the machine while the time of this run stands still"
    with ComponentTest(worker) as arm:
        arm.wait_for(lambda: arm.worker._user.number)
        assert "time.sleep" not in caplog.text
    with ComponentTest(worker, virtual=True) as arm:
        arm.run(0.5)
        assert arm.worker._user.number == 5
        assert told in caplog.text


def test_time_goes_on_while_a_handler_waits_for_a_mutex(tmp_path: Path) -> None:
    slow = "module RoboCompSlow { interface Slow { void work(); }; };\n"
    model = 'import "Slow.idsl"; Component slow { Communications { implements Slow; }; language python; };'
    locked = "        self.mutex.lock()\n        self.seen.append({what})\n        self.mutex.unlock()\n"
    arm = Form(
        SERVER.replace("publishes Touch", "requires Slow").replace("Touch.idsl", "Slow.idsl"),
        BARE.replace("        pass\n", locked.format(what="self.slow_proxy.work()"))
        + "\n    def Arm_halt(self):\n"
        + locked.format(what="'halt'"),
        more={"Slow.idsl": slow},
    )
    made(tmp_path / "arm", arm)
    folder = tmp_path / "slow"
    folder.mkdir()
    (folder / "Slow.idsl").write_text(slow)
    (folder / "slow.cdsl").write_text(model)
    assert rcgen([str(folder / "slow.cdsl")]) == 0
    worker = folder / "specificworker.py"
    head = worker.read_text().partition("class SpecificWorker")[0]
    worker.write_text(
        f"{head}class SpecificWorker(GenericWorker):\n    def Slow_work(self) -> None:\n        self.sleep(0.0075)\n"
    )
    net = 'import "arm/arm.cdsl"; import "slow/slow.cdsl"; Deployment net { Component arm { }; Component slow { }; };'
    (tmp_path / "net.ddsl").write_text(net)
    with Simulation(tmp_path / "net.ddsl") as sim:
        sim.run(0.012)
        sim.call("arm/Arm/halt")
        assert sim["arm"].worker._user.seen == [None, "halt"]
        assert sim.time == 0.018  # the call ends at 17.5 ms, and the handler looks every millisecond
