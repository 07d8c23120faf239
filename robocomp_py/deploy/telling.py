"""Reports the events of a running network in sentences: what happened, and what follows."""

from __future__ import annotations

import signal
from collections.abc import Collection, Mapping, Sequence
from typing import Protocol

from .events import (
    Action,
    Along,
    Back,
    EndRequested,
    Event,
    Exited,
    GaveUp,
    Hung,
    Kill,
    Left,
    Lost,
    Ready,
    RestartRequested,
    Retry,
    Start,
    StopRequested,
    Stuck,
    Tick,
)
from .plan import Plan
from .policy import State, Supervisor


class Display(Protocol):
    """Where events are shown."""

    def line(self, name: str, text: str) -> None:
        """A line of a component's output."""

    def states(self, states: dict[str, State]) -> None:
        """The states of all processes, after a change."""

    def up(self) -> None:
        """Everything is ready."""

    def waiting(self, names: list[str]) -> None:
        """Some processes are not ready yet: their names, with the reason if known."""

    def ended(self, name: str, how: str) -> None:
        """A component has ended without an error."""

    def failed(self, name: str, how: str) -> None:
        """A component failed; `how` says what follows. `line` has shown its own output."""

    def tell(self, text: str) -> None:
        """Any other event of the network."""

    def stopping(self, why: str) -> None: ...


class Teller:
    """Reports events on a display. What it remembers of each process also serves `rcdeploy status`."""

    def __init__(self, plan: Plan, until: str | None, supervisor: Supervisor, display: Display) -> None:
        self._plan, self._until, self._supervisor, self._display = plan, until, supervisor, display
        self._processes = {process.name: process for process in plan.processes}
        self._killed: dict[str, str] = {}
        """The processes that rcdeploy killed, with the words to report it."""
        self.statuses: dict[str, str] = {}
        """The status that each process has reported."""
        self.left: dict[str, list[str]] = {name: [] for name in self._processes}
        """The instances that have ended while their process goes on."""
        self.how: dict[str, str] = {}
        """How each process ended last."""

    def line(self, name: str, text: str) -> None:
        self._display.line(name, text)

    def tell(self, event: Event, before: Mapping[str, State], was_stopping: bool, actions: Sequence[Action]) -> None:
        """Report an event that the supervisor has handled."""
        self._tell_event(event, before, was_stopping, actions)
        if self._supervisor.stopping and not was_stopping:
            self._display.stopping(self._supervisor.why)
        for action in actions:
            self._tell_action(action, is_late=isinstance(event, Tick))

    def remind(self, unreachable: Collection[str]) -> list[str]:
        """Say which processes are not ready yet. Returns what was said."""
        found = self._supervisor.states.items()
        waiting = [self._reason(name, unreachable) for name, state in found if state in _NOT_READY_YET]
        if waiting:
            self._display.waiting(waiting)
        return waiting

    def _tell_event(
        self, event: Event, before: Mapping[str, State], was_stopping: bool, actions: Sequence[Action]
    ) -> None:
        match event:
            case Exited(name, code):
                self._tell_exit(name, code, before[name], [each for each in actions if _is_about(each, name)])
            case Left(instance):
                if instance != self._until:
                    self._display.ended(instance, "has ended")
            case Ready(name):
                if before[name] is State.STARTING and self._supervisor.progress[name].starts > 1:
                    self._display.tell(f"{name} is ready again")
            case Hung(name):
                self._display.tell(f"{name} does not answer its watchdog and is being ended")
            case Lost(host, why):
                self._tell_lost(host, why, [name for name, state in before.items() if self._is_at(host, name, state)])
            case Back(host):
                self._display.tell(f"{host} is back")
            case StopRequested(_, grace):
                if was_stopping and grace == 0:
                    self._display.stopping("killing what is left")
            case RestartRequested(names):
                if not was_stopping:
                    self._display.tell(f"restart of {', '.join(names)} requested")
            case EndRequested(names):
                if not was_stopping:
                    self._display.tell(f"stop of {', '.join(names)} requested")
                    found = {one for name in names for one in self._supervisor.find(name)}
                    ended = {one for one in found if before[one] in (State.ENDED, State.FAILED)}
                    self.how |= dict.fromkeys(found - ended, "was stopped by the user")
            case Tick():
                pass

    def _tell_action(self, action: Action, is_late: bool) -> None:
        match action:
            case Start(name):
                self.left[name].clear()
                for texts in (self._killed, self.statuses):
                    texts.pop(name, None)
            case Kill(name):
                late = f"did not stop within {self._supervisor.grace(name):g} s; killed"
                self._killed[name] = late if is_late else "was killed"
            case Along(names, sake, again):
                verb = "are" if len(names) > 1 else "is"
                reason = f"started again with {sake}" if again else f"stopped: {sake} has been given up"
                if not again:
                    self.how |= dict.fromkeys(names, reason)
                self._display.tell(f"{', '.join(names)} {verb} {reason}")
            case Stuck(name):
                self._display.tell(f"{name} was killed but has not ended; end it by hand")
            case _:
                pass  # it is visible, or was reported with the end of a process

    def _tell_exit(self, name: str, code: int, was: State, actions: Sequence[Action]) -> None:
        if was.gone:
            return  # it was lost with its host, or took very long to end when it was killed
        killed = self._killed.get(name) if code == -signal.SIGKILL else None
        hung = "did not answer its watchdog; " if was is State.HUNG else ""
        how = f"{hung}{killed or _how(code)}{''.join(map(self._given_up, actions))}"
        state = self._supervisor.states[name]
        if not (state is State.ENDED and self._supervisor.progress[name].is_dropped):  # a better reason is known
            self.how[name] = how
        how += "".join(map(_retried, actions))
        is_mission = self._until in (name, *self._processes[name].instances)
        is_tried_again = state in (State.WAITING, State.STARTING, State.RESTARTING)
        if state is State.FAILED or (is_tried_again and (code or hung) and was is not State.STOPPING):
            self._display.failed(name, how)
        elif killed or (was is not State.STOPPING and not is_mission):
            self._display.ended(name, how)

    def _given_up(self, action: Action) -> str:
        if not isinstance(action, GaveUp):
            return ""
        times = f"{action.restarts} restart{'' if action.restarts == 1 else 's'}"
        return f"; given up after {times} in {self._processes[action.name].restart.period:g} s"

    def _is_at(self, host: str, name: str, state: State) -> bool:
        return self._processes[name].host == host and not state.gone

    def _tell_lost(self, host: str, why: str, names: Sequence[str]) -> None:
        self._display.tell(f"{host} is out of reach: {why}")
        if not names:
            return
        gone = {instance for name in names for instance in self._processes[name].instances}
        missed = dict.fromkeys(
            f"{link.interface} of {link.source} by {link.client}"
            for link in self._plan.links
            if link.provider in gone and link.client not in gone
        )
        self.how |= dict.fromkeys(names, f"lost with {host}")
        self._display.tell(f"lost with it: {', '.join(names)}")
        if missed:
            self._display.tell(f"missed: {', '.join(missed)}")

    def _reason(self, name: str, unreachable: Collection[str]) -> str:
        states, process = self._supervisor.states, self._processes[name]
        if states[name] is not State.WAITING:
            return f"{name} ({self.statuses[name]})" if self.statuses.get(name) else name
        if process.host in unreachable:
            return f"{name} ({process.host} is out of reach)"
        barred = self._supervisor.progress[name].barred
        progress = self._supervisor.progress
        after = [
            each
            for each in process.after
            if states[each] is not State.READY and not progress[each].is_done and each not in barred
        ]
        after += [each for each in self._supervisor.awaited(name) if each not in after]
        return f"{name} (after {', '.join([*after, *(f'the end of {each}' for each in sorted(barred))])})"


_NOT_READY_YET = (State.WAITING, State.STARTING)


def _is_about(action: Action, name: str) -> bool:
    return isinstance(action, Retry | GaveUp) and action.name == name


def _retried(action: Action) -> str:
    if not isinstance(action, Retry):
        return ""
    return f"; started again in {action.seconds:.1f} s" if action.seconds >= 0.05 else "; started again at once"


def _how(code: int) -> str:
    if code < 0:
        return f"was ended by signal {-code}"
    return f"ended with exit code {code}" if code else "has ended"
