"""The table of a component's life, and its beat."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.runtime.clock import SECOND, ns
from robocomp_py.runtime.lifecycle import TRANSITIONS, Beat, Event, State, after


def replay(*events: Event) -> State:
    state = State.STARTING
    for event in events:
        state = after(state, event)
    return state


@pytest.mark.parametrize(
    ("events", "state"),
    [
        ((), State.STARTING),
        ((Event.CONNECTED,), State.INITIALIZE),
        ((Event.CONNECTED, Event.DONE), State.COMPUTE),
        ((Event.CONNECTED, Event.DONE, Event.ALARM), State.EMERGENCY),
        ((Event.CONNECTED, Event.DONE, Event.ALARM, Event.RECOVERED), State.RESTORE),
        ((Event.CONNECTED, Event.DONE, Event.ALARM, Event.RECOVERED, Event.DONE), State.COMPUTE),
        ((Event.CONNECTED, Event.DONE, Event.STOP), State.FINISH),
        ((Event.CONNECTED, Event.DONE, Event.STOP, Event.DONE), State.ENDED),
        ((Event.STOP,), State.ENDED),
        ((Event.CONNECTED, Event.STOP), State.FINISH),
    ],
)
def test_a_life_goes_as_drawn(events: tuple[Event, ...], state: State) -> None:
    assert replay(*events) is state


def test_an_event_that_means_nothing_changes_nothing() -> None:
    for state, event in product(State, Event):
        if (state, event) not in TRANSITIONS:
            assert after(state, event) is state


def test_every_state_but_the_last_can_be_left_and_every_life_can_be_ended() -> None:
    for state in State:
        if state is not State.ENDED:
            assert after(after(state, Event.STOP), Event.DONE) is State.ENDED


@given(st.lists(st.sampled_from(Event)))
def test_no_history_leads_back_from_the_end(events: list[Event]) -> None:
    states = [State.STARTING]
    for event in events:
        states.append(after(states[-1], event))
    if State.ENDED in states:
        assert set(states[states.index(State.ENDED) :]) == {State.ENDED}


def test_beats_do_not_drift() -> None:
    beat, now = Beat(0.1, 0), 0
    begun = []
    for _ in range(100):
        now = beat.due(now)
        begun.append(now)
        beat.begun()
        now += ns(0.037)  # what is done takes a while, but less than a period
        beat.done(now)
    assert begun == [n * SECOND // 10 for n in range(100)]
    assert beat.overruns == 0


def test_missed_beats_are_counted_and_not_made_up_for() -> None:
    beat = Beat(0.1, 0)
    assert beat.due(0) == 0
    beat.begun()
    beat.done(ns(0.25))  # the beats at 0.1 and 0.2 passed meanwhile
    assert beat.overruns == 2
    assert beat.due(ns(0.25)) == ns(0.3)
    beat.begun()
    beat.done(ns(0.31))
    assert beat.due(ns(0.31)) == ns(0.4)
    assert beat.overruns == 2


@given(st.lists(st.integers(0, SECOND), max_size=50))
def test_beats_stay_on_their_grid_whatever_takes_how_long(durations: list[int]) -> None:
    beat, now = Beat(0.25, 0), 0
    for duration in durations:
        now = beat.due(now)
        assert now % ns(0.25) == 0
        beat.begun()
        now += duration
        beat.done(now)
        assert beat.due(now) <= now + ns(0.25)


def test_a_period_that_is_changed_during_a_beat_holds_from_that_beat_on() -> None:
    beat = Beat(0.1, 0)
    beat.begun()
    beat.period = 0.4
    beat.done(ns(0.05))
    assert beat.due(ns(0.05)) == ns(0.4)
