"""What a deployment does next. Pure: events and the time come in, actions go out; no processes, no clock, no dice.

    WAITING ─▶ STARTING ─▶ READY ─▶ STOPPING ─▶ ENDED or FAILED
       ▲           └────────┴─ failed ─▶ RESTARTING (until its delay is over) ─┐
       └────────────────────────────────────────────────────────────────────────┘

Before everything was ready, a process that is given up stops the network, which cannot come up any more; so does one
that ends, even well, while another that needs it is still starting. A process that is given up later is reported, and
its system's escalation says which others end with it; the rest keeps running. Every start, the first or a later one,
waits until the processes that it depends on are ready. It also waits for the processes whose interfaces it requires,
unless they are gone for good. Stopping goes backwards: a process is told to stop when its dependents and clients are
gone, and killed if it does not stop within its grace. Nothing starts once the network stops.

Several instances may run in one process, which goes on when one of them ends well.
"""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

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


class When(StrEnum):
    """The exits after which a process is started again, unless it was told to end."""

    NEVER = "never"
    ON_FAILURE = "on_failure"
    ALWAYS = "always"


class Escalation(StrEnum):
    """Which other processes are restarted with one, as in Erlang/OTP's supervisors."""

    ONE_FOR_ONE = "one_for_one"
    REST_FOR_ONE = "rest_for_one"
    ONE_FOR_ALL = "one_for_all"


@dataclass(frozen=True, slots=True)
class Restart:
    """Whether and how often a process is started again.

    The first restart comes after `delay` seconds. The delay doubles each time, up to `max_delay`, and varies a little
    so that not all come at once. After `intensity` restarts within `period` seconds the process is given up.
    """

    when: When = When.NEVER
    intensity: int = 5
    period: float = 60.0
    delay: float = 0.2
    max_delay: float = 30.0


@dataclass(frozen=True, slots=True)
class Child:
    """One process, as its supervisor sees it."""

    name: str
    after: tuple[str, ...] = ()
    """Those that must be ready before it is started."""
    restart: Restart = Restart()
    grace: float = 5.0
    """Seconds it has to end by itself, once told to."""
    system: tuple[str, ...] = ()
    """The systems around it, the outermost first."""
    host: str = ""
    instances: tuple[str, ...] = ()
    """Its instances, unless it has just one of its own name."""
    needs: frozenset[str] = frozenset()
    """The instances of others without which it does not become ready."""
    is_kept: bool = False
    """Whether it goes on while its host is out of reach, and is found there again."""
    ready_after: tuple[str, ...] = ()
    """The providers that it requires: it is started when they are ready, or gone for good."""
    stops_before: tuple[str, ...] = ()
    """The providers that it requires, and that are stopped after it."""


class State(StrEnum):
    WAITING = "waiting"
    STARTING = "starting"
    READY = "ready"
    HUNG = "hung"
    STOPPING = "stopping"
    RESTARTING = "restarting"
    """It has failed, and its delay is not over yet."""
    LOST = "lost"
    """Its host is out of reach; it is started again when that is back."""
    ENDED = "ended"
    FAILED = "failed"

    @property
    def gone(self) -> bool:
        """Whether the process does not exist."""
        return self not in _THERE


_RUNNING = frozenset({State.STARTING, State.READY, State.HUNG})
_THERE = _RUNNING | {State.STOPPING}
_ON_ITS_WAY = frozenset({State.WAITING, State.STARTING, State.RESTARTING, State.LOST})

FAILED = 1
UNREACHABLE = 3

UNKILLABLE = 10.0
"""Seconds after which a process that was killed, but has not ended, is given up."""

_HELD_UP = 1.0
"""A delay of this process, in seconds, from which on missed deadlines do not count: the others may be late, too."""

_STOPPED_BY_US = frozenset({0, -signal.SIGTERM, -signal.SIGINT, 128 + signal.SIGTERM, 128 + signal.SIGINT})
"""Exit codes of a process that was told to stop, and did."""


@dataclass(slots=True, eq=False)
class Progress:
    """The progress of a process. Only the supervisor may change it."""

    child: Child
    position: int
    state: State = State.WAITING
    since: float = 0.0
    """When its state changed."""
    starts: int = 0
    started_at: float = 0.0
    not_before: float = 0.0
    """When it may be started again."""
    deadline: float = 0.0
    """When it must have stopped."""
    leaving: bool = False
    """Whether it is to be stopped as soon as those that depend on it and are to be stopped as well are gone."""
    again: bool = False
    """Whether it is to be started then."""
    barred: set[str] = field(default_factory=set)
    """Those that must be gone before it is started."""
    planned: list[float] = field(default_factory=list)
    """The times of its recent restarts, as far as they still count."""
    streak: int = 0
    """Number of its ends since it was last ready for long."""
    ready_at: float | None = None
    is_done: bool = False
    """Whether it was ready, and then ended well: its dependents may start."""
    is_over: bool = False
    """Whether it ended by itself and is `never` started again, but by a user."""
    is_dropped: bool = False
    """Whether it, or the one for whose sake it was stopped, has been given up."""
    is_killed: bool = False
    is_put_off: bool = False
    """Whether it was given its time to stop, or to end after SIGKILL, once more."""
    is_stuck: bool = False
    """Whether it has not ended although it was killed; the others treat it as gone."""

    @property
    def instances(self) -> tuple[str, ...]:
        return self.child.instances or (self.child.name,)


class Supervisor:
    """Decides for `children`, which are in an order in which they can be started.

    `until` names an instance, or a process, whose end is the end of the network. `escalations` are those of systems, by
    path; that of the whole network by the empty one; one_for_one for others. Times are seconds of one clock that never
    goes back, `chance` is a random number from 0 to 1.
    """

    def __init__(
        self,
        children: Iterable[Child],
        until: str | None = None,
        escalations: Mapping[tuple[str, ...], Escalation] | None = None,
    ) -> None:
        self.progress = {child.name: Progress(child, number) for number, child in enumerate(children)}
        self._states = {name: each.state for name, each in self.progress.items()}
        self._count = Counter(self._states.values())
        """Number of processes in each state, so that most events need no loop over all of them."""
        self.up = False
        """Whether every process has been ready, or has done its work."""
        self.stopping = False
        self.why = ""
        """Why it stops."""
        self._until = until
        self._escalations = dict(escalations or {})
        self._dependents: dict[str, list[Progress]] = {name: [] for name in self.progress}
        for each in self.progress.values():
            for name in each.child.after:
                self._dependents[name].append(each)
        self._clients: dict[str, list[Progress]] = {name: list(those) for name, those in self._dependents.items()}
        """Those that are stopped before each."""
        for each in self.progress.values():
            for name in each.child.stops_before:
                self._clients[name].append(each)
        self._lost_hosts: set[str] = set()
        self._now, self._chance = 0.0, 0.5
        self._notices: list[Action] = []
        self._grace: float | None = None
        self._impatient = False
        self._asked = self._fault = 0
        self._finished = False

    @property
    def states(self) -> dict[str, State]:
        """The present states, in the order of the network."""
        return self._states.copy()

    @property
    def wake(self) -> float | None:
        """The time at which a `Tick` is needed if no other event comes before."""
        times: list[float] = []
        if self._count[State.STOPPING]:
            times += [each.deadline for each in self.progress.values() if each.state is State.STOPPING]
        if self._count[State.RESTARTING] and not self.stopping:
            times += [each.not_before for each in self.progress.values() if each.state is State.RESTARTING]
        return min(times, default=None)

    def find(self, name: str) -> list[str]:
        """The processes that a name stands for: of a process, of an instance in it, or of a system around it."""
        path = tuple(name.split("/"))
        return [
            each.child.name
            for each in self.progress.values()
            if name == each.child.name or name in each.instances or each.child.system[: len(path)] == path
        ]

    def awaited(self, name: str) -> list[str]:
        """The processes that a process requires, and that are going to be ready."""
        return [other for other in self.progress[name].child.ready_after if self._is_due(self.progress[other])]

    def grace(self, name: str) -> float:
        """The seconds that a process has to end by itself."""
        return self._grace_of(self.progress[name])

    def begin(self, now: float = 0.0) -> list[Action]:
        return self.handle(Tick(), now)

    def handle(self, event: Event, now: float = 0.0, chance: float = 0.5) -> list[Action]:
        self._now, self._chance, self._notices = now, chance, []
        if self._count[State.STOPPING]:
            self._put_off()
        match event:
            case Ready(name):
                self._ready(self.progress[name])
            case Hung(name):
                if self.progress[name].state in _RUNNING:
                    self._to(self.progress[name], State.HUNG)
            case Exited(name, code):
                self._exited(self.progress[name], code)
            case Left(instance):
                self._left(instance)
            case StopRequested(code, grace, why):
                self._requested(code, grace, why)
            case RestartRequested(names):
                self._restart_for_user([found for name in names for found in self.find(name)])
            case EndRequested(names):
                self._end_for_user([found for name in names for found in self.find(name)])
            case Lost(host):
                self._lost(host)
            case Back(host):
                self._back(host)
            case Tick():
                pass
        if not self.up and not self.stopping:
            self.up = self._count[State.READY] + self._count[State.ENDED] == len(self.progress)
        return [*self._notices, *self._next()]

    def _put_off(self) -> None:
        """Give a process whose time ran out while this one was held up the same time again, but only once."""
        overdue = [
            each
            for each in self.progress.values()
            if each.state is State.STOPPING and each.deadline <= self._now and not each.is_put_off
        ]
        if any(self._now - each.deadline > _HELD_UP for each in overdue) and not self._impatient:
            for each in overdue:
                each.is_put_off = True
                each.deadline = self._now + (UNKILLABLE if each.is_killed else self._grace_of(each))

    # Events.

    def _ready(self, each: Progress) -> None:
        if each.state is State.STARTING:
            each.ready_at = self._now
            self._to(each, State.READY)

    def _exited(self, each: Progress, code: int) -> None:
        was = each.state
        self._gone(each)
        if was.gone:
            each.is_stuck = False
            return
        failed = code != 0 or was is State.HUNG
        if each.again:
            self._wait(each)
        elif was is State.STOPPING:
            self._end(each, not self._is_stopped_well(each, code))
        elif self.stopping or each.leaving:
            self._end(each, failed)
        elif self._is_mission(each) and not failed:
            self._end(each, failed)
            self._stop(f"{self._until} has ended")
        elif not self._restart(each, failed):
            self._end_for_good(each, failed)

    def _end_for_good(self, each: Progress, failed: bool) -> None:
        """It has ended by itself, and is not started again."""
        is_given_up = _is_wanted_again(each.child.restart, failed)
        each.is_over, each.is_dropped = each.child.restart.when is When.NEVER, is_given_up
        each.is_done = each.state is State.READY and not failed
        self._end(each, failed or is_given_up)
        if self._is_mission(each):
            self._stop(f"{self._until} has ended")
        elif not self.up and (each.state is State.FAILED or self._is_missed(each)):
            self._stop(f"{each.child.name} ended before all components were ready", FAILED)
        elif is_given_up:
            self._drop_with(each)

    def _left(self, instance: str) -> None:
        if self.stopping:
            return
        if instance == self._until:
            self._stop(f"{instance} has ended")
        elif not self.up and self._is_needed({instance}):
            self._stop(f"{instance} ended before all components were ready", FAILED)

    def _requested(self, code: int, grace: float | None, why: str) -> None:
        self._grace = grace if grace is not None else self._grace
        if self.stopping:
            self._asked = self._asked or code
            for each in self.progress.values() if grace is not None else ():
                if each.state is State.STOPPING and not each.is_killed:
                    each.deadline = min(each.deadline, self._now + self._grace_of(each))
        else:
            self._stop(why)
            self._asked = code
        self._impatient = self._impatient or grace == 0

    def _restart_for_user(self, names: Collection[str]) -> None:
        if self.stopping:
            return
        asked = [each for name, each in self.progress.items() if name in names]
        group = self._together(asked)
        for each in group:
            each.planned, each.streak, each.not_before = [], 0, self._now
            each.is_dropped = False
            each.is_over = each.is_over and each not in asked
        self._again(group, self._now, by_user=True)
        along = [each for each in group if each not in asked and each.again]
        self._tell_along(along, ", ".join(each.child.name for each in asked), again=True)

    def _end_for_user(self, names: Collection[str]) -> None:
        if self.stopping:
            return
        for each in (self.progress[name] for name in names):
            if each.state is State.LOST:
                continue
            each.again, each.is_dropped = False, True
            if each.state in _RUNNING:
                each.leaving = True
            elif each.state in (State.WAITING, State.RESTARTING):
                self._gone(each)
                self._to(each, State.ENDED)

    def _lost(self, host: str) -> None:
        self._lost_hosts.add(host)
        here = [each for each in self.progress.values() if each.child.host == host and not each.state.gone]
        wanted = [each for each in here if self._is_back_later(each)]
        for each in wanted:
            self._to(each, State.LOST)
        for each in here:
            if each not in wanted:
                self._gone(each)
                each.is_over = True
                self._to(each, State.FAILED)
                self._fail(UNREACHABLE)
        if self.stopping:
            return
        for each in wanted:
            if not each.child.is_kept:
                self._restart_along(each, self._now)
        for each in here:
            if each not in wanted and (self._is_mission(each) or not self.up):
                return self._stop(f"{each.child.name} was lost with its host {host}", UNREACHABLE)

    def _is_back_later(self, each: Progress) -> bool:
        """Whether a process that was lost with its host is to run there again."""
        if self.stopping or (each.leaving and not each.again):
            return False
        return each.again or each.child.is_kept or each.child.restart.when is not When.NEVER

    def _back(self, host: str) -> None:
        self._lost_hosts.discard(host)
        for each in self.progress.values():
            if each.child.host == host and each.state is State.LOST:
                self._gone(each)
                self._wait(each)

    # Starting again, and giving up.

    def _restart(self, each: Progress, failed: bool) -> bool:
        """Whether a process that has ended by itself is started again."""
        restart = each.child.restart
        if not _is_wanted_again(restart, failed):
            return False
        if each.ready_at is not None and self._now - each.ready_at >= max(restart.period, restart.max_delay):
            each.streak = 0
        time = self._now + _delay(restart, each.streak, self._chance)
        each.planned = [earlier for earlier in each.planned if time - earlier < restart.period]
        if len(each.planned) >= restart.intensity:
            self._notices.append(GaveUp(each.child.name, len(each.planned)))
            return False
        each.planned.append(time)
        each.streak += 1
        each.not_before = max(each.not_before, time)
        self._wait(each)
        self._notices.append(Retry(each.child.name, each.not_before - self._now))
        self._restart_along(each, time)
        return True

    def _restart_along(self, each: Progress, time: float) -> None:
        """Those that are started again with this one begin with it, and not before all of them are gone."""
        others = [other for other in self._together([each]) if other is not each]
        idle = [other for other in others if not other.again]
        self._again([each, *others], time)
        self._tell_along([other for other in idle if other.again], each.child.name, again=True)

    def _again(self, group: Collection[Progress], time: float, by_user: bool = False) -> None:
        there = {each.child.name for each in group if not each.state.gone or each.state is State.LOST}
        for each in group:
            if each.state in _RUNNING:
                each.leaving = each.again = True
            elif each.state is State.STOPPING:
                each.again = each.again or by_user
            elif each.state.gone and (each.is_over or each.is_dropped or each.is_stuck):
                continue
            each.not_before = max(each.not_before, time)
            each.barred |= there - {each.child.name}
            if each.state.gone and each.state is not State.LOST:
                self._wait(each)

    def _together(self, those: Collection[Progress]) -> list[Progress]:
        """These, and the processes that are restarted with them, in the order of the network."""
        found = {other.position: other for each in those for other in self._taken_along([each], each.child.system)}
        return [found[position] for position in sorted(found)]

    def _taken_along(self, those: Collection[Progress], path: tuple[str, ...]) -> list[Progress]:
        """These, and the processes that end or restart with them, by the escalation of a system."""
        inside = [other for other in self.progress.values() if other.child.system[: len(path)] == path]
        match self._escalation(path):
            case Escalation.ONE_FOR_ONE:
                return list(those)
            case Escalation.REST_FOR_ONE:
                first = min(each.position for each in those)
                return [other for other in inside if other in those or other.position > first]
            case Escalation.ONE_FOR_ALL:
                return inside

    def _escalation(self, path: tuple[str, ...]) -> Escalation:
        return self._escalations.get(path, Escalation.ONE_FOR_ONE)

    def _drop_with(self, given_up: Progress) -> None:
        """A process has been given up: also end those that are of no use without it, from the inner system outwards."""
        path = given_up.child.system
        those: list[Progress] = [given_up]
        while self._escalation(path) is not Escalation.ONE_FOR_ONE:
            those = self._taken_along(those, path)
            if not path:
                break
            path = path[:-1]
        if len(those) == len(self.progress) > 1:
            return self._stop(f"every component depends on {given_up.child.name}", FAILED)
        if any(self._is_mission(each) for each in those):
            return self._stop(f"{self._until} depends on the failed {given_up.child.name}", FAILED)
        dropped = [each for each in those if each.state not in (State.ENDED, State.FAILED)]
        for each in dropped:
            each.is_dropped = True
            each.again = False
            if each.state in _RUNNING:
                each.leaving = True
            elif each.state is not State.STOPPING:
                self._gone(each)
                self._to(each, State.ENDED)
        self._tell_along(dropped, given_up.child.name, again=False)

    # Next steps.

    def _next(self) -> list[Action]:
        actions: list[Action] = []
        for each in reversed(self.progress.values()):
            if each.leaving or each.state is State.STOPPING:
                actions += self._stop_if_free(each)
        if not self.stopping and (self._count[State.WAITING] or self._count[State.RESTARTING]):
            for each in self.progress.values():
                if each.state is State.WAITING or each.state is State.RESTARTING:
                    actions += self._start_if_free(each)
        if not self._finished and self._is_at_end():
            self._finished = True
            if any(each.state is State.WAITING for each in self.progress.values()) and not self.stopping:
                self._fail(FAILED)  # the process that it waits for will not start
            actions.append(Finish(self._fault or self._asked))
        return actions

    def _is_at_end(self) -> bool:
        if any(self._count[state] for state in _THERE):
            return False
        return self.stopping or not any(map(self._is_coming, self.progress.values()))

    def _is_coming(self, each: Progress) -> bool:
        """Whether a process that does not run will start without the help of a running one."""
        is_held_up = each.state is State.WAITING and each.child.host in self._lost_hosts
        return is_held_up or each.state in (State.RESTARTING, State.LOST)

    def _start_if_free(self, each: Progress) -> list[Action]:
        if each.state is State.RESTARTING and each.not_before <= self._now:
            self._to(each, State.WAITING)
        if each.state is not State.WAITING or each.barred or each.child.host in self._lost_hosts:
            return []
        if not all(self._has_been_ready(self.progress[name]) for name in each.child.after):
            return []
        if self.awaited(each.child.name):
            return []
        each.starts, each.started_at = each.starts + 1, self._now
        each.ready_at = None
        each.is_done = each.is_killed = each.is_put_off = False
        self._to(each, State.STARTING)
        return [Start(each.child.name)]

    def _stop_if_free(self, each: Progress) -> list[Action]:
        name = each.child.name
        if each.state in _RUNNING and each.leaving and not self._is_used(each):
            each.deadline = self._now + self._grace_of(each)
            self._to(each, State.STOPPING)
            if not self._impatient:
                return [Stop(name)]
        if each.state is not State.STOPPING or each.deadline > self._now:
            return []
        if not each.is_killed:
            each.is_killed, each.is_put_off = True, False
            each.deadline = self._now + UNKILLABLE
            return [Kill(name)]
        self._gone(each)
        each.is_stuck = True
        self._end(each, failed=True)
        return [Stuck(name)]

    def _is_used(self, each: Progress) -> bool:
        """Whether a process depends on it that has to stop first."""
        if self._impatient:
            return False
        return any(other.leaving and not other.state.gone for other in self._clients[each.child.name])

    # Small steps.

    def _tell_along(self, those: Collection[Progress], sake: str, again: bool) -> None:
        if those:
            self._notices.append(Along(tuple(each.child.name for each in those), sake, again))

    def _to(self, each: Progress, state: State) -> None:
        self._count[each.state] -= 1
        self._count[state] += 1
        self._states[each.child.name] = each.state = state
        each.since = self._now

    def _wait(self, each: Progress) -> None:
        """Let it wait until it may be started, for the first time or again."""
        each.leaving = each.again = each.is_over = False
        self._to(each, State.RESTARTING if each.not_before > self._now else State.WAITING)

    def _end(self, each: Progress, failed: bool) -> None:
        each.leaving = each.again = False
        self._to(each, State.FAILED if failed else State.ENDED)
        if failed:
            self._fail(FAILED)

    def _gone(self, each: Progress) -> None:
        """No process has to wait any longer for its end."""
        for other in self.progress.values():
            other.barred.discard(each.child.name)

    def _fail(self, code: int) -> None:
        self._fault = self._fault or code

    def _stop(self, why: str, fault: int = 0) -> None:
        self._fail(fault)
        if self.stopping:
            return
        self.stopping, self.why = True, why
        for each in self.progress.values():
            each.leaving, each.again = not each.state.gone, False
            if each.state is State.RESTARTING:
                self._to(each, State.ENDED)
            elif each.state is State.LOST:
                self._fail(UNREACHABLE)

    def _grace_of(self, each: Progress) -> float:
        return each.child.grace if self._grace is None else self._grace

    def _is_mission(self, each: Progress) -> bool:
        return self._until == each.child.name or self._until in each.instances

    def _is_stopped_well(self, each: Progress, code: int) -> bool:
        if each.ready_at is None and not each.is_killed and code == FAILED:
            return True  # what it needed to become ready was stopped with it
        return code in _STOPPED_BY_US or (self._impatient and code == -signal.SIGKILL)

    def _is_due(self, each: Progress) -> bool:
        """Whether it is not ready, and only its own start keeps it from that."""
        if each.child.host in self._lost_hosts:
            return False
        return each.again or each.state in (State.WAITING, State.STARTING, State.RESTARTING)

    def _has_been_ready(self, each: Progress) -> bool:
        return each.state is State.READY or each.is_done

    def _is_missed(self, each: Progress) -> bool:
        """Whether a process cannot become ready now that this one has ended."""
        waiting = [other for other in self._dependents[each.child.name] if other.state in _ON_ITS_WAY]
        return (bool(waiting) and not each.is_done) or self._is_needed(each.instances)

    def _is_needed(self, instances: Collection[str]) -> bool:
        """Whether a process cannot become ready without one of these."""
        coming = (each for each in self.progress.values() if each.state in _ON_ITS_WAY)
        return any(not each.child.needs.isdisjoint(instances) for each in coming)


def _is_wanted_again(restart: Restart, failed: bool) -> bool:
    return restart.when is When.ALWAYS or (restart.when is When.ON_FAILURE and failed)


def _delay(restart: Restart, streak: int, chance: float) -> float:
    doubled = min(restart.delay * 2.0 ** min(streak, 63), restart.max_delay)
    return min(doubled * (0.8 + 0.4 * chance), restart.max_delay)
