"""Which components need real Qt: by what their files use of it."""

from __future__ import annotations

import pytest

from robocomp_py.classic.workers.qt import need

FORM_2022 = """
from PySide2.QtCore import QTimer
from PySide2.QtWidgets import QApplication
from rich.console import Console
from genericworker import *
import interfaces as ifaces

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map)
        self.Period = 2000
        if startup_check:
            self.startup_check()
        else:
            self.timer.timeout.connect(self.compute)
            self.timer.start(self.Period)

    @QtCore.Slot()
    def compute(self):
        return True

    def startup_check(self):
        QTimer.singleShot(200, QApplication.instance().quit)
"""

FORM_2016 = """
import sys, os, traceback, time
from PySide import QtGui, QtCore
from genericworker import *

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map):
        super(SpecificWorker, self).__init__(proxy_map)
        self.timer.timeout.connect(self.compute)
        self.timer.start(self.Period)

    def setParams(self, params):
        try:
            par = params["par"]
        except:
            QtCore.QCoreApplication.quit()
        return True

    @QtCore.Slot()
    def compute(self):
        with QtCore.QMutexLocker(self.mutex):
            pass
"""


def uses(text: str, **others: str) -> list[str]:
    sources = {f"src/{name}.py": other for name, other in others.items()}
    return [str(use) for use in need({"src/specificworker.py": text, **sources}).uses]


@pytest.mark.parametrize("form", [FORM_2016, FORM_2022])
def test_what_generators_wrote_needs_no_qt(form: str) -> None:
    assert uses(form) == []
    assert not need({"src/specificworker.py": form})


def test_what_is_imported_and_not_used_is_not_needed() -> None:
    assert uses("from PySide2.QtWidgets import QLabel\nimport PySide6.QtCharts\nfrom PyQt5 import QtGui") == []


@pytest.mark.parametrize(
    ("text", "use"),
    [
        ("from PySide2.QtWidgets import QLabel\nQLabel('hello')", "2: QtWidgets.QLabel"),
        ("from PySide2.QtWidgets import QLabel as Text\ndef f(t: Text): ...", "2: QtWidgets.QLabel"),
        ("from PySide import QtGui\nQtGui.QMessageBox.question(None)", "2: QtGui.QMessageBox.question"),
        ("import PySide6.QtGui as gui\ngui.QImage()", "2: QtGui.QImage"),
        ("import PyQt5.QtWidgets\nPyQt5.QtWidgets.QDialog", "2: QtWidgets.QDialog"),
        ("from genericworker import *\nQtWidgets.QMenu(self)", "2: QtWidgets.QMenu"),
        ("from PySide2.QtWidgets import *\nQPushButton()", "2: QPushButton"),
        ("from PySide2.QtCharts import QtCharts\nQtCharts.QChart()", "2: QtCharts.QChart"),
        ("from PySide2.QtCore import Qt\nx = Qt.AlignCenter", "2: QtCore.Qt.AlignCenter"),
        ("from PySide2.QtWidgets import QApplication\nQApplication.font()", "2: QtWidgets.QApplication.font"),
        ("from PySide6.QtCore import QTimer\nclass T(QTimer): ...\nQTimer.nextBeat()", "3: QtCore.QTimer.nextBeat"),
        ("from ui_login import Ui_login", "1: ui_login"),
    ],
)  # fmt: skip
def test_what_is_used_and_the_stand_in_has_not(text: str, use: str) -> None:
    assert uses(text) == [f"src/specificworker.py:{use}"]


@pytest.mark.parametrize(
    "text",
    [
        "from pygame.locals import *\nevent = QUIT",
        "class QUserManager: ...\nQUserManager()",
        "from network import QNetwork\nQNetwork()",
        "def f(QSize): return QSize",
        "from PySide2.QtWidgets import *\nif __name__ == '__main__':\n    QWidget().show()",
        "from PySide2.QtCore import Qt\nx = Qt.QueuedConnection",
        "this is no Python",
    ],
)
def test_what_only_looks_like_qt(text: str) -> None:
    assert uses(text) == []


def test_files_count_that_the_specific_part_imports_and_so_on() -> None:
    view = "from PySide2.QtWidgets import QLabel\nQLabel()"
    assert uses("import model", model="from view import View", view=view) == ["src/view.py:2: QtWidgets.QLabel"]
    assert uses("import model", model="", view=view) == []


def test_a_window_is_needed_by_what_the_component_is() -> None:
    needed = need({"src/specificworker.py": ""}, window="QMainWindow")
    assert needed
    assert needed.screen
    assert needed.why == "its .cdsl says `gui` (QMainWindow)"


@pytest.mark.parametrize(
    ("text", "screen"),
    [
        ("from PySide2 import QtCore\nQtCore.QPointF(1, 2)", False),
        ("from PySide import QtGui\nQtGui.QPolygonF()", False),
        ("from PySide2.QtGui import *\nQVector3D()", False),
        ("from PySide2 import QtGui\nQtGui.QPixmap()", True),
        ("from PySide2.QtWidgets import *\nQLabel()", True),
        ("import ui_mainUI", True),
    ],
)
def test_numbers_and_colours_need_no_screen(text: str, screen: bool) -> None:
    needed = need({"src/specificworker.py": text})
    assert needed
    assert needed.screen == screen


def test_why_says_the_first_and_how_many_more() -> None:
    needed = need({"a.py": "from PySide2 import QtGui\nQtGui.QImage()\nQtGui.QPixmap()"})
    assert needed.why == "a.py:2: QtGui.QImage and 1 more"
