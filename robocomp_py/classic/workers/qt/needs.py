"""Decides whether a component needs real Qt: by the names that its files use, not by those that they import.

RoboComp's generators wrote `from PySide2.QtWidgets import QApplication` into components without any window, and for
years `from PySide import QtGui`; what they use of that is `QApplication.instance().quit`, which the stand-in has.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import PurePath
from typing import Any

from ....runtime.clock import Virtual
from ..python2 import parsed
from .agenda import Agenda
from .core import EventContext, core
from .mutex import MutexSet

ROOTS = ("PySide", "PySide2", "PySide6", "PyQt4", "PyQt5", "PyQt6")
"""The packages from which files import Qt."""

START = "specificworker"

_CLASS = re.compile(r"Q(?=\w*[a-z])[A-Z0-9]\w*|q[A-Z][a-z]\w*App|pyqt(Signal|Slot|Property)")
"""What looks like a name of Qt, if its origin is unknown."""

_VALUES = frozenset({
    "QByteArray", "QDate", "QDateTime", "QDir", "QElapsedTimer", "QEvent", "QEventLoop", "QFile", "QLine",
    "QLineF", "QMargins", "QMetaObject", "QPoint", "QPointF", "QProcess", "QRandomGenerator", "QRect", "QRectF",
    "QRunnable", "QSemaphore", "QSettings", "QSize", "QSizeF", "QThread", "QThreadPool", "QTime", "QUrl",
    "QWaitCondition", "QColor", "QImage", "QMatrix4x4", "QPolygon", "QPolygonF", "QQuaternion", "QTransform",
    "QVector2D", "QVector3D", "QVector4D",
})  # fmt: skip
"""Names of QtCore and QtGui that work without a screen."""


@dataclass(frozen=True)
class Use:
    """A name of Qt that a file uses and the stand-in does not have."""

    file: str
    line: int
    module: str
    """For example `QtWidgets`; empty if the text does not show it."""
    name: str
    """`QLabel`, `Qt.AlignCenter`; empty for a window made of an .ui file."""

    @property
    def needs_screen(self) -> bool:
        first = self.name.partition(".")[0]
        return self.module != "QtCore" and first not in _VALUES

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {'.'.join(filter(None, (self.module, self.name)))}"


@dataclass(frozen=True)
class Need:
    """What a component needs of Qt; false if the stand-in suffices."""

    uses: tuple[Use, ...] = ()
    window: str = ""
    """The window class in the `gui` statement of the CDSL: `QWidget`, `QMainWindow`."""

    def __bool__(self) -> bool:
        return bool(self.uses or self.window)

    @property
    def screen(self) -> bool:
        """Whether it uses windows, or classes that draw."""
        return bool(self.window) or any(use.needs_screen for use in self.uses)

    @property
    def why(self) -> str:
        """One line for messages."""
        if self.window:
            return f"its .cdsl says `gui` ({self.window})"
        more = f" and {len(self.uses) - 1} more" if len(self.uses) > 1 else ""
        return f"{self.uses[0]}{more}" if self.uses else "nothing"


def need(sources: Mapping[str, str], window: str = "") -> Need:
    """What a component needs, from its files (name → text): the specific part and the files that it imports.

    Files that are not Python 3 count as empty; importing them reports the error.
    """
    trees = {PurePath(file).stem: (file, _parsed(text)) for file, text in sources.items()}
    own = {node.name for _, tree in trees.values() for node in ast.walk(tree) if isinstance(node, _DEFINITION)}
    wanted, seen, uses = [START] if START in trees else list(trees), set[str](), list[Use]()
    while wanted:
        stem = wanted.pop()
        if stem in seen or stem not in trees:
            continue
        seen.add(stem)
        file, tree = trees[stem]
        reading = _Reading(file, own)
        reading.read(tree)
        uses += reading.uses
        wanted += reading.modules
    return Need(tuple(dict.fromkeys(uses)), window)


_DEFINITION = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def _parsed(text: str) -> ast.Module:
    try:
        return parsed(text, "its file")
    except (SyntaxError, ValueError):
        return ast.Module([], [])


class _Reading(ast.NodeVisitor):
    """Reads one file: the meanings of its names, then the names that it uses."""

    def __init__(self, file: str, own: set[str]) -> None:
        self.uses: list[Use] = []
        self.modules: list[str] = []
        self._file, self._own = file, set(own)
        self._means: dict[str, str] = {}
        """`QtCore` → `QtCore`, `Q` → `QtWidgets.QLabel`, `PySide2` → ``: where names lead to below a root."""

    def read(self, tree: ast.Module) -> None:
        body = [node for node in tree.body if not _is_main(node)]
        for statement in body:
            for node in ast.walk(statement):
                self._note(node)
        for statement in body:
            self.visit(statement)

    def _note(self, node: ast.AST) -> None:
        match node:
            case ast.Import():
                for alias in node.names:
                    root, _, below = alias.name.partition(".")
                    if root in ROOTS:
                        self._means[alias.asname or root] = below if alias.asname else ""
                    else:
                        self._imports(node.lineno, root)
                        self._own.add(alias.asname or root)
            case ast.ImportFrom(module=str(module), level=0):
                root, _, below = module.partition(".")
                if root in ROOTS:
                    for alias in node.names:
                        self._means[alias.asname or alias.name] = f"{below}.{alias.name}".lstrip(".")
                else:
                    self._imports(node.lineno, root)
                    self._own.update(alias.asname or alias.name for alias in node.names)
            case ast.Name(ctx=ast.Store()):
                self._own.add(node.id)
            case ast.arg():
                self._own.add(node.arg)
            case _:
                pass

    def _imports(self, line: int, module: str) -> None:
        self.modules.append(module)
        if module.startswith("ui_"):  # made of an .ui file
            self.uses.append(Use(self._file, line, module, ""))

    def visit_Attribute(self, node: ast.Attribute) -> None:
        chain, inner = [node.attr], node.value
        while isinstance(inner, ast.Attribute):
            chain.insert(0, inner.attr)
            inner = inner.value
        if isinstance(inner, ast.Name):
            self._used(node.lineno, inner.id, chain)
        else:
            self.visit(inner)

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load):
            self._used(node.lineno, node.id, [])

    def _used(self, line: int, name: str, chain: list[str]) -> None:
        if name in self._means:
            path = [*self._means[name].split("."), *chain] if self._means[name] else chain
        elif name in self._own:
            return
        elif name.startswith("Qt") and name[2:3].isupper():  # by way of `from genericworker import *`
            path = [name, *chain]
        elif _CLASS.fullmatch(name):
            path = ["", name, *chain]
        else:
            return
        module, *names = path or [""]
        if names and names[0] == module:  # as in `from PySide2.QtCharts import QtCharts`
            names = names[1:]
        if names and names != ["*"] and not provided(names):
            self.uses.append(Use(self._file, line, module, ".".join(names)))


def _is_main(node: ast.stmt) -> bool:
    """Whether a node is `if __name__ == "__main__":`, which does not run here."""
    return isinstance(node, ast.If) and any(isinstance(n, ast.Name) and n.id == "__name__" for n in ast.walk(node.test))


def provided(names: list[str]) -> bool:
    """Whether the stand-in has a name; attributes of objects are not checked."""
    found: Any = _stand_in().get(names[0])
    if found is None:
        return False
    for name in names[1:]:
        if not isinstance(found, type):
            return True
        if not hasattr(found, name):
            return False
        found = getattr(found, name)
    return True


@cache
def _stand_in() -> dict[str, Any]:
    context = EventContext(Agenda(lambda: None, Virtual()), lambda exc: None, lambda: None, nullcontext)
    return core(context, MutexSet(nullcontext))
