"""A stand-in for the parts of QtCore that components without windows use: objects, signals, slots, timers, mutexes.

It behaves like PySide2 and PySide6:

    a slot gets as many of a signal's arguments as it accepts
    a signal emitted on the component's own thread calls its slots at once; on another thread, it queues the calls
    an exception of a slot is logged, and does not reach other slots or the emitter; SystemExit passes

Components that use more get real Qt (`needs.py` decides). `core` makes the classes anew for each component, because
each has its own agenda of queued calls and timers.
"""

from __future__ import annotations

import inspect
import math
import random
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any, ClassVar

from ....runtime.clock import SECOND
from .agenda import Agenda, Alarm
from .mutex import MutexSet, mutexes

Slot_ = Callable[..., Any]

MILLISECOND = SECOND // 1000
"""One millisecond, in the unit of clocks."""


class EventContext:
    """The agenda and the thread of one component's objects.

    `tell` logs an exception of a slot, `quit` ends the component, and `outside` leaves the worker's monitor.
    """

    def __init__(
        self,
        agenda: Agenda,
        tell: Callable[[BaseException], None],
        quit_: Callable[[], None],
        outside: Callable[[], AbstractContextManager[None]],
    ) -> None:
        self.agenda, self.tell, self.quit, self.outside = agenda, tell, quit_, outside
        self.thread: int | None = None
        """The thread of its objects; None before anything has run there."""
        self.sender: Object | None = None

    @property
    def here(self) -> bool:
        """Whether the calling thread is the thread of its objects."""
        return self.thread in (None, threading.get_ident())

    def attempt(self, sender: Object | None, call: Callable[[], object]) -> None:
        """Call a slot, and log what it raises."""
        with self._sent_by(sender):
            try:
                call()
            except Exception as exc:
                self.tell(exc)

    @contextmanager
    def _sent_by(self, sender: Object | None) -> Iterator[None]:
        before, self.sender = self.sender, sender
        try:
            yield
        finally:
            self.sender = before


class ConnectionType(IntEnum):
    AutoConnection = 0
    DirectConnection = 1
    QueuedConnection = 2
    UniqueConnection = 0x80


class TimerType(IntEnum):
    PreciseTimer = 0
    CoarseTimer = 1
    VeryCoarseTimer = 2


class Qt:
    """The names in Qt's namespace that components without windows use."""

    ConnectionType, TimerType = ConnectionType, TimerType
    AutoConnection = ConnectionType.AutoConnection
    DirectConnection = ConnectionType.DirectConnection
    QueuedConnection = ConnectionType.QueuedConnection
    UniqueConnection = ConnectionType.UniqueConnection
    PreciseTimer = TimerType.PreciseTimer
    CoarseTimer = TimerType.CoarseTimer
    VeryCoarseTimer = TimerType.VeryCoarseTimer


# -- signals and slots -----------------------------------------------------------------


class Signal:
    """`Signal()`, `Signal(int, str)`, `Signal((int,), (str,))` in the body of a class; each object has its own."""

    def __init__(self, *types: Any, name: str | None = None, arguments: Any = None) -> None:
        self._overloads = [tuple(each) for each in types if isinstance(each, tuple | list)] or [types]
        self._name = name or "signal"

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Object | None, owner: type | None = None) -> Any:
        if instance is None:
            return self
        if not isinstance(instance, Object):
            raise AttributeError(f"{type(instance).__name__}.{self._name}: only a QObject has signals")
        bound: dict[Signal, BoundSignal] = instance.__dict__.setdefault("_qt_signals", {})
        return bound.setdefault(self, BoundSignal(instance, self._name, self._overloads))


@dataclass(frozen=True)
class _Connection:
    slot: Any
    call: Slot_
    takes: float
    kind: int


class BoundSignal:
    """A signal of one object."""

    def __init__(self, owner: Object, name: str, overloads: list[tuple[Any, ...]]) -> None:
        self._owner, self._name, self._types = owner, name, overloads[0]
        self._connections: list[_Connection] = []
        self._overloads = {overloads[0]: self}
        for types in overloads[1:]:
            self._overloads[types] = BoundSignal(owner, name, [types])

    def __getitem__(self, types: Any) -> BoundSignal:
        wanted = types if isinstance(types, tuple) else (types,)
        if wanted not in self._overloads:
            raise IndexError(f"the signal {self._name} has no overload for {wanted}")
        return self._overloads[wanted]

    def connect(self, slot: Any, type: Any = Qt.AutoConnection) -> bool:
        call = slot if callable(slot) else getattr(slot, "emit", None)
        if call is None:
            raise TypeError(f"{self._name}.connect: {slot!r} can be neither called nor emitted")
        kind = int(type)
        if kind & Qt.UniqueConnection and any(each.slot == slot for each in self._connections):
            return False
        made = _Connection(slot, call, _takes(call), kind & ~Qt.UniqueConnection)
        self._connections = [*self._connections, made]
        return True

    def disconnect(self, slot: Any = None) -> bool:
        kept = [each for each in self._connections if slot is not None and each.slot != slot]
        if len(kept) == len(self._connections):
            which = "anything" if slot is None else repr(slot)
            raise RuntimeError(f"the signal {self._name} is not connected to {which}")
        self._connections = kept
        return True

    def emit(self, *arguments: Any) -> bool:
        if len(arguments) != len(self._types):
            wanted = ", ".join(getattr(each, "__name__", str(each)) for each in self._types)
            raise TypeError(f"{self._name}({wanted}) needs {len(self._types)} argument(s), {len(arguments)} given")
        if self._owner._qt_blocked:
            return False
        context = self._owner._qt_context
        for each in self._connections:
            given = arguments[: int(min(each.takes, len(arguments)))]
            call = partial(context.attempt, self._owner, partial(each.call, *given))
            at_once = context.here if each.kind == Qt.AutoConnection else each.kind == Qt.DirectConnection
            if at_once:
                call()
            else:
                context.agenda.post(call)
        return True

    def __call__(self, *arguments: Any) -> None:
        self.emit(*arguments)

    def __repr__(self) -> str:
        return f"<signal {self._name} of {self._owner!r}>"


def _takes(call: Slot_) -> float:
    """Maximum number of arguments that a slot accepts."""
    if isinstance(call, BoundSignal):
        return len(call._types)
    owner = getattr(call, "__self__", None)
    if isinstance(owner, BoundSignal):  # its `emit`
        return len(owner._types)
    try:
        parameters = inspect.signature(call).parameters.values()
    except (TypeError, ValueError):  # some C functions have no signature
        return math.inf
    if any(each.kind is each.VAR_POSITIONAL for each in parameters):
        return math.inf
    return sum(each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD) for each in parameters)


def Slot(*types: Any, name: str | None = None, result: Any = None) -> Any:
    """`@Slot()`, `@Slot(int, result=bool)`, `@Slot`: marks a method as a slot, without effect."""
    if len(types) == 1 and inspect.isfunction(types[0]):
        return types[0]
    return lambda function: function


def SIGNAL(text: str) -> str:
    return f"2{text}"


def SLOT(text: str) -> str:
    return f"1{text}"


# -- objects ---------------------------------------------------------------------------


class Object:
    """`QObject`. Its own names begin with `_qt_`; other names are the user's."""

    destroyed = Signal()

    _qt_context: ClassVar[EventContext]
    _qt_blocked = False
    _qt_name = ""
    _qt_parent: Object | None = None

    def __init__(self, parent: Object | None = None, *, objectName: str = "") -> None:
        self._qt_name = objectName
        self.setParent(parent)

    def parent(self) -> Object | None:
        return self._qt_parent

    def children(self) -> list[Object]:
        return list(self.__dict__.get("_qt_children", ()))

    def setParent(self, parent: Object | None) -> None:
        if self._qt_parent is not None:
            self._qt_parent.__dict__["_qt_children"].remove(self)
        self._qt_parent = parent
        if parent is not None:
            parent.__dict__.setdefault("_qt_children", []).append(self)

    def objectName(self) -> str:
        return self._qt_name

    def setObjectName(self, name: str) -> None:
        self._qt_name = name

    def blockSignals(self, block: bool) -> bool:
        before, self._qt_blocked = self._qt_blocked, block
        return before

    def signalsBlocked(self) -> bool:
        return self._qt_blocked

    def sender(self) -> Object | None:
        """The object whose signal has called the running slot."""
        return self._qt_context.sender

    def property(self, name: str) -> Any:
        return self.__dict__.get("_qt_properties", {}).get(name)

    def setProperty(self, name: str, value: Any) -> bool:
        self.__dict__.setdefault("_qt_properties", {})[name] = value
        return False  # as Qt does for properties that no class declares

    def deleteLater(self) -> None:
        self._qt_context.agenda.post(self._qt_delete)

    def _qt_delete(self) -> None:
        for child in self.children():
            child._qt_delete()
        self.setParent(None)
        self.destroyed.emit()

    @staticmethod
    def connect(sender: Object, signal: str, *to: Any) -> bool:
        """The old form: `connect(button, SIGNAL("clicked()"), self.pressed)`, or `…, self, SLOT("pressed()"))`."""
        slot = getattr(to[0], _named(to[1])) if len(to) > 1 and isinstance(to[1], str) else to[0]
        return bool(_signal(sender, signal).connect(slot))

    @staticmethod
    def disconnect(sender: Object, signal: str, *to: Any) -> bool:
        slot = getattr(to[0], _named(to[1])) if len(to) > 1 and isinstance(to[1], str) else to[0]
        return bool(_signal(sender, signal).disconnect(slot))


def _signal(sender: Object, signal: str) -> BoundSignal:
    found = getattr(sender, _named(signal), None)
    if not isinstance(found, BoundSignal):
        raise RuntimeError(f"{type(sender).__name__} has no signal {signal[1:]}; declare it in its class: Signal()")
    return found


def _named(text: str) -> str:
    """The name in the text of SIGNAL or SLOT."""
    return text[1:].partition("(")[0]


class Timer(Object):
    """`QTimer`. Intervals are milliseconds."""

    timeout = Signal()

    def __init__(self, parent: Object | None = None) -> None:
        super().__init__(parent)
        self._qt_alarm = Alarm(self.timeout.emit)
        self._qt_interval = 0
        self._qt_type = TimerType.CoarseTimer

    def start(self, msec: float | None = None) -> None:
        if msec is not None:
            self._qt_interval = _milliseconds(msec)
        self._qt_context.agenda.start(self._qt_alarm, self._qt_interval * MILLISECOND)

    def stop(self) -> None:
        self._qt_context.agenda.stop(self._qt_alarm)

    def isActive(self) -> bool:
        return self._qt_alarm.at is not None

    def interval(self) -> int:
        return self._qt_interval

    def setInterval(self, msec: float) -> None:
        self._qt_interval = _milliseconds(msec)
        if self.isActive():
            self.start()

    def remainingTime(self) -> int:
        at = self._qt_alarm.at
        return -1 if at is None else max(0, -((self._qt_context.agenda.now() - at) // MILLISECOND))

    def isSingleShot(self) -> bool:
        return self._qt_alarm.single

    def setSingleShot(self, single: bool) -> None:
        self._qt_alarm.single = bool(single)

    def timerType(self) -> TimerType:
        return self._qt_type

    def setTimerType(self, kind: TimerType) -> None:
        """Has no effect: all timers are as precise as possible."""
        self._qt_type = kind

    @classmethod
    def singleShot(cls, msec: float, *to: Any) -> None:
        """`singleShot(200, slot)`, also `(200, Qt.PreciseTimer, slot)`, and `(200, self, SLOT("compute()"))`."""
        context = cls._qt_context
        receiver, last = to[-2] if len(to) > 1 else None, to[-1]
        slot = getattr(receiver, _named(last)) if isinstance(last, str) else last
        call = slot if callable(slot) else slot.emit
        context.agenda.start(
            Alarm(partial(context.attempt, None, call), single=True), _milliseconds(msec) * MILLISECOND
        )

    def _qt_delete(self) -> None:
        self.stop()
        super()._qt_delete()


def _milliseconds(given: float) -> int:
    if given < 0:
        raise ValueError(f"a timer has an interval of 0 ms at least, not {given}")
    return int(given)


class Application(Object):
    """`QCoreApplication`, also as `QApplication` for components without windows. There is only one."""

    aboutToQuit = Signal()

    _qt_only: ClassVar[list[Application]]
    _qt_names: ClassVar[dict[str, str]]

    def __new__(cls, *_: Any) -> Application:
        return cls.instance()

    def __init__(self, *_: Any) -> None:
        """Does nothing, because the application already exists."""

    @classmethod
    def instance(cls) -> Application:
        if not cls._qt_only:
            cls._qt_only.append(object.__new__(cls))
        return cls._qt_only[0]

    @classmethod
    def quit(cls) -> None:
        """End the component, as Ctrl-C does."""
        cls._qt_context.quit()

    @classmethod
    def exit(cls, code: int = 0) -> None:
        cls._qt_context.quit()

    @classmethod
    def exec(cls) -> int:
        """Has no effect: the component's loop is already running."""
        return -1

    exec_ = exec

    @classmethod
    def processEvents(cls, *_: Any) -> None:
        """Run queued calls and timers that are due, and let waiting handlers run."""
        context = cls._qt_context
        if not context.here:
            return  # the calls belong to the component's thread
        now = context.agenda.now()
        while context.agenda.do(now):
            pass
        with context.outside():
            pass

    @staticmethod
    def arguments() -> list[str]:
        return list(sys.argv)

    @classmethod
    def applicationName(cls) -> str:
        return cls._qt_names.get("application", "")

    @classmethod
    def setApplicationName(cls, name: str) -> None:
        cls._qt_names["application"] = name

    @classmethod
    def organizationName(cls) -> str:
        return cls._qt_names.get("organization", "")

    @classmethod
    def setOrganizationName(cls, name: str) -> None:
        cls._qt_names["organization"] = name


# -- the classes of one component ------------------------------------------------------


def core(context: EventContext, mutex_set: MutexSet) -> dict[str, Any]:
    """The names in QtCore, and `QApplication`, with their values for one component."""
    objects = type("QObject", (Object,), {"_qt_context": context})
    application = type("QCoreApplication", (Application, objects), {"_qt_only": [], "_qt_names": {}})
    return {
        "QObject": objects,
        "QTimer": type("QTimer", (Timer, objects), {}),
        "QCoreApplication": application,
        "QApplication": application,
        "QGuiApplication": application,
        "qApp": application(),
        "Signal": Signal,
        "SignalInstance": BoundSignal,
        "Slot": Slot,
        "SIGNAL": SIGNAL,
        "SLOT": SLOT,
        "Qt": Qt,
        **renamed(Signal, Slot),
        **mutexes(mutex_set),
        **rand(),
    }


def renamed(signal: Any, slot: Any) -> dict[str, Any]:
    """PyQt's other names."""
    return {"pyqtSignal": signal, "pyqtSlot": slot, "pyqtBoundSignal": BoundSignal}


def rand() -> dict[str, Any]:
    """The random numbers of Qt 4; later versions have none."""
    source = random.Random()
    return {"qrand": lambda: source.randrange(2**31), "qsrand": source.seed}
