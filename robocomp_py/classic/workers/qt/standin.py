"""The event loop of a component that uses the stand-in for Qt. It runs on the component's own thread.

Timers follow the component's clock. A timer of 0 ms is due at once on the machine's clock. Other clocks may stand still
until nothing is due any more, so there it takes 1 ms.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import ModuleType
from typing import Any, TypeVar

from ....runtime.clock import Clock, Real
from .agenda import Agenda
from .core import MILLISECOND, Application, EventContext, core
from .mutex import MutexSet
from .served import Absent, Served

T = TypeVar("T")

_NOT_IN_QTCORE = frozenset({"QApplication", "QGuiApplication", "qApp"})
"""Names of the stand-in that are not in QtCore."""


class StandInLoop:
    """A `Loop` without real Qt: calls and timers that are due run one at a time."""

    in_front = None

    def __init__(
        self,
        wake: Callable[[], None],
        quit_: Callable[[], None],
        outside: Callable[[], AbstractContextManager[None]],
        tell: Callable[[BaseException], None],
        clock: Clock,
    ) -> None:
        self.outside = outside
        self.builtins: dict[str, Any] | None = None
        moved = None if isinstance(clock, Real) else clock
        self._agenda = Agenda(wake, clock, MILLISECOND if moved else 0)
        self._context = EventContext(self._agenda, tell, quit_, outside)
        self._mutexes = MutexSet(outside, moved=moved)
        self._core = core(self._context, self._mutexes)
        self._has_run = False
        self.base: type = self._core["QObject"]
        self.modules: Mapping[str, ModuleType] = Served(self._look_up, self._exported, {})

    @property
    def missed(self) -> int:
        return self._agenda.missed

    def begin(self, now: int) -> None:
        self._agenda.skip_to(now)

    def due(self, now: int) -> int:
        return self._agenda.due(now)

    def run(self, now: int) -> None:
        self._context.thread = threading.get_ident()
        self._has_run = True
        self._agenda.do(now)

    def locked(self, change: int) -> None:
        """Has no effect: a wait for a lock already leaves the monitor, and each handler has its own thread."""

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        if not self._has_run:  # assume that the thread that makes the objects will run them
            self._context.thread = threading.get_ident()
        return function(*arguments)

    def wait_for(self, function: Callable[[], T]) -> T:
        with self.outside():
            return function()

    def post(self, call: Callable[[], object]) -> None:
        self._agenda.post(lambda: self._context.attempt(None, call))

    def close(self) -> None:
        if self._agenda.closed:
            return
        application: Application = self._core["qApp"]
        self._context.attempt(None, application.aboutToQuit.emit)
        self._agenda.close()
        self._mutexes.closed = True

    def _look_up(self, root: str, module: str, name: str) -> Any:
        is_there = name not in _NOT_IN_QTCORE if module == "QtCore" else name in _NOT_IN_QTCORE
        found = self._core.get(name) if is_there else None
        return Absent(f"{root}.{module}.{name}") if found is None else found

    def _exported(self, root: str, module: str) -> list[str]:
        if module == "QtCore":
            return [name for name in self._core if name not in _NOT_IN_QTCORE]
        return sorted(_NOT_IN_QTCORE) if module in ("QtGui", "QtWidgets") else []
