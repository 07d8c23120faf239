"""The loop of a component that uses real Qt: PySide6, whatever version of Qt its files import."""

from __future__ import annotations

import importlib.abc
import importlib.util
import re
import subprocess
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from ....errors import ComponentError
from ....runtime.clock import SECOND
from .core import rand
from .front import Front, Joined, qt
from .mutex import MutexSet, mutexes
from .needs import Need
from .served import ALL, Served

T = TypeVar("T")

_SISTERS = ("QtCore", "QtGui", "QtWidgets", "QtStateMachine", "QtOpenGLWidgets", "QtSvgWidgets", "QtPrintSupport")
"""Modules in which names are now that used to be in another module of Qt."""

ADDONS = "pip install PySide6"
"""Has charts, 3D, multimedia, which are no part of what `gui` installs."""

_MOVED = {
    "QtWidgets": (
        "QAction",
        "QActionGroup",
        "QFileSystemModel",
        "QShortcut",
        "QUndoCommand",
        "QUndoGroup",
        "QUndoStack",
    ),
    "QtCore": ("QState", "QFinalState", "QStateMachine", "QSignalTransition"),
}
"""Of these, `import *` has to know, if they are installed."""

_HEADER = re.compile(r"(<header[^<>]*>[^<>]*?)\.py\s*(?=</header>)")
"""Where a widget of the user's is, written as a file of Python's: Qt's compiler wants a module, or a file of C++'s."""

_ASK = SECOND
"""Period of the checks whether the main thread still answers."""

_REST_S = 2.0
"""Seconds that a waiting slot or handler has, at the end of the component."""


class Real:
    """See `Loop`."""

    missed = 0
    """Qt does not tell."""

    def __init__(
        self,
        need: Need,
        tell: Callable[[BaseException], None],
        folder: Path,
        name: str,
        outside: Callable[[], AbstractContextManager[None]],
    ) -> None:
        try:
            self._front = Front.there(need.screen, name)
        except ComponentError as exc:
            raise ComponentError(f"{exc}\n(it needs Qt: {need.why})") from exc
        self._outside = outside
        self._keeper = MutexSet(self.outside, self._front.freed)
        self._own = self._names()
        self.base: type = self._base(need.window)
        self.builtins: dict[str, Any] | None = None
        """Those of the component's files: what `import` means in them."""
        self.modules: Mapping[str, ModuleType] = Served(self._look_up, self._exported, self._forms(folder))
        joined = Joined(folder, tell, lambda: self._keeper.any_locked)
        self._leave: Callable[[], None] | None = self._front.join(joined)
        self._asked = 0

    @property
    def in_front(self) -> Callable[[Callable[[], bool], Callable[[], None]], bool]:
        return self._front.live

    def outside(self) -> AbstractContextManager[None]:
        """Entered around a wait for a lock. The main thread does not hold the monitor: the thread that waits for the
        errand does. While a lock is held, the main thread would run nothing else anyway."""
        return nullcontext() if self._front.here else self._outside()

    def begin(self, now: int) -> None: ...

    def due(self, now: int) -> int:
        return max(now, self._asked + _ASK)

    def run(self, now: int) -> None:
        """Wait until the main thread answers; this component cannot continue before."""
        self._asked = now
        self._front.call(lambda: None, self._outside, always=True)

    def locked(self, change: int) -> None:
        self._keeper.count(change)

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        return self._front.call(partial(function, *arguments), self._outside)

    def wait_for(self, function: Callable[[], T]) -> T:
        return self._front.wait_for(function)

    def post(self, call: Callable[[], object]) -> None:
        self._front.post(call)

    def close(self) -> None:
        if self._leave is None:
            return
        leave, self._leave = self._leave, None
        self._keeper.closed = True
        self._front.call(leave, self._outside, always=True)
        with self._outside():  # the waiting code enters the monitor again
            self._front.rest(_REST_S)

    # The modules for its files.

    def _names(self) -> dict[str, Any]:
        core = qt("QtCore")
        return {
            "pyqtSignal": core.Signal,
            "pyqtSlot": core.Slot,
            "pyqtProperty": core.Property,
            "qApp": self._front.application,
            **mutexes(self._keeper),
            **rand(),
        }

    @staticmethod
    def _base(window: str) -> type:
        if not window:
            found: Any = qt("QtCore").QObject
        else:
            found = getattr(qt("QtWidgets"), window, None)
            if not (isinstance(found, type) and issubclass(found, qt("QtWidgets").QWidget)):
                raise ComponentError(
                    f"its .cdsl says `gui Qt({window});`, and Qt has no such window: QWidget, QMainWindow"
                )
        base: type = found
        return base

    def _look_up(self, root: str, module: str, name: str) -> Any:
        if module in ALL and name in self._own:
            return self._own[name]
        if _module(module) is None:
            raise ImportError(f"{root}.{module} is served by PySide6.{module} here, which is not installed: {ADDONS}")
        for sister in (module, *_SISTERS):
            found = getattr(_module(sister), name, None)
            if found is not None:
                return found
        if name == module:  # as in `from PySide2.QtCharts import QtCharts`
            return self.modules[f"{root}.{module}"]
        raise AttributeError(f"{root}.{module} is served by PySide6 here, which has no {name}")

    def _exported(self, root: str, module: str) -> list[str]:
        modules = ("QtGui", "QtWidgets") if root in ("PySide", "PyQt4") and module == "QtGui" else (module,)
        names = [name for each in modules for name in dir(_module(each)) if not name.startswith("_")]
        moved = [name for name in _MOVED.get(module, ()) if any(hasattr(_module(each), name) for each in _SISTERS)]
        return list(dict.fromkeys([*names, *moved, *(self._own if module == "QtCore" else ())]))

    def _forms(self, folder: Path) -> dict[str, Callable[[], ModuleType]]:
        return {f"ui_{file.stem}": partial(self._form, file) for file in sorted(folder.glob("src/*.ui"))}

    def _form(self, file: Path) -> ModuleType:
        """What Qt's compiler makes of an .ui file: a module with its `Ui_guiDlg`."""
        name = f"ui_{file.stem}"
        spec = importlib.util.spec_from_loader(name, _Text(_compiled(file)), origin=str(file))
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        if self.builtins is not None:
            module.__builtins__ = self.builtins  # type: ignore[attr-defined]  # promoted widgets are its own files
        spec.loader.exec_module(module)
        return module


class _Text(importlib.abc.InspectLoader):
    """Loads a module from its text."""

    def __init__(self, text: str) -> None:
        self._text = text

    def get_source(self, fullname: str) -> str:
        return self._text


def _compiled(file: Path) -> str:
    compiler = Path(qt("QtCore").__file__).parent / "Qt" / "libexec" / "uic"
    try:
        text = _HEADER.sub(r"\1", file.read_text())
        done = subprocess.run(
            [compiler, "-g", "python"], input=text, capture_output=True, text=True, timeout=60, check=True
        )
    except (OSError, UnicodeError, subprocess.SubprocessError) as exc:
        why = (getattr(exc, "stderr", None) or str(exc)).strip()
        raise ComponentError(f"{file} cannot be made into a window: {why}") from exc
    return done.stdout


@cache
def _module(name: str) -> ModuleType | None:
    """A module of PySide6; None if it is not installed."""
    try:
        found: ModuleType = qt(name)
    except ComponentError:
        return None
    return found
