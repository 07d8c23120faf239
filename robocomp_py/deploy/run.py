"""Runs a plan: one queue of events, one loop that does what the policy says."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections import deque
from dataclasses import dataclass
from typing import Protocol

from ..errors import DeploymentError
from .plan import Plan
from .policy import Event, Exited, Finish, GraceOver, Kill, Ready, Start, State, Stop, StopRequested, Supervisor
from .processes import Launcher

GRACE = 5.0
"""Seconds a process has to end by itself, once told to."""

LAST_LINES = 20


class Display(Protocol):
    """Where people look."""

    def line(self, name: str, text: str) -> None:
        """A line of a component's output."""

    def states(self, states: dict[str, State]) -> None:
        """How all are, after a change."""

    def up(self) -> None:
        """Everything is ready."""

    def died(self, name: str, code: int, last: list[str]) -> None:
        """A component ended that should not have, or failed; its last lines."""

    def stopping(self, why: str) -> None: ...


@dataclass(frozen=True)
class Options:
    duration: float | None = None
    """Seconds to stay up, counted from when everything is ready; None is until stopped."""
    until: str | None = None
    """The instance whose end is the end of the network."""


async def run_plan(plan: Plan, options: Options, display: Display) -> int:
    """Start a network, watch it, stop it. Returns the exit code: 0, 1, or 128 + the signal that stopped it."""
    return await _Run(plan, options, display).run()


class _Run:
    def __init__(self, plan: Plan, options: Options, display: Display) -> None:
        self._processes = {process.name: process for process in plan.processes}
        self._options, self._display = options, display
        self._supervisor = Supervisor(((p.name, p.after) for p in plan.processes), options.until)
        self._events: asyncio.Queue[Event] = asyncio.Queue()
        self._last: dict[str, deque[str]] = {name: deque(maxlen=LAST_LINES) for name in self._processes}
        self._launcher = Launcher(self._output, self._ready, self._exited)
        self._was_up = False
        self._timers: list[asyncio.TimerHandle] = []

    async def run(self) -> int:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._interrupted, number)
        await self._launcher.open()
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
                match action:
                    case Start(name):
                        await self._start(name)
                    case Stop(name):
                        self._launcher.stop(name)
                        self._after(GRACE, GraceOver(name))
                    case Kill(name):
                        self._launcher.kill(name)
                    case Finish(code):
                        return code
            self._show()
            event = await self._events.get()
            self._report(event)
            actions = self._supervisor.handle(event)

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

    def _report(self, event: Event) -> None:
        supervisor = self._supervisor
        match event:
            case Exited(name, code):
                expected = supervisor.states[name] is State.STOPPING or (code == 0 and name == self._options.until)
                if not expected or (code not in (0, 130, 143, -15, -2)):
                    self._display.died(name, code, list(self._last[name]))
                elif name == self._options.until:
                    self._display.stopping(f"{name} has ended")
            case StopRequested(code):
                again = supervisor.stopping
                self._display.stopping("killing what is left" if again else "asked to" if code else "time is over")
            case Ready() | GraceOver():
                pass

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


def run(plan: Plan, options: Options, display: Display) -> int:
    """`run_plan`, from code that is not asynchronous."""
    with contextlib.suppress(asyncio.CancelledError):
        return asyncio.run(run_plan(plan, options, display))
    return 1
