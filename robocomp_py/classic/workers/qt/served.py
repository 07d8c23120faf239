"""The modules `PySide2`, `PyQt5.QtCore`, `PySide.QtGui` and so on of one component, made at their first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Any

from ....errors import ComponentError
from .needs import ROOTS

GUI = "robocomp-py[gui]"
"""What to install."""

ALL = ("QtCore", "QtGui", "QtWidgets")
"""The names that `from PySide2 import *` imports."""

OTHERS = (
    "Qt3DAnimation", "Qt3DCore", "Qt3DExtras", "Qt3DInput", "Qt3DLogic", "Qt3DRender", "QtBluetooth",
    "QtCharts", "QtConcurrent", "QtDBus", "QtDataVisualization", "QtHelp", "QtMultimedia",
    "QtMultimediaWidgets", "QtNetwork", "QtOpenGL", "QtOpenGLWidgets", "QtPositioning", "QtPrintSupport",
    "QtQml", "QtQuick", "QtQuickWidgets", "QtSensors", "QtSerialPort", "QtSql", "QtStateMachine", "QtSvg",
    "QtSvgWidgets", "QtTest", "QtTextToSpeech", "QtUiTools", "QtWebChannel", "QtWebEngineCore",
    "QtWebEngineWidgets", "QtWebKit", "QtWebSockets", "QtXml",
)  # fmt: skip


class Served(Mapping[str, ModuleType]):
    """Modules by name, including `more`. `look_up(root, module, name)` returns the value of a name in a module."""

    def __init__(
        self,
        look_up: Callable[[str, str, str], Any],
        exported: Callable[[str, str], list[str]],
        more: Mapping[str, Callable[[], ModuleType]],
    ) -> None:
        self._look_up, self._exported, self._more = look_up, exported, more
        below = [f"{root}.{name}" for root in ROOTS for name in (*ALL, *OTHERS)]
        self._names = dict.fromkeys([*ROOTS, *below, *more])
        self._made: dict[str, ModuleType] = {}

    def __getitem__(self, name: str) -> ModuleType:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._made:
            root, _, below = name.partition(".")
            made = self._more[name]() if name in self._more else self._module(root, below)
            self._made[name] = made
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def _module(self, root: str, below: str) -> ModuleType:
        if below:
            return _Part(root, below, self._look_up, self._exported)
        return _Root(root, self)


class _Root(ModuleType):
    """The package `PySide2`, with its modules as attributes."""

    __all__ = ALL

    def __init__(self, name: str, served: Served) -> None:
        super().__init__(name)
        self.__path__: list[str] = []
        self._served = served

    def __getattr__(self, name: str) -> ModuleType:
        try:
            return self._served[f"{self.__name__}.{name}"]
        except KeyError:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}") from None


class _Part(ModuleType):
    """A module such as `PySide2.QtCore`, whose names are looked up at their first use."""

    def __init__(
        self, root: str, below: str, look_up: Callable[[str, str, str], Any], exported: Callable[[str, str], list[str]]
    ) -> None:
        super().__init__(f"{root}.{below}")
        self._place = root, below
        self._look_up, self._exported = look_up, exported

    def __getattr__(self, name: str) -> Any:
        if name == "__all__":
            return self._exported(*self._place)
        if name.startswith("__"):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        found = self._look_up(*self._place, name)
        setattr(self, name, found)
        return found

    def __dir__(self) -> list[str]:
        return self._exported(*self._place)


class Absent:
    """Stands for a name that the stand-in lacks. Importing it is allowed, because many files import unused names."""

    def __init__(self, name: str) -> None:
        self._qt_name = name

    def _qt_missed(self) -> ComponentError:
        return ComponentError(
            f"{self._qt_name} needs Qt, but this component runs without it, because its files did not seem to use Qt; "
            f"write `gui Qt(QWidget);` into its .cdsl, and run: pip install '{GUI}'"
        )

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise self._qt_missed()

    def __call__(self, *_: Any, **__: Any) -> Any:
        raise self._qt_missed()

    def __mro_entries__(self, bases: tuple[Any, ...]) -> tuple[type, ...]:
        raise self._qt_missed()

    def __repr__(self) -> str:
        return f"<{self._qt_name}, which needs Qt>"
