"""Qt for components of RoboComp's generators: the real one if their files need it, otherwise a stand-in.

Components without windows use timers, signals, slots and mutexes. The stand-in provides these; they run on the
component's own thread, one at a time, and Qt need not be installed. For components with windows, PySide6 is used,
whatever version of Qt a file imports.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, TypeVar

from ....runtime.clock import Clock
from ....runtime.lifecycle import Beat
from ....runtime.worker import Front
from .needs import Need, need
from .standin import StandInLoop

__all__ = ["Loop", "LoopBeat", "Need", "need", "open_loop"]

T = TypeVar("T")


class Loop(Protocol):
    """The event loop of one component, and the Qt modules for its files."""

    @property
    def modules(self) -> Mapping[str, ModuleType]:
        """The modules `PySide2`, `PySide2.QtCore`, `PyQt5.QtWidgets`, `ui_mainUI` and so on, for its files."""

    @property
    def base(self) -> type:
        """The base class of its `GenericWorker`."""

    @property
    def in_front(self) -> Front | None:
        """What the main thread has to run while the component runs; None for nothing."""

    @property
    def missed(self) -> int:
        """Number of timeouts that were skipped because something took too long."""

    def locked(self, change: int) -> None:
        """A lock in the user's code was taken (1) or released (-1). A thread that holds one must not run other code,
        which may want it, during a wait."""

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function of the user's on the proper thread; returns its result, or raises its exception.

        The caller is inside the component's monitor.
        """

    builtins: dict[str, Any] | None
    """The builtins of its files; set by the loader."""

    def outside(self) -> AbstractContextManager[None]:
        """Entered around a wait for a lock in the user's code; other code runs meanwhile, if possible."""

    def wait_for(self, function: Callable[[], T]) -> T:
        """Call a blocking function for the user's code, on any thread, while other code may run."""

    def begin(self, now: int) -> None:
        """Called once, before the first `run`: timers that were started before are not late. The time is that of the
        component's clock, in nanoseconds, as those below."""

    def due(self, now: int) -> int:
        """The time at which something is due: `now` if it is late, NEVER if nothing is due until `wake` is called."""

    def run(self, now: int) -> None:
        """Do one due thing inside the component's monitor. Exceptions of slots are logged, but SystemExit passes."""

    def post(self, call: Callable[[], object]) -> None:
        """Queue a call, which may run inside of a `wait_for`. Safe to use from any thread. Raises ComponentError if
        too many calls wait."""

    def close(self) -> None:
        """Stop timers and close windows. Afterwards only `call` runs user code. Idempotent."""


def open_loop(
    need: Need,
    *,
    wake: Callable[[], None],
    quit: Callable[[], None],
    outside: Callable[[], AbstractContextManager[None]],
    tell: Callable[[BaseException], None],
    clock: Clock,
    folder: Path,
    name: str,
) -> Loop:
    """A loop for one component instance, before its files are imported.

    `wake` is called, from any thread, when something may be due earlier than `due` has returned; `quit` when its code
    or its last window wants the component to end. `outside` lets other code run while the calling thread waits. `tell`
    gets exceptions of slots. The stand-in's timers follow `clock`, those of real Qt the machine. `folder` holds its .ui
    files. Raises ComponentError if PySide6 is needed but missing.
    """
    if not need:
        return StandInLoop(wake, quit, outside, tell, clock)
    from .real import Real  # imports PySide6

    return Real(need, tell, folder, name, outside)


class LoopBeat(Beat):
    """The beat of a component whose loop decides when it is due."""

    def __init__(self, loop: Loop, period: float) -> None:
        super().__init__(period, 0)
        self._loop = loop

    def due(self, now: int) -> int:
        return self._loop.due(now)

    def begun(self) -> None: ...

    def done(self, now: int) -> None:
        self.overruns = self._loop.missed
