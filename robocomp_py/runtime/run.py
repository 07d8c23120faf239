"""Runs a component: from its worker class and settings to its end."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import itertools
import logging
import re
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from .. import installed
from ..contract.component import Port
from ..contract.parameters import build
from ..contract.statemachine import label
from ..errors import Closed, ComponentError, ConfigurationError, RobocompError
from ..threads import start_thread
from ..transports import headroom
from ..transports.base import TransportFactory, find_transport
from ..wire import names
from . import tally
from .clock import NEVER, SECOND, Clock, Real, Virtual
from .commandline import configure_logging, exit_code, parser_of, prepare, print_config, tell_notes
from .commonbehavior import CommonBehavior
from .connections import Connections
from .ending import STUCK, announced, end_after, grace_of, settle
from .hooks import Hooks
from .introspecting import Introspection
from .lifecycle import Beat, Event, State, after
from .monitor import Monitor, Threads
from .notify import contract, notify
from .overruns import warn_if_slow
from .RoboCompCommonBehavior import Status
from .settings import Settings
from .signals import Signals
from .sleeping import Sleepers
from .statemachine import Machine, Trigger
from .status import Counts, life, status
from .timers import Agenda, Timer, TimerHandle, Timers
from .trace import place_of, user_trace
from .unsafe import write_out
from .watch import Lost, Missed
from .watchdog import Watchdog
from .watching import Watching
from .worker import Worker, check_methods

if TYPE_CHECKING:
    from ..actions.binding import Surroundings
    from ..lockstep.free import Followed
    from ..lockstep.lockstep import Lockstep
    from .diary import Diary

log = logging.getLogger("robocomp.worker")

_ALIVE = (State.COMPUTE, State.EMERGENCY)

_PATIENCE = 0.2
"""Seconds to wait for a peer, before looking whether the component was stopped."""


class Running:
    """One component of this process, from its start to its end.

    `run` is called once and returns when it has ended. Instead, an executor may drive it step by step, all on one
    thread: `begin`, then `beat` whenever something is `due`, then `end`. Then the component waits for nothing by itself
    but in its own code. The rest may be used from other threads.
    """

    def __init__(
        self,
        worker_class: type[Worker[Any]],
        settings: Settings,
        find: Callable[[str], TransportFactory] = find_transport,
        tell: Callable[[str], None] = notify,
        clock: Clock | None = None,
        threads: Threads | None = None,
        seed: int | None = None,
    ) -> None:
        """`tell` sends status messages to the launcher of the process. `clock` is the machine's, unless given. `seed`
        makes the component's random numbers repeat."""
        check_methods(worker_class)
        self._tell = tell
        self.component = worker_class.component
        self.settings = settings
        self._lockstep = None if clock or not settings.clock else self._in_lockstep(settings)
        self.clock = clock or (self._lockstep.clock if self._lockstep else Real())
        self._is_virtual = clock is not None
        self.started, self.begun = time.time_ns(), time.monotonic()
        self._introspection: Introspection | None = None
        self.ready = threading.Event()
        self.state = State.STARTING
        self._wake = self._lockstep.wake if self._lockstep else threading.Event()
        self._changing = threading.Lock()
        threads = self._lockstep.threads if self._lockstep else threads
        self.monitor = Monitor(f"worker-{settings.instance}", threads)
        self._watching = Watching(settings.instance, self._call_qos_hook, self.clock)
        self._compute = Timer("compute", Beat(settings.period, self.clock.now()), self._wake.set)
        self._agenda = Agenda(settings.instance, self.clock)
        """The other timers."""
        self._is_stepping = False
        self.failed = False
        """Whether its code or its middleware failed, which ends it."""
        self._is_closed = False
        self._is_driven = True
        """Whether an executor takes its steps, so that it has no threads of its own."""
        self._sleepers = Sleepers(self.clock, self.monitor, lambda: self.state)
        self._hooks = Hooks(self.monitor, self.clock, lambda: self.state, self.stop, self._fail)
        self._machine: Machine | None = None
        self._diary: Diary | None = None
        self._round = 0
        """Number of fired transitions to take until `compute` is looked at, plus one; 0 between two rounds."""
        self.worker = self._build(worker_class, seed)
        self._connections = Connections(
            self.worker,
            settings,
            find,
            lambda: not self.is_over,
            self.monitor,
            self._watching,
            self._lockstep.counts if self._lockstep else None,
            lambda text: self._tell(f"STATUS={text}"),
            self._goals_need if self.component.has_actions else None,
        )

    def run(self) -> bool:
        """Start, compute until stopped, finish, close. Returns False if the component failed."""
        self._is_driven = isinstance(self.clock, Virtual)
        try:
            self.begin()
            while not self.is_over:
                self._wait()
                self.beat()
        finally:
            self._close()
        return not self.failed

    def begin(self) -> bool:
        """Open the links of its ports. Returns False if that failed; `end` closes what is open.

        The first beats wait for the peers that it requires: it can begin before they do.
        """
        self._tell_contract()
        machine, params = vars(self.worker).get("statemachine"), self.settings.params
        try:
            behavior = CommonBehavior(self.worker, params, self.monitor.held, self._status, machine)
            self._introspection = Introspection(self, behavior)
            self._connections.open(behavior, self._introspection)
            if self._diary:
                self._diary.note_proxies(self.worker)
            if self._lockstep:
                self._lockstep.open(self._connections)
        except (RobocompError, OSError) as exc:
            self._fail_by(exc)
        return not self.is_over

    def due(self) -> int:
        """The time of its clock at which the next beat has something to do; NEVER if nothing will be due by itself.

        An event, such as a fired transition or a change of a period, may make it earlier, so ask again after each
        beat, handler or call of this component.
        """
        state = self.state
        if state is State.ENDED:
            return NEVER
        now, is_alive = self.clock.reached(), state in _ALIVE
        due = now
        if self._is_stepping:
            due = NEVER
        elif is_alive and not (self._machine and state is State.COMPUTE and self._machine._waiting):
            due = self._compute._beat.due(now)
        if self._is_driven and is_alive and due > now:
            due = min(due, max(now, min(self._watching.due(), self._agenda.due())))
        return due

    @property
    def awaited(self) -> str:
        """See `Connections.awaited`."""
        return self._connections.awaited

    def beat(self) -> bool:
        """Do one thing that is due, and return whether there was one.

        That is one call of a hook, a timer or a function, one transition of the state machine, one look at the
        deadlines of its topics, or one look for required peers (which counts when all are there). What the component's
        code raises is logged, and stops the component. If a step waits in the component's code and lets the executor
        go on, only timers and deadlines are due until it returns.
        """
        if not self._is_stepping:
            self._is_stepping = True
            try:
                if self._step():
                    return True
            except (RobocompError, OSError) as exc:
                self._fail_by(exc)
                return True
            finally:
                self._is_stepping = False
        return self._is_driven and self.state in _ALIVE and (self._tick() or self._watch())

    def end(self) -> bool:
        """Stop it, with `finish` if it has started, and close all. Returns False if the component failed."""
        self.stop()
        while not self.is_over and not self._is_stepping:
            self.beat()
        self._close()
        return not self.failed

    @property
    def is_up(self) -> bool:
        return self.ready.is_set() and self.state not in (State.FINISH, State.ENDED)

    @property
    def is_over(self) -> bool:
        return self.state is State.ENDED

    @property
    def computes(self) -> int:
        """How often `compute` was called."""
        return self._compute.calls

    @property
    def overruns(self) -> int:
        """Number of periods skipped because a call of `compute` took too long."""
        return self._compute.overruns

    @property
    def doing(self) -> str:
        """The name of the hook that is running; "" if none is."""
        return self._hooks.doing

    @property
    def busy(self) -> str:
        """What its code is at, for a message; "" if no thread is inside its monitor."""
        thread, _ = self.monitor.turn()
        what = place_of(thread) or self.doing
        return f"{self.settings.instance} is busy with {what or 'a handler'}" if thread is not None else ""

    @property
    def life(self) -> str:
        """Its status, as one line for its launcher."""
        counts = Counts(self.computes, self.all_overruns)
        return life(self.settings.instance, self.state, counts, self._watching.all)

    @property
    def all_overruns(self) -> int:
        """Those of `compute` and of all timers."""
        return self.overruns + sum(each.overruns for each in self._agenda.timers)

    @property
    def clock_name(self) -> str:
        """The instance whose clock it follows, `virtual`, or "" for the machine's."""
        if self._is_virtual:
            return "virtual"
        return self.settings.clock.leader if self._lockstep and self.settings.clock else ""

    @property
    def _counts(self) -> Counts:
        return Counts(self.computes, self.overruns)

    def _status(self) -> Status:
        name, component, bound = self.settings.instance, self.component.name, self._connections.bound
        return status(name, component, self.state, self._counts, bound, self._watching.all, self._agenda.timers)

    @property
    def is_running_here(self) -> bool:
        """Whether the calling thread runs code of its worker."""
        pool = rf"{re.escape(self.monitor.name)}(-concurrent)?_\d+"
        return self.monitor.is_inside or bool(re.fullmatch(pool, threading.current_thread().name))

    def stop(self) -> None:
        """Ask it to stop: after the current call, `finish` is called and everything is closed."""
        self.signal(Event.STOP)

    def signal(self, event: Event, during: State | None = None) -> None:
        """Apply an event to the life cycle; with `during`, only if the component is still in that state."""
        with self._changing:
            if during is None or self.state is during:
                self.state = after(self.state, event)
            is_ending = self.state in (State.FINISH, State.ENDED)
            if is_ending:
                self._agenda.end()
            elif self.state is not State.COMPUTE:
                self._agenda.pause()
        self._wake.set()
        if is_ending:
            self._sleepers.wake()
            self.monitor.turn_away()

    def publish(self, port: Port) -> tuple[Any, Callable[[], None]]:
        """See `Connections.publish`."""
        return self._connections.publish(port)

    # Starting and ending.

    def _goals_need(self) -> Surroundings:
        """What actions need of the component. In virtual time, nothing is left to chance or to the machine."""
        from ..actions.binding import Surroundings, new_identity  # few components need it

        if not self._is_virtual:
            counts = self._lockstep.counts if self._lockstep else None
            return Surroundings(self.monitor, self._sleepers.wait, time.monotonic, new_identity, counts)
        numbers, owner = itertools.count(1), f"{self.settings.namespace}/{self.settings.instance}"

        def identity() -> bytes:
            return hashlib.blake2b(f"{owner} {next(numbers)}".encode(), digest_size=16).digest()

        return Surroundings(self.monitor, self._sleepers.wait, lambda: self.clock.now() / SECOND, identity)

    def _in_lockstep(self, settings: Settings) -> Lockstep | Followed | None:
        """What lets the component follow another clock; None if it tells the time of its own to others."""
        is_ending = (State.FINISH, State.ENDED)
        if settings.clock and settings.clock.mode == "free":
            from ..lockstep.free import follow

            return follow(settings, self.component, lambda: self.state in is_ending)
        from ..lockstep.lockstep import Lockstep  # few components need it

        return Lockstep(settings, lambda: self.monitor.is_idle, lambda: self.state in is_ending, self._fail)

    def _build(self, worker_class: type[Worker[Any]], seed: int | None) -> Worker[Any]:
        worker = worker_class.__new__(worker_class)
        spec = self.component.params
        worker._configured = build(spec, self.settings.params) if spec else None
        worker.log = logging.getLogger(self.settings.instance)
        worker._period = self.settings.period
        worker._signal = self.signal
        worker._clock = self.clock
        worker._sleep = self._sleepers.sleep
        worker._after = self._agenda.after
        worker._state = lambda: self.state
        worker._set_period = self._set_period
        worker._wake = self._wake.set
        worker._suspended = self.monitor.suspended
        worker.instance = self.settings.instance
        worker._document = self.settings.document
        worker._seed = None if seed is None else (seed, *self.settings.instance.encode())
        if self.settings.diary:
            from .diary import opened  # few components have one

            self._diary = opened(self.settings)
            self._diary.note_worker(worker)
        if self.component.machine:
            self._machine = Machine(self.component.machine, self._enter, self._wake.set)
            triggers = self.component.machine.triggers().items()
            found = {name: Trigger(self._machine, transition) for name, transition in triggers}
            vars(worker).update(found, statemachine=self._machine)
        if self.component.named:
            from .instances import add_to  # only such a component needs it

            add_to(worker, self.settings)
        if self.component.timers:
            periods = self.settings.timers
            worker.timers = Timers(
                self._agenda.add(each.name, periods.get(each.name, each.period), getattr(worker, each.method))
                for each in self.component.timers
            )
        try:
            worker_class.__init__(worker)  # last, so that a user's __init__ can use all of the above
        except ComponentError:
            raise
        except Exception as exc:
            raise ComponentError(self._init_failed(exc)) from exc
        return worker

    def _init_failed(self, exc: Exception) -> str:
        name = exc.name if isinstance(exc, AttributeError) else ""
        early = name in {port.attribute for port in self.component.ports}
        hint = f"\nproxies exist from `initialize` on: move code that uses `{name}` there" if early else ""
        return f"{user_trace(exc)}{hint}"

    def _tell_contract(self) -> None:
        """Report the contracts of this component, so that the launcher can compare them with those of its peers."""
        if lines := list(contract(self.settings.instance, self.component.fingerprints())):
            self._tell("\n".join(lines))

    def _look_for_peers(self) -> bool:
        if self.state is not State.STARTING or not self._connections.are_peers_there():
            return False
        self.signal(Event.CONNECTED, during=State.STARTING)
        return True

    def _close(self) -> None:
        if self._is_closed:
            return
        self._is_closed = True
        self._tell("STOPPING=1")
        self.monitor.turn_away()
        if self._lockstep:
            self._lockstep.close()
        self._watching.end()
        if self._introspection:
            self._introspection.close()
        tally.write(self.monitor.tallies, self.component.ports, self.settings.namespace, self.settings.instance)
        self._connections.close_links()
        self._watching.close()
        self._agenda.close()
        self.monitor.close()
        self._connections.close()
        if self._diary:
            self._diary.close()
        self.state = State.ENDED

    # Living.

    def _step(self) -> bool:
        """Take one step if it is due, and return whether it was."""
        if self.state is State.COMPUTE:  # first: it is so at nearly every step
            return self._move_or_compute()
        match self.state:
            case State.STARTING:
                return self._look_for_peers()
            case State.INITIALIZE:
                self._once(self.worker.initialize, early=True)
                self._get_going()
            case State.EMERGENCY:
                return self._on_the_beat(self.worker.emergency)
            case State.RESTORE:
                self._once(self.worker.restore)
                self._resume_timers()
            case State.FINISH:
                if self._connections.goals:
                    self._hooks.call(self._connections.goals.end, early=True)
                self._once(self.worker.finish, early=True)
            case State.ENDED:
                return False
        return True

    def _wait(self) -> None:
        """Wait until something is due, or until an event."""
        if self.state is State.STARTING:
            try:
                self._connections.are_peers_there(_PATIENCE)
            except (RobocompError, OSError) as exc:
                self._fail_by(exc)
        elif self.clock.wait(self._wake, self.due()):
            self._wake.clear()

    def _get_going(self) -> None:
        """Enter the initial states, admit handlers and report readiness, unless the component was stopped meanwhile."""
        if self._machine and self.state is State.COMPUTE:
            self._move(self._machine._begin, early=True)
        if self.state is not State.COMPUTE:
            return
        headroom.check(self.settings.instance)  # before the clock moves: it takes a while
        self.monitor.open()
        if self._lockstep:
            self._lockstep.begin()
            self._tell_ready()  # before the clock moves: it waits until all components of the network have started
            self._lockstep.wait()
            self._connections.connect_instances()
        if not self._is_driven:
            self._watching.begin()
        self._compute._beat = self.worker._beats(self.clock.now())
        self.ready.set()
        self._resume_timers()
        if not self._is_driven:
            self._agenda.begin(self._fire)
        self._connections.tell_missing()
        if not self._lockstep:
            self._tell_ready()  # last: the launcher then starts components that depend on this one

    def _tell_ready(self) -> None:
        log.info("ready")
        self._tell("READY=1")

    def _move_or_compute(self) -> bool:
        """Take one of the transitions fired until now, and when all are taken, compute if that is due.

        Handlers may run between two transitions.
        """
        if not self._round:
            self._round = 1 + (self._machine._waiting if self._machine else 0)
        self._round -= 1
        if self._machine and self._round:
            self._move(self._machine._step)
            return True
        goals = self._connections.goals
        computed = self._on_the_beat(self.worker.compute, goals.step if goals else None)
        self._compute.calls += computed
        return computed

    def _move(self, move: Callable[[], None], *, early: bool = False) -> None:
        """Run a step of the state machine inside the monitor. `_enter` handles the errors of each method, so that one
        that raises does not leave the step half done."""
        with contextlib.suppress(Closed), self.monitor.held(early=early):  # Closed: the component is stopping
            move()

    def _enter(self, state: str) -> None:
        """Call the worker's method for a state that is entered, unless an earlier one has failed."""
        method = getattr(self.worker, f"sm_{label(state)}")
        if not self.failed:
            self._hooks.call_inside(method)

    def _on_the_beat(self, hook: Callable[[], None], then: Callable[[], None] | None = None) -> bool:
        """Call a hook if it is due, and something after it, and return whether it was."""
        beat, begun = self._compute._beat, self.clock.reached()
        if beat.due(begun) > begun:
            return False
        skipped = beat.overruns
        beat.begun()
        self._hooks.call(hook)
        if then:
            self._hooks.call(then)
        now = self.clock.now()
        beat.done(now)
        if beat.overruns != skipped:
            took = (now - max(begun, self._hooks.entered)) / SECOND
            warn_if_slow(self._compute, hook, took, self.monitor.tallies)
        return True

    def _resume_timers(self) -> None:
        with self._changing:  # the component may be stopped or become an emergency at this moment
            if self.state is State.COMPUTE:
                self._agenda.resume()

    def _fire(self, taken: Timer | TimerHandle) -> None:
        """Call a timer or a function on a thread of the monitor, or here if there is none."""
        if not self.monitor.submit(partial(self._run_timer, taken), limited=False):
            with contextlib.suppress(Closed), self.monitor.held():  # Closed: the component is stopping
                self._run_timer(taken)

    def _tick(self) -> bool:
        """Call the timer or function that is due first, if one is and no thread does it."""
        taken = self._agenda.take()
        if taken:
            with contextlib.suppress(Closed), self.monitor.held():
                self._run_timer(taken)
        return taken is not None

    def _run_timer(self, taken: Timer | TimerHandle) -> None:
        skipped = taken.overruns if isinstance(taken, Timer) else 0
        took = self._agenda.run(taken, self._hooks.call_inside)
        if isinstance(taken, Timer) and taken.overruns != skipped:
            warn_if_slow(taken, taken._method, took, self.monitor.tallies)

    def _watch(self) -> bool:
        """Look at the deadlines of topics, if that is due and no thread does it."""
        if not self._is_driven or self._watching.due() > self.clock.reached():
            return False
        self._watching.look()
        return True

    def _call_qos_hook(self, port: Port, operation: str, event: Missed | Lost) -> None:
        """Call the hook for a missed deadline or a lost publisher, inside the monitor."""
        instance = names.instance(event.channel)
        hook = self.worker.on_deadline_missed if isinstance(event, Missed) else self.worker.on_liveliness_lost
        self._hooks.tell(hook, port.label, operation, instance, event.total)

    def _once(self, hook: Callable[[], None], *, early: bool = False) -> None:
        state = self.state
        self._hooks.call(hook, early=early)
        self.signal(Event.DONE, during=state)

    def _fail_by(self, exc: Exception) -> None:
        """Fail by an error of its links or its middleware."""
        if not (self.is_over and isinstance(exc, Closed)):  # Closed: stopped while it waited for its middleware
            self._fail(str(exc))

    def _fail(self, message: str) -> None:
        log.error("%s", message)
        self.failed = True
        self.signal(Event.STOP)

    def _set_period(self, seconds: float) -> None:
        self._compute._beat.period = seconds
        self._wake.set()


@installed.asked_once()
def main(
    worker_class: type[Worker[Any]],
    arguments: Sequence[str] | None = None,
    options: argparse.Namespace | None = None,
    missed: Callable[[], int] = lambda: 0,
) -> int:
    """Run a component as a program: `python -m PACKAGE`, `rc run DIR`. Returns the exit code.

    `options` are its arguments, if they have been parsed already. `missed` returns the number of a signal that arrived
    before this function handled signals, and 0 if there was none.
    """
    if options is None:
        parser = parser_of(worker_class.component)
        options = parser.parse_args(arguments)
        if options.json and not options.print_config:
            parser.error("--json is for --print-config")
    try:
        chosen, document = prepare(worker_class, options)
        if options.print_config:
            print_config(worker_class, chosen, document, as_json=options.json)
            return 0
        configure_logging(chosen)
        tell_notes(document)
        running = Running(worker_class, chosen)
    except (ConfigurationError, ComponentError) as exc:
        print(exc, file=sys.stderr)
        return exit_code(options)
    received: list[int] = []
    grace = grace_of([options.grace])
    stop_by = partial(_stop_by, running, received, grace)
    try:
        with Signals(stop_by, partial(end_after, grace)), Watchdog([running], [chosen.watchdog], notify):
            if number := missed():
                stop_by(number)
            front = running.worker._in_front
            fine = front(running.run, running.stop) if front else running.run()
            write_out()
    except ComponentError as exc:
        print(exc, file=sys.stderr)
        return 1
    settle()
    return 1 if not fine else 128 + received[0] if received else 0


def _stop_by(running: Running, received: list[int], grace: float | None, number: int) -> None:
    end_after(grace)
    received.append(number)
    running.stop()
    reminder = threading.Timer(STUCK, _tell_stuck, [running, grace])
    reminder.daemon = True
    start_thread(reminder)  # if it cannot start, the component stops without this message


def _tell_stuck(running: Running, grace: float | None) -> None:
    """Print what keeps a component from stopping, and how to end it."""
    if running.state is not State.ENDED:
        doing = running.doing or "closing"
        print(f"asked to stop {STUCK:g} s ago, but still busy with {doing}{announced(grace)}", file=sys.stderr)
