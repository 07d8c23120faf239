"""Threads that take turns at receiving (leader and followers), and what they pass messages through.

The leader waits for input and runs what came in itself, so that nothing is handed from thread to
thread while handlers are quick. When one waits for an answer (`step_aside`), or still runs at the
next look of the lookout, another thread becomes the leader and goes on receiving; the former one
finishes what it runs and then stands by.

    leader    receive → run one job → still the leader? → again
    lookout   while there is traffic, look every 10 ms: does the same job still run? → another leads

Jobs are begun in the order in which they came in, by whoever leads.
"""

from __future__ import annotations

import logging
import threading
import weakref
from collections import deque
from collections.abc import Callable, Iterable

from ..wire.codec import Payload
from .base import Sink, Statistics, receives

log = logging.getLogger("robocomp.transport")

Job = Callable[[], object]

PATIENCE = 0.010
"""Seconds after which another thread takes over from a leader busy with one job."""

STUCK = 5.0
"""Seconds for which closing waits for a handler that is running."""

_QUIET_LOOKS = 50
"""After so many looks without traffic the lookout sleeps until there is some."""


_THREADS: weakref.WeakSet[threading.Thread] = weakref.WeakSet()
"""All threads of all crews."""


def abandoned() -> bool:
    """Whether the program has ended, but for threads of crews: somebody forgot to close a transport.

    Interpreters wait for their threads before anything else, so only such a thread can notice.
    """
    if threading.main_thread().is_alive():
        return False
    return all(thread.daemon or thread in _THREADS for thread in threading.enumerate() if thread.is_alive())


class Crew:
    """Calls `receive` again and again, on one thread at a time, and runs the jobs it returns.

    `receive` blocks until there is something to do or `wake` was called; it must not raise.
    """

    def __init__(self, name: str, receive: Callable[[], Iterable[Job]], wake: Callable[[], None]) -> None:
        self._name, self._receive, self._wake = name, receive, wake
        self._jobs: deque[Job] = deque()
        self._threads: list[threading.Thread] = []
        self._closing = threading.Event()
        self._traffic = threading.Event()
        self._watched = False
        self._turn = threading.Condition()
        self._leader: threading.Thread | None = None
        self._followers = 0
        self._running: Job | None = None
        self._begun = 0

    def start(self) -> None:
        with self._turn:
            self._hire(self._serve, "0")
            self._hire(self._look_out, "lookout")

    def close(self) -> None:
        """Stop, and wait for all threads but the calling one. Jobs not begun are dropped."""
        self._closing.set()
        self._traffic.set()
        with self._turn:
            self._turn.notify_all()
        self._wake()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()
        self._jobs.clear()

    def _hire(self, work: Callable[[], None], suffix: str) -> None:
        thread = threading.Thread(target=work, name=f"{self._name}-{suffix}")
        self._threads.append(thread)
        _THREADS.add(thread)
        thread.start()

    def _serve(self) -> None:
        receives(self._hand_over)
        while self._await_turn():
            self._lead()

    def _await_turn(self) -> bool:
        with self._turn:
            self._followers += 1
            self._turn.wait_for(lambda: self._leader is None or self._closing.is_set())
            self._followers -= 1
            if not self._closing.is_set():
                self._leader = threading.current_thread()
            return not self._closing.is_set()

    def _lead(self) -> None:
        while not self._closing.is_set():
            if not self._jobs:
                self._jobs.extend(self._receive())
                continue
            if not self._run(self._jobs.popleft()):
                return

    def _run(self, job: Job) -> bool:
        """Run one job; whether this thread still leads."""
        self._begun += 1
        self._running = job
        if not self._watched:
            self._watched = True
            self._traffic.set()
        try:
            job()
        except Exception:
            log.exception("%s: a message was not handled", self._name)
        with self._turn:
            if self._leader is not threading.current_thread():
                return False
            self._running = None
            return True

    def _hand_over(self, overdue: Job | None = None) -> None:
        """Let another thread lead: the leader says so itself, or its job is overdue."""
        with self._turn:
            mine = self._leader is threading.current_thread()
            if self._closing.is_set() or not (mine or (overdue is not None and self._running is overdue)):
                return
            self._leader = self._running = None
            if self._followers:
                self._turn.notify()
            else:
                self._hire(self._serve, str(len(self._threads)))

    def _look_out(self) -> None:
        while True:
            self._traffic.wait()
            quiet = 0
            while quiet < _QUIET_LOOKS:
                begun, running = self._begun, self._running
                if self._closing.wait(PATIENCE):
                    return
                if running is not None and self._running is running:
                    self._hand_over(running)
                quiet = quiet + 1 if self._begun == begun else 0
            self._traffic.clear()
            self._watched = False  # in this order: a job begun in between is seen by its count
            if self._begun != begun or self._closing.is_set():
                self._traffic.set()


class Gate:
    """Lets calls through until it is closed, and knows when the last one has left."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._changed = threading.Condition()
        self._inside: list[int] = []
        self.closed = False

    def enter(self) -> bool:
        with self._changed:
            if not self.closed:
                self._inside.append(threading.get_ident())
            return not self.closed

    def leave(self) -> None:
        with self._changed:
            self._inside.remove(threading.get_ident())
            if self.closed:
                self._changed.notify_all()

    def close(self) -> None:
        """Let nobody in any more, and wait for those inside, except the calling thread.

        A handler that is stuck is left alone after a while; that is logged.
        """
        with self._changed:
            self.closed = True
            me = threading.get_ident()
            if not self._changed.wait_for(lambda: all(thread == me for thread in self._inside), STUCK):
                log.warning("%s: still in a handler after %g s; not waiting any longer", self._name, STUCK)


class Lane:
    """The messages of one inlet on their way to its sink: in order, one at a time, at most `depth` waiting.

    A lane that is full gives up its oldest message (`lossy`), or takes no more until there is room.
    """

    def __init__(self, name: str, sink: Sink, depth: int, *, lossy: bool, stats: Statistics) -> None:
        self._name, self._sink, self._depth, self._lossy, self._stats = name, sink, depth, lossy, stats
        self._waiting: deque[Payload] = deque()
        self._changed = threading.Condition()
        self._draining = False
        self._gate = Gate(name)

    @property
    def full(self) -> bool:
        """Whether `put` would refuse; a lossy lane never is."""
        return not self._lossy and len(self._waiting) >= self._depth

    def put(self, payload: Payload, patience: float = 0.0) -> bool:
        """Append a message, after waiting for room at most `patience` seconds; whether it was taken.

        Somebody has to call `drain` then. A closed lane takes everything and forgets it.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: not self.full or self._gate.closed, patience):
                return False
            if len(self._waiting) >= self._depth:
                self._waiting.popleft()
                self._stats.dropped += 1
            if not self._gate.closed:
                self._waiting.append(payload)
            return True

    def drain(self) -> None:
        """Give the sink what waits. Returns at once if another thread is doing so."""
        with self._changed:
            if self._draining:
                return
            self._draining = True
        while True:
            with self._changed:
                if not self._waiting:
                    self._draining = False
                    return
                payload = self._waiting.popleft()
                self._changed.notify_all()
            self._deliver(payload)

    def close(self) -> None:
        """Forget what waits. The sink is not called any more once this returns."""
        with self._changed:
            self._waiting.clear()
            self._changed.notify_all()
        self._gate.close()

    def _deliver(self, payload: Payload) -> None:
        if not self._gate.enter():
            return
        try:
            self._stats.received += 1
            self._sink(payload)
        except Exception:
            log.exception("%s: a message was not handled", self._name)
        finally:
            self._gate.leave()
