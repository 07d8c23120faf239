"""The loop of a component without real Qt: its own thread does what is due, one thing at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import ModuleType
from typing import Any, TypeVar

from .agenda import Agenda
from .core import Application, Place, core
from .mutex import MutexSet
from .served import Absent, Served

T = TypeVar("T")

_CORE = frozenset({"QApplication", "QGuiApplication", "qApp"})
"""Names of the stand-in that are not in QtCore."""


class Alone:
    """See `Loop`."""

    in_front = None

    def __init__(
        self,
        wake: Callable[[], None],
        quit_: Callable[[], None],
        outside: Callable[[], AbstractContextManager[None]],
        tell: Callable[[BaseException], None],
    ) -> None:
        self.outside = outside
        self.builtins: dict[str, Any] | None = None
        self._agenda = Agenda(wake)
        self._place = Place(self._agenda, tell, quit_, outside)
        self._keeper = MutexSet(outside)
        self._core = core(self._place, self._keeper)
        self._has_run = False
        self.base: type = self._core["QObject"]
        self.modules: Mapping[str, ModuleType] = Served(self._look_up, self._exported, {})

    @property
    def missed(self) -> int:
        return self._agenda.missed

    def due(self, now: float) -> float | None:
        return self._agenda.due(now)

    def run(self, now: float) -> None:
        self._place.thread = threading.get_ident()
        self._has_run = True
        self._agenda.do(now)

    def locked(self, change: int) -> None:
        """A wait for a lock leaves the monitor; that suffices because each handler has its own thread."""

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        if not self._has_run:  # assume that the thread that makes the objects will run them
            self._place.thread = threading.get_ident()
        return function(*arguments)

    def wait_for(self, function: Callable[[], T]) -> T:
        with self.outside():
            return function()

    def post(self, call: Callable[[], object]) -> None:
        self._agenda.post(lambda: self._place.attempt(None, call))

    def close(self) -> None:
        if self._agenda.closed:
            return
        application: Application = self._core["qApp"]
        self._place.attempt(None, application.aboutToQuit.emit)
        self._agenda.close()
        self._keeper.closed = True

    def _look_up(self, root: str, module: str, name: str) -> Any:
        found = self._core.get(name)
        if found is not None and (name in _CORE) == (module != "QtCore"):
            return found
        return Absent(f"{root}.{module}.{name}")

    def _exported(self, root: str, module: str) -> list[str]:
        if module == "QtCore":
            return [name for name in self._core if name not in _CORE]
        return sorted(_CORE) if module in ("QtGui", "QtWidgets") else []
