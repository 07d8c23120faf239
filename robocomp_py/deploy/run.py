"""Runs a plan: one queue of events, one loop that does what the policy says.

Each host has an agent that starts and ends its processes, and a queue of commands for it, so that a slow host holds up
no other.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any

from ..contract.interface import Verb
from ..errors import DeploymentError, HostUnreachable
from ..runtime.notify import notify
from ..spelling import unknown
from ..transports.base import TransportConfig, hosting
from ..transports.deployment import deployment_of
from .agents import Agent, Listener, Usage
from .events import (
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
from .host_commands import ABREAST, HostCommands
from .plan import Plan
from .policy import FAILED, UNREACHABLE, Child, State, Supervisor
from .scouting import Scout, Scouted
from .snapshot import HostStatus, Meter, Network, ProcessStatus, Snapshot
from .telling import Display, Teller

GRACE = 5.0
"""Seconds that a process may take to end after a request, for each component in it: they end one after the other."""

REMIND = 5.0
"""Seconds until the waiting instances are reported; then twice as long each time, while nothing changes."""

MEASURE = 1.0
"""Seconds between two measurements of the processes' usage."""

CLOSING = 30.0
"""Seconds within which the agents must clean up."""

REQUESTS = 1000
"""Events that may wait; a user who asks for more is refused."""

_TERMINATING = (signal.SIGTERM, signal.SIGHUP)

_LONGEST = 64
"""The longest wait for a reminder, as a multiple of the first one."""


@dataclass(frozen=True)
class Options:
    duration: float | None = None
    """Seconds to stay up, counted from when everything is ready; None is until stopped."""
    until: str | None = None
    """The instance whose end stops the network."""
    grace: float = GRACE
    remind: float = REMIND
    signalled: Callable[[], int] = lambda: 0
    """Returns the signal that arrived before the network handles signals, and had no effect; 0 if there was none."""


Service = Callable[[Network], AbstractAsyncContextManager[object]]
"""A service that is open while a network runs, such as its control socket."""

Agents = Callable[[Plan, Listener, Callable[[str], None]], Mapping[str, Agent]]
"""Makes the agents of a plan, by host. The last argument is called with progress. May raise DeploymentError."""


def agents_of(plan: Plan, listener: Listener, note: Callable[[str], None]) -> dict[str, Agent]:
    """The agent of this machine, and one for each host of the plan."""
    from .hosts.fleet import remote_agents
    from .launcher.local import Launcher

    here = Launcher(listener, plan.name, [each.middleware for each in plan.transports])
    return {"": here, **remote_agents(plan, listener, note)}


async def run_plan(
    plan: Plan,
    options: Options,
    display: Display,
    services: Sequence[Service] = (),
    agents: Agents = agents_of,
    chance: Callable[[], float] = random.random,
) -> int:
    """Start a network, watch it, stop it.

    Returns the exit code: 0; 1 if a process failed and was not restarted; 3 if a host was out of reach; or 128 + the
    signal that stopped it.
    """
    return await _Run(plan, options, display, agents, chance).run(services)


class _Run(Listener, Network):
    def __init__(
        self,
        plan: Plan,
        options: Options,
        display: Display,
        agents: Agents,
        chance: Callable[[], float],
    ) -> None:
        self._plan, self._options, self._display = plan, options, display
        self._chance = chance
        self._processes = {process.name: process for process in plan.processes}
        self._supervisor = Supervisor(children(plan, options.grace), options.until, plan.escalations)
        self._teller = Teller(plan, options.until, self._supervisor, display)
        self._events: asyncio.Queue[Event] = asyncio.Queue()
        self._stop_asked = asyncio.Event()
        self._agents = agents
        self._commands: dict[str, HostCommands] = {}
        self._unreachable: dict[str, str] = {}
        """Why a host is out of reach."""
        self._contracts: dict[str, Mapping[str, str]] = {name: each.operations for name, each in plan.ours.items()}
        """By instance: that of the plan, until the instance has reported its own."""
        self._meter = Meter()
        self._began = time.monotonic()
        self._was_up = False
        self._reminders = 0
        self._reminded: list[str] = []
        self._timers: dict[str, asyncio.TimerHandle] = {}

    async def run(self, services: Sequence[Service]) -> int:
        loop = asyncio.get_running_loop()
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, *_TERMINATING)}
        if before[signal.SIGHUP] is signal.SIG_IGN:  # as under nohup
            del before[signal.SIGHUP]
        for number in before:
            loop.add_signal_handler(number, self._interrupted, number)
        if missed := self._options.signalled():
            self._interrupted(missed)
        try:
            return await self._with_agents(services)
        finally:
            for number, handler in before.items():
                loop.remove_signal_handler(number)
                signal.signal(number, handler or signal.SIG_DFL)  # asyncio does not restore it

    async def _with_agents(self, services: Sequence[Service]) -> int:
        try:
            agents = self._agents(self._plan, self, self._display.tell)
        except DeploymentError as exc:
            self._display.tell(str(exc))
            return FAILED
        self._commands = {host: HostCommands(agent, self) for host, agent in agents.items()}
        try:
            code = await self._open()
            if code is not None:
                return code
            async with contextlib.AsyncExitStack() as open_services:  # the agents ensure that it runs only here
                for service in services:
                    await open_services.enter_async_context(service(self))
                return await self._supervised()
        finally:
            for timer in self._timers.values():
                timer.cancel()
            await self._close()

    async def _open(self) -> int | None:
        """Open all agents. Returns the exit code if one of them failed or a stop was requested."""
        opening = asyncio.gather(*(each.agent.open() for each in self._commands.values()), return_exceptions=True)
        asked = asyncio.create_task(self._stop_asked.wait())
        try:
            await asyncio.wait((opening, asked), return_when=asyncio.FIRST_COMPLETED)
            if not opening.done():
                return self._stopped_early()
            return self._failed_early([found for found in opening.result() if found])
        finally:
            opening.add_done_callback(_noticed)
            for each in (asked, opening):
                each.cancel()
            await asyncio.wait((asked, opening), timeout=CLOSING)

    def _stopped_early(self) -> int:
        while not self._events.empty():
            event = self._events.get_nowait()
            if isinstance(event, StopRequested):
                self._display.stopping(event.why)
                return event.code
        raise AssertionError("a stop was requested")

    def _failed_early(self, errors: Sequence[BaseException]) -> int | None:
        code = None
        for error in errors:
            if not isinstance(error, DeploymentError):
                raise error
            self._display.tell(str(error))
            code = max(code or 0, UNREACHABLE if isinstance(error, HostUnreachable) else FAILED)
        return code

    async def _close(self) -> None:
        """Close the agents of all hosts, even if one of them fails."""
        closing = [asyncio.create_task(each.agent.close()) for each in self._commands.values()]
        done, late = await asyncio.wait(closing, timeout=CLOSING) if closing else (set(), set())
        for task in late:
            task.cancel()
        await asyncio.gather(*late, return_exceptions=True)
        if late:
            self._display.tell(f"not everything could be cleaned up within {CLOSING:g} s")
        for task in done:
            task.result()

    async def _supervised(self) -> int:
        self._measure()
        self._remind_later()
        async with asyncio.TaskGroup() as group:
            tasks = [
                group.create_task(each.run(), name=f"host {host}")
                for host, each in self._commands.items()
                for _ in range(1 if host else ABREAST)
            ]
            code = await self._loop()
            for task in tasks:
                task.cancel()
        return code

    async def _loop(self) -> int:
        actions = self._supervisor.begin(time.monotonic())
        while True:
            for action in actions:
                if isinstance(action, Finish):
                    self._show()
                    return action.code
                self._do(action)
            if self._events.empty() or self._supervisor.up is not self._was_up:
                self._show()
            actions = self._handle(await self._event())

    async def _event(self) -> Event:
        wake = self._supervisor.wake
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(None if wake is None else max(0.0, wake - time.monotonic())):
                return await self._events.get()
        return Tick()

    def _do(self, action: Action) -> None:
        match action:
            case Start(name):
                self._commands_for(name).start(self._processes[name])
            case Stop(name):
                self._commands_for(name).stop(name)
            case Kill(name):
                self._commands_for(name).kill(name)
            case Retry() | GaveUp() | Along() | Stuck():
                pass  # reported already
            case Finish():
                raise AssertionError("`Finish` is handled by the loop")

    def _commands_for(self, name: str) -> HostCommands:
        return self._commands[self._processes[name].host]

    def _handle(self, event: Event) -> list[Action]:
        """Let the policy decide, and report its decision."""
        supervisor = self._supervisor
        before, was_stopping = supervisor.states, supervisor.stopping
        actions = supervisor.handle(event, time.monotonic(), self._chance())
        self._teller.tell(event, before, was_stopping, actions)
        if supervisor.stopping and not was_stopping:
            notify("STOPPING=1")
        return actions

    def _show(self) -> None:
        self._display.states(self._supervisor.states)
        if self._supervisor.up and not self._was_up:
            self._was_up = True
            self._display.up()
            notify("READY=1")
            if self._options.duration is not None:
                self._later("duration", self._options.duration, self._is_over)

    def _is_over(self) -> None:
        self._events.put_nowait(StopRequested(why="time limit reached"))

    def _later(self, what: str, seconds: float, action: Callable[[], None]) -> None:
        self._timers[what] = asyncio.get_running_loop().call_later(seconds, action)

    # Reminders.

    def _remind_later(self) -> None:
        self._later("remind", self._options.remind * min(2**self._reminders, _LONGEST), self._remind)

    def _remind(self) -> None:
        if self._supervisor.stopping:
            return
        waiting = self._teller.remind(self._unreachable)
        self._reminders = self._reminders + 1 if waiting and waiting == self._reminded else 0
        self._reminded = waiting
        self._remind_later()

    # Requests.

    def _interrupted(self, number: int) -> None:
        """The first Ctrl-C stops the network, the second kills it. A second SIGHUP does not: terminals may send two."""
        kills = number == signal.SIGINT and (self._stop_asked.is_set() or self._supervisor.stopping)
        self._stop_asked.set()
        self._events.put_nowait(StopRequested(128 + number, 0.0 if kills else None))

    def ask(self, event: RestartRequested | EndRequested | StopRequested) -> None:
        if self._events.qsize() > REQUESTS:
            raise DeploymentError(f"{self._plan.name} is overloaded; try again")
        if isinstance(event, RestartRequested | EndRequested):
            self._check(event)
        else:
            self._stop_asked.set()
        self._events.put_nowait(event)

    def scout(self, host: str) -> Scout:
        known = {each.name for each in self._plan.hosts}
        agent = self._commands[host].agent if host in known else None
        if not isinstance(agent, Scouted):
            raise DeploymentError(unknown("host", host, known))
        if why := self._unreachable.get(host):
            raise HostUnreachable(f"{host} is out of reach: {why}")
        return agent.scout()

    def _check(self, request: RestartRequested | EndRequested) -> None:
        if self._stop_asked.is_set() or self._supervisor.stopping:
            raise DeploymentError(f"{self._plan.name} is stopping: nothing can be started")
        for name in request.names:
            found = self._supervisor.find(name)
            if not found:
                known = [instance for each in self._plan.processes for instance in each.instances]
                raise DeploymentError(f"{self._plan.name}: {unknown('instance', name, known)}")
            for each in found:
                if self._supervisor.progress[each].is_stuck:
                    raise DeploymentError(f"{each} cannot be started: it was killed but has not ended")
        if isinstance(request, EndRequested):
            self._check_end({each for name in request.names for each in self._supervisor.find(name)})

    def _check_end(self, names: Set[str]) -> None:
        if not self._supervisor.up:
            raise DeploymentError(f"{self._plan.name} is still starting; try again, or stop all of it: rcdeploy down")
        for name in names:
            if why := self._unreachable.get(self._processes[name].host):
                raise HostUnreachable(f"{name} is on {self._processes[name].host}, which is out of reach: {why}")
        if all(state.gone for name, state in self._supervisor.states.items() if name not in names):
            raise DeploymentError(f"{self._plan.name} would end with that: to stop all of it, use rcdeploy down")

    # Events of agents.

    def output(self, name: str, line: str) -> None:
        self._teller.line(name, line)

    def ready(self, name: str) -> None:
        self._events.put_nowait(Ready(name))

    def status(self, name: str, text: str) -> None:
        self._teller.statuses[name] = text

    def left(self, name: str, instance: str) -> None:
        left, instance = self._teller.left[name], self._processes[name].whole(instance)
        if instance in self._processes[name].instances and instance not in left:
            left.append(instance)
            self._events.put_nowait(Left(instance))

    def contract(self, name: str, instance: str, operations: Mapping[str, str]) -> None:
        process = self._processes[name]
        if process.whole(instance) in process.instances:
            self._contracts[process.whole(instance)] = operations

    def hung(self, name: str) -> None:
        self._events.put_nowait(Hung(name))

    def exited(self, name: str, code: int) -> None:
        self._events.put_nowait(Exited(name, code))

    def lost(self, host: str, why: str) -> None:
        self._unreachable[host] = why
        self._commands[host].forget()
        self._events.put_nowait(Lost(host, why))

    def back(self, host: str) -> None:
        self._unreachable.pop(host, None)
        self._events.put_nowait(Back(host))

    # State.

    def _measure(self) -> None:
        for each in self._commands.values():
            self._meter.read(each.agent.usage())
        self._later("measure", MEASURE, self._measure)

    def snapshot(self) -> Snapshot:
        supervisor, now = self._supervisor, time.monotonic()
        usage = {name: used for each in self._commands.values() for name, used in each.agent.usage().items()}
        hosts = tuple(
            HostStatus(
                each.name, each.address, each.name not in self._unreachable, self._unreachable.get(each.name, "")
            )
            for each in self._plan.hosts
        )
        return Snapshot(
            self._plan.name,
            supervisor.up,
            supervisor.stopping,
            supervisor.why,
            now - self._began,
            hosts,
            tuple(self._status_of(name, now, usage) for name in self._processes),
        )

    def _status_of(self, name: str, now: float, used: Mapping[str, Usage]) -> ProcessStatus:
        process, progress = self._processes[name], self._supervisor.progress[name]
        there = not progress.state.gone
        usage = used.get(name) if there else None
        lives = {process.whole(each): life for each, life in usage.lives.items()} if usage else {}
        return ProcessStatus(
            name=name,
            component=process.component,
            instances=process.instances,
            ended=tuple(self._teller.left[name]) if there else (),
            host=process.host,
            state=progress.state,
            how="" if there else self._teller.how.get(name, ""),
            pid=usage.pid if usage else None,
            in_state=max(0.0, now - progress.since),
            uptime=max(0.0, now - progress.started_at) if there else None,
            next_start=max(0.0, progress.not_before - now) if progress.state is State.RESTARTING else None,
            starts=progress.starts,
            restarts=max(0, progress.starts - 1),
            cpu=self._meter.cores(name, usage.pid) if usage else None,
            memory=usage.memory if usage else None,
            calls=usage.calls_per_s if usage else None,
            worst=usage.worst_ms / 1000 if usage else None,
            status=self._teller.statuses.get(name, "") if there else "",
            lives={each: lives[each] for each in process.instances if each in lives},
            contracts={each: self._contracts[each] for each in process.instances if there and each in self._contracts},
        )


def _noticed(done: asyncio.Future[Any]) -> None:
    """Keep asyncio from reporting an unread exception: a cancelled `gather` fails."""
    if not done.cancelled():
        done.exception()


def children(plan: Plan, grace: float) -> list[Child]:
    """The processes of a plan, as their supervisor sees them."""
    needs = _needs(plan)
    keeping = {host.name for host in plan.hosts if host.keep}
    return [
        Child(
            each.name,
            each.after,
            each.restart,
            each.grace if each.grace is not None else grace * len(each.instances),
            each.system,
            each.host,
            each.instances,
            frozenset(needs.get(each.name, ())),
            each.host in keeping,
            ready_after=each.ready_after,
            stops_before=each.stops_before,
        )
        for each in plan.processes
    ]


def _needs(plan: Plan) -> dict[str, set[str]]:
    """The instances that each process needs to become ready: a component waits for those that it requires."""
    process = {instance: each.name for each in plan.processes for instance in each.instances}
    found: dict[str, set[str]] = {}
    for link in plan.links:
        client, provider = process.get(link.client, link.client), process.get(link.provider, link.provider)
        if link.verb is Verb.REQUIRES and client != provider:
            found.setdefault(client, set()).add(link.provider)
    return found


def run(plan: Plan, options: Options, display: Display, services: Sequence[Service] = ()) -> int:
    """Run a plan from synchronous code, with the helper processes of its middlewares.

    Raises TransportError or ConfigurationError if a helper cannot run.
    """
    with contextlib.ExitStack() as end, contextlib.ExitStack() as hosted, contextlib.suppress(asyncio.CancelledError):
        owner = f"rcdeploy {plan.name}"
        for opened in plan.transports:
            if deployment_of(opened.middleware).shares:
                hosted.enter_context(hosting(opened.middleware, TransportConfig(opened.options, owner)))
        for helper in (each for each in plan.helpers if not each.host):
            hosted.enter_context(hosting(helper.middleware, TransportConfig(helper.options, owner)))
        try:
            return asyncio.run(run_plan(plan, options, display, services))
        finally:
            end.enter_context(_undisturbed())
    return 1


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """While entered, a further SIGTERM or SIGHUP does not interrupt the cleanup."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _TERMINATING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
