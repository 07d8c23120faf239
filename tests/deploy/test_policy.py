"""Histories: what happened, and what the supervisor does about it."""

from __future__ import annotations

import signal
from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.policy import (
    Action,
    Event,
    Exited,
    Finish,
    GraceOver,
    Kill,
    Left,
    Ready,
    Start,
    State,
    Stop,
    StopRequested,
    Supervisor,
)

LIDAR, FOLLOW, SPEECH = ("lidar", ()), ("follow", ("lidar",)), ("speech", ())
TERM = -int(signal.SIGTERM)


def replay(
    *events: Event,
    network: tuple[tuple[str, tuple[str, ...]], ...] = (LIDAR, FOLLOW),
    until: str | None = None,
    needs: Mapping[str, tuple[str, ...]] | None = None,
    instances: Mapping[str, tuple[str, ...]] | None = None,
) -> list[list[Action]]:
    supervisor = Supervisor(network, until, needs, instances)
    return [supervisor.begin(), *(supervisor.handle(event) for event in events)]


def test_what_depends_on_others_starts_when_they_are_ready() -> None:
    assert replay(Ready("lidar"), Ready("follow")) == [[Start("lidar")], [Start("follow")], []]


def test_what_depends_on_nobody_starts_at_once() -> None:
    assert replay(network=(LIDAR, FOLLOW, SPEECH)) == [[Start("lidar"), Start("speech")]]


def test_asked_to_stop_it_goes_backwards() -> None:
    history = replay(Ready("lidar"), Ready("follow"), StopRequested(), Exited("follow", TERM), Exited("lidar", 0))
    assert history == [[Start("lidar")], [Start("follow")], [], [Stop("follow")], [Stop("lidar")], [Finish(0)]]


def test_the_code_of_who_asked_is_the_exit_code_if_all_else_is_fine() -> None:
    assert replay(Ready("lidar"), StopRequested(130), Exited("lidar", 143), network=(LIDAR,))[-1] == [Finish(130)]


def test_a_process_that_does_not_stop_is_killed_and_counts_as_failed() -> None:
    history = replay(StopRequested(), GraceOver("lidar"), Exited("lidar", -9), network=(LIDAR,))
    assert history == [[Start("lidar")], [Stop("lidar")], [Kill("lidar")], [Finish(1)]]


def test_grace_means_nothing_to_a_process_that_has_gone() -> None:
    assert replay(StopRequested(), Exited("lidar", 0), GraceOver("lidar"), network=(LIDAR,))[-1] == []


def test_out_of_patience_everything_is_killed() -> None:
    history = replay(Ready("lidar"), Ready("follow"), StopRequested(130), StopRequested(130))
    assert history[-1] == [Kill("follow"), Kill("lidar")]


def test_what_was_killed_out_of_patience_has_not_failed() -> None:
    history = replay(Ready("lidar"), StopRequested(130), StopRequested(130), Exited("lidar", -9), network=(LIDAR,))
    assert history[-1] == [Finish(130)]


def test_a_time_that_is_over_while_it_stops_already_kills_nobody() -> None:
    history = replay(Ready("lidar"), StopRequested(130), StopRequested(0), Exited("lidar", 0), network=(LIDAR,))
    assert history[2:] == [[Stop("lidar")], [], [Finish(130)]]


def test_nothing_starts_once_stopping_has_begun() -> None:
    history = replay(StopRequested(), Ready("lidar"), Exited("lidar", 0))
    assert history == [[Start("lidar")], [Stop("lidar")], [], [Finish(0)]]


def test_a_death_before_it_was_ready_stops_the_network() -> None:
    history = replay(Exited("speech", 1), Exited("lidar", TERM), network=(LIDAR, FOLLOW, SPEECH))
    assert history == [[Start("lidar"), Start("speech")], [Stop("lidar")], [Finish(1)]]


def test_a_death_of_one_that_was_ready_stops_a_network_that_is_still_starting() -> None:
    history = replay(Ready("speech"), Exited("speech", 1), Exited("lidar", TERM), network=(LIDAR, SPEECH))
    assert history[2:] == [[Stop("lidar")], [Finish(1)]]


def test_who_ends_well_while_others_start_stops_the_network_only_if_one_of_them_needs_it() -> None:
    events = Ready("speech"), Exited("speech", 0), Ready("lidar"), StopRequested(130), Exited("lidar", 0)
    alone = replay(*events, network=(LIDAR, SPEECH))
    assert alone[2:] == [[], [], [Stop("lidar")], [Finish(130)]]
    needed = replay(*events[:2], Exited("lidar", 0), network=(LIDAR, SPEECH), needs={"lidar": ("speech",)})
    assert needed[2:] == [[Stop("lidar")], [Finish(1)]]


def test_what_has_done_its_work_lets_those_after_it_start() -> None:
    after_both = ("follow", ("lidar", "speech"))
    history = replay(Ready("speech"), Exited("speech", 0), Ready("lidar"), network=(LIDAR, SPEECH, after_both))
    assert history[-1] == [Start("follow")]


def test_after_a_later_death_the_others_go_on_and_the_exit_code_tells() -> None:
    history = replay(
        Ready("lidar"), Ready("speech"), Exited("speech", 3), StopRequested(130), Exited("lidar", 0),
        network=(LIDAR, SPEECH),
    )  # fmt: skip
    assert history[3:] == [[], [Stop("lidar")], [Finish(1)]]


def test_when_all_have_ended_by_themselves_it_is_over() -> None:
    history = replay(Ready("lidar"), Ready("speech"), Exited("speech", 0), Exited("lidar", 0), network=(LIDAR, SPEECH))
    assert history[-1] == [Finish(0)]


def test_what_cannot_start_any_more_stops_the_network() -> None:
    history = replay(Exited("lidar", 0), Exited("speech", 0), network=(LIDAR, FOLLOW, SPEECH))
    assert history == [[Start("lidar"), Start("speech")], [Stop("speech")], [Finish(1)]]


def test_the_end_of_the_mission_is_the_end_of_the_network() -> None:
    history = replay(
        Ready("lidar"),
        Ready("speech"),
        Exited("speech", 0),
        Exited("lidar", 0),
        network=(LIDAR, SPEECH),
        until="speech",
    )
    assert history[3:] == [[Stop("lidar")], [Finish(0)]]
    failed = replay(
        Ready("lidar"),
        Ready("speech"),
        Exited("speech", 1),
        Exited("lidar", 0),
        network=(LIDAR, SPEECH),
        until="speech",
    )
    assert failed[-1] == [Finish(1)]


BODY: dict[str, tuple[str, ...]] = {"lidar": ("front", "rear")}
"""Two instances in the first process."""


def test_the_mission_may_share_a_process_that_goes_on_without_it() -> None:
    up = Ready("lidar"), Ready("follow")
    history = replay(*up, Left("rear"), Exited("follow", 0), Exited("lidar", 0), until="rear", instances=BODY)
    assert history[3:] == [[Stop("follow")], [Stop("lidar")], [Finish(0)]]
    assert replay(*up, Left("front"), until="rear", instances=BODY)[-1] == []


def test_the_end_of_its_process_is_the_end_of_the_mission_too() -> None:
    history = replay(Ready("lidar"), Ready("follow"), Exited("lidar", -9), until="rear", instances=BODY)
    assert history[-1] == [Stop("follow")]


def test_who_leaves_a_process_while_one_that_needs_it_starts_stops_the_network() -> None:
    needs: dict[str, tuple[str, ...]] = {"speech": ("rear",)}
    network = (LIDAR, SPEECH)
    assert replay(Left("front"), network=network, needs=needs, instances=BODY)[-1] == []
    assert replay(Left("rear"), network=network, needs=needs, instances=BODY)[-1] == [Stop("speech"), Stop("lidar")]
    ended = replay(Ready("lidar"), Exited("lidar", 0), network=network, needs=needs, instances=BODY)
    assert ended[-1] == [Stop("speech")]


def test_up_means_that_all_are_ready() -> None:
    supervisor = Supervisor((LIDAR, SPEECH))
    supervisor.begin()
    supervisor.handle(Ready("lidar"))
    assert not supervisor.up
    supervisor.handle(Ready("speech"))
    assert supervisor.up
    supervisor.handle(Exited("speech", 1))
    assert supervisor.up, "it stays a network that came up"


def test_what_has_done_its_work_does_not_keep_a_network_from_being_up() -> None:
    supervisor = Supervisor((LIDAR, SPEECH))
    supervisor.begin()
    for event in (Ready("speech"), Exited("speech", 0), Ready("lidar")):
        supervisor.handle(event)
    assert supervisor.up


names = st.sampled_from(["lidar", "follow", "speech"])
events = st.one_of(
    st.builds(Ready, names),
    st.builds(Exited, names, st.sampled_from([0, 1, TERM, -9])),
    st.builds(StopRequested, st.sampled_from([0, 130])),
    st.builds(GraceOver, names),
    st.builds(Left, st.sampled_from(["front", "rear"])),
)


@given(st.lists(events, max_size=40))
def test_whatever_happens_nobody_is_left_running_after_finish(history: list[Event]) -> None:
    """Events are played as the shell would: nobody exits who was not started, and the dead are silent."""
    supervisor = Supervisor((LIDAR, FOLLOW, SPEECH), "rear", {"speech": ["front"]}, BODY)
    running: set[str] = set()
    finished = False

    def act(actions: list[Action]) -> None:
        nonlocal finished
        for action in actions:
            assert not finished, "something was done after the end"
            match action:
                case Start(name):
                    assert name not in running
                    running.add(name)
                case Finish():
                    finished = True
                    assert not running
                case Stop(name) | Kill(name):
                    assert name in running

    act(supervisor.begin())
    for event in [*history, StopRequested(), StopRequested()]:
        speaker = "lidar" if isinstance(event, Left) else "" if isinstance(event, StopRequested) else event.name
        if not speaker or speaker in running:
            if isinstance(event, Exited):
                running.discard(event.name)
            act(supervisor.handle(event))
    for name in sorted(running):
        running.discard(name)
        act(supervisor.handle(Exited(name, -9)))
    assert finished
    assert all(state.gone for state in supervisor.states.values())
    assert not any(state is State.READY for state in supervisor.states.values())
