"""What Qt's names mean to a component without Qt."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.classic.workers.qt import need, open_loop
from robocomp_py.errors import ComponentError
from robocomp_py.runtime.clock import Real

from .alone import Component


@pytest.fixture
def modules() -> Any:
    return Component().loop.modules


@pytest.mark.parametrize("root", ["PySide", "PySide2", "PySide6", "PyQt4", "PyQt5", "PyQt6"])
def test_qt_has_many_names(modules: Any, root: str) -> None:
    assert modules[root].QtCore is modules[f"{root}.QtCore"]
    assert modules[f"{root}.QtCore"].QTimer is modules["PySide2.QtCore"].QTimer
    assert modules[f"{root}.QtCore"].pyqtSignal is modules["PySide2.QtCore"].Signal
    assert modules[root].__path__ == []


def test_import_star_brings_what_there_is(modules: Any) -> None:
    assert set(modules["PySide"].__all__) == {"QtCore", "QtGui", "QtWidgets"}
    assert {"QObject", "QTimer", "Signal", "Slot", "QMutex", "QMutexLocker", "Qt"} <= set(
        dir(modules["PySide2.QtCore"])
    )
    assert modules["PySide2.QtWidgets"].__all__ == ["QApplication", "QGuiApplication", "qApp"]
    assert modules["PySide2.QtCharts"].__all__ == []


def test_other_modules_are_not_served(modules: Any) -> None:
    assert "PySide2.QtCharts" in modules
    assert "PySide2.Nonsense" not in modules
    with pytest.raises(AttributeError, match="module 'PySide2' has no attribute 'Nonsense'"):
        _ = modules["PySide2"].Nonsense


def test_what_is_not_there_may_be_imported_and_tells_when_it_is_used(modules: Any) -> None:
    label = modules["PySide2.QtWidgets"].QLabel
    wanted = r"PySide2\.QtWidgets\.QLabel needs Qt.*`gui Qt\(QWidget\);`.*pip install 'robocomp-py\[gui\]'"
    with pytest.raises(ComponentError, match=wanted):
        label("hello")
    with pytest.raises(ComponentError, match=wanted):
        _ = label.Shape

    def derive() -> type:
        class Mine(label):  # type: ignore[misc, valid-type]
            pass

        return Mine

    with pytest.raises(ComponentError, match=wanted):
        derive()


def test_a_missing_qt_is_an_error_with_the_reason_and_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "PySide6", None)
    needed = need({"src/specificworker.py": "from PySide2 import QtGui\nQtGui.QImage()"})
    with pytest.raises(ComponentError) as caught:
        open_loop(
            needed,
            wake=lambda: None,
            quit=lambda: None,
            outside=nullcontext,
            tell=lambda exc: None,
            clock=Real(),
            folder=tmp_path,
            name="view",
        )
    assert str(caught.value) == (
        "PySide6.QtCore is not installed: pip install 'robocomp-py[gui]'\n"
        "(it needs Qt: src/specificworker.py:2: QtGui.QImage)"
    )


def test_random_numbers_of_qt_4(modules: Any) -> None:
    core = modules["PySide.QtCore"]
    core.qsrand(7)
    first = [core.qrand() for _ in range(3)]
    core.qsrand(7)
    assert [core.qrand() for _ in range(3)] == first
    assert all(0 <= each < 2**31 for each in first)
