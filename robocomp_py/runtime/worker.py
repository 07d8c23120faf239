"""The base class of user code, through the generated GenericWorker."""

from __future__ import annotations

import inspect
import logging
import os
import shlex
from abc import ABC
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from ..contract.component import MAX_SECONDS, Component
from ..errors import ComponentError
from ..spelling import closest
from .lifecycle import Beat, Event, State
from .timers import TimerHandle, Timers

if TYPE_CHECKING:
    import numpy as np

    from .clock import Clock
    from .document import Document

P = TypeVar("P")

Front = Callable[[Callable[[], bool], Callable[[], None]], bool]
"""Runs components (its first argument) on another thread, and the main thread's own loop; returns their result. Its
second argument stops the components."""


class Worker(ABC, Generic[P]):
    """A component's own code. Override the hooks, and write the handlers the generated class asks for.

    Only one method runs at a time, so attributes need no locks. While a method waits for the reply of another
    component, a handler may run. Handlers of ports that the CDSL declares `concurrent` run at any time.
    """

    component: ClassVar[Component]
    middleware: ClassVar[str]
    """The middleware of its messages, unless configuration or deployment set another one."""

    _home: ClassVar[Path | None] = None
    """The component's folder, if it is not the folder of this class."""

    _takes_any_params: ClassVar[bool] = False
    """Whether its own code reads the parameters in the configuration, so that unknown ones are allowed."""

    timers: Timers = Timers()
    """The timers that the CDSL declares: `self.timers.poll.period = 0.05`."""

    log: logging.Logger
    """The logger of this component."""

    instance: str
    """The name of this instance in its network."""

    _configured: P
    _signal: Callable[[Event], None]
    _state: Callable[[], State]
    _clock: Clock
    _sleep: Callable[[float], bool]
    _after: Callable[[float, Callable[[], object]], TimerHandle]
    _set_period: Callable[[float], None]
    _wake: Callable[[], None]
    """Ends the current wait, so that a due call is made at once."""

    _suspended: Callable[[], AbstractContextManager[None]]
    """A context manager around a wait, during which handlers may run."""

    _document: Document | None
    """Its configuration, if it comes from a file."""

    _seed: tuple[int, ...] | None

    _in_front: Front | None = None
    """The loop of the main thread, for components with windows, which belong to that thread."""

    def _beats(self, now: int) -> Beat:
        """The schedule of `compute`, from now on."""
        return Beat(self._period, now)

    def initialize(self) -> None:
        """Called once, when all required components are visible. Handlers are called only afterwards."""

    def compute(self) -> None:
        """Called every period."""

    def emergency(self) -> None:
        """Called every period, instead of `compute`, from `goToEmergency` until `goToRestore`."""

    def restore(self) -> None:
        """Called once after an emergency, before `compute` goes on."""

    def finish(self) -> None:
        """Called once at the end. Other components may already be gone."""

    def paramsChanged(self, changed: frozenset[str]) -> None:
        """Called after dynamic parameters were changed from outside, with their names: `motors[0].max_speed`.

        `self.params` has the new values. If this method raises, the old values are restored, and the component that
        requested the change gets the exception.
        """

    def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
        """Called like a handler when no message of a topic has come within the `deadline` of its QoS.

        `port` is the name in the CDSL (`LaserPub`), and `instance` is the publisher: this component itself if it has
        not published in time. `total` counts all missed deadlines of that instance.
        """
        self._note("deadline missed", port, operation, instance)

    def on_liveliness_lost(self, port: str, operation: str, instance: str, total: int) -> None:
        """Called like a handler when the publisher of a topic is gone, according to the `lease` of its QoS.

        It may come back, and be lost again. The arguments are those of `on_deadline_missed`.
        """
        self._note("publisher lost", port, operation, instance)

    def _note(self, what: str, port: str, operation: str, instance: str) -> None:
        noted = self.__dict__.setdefault("_noted", set())
        if (what, port, operation, instance) not in noted and len(noted) < _MOST_NOTED:
            noted.add((what, port, operation, instance))
            self.log.warning("%s.%s of %s: %s (further ones are only counted)", port, operation, instance, what)

    def goToEmergency(self) -> None:
        """Stop computing and call `emergency` instead. No effect unless computing."""
        self._signal(Event.ALARM)

    def goToRestore(self) -> None:
        """The emergency is over: call `restore`, then compute again. No effect otherwise."""
        self._signal(Event.RECOVERED)

    def stop(self) -> None:
        """Stop this component, as Ctrl-C does: after the current call, `finish` is called."""
        self._signal(Event.STOP)

    def now(self) -> int:
        """The time of the component's clock, in nanoseconds since the epoch of that clock.

        The machine's clock counts from 1970 and never goes back; a simulation's clock counts from its start.
        """
        return self._clock.now()

    def sleep(self, seconds: float) -> bool:
        """Wait on the component's clock. Meanwhile handlers may run, as during a call of another component.

        Returns False, earlier, if the component is asked to stop. In `finish`, it waits to the end.
        """
        return self._sleep(seconds)

    def after(self, seconds: float, function: Callable[[], object]) -> TimerHandle:
        """Call a function without arguments once, when that time of the component's clock has passed.

        It is called like a handler, so that no other code runs meanwhile; during an emergency, it waits. `cancel()` of
        the result prevents it. What still waits when the component stops is cancelled. At most 1000 functions may wait.
        """
        return self._after(seconds, function)

    @property
    def params(self) -> P:
        """The configured parameters; read-only. Dynamic ones may be changed from outside, between two calls."""
        return self._configured

    reads_caller = False
    """Whether handlers may read `caller`. Set it to True in `SpecificWorker`; other components spend nothing on it."""

    @property
    def caller(self) -> str:
        """In a handler: the instance that made the call or sent the message.

        "" if it is not known, and outside of handlers. Raises ComponentError without `reads_caller = True`.
        """
        from .callers import caller_for  # only components that use this need it

        return caller_for(self)

    @cached_property
    def random(self) -> np.random.Generator:
        """Random numbers. In virtual time they repeat: they depend only on the seed and on the name of the instance."""
        import numpy as np  # only components that use this need it

        return np.random.default_rng(self._seed)

    @property
    def state(self) -> State:
        """The present state of the component's life cycle."""
        return self._state()

    @property
    def period(self) -> float:
        """Seconds from one `compute` to the next."""
        return self._period

    @period.setter
    def period(self, seconds: float) -> None:
        if not 0 < seconds <= MAX_SECONDS:
            raise ValueError(f"a period is a positive number of seconds, at most {MAX_SECONDS:g}, not {seconds!r}")
        self._set_period(seconds)
        self._period = seconds

    _period: float


HOOKS = ("initialize", "compute", "emergency", "restore", "finish")
_MOST_NOTED = 1000
_SPECIAL_FLAGS = (
    inspect.CO_VARARGS
    | inspect.CO_VARKEYWORDS
    | inspect.CO_GENERATOR
    | inspect.CO_COROUTINE
    | inspect.CO_ITERABLE_COROUTINE
    | inspect.CO_ASYNC_GENERATOR
)
_WATCHING = ("port", "operation", "instance", "total")


def check_methods(worker: type[Worker[Any]]) -> None:
    """Raise ComponentError if a hook, a handler or the method of a state cannot be called.

    That is: it is missing, not a method, asynchronous, or takes the wrong arguments.
    """
    for name in HOOKS:
        _check_method(worker, name, [])
    _check_method(worker, "paramsChanged", ["changed"])
    for name in ("on_deadline_missed", "on_liveliness_lost"):
        _check_method(worker, name, list(_WATCHING))
    for name, arguments in _wanted(worker.component):
        declared = getattr(worker, name, None)
        if declared is None or getattr(declared, "__isabstractmethod__", False):
            near = closest(name, _uncalled(worker))
            lacking = f"{worker.__name__} lacks the method {name}" + (
                f", and has {near}: rename it, " if near else "; "
            )
            raise ComponentError(f"{lacking}{_remedy(worker)}:\n\n{_stub(worker, name)}")
        _check_method(worker, name, arguments)
    for port, action in worker.component.actions():
        _check_steps(worker, port.handler(action.name))


def _uncalled(worker: type[Worker[Any]]) -> list[str]:
    """Methods of its own that the framework does not call: one may be a handler with a misspelt name."""
    called = {*HOOKS, *(name for name, _ in _wanted(worker.component))}
    return [name for name in vars(worker) if not name.startswith("_") and name not in called]


def _check_steps(worker: type[Worker[Any]], name: str) -> None:
    """Raise ComponentError if a handler of an action is no generator."""
    if not inspect.isgeneratorfunction(inspect.unwrap(getattr(worker, name))):
        raise ComponentError(
            f"{worker.__name__}.{name} must contain a `yield`, because it executes an action: each `yield` waits for "
            "the next compute, and raises Cancelled if the goal is cancelled"
        )


def _check_method(worker: type[Worker[Any]], name: str, arguments: list[str]) -> None:
    method = getattr(worker, name)
    if _takes(method, 1 + len(arguments)):
        return
    if not callable(method):
        raise ComponentError(
            f"{worker.__name__}.{name} must be a method, because the framework calls it, not {method!r}"
        )
    if inspect.iscoroutinefunction(method):
        raise ComponentError(f"{worker.__name__}.{name} is `async def`; the framework calls plain methods: write `def`")
    try:
        inspect.signature(method).bind(None, *arguments)
    except TypeError:
        wanted = ", ".join(("self", *arguments))
        raise ComponentError(
            f"{worker.__name__}.{name} must take ({wanted}); write:\n\n{_stub(worker, name)}"
        ) from None


def _takes(method: object, number: int) -> bool:
    """Whether it is a plain function of this many arguments. Faster than `inspect.signature`, which others need."""
    if not inspect.isfunction(method) or method.__dict__:  # decorators add attributes
        return False
    code = method.__code__
    return code.co_argcount == number and not code.co_kwonlyargcount and not code.co_flags & _SPECIAL_FLAGS


def _wanted(component: Component) -> Iterator[tuple[str, list[str]]]:
    """The methods that a component must have, and their arguments."""
    for port, operation in component.handlers():
        yield port.handler(operation.name), [field.attribute for field in operation.inputs]
    for port, action in component.actions():
        yield port.handler(action.name), ["goal", *(field.attribute for field in action.inputs)]
    for method in component.machine.methods() if component.machine else ():
        yield method, []
    for timer in component.timers:
        yield timer.method, []


def _remedy(worker: type[Worker[Any]]) -> str:
    """The command that appends a missing method if the model is next to the worker; otherwise just "add"."""
    models = list(Path(inspect.getfile(worker)).parent.glob("*.cdsl"))
    if len(models) != 1:
        return "add"
    return f"run `{shlex.join(['rcgen', '--stubs', os.path.relpath(models[0])])}`, or add"


def _stub(worker: type[Worker[Any]], name: str) -> str:
    """The method to paste, as the generated class declares it."""
    generic = next((c for c in worker.__mro__ if getattr(c.__dict__.get(name), "__isabstractmethod__", False)), None)
    if generic is None:
        return f"    def {name}(self) -> None: ..." if name in HOOKS else f"    def {name}(self, ...): ..."
    signature = str(inspect.signature(generic.__dict__[name])).replace("'", "")
    return f"    def {name}{signature}:\n        raise NotImplementedError  # your code here"
