"""State machines of components that run: when their methods are called, and what firing does."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.statemachine import State, StateMachine, Transition
from robocomp_py.errors import ComponentError, RemoteFailure, Timeout
from robocomp_py.runtime import ports, settings
from robocomp_py.runtime.lifecycle import State as Life
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE
from robocomp_py.runtime.route import Route
from robocomp_py.runtime.run import Running
from robocomp_py.runtime.statemachine import MAX_WAITING, Machine, Trigger
from robocomp_py.runtime.worker import Worker, check_methods
from robocomp_py.testing import everything as e
from robocomp_py.testing.components import ComponentTest
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.inproc import InprocTransport

MACHINE = StateMachine(
    "game",
    (
        State("start"),
        State("play", (State("left", (State("up"), State("down")), "up"), State("right")), parallel=True),
        State("over", final=True),
    ),
    "start",
    (
        Transition("start", "play", ("go",)),
        Transition("up", "down"),
        Transition("down", "down"),
        Transition("play", "start"),
        Transition("play", "over", ("stop",)),
    ),
)
STATES = [state.name for state in MACHINE.every_state()]


class Game(Worker[None]):
    """Writes down what is called, and in which states it is then; `on` has more to do for some of it."""

    component = Component("game", (Port(Verb.IMPLEMENTS, e.EVERYTHING),), period=0.005, machine=MACHINE)
    middleware = "inproc"
    statemachine: Machine
    t_start_to_play: Trigger
    t_up_to_down: Trigger
    t_down_to_down: Trigger
    t_play_to_start: Trigger
    t_play_to_over: Trigger

    on: dict[str, Callable[[Any], object]]

    def __init__(self) -> None:
        self.entries: list[str] = []
        self.on = {}

    def note(self, what: str) -> None:
        self.entries.append(what)
        self.on.get(what, lambda _: None)(self)

    def initialize(self) -> None:
        self.note("initialize")

    def compute(self) -> None:
        self.note("compute")

    def emergency(self) -> None:
        self.note("emergency")

    def finish(self) -> None:
        self.note("finish")

    def sm_start(self) -> None:
        self.note("start")

    def sm_play(self) -> None:
        self.note("play")

    def sm_left(self) -> None:
        self.note("left")

    def sm_up(self) -> None:
        self.note("up")

    def sm_down(self) -> None:
        self.note("down")

    def sm_right(self) -> None:
        self.note("right")

    def sm_over(self) -> None:
        self.note("over")

    def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
        return value

    def Everything_echo_arrays(self, value: e.Arrays) -> e.Arrays:
        return value

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        return divmod(dividend, divisor)

    def Everything_work(self, task: str) -> str:
        self.note(task)
        return task

    def Everything_poke(self, number: int) -> None:
        self.note(f"poke {number}")

    @property
    def states(self) -> list[str]:
        """The states that were entered, in order."""
        return [entry for entry in self.entries if entry in STATES]


@contextmanager
def playing(**on: Callable[[Any], object]) -> Iterator[Any]:
    """A game that runs, until the block ends."""

    class Playing(Game):
        def __init__(self) -> None:
            super().__init__()
            self.on.update(on)

    with ComponentTest(Playing) as test:
        yield test


def entered(test: Any, *states: str) -> None:
    """Wait until these states, and no others, have been entered, and all that was fired is done."""
    worker = test.worker
    test.wait_for(lambda: worker.states[-len(states) :] == [*states] and not worker.statemachine._waiting)
    test.wait_for_computes(2)
    assert worker.states == [*states]


def test_the_first_states_are_entered_between_initialize_and_the_first_compute() -> None:
    with playing() as test:
        test.wait_for_computes(1)
        assert test.worker.entries[:3] == ["initialize", "start", "compute"]
        assert test.worker.statemachine.active == ("start",)


def test_calls_are_let_in_when_the_machine_is_in_its_first_state() -> None:
    with playing(task=lambda game: game.note(",".join(game.statemachine.active))) as test:
        test.call("Everything.work", "task")
        assert test.worker.entries.index("start") < test.worker.entries.index("task")


def test_a_fired_transition_enters_what_it_leads_to_from_outside_in() -> None:
    with playing() as test:
        test.worker.t_start_to_play()
        entered(test, "start", "play", "left", "up", "right")
        assert test.worker.statemachine.active == ("play", "left", "up", "right")


def test_qt_s_way_of_firing_works_too() -> None:
    with playing() as test:
        test.worker.t_start_to_play.emit()
        entered(test, "start", "play", "left", "up", "right")


def test_a_transition_fired_in_a_state_is_taken_when_all_that_is_entered_with_it_is_entered() -> None:
    with playing(play=lambda game: game.t_up_to_down(), start=lambda game: game.t_start_to_play()) as test:
        entered(test, "start", "play", "left", "up", "right", "down")


def test_what_is_fired_in_initialize_is_taken_after_the_first_states_were_entered() -> None:
    with playing(initialize=lambda game: game.t_start_to_play()) as test:
        entered(test, "start", "play", "left", "up", "right")


def test_what_is_fired_in_the_constructor_is_taken_too() -> None:
    class Eager(Game):
        def __init__(self) -> None:
            super().__init__()
            self.t_start_to_play()

    with ComponentTest(Eager) as test:
        entered(test, "start", "play", "left", "up", "right")


def test_a_handler_may_fire() -> None:
    with playing(fire=lambda game: game.t_start_to_play()) as test:
        test.call("Everything.work", "fire")
        entered(test, "start", "play", "left", "up", "right")


def test_any_thread_may_fire_and_what_is_entered_never_overlaps_with_other_code() -> None:
    inside = threading.Lock()
    overlaps: list[str] = []

    def alone(game: Any) -> None:
        if not inside.acquire(blocking=False):
            overlaps.append("overlap")
            return
        inside.release()

    def slowly(game: Any) -> None:
        with inside:
            sum(range(20_000))  # long enough for others to come in, if they could

    with playing(down=slowly, compute=alone, task=alone) as test:
        worker = test.worker
        worker.t_start_to_play()
        worker.t_up_to_down()
        threads = [threading.Thread(target=lambda: [worker.t_down_to_down() for _ in range(20)]) for _ in range(4)]
        for thread in threads:
            thread.start()
        for _ in range(10):
            test.call("Everything.work", "task")
        for thread in threads:
            thread.join(SOON)
        test.wait_for(lambda: worker.states.count("down") == 81)
    assert overlaps == []


def test_states_are_visible_while_their_methods_run() -> None:
    seen: list[tuple[str, ...]] = []
    with playing(left=lambda game: seen.append(game.statemachine.active)) as test:
        test.worker.t_start_to_play()
        entered(test, "start", "play", "left", "up", "right")
    assert seen == [("play", "left")]


def test_a_state_that_reenters_itself_repeatedly_lets_handlers_run() -> None:
    with playing(down=lambda game: game.t_down_to_down()) as test:
        test.worker.t_start_to_play()
        test.worker.t_up_to_down()
        test.wait_for(lambda: test.worker.states.count("down") > 10)
        test.wait_for_computes(3)
        assert test.call("Everything.work", "task") == "task"
        before = test.worker.states.count("down")
        test.wait_for(lambda: test.worker.states.count("down") > before + 10)


def test_firing_out_of_a_state_that_is_not_active_is_ignored_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    with playing() as test:
        for _ in range(3):
            test.worker.t_up_to_down()
        entered(test, "start")
    warnings = [each.getMessage() for each in caplog.records if each.levelno == logging.WARNING]
    assert warnings == ["t_up_to_down() was ignored: `up` is not active; active: start"]


def test_an_ignored_transition_is_warned_of_again_once_the_machine_has_moved(caplog: pytest.LogCaptureFixture) -> None:
    with playing() as test:
        worker = test.worker
        for fire in (worker.t_play_to_over, worker.t_start_to_play, worker.t_play_to_start, worker.t_play_to_over):
            fire()
        entered(test, "start", "play", "left", "up", "right", "start")
    assert len([each for each in caplog.records if "t_play_to_over() was ignored" in each.getMessage()]) == 2


def test_an_event_moves_what_waits_for_it_and_is_nothing_to_what_does_not() -> None:
    with playing() as test:
        for event in ("stop", "go", "go"):
            test.worker.statemachine.send(event)
        entered(test, "start", "play", "left", "up", "right")


def test_an_event_that_nothing_ever_waits_for_is_refused_at_once() -> None:
    with playing() as test, pytest.raises(ValueError, match="unknown event `stp`; did you mean `stop`"):
        test.worker.statemachine.send("stp")


def test_the_end_state_ends_the_machine_but_not_the_component(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), playing() as test:
        test.worker.t_start_to_play()
        assert not test.worker.statemachine.ended
        test.worker.statemachine.send("stop")
        test.wait_for(lambda: test.worker.statemachine.ended)
        entered(test, "start", "play", "left", "up", "right", "over")
        test.worker.t_start_to_play()
        test.wait_for_computes(3)
        assert test.worker.states[-1] == "over"
        assert test.worker.statemachine.active == ("over",)
    assert test.fine
    assert any("the state machine game has ended (over)" in each.getMessage() for each in caplog.records)


def test_the_end_of_a_state_is_an_event_which_comes_before_all_that_was_fired() -> None:
    machine = StateMachine(
        "round",
        (State("all", (State("one"), State("last", final=True)), "one"), State("next"), State("other")),
        "all",
        (
            Transition("one", "last"),
            Transition("all", "next", ("done.state.all",)),
            Transition("all", "other"),
            Transition("next", "other"),
        ),
    )
    seen: list[str] = []
    made = Machine(machine, seen.append, lambda: None)
    made._begin()
    for trigger in ("t_one_to_last", "t_all_to_other", "t_next_to_other"):
        Trigger(made, machine.triggers()[trigger])()
    while made._waiting:
        made._step()
    assert seen == ["all", "one", "last", "next", "other"]


def test_end_states_of_one_name_call_one_method_and_end_their_own_parent(caplog: pytest.LogCaptureFixture) -> None:
    def part(name: str) -> State:
        return State(name, (State(f"{name}_on"), State(f"{name}.done", final=True)), f"{name}_on")

    ended = StateMachine(
        "parts",
        (part("one"), part("two"), State("done", final=True)),
        "one",
        (
            Transition("one", "two", ("done.state.one",)),
            Transition("two", "done", ("done.state.two",)),
            Transition("one_on", "one.done"),
            Transition("two_on", "two.done"),
        ),
    )
    seen: list[tuple[str, ...]] = []
    methods: dict[str, Any] = dict.fromkeys(ended.methods(), lambda self: None)
    methods |= {
        "sm_one_on": lambda self: self.t_one_on_to_done(),
        "sm_two_on": lambda self: self.t_two_on_to_done(),
        "sm_done": lambda self: seen.append(self.statemachine.active),
    }
    component = Component("parts", period=0.005, machine=ended)
    parts = type("Parts", (Worker,), {"component": component, "middleware": "inproc", **methods})
    with caplog.at_level(logging.INFO), ComponentTest(parts):
        wait_until(lambda: len(seen) == 3)
    assert seen == [("one", "one.done"), ("two", "two.done"), ("done",)]
    assert "the state machine parts has ended (done)" in caplog.text


def test_in_an_emergency_the_machine_rests_and_goes_on_after_it() -> None:
    with playing() as test:
        test.worker.goToEmergency()
        test.wait_for(lambda: "emergency" in test.worker.entries)
        test.worker.t_start_to_play()
        count = test.worker.entries.count("emergency")
        test.wait_for(lambda: test.worker.entries.count("emergency") > count + 2)
        assert test.worker.states == ["start"]
        test.worker.goToRestore()
        entered(test, "start", "play", "left", "up", "right")


def test_too_much_that_was_fired_is_refused_where_it_is_fired() -> None:
    made = Machine(MACHINE, lambda state: None, lambda: None)
    trigger = Trigger(made, MACHINE.transitions[0])
    for _ in range(MAX_WAITING):
        trigger()
    with pytest.raises(ComponentError, match="t_start_to_play: 1000 fired transitions are already waiting"):
        trigger()


def flood(game: Any) -> None:
    for _ in range(MAX_WAITING + 1):
        game.t_down_to_down()


def test_a_handler_that_floods_the_machine_tells_its_caller() -> None:
    with playing(task=flood) as test, pytest.raises(RemoteFailure, match="fired transitions are already waiting"):
        test.call("Everything.work", "task")


def raising(error: BaseException) -> Callable[[Any], object]:
    def do(game: Any) -> None:
        raise error

    return do


def test_a_mistake_in_a_state_ends_the_component_with_its_place(caplog: pytest.LogCaptureFixture) -> None:
    with playing(left=raising(ZeroDivisionError("oh"))) as test:
        test.worker.t_start_to_play()
        test.wait_for(lambda: "finish" in test.worker.entries)
    assert not test.fine
    assert test.worker.states == ["start", "play", "left"]
    [told] = [each.getMessage() for each in caplog.records if each.levelno == logging.ERROR]
    assert told.startswith("Game.sm_left raised ZeroDivisionError")
    assert "in sm_left" in told


def test_a_mistake_in_the_first_state_ends_the_component_before_it_is_ready(caplog: pytest.LogCaptureFixture) -> None:
    with playing(start=raising(ZeroDivisionError("oh"))) as test:
        test.worker  # noqa: B018 - it has ended by itself
    assert not test.fine
    assert test.worker.entries == ["initialize", "start", "finish"]


def test_another_component_that_is_away_cuts_a_state_short_but_not_those_entered_with_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with playing(play=raising(Timeout("too slow"))) as test:
        test.worker.t_start_to_play()
        entered(test, "start", "play", "left", "up", "right")
    assert test.fine
    assert [each.getMessage() for each in caplog.records if each.levelno == logging.WARNING] == [
        "Game.sm_play did not complete: too slow"
    ]


def test_a_state_may_stop_the_component() -> None:
    with playing(over=lambda game: game.stop()) as test:
        test.worker.t_start_to_play()
        test.worker.t_play_to_over()
        test.wait_for(lambda: "finish" in test.worker.entries)
    assert test.fine
    assert test.worker.state is Life.ENDED


def test_what_was_fired_is_forgotten_at_the_end() -> None:
    with playing(finish=lambda game: game.t_start_to_play()) as test:
        pass
    assert test.fine
    assert test.worker.states == ["start"]


@pytest.mark.parametrize("method", ["sm_play", "sm_over"])
def test_a_worker_has_to_have_a_method_for_every_state(method: str) -> None:
    broken = type("Broken", (Game,), {method: None})
    with pytest.raises(ComponentError, match=method):
        check_methods(broken)


def test_the_method_of_a_state_takes_nothing() -> None:
    broken = type("Broken", (Game,), {"sm_play": lambda self, event: None})
    with pytest.raises(ComponentError, match="sm_play must take"):
        check_methods(broken)


def test_common_behavior_tells_the_states(tmp_path: Any) -> None:
    def find(name: str) -> Callable[[TransportConfig], Transport]:
        return lambda config: InprocTransport(TransportConfig({"bus": "statemachine"}, config.owner))

    made = Running(Game, settings.check(Game.component, settings.Document()), find)
    thread = threading.Thread(target=made.run)
    thread.start()
    asking = find("inproc")(TransportConfig(owner="asking"))
    monitor = Monitor("asking")
    port = Port(Verb.REQUIRES, COMMONBEHAVIOR_INTERFACE, proxy=ports.Proxy)
    proxy, links = ports.bind_proxy(
        port,
        lambda port, operation: Route(asking, "inproc", f"game/CommonBehavior/{operation.name}", port.qos, SOON),
        monitor,
    )
    try:
        wait_until(made.ready.is_set)
        operation = next(each for each in COMMONBEHAVIOR_INTERFACE.operations if each.name == "getActiveStates")
        assert proxy._ask(operation, (), SOON) == ["start"]
        vars(made.worker)["t_start_to_play"]()
        wait_until(lambda: proxy._ask(operation, (), SOON) == ["play", "left", "up", "right"])
    finally:
        made.stop()
        thread.join(SOON)
        ports.close_all(links)
        monitor.close()
        asking.close()
