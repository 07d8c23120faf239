"""Histories: what happened, and what the supervisor does about it."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.events import (
    Action,
    Along,
    Back,
    EndRequested,
    Event,
    Exited,
    Finish,
    GaveUp,
    Hung,
    Kill,
    Left,
    Lost,
    Ready,
    RestartRequested,
    Retry,
    Start,
    Stop,
    StopRequested,
    Stuck,
    Tick,
)
from robocomp_py.deploy.policy import UNKILLABLE, Child, Escalation, Restart, State, Supervisor, When

LIDAR, FOLLOW, SPEECH = Child("lidar"), Child("follow", after=("lidar",)), Child("speech")
TERM = -int(signal.SIGTERM)

Step = Event | tuple[float, Event]
"""What happens, and when; without a time, when the step before does."""


def replay(
    *steps: Step,
    network: tuple[Child, ...] = (LIDAR, FOLLOW),
    until: str | None = None,
    escalations: Mapping[tuple[str, ...], Escalation] | None = None,
) -> list[list[Action]]:
    supervisor = Supervisor(network, until, escalations)
    now, actions = 0.0, [supervisor.begin()]
    for step in steps:
        now, event = step if isinstance(step, tuple) else (now, step)
        actions.append(supervisor.handle(event, now))
    return actions


def deeds(history: list[list[Action]]) -> list[list[Action]]:
    """What is done, without what is only told."""
    return [[each for each in actions if not isinstance(each, Retry | GaveUp | Along | Stuck)] for actions in history]


# Starting and stopping.


def test_what_depends_on_others_starts_when_they_are_ready() -> None:
    assert replay(Ready("lidar"), Ready("follow")) == [[Start("lidar")], [Start("follow")], []]


def test_instances_without_dependences_start_at_once() -> None:
    assert replay(network=(LIDAR, FOLLOW, SPEECH)) == [[Start("lidar"), Start("speech")]]


def test_asked_to_stop_it_goes_backwards() -> None:
    history = replay(Ready("lidar"), Ready("follow"), StopRequested(), Exited("follow", TERM), Exited("lidar", 0))
    assert history == [[Start("lidar")], [Start("follow")], [], [Stop("follow")], [Stop("lidar")], [Finish(0)]]


def test_the_requested_exit_code_is_used_if_nothing_failed() -> None:
    assert replay(Ready("lidar"), StopRequested(130), Exited("lidar", 143), network=(LIDAR,))[-1] == [Finish(130)]


def test_a_process_that_does_not_stop_is_killed_and_counts_as_failed() -> None:
    history = replay(StopRequested(), (4.9, Tick()), (5.0, Tick()), Exited("lidar", -9), network=(LIDAR,))
    assert history == [[Start("lidar")], [Stop("lidar")], [], [Kill("lidar")], [Finish(1)]]


def test_the_time_that_rcdeploy_was_stopped_itself_kills_no_process() -> None:
    steps = (60.0, Tick()), (64.9, Tick()), (65.0, Tick()), (200.0, Tick()), (210.0, Tick())
    history = replay(StopRequested(), *steps, network=(LIDAR,))
    assert history[1:] == [[Stop("lidar")], [], [], [Kill("lidar")], [], [Stuck("lidar"), Finish(1)]]


def test_what_is_stopped_before_it_was_ready_may_fail_for_lack_of_what_is_stopped_with_it() -> None:
    def code(*history: Step) -> Action:
        return replay(*history, network=(LIDAR,))[-1][-1]

    stop = StopRequested(130)
    assert code(stop, Exited("lidar", 1)) == Finish(130)
    assert code(Ready("lidar"), stop, Exited("lidar", 1)) == Finish(1)
    for crashed in (-11, 139):
        assert code(stop, Exited("lidar", crashed)) == Finish(1)
    assert code(stop, (5.0, Tick()), Exited("lidar", 1)) == Finish(1)


def test_each_process_has_a_grace_of_its_own() -> None:
    slow = Child("arm", grace=12.0)
    history = replay(StopRequested(), (5.0, Tick()), (12.0, Tick()), network=(LIDAR, slow))
    assert history[1:] == [[Stop("arm"), Stop("lidar")], [Kill("lidar")], [Kill("arm")]]


def test_a_stop_request_can_set_the_grace_period() -> None:
    history = replay(StopRequested(grace=1.0), (1.0, Tick()), network=(LIDAR,))
    assert history[1:] == [[Stop("lidar")], [Kill("lidar")]]
    later = replay(StopRequested(), StopRequested(grace=1.0), (1.0, Tick()), network=(LIDAR,))
    assert later[1:] == [[Stop("lidar")], [], [Kill("lidar")]]


def test_grace_means_nothing_to_a_process_that_has_gone() -> None:
    assert replay(StopRequested(), Exited("lidar", 0), (5.0, Tick()), network=(LIDAR,))[-1] == []


def test_out_of_patience_everything_is_killed() -> None:
    history = replay(Ready("lidar"), Ready("follow"), StopRequested(130), StopRequested(130, grace=0))
    assert history[-1] == [Kill("follow"), Kill("lidar")]


def test_what_was_killed_out_of_patience_has_not_failed() -> None:
    history = replay(StopRequested(130), StopRequested(130, grace=0), Exited("lidar", -9), network=(LIDAR,))
    assert history[-1] == [Finish(130)]


def test_asked_for_an_end_without_grace_everything_is_killed_at_once() -> None:
    history = replay(Ready("lidar"), Ready("follow"), StopRequested(grace=0), Exited("follow", -9), Exited("lidar", -9))
    assert history[3:] == [[Kill("follow"), Kill("lidar")], [], [Finish(0)]]


def test_a_second_stop_request_kills_no_process() -> None:
    history = replay(Ready("lidar"), StopRequested(143), StopRequested(129), Exited("lidar", 0), network=(LIDAR,))
    assert history[2:] == [[Stop("lidar")], [], [Finish(143)]]


def test_a_process_that_survives_kill_is_not_waited_for() -> None:
    times = 5.0, 5.0 + UNKILLABLE
    history = replay(StopRequested(), *((time, Tick()) for time in times), Exited("lidar", -9), network=(LIDAR,))
    assert history[1:] == [[Stop("lidar")], [Kill("lidar")], [Stuck("lidar"), Finish(1)], []]


def test_nothing_starts_once_stopping_has_begun() -> None:
    history = replay(StopRequested(), Ready("lidar"), RestartRequested(("lidar",)), Exited("lidar", 0))
    assert history == [[Start("lidar")], [Stop("lidar")], [], [], [Finish(0)]]


def test_a_death_before_it_was_ready_stops_the_network() -> None:
    history = replay(Exited("speech", 1), Exited("lidar", TERM), network=(LIDAR, FOLLOW, SPEECH))
    assert history == [[Start("lidar"), Start("speech")], [Stop("lidar")], [Finish(1)]]


def test_a_death_of_one_that_was_ready_stops_a_network_that_is_still_starting() -> None:
    history = replay(Ready("speech"), Exited("speech", 1), Exited("lidar", TERM), network=(LIDAR, SPEECH))
    assert history[2:] == [[Stop("lidar")], [Finish(1)]]


def test_a_normal_end_during_the_start_stops_the_network_only_if_the_process_is_needed() -> None:
    events = Ready("speech"), Exited("speech", 0), Ready("lidar"), StopRequested(130), Exited("lidar", 0)
    alone = replay(*events, network=(LIDAR, SPEECH))
    assert alone[2:] == [[], [], [Stop("lidar")], [Finish(130)]]
    needing = replace(LIDAR, needs=frozenset({"speech"}))
    needed = replay(*events[:2], Exited("lidar", 0), network=(needing, SPEECH))
    assert needed[2:] == [[Stop("lidar")], [Finish(1)]]


def test_what_has_done_its_work_lets_those_after_it_start() -> None:
    after_both = Child("follow", after=("lidar", "speech"))
    history = replay(Ready("speech"), Exited("speech", 0), Ready("lidar"), network=(LIDAR, SPEECH, after_both))
    assert history[-1] == [Start("follow")]


def test_after_a_later_death_the_others_go_on_and_the_exit_code_tells() -> None:
    events = Ready("lidar"), Ready("speech"), Exited("speech", 3), StopRequested(130), Exited("lidar", 0)
    history = replay(*events, network=(LIDAR, SPEECH))
    assert history[3:] == [[], [Stop("lidar")], [Finish(1)]]


def test_when_all_have_ended_by_themselves_it_is_over() -> None:
    history = replay(Ready("lidar"), Ready("speech"), Exited("speech", 0), Exited("lidar", 0), network=(LIDAR, SPEECH))
    assert history[-1] == [Finish(0)]


def test_what_cannot_start_any_more_stops_the_network() -> None:
    history = replay(Exited("lidar", 0), Exited("speech", 0), network=(LIDAR, FOLLOW, SPEECH))
    assert history == [[Start("lidar"), Start("speech")], [Stop("speech")], [Finish(1)]]


# Ends that are the end of all.


def test_the_end_of_the_mission_is_the_end_of_the_network() -> None:
    up = Ready("lidar"), Ready("speech")
    history = replay(*up, Exited("speech", 0), Exited("lidar", 0), network=(LIDAR, SPEECH), until="speech")
    assert history[3:] == [[Stop("lidar")], [Finish(0)]]
    failed = replay(*up, Exited("speech", 1), Exited("lidar", 0), network=(LIDAR, SPEECH), until="speech")
    assert failed[-1] == [Finish(1)]


BODY = Child("lidar", instances=("front", "rear"))
"""Two instances in a process."""


def test_the_mission_may_share_a_process_that_goes_on_without_it() -> None:
    network, up = (BODY, FOLLOW), (Ready("lidar"), Ready("follow"))
    history = replay(*up, Left("rear"), Exited("follow", 0), Exited("lidar", 0), network=network, until="rear")
    assert history[3:] == [[Stop("follow")], [Stop("lidar")], [Finish(0)]]
    assert replay(*up, Left("front"), network=network, until="rear")[-1] == []


def test_the_end_of_its_process_is_the_end_of_the_mission_too() -> None:
    history = replay(Ready("lidar"), Ready("follow"), Exited("lidar", -9), network=(BODY, FOLLOW), until="rear")
    assert history[-1] == [Stop("follow")]


def test_an_instance_that_ends_while_its_client_starts_stops_the_network() -> None:
    network = (BODY, replace(SPEECH, needs=frozenset({"rear"})))
    assert replay(Left("front"), network=network)[-1] == []
    assert replay(Left("rear"), network=network)[-1] == [Stop("speech"), Stop("lidar")]
    assert replay(Ready("lidar"), Exited("lidar", 0), network=network)[-1] == [Stop("speech")]


def test_a_mission_that_fails_is_tried_again_before_that_is_the_end() -> None:
    mission = replace(SPEECH, restart=Restart(When.ON_FAILURE, intensity=1))
    history = replay(
        Ready("lidar"), Ready("speech"), (9.0, Exited("speech", 1)), (9.2, Tick()), Exited("speech", 1),
        network=(LIDAR, mission), until="speech",
    )  # fmt: skip
    assert deeds(history)[3:] == [[], [Start("speech")], [Stop("lidar")]]


def test_a_mission_that_is_always_restarted_is_over_when_it_ends_well() -> None:
    mission = replace(SPEECH, restart=Restart(When.ALWAYS))
    history = replay(Ready("lidar"), Ready("speech"), Exited("speech", 0), network=(LIDAR, mission), until="speech")
    assert history[-1] == [Stop("lidar")]


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


# Starting again.

ON_FAILURE, ALWAYS = Restart(When.ON_FAILURE), Restart(When.ALWAYS)
TENACIOUS = replace(LIDAR, restart=ON_FAILURE)


@pytest.mark.parametrize(
    ("when", "code", "again"),
    [
        (When.NEVER, 1, False),
        (When.NEVER, 0, False),
        (When.ON_FAILURE, 1, True),
        (When.ON_FAILURE, -11, True),
        (When.ON_FAILURE, 0, False),
        (When.ALWAYS, 1, True),
        (When.ALWAYS, 0, True),
    ],
)
def test_after_which_end_it_is_started_again(when: When, code: int, again: bool) -> None:
    network = (Child("lidar", restart=Restart(when)), SPEECH)
    history = replay(Ready("lidar"), Ready("speech"), Exited("lidar", code), (0.2, Tick()), network=network)
    assert history[-1] == ([Start("lidar")] if again else [])


def test_a_failure_followed_by_a_successful_restart_is_not_a_failure() -> None:
    events = Ready("lidar"), Exited("lidar", 1), (0.2, Tick()), Ready("lidar"), StopRequested(), Exited("lidar", 0)
    assert replay(*events, network=(TENACIOUS,))[-1] == [Finish(0)]


def test_while_the_network_starts_it_is_tried_again_instead_of_giving_all_up() -> None:
    history = replay(Exited("lidar", 1), (0.2, Tick()), Ready("lidar"), network=(TENACIOUS, FOLLOW, SPEECH))
    assert deeds(history)[1:] == [[], [Start("lidar")], [Start("follow")]]


def test_given_up_while_the_network_starts_it_stops_the_network() -> None:
    once = replace(LIDAR, restart=Restart(When.ON_FAILURE, intensity=1))
    history = replay(Exited("lidar", 1), (0.2, Tick()), Exited("lidar", 1), network=(once, FOLLOW, SPEECH))
    assert history[-1] == [GaveUp("lidar", 1), Stop("speech")]


def crashes(*times: float, restart: Restart = ON_FAILURE, chance: float = 0.5) -> list[float]:
    """The delays of one that is ready when it has been started, and fails so many seconds later each time."""
    supervisor, now, delays = Supervisor((Child("lidar", restart=restart),)), 0.0, []
    supervisor.begin()
    for seconds in times:
        supervisor.handle(Ready("lidar"), now)
        now += seconds
        actions = supervisor.handle(Exited("lidar", 1), now, chance)
        delays += [action.seconds for action in actions if isinstance(action, Retry)]
        if supervisor.wake is None:
            return delays
        now = supervisor.wake
        assert supervisor.handle(Tick(), now) == [Start("lidar")]
    return delays


def test_each_delay_is_twice_as_long_up_to_a_limit() -> None:
    endless = Restart(When.ON_FAILURE, intensity=99, delay=0.2, max_delay=3.0)
    assert crashes(*[0.0] * 7, restart=endless) == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.0, 3.0, 3.0])


def test_delays_are_a_little_more_or_less_and_never_above_the_limit() -> None:
    endless = Restart(When.ON_FAILURE, intensity=99, delay=1.0, max_delay=2.0)
    assert crashes(*[0.0] * 3, restart=endless, chance=0.0) == pytest.approx([0.8, 1.6, 1.6])
    assert crashes(*[0.0] * 3, restart=endless, chance=1.0) == pytest.approx([1.2, 2.0, 2.0])


def test_after_so_many_restarts_within_the_period_it_is_given_up() -> None:
    assert len(crashes(*[0.0] * 9)) == 5
    steady = replace(ON_FAILURE, max_delay=0.2)
    assert len(crashes(*[11.0] * 9, restart=steady)) == 5
    assert len(crashes(*[13.0] * 9, restart=steady)) == 9


def test_up_for_a_while_it_begins_with_the_first_delay_again() -> None:
    assert crashes(0.0, 0.0, 59.0, 60.0, 0.0) == pytest.approx([0.2, 0.4, 0.8, 0.2, 0.4])


def test_a_period_shorter_than_the_longest_delay_does_not_make_a_storm() -> None:
    hasty = Restart(When.ON_FAILURE, intensity=5, period=1.0)
    assert crashes(*[2.0] * 4, restart=hasty) == pytest.approx([0.2, 0.4, 0.8, 1.6])


def test_no_intensity_is_no_restart() -> None:
    assert crashes(0.0, restart=Restart(When.ON_FAILURE, intensity=0)) == []


def test_a_process_given_up_later_fails_the_exit_code_while_others_run_on() -> None:
    once = replace(LIDAR, restart=Restart(When.ON_FAILURE, intensity=1))
    history = replay(
        Ready("lidar"), Ready("speech"), Exited("lidar", 1), (0.2, Tick()), Exited("lidar", 1), (99.0, Tick()),
        StopRequested(130), Exited("speech", 0), network=(once, SPEECH),
    )  # fmt: skip
    assert history[5:] == [[GaveUp("lidar", 1)], [], [Stop("speech")], [Finish(1)]]


def test_a_process_that_ends_well_too_often_is_given_up() -> None:
    once = replace(LIDAR, restart=Restart(When.ALWAYS, intensity=1))
    history = replay(Ready("lidar"), Exited("lidar", 0), (0.2, Tick()), Exited("lidar", 0), network=(once,))
    assert history[-1] == [GaveUp("lidar", 1), Finish(1)]


def test_a_pending_restart_keeps_the_network_running() -> None:
    history = replay(Ready("lidar"), Exited("lidar", 1), network=(TENACIOUS,))
    assert history[-1] == [Retry("lidar", 0.2)]


def test_no_pending_restart_survives_the_beginning_of_the_end() -> None:
    history = replay(Ready("lidar"), Exited("lidar", 1), StopRequested(), (9.0, Tick()), network=(TENACIOUS,))
    assert history[3:] == [[Finish(0)], []]


def test_a_restarted_process_waits_for_its_restarted_dependency() -> None:
    follow = replace(FOLLOW, restart=ON_FAILURE)
    history = replay(
        Ready("lidar"), Ready("follow"), Exited("lidar", 1), Exited("follow", 1), (0.2, Tick()), (3.0, Ready("lidar")),
        network=(TENACIOUS, follow),
    )  # fmt: skip
    assert deeds(history)[3:] == [[], [], [Start("lidar")], [Start("follow")]]


def test_a_process_that_waits_for_a_lost_dependency_does_not_keep_the_network_alive() -> None:
    follow = replace(FOLLOW, restart=ON_FAILURE)
    history = replay(
        Ready("lidar"), Ready("follow"), Exited("lidar", 1), Exited("follow", 1), (0.2, Tick()), network=(LIDAR, follow)
    )
    assert history[-1] == [Finish(1)]


# Those that hang.


def test_a_process_that_hangs_has_failed_whatever_its_exit_code() -> None:
    history = replay(Ready("lidar"), Hung("lidar"), Exited("lidar", 0), (0.2, Tick()), network=(TENACIOUS,))
    assert deeds(history)[2:] == [[], [], [Start("lidar")]]


def test_no_process_starts_after_one_that_hangs() -> None:
    assert replay(Hung("lidar"), Ready("lidar"))[1:] == [[], []]


def test_a_process_that_hangs_is_stopped_like_the_others() -> None:
    history = replay(Ready("lidar"), Hung("lidar"), StopRequested(), (5.0, Tick()), network=(LIDAR,))
    assert history[3:] == [[Stop("lidar")], [Kill("lidar")]]


# Those that go together.

A, B, C = (Child(name, restart=ON_FAILURE) for name in "abc")
ABC = (A, B, C)
UP: tuple[Event, ...] = tuple(map(Ready, "abc"))


def group(escalation: Escalation, *steps: Step, network: tuple[Child, ...] = ABC) -> list[list[Action]]:
    """What comes after all are up."""
    up = tuple(Ready(each.name) for each in network)
    return replay(*up, *steps, network=network, escalations={(): escalation})[1 + len(up) :]


def test_one_for_one_restarts_the_failed_process() -> None:
    history = group(Escalation.ONE_FOR_ONE, Exited("b", 1), (0.2, Tick()))
    assert history == [[Retry("b", 0.2)], [Start("b")]]


def test_rest_for_one_starts_again_those_after_it_too() -> None:
    history = group(Escalation.REST_FOR_ONE, Exited("b", 1), Exited("c", TERM), (0.2, Tick()))
    along = Along(("c",), "b", again=True)
    assert history == [[Retry("b", 0.2), along, Stop("c")], [], [Start("b"), Start("c")]]


def test_one_for_all_starts_all_again() -> None:
    history = group(Escalation.ONE_FOR_ALL, Exited("b", 1), Exited("c", TERM), Exited("a", TERM), (0.2, Tick()))
    along = Along(("a", "c"), "b", again=True)
    assert history == [
        [Retry("b", 0.2), along, Stop("c"), Stop("a")],
        [],
        [],
        [Start("a"), Start("b"), Start("c")],
    ]


def test_a_group_restarts_only_after_all_its_processes_have_ended() -> None:
    history = group(Escalation.ONE_FOR_ALL, Exited("b", 1), Exited("a", 0), (3.0, Tick()), Exited("c", 0))
    assert deeds(history)[1:] == [[], [], [Start("a"), Start("b"), Start("c")]]


CHAIN = (A, replace(B, after=("a",)), replace(C, after=("b",)))


def test_processes_that_restart_together_stop_and_start_in_their_order() -> None:
    history = group(
        Escalation.ONE_FOR_ALL, Exited("a", 1), Exited("c", TERM), Exited("b", TERM), (0.2, Tick()), Ready("a"),
        Ready("b"), network=CHAIN,
    )  # fmt: skip
    assert deeds(history) == [[Stop("c")], [Stop("b")], [], [Start("a")], [Start("b")], [Start("c")]]


def test_a_process_killed_for_its_restart_has_not_failed() -> None:
    history = group(
        Escalation.REST_FOR_ONE, Exited("a", 1), (5.0, Tick()), Exited("b", -9), StopRequested(), network=(A, B)
    )
    assert deeds(history) == [[Stop("b")], [Kill("b")], [Start("a"), Start("b")], [Stop("b"), Stop("a")]]
    assert replay(*UP[:2], StopRequested(), Exited("b", 0), Exited("a", 0), network=(A, B))[-1] == [Finish(0)]


def test_a_process_is_killed_at_every_restart_that_it_does_not_stop_for() -> None:
    asked = RestartRequested(("a",))
    history = replay(Ready("a"), asked, (5.0, Tick()), Exited("a", -9), Ready("a"), asked, (10.0, Tick()), network=(A,))
    assert history[2:] == [[Stop("a")], [Kill("a")], [Start("a")], [], [Stop("a")], [Kill("a")]]


def test_what_cannot_be_killed_is_not_started_again_and_keeps_no_other_from_it() -> None:
    events = (
        Exited("a", 1),
        (5.0, Tick()),
        (5.0 + UNKILLABLE, Tick()),
        Ready("a"),
        (50.0, Exited("a", 1)),
        (51.0, Tick()),
    )
    history = group(Escalation.ONE_FOR_ALL, *events, Exited("b", -9), RestartRequested(("b",)), network=(A, B))
    assert deeds(history) == [[Stop("b")], [Kill("b")], [Start("a")], [], [], [Start("a")], [], [Stop("a")]]
    assert history[2] == [Stuck("b"), Start("a")]


def test_what_was_killed_and_is_gone_at_last_can_be_started_by_a_user() -> None:
    events = (
        RestartRequested(("b",)),
        (5.0, Tick()),
        (5.0 + UNKILLABLE, Tick()),
        Exited("b", -9),
        RestartRequested(("b",)),
    )
    assert deeds(group(Escalation.ONE_FOR_ONE, *events, network=(A, B)))[2:] == [[], [], [Start("b")]]


def test_a_failure_while_stopping_does_not_count_as_a_restart() -> None:
    stubborn = Restart(When.ON_FAILURE, intensity=0)
    network = (A, replace(B, after=("a",), restart=stubborn), replace(C, after=("b",)))
    history = group(
        Escalation.ONE_FOR_ALL, Exited("a", 1), Exited("b", 1), Exited("c", 0), (0.2, Tick()), network=network
    )
    assert deeds(history) == [[Stop("c")], [], [], [Start("a")]]


def test_another_end_while_they_start_again_starts_them_all_again() -> None:
    history = group(
        Escalation.ONE_FOR_ALL, Exited("a", 1), Exited("b", 0), (0.2, Tick()), Exited("b", 1), Exited("a", TERM),
        (9.0, Tick()), network=(A, B),
    )  # fmt: skip
    assert deeds(history) == [[Stop("b")], [], [Start("a"), Start("b")], [Stop("a")], [], [Start("a"), Start("b")]]


def test_a_process_that_is_never_restarted_for_its_own_end_restarts_with_the_others() -> None:
    network = (A, Child("b"))
    along = group(Escalation.ONE_FOR_ALL, Exited("a", 1), Exited("b", 0), (0.2, Tick()), network=network)
    assert along[-1] == [Start("a"), Start("b")]
    for code in (0, 1):
        ended = group(Escalation.ONE_FOR_ALL, Exited("b", code), Exited("a", 1), (0.2, Tick()), network=network)
        assert deeds(ended) == [[], [], [Start("a")]]


def test_what_had_done_its_work_does_it_again_for_those_it_goes_together_with() -> None:
    history = group(Escalation.ONE_FOR_ALL, Exited("a", 0), Exited("b", 1), (0.2, Tick()), network=(A, B))
    assert deeds(history) == [[], [], [Start("a"), Start("b")]]


def test_given_up_one_takes_those_along_that_are_of_no_use_without_it() -> None:
    hopeless = replace(B, restart=Restart(When.ON_FAILURE, intensity=0))
    network = (A, hopeless, C)
    one = group(Escalation.ONE_FOR_ONE, Exited("b", 1), network=network)
    assert one == [[GaveUp("b", 0)]]
    rest = group(
        Escalation.REST_FOR_ONE, Exited("b", 1), Exited("c", 0), StopRequested(), Exited("a", 0), network=network
    )
    assert rest == [[GaveUp("b", 0), Along(("c",), "b", again=False), Stop("c")], [], [Stop("a")], [Finish(1)]]
    everybody = group(Escalation.ONE_FOR_ALL, Exited("b", 1), Exited("c", 0), Exited("a", 0), network=network)
    assert everybody == [[GaveUp("b", 0), Stop("c"), Stop("a")], [], [Finish(1)]]


def test_a_mission_that_is_of_no_use_any_more_is_the_end_of_the_network() -> None:
    hopeless = replace(B, restart=Restart(When.ON_FAILURE, intensity=0))
    escalations: dict[tuple[str, ...], Escalation] = {(): Escalation.REST_FOR_ONE}
    history = replay(*UP, Exited("b", 1), network=(A, hopeless, C), until="c", escalations=escalations)
    assert history[-1] == [GaveUp("b", 0), Stop("c"), Stop("a")]


def test_a_process_dropped_with_one_given_up_is_not_revived_by_another_restart() -> None:
    hopeless = replace(B, restart=Restart(When.ON_FAILURE, intensity=0))
    history = group(
        Escalation.REST_FOR_ONE, Exited("b", 1), Exited("c", 0), Exited("a", 1), (0.2, Tick()), network=(A, hopeless, C)
    )
    assert deeds(history)[-1] == [Start("a")]


ARM, WRIST, BASE = (
    Child("left/arm", system=("left",), restart=ON_FAILURE),
    Child("left/hand/wrist", system=("left", "hand"), restart=ON_FAILURE),
    Child("base", restart=ON_FAILURE),
)
ROBOT = (ARM, WRIST, BASE)
ALL_UP = tuple(Ready(each.name) for each in ROBOT)
ONE_FOR_ALL = Escalation.ONE_FOR_ALL


def test_escalation_stays_within_its_system() -> None:
    history = replay(*ALL_UP, Exited("left/arm", 1), network=ROBOT, escalations={("left",): ONE_FOR_ALL})
    assert deeds(history)[-1] == [Stop("left/hand/wrist")]
    inner = replay(*ALL_UP, Exited("left/hand/wrist", 1), network=ROBOT, escalations={("left",): ONE_FOR_ALL})
    assert deeds(inner)[-1] == [], "its own system says one_for_one"


def test_a_system_of_which_one_is_given_up_is_given_up_by_the_system_around_it() -> None:
    hopeless = replace(WRIST, restart=Restart(When.ON_FAILURE, intensity=0))
    network = (ARM, hopeless, BASE)
    inner = {("left", "hand"): ONE_FOR_ALL, ("left",): ONE_FOR_ALL}
    history = replay(*ALL_UP, Exited("left/hand/wrist", 1), network=network, escalations=inner)
    assert deeds(history)[-1] == [Stop("left/arm")]
    alone = replay(*ALL_UP, Exited("left/hand/wrist", 1), network=network, escalations={("left",): ONE_FOR_ALL})
    assert deeds(alone)[-1] == [], "the system of the wrist can do without it"
    whole = replay(*ALL_UP, Exited("left/hand/wrist", 1), network=network, escalations={**inner, (): ONE_FOR_ALL})
    assert deeds(whole)[-1] == [Stop("base"), Stop("left/arm")]


# What users ask for.


def test_a_user_has_one_started_again_at_once() -> None:
    history = replay(*UP, RestartRequested(("b",)), (1.0, Exited("b", 1)), network=ABC)
    assert history[4:] == [[Stop("b")], [Start("b")]]


def test_a_restart_by_a_user_keeps_dependents_running() -> None:
    history = replay(Ready("lidar"), Ready("follow"), RestartRequested(("lidar",)), Exited("lidar", 0))
    assert history[3:] == [[Stop("lidar")], [Start("lidar")]]


def test_started_again_after_work_that_was_done_it_waits_for_that_to_be_done_again() -> None:
    follow = replace(FOLLOW, restart=ON_FAILURE)
    history = replay(
        Ready("lidar"), Exited("lidar", 0), Ready("follow"), RestartRequested(("lidar", "follow")), Exited("follow", 0),
        Ready("lidar"), network=(LIDAR, follow),
    )  # fmt: skip
    assert history[4:] == [[Stop("follow")], [Start("lidar")], [Start("follow")]]


def test_stopping_the_network_cancels_a_requested_restart() -> None:
    supervisor = Supervisor((LIDAR,))
    supervisor.begin()
    for event in (Ready("lidar"), RestartRequested(("lidar",)), StopRequested(), Exited("lidar", 0)):
        supervisor.handle(event)
    assert supervisor.states == {"lidar": State.ENDED}


def test_a_user_has_one_that_was_given_up_started_with_all_its_chances() -> None:
    once = replace(A, restart=Restart(When.ON_FAILURE, intensity=1))
    history = replay(
        *UP[:2], Exited("a", 1), (0.2, Tick()), Exited("a", 1), RestartRequested(("a",)), Exited("a", 1),
        network=(once, B),
    )  # fmt: skip
    assert history[5:] == [[GaveUp("a", 1)], [Start("a")], [Retry("a", 0.2)]]


def test_a_user_does_not_wait_for_a_delay() -> None:
    history = replay(
        Ready("lidar"), Exited("lidar", 1), RestartRequested(("lidar",)), (0.2, Tick()), network=(TENACIOUS,)
    )
    assert history[3:] == [[Start("lidar")], []]


def test_what_a_user_has_stopped_is_not_started_again_until_asked_for() -> None:
    always = replace(LIDAR, restart=Restart(When.ALWAYS))
    history = replay(
        Ready("lidar"), Ready("speech"), EndRequested(("lidar",)), Exited("lidar", TERM), (100.0, Tick()),
        RestartRequested(("lidar",)), network=(always, SPEECH),
    )  # fmt: skip
    assert history[3:] == [[Stop("lidar")], [], [], [Start("lidar")]]


def test_a_stop_by_a_user_cancels_a_pending_restart() -> None:
    history = replay(
        Ready("lidar"), Ready("speech"), Exited("lidar", 1), EndRequested(("lidar",)), (100.0, Tick()),
        network=(TENACIOUS, SPEECH),
    )  # fmt: skip
    assert deeds(history)[4:] == [[], []]


def test_what_a_user_has_stopped_stays_so_when_another_one_of_its_group_fails() -> None:
    history = group(
        Escalation.ONE_FOR_ALL, EndRequested(("c",)), Exited("c", TERM), Exited("a", 1), (1.0, Exited("b", 0))
    )
    assert Start("c") not in [each for actions in history for each in actions]


def test_a_stop_by_a_user_is_no_failure_of_the_network() -> None:
    history = replay(
        Ready("lidar"), Ready("speech"), EndRequested(("lidar",)), Exited("lidar", TERM), StopRequested(),
        Exited("speech", TERM), network=(LIDAR, SPEECH),
    )  # fmt: skip
    assert history[-1] == [Finish(0)]


def test_a_user_may_name_an_instance_or_a_system() -> None:
    shared = replay(Ready("lidar"), RestartRequested(("rear",)), network=(BODY,))
    assert shared[-1] == [Stop("lidar")]
    history = replay(*ALL_UP, RestartRequested(("left",)), network=ROBOT)
    assert history[-1] == [Stop("left/hand/wrist"), Stop("left/arm")]


def test_what_a_user_has_started_again_takes_along_what_goes_with_it() -> None:
    history = group(Escalation.REST_FOR_ONE, RestartRequested(("b",)))
    assert history == [[Along(("c",), "b", again=True), Stop("c"), Stop("b")]]


def test_a_user_revives_those_that_were_dropped_with_one_that_was_given_up() -> None:
    hopeless = replace(B, restart=Restart(When.ON_FAILURE, intensity=0))
    history = group(
        Escalation.REST_FOR_ONE, Exited("b", 1), RestartRequested(("b",)), Exited("c", 0), network=(A, hopeless, C)
    )
    assert deeds(history) == [[Stop("c")], [], [Start("b"), Start("c")]]


def test_a_user_may_have_one_started_that_ended_and_never_starts_again_by_itself() -> None:
    history = replay(
        Ready("lidar"), Ready("speech"), Exited("lidar", 0), RestartRequested(("lidar",)), network=(LIDAR, SPEECH)
    )
    assert history[-1] == [Start("lidar")]


def test_asked_for_twice_it_is_started_once() -> None:
    asked = RestartRequested(("b",))
    assert replay(*UP, asked, asked, Exited("b", 0), network=ABC)[4:] == [[Stop("b")], [], [Start("b")]]


def test_an_unknown_name_matches_no_process() -> None:
    assert Supervisor(ROBOT).find("lef") == []
    assert Supervisor(ROBOT).find("left/hand") == ["left/hand/wrist"]
    assert replay(RestartRequested(("nobody",)), network=(LIDAR,))[-1] == []


# Hosts.

FAR = Child("far", host="onboard", restart=ON_FAILURE)
NEAR = Child("near", restart=ON_FAILURE)
FAR_AND_NEAR = (FAR, NEAR)
BOTH = Ready("far"), Ready("near")


def test_what_was_lost_with_its_host_is_started_when_that_is_back() -> None:
    history = replay(*BOTH, Lost("onboard"), (99.0, Tick()), Back("onboard"), network=FAR_AND_NEAR)
    assert history[3:] == [[], [], [Start("far")]]


def test_a_host_that_is_lost_again_and_again_uses_up_no_restarts() -> None:
    flapping: list[Event] = [Lost("onboard"), Back("onboard"), Ready("far")] * 20
    assert replay(*BOTH, *flapping, network=FAR_AND_NEAR)[-2] == [Start("far")]


def test_what_is_never_started_again_has_failed_with_its_host() -> None:
    network = (replace(FAR, restart=Restart()), NEAR)
    history = replay(*BOTH, Lost("onboard"), Back("onboard"), StopRequested(), Exited("near", 0), network=network)
    assert history[3:] == [[], [], [Stop("near")], [Finish(3)]]
    starting = replay(Ready("near"), Lost("onboard"), network=network)
    assert starting[-1] == [Stop("near")], "the network cannot come up any more"


def test_what_its_host_keeps_is_found_there_again_even_if_it_is_never_started_again() -> None:
    network = (replace(FAR, restart=Restart(), is_kept=True), NEAR)
    history = replay(*BOTH, Lost("onboard"), Back("onboard"), network=network)
    assert history[3:] == [[], [Start("far")]]


def test_processes_kept_on_an_unreachable_host_restart_no_others() -> None:
    network = (replace(FAR, is_kept=True), NEAR)
    escalations: dict[tuple[str, ...], Escalation] = {(): Escalation.ONE_FOR_ALL}
    history = replay(*BOTH, Lost("onboard"), Back("onboard"), network=network, escalations=escalations)
    assert history[3:] == [[], [Start("far")]]


def test_stopped_without_one_of_its_hosts_a_network_was_not_stopped_completely() -> None:
    history = replay(*BOTH, Lost("onboard"), StopRequested(130), Exited("near", 0), network=FAR_AND_NEAR)
    assert history[3:] == [[], [Stop("near")], [Finish(3)]]
    meanwhile = replay(*BOTH, StopRequested(), Lost("onboard"), Exited("near", 0), network=FAR_AND_NEAR)
    assert meanwhile[-1] == [Finish(3)]


def test_nothing_starts_at_a_host_that_is_out_of_reach() -> None:
    history = replay(*BOTH, Exited("far", 1), Lost("onboard"), (9.0, Tick()), Back("onboard"), network=FAR_AND_NEAR)
    assert deeds(history)[3:] == [[], [], [], [Start("far")]]


def test_an_unreachable_host_keeps_the_network_running() -> None:
    history = replay(Ready("far"), Exited("far", 1), Lost("onboard"), (9.0, Tick()), Back("onboard"), network=(FAR,))
    assert deeds(history)[2:] == [[], [], [], [Start("far")]]


def test_what_was_to_be_stopped_for_good_does_not_come_back_with_its_host() -> None:
    hopeless = replace(A, restart=Restart(When.ON_FAILURE, intensity=0))
    history = group(
        Escalation.REST_FOR_ONE, Exited("a", 1), Lost("onboard"), Back("onboard"), network=(NEAR, hopeless, FAR)
    )
    assert deeds(history) == [[Stop("far")], [], []]


def test_what_goes_together_waits_for_a_host() -> None:
    escalations: dict[tuple[str, ...], Escalation] = {(): Escalation.ONE_FOR_ALL}
    events = Lost("onboard"), Exited("near", TERM), (9.0, Tick()), Back("onboard")
    history = replay(*BOTH, *events, network=FAR_AND_NEAR, escalations=escalations)
    assert deeds(history)[3:] == [[Stop("near")], [], [], [Start("far"), Start("near")]]


def test_what_was_said_of_a_process_that_is_lost_means_nothing() -> None:
    assert replay(*BOTH, Lost("onboard"), Exited("far", 127), Ready("far"), network=FAR_AND_NEAR)[3:] == [[], [], []]


# Whatever happens.

RESTARTS = st.builds(
    Restart,
    st.sampled_from(When),
    intensity=st.integers(0, 3),
    period=st.sampled_from([5.0, 60.0]),
    delay=st.sampled_from([0.0, 0.2, 4.0]),
    max_delay=st.sampled_from([0.2, 30.0]),
)
NAMES = ("lidar", "follow", "left/arm", "left/hand/wrist", "map")
SYSTEMS = {"left/arm": ("left",), "left/hand/wrist": ("left", "hand")}


@st.composite
def networks(draw: st.DrawFn) -> tuple[Child, ...]:
    found: list[Child] = []
    for name in NAMES:
        earlier = [each.name for each in found]
        after = draw(st.lists(st.sampled_from(earlier), unique=True)) if earlier else []
        host = draw(st.sampled_from(["", "onboard"]))
        instances = ("front", "rear") if name == "lidar" else ()
        child = Child(name, tuple(after), draw(RESTARTS), 5.0, SYSTEMS.get(name, ()), host, instances=instances)
        found.append(replace(child, is_kept=bool(host) and draw(st.booleans())))
    return tuple(found)


names = st.sampled_from(NAMES)
events = st.one_of(
    st.builds(Ready, names),
    st.builds(Exited, names, st.sampled_from([0, 1, TERM, -9])),
    st.builds(Hung, names),
    st.builds(Left, st.sampled_from(["front", "rear"])),
    st.builds(StopRequested, st.sampled_from([0, 130]), st.sampled_from([None, None, 1.0, 0.0])),
    st.builds(RestartRequested, st.lists(st.sampled_from([*NAMES, "left"]), min_size=1, max_size=2).map(tuple)),
    st.just(Lost("onboard")),
    st.just(Back("onboard")),
    st.just(Tick()),
)
likely = st.one_of(
    st.builds(Ready, names), st.builds(Ready, names), st.builds(Exited, names, st.sampled_from([0, 1])), events
)
moments = st.sampled_from([0.0, 0.0, 0.3, 5.0, 61.0])


class World:
    """Plays events as the shell would: only running processes send events, and time stops at each wake-up."""

    def __init__(
        self, network: tuple[Child, ...], until: str | None, escalations: Mapping[tuple[str, ...], Escalation]
    ):
        self.supervisor = Supervisor(network, until, escalations)
        self.until = until or ""
        self.children = {child.name: child for child in network}
        self.now = 0.0
        self.running: set[str] = set()
        self.ready: set[str] = set()
        self.done: set[str] = set()
        self.lost = False
        self.finished: int | None = None
        self.own_ends: dict[str, list[float]] = {name: [] for name in self.children}
        """The times of the restarts that came from a process's own ends, since a user last asked for anything."""
        self.act(self.supervisor.begin())

    def wait(self, seconds: float) -> None:
        end = self.now + seconds
        while (wake := self.supervisor.wake) is not None and wake <= end and self.finished is None:
            assert wake >= self.now or not self.supervisor.handle(Tick(), self.now), "a wake-up that wakes nobody"
            self.now = max(self.now, wake)
            self.tell(Tick())
        self.now = max(self.now, end)

    def tell(self, event: Event) -> None:
        if self.finished is not None or not self.can_be(event):
            return
        match event:
            case Ready(name):
                self.ready.add(name)
            case Exited(name, code):
                self.running.discard(name)
                if name in self.ready and code == 0:
                    self.done.add(name)
                self.ready.discard(name)
            case Lost():
                self.lost = True
                self.running = {name for name in self.running if self.children[name].host != "onboard"}
                self.ready &= self.running
            case Back():
                self.lost = False
            case RestartRequested():
                for times in self.own_ends.values():
                    times.clear()
            case _:
                pass
        self.act(self.supervisor.handle(event, self.now, chance=0.7))
        mission = self.supervisor.progress.get(self.until)
        if mission and mission.state in (State.ENDED, State.FAILED) and not mission.is_stuck:
            assert self.supervisor.stopping, "what the network was for has ended, and the network has not"
        if not self.running and not self.lost and self.supervisor.wake is None:
            assert self.finished is not None, "nobody runs or is going to, and that is not the end"

    def can_be(self, event: Event) -> bool:
        match event:
            case Ready(name) | Hung(name) | Exited(name):
                return name in self.running
            case Left():
                return "lidar" in self.running
            case Lost():
                return not self.lost
            case Back():
                return self.lost
            case _:
                return True

    def act(self, actions: list[Action]) -> None:
        for action in actions:
            assert self.finished is None, "something was done after the end"
            match action:
                case Start(name):
                    self.started(name)
                case Stop(name) | Kill(name):
                    assert name in self.running
                case Finish(code):
                    self.finished = code
                    assert not self.running
                case Retry(name, seconds):
                    assert seconds >= 0
                    self.own_ends[name].append(self.now + seconds)
                    self.check_limits(name)
                case Stuck(name):
                    self.running.discard(name)
                case Along() | GaveUp():
                    pass

    def started(self, name: str) -> None:
        child = self.children[name]
        assert not self.supervisor.stopping, "it was started although stopping had begun"
        assert name not in self.running, "it was started twice without an end in between"
        assert not (self.lost and child.host == "onboard"), "it was started at a host that is out of reach"
        assert all(other in self.ready or other in self.done for other in child.after), "it was started too early"
        self.running.add(name)
        self.done.discard(name)

    def check_limits(self, name: str) -> None:
        restart = self.children[name].restart
        assert restart.when is not When.NEVER
        last = self.own_ends[name][-1]
        recent = [time for time in self.own_ends[name] if last - time < restart.period]
        assert len(recent) <= restart.intensity, "it was started again more often than it may be"


ESCALATIONS = st.fixed_dictionaries(dict.fromkeys(((), ("left",), ("left", "hand")), st.sampled_from(Escalation)))


@given(
    networks(),
    st.sampled_from([None, "rear", "map"]),
    ESCALATIONS,
    st.lists(st.tuples(moments, likely), max_size=40),
    st.booleans(),
)
def test_whatever_happens_the_rules_are_kept_and_no_process_is_left_running(
    network: tuple[Child, ...],
    until: str | None,
    escalations: dict[tuple[str, ...], Escalation],
    history: list[tuple[float, Event]],
    is_deaf: bool,
) -> None:
    world = World(network, until, escalations)
    for seconds, event in history:
        world.wait(seconds)
        world.tell(event)
    world.tell(StopRequested())
    if not is_deaf:
        for _ in network:
            for name in sorted(world.running):
                world.tell(Exited(name, TERM))
    world.wait(5.0 * len(network) + 5.0 + UNKILLABLE * len(network))
    assert world.finished is not None, "the end was not reached"
    assert all(state.gone for state in world.supervisor.states.values())
    assert world.supervisor.wake is None
