"""A follower's end of the socket on which the leader of its clock asks.

One thread at a time receives the questions: that of the component's loop, while it waits for the clock, so that no
other thread has to wake up for an instant; otherwise the reader, a thread that belongs to this end.

    loop      waits for its clock → lent: receives, answers → it is due: works → waits again: answers the question
    reader    receives while the loop does not. It takes over, with the question that is not answered yet, if the loop
              is about to block, or does not come back soon
"""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import select
import socket
import struct
import threading
from collections.abc import Callable
from typing import Protocol

from ..threads import start_thread
from ..transports.base import receives
from .balance import State
from .line import MOST, QUESTION, STEP, bound, is_own, pack_answer, unpack_answer

log = logging.getLogger("robocomp.clock")

_SOON = 0.02
"""Seconds after which the reader takes over from a loop that works."""

_QUIET = 25
"""Looks in a row without an instant after which the reader stops looking."""

_STUCK = 5.0
"""Seconds that closing waits for the thread."""


class Answers(Protocol):
    """What a follower answers. `asking` is the event of the thread that asks, if that is a loop that waits for it."""

    def work(self, now: int, asking: threading.Event | None) -> State | None:
        """Do all that is due until an instant; None, before that is done, if the asking thread has to do some of it.

        Its event need not be set then.
        """

    def watch(self, last: State, asking: threading.Event | None) -> State:
        """Wait until its state differs from the last one, but not long, and not if the event is set."""


class Bell:
    """Ends the `poll` of a thread."""

    def __init__(self) -> None:
        self.number = -1
        """Of its descriptor; -1 while it is not open."""
        self._lock = threading.Lock()

    def open(self) -> None:
        self.number = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def ring(self) -> None:
        with self._lock:
            if self.number >= 0:
                os.eventfd_write(self.number, 1)

    def silence(self) -> None:
        """After it has rung."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self.number)

    def close(self) -> None:
        with self._lock:
            if self.number >= 0:
                os.close(self.number)
                self.number = -1


class Alarm(threading.Event):
    """The event of a loop, which also ends its `poll`.

    Only the thread of the loop waits for it. So a lock will do, which takes a fifth of the time of a condition.
    """

    def __init__(self) -> None:
        super().__init__()
        self.bell = Bell()
        self.is_polled = False
        """Whether the loop polls, or is about to."""
        self._is_on = False
        self._setting = threading.Lock()
        self._rung = threading.Lock()
        """Released when the event is set."""
        self._rung.acquire()

    def is_set(self) -> bool:
        return self._is_on

    def set(self) -> None:
        with self._setting:
            self._is_on = True
            if self._rung.locked():
                self._rung.release()
        if self.is_polled:
            self.bell.ring()

    def clear(self) -> None:
        self._is_on = False

    def wait(self, timeout: float | None = None) -> bool:
        """As that of an event, but it may return earlier."""
        if not self._is_on:
            self._rung.acquire(timeout=-1 if timeout is None else timeout)
        return self._is_on


class Answering:
    """Answers one leader at a time. `begin`, `wait` on the thread of the loop, `close`."""

    def __init__(self, name: str, answers: Answers) -> None:
        self.address = ""
        """Where a leader reaches it; "" if that is not possible."""
        self.alarm = Alarm()
        """That of the loop."""
        self._name, self._answers = name, answers
        self._bell = Bell()
        """That of the reader."""
        self._listening: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._registered = False
        self._buffer = bytearray(MOST)  # a new one for each question costs more than the question
        self._closed = False
        self._lock = threading.Lock()
        self._connected: socket.socket | None = None
        self._poll: Callable[[float], list[tuple[int, int]]] = lambda timeout: []
        """Waits for a question, or for the alarm, at most for this time in milliseconds."""
        self._is_wanted = False
        """Whether the loop would like to receive."""
        self._is_lent = False
        """Whether it does."""
        self._is_out = False
        """Whether it does something else in the meantime."""
        self._outs = 0
        """How often it has begun to."""
        self._owed = b""
        """The question that it answers when it is back."""
        self._left = b""
        """The question that it has left to the reader."""
        self._is_watched = False
        """Whether the reader looks from time to time if the loop is back."""

    def begin(self) -> None:
        """Let a leader connect from now on."""
        address = f"robocomp-clock-{secrets.token_hex(16)}"
        self._listening = bound(address)
        if self._listening is None:
            return
        self._bell.open()
        self.alarm.bell.open()
        self._thread = threading.Thread(target=self._run, name=f"{self._name}-line", daemon=True)
        if start_thread(self._thread):
            self.address = address

    def close(self) -> None:
        """Idempotent."""
        with self._lock:
            self._closed = True
            for each in (self._listening, self._connected):
                if each:
                    with contextlib.suppress(OSError):
                        each.shutdown(socket.SHUT_RDWR)
        self._bell.ring()
        if self._thread and self._thread.ident:
            self._thread.join(_STUCK)
        if self._listening:
            self._listening.close()
        self._bell.close()
        self.alarm.bell.close()

    # The loop.

    def wait(self, wake: threading.Event, timeout: float) -> bool:
        """As the `wait` of an event. If that is the alarm, questions are answered meanwhile."""
        if wake is not self.alarm:
            return wake.wait(timeout)
        with self._lock:
            self._is_out = False
            sock = self._connected if self._is_lent else None
            asks = sock is None and self._connected is not None and not self._is_wanted
            self._is_wanted |= asks
        if asks:
            self._bell.ring()
        if sock is None:
            return wake.wait(timeout)
        try:
            return self._attend(sock, timeout)
        except (OSError, struct.error):  # the leader is gone; the reader finds out, too
            with self._lock:
                self._is_lent, self._owed = False, b""
            self._bell.ring()
            return self.alarm.is_set()
        finally:
            with self._lock:
                self._is_out = True
                self._outs += 1
                asks = self._is_lent and not self._is_watched
                self._is_watched |= asks
            if asks:
                self._bell.ring()

    def _attend(self, sock: socket.socket, timeout: float) -> bool:
        alarm, number, wait = self.alarm, sock.fileno(), self._poll
        if not self._registered:
            self._registered = True
            receives(self._step_aside)
        question, self._owed = self._owed, b""
        while True:
            if question and not self._answer(sock, question, alarm):
                self._owed = question
                return True
            alarm.is_polled = True
            ready = [] if alarm.is_set() else wait(timeout * 1000)
            alarm.is_polled = False
            if len(ready) != 1 or ready[0][0] != number:  # the alarm, or nothing for this time
                alarm.bell.silence()
                return alarm.is_set()
            question = self._receive(sock)
            if not question:
                raise OSError("the connection has ended")

    def _step_aside(self) -> None:
        """Leave the questions to the reader, because the loop is about to block."""
        with self._lock:
            asks = self._is_lent and self._is_out
            if asks:
                self._leave()
        if asks:
            self._bell.ring()

    def _leave(self) -> None:
        """Called with the lock, while the loop is out."""
        self._is_lent = False
        self._left, self._owed = self._owed, b""

    # The reader.

    def _run(self) -> None:
        assert self._listening
        while not self._closed:
            try:
                sock, _ = self._listening.accept()
            except OSError:
                return  # it is closed
            with sock:
                try:
                    if is_own(sock):
                        self._serve(sock)
                except (OSError, struct.error) as exc:
                    log.debug("the line to the leader of the clock broke: %s", exc)
                finally:
                    with self._lock:
                        self._connected = None
                        self._is_lent = self._is_wanted = False
                        self._owed = self._left = b""

    def _serve(self, sock: socket.socket) -> None:
        own, loops = select.poll(), select.poll()
        for poll, bell in ((own, self._bell), (loops, self.alarm.bell)):
            poll.register(sock, select.POLLIN)
            poll.register(bell.number, select.POLLIN)
        with self._lock:
            self._connected, self._poll = sock, loops.poll
        while not self._closed:
            with self._lock:
                question, self._left = self._left, b""
                lends = self._is_wanted and not question
                if lends:
                    self._is_wanted, self._is_lent, self._is_out = False, True, True
                    self._outs += 1
                is_lent = self._is_lent
            if lends:
                self.alarm.set()  # it finds that nothing is due, and waits again
            if is_lent:
                self._look_out()
                continue
            if not question:
                ready = own.poll()
                if any(number == self._bell.number for number, _ in ready):
                    self._bell.silence()
                if all(number == self._bell.number for number, _ in ready):
                    continue
                question = self._receive(sock)
                if not question:
                    return
            self._answer(sock, question)

    def _look_out(self) -> None:
        """Return when the loop receives no longer."""
        poll, quiet = select.poll(), 0
        poll.register(self._bell.number, select.POLLIN)
        while not self._closed:
            outs, was_out = self._outs, self._is_out
            if poll.poll(_SOON * 1000 if self._is_watched else None):
                self._bell.silence()
            with self._lock:
                if not self._is_lent:
                    return
                quiet = quiet + 1 if outs == self._outs else 0
                if not quiet:
                    continue
                if was_out and self._is_out:
                    self._leave()
                    return
                self._is_watched = quiet < _QUIET

    def _receive(self, sock: socket.socket) -> bytes:
        """The next question; "" if the connection has ended. Called by the thread that receives."""
        return bytes(self._buffer[: sock.recv_into(self._buffer)])

    def _answer(self, sock: socket.socket, question: bytes, asking: threading.Event | None = None) -> bool:
        """Answer a question; False, without an answer, if the asking thread has something else to do."""
        number, kind, now = QUESTION.unpack_from(question)
        if kind == STEP:
            state = self._answers.work(now, asking)
        else:
            _, last = unpack_answer(question, QUESTION.size, len(question))
            state = self._answers.watch(last, asking)
        if state is None:
            return False
        sock.send(pack_answer(number, state))
        return True
