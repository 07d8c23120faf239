"""Threads that take turns to receive (leader and followers), and the queues that messages pass.

The leader waits for input and runs the handlers itself: while they are quick, no message changes
threads. If a handler makes a blocking call (`about_to_block`) or is still running at the next look
of the lookout thread, another thread becomes the leader and receives. The former leader finishes
its handler and becomes a follower.

    leader    receive → run one job → still the leader? → again
    lookout   while there is traffic, look every 10 to 100 ms: does the same job still run? → another leads

The leader begins jobs in the order of their arrival. If the system can start no thread, the leader stays the
leader: input waits until its job has ended, or until the lookout can start a thread.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future

from ..errors import TransportError
from ..threads import NO_THREAD, start_thread
from ..wire.codec import Payload
from .base import Reply, Service, Sink, Statistics, Status, pass_on, receives, reply_of
from .limits import COMMANDS_WAITING

log = logging.getLogger("robocomp.transport")

Job = Callable[[], object]

PATIENCE = 0.010
"""Seconds after which another thread takes over from a leader busy with one job."""

STUCK = 5.0
"""Seconds for which closing waits for a handler that is running."""

_LAZINESS = 10
"""While all jobs are short, the lookout looks this many times less often: a look costs a fifth of a message. A handler
that is known to be long does not wait for it."""

_QUIET = 0.5
"""Seconds without traffic after which the lookout sleeps until the next job."""

_LONGEST_PAUSE = 0.5
"""Maximum seconds between two attempts to receive, if they fail."""

# Code that runs for each message acquires the lock itself: through its condition it takes twice as long.

_THREADS: weakref.WeakSet[threading.Thread] = weakref.WeakSet()
"""Threads of all `LeaderFollowers`, and others that belong to transports. None is a daemon, also if a daemon of the
user starts it: the interpreter would end while it is in foreign code, which may abort the process, and nothing would
close the transport."""


def belongs(thread: threading.Thread) -> None:
    """Note a thread of a transport that belongs to no `LeaderFollowers`, for `abandoned`."""
    _THREADS.add(thread)


def abandoned(also: type[threading.Thread] | tuple[()] = ()) -> bool:
    """Whether only threads of transports, and those of the class `also`, still run: the program forgot to close them.

    At its end an interpreter first waits for its threads, so only one of them can notice.
    """
    if threading.main_thread().is_alive():
        return False
    left = [thread for thread in threading.enumerate() if thread.is_alive()]
    return all(thread.daemon or thread in _THREADS or isinstance(thread, also) for thread in left)


class LeaderFollowers:
    """Calls `receive` again and again, on one thread at a time, and runs the jobs it returns.

    `receive` blocks until there is something to do or `wake` was called. Long work and calls of user
    code belong into a job: no other thread receives before `receive` has returned, not even after
    `about_to_block`. If it raises, that is logged, and after a pause it is called again.
    """

    def __init__(
        self,
        name: str,
        receive: Callable[[], Iterable[Job]],
        wake: Callable[[], None],
        start: Callable[[threading.Thread], bool] = start_thread,
    ) -> None:
        """`start` starts a thread, and returns False if the system cannot."""
        self._name, self._receive, self._wake, self._start = name, receive, wake, start
        self._jobs: deque[Job] = deque()
        self._threads: list[threading.Thread] = []
        self._closing = threading.Event()
        self._ends = False
        """The same as `_closing`, but faster to read: no function is called."""
        self._traffic = threading.Event()
        self._watched = False
        self._lock = threading.RLock()
        self._turn = threading.Condition(self._lock)
        self._leader: threading.Thread | None = None
        self._followers = 0
        self._short = False
        """Whether a thread was needed and could not be started."""
        self._running: Job | None = None
        self._begun = 0
        self._pause = 0.0
        """Seconds to wait after `receive` has failed; 0 while it succeeds."""

    def start(self, otherwise: Callable[[], object] = lambda: None) -> None:
        """Raises TransportError if the system can start no thread; then none runs, and `otherwise` was called."""
        with self._lock:
            started = self._hire(self._serve, "0") and self._hire(self._look_out, "lookout")
        if not started:
            self.close()
            otherwise()
            raise TransportError(f"{self._name}: {NO_THREAD}")

    def close(self) -> None:
        """Stop, and wait for all threads but the calling one. Jobs not begun are dropped.

        A thread whose job is stuck is left alone after a while; that is logged.
        """
        self._ends = True
        self._closing.set()
        self._traffic.set()
        with self._lock:
            self._turn.notify_all()
            others = [thread for thread in self._threads if thread is not threading.current_thread()]
        self._wake()
        end = time.monotonic() + STUCK
        for thread in others:
            thread.join(max(0.0, end - time.monotonic()))
        stuck = [thread.name for thread in others if thread.is_alive()]
        if stuck:
            log.warning("%s: still busy after %g s; not waiting any longer", ", ".join(stuck), STUCK)
        self._jobs.clear()

    def _hire(self, work: Callable[[], None], suffix: str) -> bool:
        thread = threading.Thread(target=work, name=f"{self._name}-{suffix}", daemon=False)
        _THREADS.add(thread)
        started = self._start(thread)
        if started:
            self._threads.append(thread)
        return started

    def _serve(self) -> None:
        receives(self._hand_over)
        while self._await_turn():
            self._lead()

    def _await_turn(self) -> bool:
        with self._lock:
            self._followers += 1
            self._turn.wait_for(lambda: self._leader is None or self._closing.is_set())
            self._followers -= 1
            if not self._closing.is_set():
                self._leader = threading.current_thread()
            return not self._closing.is_set()

    def _lead(self) -> None:
        me, jobs = threading.current_thread(), self._jobs
        while not self._ends:
            if not jobs:
                jobs.extend(self._input())
            elif not self._run(jobs.popleft(), me):
                return

    def _input(self) -> Iterable[Job]:
        try:
            jobs = self._receive()
        except Exception:  # if this thread ended, no thread would receive any more
            if not self._pause and not self._closing.is_set():
                log.exception("%s: receiving failed; trying again until it succeeds", self._name)
            self._pause = min(2 * self._pause or PATIENCE, _LONGEST_PAUSE)
            self._closing.wait(self._pause)
            return ()
        self._pause = 0.0
        return jobs

    def _run(self, job: Job, me: threading.Thread) -> bool:
        """Run one job; whether this thread still leads."""
        self._begun += 1
        self._running = job
        if not self._watched:
            self._watched = True
            self._traffic.set()
        try:
            job()
        except BaseException:  # also SystemExit, which would only end this thread
            log.exception("%s: a message was not handled", self._name)
        self._lock.acquire()  # half of what `with` takes, and nothing here raises
        leads = self._leader is me
        if leads:
            self._running = None
        self._lock.release()
        return leads

    def _hand_over(self, overdue: Job | None = None) -> None:
        """Let another thread lead. Called by the leader in its job, or by the lookout for an overdue job."""
        with self._lock:
            mine = self._leader is threading.current_thread() and self._running is not None
            if self._closing.is_set() or not (mine or (overdue is not None and self._running is overdue)):
                return
            if self._followers:
                self._turn.notify()
            elif not self._hire(self._serve, str(len(self._threads))):
                if not self._short:
                    log.warning("%s: nothing is received until a handler has ended: %s", self._name, NO_THREAD)
                self._short = True
                return  # the lookout tries again
            self._short = False
            self._leader = self._running = None

    def _look_out(self) -> None:
        while True:
            self._traffic.wait()
            quiet, pause = 0.0, PATIENCE
            while quiet < _QUIET:
                # keeps no reference to the job, whose message takes memory
                begun, busy = self._begun, self._running is not None
                pause = PATIENCE if busy else min(pause * 1.2, _LAZINESS * PATIENCE)
                if self._closing.wait(pause):
                    return
                running = self._running
                if busy and self._begun == begun:  # in this order: then it is the same job
                    self._hand_over(running)
                running = None
                quiet = quiet + pause if self._begun == begun and not busy else 0.0
            self._traffic.clear()
            self._watched = False  # in this order: a job begun in between is seen by its count
            if self._begun != begun or self._closing.is_set():
                self._traffic.set()


class Gate:
    """Lets calls through until it is closed, and knows when the last one has left.

    Entering takes no lock. A thread enters the list before it checks whether the gate is closed; `close` closes the
    gate before it reads the list. Operations on a list are atomic.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._left = threading.Condition()
        self.inside: list[int] = []
        """The threads inside."""
        self.closed = False

    def enter(self) -> bool:
        self.inside.append(threading.get_ident())
        if self.closed:
            self.leave()
            return False
        return True

    def leave(self) -> None:
        self.inside.remove(threading.get_ident())
        if self.closed:
            self.left()

    def left(self) -> None:
        """Tell `close` that a thread has left."""
        with self._left:
            self._left.notify_all()

    def close(self) -> None:
        """Let no thread in any more, and wait for those inside, except the calling thread.

        A handler that is stuck is left alone after a while; that is logged.
        """
        with self._left:
            self.closed = True
            me = threading.get_ident()
            if not self._left.wait_for(lambda: all(thread == me for thread in self.inside), STUCK):
                log.warning("%s: still in a handler after %g s; not waiting any longer", self._name, STUCK)


class Servant:
    """A service behind its gate: it executes no expired request, and nothing once it is closed."""

    def __init__(self, name: str, service: Service, stats: Statistics) -> None:
        self._service, self._stats = service, stats
        self._gate = Gate(name)

    def serve(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> bool:
        """Answer a request, now or later; False, without an answer, if it is closed."""
        gate, me = self._gate, threading.get_ident()
        gate.inside.append(me)  # `enter` and `leave` inlined, for speed
        try:
            if gate.closed:
                return False
            if time.monotonic() >= expires:
                self._stats.expired += 1
                answer(Reply(Status.EXPIRED))
            else:
                self._stats.received += 1
                reply = reply_of(self._service, payload, expires)
                if isinstance(reply, Reply):
                    answer(reply)
                else:
                    pass_on(reply, answer)
            return True
        finally:
            gate.inside.remove(me)
            if gate.closed:
                gate.left()

    def ask(self, payload: Payload, now: float, expires: float) -> Reply | Future[Reply] | None:
        """Run the service on the calling thread, which made the request; None if it is closed."""
        gate, me = self._gate, threading.get_ident()
        gate.inside.append(me)
        try:
            if gate.closed:
                return None
            if now >= expires:
                self._stats.expired += 1
                return Reply(Status.EXPIRED)
            self._stats.received += 1
            return reply_of(self._service, payload, expires)
        finally:
            gate.inside.remove(me)
            if gate.closed:
                gate.left()

    def close(self) -> None:
        """Start no more handlers, and wait for the running ones."""
        self._gate.close()


class Lane:
    """The messages of one inlet on their way to its sink: in order, one at a time, at most `depth` waiting.

    A full lane drops its oldest message (`lossy`), or takes no more until there is room.
    """

    def __init__(self, name: str, sink: Sink, depth: int, *, lossy: bool, stats: Statistics) -> None:
        self._name, self._sink, self._depth, self._lossy, self._stats = name, sink, depth, lossy, stats
        self._waiting: deque[Payload] = deque()
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._wanted = 0
        """The number of threads that wait for room."""
        self._draining = False
        self._summoned = False
        self._gate = Gate(name)

    @property
    def full(self) -> bool:
        """Whether `put` would refuse; a lossy lane never is."""
        return not self._lossy and len(self._waiting) >= self._depth

    @property
    def lossy(self) -> bool:
        return self._lossy

    @property
    def room(self) -> int:
        """How many messages `put` would take; a lossy lane takes any number, and is said to have its depth."""
        return self._depth if self._lossy else self._depth - len(self._waiting)

    def put(self, payload: Payload, patience: float = 0.0, *, may_be_lost: bool = False) -> bool:
        """Append a message, after waiting for room at most `patience` seconds; whether it was taken.

        If there is no room, a message that may be lost is dropped and counted, and `put` returns True. After `put`,
        the caller must have `drain` called. A closed lane takes everything and discards it.
        """
        self._lock.acquire()
        try:
            waiting = self._waiting
            if len(waiting) >= self._depth:
                if self._lossy:
                    with contextlib.suppress(IndexError):  # `drain` may have taken it
                        waiting.popleft()
                        self._stats.dropped += 1
                elif may_be_lost:  # not the oldest, which may be a message that must not be lost
                    if not self._gate.closed:
                        self._stats.dropped += 1
                    return True
                elif not self._await_room(patience):
                    return False
            if not self._gate.closed:
                waiting.append(payload)
            return True
        finally:
            self._lock.release()

    def put_all(self, payloads: list[Payload]) -> int:
        """`put` each, without waiting for room; how many were taken. Stops at the first one that was not."""
        if len(payloads) == 1 or len(self._waiting) + len(payloads) > self._depth:
            return next((number for number, each in enumerate(payloads) if not self.put(each)), len(payloads))
        with self._lock:
            if not self._gate.closed:
                self._waiting.extend(payloads)
        return len(payloads)

    @property
    def idle(self) -> bool:
        """Whether the sink has handled every message, and no `drain` is due."""
        with self._lock:
            return not (self._waiting or self._draining or self._summoned)

    def through(self, wrap: Callable[[Sink], Sink]) -> None:
        """Put something in front of the sink."""
        self._sink = wrap(self._sink)

    def start_with(self, payloads: Iterable[Payload]) -> None:
        """Append the newest `depth` of these, which a late subscriber has missed; does not wait for room."""
        with self._lock:
            if not self._gate.closed:
                self._waiting.extend(deque(payloads, self._depth))

    def summon(self) -> bool:
        """Whether the caller has to call `drain`: not if it runs already, or another thread was told to call it."""
        with self._lock:
            if self._draining or self._summoned:
                return False
            self._summoned = True
            return True

    def drain(self) -> None:
        """Give the waiting messages to the sink. Returns at once if another thread is doing so."""
        lock = self._lock
        lock.acquire()
        self._summoned, draining = False, self._draining
        self._draining = True
        lock.release()
        if draining:
            return
        waiting, gate, me = self._waiting, self._gate, threading.get_ident()
        gate.inside.append(me)  # `enter` and `leave` inlined, for speed; a closed lane is empty
        try:
            while True:
                try:
                    payload = waiting.popleft()  # atomic, and quicker without the lock
                except IndexError:
                    lock.acquire()
                    more = self._draining = bool(waiting)
                    lock.release()
                    if more:
                        continue
                    return
                if self._wanted:
                    with self._lock:
                        self._changed.notify_all()
                if gate.closed:
                    continue
                self._stats.received += 1
                try:
                    self._sink(payload)
                except BaseException:  # also SystemExit: later messages must still be delivered
                    log.exception("%s: a message was not handled", self._name)
        finally:
            gate.inside.remove(me)
            if gate.closed:
                gate.left()

    def close(self) -> None:
        """Discard what waits. The sink is not called any more once this returns."""
        with self._lock:  # closed at once: nothing that is put meanwhile stays, and no thread waits for room
            self._gate.closed = True
            self._waiting.clear()
            self._changed.notify_all()
        self._gate.close()

    def _await_room(self, patience: float) -> bool:
        """Called with the lock, which is released while waiting."""
        self._wanted += 1
        try:
            return self._changed.wait_for(lambda: not self.full or self._gate.closed, patience)
        finally:
            self._wanted -= 1


class CommandLane(Lane):
    """Commands on their way to their sink, each with the time at which it expires. Without room, they are dropped."""

    def __init__(self, name: str, sink: Sink, stats: Statistics) -> None:
        super().__init__(name, self._execute, COMMANDS_WAITING, lossy=False, stats=stats)
        self._command = sink

    def take(self, payload: Payload, expires: float) -> bool:
        """Append a command; whether there was room for it."""
        if self.put((expires, payload)):
            return True
        self._stats.dropped += 1
        if self._stats.dropped == 1:
            log.warning("%s: %d commands wait; dropping more", self._name, COMMANDS_WAITING)
        return False

    def _execute(self, waiting: tuple[float, Payload]) -> None:
        expires, payload = waiting
        if time.monotonic() >= expires:
            self._stats.expired += 1
        else:
            self._command(payload)
