"""State machines in generated components: what they carry, and that they run."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.codegen.machine import state_doc, states_of
from robocomp_py.codegen.stubs import Stubs, find_stubs
from robocomp_py.contract.component import Component
from robocomp_py.contract.statemachine import State, StateMachine
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.testing.components import ComponentTest

from .generated import MODELS, artifacts, golden_model, loaded
from .golden import GOLDEN

PATROL = golden_model("patrol")


def specific() -> str:
    return next(each.text for each in artifacts("patrol") if str(each.path) == "specificworker.py")


def test_generated_code_carries_the_machine_that_its_file_describes() -> None:
    machine = Workspace().statemachine(MODELS / "patrol.smdsl")
    assert isinstance(machine, StateMachine)
    assert loaded(GOLDEN / "patrol").component.machine == machine


def test_the_generated_component_goes_where_its_machine_leads() -> None:
    entered: list[str] = []

    class Patrol(loaded(GOLDEN / "patrol")):  # type: ignore[misc]  # a class that is known when it runs
        def __getattribute__(self, name: str) -> Any:
            if name.startswith("sm_"):
                entered.append(name)
            return super().__getattribute__(name)

        def initialize(self) -> None:
            self.t_waiting_to_working()
            self.t_driving_to_turning()
            self.t_turning_to_charging()

    with ComponentTest(Patrol) as component:
        component.wait_for(lambda: component.worker.statemachine.active == ("charging",))
    assert component.fine
    assert entered == [
        *("sm_waiting", "sm_working", "sm_moving", "sm_driving", "sm_watching", "sm_looking"),
        *("sm_turning", "sm_charging"),
    ]


def stubs(source: str) -> Stubs:
    def read(path: Path) -> bytes:
        if path.name != "specificworker.py":
            raise FileNotFoundError(path)
        return source.encode()

    return find_stubs(Path("patrol"), PATROL, read)


def test_a_generated_specific_part_lacks_no_state() -> None:
    found = stubs(specific())
    assert (found.missing, found.unfit) == ({}, {})


def test_the_method_of_a_new_state_comes_to_be_pasted() -> None:
    tree = ast.parse(specific())
    [worker] = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    worker.body = [node for node in worker.body if getattr(node, "name", "") not in ("sm_turning", "sm_off")]
    found = stubs(ast.unparse(tree))
    assert found.missing == {
        "sm_turning": (
            "    def sm_turning(self) -> None:\n"
            '        """Called when `turning` is entered. From here: self.t_turning_to_charging(),\n'
            "        self.t_turning_to_driving().\n"
            '        """\n'
        ),
        "sm_off": (
            '    def sm_off(self) -> None:\n        """Called when `off` is entered, which ends the state machine."""\n'
        ),
    }


def test_the_method_of_a_state_that_wants_more_than_it_gets_is_unfit() -> None:
    source = specific().replace("def sm_broken(self)", "def sm_broken(self, why)")
    assert stubs(source).unfit == {"sm_broken": "def sm_broken(self) -> None:"}


def test_a_state_that_is_added_is_announced_and_the_file_stays_as_it_is(tmp_path: Path, capsys: Any) -> None:
    cdsl, smdsl = tmp_path / "arm.cdsl", tmp_path / "arm.smdsl"
    cdsl.write_text('Component arm { language python; statemachine "arm.smdsl"; };')
    smdsl.write_text("arm { initial_state begin; };")
    assert rcgen([str(cdsl)]) == 0
    before = (tmp_path / "specificworker.py").read_text()
    smdsl.write_text("arm { initial_state begin; end_state over; transitions { begin => over; }; };")
    capsys.readouterr()
    assert rcgen(["--check", str(cdsl)]) == 1
    assert rcgen([str(cdsl)]) == 0
    said = capsys.readouterr().out
    assert f"lacks sm_over; run `rcgen --stubs {cdsl}`, or add to SpecificWorker:" in said
    assert "def sm_over(self) -> None:" in said
    assert (tmp_path / "specificworker.py").read_text() == before
    assert "`arm.cdsl`, `arm.smdsl`" in (tmp_path / "README.md").read_text()


def test_end_states_of_one_name_get_one_method_which_says_what_each_ends() -> None:
    def part(name: str) -> State:
        return State(name, (State(f"{name}_on"), State(f"{name}.done", final=True)), f"{name}_on")

    machine = StateMachine("parts", (part("one"), part("two"), State("done", final=True)), "one")
    component = Component("parts", machine=machine)
    assert [state.method for state in states_of(component)] == machine.methods()
    (done,) = (state for state in states_of(component) if state.method == "sm_done")
    assert state_doc(done, machine) == "Called when `done` is entered, which ends the state machine or `one` or `two`."
