"""The components of a network in virtual time, from their start to their end."""

from __future__ import annotations

import linecache
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import FrameType, TracebackType
from typing import Any, Self, TypeVar

from ..contract.component import Component
from ..errors import ComponentError
from ..runtime.clock import NEVER, SECOND, ns
from ..runtime.lifecycle import State
from ..runtime.run import Running
from ..runtime.settings import Settings
from ..runtime.worker import Worker
from ..spelling import unknown
from ..transports.base import TransportConfig
from ..transports.memory import keep_memory
from .executor import Executor
from .outside import Outside, provided
from .record import Record
from .stalls import Stalls, folder_of, line_in
from .transport import Air
from .turns import TurnClock, TurnThreads

log = logging.getLogger("robocomp.simulation")

GRACE = 5.0
"""Virtual seconds that a component has to end."""

PATIENCE = 60.0
"""Virtual seconds that a function of `Simulation.do` may take."""

_ALIVE = (State.COMPUTE, State.EMERGENCY)
"""Before and after these, a component may well wait for files or devices."""

MOST_ERRORS = 100
"""Number of exceptions that `Simulation.errors` keeps."""

T = TypeVar("T")


@dataclass(frozen=True)
class Part:
    """One component of a simulated network."""

    worker_class: type[Worker[Any]]
    settings: Settings
    name: str = ""
    """In the network, with the systems around it: `left/arm`; "" for that of its settings."""

    @property
    def instance(self) -> str:
        return self.name or self.settings.instance

    @property
    def component(self) -> Component:
        return self.worker_class.component

    @property
    def middleware(self) -> str:
        """The one that it is generated for."""
        return self.worker_class.middleware


@dataclass(frozen=True)
class Failure:
    """An exception that the code of a component raised."""

    time: float
    """Virtual seconds since the start."""
    instance: str
    method: str
    """Its name in the log, such as `SpecificWorker.EyesPub_distance`."""
    exception: BaseException


class Simulation:
    """Runs components in virtual time, in a `with` block. The order of `parts` decides what is simultaneous.

    Times are in seconds since the start. `seed` seeds `self.random` of each component. `write` gets a line for each
    message. Not safe to use from several threads.
    """

    def __init__(self, parts: Sequence[Part], seed: int = 0, write: Callable[[str], object] | None = None) -> None:
        """Creates the workers. Raises ComponentError if one cannot be created."""
        keep_memory()
        self._executor = Executor(look=Stalls(self._tell_stall).look)
        self.record = Record(self._executor, write)
        self._air = air = Air(self._executor, self.record)
        self._parts = parts
        self._components: dict[str, Simulated] = {}
        self._running: list[Running] = []
        self._errors: list[Failure] = []
        self._stalls: set[tuple[str, str, int]] = set()
        """The instances and lines that were told to wait for the machine."""
        self._before = set(threading.enumerate())
        for order, part in enumerate(parts):
            clock = TurnClock(self._executor, order)
            running = Running(
                part.worker_class, part.settings, air.factory, _tell, clock, TurnThreads(self._executor), seed=seed
            )
            running.monitor.tallies.on_failure = partial(self._note_failure, part.instance)
            self._running.append(running)
            if part.instance in self._components:
                raise ComponentError(f"two components are called {part.instance}")
            self._components[part.instance] = simulated = Simulated(running, part.instance)
            self._executor.add(simulated)

    @property
    def time(self) -> float:
        """Virtual seconds since the start."""
        return self._executor.now / SECOND

    @property
    def hash(self) -> str:
        """A hash of all messages until now, with their times: equal runs have equal hashes."""
        return self.record.hash

    @property
    def failed(self) -> list[str]:
        """The instances that have failed."""
        return [name for name, each in self._components.items() if each.failed]

    @property
    def errors(self) -> list[Failure]:
        """The first 100 exceptions of handlers, actions, timers and hooks that were logged as errors.

        An exception in a handler does not end its component, so `failed` does not name the component. Exceptions that
        the interface declares are answers, and are not listed.
        """
        return list(self._errors)

    @property
    def over(self) -> bool:
        """Whether all components have ended."""
        return all(each.is_over() for each in self._components.values())

    @property
    def acting(self) -> str:
        """The instance whose code runs; "" if none does."""
        stepping = [each for each in self._executor.stepping if isinstance(each, Simulated)]
        inside = (each for each in self._components.values() if each.is_inside)
        acting = next(inside, stepping[-1] if stepping else None)
        return acting.instance if acting else ""

    def __getitem__(self, instance: str) -> Simulated:
        """A component, to look into. Raises KeyError, which names the most similar one."""
        try:
            return self._components[instance]
        except KeyError:
            raise KeyError(unknown("instance", instance, self._components)) from None

    def __enter__(self) -> Self:
        for each in self._components.values():
            each.begin()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self.stop()
        finally:
            self._executor.close()
            for each in self._components.values():
                each.end()

    def run(
        self, seconds: float | None = None, *, until: Callable[[], object] | None = None, at_most: float | None = None
    ) -> bool:
        """Let the network run: for so many seconds, or until a condition holds, but `at_most` so many seconds.

        Returns whether the condition holds; without one, whether the time has passed. It ends early if all components
        end or one fails. The condition is looked at after each event, so it should be quick.
        """
        if seconds is None and at_most is None and until is None:
            raise ValueError("say how long: seconds, or until=..., or both until=... and at_most=...")
        limit = at_most if seconds is None else seconds
        end = NEVER if limit is None else self._executor.now + ns(limit)
        if until is None:
            self._executor.run(self._has_ended, end)
            return self._executor.now >= end
        self._executor.run(lambda: until() or self._has_ended(), end)
        return bool(until())

    def _has_ended(self) -> bool:
        """Whether all components have ended, or one has failed. Asked after each event, so it has to be quick."""
        is_over = True
        for each in self._running:
            if each.failed:
                return True
            is_over = is_over and each.state is State.ENDED
        return is_over

    def _note_failure(self, instance: str, method: str, exc: BaseException) -> None:
        if len(self._errors) < MOST_ERRORS:
            self._errors.append(Failure(self.time, instance, method, exc))

    def _tell_stall(self, thread: threading.Thread, frame: FrameType) -> None:
        """Warn, once for each line of a component, that it waits for the machine."""
        for each in self._components.values():
            where = line_in(folder_of(type(each.worker)), frame) if each.acts_on(thread) else None
            if where and (each.instance, *where) not in self._stalls:
                self._stalls.add((each.instance, *where))
                logging.getLogger(each.instance).warning(
                    "%s:%d waits while virtual time stands still, which slows the simulation: `%s`; "
                    "`self.sleep` waits in virtual time",
                    *where,
                    linecache.getline(*where).strip(),
                )

    def outside(self, name: str) -> Outside:
        """Calls and hears the network as something that is not one of its components, which they see as `name`.

        What it opens is to be closed before the simulation ends.
        """
        return Outside(
            provided(self._parts), lambda middleware: self._air.factory(middleware)(TransportConfig({}, name))
        )

    def do(self, function: Callable[[], T]) -> T:
        """Run a function as an event of now, and return its result. It may use what `outside` returns.

        Time passes only if a handler that it calls waits. What else it causes happens when the network runs again.
        Raises what the function raises, and ComponentError if it takes longer than a minute of virtual time.
        """
        results: list[T] = []
        self._executor.do(lambda: results.append(function()))
        if not self._executor.run(lambda: results, self._executor.now + ns(PATIENCE)):
            raise ComponentError(f"a call into the network did not end within {PATIENCE:g} s of virtual time")
        return results[0]

    def stop(self) -> None:
        """Stop all components, the last first, each with its `finish`."""
        for each in reversed(self._components.values()):
            each.stop()
            self._executor.run(each.is_over, self._executor.now + ns(GRACE))
            if not each.is_over():
                log.warning("%s: did not end in %g s of virtual time", each.instance, GRACE)

    def foreign_threads(self) -> list[str]:
        """The names of threads that components have started. What they do is not part of the simulation."""
        own = {*self._before, *self._executor.threads}
        return sorted(thread.name for thread in threading.enumerate() if thread not in own)


class Simulated:
    """One component of a simulation. Its events are those of the executor."""

    def __init__(self, running: Running, instance: str) -> None:
        self._running = running
        self.instance = instance
        self._has_begun = False

    @property
    def worker(self) -> Any:
        """The SpecificWorker itself, to look into between two runs."""
        return self._running.worker

    @property
    def state(self) -> State:
        """Its place in the life cycle, such as "compute" or "ended"."""
        return self._running.state

    @property
    def computes(self) -> int:
        """How often `compute` was called."""
        return self._running.computes

    @property
    def failed(self) -> bool:
        return self._running.failed

    @property
    def is_inside(self) -> bool:
        """Whether a method of its worker runs, and does not wait."""
        return self._running.monitor.is_inside

    def acts_on(self, thread: threading.Thread) -> bool:
        """Whether a thread runs `compute`, a timer or a handler of it."""
        return self.state in _ALIVE and self._running.monitor.turn()[0] == thread.ident

    def is_over(self) -> bool:
        return self._running.is_over

    def begin(self) -> None:
        self._has_begun = True
        self._running.begin()

    def stop(self) -> None:
        self._running.stop()

    def end(self) -> None:
        if self._has_begun:
            self._running.end()

    def due(self) -> int | None:
        instant = self._running.due()
        return None if instant == NEVER else instant

    def step(self) -> None:
        if not self._running.beat() and self._running.state is State.STARTING:
            wanted = self._running.awaited
            raise ComponentError(f"{self.instance} requires {wanted}, which no component of the network implements")
        if self._running.is_over:
            self._running.end()


def _tell(text: str) -> None:
    """Takes what a component would tell its launcher."""
