"""Objects, signals, slots and timers without Qt, in the forms in which RoboComp's components use them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from robocomp_py.runtime.clock import NEVER

from .alone import Component


@pytest.fixture
def component() -> Iterator[Component]:
    made = Component()
    yield made
    made.loop.close()


@pytest.fixture
def QtCore(component: Component) -> Any:
    return component.QtCore


def in_a_thread(call: Any) -> None:
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()


# -- signals ---------------------------------------------------------------------------


def test_each_object_has_signals_of_its_own(QtCore: Any) -> None:
    class Door(QtCore.QObject):
        opened = QtCore.Signal()

    heard: list[str] = []
    front, back = Door(), Door()
    front.opened.connect(lambda: heard.append("front"))
    back.opened.connect(lambda: heard.append("back"))
    front.opened.emit()
    assert heard == ["front"]


def test_a_slot_gets_as_many_arguments_as_it_takes(QtCore: Any) -> None:
    heard: list[Any] = []

    class Worker(QtCore.QObject):
        moved = QtCore.Signal(int, str)

        @QtCore.Slot()
        def none(self) -> None:
            heard.append(())

        @QtCore.Slot(int)
        def one(self, number: int) -> None:
            heard.append((number,))

        @QtCore.Slot
        def all(self, *arguments: Any) -> None:
            heard.append(arguments)

    worker = Worker()
    for slot in (worker.none, worker.one, worker.all):
        worker.moved.connect(slot)
    worker.moved.emit(3, "left")
    assert heard == [(), (3,), (3, "left")]


def test_a_signal_is_emitted_with_what_it_was_declared_with(QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        moved = QtCore.Signal(int)

    with pytest.raises(TypeError, match=r"moved\(int\) needs 1 argument\(s\), 0 given"):
        Worker().moved.emit()


def test_overloads_are_chosen_by_their_types(QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        said = QtCore.Signal((int,), (str,))

    heard: list[Any] = []
    worker = Worker()
    worker.said.connect(heard.append)
    worker.said[str].connect(heard.append)
    worker.said[str].emit("word")
    worker.said[int].emit(1)
    assert heard == ["word", 1]
    with pytest.raises(IndexError, match="no overload"):
        worker.said[float]


def test_a_signal_may_be_connected_to_a_signal_and_to_whatever_emits(QtCore: Any) -> None:
    class Transition:
        fired = 0

        def emit(self) -> None:
            self.fired += 1

    class Worker(QtCore.QObject):
        one, two = QtCore.Signal(), QtCore.Signal()

    worker, transition = Worker(), Transition()
    worker.one.connect(worker.two)
    worker.two.connect(transition)
    worker.one.connect(worker.two.emit)
    worker.one.emit()
    assert transition.fired == 2


def test_what_is_disconnected_is_not_called(QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        done = QtCore.Signal()
        calls = 0

        def note(self) -> None:
            self.calls += 1

    worker = Worker()
    worker.done.connect(worker.note)
    worker.done.connect(worker.note, QtCore.Qt.UniqueConnection)
    worker.done.disconnect(worker.note)
    worker.done.emit()
    assert worker.calls == 0
    with pytest.raises(RuntimeError, match="the signal done is not connected to"):
        worker.done.disconnect(worker.note)


def test_an_exception_of_a_slot_is_reported_and_other_slots_run(component: Component, QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        done = QtCore.Signal()

    def fail() -> None:
        raise ValueError("bad")

    heard: list[int] = []
    worker = Worker()
    worker.done.connect(fail)
    worker.done.connect(lambda: heard.append(1))
    worker.done.emit()
    assert heard == [1]
    assert [repr(each) for each in component.told] == ["ValueError('bad')"]


def test_sys_exit_in_a_slot_ends_the_component(QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        done = QtCore.Signal()

    def leave() -> None:
        raise SystemExit(3)

    worker = Worker()
    worker.done.connect(leave)
    with pytest.raises(SystemExit):
        worker.done.emit()


def test_a_signal_from_another_thread_waits_for_its_turn(component: Component, QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        arrived = QtCore.Signal(str)

    heard: list[tuple[str, str]] = []
    worker = Worker()
    worker.arrived.connect(lambda text: heard.append((text, threading.current_thread().name)))
    in_a_thread(lambda: worker.arrived.emit("news"))
    assert heard == []
    assert component.woken == 1
    component.run_all()
    assert heard == [("news", threading.current_thread().name)]


def test_a_connection_says_when_its_slot_is_called(component: Component, QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        done = QtCore.Signal(str)

    heard: list[str] = []
    worker = Worker()
    worker.done.connect(lambda text: heard.append(f"later {text}"), QtCore.Qt.QueuedConnection)
    worker.done.connect(lambda text: heard.append(f"at once {text}"), type=QtCore.Qt.ConnectionType.DirectConnection)
    worker.done.emit("a")
    in_a_thread(lambda: worker.done.emit("b"))
    assert heard == ["at once a", "at once b"]
    component.run_all()
    assert heard[2:] == ["later a", "later b"]


def test_the_signals_of_an_object_may_be_blocked(QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        done = QtCore.Signal()

    heard: list[int] = []
    worker = Worker()
    worker.done.connect(lambda: heard.append(1))
    worker.blockSignals(True)
    assert not worker.done.emit()
    worker.blockSignals(False)
    worker.done.emit()
    assert heard == [1]


def test_a_slot_can_ask_for_the_sender(QtCore: Any) -> None:
    senders: list[Any] = []

    class Worker(QtCore.QObject):
        done = QtCore.Signal()

        def note(self) -> None:
            senders.append(self.sender())

    one, other = Worker(), Worker()
    one.done.connect(other.note)
    one.done.emit()
    assert senders == [one]
    assert other.sender() is None


def test_connections_of_old(QtCore: Any) -> None:
    class Worker(QtCore.QObject):
        pressed = QtCore.Signal(int)

        def note(self, number: int) -> None:
            heard.append(number)

    heard: list[int] = []
    worker = Worker()
    QtCore.QObject.connect(worker, QtCore.SIGNAL("pressed(int)"), worker.note)
    worker.connect(worker, QtCore.SIGNAL("pressed(int)"), worker, QtCore.SLOT("note(int)"))
    worker.pressed.emit(2)
    assert heard == [2, 2]
    with pytest.raises(RuntimeError, match=r"Worker has no signal released\(\); declare it in its class"):
        QtCore.QObject.connect(worker, QtCore.SIGNAL("released()"), worker.note)


def test_only_objects_of_qt_have_signals(QtCore: Any) -> None:
    class Plain:
        done = QtCore.Signal()

    with pytest.raises(AttributeError, match=r"Plain\.done: only a QObject has signals"):
        Plain().done.emit()


# -- objects and timers ----------------------------------------------------------------


def test_the_worker_of_every_generation(component: Component, QtCore: Any) -> None:
    class GenericWorker(QtCore.QObject):
        kill = QtCore.Signal()

        def __init__(self, proxies: dict[str, Any]) -> None:
            super(GenericWorker, self).__init__()  # noqa: UP008 - as it was generated
            self.mutex = QtCore.QMutex(QtCore.QMutex.Recursive)
            self.Period = 30
            self.timer = QtCore.QTimer(self)

        @QtCore.Slot(int)
        def setPeriod(self, period: int) -> None:
            self.Period = period
            self.timer.start(self.Period)

    class SpecificWorker(GenericWorker):
        computed = 0

        def __init__(self, proxies: dict[str, Any]) -> None:
            super().__init__(proxies)
            self.timer.timeout.connect(self.compute)
            self.Period = 1
            self.timer.start(self.Period)

        @QtCore.Slot()
        def compute(self) -> None:
            self.computed += 1
            if self.computed == 3:
                self.timer.stop()

    worker = SpecificWorker({})
    assert worker.timer.parent() is worker
    component.run_until(lambda: worker.computed == 3)
    assert not worker.timer.isActive()
    assert component.loop.due(0) == NEVER


def test_a_timer_may_ring_once(component: Component, QtCore: Any) -> None:
    heard: list[int] = []
    timer = QtCore.QTimer()
    timer.setSingleShot(True)
    timer.setInterval(1000 / 333)
    timer.timeout.connect(lambda: heard.append(1))
    timer.start()
    assert (timer.interval(), timer.isSingleShot(), timer.isActive()) == (3, True, True)
    component.run_until(lambda: heard)
    assert not timer.isActive()
    assert timer.remainingTime() == -1


def test_single_shots_in_all_their_forms(component: Component, QtCore: Any) -> None:
    heard: list[str] = []

    class Worker(QtCore.QObject):
        due = QtCore.Signal()

        def note(self) -> None:
            heard.append("slot")

    worker = Worker()
    worker.due.connect(lambda: heard.append("signal"))
    QtCore.QTimer.singleShot(1000 / 1000, worker.due)
    QtCore.QTimer.singleShot(1, QtCore.Qt.PreciseTimer, worker.note)
    QtCore.QTimer().singleShot(1, worker, QtCore.SLOT("note()"))
    component.run_until(lambda: sorted(heard) == ["signal", "slot", "slot"])


def test_no_timer_rings_before_now(QtCore: Any) -> None:
    with pytest.raises(ValueError, match="0 ms at least, not -1"):
        QtCore.QTimer().start(-1)


def test_the_form_in_which_components_check_their_start(component: Component, QtCore: Any) -> None:
    QtCore.QTimer.singleShot(1, component.QtWidgets.QApplication.instance().quit)
    component.run_until(lambda: component.quits)
    component.loop.modules["PySide.QtGui"].QApplication.exit()
    QtCore.QCoreApplication.quit()
    assert component.quits == 3
    assert component.QtWidgets.QApplication([]) is component.QtWidgets.qApp is QtCore.QCoreApplication.instance()


def test_what_is_deleted_rings_no_more(component: Component, QtCore: Any) -> None:
    heard: list[str] = []
    parent = QtCore.QObject(objectName="parent")
    timer = QtCore.QTimer(parent)
    timer.timeout.connect(lambda: heard.append("tick"))
    timer.start(0)
    parent.destroyed.connect(lambda: heard.append("destroyed"))
    assert parent.children() == [timer]
    parent.deleteLater()
    component.run_until(lambda: "destroyed" in heard)
    assert not timer.isActive()
    assert parent.objectName() == "parent"


def test_processing_events_does_what_is_due_but_not_what_runs(component: Component, QtCore: Any) -> None:
    heard: list[str] = []

    class Worker(QtCore.QObject):
        news = QtCore.Signal()

        def compute(self) -> None:
            heard.append("begin")
            self.news.emit()
            QtCore.QCoreApplication.processEvents()
            heard.append("end")
            timer.stop()

    worker = Worker()
    worker.news.connect(lambda: heard.append("news"), QtCore.Qt.QueuedConnection)
    timer = QtCore.QTimer()
    timer.timeout.connect(worker.compute)
    timer.start(0)
    component.run_all()
    assert heard == ["begin", "news", "end"]


def test_about_to_quit_is_emitted_once_at_the_end(component: Component, QtCore: Any) -> None:
    heard: list[int] = []
    QtCore.QCoreApplication.instance().aboutToQuit.connect(lambda: heard.append(1))
    component.loop.close()
    component.loop.close()
    assert heard == [1]


def test_two_components_have_nothing_in_common() -> None:
    one, other = Component(), Component()
    one.QtCore.QTimer.singleShot(0, lambda: None)
    assert one.loop.due(0) < NEVER
    assert other.loop.due(0) == NEVER
    other.QtCore.QCoreApplication.setApplicationName("other")
    assert one.QtCore.QCoreApplication.applicationName() == ""
    assert not issubclass(one.QtCore.QTimer, other.QtCore.QObject)


def test_what_was_posted_is_called_when_it_is_its_turn(component: Component) -> None:
    heard: list[int] = []
    in_a_thread(lambda: component.loop.post(lambda: heard.append(1)))
    assert heard == []
    component.run_all()
    assert heard == [1]


# -- mutexes ---------------------------------------------------------------------------


def test_a_thread_waits_for_a_mutex_outside(component: Component, QtCore: Any) -> None:
    mutex = QtCore.QMutex()
    mutex.lock()
    got = threading.Event()

    def want() -> None:
        with QtCore.QMutexLocker(mutex):
            got.set()

    thread = threading.Thread(target=want)
    thread.start()
    try:
        component.run_until(lambda: component.outside == 1)
        assert not got.is_set()
    finally:
        mutex.unlock()
        thread.join()
    assert got.is_set()
    assert component.outside == 0


def test_a_locker_unlocks_when_its_function_returns(QtCore: Any) -> None:
    mutex = QtCore.QMutex()

    def guarded() -> bool:
        locker = QtCore.QMutexLocker(mutex)
        assert locker.mutex() is mutex
        return bool(mutex.tryLock())

    assert not guarded()
    assert mutex.tryLock()
    assert not mutex.tryLock(1)


def test_a_locker_may_unlock_for_a_while(QtCore: Any) -> None:
    mutex = QtCore.QMutex()
    with QtCore.QMutexLocker(mutex) as locker:
        locker.unlock()
        assert mutex.tryLock()
        mutex.unlock()
        locker.relock()
        assert not mutex.tryLock()
    assert mutex.tryLock()


@pytest.mark.parametrize(("kind", "given"), [("QMutex", (1,)), ("QRecursiveMutex", ())])
def test_a_recursive_mutex_is_locked_as_often_as_it_is_unlocked(QtCore: Any, kind: str, given: tuple[int, ...]) -> None:
    mutex = getattr(QtCore, kind)(*given)
    assert mutex.isRecursive()
    mutex.lock()
    mutex.lock()
    mutex.unlock()
    free: list[bool] = []
    in_a_thread(lambda: free.append(mutex.tryLock()))
    mutex.unlock()
    in_a_thread(lambda: free.append(mutex.tryLock()))
    assert free == [False, True]


def test_waiting_for_itself_is_an_error(QtCore: Any) -> None:
    mutex = QtCore.QMutex()
    mutex.lock()
    with pytest.raises(RuntimeError, match="has locked this QMutex already"):
        mutex.lock()
    mutex.unlock()
    with pytest.raises(RuntimeError, match="not locked"):
        mutex.unlock()
