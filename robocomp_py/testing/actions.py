"""The suite for actions: whether a transport carries goals from their begin to their end.

class TestMine(ActionsConformance):
    def open_transport(self, owner="test"):
        return MyTransport(TransportConfig(owner=owner))
"""

from __future__ import annotations

import asyncio
import itertools
import threading
import time
import uuid
from collections.abc import Callable, Generator
from concurrent.futures import Future, wait
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

from ..actions.binding import Connected, Surroundings, connect, new_identity, serve
from ..actions.client import ActionProxy
from ..actions.goal import MOST_QUEUED, Goal, ServerGoal, Times
from ..contract.component import Port
from ..contract.goal import GoalState
from ..contract.interface import Action, Interface, Operation, Verb
from ..contract.types import FLOAT32, INT32, STRING, ExceptionType, Field, Struct
from ..errors import Busy, Cancelled, Closed, ContractMismatch, DeclaredError, RemoteFailure, Timeout, Unreachable
from ..runtime.monitor import Monitor
from ..runtime.ports import close_all
from ..runtime.route import Route
from ..transports.base import Transport
from .parts import ComponentSuite, Victim
from .patience import SCALE, SOON, wait_until

Steps = Generator[None, None, Any]


@dataclass
class Progress:
    left: float = 0.0


@dataclass(eq=False)
class Blocked(DeclaredError):
    by: str = ""


_PROGRESS = Struct("Conformance::PilotGoToFeedback", (Field("left", FLOAT32),), Progress)
_BLOCKED = ExceptionType("Conformance::Blocked", (Field("by", STRING),), python=Blocked)
Blocked.__contract__ = _BLOCKED  # type: ignore[attr-defined]  # as generated classes have it
_PILOT = "Conformance::Pilot"
_STEPS, _RESULT = (Field("steps", INT32),), (Field("ret", INT32),)
GO_TO = Action(_PILOT, "goTo", _STEPS, _RESULT, _PROGRESS, (_BLOCKED,))
DOCK = Action(_PILOT, "dock", _STEPS, _RESULT)
TURN = Action(_PILOT, "turn", _STEPS, _RESULT)
PILOT = Interface(_PILOT, (), actions=(GO_TO, DOCK, TURN))
OTHER = Interface(_PILOT, (), actions=(Action(_PILOT, "goTo", (Field("steps", FLOAT32),), _RESULT, _PROGRESS),))
"""Another definition under the same name."""

_TIMES = Times(slice=0.3 * SCALE, reply=SOON, silence=1.5 * SCALE)

FOREVER = 10**6
"""More steps than a test waits for."""

FLOOD = 2000
"""Number of feedbacks without a pause."""


class Pilot:
    """Executes goals. The number of steps decides about their ends."""

    def __init__(self) -> None:
        self.told_to_stop = 0
        self.begun: list[int] = []

    def Pilot_goTo(self, goal: ServerGoal, steps: int) -> Steps:
        self.begun.append(steps)
        if steps == FLOOD:
            for left in range(steps):
                goal._tell(Progress(left))
        try:
            for left in range(min(steps, FOREVER), 0, -1):
                if steps != FLOOD:
                    goal._tell(Progress(left))
                yield
                if steps == FLOOD:
                    break
        except Cancelled:
            self.told_to_stop += 1
            raise
        if steps == -1:
            raise Blocked("wall")
        if steps == -2:
            raise KeyError("wheel")
        return steps

    def Pilot_dock(self, goal: ServerGoal, steps: int) -> Steps:
        self.begun.append(steps)
        yield from itertools.repeat(None, steps)
        return steps

    def Pilot_turn(self, goal: ServerGoal, steps: int) -> Steps:
        self.begun.append(steps)
        try:
            yield from itertools.repeat(None, steps)
        except Cancelled:
            if steps != FOREVER + 1:
                raise
        return steps


async def _awaited(goal: Goal[int, Progress]) -> int:
    return await asyncio.wait_for(goal, SOON)


def _wait(seconds: float | None, condition: Callable[[], bool], wake: threading.Event) -> bool:
    """As a component on the machine's clock does."""
    while not condition() and wake.wait(seconds):
        wake.clear()
    return True


class End:
    """One end of the actions at one name."""

    def __init__(self, transport: Transport, name: str) -> None:
        self._transport, self._name = transport, name
        self.monitor = Monitor("pilot")
        self.monitor.open()
        self.connected = Connected()
        self.around = Surroundings(self.monitor, _wait, time.monotonic, new_identity, None, _TIMES)

    def close(self) -> None:
        self.monitor.turn_away()
        close_all(self.connected.links)
        self.monitor.close()

    def route(self, port: Port, operation: Operation[Any], action: str) -> Route:
        channel = f"{self._name}/{port.interface.short}/{operation.name}"
        return Route(self._transport, "tested", channel, port.qos, SOON)


class Server(End):
    """A component that executes goals, as `Running` does: a step at each beat."""

    def __init__(self, transport: Transport, name: str) -> None:
        super().__init__(transport, name)
        self.pilot = Pilot()
        policies = (("dock", "queue"), ("turn", "preempt"))
        self.goals = serve(
            Port(Verb.IMPLEMENTS, PILOT, policies=policies), self.pilot, self.route, self.around, self.connected
        )
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._loop, name="beats", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stopping.set()
        self._thread.join(SOON)
        with self.monitor.held():
            for each in self.goals:
                each.end()
        super().close()

    def _loop(self) -> None:
        """Until it is closed, or its transport is."""
        while not self._stopping.wait(0.002):
            try:
                with self.monitor.held():
                    for each in self.goals:
                        each.step()
            except Closed:
                return


class Client(End):
    """A component that begins goals."""

    def __init__(self, transport: Transport, name: str, interface: Interface = PILOT) -> None:
        super().__init__(transport, name)
        self.proxy = ActionProxy({})
        self.goals = connect(Port(Verb.REQUIRES, interface), self.proxy, self.route, self.around, self.connected)

    def wait(self) -> Client:
        for link in self.connected.links:
            assert link.wait_peer(SOON)
        return self

    def begin(self, action: Action, steps: int, *, detached: bool = False) -> Goal[int, Progress]:
        return self.proxy._begin(action, (steps,), detached, None)

    def close(self) -> None:
        self.goals.close()
        super().close()


class ActionsConformance(ComponentSuite):
    """The tests."""

    @pytest.fixture
    def name(self) -> str:
        return f"i{uuid.uuid4().hex[:12]}"

    @pytest.fixture
    def here(self, ending: ExitStack) -> Transport:
        transport = self.open_transport("client")
        ending.callback(transport.close)
        return transport

    @pytest.fixture
    def server(self, ending: ExitStack, name: str) -> Server:
        transport = self.open_transport("server")
        ending.callback(transport.close)
        server = Server(transport, name)
        ending.callback(server.close)
        return server

    @pytest.fixture
    def client(self, server: Server, here: Transport, name: str, ending: ExitStack) -> Client:
        client = Client(here, name)
        ending.callback(client.close)
        return client.wait()

    def test_a_goal_succeeds(self, client: Client) -> None:
        goal = client.begin(GO_TO, 30)
        assert goal.result(SOON) == 30
        assert goal.status is GoalState.SUCCEEDED
        assert goal.done
        assert goal.result() == 30

    def test_the_client_sees_the_newest_feedback(self, client: Client) -> None:
        goal = client.begin(GO_TO, FOREVER)
        wait_until(lambda: goal.feedback is not None)
        first = goal.feedback
        wait_until(lambda: goal.feedback and first and goal.feedback.left < first.left)
        wait_until(lambda: goal.status is GoalState.EXECUTING)
        assert not goal.done
        goal.cancel()

    def test_a_declared_exception_reaches_the_client(self, client: Client) -> None:
        goal = client.begin(GO_TO, -1)
        with pytest.raises(Blocked) as caught:
            goal.result(SOON)
        assert caught.value.by == "wall"
        assert goal.status is GoalState.ABORTED

    def test_any_other_exception_is_a_remote_failure(self, client: Client) -> None:
        goal = client.begin(GO_TO, -2)
        with pytest.raises(RemoteFailure) as caught:
            goal.result(SOON)
        assert caught.value.kind == "KeyError"
        assert goal.status is GoalState.ABORTED

    def test_a_cancelled_goal_is_told_to_both_sides(self, server: Server, client: Client) -> None:
        goal = client.begin(GO_TO, FOREVER)
        wait_until(lambda: goal.feedback is not None)
        goal.cancel()
        with pytest.raises(Cancelled):
            goal.result(SOON)
        assert goal.status is GoalState.CANCELED
        assert server.pilot.told_to_stop == 1

    def test_a_handler_may_succeed_although_it_is_cancelled(self, server: Server, client: Client) -> None:
        goal = client.begin(TURN, FOREVER + 1)
        wait_until(lambda: server.pilot.begun)
        goal.cancel()
        assert goal.result(SOON) == FOREVER + 1
        assert goal.status is GoalState.SUCCEEDED

    def test_a_result_may_be_waited_for_in_parts(self, client: Client) -> None:
        goal = client.begin(GO_TO, FOREVER)
        with pytest.raises(Timeout):
            goal.result(2 * _TIMES.slice)  # so that it is asked for again
        assert not goal.done
        goal.cancel()
        with pytest.raises(Cancelled):
            goal.result(SOON)

    def test_a_goal_can_be_awaited(self, client: Client) -> None:
        async def outcome(steps: int) -> int | Exception:
            try:
                return await client.begin(DOCK if steps >= 0 else GO_TO, steps)
            except (Blocked, RemoteFailure) as exc:
                return exc

        async def outcomes() -> tuple[int | Exception, ...]:
            return await asyncio.gather(outcome(3), outcome(-1), outcome(0))

        steps, blocked, none = asyncio.run(outcomes())
        assert (steps, none) == (3, 0)
        assert isinstance(blocked, Blocked)
        assert blocked.by == "wall"

    def test_goals_are_awaited_without_threads(self, client: Client) -> None:
        goals = [client.begin(DOCK, 1) for _ in range(50)]
        before = threading.active_count()

        async def results() -> tuple[list[int], int]:
            every = asyncio.gather(*goals)
            await asyncio.sleep(0)
            return await every, threading.active_count()

        done, threads = asyncio.run(results())
        assert done == [1] * 50
        assert threads < before + 25

    def test_a_task_that_ends_early_does_not_cancel_its_goal(self, server: Server, client: Client) -> None:
        async def wait_in_vain(goal: Goal[int, Progress]) -> None:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(goal, 0.05)

        async def cancel(goal: Goal[int, Progress]) -> None:
            await asyncio.to_thread(goal.cancel)
            with pytest.raises(Cancelled):
                await goal

        goal = client.begin(GO_TO, FOREVER)
        asyncio.run(wait_in_vain(goal))
        assert not goal.done
        assert not server.pilot.told_to_stop
        asyncio.run(cancel(goal))
        assert goal.status is GoalState.CANCELED

    def test_a_goal_has_futures(self, client: Client) -> None:
        goal = client.begin(GO_TO, FOREVER)
        future, dropped = goal.future(), goal.future()
        called: list[Future[int]] = []
        future.add_done_callback(called.append)
        assert dropped.cancel()
        assert wait([dropped], SOON).done == {dropped}
        assert not goal.done
        with pytest.raises(Timeout):
            future.result(0.01)
        goal.cancel()
        with pytest.raises(Cancelled):
            future.result(SOON)
        assert isinstance(goal.future().exception(), Cancelled)
        wait_until(lambda: called == [future])
        assert client.begin(GO_TO, 2).future().result(SOON) == 2

    def test_callbacks_of_a_future_run_like_handlers(self, client: Client) -> None:
        inside: list[bool] = []
        goal = client.begin(GO_TO, 1)
        with client.monitor.held():
            goal.future().add_done_callback(lambda _: inside.append(client.monitor.is_inside))
            assert goal.result(SOON) == 1
        wait_until(lambda: inside)
        assert inside == [True]

    def test_a_client_that_stops_waits_no_longer(self, client: Client) -> None:
        goal = client.begin(GO_TO, FOREVER, detached=True)
        future = goal.future()

        async def stop() -> None:
            waiting = [asyncio.ensure_future(goal), asyncio.wrap_future(goal.future())]
            await asyncio.sleep(0)
            client.monitor.turn_away()
            for each in waiting:
                with pytest.raises(Closed):
                    await each

        asyncio.run(stop())
        with pytest.raises(Closed):
            future.result(SOON)
        assert not goal.done, "until it closes"
        client.goals.close()
        assert goal.done
        with pytest.raises(Closed):
            goal.result()
        assert isinstance(goal.future().exception(), Closed)

    def test_a_goal_is_refused_while_another_one_is_active(self, client: Client) -> None:
        goal = client.begin(GO_TO, FOREVER)
        with pytest.raises(Busy):
            client.begin(GO_TO, 1)
        goal.cancel()
        with pytest.raises(Cancelled):
            goal.result(SOON)
        assert client.begin(GO_TO, 1).result(SOON) == 1

    def test_a_goal_preempts_another_one(self, server: Server, client: Client) -> None:
        first = client.begin(TURN, FOREVER)
        wait_until(lambda: server.pilot.begun == [FOREVER])
        second = client.begin(TURN, 2)
        with pytest.raises(Cancelled):
            first.result(SOON)
        assert second.result(SOON) == 2

    def test_a_hundred_goals_are_executed_in_their_order(self, server: Server, client: Client) -> None:
        goals = [client.begin(DOCK, number % 3) for number in range(100)]
        assert [goal.result(SOON) for goal in goals] == [number % 3 for number in range(100)]
        assert server.pilot.begun == [number % 3 for number in range(100)]
        assert {goal.status for goal in goals} == {GoalState.SUCCEEDED}

    def test_the_queue_is_bounded(self, client: Client) -> None:
        goals = [client.begin(DOCK, FOREVER)]
        goals += [client.begin(DOCK, 0) for _ in range(MOST_QUEUED)]
        with pytest.raises(Busy):
            client.begin(DOCK, 0)
        goals[0].cancel()
        assert [goal.result(SOON) for goal in goals[1:]] == [0] * MOST_QUEUED

    def test_a_cancel_races_the_result(self, client: Client) -> None:
        ends = set()
        for number in range(40):
            goal = client.begin(DOCK, number % 4)
            goal.cancel()
            try:
                ends.add((goal.result(SOON) == number % 4, goal.status))
            except Cancelled:
                ends.add((False, goal.status))
        assert ends <= {(True, GoalState.SUCCEEDED), (False, GoalState.CANCELED)}

    def test_a_flood_of_feedback_is_bounded(self, client: Client) -> None:
        goal = client.begin(GO_TO, FLOOD)
        assert goal.result(SOON) == FLOOD
        assert client.begin(GO_TO, 3).result(SOON) == 3

    def test_clients_have_their_own_goals(self, server: Server, client: Client, name: str, ending: ExitStack) -> None:
        transport = self.open_transport("another")
        ending.callback(transport.close)
        other = Client(transport, name)
        ending.callback(other.close)
        other.wait()
        goals = [each.begin(DOCK, steps) for steps in range(5) for each in (client, other)]
        assert [goal.result(SOON) for goal in goals] == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]

    def test_a_goal_without_a_server_is_unreachable(self, here: Transport, name: str, ending: ExitStack) -> None:
        client = Client(here, name)
        ending.callback(client.close)
        with pytest.raises(Unreachable):
            client.begin(GO_TO, 1)

    def test_a_client_with_another_definition_is_refused(
        self, server: Server, here: Transport, name: str, ending: ExitStack
    ) -> None:
        client = Client(here, name, OTHER)
        ending.callback(client.close)
        action = OTHER.actions[0]

        def is_refused() -> bool:
            try:
                client.proxy._begin(action, (1.0,), False, None)
            except ContractMismatch:
                return True
            except Unreachable:  # it is not visible yet
                return False
            return pytest.fail("it was accepted")

        wait_until(is_refused)

    def test_the_end_of_the_server_ends_its_goals(self, name: str, here: Transport, ending: ExitStack) -> None:
        transport = self.open_transport("server")
        ending.callback(transport.close)
        server = Server(transport, name)
        with ExitStack() as serving:
            serving.callback(server.close)
            client = Client(here, name)
            ending.callback(client.close)
            goal = client.wait().begin(GO_TO, FOREVER)
            wait_until(lambda: goal.feedback is not None)
        with pytest.raises(Unreachable):
            goal.result(SOON)

    def test_a_killed_server_is_unreachable(self, here: Transport, name: str, ending: ExitStack) -> None:
        victim = Victim(self, here, name, _be_server)
        ending.callback(victim.kill)
        client = Client(here, name)
        ending.callback(client.close)
        goal = client.wait().begin(GO_TO, FOREVER)
        wait_until(lambda: goal.feedback is not None)
        future = goal.future()
        victim.kill()
        with pytest.raises(Unreachable):
            asyncio.run(_awaited(goal))
        with pytest.raises(Unreachable):
            future.result(SOON)

    def test_the_goals_of_a_killed_client_are_cancelled_unless_detached(
        self, server: Server, here: Transport, name: str, ending: ExitStack
    ) -> None:
        victim = Victim(self, here, name, _be_client)
        ending.callback(victim.kill)
        victim.wait_until_stuck()
        attached, detached = server.goals[0], server.goals[1]
        assert (attached.active, detached.active) == (1, 1)
        victim.kill()
        wait_until(lambda: attached.active == 0)
        assert server.pilot.told_to_stop == 1
        assert detached.active == 1

    def test_goals_of_a_client_that_stops_are_cancelled_unless_detached(
        self, server: Server, name: str, ending: ExitStack
    ) -> None:
        transport = self.open_transport("leaving")
        ending.callback(transport.close)
        client = Client(transport, name)
        client.wait()
        client.begin(GO_TO, FOREVER)
        client.begin(DOCK, FOREVER, detached=True)
        wait_until(lambda: len(server.pilot.begun) == 2)
        client.close()
        wait_until(lambda: server.goals[0].active == 0)
        assert server.goals[1].active == 1


def _be_server(transport: Transport, name: str, stuck: Any) -> None:
    Server(transport, name)


def _be_client(transport: Transport, name: str, stuck: Any) -> None:
    client = Client(transport, name).wait()
    goals = [client.begin(GO_TO, FOREVER), client.begin(DOCK, FOREVER, detached=True)]
    wait_until(lambda: all(goal.status is GoalState.EXECUTING for goal in goals))
    stuck.set()
