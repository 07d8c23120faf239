"""A network under supervision, with agents that do what a test says."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.agents import Abandoned, Agent, Listener, Usage
from robocomp_py.deploy.events import EndRequested, RestartRequested, StopRequested
from robocomp_py.deploy.host_commands import ABREAST
from robocomp_py.deploy.plan import Host, Link, Plan
from robocomp_py.deploy.policy import Escalation, Restart, State, When
from robocomp_py.deploy.process import Process
from robocomp_py.deploy.run import Options, run_plan
from robocomp_py.deploy.snapshot import Meter, Network, ProcessStatus
from robocomp_py.deploy.telling import Display
from robocomp_py.errors import DeploymentError, HostUnreachable
from robocomp_py.testing.patience import SOON

PATIENT = Options(grace=SOON, remind=SOON)

Reaction = Callable[[Listener, str], None]


def ready(listener: Listener, name: str) -> None:
    listener.ready(name)


def silent(listener: Listener, name: str) -> None:
    pass


def exits(code: int) -> Reaction:
    return lambda listener, name: listener.exited(name, code)


def interrupted(*numbers: int) -> Reaction:
    """Signals to the deployer, as from a terminal."""

    def send(listener: Listener, name: str) -> None:
        for number in numbers or (signal.SIGINT,):
            os.kill(os.getpid(), number)

    return send


def both(*reactions: Reaction) -> Reaction:
    def react(listener: Listener, name: str) -> None:
        for reaction in reactions:
            reaction(listener, name)

    return react


class Scripted(Agent):
    """Notes what it is asked to do, and answers each time as `script` says, by verb and name; else as if all went well.

    A reaction is called when the event loop comes to it: first the one, next time the next one.
    """

    def __init__(self, listener: Listener, script: Mapping[str, Sequence[Reaction]]) -> None:
        self.listener = listener
        self.did: list[str] = []
        self._script = {deed: list(reactions) for deed, reactions in script.items()}

    async def open(self) -> None:
        self._react("open", "", silent)

    async def start(self, process: Process) -> None:
        self._react("start", process.name, ready)

    def stop(self, name: str) -> None:
        self._react("stop", name, exits(-signal.SIGTERM))

    def kill(self, name: str) -> None:
        self._react("kill", name, exits(-signal.SIGKILL))

    def usage(self) -> Mapping[str, Usage]:
        return {"laser": Usage(4711, 1.0, 2_000_000, 30.0, 12.0)}

    async def close(self) -> None:
        self._react("close", "", silent)

    def _react(self, verb: str, name: str, otherwise: Reaction) -> None:
        deed = f"{verb} {name}".strip()
        self.did.append(deed)
        reactions = self._script.get(deed, [])
        reaction = reactions.pop(0) if reactions else otherwise
        asyncio.get_running_loop().call_soon(reaction, self.listener, name)


class Told(Display):
    """Remembers, and reacts: `on` is what to do when something is told for the first time, by a part of it."""

    def __init__(self, on: Mapping[str, Callable[[], None]] | None = None) -> None:
        self.said: list[str] = []
        self._on = dict(on or {})

    def line(self, name: str, text: str) -> None:
        self.said.append(f"{name} | {text}")

    def states(self, states: dict[str, State]) -> None:
        pass

    def up(self) -> None:
        self._say("up")

    def waiting(self, names: list[str]) -> None:
        self._say(f"not ready: {', '.join(names)}")

    def ended(self, name: str, how: str) -> None:
        self._say(f"{name} {how}")

    def failed(self, name: str, how: str) -> None:
        self._say(f"failed: {name} {how}")

    def tell(self, text: str) -> None:
        self._say(text)

    def stopping(self, why: str) -> None:
        self._say(f"stopping: {why}")

    def _say(self, text: str) -> None:
        self.said.append(text)
        for part in [part for part in self._on if part in text]:
            self._on.pop(part)()


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def process(name: str, after: tuple[str, ...] = (), host: str = "", restart: Restart | None = None) -> Process:
    return Process(name, name.capitalize(), ("true",), Path.cwd(), after=after, host=host, restart=restart or Restart())


ONCE = Restart(When.ON_FAILURE, intensity=1, delay=0.0)
ONBOARD = Host("onboard", "192.0.2.1")


class Scene:
    """A network that was run, with what was done and told."""

    def __init__(
        self,
        plan: Plan,
        display: Told,
        script: Mapping[str, Sequence[Reaction]] | None = None,
        make: Callable[[Listener, Mapping[str, Sequence[Reaction]]], Scripted] = Scripted,
        services: Sequence[Callable[[Network], AbstractAsyncContextManager[None]]] = (),
        options: Options = PATIENT,
    ) -> None:
        self.agents: dict[str, Scripted] = {}
        self._make, self._script = make, script or {}
        running = run_plan(plan, options, display, services, self._agents, chance=lambda: 0.5)
        self.code = asyncio.run(asyncio.wait_for(running, SOON * 3))

    def _agents(self, plan: Plan, listener: Listener, note: Callable[[str], None]) -> dict[str, Agent]:
        self.agents = {host: self._make(listener, self._script) for host in ("", *(each.name for each in plan.hosts))}
        return dict(self.agents)

    @property
    def did(self) -> list[str]:
        """What was asked of the agent of this machine."""
        return self.agents[""].did


def plan(*processes: Process, hosts: tuple[Host, ...] = (), links: tuple[Link, ...] = ()) -> Plan:
    return Plan("patrol", "", processes, links, hosts=hosts)


def test_a_failure_is_reported_with_its_consequence() -> None:
    told = Told()
    scene = Scene(plan(process("laser", restart=ONCE)), told, {"start laser": [exits(1), both(ready, exits(-11))]})
    assert scene.code == 1
    assert told.said == [
        "failed: laser ended with exit code 1; started again at once",
        "laser is ready again",
        "up",
        "failed: laser was ended by signal 11; given up after 1 restart in 60 s",
    ]


def test_a_delay_is_reported_and_waited_for() -> None:
    told = Told(on={"ready again": interrupt})
    slow = Restart(When.ALWAYS, delay=0.06)
    scene = Scene(plan(process("laser", restart=slow)), told, {"start laser": [both(ready, exits(0))]})
    assert scene.code == 130
    assert "laser has ended; started again in 0.1 s" in told.said


def test_a_hung_process_is_reported_and_restarted() -> None:
    def hangs(listener: Listener, name: str) -> None:
        listener.hung(name)
        listener.exited(name, -signal.SIGABRT)

    told = Told(on={"ready again": interrupt})
    scene = Scene(plan(process("laser", restart=ONCE)), told, {"start laser": [both(ready, hangs)]})
    assert scene.code == 130
    assert "laser does not answer its watchdog and is being ended" in told.said
    how = "failed: laser did not answer its watchdog; was ended by signal 6; started again at once"
    assert how in told.said


def test_processes_restarted_with_a_failed_one_are_reported() -> None:
    told = Told(on={"mapper is ready again": interrupt})
    network = plan(process("laser", restart=ONCE), process("mapper"))
    network = Plan("patrol", "", network.processes, (), escalations={(): Escalation.REST_FOR_ONE})
    scene = Scene(
        network, told, {"start laser": [silent], "start mapper": [both(ready, lambda on, _: exits(1)(on, "laser"))]}
    )
    assert scene.did[1:6] == ["start laser", "start mapper", "stop mapper", "start laser", "start mapper"]
    assert "mapper is started again with laser" in told.said
    assert scene.code == 130


def test_a_program_that_cannot_be_started_is_tried_again_too() -> None:
    class Without(Scripted):
        async def start(self, process: Process) -> None:
            self.did.append(f"start {process.name}")
            raise DeploymentError("there is no such program")

    told = Told()
    scene = Scene(plan(process("laser", restart=ONCE)), told, make=Without)
    assert scene.did.count("start laser") == 2
    assert told.said[:2] == [
        "laser | there is no such program",
        "failed: laser ended with exit code 127; started again at once",
    ]


# Being stopped.


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)], ids=lambda it: str(int(it))
)
def test_a_signal_stops_the_network(number: int, code: int) -> None:
    scene = Scene(plan(process("laser")), Told(), {"start laser": [both(ready, interrupted(number))]})
    assert scene.did[-2:] == ["stop laser", "close"]
    assert scene.code == code


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_further_ctrl_c_kills_what_is_left(first: int) -> None:
    told = Told()
    script = {"start laser": [both(ready, interrupted(first))], "stop laser": [interrupted(signal.SIGINT)]}
    scene = Scene(plan(process("laser")), told, script)
    assert scene.did[-2:] == ["kill laser", "close"]
    assert told.said[-3:] == ["stopping: asked to", "stopping: killing what is left", "laser was killed"]
    assert scene.code == 128 + first


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_is_sent_twice_cuts_no_grace_short(number: int) -> None:
    scene = Scene(plan(process("laser")), Told(), {"start laser": [both(ready, interrupted(number, number))]})
    assert scene.did[-2:] == ["stop laser", "close"]


def test_no_process_is_started_once_the_network_is_stopping() -> None:
    class Slow(Scripted):
        async def start(self, process: Process) -> None:
            self.did.append(f"start {process.name}")
            coming[process.name] = asyncio.get_running_loop().create_future()
            if len(coming) == ABREAST:
                interrupt()
            await coming[process.name]

        def stop(self, name: str) -> None:
            self.did.append(f"stop {name}")
            coming[name].set_exception(Abandoned(name))

    coming: dict[str, asyncio.Future[None]] = {}
    names = [f"n{number}" for number in range(ABREAST + 3)]
    scene = Scene(plan(*map(process, names)), Told(), make=Slow)
    begun = names[:ABREAST]
    assert scene.did[: ABREAST + 1] == ["open", *(f"start {name}" for name in begun)]
    assert sorted(scene.did[ABREAST + 1 : -1]) == sorted(f"stop {name}" for name in begun)
    assert scene.did[-1] == "close"
    assert scene.code == 130


def test_a_host_that_is_slow_holds_up_no_other() -> None:
    class Far(Scripted):
        async def start(self, process: Process) -> None:
            if process.host:
                async with asyncio.timeout(SOON):
                    await near_is_ready.wait()
            else:
                near_is_ready.set()
            await super().start(process)

    near_is_ready = asyncio.Event()
    network = plan(process("far", host="onboard"), process("near"), hosts=(ONBOARD,))
    assert Scene(network, Told(on={"up": interrupt}), make=Far).code == 130


# Hosts.


def test_a_signal_that_nothing_came_of_before_is_heeded_then() -> None:
    scene = Scene(plan(process("laser")), Told(), options=Options(signalled=lambda: signal.SIGTERM))
    assert scene.code == 143
    assert "start laser" not in scene.did


class Unreached(Scripted):
    """Cannot be reached, where it is not this machine."""

    host = 0

    async def open(self) -> None:
        await super().open()
        type(self).host += 1
        if self.host % 2 == 0:
            raise HostUnreachable("onboard (192.0.2.1): no route")


def test_without_one_of_its_hosts_a_network_is_not_started() -> None:
    told = Told()
    scene = Scene(plan(process("near"), process("far", host="onboard"), hosts=(ONBOARD,)), told, make=Unreached)
    assert scene.code == 3
    assert [agent.did for agent in scene.agents.values()] == [["open", "close"], ["open", "close"]]
    assert told.said == ["onboard (192.0.2.1): no route"]


def test_an_interrupt_ends_the_wait_for_a_host() -> None:
    class Endless(Scripted):
        async def open(self) -> None:
            await super().open()
            await asyncio.Event().wait()

    scene = Scene(plan(process("near")), Told(), {"open": [interrupted()]}, make=Endless)
    assert scene.did == ["open", "close"]
    assert scene.code == 130


def test_a_lost_host_is_reported_with_the_missing_links_and_used_again_when_back() -> None:
    class Losing(Scripted):
        async def open(self) -> None:
            await super().open()
            listeners.append(self.listener)

    def lose() -> None:
        listeners[0].lost("onboard", "no answer")
        listeners[0].back("onboard")

    listeners: list[Listener] = []
    link = Link("Laser", "laser", "mapper", Verb.REQUIRES)
    network = plan(process("laser", host="onboard", restart=ONCE), process("mapper"), hosts=(ONBOARD,), links=(link,))
    told = Told(on={"up": lose, "laser is ready again": interrupt})
    scene = Scene(network, told, make=Losing)
    assert told.said[:6] == [
        "up",
        "onboard is out of reach: no answer",
        "lost with it: laser",
        "missed: Laser of laser by mapper",
        "onboard is back",
        "laser is ready again",
    ]
    assert scene.agents["onboard"].did == ["open", "start laser", "start laser", "stop laser", "close"]


def test_all_agents_are_closed_even_if_one_cannot_be() -> None:
    class Broken(Scripted):
        async def close(self) -> None:
            await super().close()
            closed.append(self)
            if len(closed) == 1:
                raise OSError("no space left")

    closed: list[Scripted] = []
    network = plan(process("near"), hosts=(ONBOARD,))
    with pytest.raises(OSError, match="no space left"):
        Scene(network, Told(on={"up": interrupt}), make=Broken)
    assert len(closed) == 2


def test_an_agent_that_breaks_ends_the_network_and_nothing_is_left() -> None:
    class Broken(Scripted):
        async def start(self, process: Process) -> None:
            raise ZeroDivisionError("a mistake of ours")

        async def close(self) -> None:
            await super().close()
            closed.append(self)

    closed: list[Scripted] = []
    with pytest.raises(ExceptionGroup) as raised:
        Scene(plan(process("near"), hosts=(ONBOARD,)), Told(), make=Broken)
    assert isinstance(raised.value.exceptions[0], ZeroDivisionError)
    assert len(closed) == 2


def test_errors_of_making_agents_are_reported() -> None:
    def none(plan: Plan, listener: Listener, note: Callable[[str], None]) -> Mapping[str, Agent]:
        raise DeploymentError("other hosts are reached by asyncssh, which is missing")

    told = Told()
    assert asyncio.run(run_plan(plan(process("near")), PATIENT, told, agents=none)) == 1
    assert told.said == ["other hosts are reached by asyncssh, which is missing"]


# Being asked.


class Visitor:
    """Looks at a network when it is up, and asks for things."""

    def __init__(self, *asks: RestartRequested | EndRequested | StopRequested) -> None:
        self._asks = asks
        self.seen: list[ProcessStatus] = []
        self.refused: list[str] = []
        self.network: Network | None = None

    @asynccontextmanager
    async def __call__(self, network: Network) -> AsyncIterator[None]:
        self.network = network
        yield

    def come(self) -> None:
        assert self.network
        self.seen.append(self.network.snapshot().processes[0])
        for event in self._asks:
            try:
                self.network.ask(event)
            except DeploymentError as exc:
                self.refused.append(str(exc))


def test_a_user_has_something_started_again() -> None:
    visitor = Visitor(RestartRequested(("laser",)))
    told = Told(on={"up": visitor.come, "ready again": interrupt})
    scene = Scene(plan(process("laser")), told, services=[visitor])
    assert scene.did == ["open", "start laser", "stop laser", "start laser", "stop laser", "close"]
    assert scene.code == 130
    assert told.said[1:3] == ["restart of laser requested", "laser is ready again"]


def test_a_user_has_a_process_stopped_and_started() -> None:
    visitor = Visitor(EndRequested(("laser",)))

    def start() -> None:
        assert visitor.network
        assert visitor.network.snapshot().processes[0].how == "was stopped by the user"
        visitor.network.ask(RestartRequested(("laser",)))

    told = Told(on={"up": visitor.come, "ready again": interrupt})
    script = {"stop laser": [both(exits(0), lambda listener, name: asyncio.get_running_loop().call_soon(start))]}
    scene = Scene(plan(process("laser"), process("arm")), told, script, services=[visitor])
    assert [each for each in scene.did if "laser" in each] == [
        "start laser", "stop laser", "start laser", "stop laser"
    ]  # fmt: skip
    assert told.said[1] == "stop of laser requested"


def test_a_stop_that_would_end_the_network_is_refused() -> None:
    visitor = Visitor(EndRequested(("laser",)), StopRequested())
    Scene(plan(process("laser")), Told(on={"up": visitor.come}), services=[visitor])
    assert visitor.refused == ["patrol would end with that: to stop all of it, use rcdeploy down"]


def test_a_user_has_the_network_stopped_and_that_is_no_failure() -> None:
    visitor = Visitor(StopRequested())
    scene = Scene(plan(process("laser")), Told(on={"up": visitor.come}), services=[visitor])
    assert scene.did[-2:] == ["stop laser", "close"]
    assert scene.code == 0


def test_what_cannot_be_done_is_refused_with_the_reason() -> None:
    visitor = Visitor(RestartRequested(("lasre",)), StopRequested(), RestartRequested(("laser",)))
    Scene(plan(process("laser")), Told(on={"up": visitor.come}), services=[visitor])
    assert visitor.refused == [
        "patrol: unknown instance `lasre`; did you mean `laser`?",
        "patrol is stopping: nothing can be started",
    ]


def test_too_many_requests_are_refused() -> None:
    visitor = Visitor(*[RestartRequested(("laser",))] * 2000)
    Scene(plan(process("laser")), Told(on={"up": visitor.come, "ready again": interrupt}), services=[visitor])
    assert set(visitor.refused) == {"patrol is overloaded; try again"}


def test_a_snapshot_shows_how_a_process_is() -> None:
    visitor = Visitor()
    script = {"start laser": [both(lambda listener, name: listener.status(name, "warm"), ready)]}
    Scene(plan(process("laser")), Told(on={"up": both_of(visitor.come, interrupt)}), script, services=[visitor])
    (seen,) = visitor.seen
    assert (seen.name, seen.component, seen.instances, seen.state) == ("laser", "Laser", ("laser",), State.READY)
    assert (seen.pid, seen.memory, seen.calls, seen.worst, seen.status) == (4711, 2_000_000, 30.0, 0.012, "warm")
    assert (seen.starts, seen.restarts, seen.next_start) == (1, 0, None)
    assert visitor.network
    over = visitor.network.snapshot()
    assert over.stopping
    assert over.why == "asked to"
    assert over.processes[0].state is State.ENDED
    assert over.processes[0].pid is None


def soon(*deeds: Callable[[], None]) -> None:
    asyncio.get_running_loop().call_soon(both_of(*deeds))


def both_of(*deeds: Callable[[], None]) -> Callable[[], None]:
    def act() -> None:
        for deed in deeds:
            deed()

    return act


def test_a_snapshot_tells_when_something_is_started_again_and_why() -> None:
    visitor = Visitor()
    patient = Restart(When.ON_FAILURE, delay=50.0, max_delay=50.0)
    told = Told(on={"started again": lambda: soon(visitor.come, interrupt)})
    Scene(plan(process("laser", restart=patient)), told, {"start laser": [both(ready, exits(3))]}, services=[visitor])
    (seen,) = visitor.seen
    assert seen.state is State.RESTARTING
    assert seen.how == "ended with exit code 3"
    assert seen.next_start is not None
    assert 0 < seen.next_start <= 50.0


def test_a_share_of_the_processor_needs_two_looks_at_the_same_process() -> None:
    meter = Meter()
    meter.read({"laser": Usage(1, cpu_s=5.0, at=10.0)})
    assert meter.cores("laser", 1) is None
    meter.read({"laser": Usage(1, cpu_s=6.0, at=12.0)})
    assert meter.cores("laser", 1) == 0.5
    meter.read({"laser": Usage(1, cpu_s=6.0, at=12.0)})
    assert meter.cores("laser", 1) == 0.5, "nobody has looked since"
    meter.read({"laser": Usage(2, cpu_s=0.1, at=13.0)})
    assert meter.cores("laser", 2) is None
    assert meter.cores("laser", 1) is None
