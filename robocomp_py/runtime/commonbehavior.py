"""`CommonBehavior`, which every component answers: how it is, and how to end it."""

from __future__ import annotations

import time
from typing import Any

from ..contract.component import Component, Port
from ..contract.interface import Verb
from .lifecycle import State
from .RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE, Parameter, ParameterList
from .RoboCompCommonBehavior import State as Told
from .worker import Worker


class CommonBehavior:
    """Handlers of the interface for one worker. They may run beside its code, and are quick."""

    def __init__(self, worker: Worker[Any], params: dict[str, Any]) -> None:
        self._worker, self._params = worker, params
        self._born = time.monotonic()

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
            name: Parameter(editable=False, value=str(value), type=type(value).__name__)
            for name, value in self._params.items()
        }

    def CommonBehavior_setParameterList(self, l: ParameterList) -> None:  # noqa: E741 - the IDSL's name
        raise PermissionError("parameters are read-only while the component runs; change its configuration")

    def CommonBehavior_reloadConfig(self) -> None:
        raise PermissionError("a running component keeps its configuration; restart it to load another")

    def CommonBehavior_getState(self) -> Told:
        starting = self._worker.state in (State.STARTING, State.INITIALIZE)
        return Told.Starting if starting else Told.Running


def port_of(component: Component) -> Port | None:
    """The port to answer on, unless the component implements the interface itself."""
    taken = any(p.interface.short == COMMONBEHAVIOR_INTERFACE.short and not p.verb.has_proxy for p in component.ports)
    return None if taken else Port(Verb.IMPLEMENTS, COMMONBEHAVIOR_INTERFACE, concurrent=True)
