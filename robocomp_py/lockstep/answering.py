"""A follower's end of the socket on which the leader of its clock asks.

The thread that has the helm receives the questions (`helm.py`). If a question makes the loop of the component go on,
the answer waits until the loop waits for the clock again, or until the stand-in answers.
"""

from __future__ import annotations

import contextlib
import logging
import secrets
import select
import socket
import struct
import threading
from collections.abc import Callable
from typing import Protocol

from ..runtime.clock import NEVER
from .balance import State
from .helm import ANY_CORE, Alarm, Helm
from .line import LOOK, MOST, QUESTION, STEP, TELL, bound, is_own, pack_answer, unpack_answer

log = logging.getLogger("robocomp.clock")

_NO_STATE = State(NEVER, True, 0, ())


class Answers(Protocol):
    """What a follower answers. `asking` is the event of the thread that asks, if that is a loop that waits for it."""

    def work(self, now: int, asking: threading.Event | None) -> State | None:
        """Do all that is due until an instant; None, before that is done, if the asking thread has to do some of it.

        Its event need not be set then.
        """

    def tell(self, now: int) -> State:
        """Show an instant to handlers. What is due waits for `work`."""

    def watch(self, last: State, asking: threading.Event | None) -> State:
        """Wait until its state differs from the last one, but not long, and not if the event is set."""


class Answering:
    """Answers one leader at a time. `begin`, `close`."""

    def __init__(self, name: str, answers: Answers) -> None:
        self.helm = Helm(f"{name}-line", self)
        self.address = ""
        """Where a leader reaches it; "" if that is not possible."""
        self.is_for_loop = False
        """While a leader is connected."""
        self._core = ANY_CORE
        """That of the leader, as its last question told."""
        self._answers = answers
        self._listening: socket.socket | None = None
        self._connected: socket.socket | None = None
        self._polls: dict[Alarm, Callable[[float], list[tuple[int, int]]]] = {}
        """Wait for a question, or for the alarm, at most for a time in milliseconds."""
        self._question: tuple[int, int, int, State] | None = None
        """The one that is not answered yet: its number, its kind, its instant, and the last state for a look."""
        self._buffer = bytearray(MOST)  # a new one for each question costs more than the question
        self._closed = False
        self._lock = threading.Lock()

    def begin(self) -> None:
        """Let a leader connect from now on."""
        address = f"robocomp-clock-{secrets.token_hex(16)}"
        self._listening = bound(address)
        if self._listening and self.helm.begin():
            self.address = address

    def close(self) -> None:
        """Idempotent."""
        with self._lock:
            self._closed = True
            for each in (self._listening, self._connected):
                if each:
                    with contextlib.suppress(OSError):
                        each.shutdown(socket.SHUT_RDWR)
        self.helm.close()
        self._hang_up()
        if self._listening:
            self._listening.close()

    # For the helm.

    def core(self) -> int:
        return self._core

    def serve(self, by: Alarm, timeout: float, *, is_loop: bool) -> bool:
        sock = self._connected
        try:
            if sock:
                return self._attend(sock, by, timeout * 1000, by if is_loop else None)
            self._accept()
            return by.is_set()
        except (OSError, struct.error) as exc:
            log.debug("the line to the leader of the clock broke: %s", exc)
            self._hang_up()
            return by.is_set() if sock else by.wait(timeout)

    def _attend(self, sock: socket.socket, by: Alarm, milliseconds: float, asking: Alarm | None) -> bool:
        answers, buffer, poll = self._answers, self._buffer, self._polls[by]
        while True:
            if self._question:
                number, kind, now, last = self._question
                if kind == STEP:
                    state = answers.work(now, asking)
                    if state is None:
                        return True
                elif kind == TELL:
                    state = answers.tell(now)
                else:
                    state = answers.watch(last, asking)
                sock.send(pack_answer(number, state))
                self._question = None
            by.is_polled = True
            ready = [] if by.is_set() else poll(milliseconds)
            by.is_polled = False
            if len(ready) != 1 or ready[0][0] == by.bell.number:  # the alarm, or nothing for this time
                by.bell.silence()
                return by.is_set()
            size = sock.recv_into(buffer)
            if not size:
                raise OSError("the connection has ended")
            number, kind, now, self._core = QUESTION.unpack_from(buffer)
            last = unpack_answer(buffer, QUESTION.size, size)[1] if kind == LOOK else _NO_STATE
            self._question = number, kind, now, last

    # The connection.

    def _accept(self) -> None:
        """Wait for a leader. Only the stand-in does: the loop is not concerned while there is none."""
        assert self._listening
        sock, _ = self._listening.accept()
        if not is_own(sock):
            sock.close()
            return
        self._polls = {each: self._poll(sock, each) for each in (self.helm.alarm, self.helm.spare)}
        with self._lock:
            if self._closed:
                sock.close()
            else:
                self._question, self._connected, self.is_for_loop = None, sock, True

    def _hang_up(self) -> None:
        with self._lock:
            sock, self._connected, self.is_for_loop = self._connected, None, False
        if sock:
            sock.close()

    @staticmethod
    def _poll(sock: socket.socket, alarm: Alarm) -> Callable[[float], list[tuple[int, int]]]:
        poll = select.poll()
        poll.register(sock, select.POLLIN)
        poll.register(alarm.bell.number, select.POLLIN)
        return poll.poll
