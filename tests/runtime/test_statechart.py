"""How state machines move: any machine, any sequence of transitions and events."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.statemachine import State, StateMachine, Transition
from robocomp_py.runtime.statechart import Chart

PATROL = StateMachine(
    "patrol",
    (
        State("waiting"),
        State(
            "working",
            (
                State("moving", (State("driving"), State("turning"), State("arrived", final=True)), "driving"),
                State("watching", (State("looking"), State("seen", final=True)), "looking"),
            ),
            parallel=True,
        ),
        State("off", final=True),
    ),
    "waiting",
    (
        Transition("waiting", "working", ("go",)),
        Transition("driving", "turning", ("turn", "step", "either")),
        Transition("turning", "driving", ("turn",)),
        Transition("driving", "arrived"),
        Transition("looking", "seen", ("step",)),
        Transition("working", "off", ("stop", "turn", "error.*")),
        Transition("moving", "moving", ("again",)),
        Transition("looking", "turning", ("cross",)),
        Transition("turning", "waiting", ("step",)),
        Transition("working", "waiting", ("done.state.working",)),
        Transition("looking", "waiting", ("either",)),
        Transition("looking", "seen", ("either",)),
    ),
)
CHART = Chart(PATROL)
WORKING = ("working", "moving", "driving", "watching", "looking")


def by(event: str, active: tuple[str, ...] = WORKING) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What an event has left and entered."""
    step = CHART.step(active, CHART.chosen(active, event))
    return step.left, step.entered


def test_it_begins_in_its_initial_state() -> None:
    assert CHART.begin() == ("waiting",)


def test_all_regions_of_a_parallel_state_are_entered_from_outside_in() -> None:
    assert by("go", ("waiting",)) == (("waiting",), WORKING)


def test_states_are_left_from_inside_out_the_last_one_first() -> None:
    assert by("stop") == (("looking", "watching", "driving", "moving", "working"), ("off",))


def test_one_event_may_move_several_regions() -> None:
    assert by("step") == (("looking", "driving"), ("turning", "seen"))


def test_the_transition_of_the_innermost_state_goes_first() -> None:
    assert by("turn") == (("driving",), ("turning",))


def test_of_transitions_that_exclude_each_other_that_of_the_first_state_in_the_file_is_taken() -> None:
    """`turning` and `looking` both want `step`, and one of them would leave the other's region."""
    active = ("working", "moving", "turning", "watching", "looking")
    assert by("step", active) == (active[::-1], ("waiting",))


def test_a_transition_that_has_to_stand_back_is_not_replaced_by_the_next_one_of_its_state() -> None:
    assert by("either") == (("driving",), ("turning",))


def test_a_transition_of_a_state_to_itself_leaves_it_and_enters_it_again() -> None:
    """A region cannot be left alone: all of its parallel state is, as SCXML has it."""
    assert by("again") == (WORKING[::-1], WORKING)


def test_a_transition_into_another_region_leaves_both_and_enters_what_is_beside_its_target() -> None:
    assert by("cross") == (WORKING[::-1], ("working", "moving", "turning", "watching", "looking"))


@pytest.mark.parametrize(
    ("event", "taken"),
    [("error", 1), ("error.arm", 1), ("error.arm.hot", 1), ("errors", 0), ("stop.now", 1), ("st", 0)],
)
def test_events_are_heard_by_their_first_words(event: str, taken: int) -> None:
    assert len(CHART.chosen(WORKING, event)) == taken


def test_a_star_hears_everything() -> None:
    chart = Chart(StateMachine("any", (State("a"), State("b")), "a", (Transition("a", "b", ("*",)),)))
    assert chart.chosen(("a",), "whatever") == [Transition("a", "b", ("*",))]


def test_a_state_ends_with_an_event_and_a_parallel_one_when_all_its_regions_have_ended() -> None:
    half = ("working", "moving", "arrived", "watching", "looking")
    assert [*CHART.done(("arrived",), half)] == ["done.state.moving"]
    whole = ("working", "moving", "arrived", "watching", "seen")
    assert [*CHART.done(("seen",), whole)] == ["done.state.watching", "done.state.working"]
    assert not CHART.ended(whole)


def test_the_machine_ends_with_its_own_end_state() -> None:
    assert CHART.ended(("off",))
    assert [*CHART.done(("off",), ("off",))] == []


# Any machine.

EVENTS = ("a", "b", "a.b")


@st.composite
def machines(draw: st.DrawFn) -> StateMachine:
    numbers = iter(range(100))

    def state(depth: int) -> State:
        name = f"s{next(numbers)}"
        inner = tuple(state(depth + 1) for _ in range(draw(st.integers(0, max(0, 3 - depth)))))
        if not inner:
            return State(name, final=depth > 0 and draw(st.booleans()) and draw(st.booleans()))
        if draw(st.booleans()):
            return State(name, tuple(without_end(each) for each in inner), parallel=True)
        return State(name, inner, draw(st.sampled_from([each.name for each in within(inner)])))

    states = tuple(state(0) for _ in range(draw(st.integers(1, 4))))
    names = [each.name for each in within(states)]
    sources = [each.name for each in within(states) if not each.final] or names
    transition = st.builds(
        Transition,
        st.sampled_from(sources),
        st.sampled_from(names),
        st.lists(st.sampled_from([*EVENTS, "*", "a.*"]), max_size=2).map(tuple),
    )
    transitions = draw(st.lists(transition, min_size=1, max_size=12))
    return StateMachine("any", states, draw(st.sampled_from(names)), tuple(transitions))


def within(states: tuple[State, ...]) -> list[State]:
    return [inner for state in states for inner in (state, *within(state.states))]


def without_end(state: State) -> State:
    return State(state.name, state.states, state.initial, state.parallel)


def legal(active: set[str], states: tuple[State, ...], parallel: bool = False) -> bool:
    """Whether of these states, all of what is active around them, the right ones are active."""
    inside = [state for state in states if state.name in active]
    right = len(inside) == (len(states) if parallel else min(1, len(states)))
    idle = {each.name for state in states if state not in inside for each in within(state.states)}
    return right and not idle & active and all(legal(active, state.states, state.parallel) for state in inside)


def depths(machine: StateMachine) -> dict[str, tuple[int, ...]]:
    """The place of every state: its number in what it is in, behind the place of that."""

    def places(states: tuple[State, ...], before: tuple[int, ...]) -> Iterator[tuple[str, tuple[int, ...]]]:
        for number, state in enumerate(states):
            yield state.name, (*before, number)
            yield from places(state.states, (*before, number))

    return dict(places(machine.states, ()))


@given(machines(), st.data())
def test_whatever_happens_the_right_states_are_active_left_and_entered_in_order(
    machine: StateMachine, data: st.DataObject
) -> None:
    chart, place = Chart(machine), depths(machine)
    active = set(chart.begin())
    assert legal(active, machine.states)
    for _ in range(data.draw(st.integers(1, 12))):
        possible = [each for each in machine.transitions if each.source in active]
        choices: list[str | Transition] = [*EVENTS, *possible]
        what = data.draw(st.sampled_from(choices))
        taken = [what] if isinstance(what, Transition) else chart.chosen(active, what)
        step = chart.step(active, taken)
        assert [*step.left] == sorted(step.left, key=place.__getitem__, reverse=True)
        assert [*step.entered] == sorted(step.entered, key=place.__getitem__)
        assert set(step.left) <= active
        assert not set(step.entered) & (active - set(step.left)), "entered without having been left"
        active = active - set(step.left) | set(step.entered)
        assert legal(active, machine.states)
        assert {each.target for each in taken} <= active


@given(machines())
def test_a_transition_does_not_exit_states_that_contain_both_its_ends(machine: StateMachine) -> None:
    chart, place = Chart(machine), depths(machine)
    active = set(chart.begin())
    for transition in (each for each in machine.transitions if each.source in active):
        ends = place[transition.source], place[transition.target]
        step = chart.step(active, [transition])
        around = {
            state.name for state in machine.every_state() if not state.parallel and all(
                len(place[state.name]) < len(end) and end[: len(place[state.name])] == place[state.name] for end in ends
            )
        }  # fmt: skip
        assert not around & {*step.left, *step.entered}
