"""Components with real Qt, run as their users run them, with hidden windows."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import dedent

import pytest

from robocomp_py.testing.patience import SOON

from ..components import Form, made

pytestmark = pytest.mark.tool

INTERFACES = {
    "Echo.idsl": "module RoboCompEcho { interface Echo { string echo(string text); }; };",
    "Back.idsl": "module RoboCompBack { interface Back { string ask(string text); }; };",
}

FORM = """\
<?xml version="1.0" encoding="UTF-8"?>
<ui version="4.0">
 <class>guiDlg</class>
 <widget class="QWidget" name="guiDlg">
  <layout class="QVBoxLayout" name="layout">
   <item><widget class="QLabel" name="label"/></item>
   <item><widget class="QPushButton" name="button"/></item>
   {more}
  </layout>
 </widget>
 {below}
</ui>
"""

HEAD = """
import sys, threading
from PySide2.QtCore import QTimer
from PySide2.QtWidgets import QApplication
from genericworker import *

def say(*words):
    print(*words, "main" if threading.current_thread() is threading.main_thread() else "elsewhere", flush=True)

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map)
        self.Period = 20
        self.timer.timeout.connect(self.compute)
        self.timer.start(self.Period)

    def setParams(self, params):
        return True
"""


@pytest.fixture
def component(tmp_path: Path) -> Callable[..., Path]:
    """Makes the folder of a component as RoboComp's generator did, and adds what ours does."""

    def make(body: str, name: str = "view", ports: str = "", gui: str = "gui Qt(QWidget);", **files: str) -> Path:
        imports = "".join(f'import "{each}";\n' for each in INTERFACES)
        cdsl = f"{imports}Component {name} {{ Communications {{ {ports} }}; language Python; {gui} }};"
        text = body if "class SpecificWorker" in body else HEAD + body
        more = {f"src/{file.replace('_dot_', '.')}": dedent(content) for file, content in files.items()}
        if gui:
            more["src/mainUI.ui"] = FORM.format(more="", below="")
        return made(tmp_path / name, Form(cdsl, text, more={**INTERFACES, **more}))

    return make


class Program:
    """A program that runs, and what it prints."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.printed: list[str] = []

    def wait_for(self, text: str) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.printed.append(line.rstrip())
            if text in line:
                return
        raise AssertionError(f"it ended without `{text}`: {self.printed}")

    def ended(self) -> int:
        """Its exit code, when it has ended."""
        rest, _ = self.process.communicate(timeout=6 * SOON)
        self.printed += rest.splitlines()
        return self.process.returncode


@contextmanager
def running(*folders: Path, **environment: str) -> Iterator[Program]:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(folders[0])]
    for folder in folders[1:]:
        command += ["+", str(folder)]
    surroundings = {**os.environ, "QT_QPA_PLATFORM": "offscreen", **environment}
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={key: value for key, value in surroundings.items() if value},
    ) as process:
        try:
            yield Program(process)
        finally:
            process.kill()


BODY = """
    @QtCore.Slot()
    def compute(self):
        self.ui.label.setText("computed")
        say(self.ui.label.text())
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_window_lives_in_the_main_thread_until_a_signal_ends_it(
    component: Callable[..., Path], number: signal.Signals
) -> None:
    with running(component(BODY)) as program:
        program.wait_for("computed main")
        program.process.send_signal(number)
        assert program.ended() == 128 + number


def test_an_exception_of_a_slot_is_logged_and_the_component_continues(component: Callable[..., Path]) -> None:
    body = """
    computed = 0

    def compute(self):
        self.computed += 1
        if self.computed == 1:
            raise ValueError("bad")
        if self.computed == 3:
            self.ui.button.clicked.connect(self.close)
            self.ui.button.click()

    def closeEvent(self, event):
        say("closing")
"""
    with running(component(body)) as program:
        assert program.ended() == 0
    told = "\n".join(program.printed)
    assert "SpecificWorker.compute raised" in told
    assert "ValueError: bad" in told
    assert "robocomp_py" not in told  # of the package's own frames
    assert "closing main" in told


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("QApplication.instance().quit()", 0),
        ("QtCore.QCoreApplication.quit()", 0),
        ("self.close()", 0),
        ("self.killYourSelf()", 0),
        ("sys.exit(3)", 3),
        ("sys.exit()", 0),
    ],
)
def test_the_ways_in_which_a_window_ends_its_component(
    component: Callable[..., Path], statement: str, code: int
) -> None:
    with running(component(f"\n    def compute(self):\n        {statement}\n")) as program:
        assert program.ended() == code


def test_a_dialog_that_waits_for_its_user_is_no_reason_to_stay(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        self.timer.stop()
        QTimer.singleShot(0, lambda: say("asking"))
        QtWidgets.QMessageBox(self).exec_()
        say("asked")
"""
    with running(component(body)) as program:
        program.wait_for("asking main")
        program.process.send_signal(signal.SIGTERM)
        assert program.ended() == 128 + signal.SIGTERM
    assert "asked main" in program.printed


CALLER = """
    def compute(self):
        self.timer.stop()
        say(self.back_proxy.ask("hello"))
        QApplication.quit()

    def Echo_echo(self, text):
        self.ui.label.setText(text.upper())
        say("handling")
        return self.ui.label.text()
"""

ANSWERER = """
from genericworker import *

class SpecificWorker(GenericWorker):
    def Back_ask(self, text):
        return self.echo_proxy.echo(text) + "!"
"""


def test_handlers_run_in_the_main_thread_while_it_waits_for_their_client(
    component: Callable[..., Path],
) -> None:
    view = component(CALLER, ports="requires Back; implements Echo;")
    back = component(ANSWERER, "back", ports="requires Echo; implements Back;", gui="")
    with running(view, back) as program:
        program.wait_for("HELLO! main")
        assert program.ended() == 0
    assert "handling main" in program.printed


def test_what_is_called_when_an_answer_comes_runs_in_the_main_thread(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        self.timer.stop()
        self.back_proxy.askAsync("hello").add_done_callback(self.answered)

    def answered(self, answer):
        self.ui.label.setText(answer.result())
        say(self.ui.label.text())
        QApplication.quit()
"""
    view = component(body, ports="requires Back;")
    answerer = ANSWERER.replace("self.echo_proxy.echo(text)", "text")
    back = component(answerer, "back", ports="implements Back;", gui="")
    with running(view, back) as program:
        program.wait_for("hello! main")
        assert program.ended() == 0


@pytest.mark.parametrize(
    ("made", "wait", "end"),
    [
        ("threading.Event()", "self.came.wait(60)", "self.came.set()"),
        ("queue.Queue()", "self.came.get(timeout=60)", "self.came.put(True)"),
        ("futures.Future()", "self.came.result(60)", "self.came.set_result(True)"),
        ("threading.Condition()", "wait(self.came)", "notify(self.came)"),
    ],
)
def test_what_waits_in_the_main_thread_has_answers_and_handlers_come(
    component: Callable[..., Path], made: str, wait: str, end: str
) -> None:
    body = f"""
    def setParams(self, params):
        import queue
        from concurrent import futures
        self.came, self.called = {made}, threading.Event()
        return True

    def compute(self):
        self.timer.stop()
        self.back_proxy.askAsync("hello").add_done_callback(self.answered)
        say("waited:", {wait} and self.called.wait(60))
        QApplication.quit()

    def answered(self, answer):
        self.ui.label.setText(answer.result())
        say(self.ui.label.text())
        {end}

    def Echo_echo(self, text):
        self.called.set()
        return text

def wait(condition):
    with condition:
        return condition.wait(60)

def notify(condition):
    with condition:
        condition.notify()
"""
    view = component(body, ports="requires Back; implements Echo;")
    back = component(ANSWERER, "back", ports="requires Echo; implements Back;", gui="")
    with running(view, back) as program:
        program.wait_for("waited: True main")
        assert program.ended() == 0
    assert "hello! main" in program.printed


def test_what_is_called_when_an_answer_comes_and_waits_is_waited_for_by_the_next(
    component: Callable[..., Path],
) -> None:
    body = """
    def compute(self):
        self.timer.stop()
        self.number, self.called = 0, threading.Event()
        for _ in range(3):
            self.back_proxy.askAsync("hello").add_done_callback(self.answered)
        self.called.wait(60)
        say("fine")
        QApplication.quit()

    def answered(self, answer):
        import time
        self.number += 1
        number = self.number
        time.sleep(0.1)
        say("number", number)
        if number == 3:
            self.called.set()
        raise ValueError("bad")
"""
    view = component(body, ports="requires Back;")
    answerer = ANSWERER.replace("self.echo_proxy.echo(text)", "text")
    back = component(answerer, "back", ports="implements Back;", gui="")
    with running(view, back) as program:
        program.wait_for("fine main")
        assert program.ended() == 0
    assert [each for each in program.printed if "number" in each] == [f"number {each} main" for each in (1, 2, 3)]
    assert any("SpecificWorker.answered raised" in each for each in program.printed)


def test_the_end_does_not_come_inside_of_a_wait(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        import time
        from concurrent.futures import ThreadPoolExecutor
        self.timer.stop()
        self.pool = ThreadPoolExecutor(1)
        say("sleeping")
        time.sleep(0.5)
        say(self.pool.submit(str, "as before").result())
"""
    with running(component(body)) as program:
        program.wait_for("sleeping")
        program.process.send_signal(signal.SIGTERM)
        assert program.ended() == 128 + signal.SIGTERM
    assert "as before main" in program.printed


def test_with_a_lock_taken_a_wait_lets_no_handler_in(component: Callable[..., Path]) -> None:
    body = """
    def setParams(self, params):
        self.lock = threading.Semaphore(1)
        return True

    def compute(self):
        import time
        self.timer.stop()
        answer = self.back_proxy.askAsync("hello")
        with self.lock:
            time.sleep(0.5)
            say("slept")
        say(answer.result())
        QApplication.quit()

    def Echo_echo(self, text):
        with self.lock:
            say("handling")
        return text
"""
    view = component(body, ports="requires Back; implements Echo;")
    back = component(ANSWERER, "back", ports="requires Echo; implements Back;", gui="")
    with running(view, back) as program:
        program.wait_for("hello! main")
        assert program.ended() == 0
    assert program.printed.index("slept main") < program.printed.index("handling main")


NESTED = """
    def compute(self):
        self.timer.stop()
        with QtCore.QMutexLocker(self.mutex):
            pass
        say(self.back_proxy.ask("hello"))

    def Echo_echo(self, text):
        with QtCore.QMutexLocker(self.mutex):
            say("handling", text)
        if len(text) < 8:
            return self.back_proxy.ask(text + "o")
        return text
"""


def test_calls_and_handlers_may_nest(component: Callable[..., Path]) -> None:
    view = component(NESTED, ports="requires Back; implements Echo;")
    back = component(ANSWERER, "back", ports="requires Echo; implements Back;", gui="")
    with running(view, back) as program:
        program.wait_for("helloooo!!!! main")
        program.process.send_signal(signal.SIGTERM)
        assert program.ended() == 128 + signal.SIGTERM
    assert [each for each in program.printed if "handling" in each] == [
        f"handling hell{'o' * number} main" for number in range(1, 5)
    ]


def test_two_windows_of_one_process_share_the_main_thread(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        windows = [each for each in QApplication.topLevelWidgets() if each.isVisible()]
        if len(windows) == 2:
            self.ui.label.setText("both")
            say(self.ui.label.text())
"""
    one, other = component(body, "one"), component(body, "other")
    with running(one, other) as program:
        program.wait_for("both main")
        program.process.send_signal(signal.SIGTERM)
        assert program.ended() == 128 + signal.SIGTERM


@pytest.mark.parametrize("order", [("fine", "broken"), ("broken", "fine")])
def test_a_window_that_cannot_be_made_ends_the_others_of_its_process_in_order(
    component: Callable[..., Path], order: tuple[str, str]
) -> None:
    body = """
    def compute(self):
        pass

    def __del__(self):
        say("gone")
"""
    fine, broken = (
        HEAD.replace("        self.Period = 20\n", f"        {instead}\n        self.Period = 20\n")
        for instead in ('say("came")', "raise ValueError('no camera')")
    )
    folders = {"fine": component(fine + body, "fine"), "broken": component(broken, "broken")}
    with running(*(folders[name] for name in order)) as program:
        assert program.ended() == 1
    told = "\n".join(program.printed)
    assert "broken ERROR: the start of SpecificWorker raised ValueError" in told
    assert told.count("gone main") == told.count("came main")  # it may not even come, if the other one begins


def test_an_exception_of_a_slot_is_logged_by_its_component(component: Callable[..., Path]) -> None:
    failing = "\n    def compute(self):\n        self.timer.stop()\n        raise ValueError('bad')\n"
    with running(component(BODY, "fine"), component(failing, "failing")) as program:
        program.wait_for("failing ERROR: SpecificWorker.compute raised")
        program.process.send_signal(signal.SIGTERM)
        assert program.ended() == 128 + signal.SIGTERM


def test_qt_has_the_names_it_had_in_each_year(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        say(*names())
        QApplication.quit()
"""
    names = """
    from PySide import QtCore as core4, QtGui as gui4
    from PySide2.QtWidgets import *
    from PySide2.QtCore import *
    from PyQt5.QtCore import pyqtSignal, pyqtSlot, QObject
    import PySide2.QtGui

    class Old(QObject):
        done = pyqtSignal(int)

        @pyqtSlot(int)
        def note(self, number):
            self.number = number

    def names():
        old = Old()
        old.done.connect(old.note)
        old.done.emit(3)
        mutex = QMutex(QMutex.Recursive)
        with QMutexLocker(mutex), QMutexLocker(mutex):
            pass
        try:
            core4.QString
        except AttributeError:
            text = "no QString"
        found = [gui4.QLabel, QAction, QShortcut, PySide2.QtGui.QColor, gui4.QApplication]
        assert qApp is QApplication.instance() and core4.qrand() >= 0 and QMessageBox.exec_
        return [old.number, text, *(each.__name__ for each in found)]
"""
    with running(component("from names import names\n" + HEAD + body, names_dot_py=names)) as program:
        wanted = "3 no QString QLabel QAction QShortcut QColor QApplication main"
        program.wait_for(wanted)
        assert program.ended() == 0


@pytest.mark.parametrize("header", ["dial.h", "dial.py"])
def test_a_form_may_have_widgets_of_the_component(component: Callable[..., Path], header: str) -> None:
    folder = component(
        "\n    def compute(self):\n        say(self.ui.dial.value())\n        self.close()\n",
        dial_dot_py="""
        from PySide2.QtWidgets import QWidget

        class Dial(QWidget):
            def value(self):
                return "my own dial"
        """,
    )
    more = '<item><widget class="Dial" name="dial"/></item>'
    below = "<customwidgets><customwidget><class>Dial</class><extends>QWidget</extends>"
    form = FORM.format(more=more, below=f"{below}<header>{header}</header></customwidget></customwidgets>")
    (folder / "src" / "mainUI.ui").write_text(form)
    with running(folder) as program:
        program.wait_for("my own dial main")
        assert program.ended() == 0


@pytest.mark.parametrize(
    ("form", "told"),
    [
        ("<ui><widget></ui>", "mainUI.ui cannot be made into a window: "),
        (FORM.format(more="", below="").replace("guiDlg", "Form"), "mainUI.ui: its <class> has to be guiDlg"),
    ],
)
def test_a_broken_form_is_named(component: Callable[..., Path], form: str, told: str) -> None:
    folder = component(BODY)
    (folder / "src" / "mainUI.ui").write_text(form)
    with running(folder) as program:
        assert program.ended() == 1
    assert told in program.printed[0]


def test_without_a_screen_it_says_so(component: Callable[..., Path]) -> None:
    with running(component(BODY), QT_QPA_PLATFORM="", DISPLAY="", WAYLAND_DISPLAY="") as program:
        assert program.ended() == 1
    assert "view has a window, and there is no screen to show it on" in program.printed[0]
    assert "(it needs Qt: its .cdsl says `gui` (QWidget))" in program.printed[1]


def test_what_needs_no_screen_runs_without(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        from PySide2.QtGui import QPolygonF
        say(QtCore.QPointF(1, 2).x(), QPolygonF([QtCore.QPointF(1, 2)]).size())
        QtCore.QCoreApplication.quit()
"""
    folder = component(body, gui="")
    with running(folder, QT_QPA_PLATFORM="", DISPLAY="", WAYLAND_DISPLAY="") as program:
        program.wait_for("1.0 1 main")
        assert program.ended() == 0


def test_qts_threads_may_emit_signals(component: Callable[..., Path]) -> None:
    body = """
    heard = QtCore.Signal(str)
    thread = None

    def compute(self):
        if self.thread is None:
            self.heard.connect(self.note)
            self.thread = Listener(self)
            self.thread.start()

    def note(self, text):
        say("heard", text)
        self.thread.wait()
        QApplication.quit()

class Listener(QtCore.QThread):
    def __init__(self, worker):
        super().__init__()
        self.worker = worker

    def run(self):
        say("listening")
        self.worker.heard.emit("news")
"""
    with running(component(body, gui="")) as program:
        program.wait_for("listening elsewhere")
        program.wait_for("heard news main")
        assert program.ended() == 0


def test_what_was_posted_from_elsewhere_runs_in_the_main_thread(tmp_path: Path) -> None:
    script = """
    import sys, threading
    from contextlib import nullcontext
    from pathlib import Path
    from robocomp_py.classic.workers.qt import Need, open_loop
    from robocomp_py.runtime.clock import Real

    loop = open_loop(Need(window="QWidget"), wake=print, quit=print, outside=nullcontext, tell=print,
                     clock=Real(), folder=Path("."), name="post")
    done = threading.Event()

    def note():
        print(threading.current_thread() is threading.main_thread())
        done.set()

    def life():
        loop.post(note)
        loop.call(lambda: None)
        return done.wait(30)

    print(loop.in_front(life, lambda: None))
    """
    (tmp_path / "post.py").write_text(dedent(script))
    command = [sys.executable, str(tmp_path / "post.py")]
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    assert subprocess.check_output(command, env=environment, text=True) == "True\nTrue\n"


def test_a_wait_for_which_there_is_no_thread_begins_later_and_once(tmp_path: Path) -> None:
    script = """
    import threading
    from contextlib import nullcontext
    from robocomp_py.classic.workers.qt.front import Front
    from robocomp_py.errors import ComponentError
    from robocomp_py.threads import start_thread

    spare, asked, served, done = 1, [], threading.Event(), threading.Event()

    def start(thread):  # as in a system that can have so many
        global spare
        spare -= 1
        return spare >= 0 and start_thread(thread)

    def ask():
        asked.append(threading.current_thread() is threading.main_thread())
        return "answered"

    def wait():
        print(front.wait_for(ask))
        print(asked)
        done.set()

    def life():
        global spare
        front.post(wait)
        front.call(lambda: print("served", asked), nullcontext)
        spare = 1
        return done.wait(60)

    front = Front(False, "scarce", start)
    print(front.live(life, lambda: None))
    spare = 0
    try:
        front.live(life, lambda: None)
    except ComponentError:
        print("told")
    """
    (tmp_path / "scarce.py").write_text(dedent(script))
    command = [sys.executable, str(tmp_path / "scarce.py")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=6 * SOON)
    assert done.stdout.splitlines() == ["served []", "answered", "[False]", "True", "told"]
    assert "waits begin later" in done.stderr


def test_a_component_that_ends_gives_up_a_wait_for_which_there_is_no_thread(tmp_path: Path) -> None:
    script = """
    import threading
    from robocomp_py.classic.workers.qt.front import Front
    from robocomp_py.errors import Closed
    from robocomp_py.threads import start_thread

    spare, waits = 1, threading.Event()

    def start(thread):
        global spare
        spare -= 1
        return spare >= 0 and start_thread(thread)

    def wait():
        waits.set()
        try:
            front.wait_for(lambda: print("asked"))
        except Closed:
            print("closed")

    def life():
        front.post(wait)
        return waits.wait(60)

    front = Front(False, "scarce", start)
    print(front.live(life, lambda: None))
    """
    (tmp_path / "scarce.py").write_text(dedent(script))
    command = [sys.executable, str(tmp_path / "scarce.py")]
    assert subprocess.check_output(command, text=True, timeout=6 * SOON) == "closed\nTrue\n"


def test_names_of_qt_come_with_the_form(component: Callable[..., Path]) -> None:
    body = """
    def compute(self):
        self.timer.stop()
        self.ui.layout.addLayout(QVBoxLayout())
        say(QPoint(1, 2).x(), QColor(255, 0, 0).red())
        QtWidgets.QApplication.quit()
"""
    with running(component(body)) as program:
        program.wait_for("1 255 main")
        assert program.ended() == 0


ECHO = """
    def compute(self):
        pass

    def Echo_echo(self, text):
        return text
"""

MANY_CALLS = """
from genericworker import *

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map)
        self.timer.timeout.connect(self.compute)
        self.timer.start(20)

    def compute(self):
        self.timer.stop()
        for number in range(20000):
            assert self.echo_proxy.echo(str(number)) == str(number)
        print("20000 calls", flush=True)
"""


def test_a_component_with_a_window_answers_any_number_of_calls(component: Callable[..., Path]) -> None:
    view = component(ECHO, ports="implements Echo;")
    back = component(MANY_CALLS, "back", ports="requires Echo;", gui="")
    with running(view, back) as program:
        program.wait_for("20000 calls")
        program.process.send_signal(signal.SIGTERM)
        assert program.ended() == 128 + signal.SIGTERM
