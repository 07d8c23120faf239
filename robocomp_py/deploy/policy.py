"""What a deployment does next. Pure: events in, actions out; no processes, no clock.

    WAITING ─Start→ STARTING ─Ready→ READY ─Stop→ STOPPING ─Exited→ GONE

A process that fails before everything was ready stops the network, which cannot come up any
more; so does one that ends, however well, while another that needs it is still on its way. Whoever
dies later is reported, and the others go on. Stopping goes backwards: a process is told to stop
when those that depend on it are gone, and killed if it does not within its grace.

Several instances may run in one process, which goes on when one of them ends well.
"""

from __future__ import annotations

import signal
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum


class When(StrEnum):
    """After which end a process is started again, unless it was told to end."""

    NEVER = "never"
    ON_FAILURE = "on_failure"
    ALWAYS = "always"


class Escalation(StrEnum):
    """Who else is started again with a process, as in Erlang/OTP's supervisors."""

    ONE_FOR_ONE = "one_for_one"
    REST_FOR_ONE = "rest_for_one"
    ONE_FOR_ALL = "one_for_all"


@dataclass(frozen=True, slots=True)
class Restart:
    """Whether and how often a process is started again.

    The first time after `delay` seconds, then after twice as many each time, up to `max_delay`, each a little more or
    less so that not all come at once. After `intensity` restarts within `period` seconds it is given up.
    """

    when: When = When.NEVER
    intensity: int = 5
    period: float = 60.0
    delay: float = 0.2
    max_delay: float = 30.0


@dataclass(frozen=True, slots=True)
class Ready:
    name: str


@dataclass(frozen=True, slots=True)
class Exited:
    """`code` is negative for a signal, as in subprocess."""

    name: str
    code: int


@dataclass(frozen=True, slots=True)
class Left:
    """An instance has ended whose process goes on."""

    instance: str


@dataclass(frozen=True, slots=True)
class StopRequested:
    """Somebody (`code` is what to exit with if all else is fine) or the clock (0) wants an end."""

    code: int = 0


@dataclass(frozen=True, slots=True)
class GraceOver:
    """A process was told to stop, and has had its time."""

    name: str


Event = Ready | Exited | Left | StopRequested | GraceOver


@dataclass(frozen=True, slots=True)
class Start:
    name: str


@dataclass(frozen=True, slots=True)
class Stop:
    name: str


@dataclass(frozen=True, slots=True)
class Kill:
    name: str


@dataclass(frozen=True, slots=True)
class Finish:
    code: int


Action = Start | Stop | Kill | Finish


class State(StrEnum):
    WAITING = "waiting"
    STARTING = "starting"
    READY = "ready"
    STOPPING = "stopping"
    ENDED = "ended"
    FAILED = "failed"

    @property
    def gone(self) -> bool:
        return self in (State.WAITING, State.ENDED, State.FAILED)


FAILED = 1
_STOPPED_BY_US = frozenset({0, -signal.SIGTERM, -signal.SIGINT, 128 + signal.SIGTERM, 128 + signal.SIGINT})
"""Exit codes of a process that was told to stop, and did."""


class Supervisor:
    """`after` names, for each process, those that must be ready before it starts.

    `until` names an instance, or a process, whose end is the end of the network. `needs` names, for each process, the
    instances of others without which it does not become ready; `instances` those in it, if it has not just one of
    its own name.
    """

    def __init__(
        self,
        after: Iterable[tuple[str, Iterable[str]]],
        until: str | None = None,
        needs: Mapping[str, Iterable[str]] | None = None,
        instances: Mapping[str, Iterable[str]] | None = None,
    ) -> None:
        self._after = {name: frozenset(others) for name, others in after}
        self._needs = {name: frozenset(others) for name, others in (needs or {}).items()}
        self._instances = {name: frozenset((instances or {}).get(name, (name,))) for name in self._after}
        self._until = until
        self.states = dict.fromkeys(self._after, State.WAITING)
        self.up = False
        """Whether everything has been ready, or has done its work."""
        self.stopping = False
        self._done: set[str] = set()
        """Who was ready, and then ended well: whoever starts after it may start."""
        self._impatient = False
        self._code = 0
        self._finished = False

    def begin(self) -> list[Action]:
        return self._next()

    def handle(self, event: Event) -> list[Action]:
        match event:
            case Ready(name):
                if self.states[name] is State.STARTING:
                    self.states[name] = State.READY
            case Exited(name, code):
                self._exited(name, code)
            case Left(instance):
                self._left(instance)
            case StopRequested(code):
                if self.stopping:
                    return self._kill_all(code) if code else []
                self._stop(code)
            case GraceOver(name):
                return [Kill(name)] if self.states[name] is State.STOPPING else []
        if not self.stopping:
            self.up = self.up or all(state in (State.READY, State.ENDED) for state in self.states.values())
        return self._next()

    def _exited(self, name: str, code: int) -> None:
        was = self.states[name]
        self.states[name] = State.ENDED if self._is_fine(was, code) else State.FAILED
        if self.states[name] is State.FAILED:
            self._code = FAILED
        elif was is State.READY:
            self._done.add(name)
        if self._until == name or self._until in self._instances[name]:
            self._stop(self._code)
        elif not (self.up or self.stopping) and (self.states[name] is State.FAILED or self._is_missed(name)):
            self._stop(FAILED)

    def _left(self, instance: str) -> None:
        if instance == self._until:
            self._stop(self._code)
        elif not (self.up or self.stopping) and self._is_needed({instance}):
            self._stop(FAILED)

    def _is_fine(self, was: State, code: int) -> bool:
        if was is not State.STOPPING:
            return code == 0
        return code in _STOPPED_BY_US or (self._impatient and code == -signal.SIGKILL)

    def _is_missed(self, name: str) -> bool:
        """Whether somebody cannot become ready now that this one has ended."""
        waiting = [other for other in self._coming() if name in self._after[other] and name not in self._done]
        return bool(waiting) or self._is_needed(self._instances[name])

    def _is_needed(self, instances: Collection[str]) -> bool:
        """Whether somebody cannot become ready without one of these."""
        return any(not self._needs.get(other, frozenset()).isdisjoint(instances) for other in self._coming())

    def _coming(self) -> list[str]:
        return [name for name, state in self.states.items() if state in (State.WAITING, State.STARTING)]

    def _stop(self, code: int) -> None:
        self.stopping = True
        self._code = self._code or code

    def _next(self) -> list[Action]:
        """What can be done now."""
        actions: list[Action] = []
        for name in reversed(self.states) if self.stopping else self.states:
            if self.stopping:
                actions += self._stop_if_free(name)
            elif self.states[name] is State.WAITING and self._can_start(name):
                self.states[name] = State.STARTING
                actions.append(Start(name))
        over = all(state.gone for state in self.states.values()) and not actions
        if over and not self._finished:
            self._finished = True
            actions.append(Finish(self._code))
        return actions

    def _can_start(self, name: str) -> bool:
        return all(self.states[other] is State.READY or other in self._done for other in self._after[name])

    def _stop_if_free(self, name: str) -> list[Action]:
        dependents = [other for other, after in self._after.items() if name in after]
        alive = self.states[name] in (State.STARTING, State.READY)
        if not alive or not all(self.states[other].gone for other in dependents):
            return []
        self.states[name] = State.STOPPING
        return [Stop(name)]

    def _kill_all(self, code: int) -> list[Action]:
        """Somebody is out of patience, and what is killed then has not failed."""
        self._impatient = True
        self._code = self._code or code
        alive = [name for name, state in self.states.items() if not state.gone]
        for name in alive:
            self.states[name] = State.STOPPING
        return [Kill(name) for name in reversed(alive)]
