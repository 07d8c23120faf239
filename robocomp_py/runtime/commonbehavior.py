"""`CommonBehavior`, which every component implements: its status, parameters and period, and how to stop it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any

from ..contract.component import Component, Port
from ..contract.interface import Verb
from ..contract.parameters import ParameterSet, build, change, dotted, flat
from ..errors import ConfigurationError
from .lifecycle import State
from .RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE, Parameter, ParameterList, Status
from .RoboCompCommonBehavior import State as Told
from .statemachine import Machine
from .worker import Worker

MOST_CHANGES = 8
"""Maximum number of waiting parameter changes. Less than the number of threads, so that other operations go on."""


class CommonBehavior:
    """Handlers of the interface for one worker. They run concurrently with its code and return quickly.

    Only a change of parameters enters the monitor (by `held`), so that the worker's code never sees half of it.
    """

    def __init__(
        self,
        worker: Worker[Any],
        params: Mapping[str, Any],
        held: Callable[[], AbstractContextManager[None]],
        status: Callable[[], Status],
        machine: Machine | None = None,
    ) -> None:
        self._worker, self.params, self._held, self._machine = worker, params, held, machine
        self.revision = 0
        """How often the parameters have changed."""
        self._status = status
        self._spec = worker.component.params
        self._born = time.monotonic()
        self._changes = threading.BoundedSemaphore(MOST_CHANGES)
        self._is_changing = False

    def CommonBehavior_getPeriod(self) -> int:
        return round(self._worker.period * 1000)

    def CommonBehavior_setPeriod(self, period: int) -> None:
        self._worker.period = period / 1000

    def CommonBehavior_timeAwake(self) -> int:
        return round((time.monotonic() - self._born) * 1000) & 0x7FFFFFFF

    def CommonBehavior_killYourSelf(self) -> None:
        self._worker.stop()

    def CommonBehavior_getParameterList(self) -> ParameterList:
        return {
            dotted(key): Parameter(editable=parameter.dynamic, value=str(value), type=type(value).__name__)
            for key, parameter, value in (flat(self._spec, self.params) if self._spec else ())
        }

    def CommonBehavior_setParameterList(self, l: ParameterList) -> None:  # noqa: E741 - the IDSL's name
        if self._spec is None:
            raise ConfigurationError("this component has no parameters")
        if not self._changes.acquire(blocking=False):
            raise ConfigurationError(f"{MOST_CHANGES} changes of parameters are already waiting; try again later")
        try:
            with self._held():
                self._change(self._spec, {name: parameter.value for name, parameter in l.items()})
        finally:
            self._changes.release()

    def _change(self, spec: ParameterSet, texts: Mapping[str, str]) -> None:
        if self._is_changing:  # paramsChanged waits for a reply, and may still reject its change
            raise ConfigurationError("another change of parameters is in progress; try again later")
        values, changed, complaints = change(spec, self.params, texts)
        if complaints:
            raise ConfigurationError("\n".join(f"{each.path}: {each.message}" for each in complaints))
        if changed:
            self._become(values, build(spec, values), frozenset(changed))
            shown = (f"{name} = {texts[name]}" for name in changed)
            self._worker.log.info("parameters changed: %s", ", ".join(shown))

    def _become(self, values: Mapping[str, Any], params: Any, changed: frozenset[str]) -> None:
        """Give the worker new parameters; if `paramsChanged` raises, the old ones stay."""
        before = self._worker.params
        self._worker._configured = params
        self._is_changing = True
        try:
            self._worker.paramsChanged(changed)
        except BaseException:
            self._worker._configured = before
            raise
        finally:
            self._is_changing = False
        self.params = values
        self.revision += 1

    def CommonBehavior_reloadConfig(self) -> None:
        raise PermissionError("a running component cannot reload its configuration; restart it")

    def CommonBehavior_getState(self) -> Told:
        starting = self._worker.state in (State.STARTING, State.INITIALIZE)
        return Told.Starting if starting else Told.Running

    def CommonBehavior_getActiveStates(self) -> list[str]:
        return list(self._machine.active) if self._machine else []

    def CommonBehavior_getStatus(self) -> Status:
        return self._status()


def port_of(component: Component) -> Port | None:
    """The port of CommonBehavior; None if the component implements an interface of that name itself."""
    taken = any(p.interface.short == COMMONBEHAVIOR_INTERFACE.short and not p.verb.has_proxy for p in component.ports)
    return None if taken else Port(Verb.IMPLEMENTS, COMMONBEHAVIOR_INTERFACE, concurrent=True)
