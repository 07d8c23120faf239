"""Components under test: faked, called, and told apart where a port occurs several times."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from robocomp_py.errors import (
    Busy,
    Closed,
    ConfigurationError,
    ContractMismatch,
    Refused,
    RemoteFailure,
    RobocompError,
    Timeout,
    TransportError,
    Unreachable,
)
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e
from robocomp_py.testing import stages
from robocomp_py.testing.components import ComponentTest, gone_after, in_turn, late, stand_ins
from robocomp_py.testing.patience import SOON, wait_until

from ..runtime.components import Calculator, EverythingProxy, EverythingPublisher, Tuned


@pytest.fixture(autouse=True, params=["real", "virtual"])
def time_of_tests(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test runs in real time and in virtual time."""
    monkeypatch.setitem(globals(), "ComponentTest", partial(ComponentTest, virtual=request.param == "virtual"))


class Comparing(Worker[None]):
    """Asks two of a kind, and hears two of a kind."""

    component = Component(
        "comparing",
        (
            Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
            Port(Verb.REQUIRES, e.EVERYTHING, "1", proxy=EverythingProxy),
            Port(Verb.SUBSCRIBES, e.EVERYTHING),
            Port(Verb.SUBSCRIBES, e.EVERYTHING, "1"),
        ),
        period=0.005,
    )
    middleware = "inproc"
    everything_proxy: EverythingProxy
    everything1_proxy: EverythingProxy

    def __init__(self) -> None:
        self.answers: list[str] = []
        self.heard: list[tuple[str, int]] = []

    def initialize(self) -> None:
        self.answers = [self.everything_proxy.work("first"), self.everything1_proxy.work("second")]

    def Everything_news(self, number: int, text: str) -> None:
        self.heard.append(("first", number))

    def Everything1_news(self, number: int, text: str) -> None:
        self.heard.append(("second", number))


def test_each_of_several_ports_has_a_fake_of_its_own() -> None:
    fakes: dict[str, Any] = {"everything": {"work": str.upper}, "everything1": {"work": "faked"}}
    with ComponentTest(Comparing, **fakes) as component:
        component.send("Everything1.news", 1, "")
        component.wait_for(lambda: component.worker.heard)
        component.send("Everything.news", 2, "")
        component.wait_for(lambda: len(component.worker.heard) == 2)
        assert component.worker.answers == ["FIRST", "faked"]
        assert component.received("everything1.work") == [("second",)]
        assert component.worker.heard == [("second", 1), ("first", 2)]
    assert component.fine


class Telling(Worker[None]):
    """Has something to say at the end."""

    component = Component("telling", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher),), period=0.005)
    middleware = "inproc"
    everything_proxy: EverythingPublisher

    def finish(self) -> None:
        for number in range(3):
            self.everything_proxy.news(number, "")


def test_what_it_publishes_last_is_received_although_it_has_ended() -> None:
    def late(number: int, text: str) -> None:
        wait_until(lambda: not component._thread.is_alive())

    with ComponentTest(Telling, everything={"news": late}) as component:
        pass
    assert component.fine
    assert component.received("everything.news") == [(number, "") for number in range(3)]


def test_what_it_implements_can_be_called() -> None:
    with ComponentTest(Calculator) as component:
        assert component.call("Everything.divide", 7, 2) == (3, 1)
        with pytest.raises(e.Failed):
            component.call("Everything.divide", 7, 0)


@pytest.mark.parametrize(
    ("fakes", "said"),
    [
        ({"everyting": {}}, "unknown port `everyting`; did you mean `everything`?"),
        ({"everything": {"wrok": 1}}, "port `everything`: unknown operation `wrok`; did you mean `work`?"),
    ],
)
def test_a_fake_of_what_is_not_there_is_a_mistake(fakes: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        ComponentTest(Comparing, **fakes)


def test_asking_for_what_is_not_there_is_a_mistake() -> None:
    with ComponentTest(Comparing) as component:
        for use in (
            lambda: component.received("everything.wrok"),
            lambda: component.send("Everything.nws", 1, ""),
            lambda: component.call("Evrything.work", ""),
            lambda: component.call("everything.work", ""),
        ):
            with pytest.raises(ValueError, match=r"did you mean|is nothing to call"):
                use()


def test_configuration_may_have_lists_and_any_text() -> None:
    item = ParameterSet("motors", (Parameter("name", ParameterKind.STRING, ""),))
    spec = ParameterSet("arm", (Parameter("word", ParameterKind.STRING, ""),), (ParameterList("motors", item, 1),))

    class Arm(Calculator):
        component = Component("arm", (), spec)

    found: dict[str, Any] = {}
    spec_of = replace(spec, python=lambda **values: found.update(values))
    item_of = replace(item, python=dict)
    Arm.component = Component("arm", (), replace(spec_of, lists=(ParameterList("motors", item_of, 1),)))
    config = {"params.word": 'a "quoted" \\ wörd', "params.motors": [{"name": "left"}, {"name": "right"}]}
    with ComponentTest(Arm, config):
        pass
    assert found == {"word": 'a "quoted" \\ wörd', "motors": ({"name": "left"}, {"name": "right"})}


def test_a_component_that_does_not_start_leaves_nothing_running(monkeypatch: pytest.MonkeyPatch) -> None:
    def given_up(*arguments: object) -> None:
        raise AssertionError("not ready")

    for stage in (stages.RealTime, stages.VirtualTime):
        monkeypatch.setattr(stage, "wait", given_up)
    before = set(threading.enumerate())
    with pytest.raises(AssertionError, match="not ready"), ComponentTest(Calculator):
        raise AssertionError("it was entered")
    assert set(threading.enumerate()) <= before  # others may end


class Retuned(Tuned):
    def paramsChanged(self, changed: frozenset[str]) -> None:
        self.entries.append(f"{sorted(changed)} changed")


def test_dynamic_parameters_can_be_changed_as_from_outside() -> None:
    with ComponentTest(Retuned, {"params.device": "x"}) as component:
        component.change({"max_speed": 1.5, "verbose": True})
        component.change({"verbose": False})
        assert (component.worker.params.max_speed, component.worker.params.verbose) == (1.5, False)
        told = [entry for entry in component.worker.entries if "changed" in entry]
        assert told == ["['max_speed', 'verbose'] changed", "['verbose'] changed"]
        with pytest.raises(RemoteFailure, match="`device` is not dynamic"):
            component.change({"device": "y"})


def test_a_program_that_never_enters_the_block_ends() -> None:
    program = (
        "from robocomp_py.testing.components import ComponentTest\n"
        "from tests.runtime.components import Calculator\n"
        "forgotten = ComponentTest(Calculator)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=SOON * 6)
    assert (done.returncode, done.stderr) == (0, "")


class Asking(Worker[None]):
    """Writes down how its calls end."""

    component = Component("asking", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.005)
    middleware = "inproc"
    everything_proxy: EverythingProxy

    def __init__(self) -> None:
        self.outcomes: list[str] = []

    def compute(self) -> None:
        self.note(lambda: self.everything_proxy.work("task", deadline=SOON))

    def note(self, call: Callable[[], object]) -> None:
        try:
            self.outcomes.append(str(call()))
        except RobocompError as exc:
            self.outcomes.append(type(exc).__name__)


OUTCOMES = [Unreachable("x"), Timeout("x"), Busy("x"), Refused("x"), ContractMismatch("x"), Closed("x")]


@pytest.mark.parametrize("outcome", OUTCOMES, ids=lambda each: type(each).__name__)
def test_a_fake_can_end_a_call_by_every_outcome_of_a_transport(outcome: TransportError) -> None:
    def raising(task: str) -> str:
        raise outcome

    for fake in (outcome, raising):
        with ComponentTest(Asking, everything={"work": in_turn(fake, "done")}) as component:
            component.wait_for(lambda: "done" in component.worker.outcomes)
            assert component.worker.outcomes[0] == type(outcome).__name__
            assert component.received("everything.work")[0] == ("task",)
        assert component.fine


def test_other_exceptions_of_a_fake_reach_the_component_as_they_would_from_elsewhere() -> None:
    with ComponentTest(Asking, everything={"work": in_turn(ValueError("x"), "done")}) as component:
        component.wait_for(lambda: "done" in component.worker.outcomes)
    assert component.worker.outcomes[0] == "RemoteFailure"


def test_a_fake_can_answer_late_and_too_late() -> None:
    class Hasty(Asking):
        """Waits long for an answer, except for the sixth one."""

        def compute(self) -> None:
            deadline = 0.5 if len(self.outcomes) == 5 else SOON
            self.note(lambda: self.everything_proxy.work("task", deadline=deadline))

    fake = in_turn("prompt", "prompt", "prompt", "prompt", late(0.01, "later"), late(SOON, "never"), "done")
    with ComponentTest(Hasty, everything={"work": fake}) as component:
        component.wait_for(lambda: "done" in component.worker.outcomes)
    assert component.worker.outcomes[:6] == ["prompt"] * 4 + ["later", "Timeout"]


def test_a_fake_can_be_gone_after_some_calls() -> None:
    with ComponentTest(Asking, everything={"work": gone_after(3, str.upper)}) as component:
        component.wait_for(lambda: len(component.worker.outcomes) > 4)
    assert component.worker.outcomes[:5] == ["TASK", "TASK", "TASK", "Unreachable", "Unreachable"]


def test_the_other_side_of_a_port_can_go_and_come_back() -> None:
    with ComponentTest(Asking, everything={"work": "there"}) as component:
        component.wait_for(lambda: component.worker.outcomes)
        with component.without("everything"):
            component.wait_for(lambda: component.worker.outcomes[-1] == "Unreachable")
        component.wait_for(lambda: component.worker.outcomes[-1] == "there")
    assert component.fine


class Commanding(Asking):
    def compute(self) -> None:
        self.note(lambda: self.everything_proxy.poke(7))


def test_a_command_can_fail_to_be_sent() -> None:
    with ComponentTest(Commanding, everything={"poke": in_turn(None, Unreachable("x"), None)}) as component:
        component.wait_for(lambda: len(component.worker.outcomes) > 3)
    assert component.worker.outcomes[:4] == ["None", "Unreachable", "None", "None"]
    assert component.received("everything.poke")[:2] == [(7,), (7,)]


def test_asynchronous_calls_end_by_the_same_outcomes() -> None:
    class Later(Asking):
        def compute(self) -> None:
            self.note(lambda: self.everything_proxy._ask_async(e.work, ("task",), 5.0).result())

    with ComponentTest(Later, everything={"work": in_turn(Busy("x"), "done")}) as component:
        component.wait_for(lambda: "done" in component.worker.outcomes)
    assert component.worker.outcomes[0] == "Busy"


def test_a_missing_parameter_is_reported_with_what_a_test_has_to_give() -> None:
    with pytest.raises(ConfigurationError) as told:
        ComponentTest(Tuned)
    assert "`device` is mandatory" in str(told.value)
    assert "in a test: ComponentTest(SpecificWorker, {'params.device': ''}), or stand_ins(SpecificWorker)" in str(
        told.value
    )
    with ComponentTest(Tuned, stand_ins(Tuned)) as component:
        component.wait_for_computes(1)
    assert component.fine
