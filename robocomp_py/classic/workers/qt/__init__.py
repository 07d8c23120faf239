"""Qt, for components of RoboComp's generators: the real one if their files use it, else a stand-in.

Components without windows have timers, signals and slots, mutexes; those run on the component's own thread, one thing
at a time, between what the rest of the runtime does there, and nothing has to be installed. With windows, PySide6 is
Qt, under whatever name a file imports it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, TypeVar

from ....runtime.lifecycle import Beat
from ....runtime.worker import Front
from .alone import Alone
from .needs import Need, need

__all__ = ["Loop", "LoopBeat", "Need", "need", "open_loop"]

T = TypeVar("T")

_LONG = 3600.0
"""Seconds after which a loop that has nothing to do is asked again."""


class Loop(Protocol):
    """The event loop of one component, and Qt as its files know it."""

    @property
    def modules(self) -> Mapping[str, ModuleType]:
        """What `PySide2`, `PySide2.QtCore`, `PyQt5.QtWidgets`, `ui_mainUI` mean in its files."""

    @property
    def base(self) -> type:
        """What its `GenericWorker` derives from."""

    @property
    def in_front(self) -> Front | None:
        """What the main thread has to do while the component lives, if anything."""

    @property
    def missed(self) -> int:
        """How many beats of timers were left out, because something took too long."""

    def locked(self, change: int) -> None:
        """A lock of the user's was taken (1), or let go of (-1): whoever waits while it has one calls nothing that may
        want it on the same thread."""

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call something of the user's where it has to run, and return what it returns, or raise what it raises.

        The caller is inside the component's monitor.
        """

    builtins: dict[str, Any] | None
    """Those of its files; to be set by who loads them."""

    def outside(self) -> AbstractContextManager[None]:
        """Around a wait for a lock in the user's code: others are let in meanwhile, as far as that can be."""

    def wait_for(self, function: Callable[[], T]) -> T:
        """Call a function that waits, for the user's code, on whatever thread: others are let in meanwhile."""

    def due(self, now: float) -> float | None:
        """Seconds until there is something to do; 0: it is time; None: nothing until `wake` is called."""

    def run(self, now: float) -> None:
        """Do one thing that is due, inside the component's monitor. What slots raise is told; SystemExit is raised."""

    def post(self, call: Callable[[], object]) -> None:
        """Have something called when it is its turn, which may be inside of a `wait_for`. From any thread; raises
        ComponentError if too much waits."""

    def close(self) -> None:
        """Stop timers, close windows. Nothing of the user's is called afterwards but by `call`. Idempotent."""


def open_loop(
    need: Need,
    *,
    wake: Callable[[], None],
    quit: Callable[[], None],
    outside: Callable[[], AbstractContextManager[None]],
    tell: Callable[[BaseException], None],
    folder: Path,
    name: str,
) -> Loop:
    """A loop for one component instance, before its files are imported.

    `wake` is called from any thread when there may be something to do sooner than `due` said, `quit` when its code or
    its last window wants the component to end. `outside` lets others in while the calling thread waits. `tell` is given
    what slots raise. `folder` is where its .ui files are. Raises ComponentError if PySide6 is needed and not there.
    """
    if not need:
        return Alone(wake, quit, outside, tell)
    from .real import Real  # imports PySide6

    return Real(need, tell, folder, name, outside)


class LoopBeat(Beat):
    """The beat of a component whose loop says when it is time."""

    def __init__(self, loop: Loop, period: float) -> None:
        super().__init__(period, 0.0)
        self._loop = loop

    def due(self, now: float) -> float:
        seconds = self._loop.due(now)
        return _LONG if seconds is None else min(seconds, _LONG)

    def done(self, now: float) -> None:
        self.overruns = self._loop.missed
