"""What user code derives from, by way of the generated GenericWorker."""

from __future__ import annotations

import inspect
import logging
import os
import shlex
from abc import ABC
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from ..contract.component import MAX_SECONDS, Component
from ..errors import ComponentError
from .lifecycle import Beat, Event, State

if TYPE_CHECKING:
    from .settings import Settings

P = TypeVar("P")

Front = Callable[[Callable[[], bool], Callable[[], None]], bool]
"""Given how components live and how they are stopped, has them live on a thread of their own; returns how it went."""


class Worker(ABC, Generic[P]):
    """A component's own code. Override the hooks, and write the handlers the generated class asks for.

    None of it ever runs on two threads at once, so it needs no locks; only handlers of ports that
    the CDSL calls `concurrent` run beside everything. While it waits for an answer from another
    component, a handler may run.
    """

    component: ClassVar[Component]
    middleware: ClassVar[str]
    """What carries its messages, unless configuration or deployment say otherwise."""

    _home: ClassVar[Path | None] = None
    """Where the component is, if not where this class is written."""

    _takes_any_params: ClassVar[bool] = False
    """Whether its own code looks at what its configuration says, whatever that is."""

    log: logging.Logger
    """Where to write messages for people."""

    _configured: P
    _signal: Callable[[Event], None]
    _state: Callable[[], State]
    _set_period: Callable[[float], None]
    _wake: Callable[[], None]
    """Has it looked at once whether it is time to call something."""

    _released: Callable[[], AbstractContextManager[None]]
    """Around a wait: lets the others in meanwhile."""

    _settings: Settings

    _in_front: Front | None = None
    """What the main thread is for instead, if this one's code cares: windows belong to the main thread."""

    def _beats(self, now: float) -> Beat:
        """When `compute` is called, from now on."""
        return Beat(self._period, now)

    def initialize(self) -> None:
        """Called once, when everything required is visible; handlers are let in afterwards."""

    def compute(self) -> None:
        """Called every period."""

    def emergency(self) -> None:
        """Called every period, instead of `compute`, from `goToEmergency` until `goToRestore`."""

    def restore(self) -> None:
        """Called once after an emergency, before `compute` goes on."""

    def finish(self) -> None:
        """Called once at the end. Other components may have gone already."""

    def paramsChanged(self, changed: frozenset[str]) -> None:
        """Called after dynamic parameters were changed from outside, with their names: `motors[0].max_speed`.

        `self.params` has the new values. Whatever this raises takes them back, and reaches who wanted the change.
        """

    def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
        """Called, as a handler is, when no message of a topic has come for as long as the `deadline` of its QoS.

        `port` is as the CDSL has it (`LaserPub`), `instance` whose messages they are: that of this
        component if it is we who have sent none. `total` counts all that were missed of that instance.
        """
        self._note("deadline missed", port, operation, instance)

    def on_liveliness_lost(self, port: str, operation: str, instance: str, total: int) -> None:
        """Called, as a handler is, when who publishes a topic is not alive any more, by the `lease` of its QoS.

        It may come back, and be lost again. Arguments: as above.
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
        """End this component, as Ctrl-C does: after what runs now, `finish` is called."""
        self._signal(Event.STOP)

    @property
    def params(self) -> P:
        """The configured parameters; read-only. Those that are dynamic change from outside, between two calls."""
        return self._configured

    @property
    def state(self) -> State:
        """Where in its life this component is."""
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
_OTHERWISE = (
    inspect.CO_VARARGS
    | inspect.CO_VARKEYWORDS
    | inspect.CO_GENERATOR
    | inspect.CO_COROUTINE
    | inspect.CO_ITERABLE_COROUTINE
    | inspect.CO_ASYNC_GENERATOR
)
_WATCHING = ("port", "operation", "instance", "total")


def check_methods(worker: type[Worker[Any]]) -> None:
    """Raise ComponentError if a hook, a handler or the method of a state is none.

    That is: it is missing, is no method or an asynchronous one, or takes other arguments than it is given.
    """
    for name in HOOKS:
        _check_method(worker, name, [])
    _check_method(worker, "paramsChanged", ["changed"])
    for name in ("on_deadline_missed", "on_liveliness_lost"):
        _check_method(worker, name, list(_WATCHING))
    for name, arguments in _wanted(worker.component):
        declared = getattr(worker, name, None)
        if declared is None or getattr(declared, "__isabstractmethod__", False):
            lacking = f"{worker.__name__} lacks the method {name}"
            raise ComponentError(f"{lacking}; {_remedy(worker)}:\n\n{_stub(worker, name)}")
        _check_method(worker, name, arguments)


def _check_method(worker: type[Worker[Any]], name: str, arguments: list[str]) -> None:
    method = getattr(worker, name)
    if _takes(method, 1 + len(arguments)):
        return
    if not callable(method):
        raise ComponentError(f"{worker.__name__}.{name} is {method!r}, but has to be a method: the framework calls it")
    if inspect.iscoroutinefunction(method):
        raise ComponentError(f"{worker.__name__}.{name} is `async def`; what the framework calls is plain: write `def`")
    try:
        inspect.signature(method).bind(None, *arguments)
    except TypeError:
        wanted = ", ".join(("self", *arguments))
        raise ComponentError(
            f"{worker.__name__}.{name} must take ({wanted}); make it:\n\n{_stub(worker, name)}"
        ) from None


def _takes(method: object, number: int) -> bool:
    """Whether it is a function that takes just so many arguments, as can be seen without taking its signature apart."""
    if not inspect.isfunction(method) or method.__dict__:  # decorators leave something there
        return False
    code = method.__code__
    return code.co_argcount == number and not code.co_kwonlyargcount and not code.co_flags & _OTHERWISE


def _wanted(component: Component) -> Iterator[tuple[str, list[str]]]:
    """The methods that a component has to have, and what they take."""
    for port in component.ports:
        if not port.verb.has_proxy:
            for operation, _ in port.interface.under(port.verb):
                yield port.handler(operation.name), [field.attribute for field in operation.inputs]
    for method in component.machine.methods() if component.machine else ():
        yield method, []


def _remedy(worker: type[Worker[Any]]) -> str:
    """What appends a missing method, if the model is beside the worker; else that it is to be added."""
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
