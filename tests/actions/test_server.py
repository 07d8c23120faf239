"""The bounds of a server: results, silent clients, requests that wait."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import Future
from typing import Any

from robocomp_py.actions.goal import MOST_POLLS, MOST_RESULTS, ServerGoal, Times
from robocomp_py.actions.server import GoalServer
from robocomp_py.contract.goal import GoalState, Policy
from robocomp_py.contract.interface import Action
from robocomp_py.contract.types import INT32, Field
from robocomp_py.transports.base import Reply, Status
from robocomp_py.wire.cdr import Cdr

ACTION = Action("Test::Pilot", "fly", (Field("steps", INT32),), (Field("ret", INT32),))


class Ship:
    """A server, with a clock that the test moves."""

    def __init__(self, policy: Policy = Policy.QUEUE) -> None:
        self.seconds = 0.0
        self.states: list[tuple[int, ...]] = []
        self.server = GoalServer(ACTION, policy, self.fly, self._tell, lambda: self.seconds, Times())
        self.codec = self.server.codec(Cdr())

    def fly(self, goal: ServerGoal, steps: int) -> Generator[None, None, int]:
        for _ in range(steps):
            yield
        return steps

    def begin(self, number: int, steps: int, *, detached: bool = False) -> bytes:
        identity = number.to_bytes(16, "big")
        self.server.start(identity, detached, steps)
        return identity

    def poll(self, identity: bytes, wait: float = 1.0) -> Reply | Future[Reply]:
        return self.server.poll(identity, wait, self.codec)

    def _tell(self, operation: Any, arguments: tuple[Any, ...]) -> None:
        self.states.append(tuple(arguments[1]))


def test_states_are_told_in_their_order() -> None:
    ship = Ship()
    ship.begin(1, 1)
    ship.server.step()
    ship.server.step()
    assert ship.states == [(GoalState.ACCEPTED,), (GoalState.EXECUTING,), (GoalState.SUCCEEDED,)]


def test_a_goal_that_is_cancelled_before_it_begins_never_begins() -> None:
    ship = Ship()
    goal = ship.begin(1, 1)
    assert ship.server.cancel(goal) == GoalState.CANCELED
    ship.server.step()
    assert ship.states[-1] == (GoalState.CANCELED,)
    assert ship.server.cancel(b"\0" * 16) == GoalState.UNKNOWN


def test_a_silent_client_loses_its_goals_but_not_detached_ones() -> None:
    ship = Ship()
    ship.begin(1, 10**6)
    ship.begin(2, 10**6, detached=True)
    ship.server.step()
    ship.seconds = 4.9
    ship.server.step()
    assert ship.server.active == 2
    ship.seconds = 5.1
    ship.server.step()
    assert ship.server.active == 1


def test_a_client_that_asks_is_not_silent() -> None:
    ship = Ship()
    goal = ship.begin(1, 10**6)
    for second in range(20):
        ship.seconds = float(second)
        assert isinstance(ship.poll(goal), Future)
        ship.server.step()
    assert ship.server.active == 1


def test_a_request_for_a_result_ends_with_it_or_after_its_time() -> None:
    ship = Ship()
    goal = ship.begin(1, 2)
    first = ship.poll(goal)
    assert isinstance(first, Future)
    ship.seconds = 1.5
    ship.server.step()
    assert first.result(0).status is Status.THROWN, "there is none yet"
    second = ship.poll(goal)
    assert isinstance(second, Future)
    ship.server.step()
    ship.server.step()
    assert second.result(0).status is Status.OK
    assert isinstance(ship.poll(goal), Reply)


def test_few_requests_wait_for_one_result() -> None:
    ship = Ship()
    goal = ship.begin(1, 10**6)
    waiting = [ship.poll(goal, 100.0) for _ in range(MOST_POLLS + 3)]
    assert [isinstance(each, Future) and each.done() for each in waiting] == [True] * 3 + [False] * MOST_POLLS


def test_results_are_kept_for_a_while_and_in_a_bounded_number() -> None:
    ship = Ship()
    for number in range(1, 51):
        ship.begin(number, 0)
    ship.server.step()
    assert isinstance(ship.poll((1).to_bytes(16, "big")), Reply)
    ship.seconds = 61.0
    ship.server.step()
    assert ship.states[-1] == (GoalState.SUCCEEDED,) * 50
    ship.begin(100, 0)
    assert ship.states[-1] == (GoalState.ACCEPTED,), "the old ones are forgotten"
    for number in range(101, 101 + 2 * MOST_RESULTS):
        ship.begin(number, 0)
        ship.server.step()
    ship.begin(1000, 0)
    assert len(ship.states[-1]) <= MOST_RESULTS + 2


def test_the_end_of_a_server_refuses_what_waits() -> None:
    ship = Ship()
    goal = ship.begin(1, 10**6)
    ship.server.step()
    waiting = ship.poll(goal)
    ship.server.end()
    assert isinstance(waiting, Future)
    assert waiting.result(0).status is Status.REFUSED
    assert ship.server.active == 0
