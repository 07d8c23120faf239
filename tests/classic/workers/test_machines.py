"""State machines by the names that RoboComp's generated code gave to their parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robocomp_py.runtime.load import load_worker
from robocomp_py.testing.components import ComponentTest

from .components import BARE, Form, made

CDSL = 'Component arm { Communications { }; language python; statemachine "arm.smdsl"; };\n'
DEFAULT = """\
defaultMachine{
    states compute;
    initial_state initialize;
    end_state finalize;
    transitions{ initialize => compute; compute => compute; compute => finalize; };
};
"""
NESTED = """\
manager{
    states admin;
    initial_state start;
    end_state gone;
    transitions{ start => admin; admin => gone; };
};
:admin{
    states paused;
    initial_state playing;
    transitions{ playing => paused; paused => playing; };
};
"""


def component(folder: Path, smdsl: str, start: str, states: str) -> ComponentTest:
    worker = BARE.replace("        self.timer.timeout.connect(self.compute)\n", start)
    form = Form(CDSL, worker + states, more={"arm.smdsl": smdsl})
    return ComponentTest(load_worker(made(folder / "arm", form)))


def seen(test: ComponentTest) -> Any:
    return test.worker._user.seen


def test_the_default_machine_computes_at_every_beat_of_the_timer(tmp_path: Path) -> None:
    start = "        self.defaultMachine.start()\n        self.destroyed.connect(self.t_compute_to_finalize)\n"
    states = """
    @QtCore.Slot()
    def sm_initialize(self):
        self.seen.append("initialize")
        self.t_initialize_to_compute.emit()

    @QtCore.Slot()
    def sm_compute(self):
        self.compute()
        self.seen.append("compute")
        if len(self.seen) == 4:
            self.t_compute_to_finalize.emit()

    @QtCore.Slot()
    def sm_finalize(self):
        self.seen.append("finalize")
"""
    with component(tmp_path, DEFAULT, start, states) as arm:
        arm.wait_for(lambda: "finalize" in seen(arm))
        assert arm.worker.statemachine.ended
        assert seen(arm) == ["initialize", "compute", "compute", "compute", "finalize"]
    assert arm.fine


def test_states_within_states_and_the_names_of_before_2020(tmp_path: Path) -> None:
    start = """\
        self.playing_state.entered.connect(lambda: self.seen.append("entered"))
        self.manager.finished.connect(lambda: self.seen.append("finished"))
        self.manager.start()
"""
    states = """
    def sm_start(self):
        self.seen.append(self.manager.configuration())
        self.starttoadmin.emit()

    def sm_admin(self):
        self.seen.append(self.manager.isRunning())

    def sm_playing(self):
        QtCore.QTimer.singleShot(0, self.playingtopaused)

    def sm_paused(self):
        self.seen.append(self.paused_state.active())
        self.t_admin_to_gone.emit()

    def sm_gone(self):
        self.seen.append("gone")
"""
    with component(tmp_path, NESTED, start, states) as arm:
        arm.wait_for(lambda: "finished" in seen(arm))
        assert seen(arm) == [("start",), True, "entered", True, "gone", "finished"]
    assert arm.fine


def test_an_exception_of_a_states_slot_is_logged_and_the_machine_continues(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    start = "        self.compute_state.entered.connect(self.fail)\n        self.defaultMachine.start()\n"
    states = """
    def sm_initialize(self):
        self.initializetocompute()

    def fail(self):
        self.t_compute_to_finalize.emit()
        raise ValueError("bad")

    def sm_finalize(self):
        self.seen.append("finalize")
"""
    with component(tmp_path, DEFAULT, start, states) as arm:
        arm.wait_for(lambda: "finalize" in seen(arm))
    assert arm.fine
    told = [each.getMessage() for each in caplog.records if "raised" in each.getMessage()]
    assert [each.splitlines()[0] for each in told] == ["SpecificWorker.fail raised ValueError"]


def test_a_machine_that_is_not_started_stays_where_it_is(tmp_path: Path) -> None:
    states = "\n    def sm_initialize(self):\n        self.seen.append('initialize')\n"
    connect = "        self.timer.timeout.connect(self.compute)\n"
    with component(tmp_path, DEFAULT, connect, states) as arm:
        arm.wait_for_computes(3)
        assert seen(arm) == []
        assert arm.worker.statemachine.active == ()
    assert arm.fine
