"""Runs a plan: one queue of events, one loop that does what the policy says."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections import deque
from dataclasses import dataclass
from typing import Protocol

from ..contract.interface import Verb
from ..errors import DeploymentError
from ..transports.base import TransportConfig, hosting
from .plan import Plan
from .policy import (
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
from .processes import Launcher

GRACE = 5.0
"""Seconds a process has to end by itself, once told to, for each component in it: they end one after the other."""

REMIND = 5.0
"""Seconds between two messages that say who is not ready yet."""

LAST_LINES = 20


class Display(Protocol):
    """Where people look."""

    def line(self, name: str, text: str) -> None:
        """A line of a component's output."""

    def states(self, states: dict[str, State]) -> None:
        """How all are, after a change."""

    def up(self) -> None:
        """Everything is ready."""

    def waiting(self, whom: list[str]) -> None:
        """Some are not ready yet: who, and why if that is known."""

    def ended(self, name: str, how: str) -> None:
        """A component is gone, which is worth a word, but nothing is wrong with it."""

    def failed(self, name: str, how: str, last: list[str]) -> None:
        """A component failed; its last lines."""

    def stopping(self, why: str) -> None: ...


@dataclass(frozen=True)
class Options:
    duration: float | None = None
    """Seconds to stay up, counted from when everything is ready; None is until stopped."""
    until: str | None = None
    """The instance whose end is the end of the network."""
    grace: float = GRACE
    remind: float = REMIND


async def run_plan(plan: Plan, options: Options, display: Display) -> int:
    """Start a network, watch it, stop it. Returns the exit code: 0, 1, or 128 + the signal that stopped it."""
    return await _Run(plan, options, display).run()


class _Run:
    def __init__(self, plan: Plan, options: Options, display: Display) -> None:
        self._processes = {process.name: process for process in plan.processes}
        self._options, self._display = options, display
        self._supervisor = Supervisor(
            ((p.name, p.after) for p in plan.processes),
            options.until,
            _needs(plan),
            {p.name: p.instances for p in plan.processes},
        )
        self._events: asyncio.Queue[Event] = asyncio.Queue()
        self._last: dict[str, deque[str]] = {name: deque(maxlen=LAST_LINES) for name in self._processes}
        self._launcher = Launcher(self._output, self._ready, self._exited, self._said, self._left)
        self._statuses: dict[str, str] = {}
        self._killed: dict[str, str] = {}
        """Who was killed by us, and how to say so."""
        self._was_up = False
        self._timers: list[asyncio.TimerHandle] = []

    async def run(self) -> int:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._interrupted, number)
        await self._launcher.open()
        self._remind_later()
        try:
            return await self._loop()
        finally:
            for timer in self._timers:
                timer.cancel()
            await self._launcher.close()

    async def _loop(self) -> int:
        actions = self._supervisor.begin()
        while True:
            for action in actions:
                if isinstance(action, Finish):
                    return action.code
                await self._do(action)
            self._show()
            actions = self._handle(await self._events.get())

    async def _do(self, action: Action) -> None:
        match action:
            case Start(name):
                await self._start(name)
            case Stop(name):
                self._launcher.stop(name)
                self._after(self._grace(name), GraceOver(name))
            case Kill(name):
                self._launcher.kill(name)
            case Finish():
                raise AssertionError("the end is no deed")

    def _handle(self, event: Event) -> list[Action]:
        """Have the policy decide, and tell what is worth telling."""
        supervisor = self._supervisor
        before, was_stopping = dict(supervisor.states), supervisor.stopping
        actions = supervisor.handle(event)
        match event:
            case Exited(name, code):
                self._report_exit(name, code, before[name])
                if supervisor.stopping and not was_stopping:
                    whose = self._options.until in (name, *self._processes[name].instances)
                    self._tell_end(self._options.until if whose else name)
            case Left(instance):
                if instance != self._options.until:
                    self._display.ended(instance, "has ended")
                if supervisor.stopping and not was_stopping:
                    self._tell_end(instance)
            case StopRequested(code):
                if not was_stopping:
                    self._display.stopping("asked to" if code else "time is over")
                elif code:
                    self._display.stopping("killing what is left")
            case Ready() | GraceOver():
                pass
        for action in actions:
            if isinstance(action, Kill):
                late = f"did not stop within {self._grace(action.name):g} s; killed"
                self._killed[action.name] = late if isinstance(event, GraceOver) else "was killed"
        return actions

    def _tell_end(self, name: str | None) -> None:
        """Why an end is the end of the network."""
        why = "has ended" if name == self._options.until else "is gone before everything was ready"
        self._display.stopping(f"{name} {why}")

    def _report_exit(self, name: str, code: int, was: State) -> None:
        killed = self._killed.get(name) if code == -signal.SIGKILL else None
        if self._supervisor.states[name] is State.FAILED:
            self._display.failed(name, killed or _how(code), list(self._last[name]))
        elif killed or (
            was is not State.STOPPING and self._options.until not in (name, *self._processes[name].instances)
        ):
            self._display.ended(name, killed or _how(code))

    def _grace(self, name: str) -> float:
        return self._options.grace * len(self._processes[name].instances)

    async def _start(self, name: str) -> None:
        try:
            await self._launcher.start(self._processes[name])
        except DeploymentError as exc:
            self._output(name, str(exc))
            self._exited(name, 127)

    def _show(self) -> None:
        self._display.states(dict(self._supervisor.states))
        if self._supervisor.up and not self._was_up:
            self._was_up = True
            self._display.up()
            if self._options.duration is not None:
                self._after(self._options.duration, StopRequested())

    def _remind_later(self) -> None:
        self._timers.append(asyncio.get_running_loop().call_later(self._options.remind, self._remind))

    def _remind(self) -> None:
        if self._supervisor.up or self._supervisor.stopping:
            return
        self._timers = [timer for timer in self._timers if timer.when() > asyncio.get_running_loop().time()]
        self._display.waiting(
            [self._reason(name) for name, state in self._supervisor.states.items() if state in _NOT_YET]
        )
        self._remind_later()

    def _reason(self, name: str) -> str:
        states = self._supervisor.states
        if states[name] is State.WAITING:
            missing = [each for each in self._processes[name].after if states[each] in _NOT_YET]
            return f"{name} (after {', '.join(missing)})"
        return f"{name} ({self._statuses[name]})" if self._statuses.get(name) else name

    def _after(self, seconds: float, event: Event) -> None:
        self._timers.append(asyncio.get_running_loop().call_later(seconds, self._events.put_nowait, event))

    def _interrupted(self, number: int) -> None:
        self._events.put_nowait(StopRequested(128 + number))

    def _output(self, name: str, line: str) -> None:
        self._last[name].append(line)
        self._display.line(name, line)

    def _ready(self, name: str) -> None:
        self._events.put_nowait(Ready(name))

    def _exited(self, name: str, code: int) -> None:
        self._events.put_nowait(Exited(name, code))

    def _left(self, name: str, instance: str) -> None:
        if instance in self._processes[name].instances:
            self._events.put_nowait(Left(instance))

    def _said(self, name: str, status: str) -> None:
        self._statuses[name] = status


_NOT_YET = (State.WAITING, State.STARTING)


def _needs(plan: Plan) -> dict[str, set[str]]:
    """Without which instances each process does not become ready: a component waits for what it requires."""
    process = {instance: each.name for each in plan.processes for instance in each.instances}
    found: dict[str, set[str]] = {}
    for link in plan.links:
        client, provider = process.get(link.client, link.client), process.get(link.provider, link.provider)
        if link.verb is Verb.REQUIRES and client != provider:
            found.setdefault(client, set()).add(link.provider)
    return found


def _how(code: int) -> str:
    if code < 0:
        return f"was ended by signal {-code}"
    return f"ended with exit code {code}" if code else "has ended"


def run(plan: Plan, options: Options, display: Display) -> int:
    """`run_plan`, from code that is not asynchronous, with what its middlewares need to be there first.

    Raises TransportError or ConfigurationError if that cannot be had.
    """
    with contextlib.ExitStack() as hosted, contextlib.suppress(asyncio.CancelledError):
        for opened in plan.transports:
            hosted.enter_context(hosting(opened.middleware, TransportConfig(opened.options, f"rcdeploy {plan.name}")))
        return asyncio.run(run_plan(plan, options, display))
    return 1
