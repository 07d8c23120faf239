"""The main thread of a process whose components use real Qt: it runs Qt's loop, and calls for other threads.

Only the main thread may use windows, so all user code runs there. Qt calls the slots of timers and clicks. Threads
with a handler hold the monitor, ask the main thread to call the handler (an errand), and wait.

    main thread   runs Qt's loop, and errands between two events
    life          a thread for Running.run: hooks, as without Qt
    asks          a pool of threads for blocking functions; meanwhile the main thread runs errands, so that two
                  components can call each other

While the code of an errand waits, its thread releases the monitor. While its code holds a lock, no errand runs inside
of its wait: that might want the lock, and would keep the holder from releasing it. No thread waits for a posted errand.
Only one posted errand runs at a time, because Ice has one thread for callbacks. Otherwise each one that waits would
start the next one inside of its wait.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Any, ClassVar, Generic, TypeVar

from ....errors import Closed, ComponentError
from ....runtime.ending import STUCK
from ....runtime.monitor import MAX_SUSPENDED
from ....runtime.trace import frames_in
from ....threads import NO_THREAD, Pool, fulfil, start_thread
from ..unsafe import before_threads, exits_noted
from .served import GUI

log = logging.getLogger("robocomp.worker")

T = TypeVar("T")

Outside = Callable[[], AbstractContextManager[None]]

_LOOK_S = 1.0
"""Seconds between two checks while waiting, because a signal that comes just before a wait does not end it."""

_BROKEN = "6.12.0"
"""The version of PySide6 that loses a reference to a bool with each signal that Python emits."""

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def qt(name: str) -> Any:
    """A module of PySide6. Raises ComponentError if it is not installed."""
    try:
        return importlib.import_module(f"PySide6.{name}")
    except ModuleNotFoundError:
        raise ComponentError(f"PySide6.{name} is not installed: pip install '{GUI}'") from None
    except ImportError as exc:
        raise ComponentError(
            f"PySide6 cannot be loaded ({exc}); on Debian: apt-get install libegl1 libgl1 libglib2.0-0 libxkbcommon0 "
            "libdbus-1-3 libfontconfig1"
        ) from exc


class _Message(Enum):
    """A message of the main thread to the thread that waits for an errand."""

    WAITS = "its code waits for others"
    GOES_ON = "it goes on"
    DONE = "it is done"


class _Errand:
    """A call that another thread has the main thread make."""

    is_posted = False

    def __init__(self, call: Callable[[], Any], always: bool = False, apart: bool = False) -> None:
        self.call, self.always, self.apart = call, always, apart
        self.messages: SimpleQueue[_Message] = SimpleQueue()
        self.is_back = False
        self.result: Any = None
        self.error: BaseException | None = None

    def do(self) -> None:
        try:
            self.result = self.call()
        except KeyboardInterrupt:
            _end_now()
        except BaseException as exc:  # raised in the waiting thread
            self.error = exc
        finally:
            self.messages.put(_Message.DONE)


class _Posted(_Errand):
    """An errand that no thread waits for."""

    is_posted = True

    def do(self) -> None:
        try:
            self.call()
        except Exception as exc:  # it may run inside of a wait, which must not raise this
            sys.excepthook(type(exc), exc, exc.__traceback__)


class _BlockingCall(Generic[T]):
    """A blocking function that a thread of a pool calls."""

    def __init__(self, function: Callable[[], T], answered: Callable[[], object]) -> None:
        self._function = function
        self.answer: Future[T] = Future()
        self.answer.add_done_callback(lambda _: answered())
        self.asked = False

    def ask(self, pool: Pool) -> bool:
        """Have a thread call it; False if none is free. The function is called only once."""
        self.asked = self.asked or pool.offer(partial(fulfil, self.answer, self._function))
        return self.asked


@dataclass(frozen=True, eq=False)
class Joined:
    """A component of this process that uses real Qt."""

    folder: Path
    tell: Callable[[BaseException], None]
    is_locked: Callable[[], bool]


class Front:
    """The single instance of this process. The main thread makes it before any object of Qt."""

    _only: ClassVar[Front | None] = None

    @classmethod
    def there(cls, screen: bool, name: str) -> Front:
        """The instance. Raises ComponentError if it cannot be made."""
        if cls._only is None:
            cls._only = cls(screen, name)
        elif screen and not cls._only.screen:
            raise ComponentError("another component of this process began Qt without windows: run this one by itself")
        return cls._only

    def __init__(self, screen: bool, name: str, start: Callable[[threading.Thread], bool] = start_thread) -> None:
        """`start` starts a thread, and returns False if the system has none to spare."""
        if threading.current_thread() is not threading.main_thread():
            raise ComponentError("Qt belongs to the main thread of a process: run this component by `rc run`")
        if qt("QtCore").__version__ == _BROKEN and sys.version_info < (3, 12):
            log.warning(
                "PySide6 %s ends Python 3.11 after some 3000 signals that a component emits; run: pip install '%s'",
                _BROKEN,
                f"pyside6-essentials!={_BROKEN}",
            )
        self.screen = screen
        self.application = _application(screen, name)
        self._thread = threading.get_ident()
        self._news = threading.Condition()
        self._inbox: deque[_Errand] = deque()
        self._at: list[_Errand] = []
        """The errands that the main thread is running; the last one is the innermost."""
        self._waits = 0
        """Depth of its nested waits."""
        self._is_over = False
        self._is_leaving = False
        self._joined: list[Joined] = []
        self._start = start
        self._asks = Pool("asks", MAX_SUSPENDED + 8, freed=self._tell_news, start=start)
        self._is_short = False
        """Whether a thread was needed but none was free."""
        self._wakeup = _Wakeup(self._woken)
        self._exit_code = 0

    @property
    def here(self) -> bool:
        return threading.get_ident() == self._thread

    def join(self, joined: Joined) -> Callable[[], None]:
        """Add a component. Call the returned function when it ends."""
        self._joined.append(joined)

        def leave() -> None:
            self._joined.remove(joined)
            if not self._joined:
                self.leave()

        return leave

    # On the main thread.

    def live(self, life: Callable[[], bool], stop: Callable[[], None]) -> bool:
        """Run Qt's loop until `life`, on its own thread, has ended. Calls `stop` if Qt is to quit.

        Raises ComponentError if the system has no thread to spare.
        """
        result: list[bool] = []

        def run() -> None:
            try:
                result.append(life())
            finally:
                self._end()

        thread = threading.Thread(target=run, name="life")
        with ExitStack() as stack:
            stack.enter_context(self._signals())
            stack.enter_context(self._exceptions())
            stack.enter_context(self._exits(thread, stop))
            if not self._start(thread):
                raise ComponentError(f"a component with a window cannot run: {NO_THREAD}")
            qt("QtCore").QTimer.singleShot(0, self._check)
            self.application.exec()
            stop()
            self._serve(lambda: self._is_over)
            thread.join()
        self._asks.close()
        return bool(result) and result[0]

    def wait_for(self, function: Callable[[], T]) -> T:
        """Have a thread call a blocking function, and run errands meanwhile.

        If the system has no thread to spare, errands are done until it has one. Raises Closed if the component ends
        before that.
        """
        if not self.here or self._is_over:
            return function()
        errand = self._at[-1] if self._at and not self._at[-1].is_posted else None
        if errand:
            errand.messages.put(_Message.WAITS)
        question = _BlockingCall(function, self._tell_news)
        self._waits += 1
        try:
            self._ask(question)
            self._serve(question.answer.done)
            if errand:
                errand.messages.put(_Message.GOES_ON)
                self._serve(lambda: errand.is_back or self._is_over)
                errand.is_back = False
        finally:
            self._waits -= 1
        return question.answer.result()

    def _ask(self, question: _BlockingCall[Any]) -> None:
        """Wait until a thread is free to call it."""
        if not question.ask(self._asks):
            if not self._is_short:
                log.warning("waits begin later, when a thread is free: %s", NO_THREAD)
            self._is_short = True
            self._serve(lambda: question.ask(self._asks) or self._is_over)
            if not question.asked:
                raise Closed("the component ends")
        self._is_short = False

    def leave(self) -> None:
        """Stop Qt's events, and close dialogs that code waits for."""
        self._is_leaving = True
        self.application.exit(0)

    def _check(self) -> None:
        """Leave a loop that was told to end before it began."""
        if self._is_leaving:
            self.leave()

    def _serve(self, until: Callable[[], bool]) -> None:
        """Run errands, and wait for more, until a condition holds."""
        while True:
            with self._news:
                while not until() and not self._next():
                    self._news.wait(_LOOK_S)
                if until():
                    return
                errand = self._next()
                assert errand is not None
                self._inbox.remove(errand)
            self._do(errand)

    def _next(self) -> _Errand | None:
        locked = any(each.is_locked() for each in self._joined)
        posted = any(each.is_posted for each in self._at)

        def may(errand: _Errand) -> bool:
            has_to_wait = locked or (posted and errand.is_posted) or (self._waits > 0 and errand.apart)
            return errand.always or not has_to_wait

        return next(filter(may, self._inbox), None)

    def _woken(self) -> None:
        """Run one errand; Qt handles its events between two of them."""
        if self._is_over:
            self.leave()
            return
        with self._news:
            if not self._inbox:
                return  # done inside of a wait
            errand = self._inbox.popleft()
            if self._inbox:
                self._wakeup.wake()
        self._do(errand)

    def _do(self, errand: _Errand) -> None:
        self._at.append(errand)
        try:
            errand.do()
        finally:
            self._at.remove(errand)

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        """Wake Qt's loop, because Python handles signals only while Python code runs."""
        reading, writing = socket.socketpair()
        reading.setblocking(False)
        writing.setblocking(False)
        before = signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
        core = qt("QtCore")
        notifier = core.QSocketNotifier(reading.fileno(), core.QSocketNotifier.Type.Read)

        def received() -> None:
            with contextlib.suppress(BlockingIOError):
                if set(reading.recv(64)) & {int(each) for each in _ENDING}:
                    self.leave()

        notifier.activated.connect(received)
        try:
            yield
        finally:
            notifier.setEnabled(False)
            signal.set_wakeup_fd(before)
            reading.close()
            writing.close()

    @contextlib.contextmanager
    def _exceptions(self) -> Iterator[None]:
        """PySide passes exceptions of slots to `sys.excepthook`."""
        before = sys.excepthook

        def raised(kind: type[BaseException], exc: BaseException, trace: TracebackType | None) -> None:
            if isinstance(exc, KeyboardInterrupt):
                _end_now()
            concerned = [each for each in self._joined if frames_in(each.folder, exc)] or self._joined
            if concerned:
                concerned[0].tell(exc)
            else:
                before(kind, exc, trace)

        sys.excepthook = raised
        try:
            yield
        finally:
            sys.excepthook = before

    @contextlib.contextmanager
    def _exits(self, life: threading.Thread, stop: Callable[[], None]) -> Iterator[None]:
        """PySide ends Python when a slot raises SystemExit; then only threads that Python waits for go on."""

        def note(status: Any) -> None:
            if self.here:
                self._exit_code = status if isinstance(status, int) else int(status is not None)

        def gone() -> None:
            if self._is_over or not life.is_alive():
                return
            log.info("sys.exit was called")
            stop()
            self._end()
            life.join(STUCK)
            logging.shutdown()
            sys.stdout.flush()
            os._exit(self._exit_code)

        before_threads(gone)
        with exits_noted(note):
            yield

    # On any other thread.

    def call(self, call: Callable[[], T], outside: Outside, *, always: bool = False) -> T:
        """Have the main thread call something, and wait. `always`: runs no user code, so it may run inside any wait."""
        if self.here:
            return call()
        errand = _Errand(call, always)
        if not self._put(errand):
            raise Closed("the component ends")
        with ExitStack() as aside:
            while (word := errand.messages.get()) is not _Message.DONE:
                if word is _Message.WAITS:
                    aside.enter_context(outside())
                else:
                    aside.close()
                    errand.is_back = True
                    self._tell_news()
        if errand.error:
            raise errand.error
        result: T = errand.result
        return result

    def post(self, call: Callable[[], object]) -> None:
        """Queue a call for the main thread, without waiting."""
        self._put(_Posted(call))

    def rest(self, patience_s: float) -> None:
        """Wait until the errands that the main thread is running have ended."""
        is_over = threading.Event()
        if not self.here and self._put(_Errand(is_over.set, apart=True)):
            is_over.wait(patience_s)

    def freed(self) -> None:
        """A component has released its last lock."""
        if self._waits and self._inbox:
            self._tell_news()

    def _put(self, errand: _Errand) -> bool:
        """Queue an errand; False if it will not run."""
        with self._news:
            if self._is_over:
                return False
            self._inbox.append(errand)
            self._news.notify_all()
        self._wakeup.wake()
        return True

    def _tell_news(self) -> None:
        with self._news:
            self._news.notify_all()

    def _end(self) -> None:
        """The life thread has ended: end all waits."""
        with self._news:
            self._is_over = True
            waiting = [*self._inbox, *self._at]
            self._inbox.clear()
            self._news.notify_all()
        for errand in waiting:
            errand.error = Closed("the component ends")
            errand.messages.put(_Message.DONE)
        self._is_leaving = True
        self._wakeup.wake()


def _application(screen: bool, name: str) -> Any:
    core = qt("QtCore")
    if not screen:
        return core.QCoreApplication([name])
    if not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"))):
        raise ComponentError(
            f"{name} has a window, and there is no screen to show it on (neither DISPLAY nor WAYLAND_DISPLAY is set); "
            "to run it without being seen: QT_QPA_PLATFORM=offscreen"
        )
    return qt("QtWidgets").QApplication([name])


class _Wakeup:
    """Wakes the main thread while it is in Qt's loop.

    Qt watches a pipe: signals that Python emits are slower, and PySide6 6.12.0 loses a reference with each of them.
    """

    def __init__(self, woken: Callable[[], None]) -> None:
        """Must be called on the main thread. The object lives as long as the process."""
        self._woken = woken
        self._reading, self._writing = os.pipe()
        os.set_blocking(self._reading, False)
        os.set_blocking(self._writing, False)
        core = qt("QtCore")
        self._notifier = core.QSocketNotifier(self._reading, core.QSocketNotifier.Type.Read)
        self._notifier.activated.connect(self._read)

    def wake(self) -> None:
        """Safe to use from any thread. Several wake-ups may be merged."""
        with contextlib.suppress(BlockingIOError):  # as many wait to be read as the pipe holds
            os.write(self._writing, b"\0")

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.read(self._reading, 4096)
        self._woken()


def _end_now() -> None:
    """The second Ctrl-C."""
    logging.shutdown()
    sys.stdout.flush()
    os._exit(128 + signal.SIGINT)
