"""A follower's end of the socket on which the leader of its clock asks.

The loop of the component or a backup thread receives the questions (`handover.py`). If a question lets the loop go on,
the answer waits until the loop waits for the clock again, or until the backup thread answers.
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
from .cores import ANY_CORE
from .handover import Handover
from .line import LOOK, MOST, QUESTION, STEP, TELL, bound, is_own, pack_answer, unpack_answer
from .pollable import PollableEvent

log = logging.getLogger("robocomp.clock")

_NO_STATE = State(NEVER, True, 0, ())


class Answers(Protocol):
    """What a follower answers. `asking` is the event of the calling thread if that is a loop that waits for it."""

    def work(self, now: int, asking: threading.Event | None) -> State | None:
        """Do all that is due until an instant. Returns None before that is done if the calling thread has to do some of
        it; its event need not be set then."""

    def tell(self, now: int) -> State:
        """Show an instant to handlers. What is due waits for `work`."""

    def watch(self, last: State, asking: threading.Event | None) -> State:
        """Wait until its state differs from the last one, but not long. If `asking` is set, do not wait."""


class Answering:
    """Answers one leader at a time. `begin`, `close`."""

    def __init__(self, name: str, answers: Answers) -> None:
        self.handover = Handover(f"{name}-line", self)
        self.address = ""
        """Where a leader reaches it; "" if that is not possible."""
        self.is_for_loop = False
        """While a leader is connected."""
        self._core = ANY_CORE
        """That of the leader, as its last question told."""
        self._answers = answers
        self._listening: socket.socket | None = None
        self._connected: socket.socket | None = None
        self._polls: dict[PollableEvent, Callable[[float], list[tuple[int, int]]]] = {}
        """By the event of a thread: wait for a question or for that event, at most for a time in ms."""
        self._question: tuple[int, int, int, State] | None = None
        """The question that is not answered yet: its number, its kind, its instant, and for a look the last state."""
        self._buffer = bytearray(MOST)  # a new one for each question costs more than the question
        self._closed = False
        self._lock = threading.Lock()

    def begin(self) -> None:
        """Let a leader connect from now on."""
        address = f"robocomp-clock-{secrets.token_hex(16)}"
        self._listening = bound(address)
        if self._listening and self.handover.begin():
            self.address = address

    def close(self) -> None:
        """Idempotent."""
        with self._lock:
            self._closed = True
            for each in (self._listening, self._connected):
                if each:
                    with contextlib.suppress(OSError):
                        each.shutdown(socket.SHUT_RDWR)
        self.handover.close()
        self._hang_up()
        if self._listening:
            self._listening.close()

    # The task, for `handover`.

    def core(self) -> int:
        return self._core

    def serve(self, wake: PollableEvent, timeout: float, *, is_loop: bool) -> bool:
        sock = self._connected
        try:
            if sock:
                return self._attend(sock, wake, timeout * 1000, wake if is_loop else None)
            self._accept()
            return wake.is_set()
        except (OSError, struct.error) as exc:
            log.debug("the line to the leader of the clock broke: %s", exc)
            self._hang_up()
            return wake.is_set() if sock else wake.wait(timeout)

    def _attend(
        self, sock: socket.socket, wake: PollableEvent, milliseconds: float, asking: PollableEvent | None
    ) -> bool:
        answers, buffer, poll = self._answers, self._buffer, self._polls[wake]
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
            wake.is_polling = True
            ready = [] if wake.is_set() else poll(milliseconds)
            wake.is_polling = False
            if len(ready) != 1 or ready[0][0] == wake.wakeup.descriptor:  # its event, or the timeout
                wake.wakeup.clear()
                return wake.is_set()
            size = sock.recv_into(buffer)
            if not size:
                raise OSError("the connection has ended")
            number, kind, now, self._core = QUESTION.unpack_from(buffer)
            last = unpack_answer(buffer, QUESTION.size, size)[1] if kind == LOOK else _NO_STATE
            self._question = number, kind, now, last

    # The connection.

    def _accept(self) -> None:
        """Wait for a leader. Only the backup thread does, since without a leader, the task is not for the loop."""
        assert self._listening
        sock, _ = self._listening.accept()
        if not is_own(sock):
            sock.close()
            return
        self._polls = {each: self._poll(sock, each) for each in (self.handover.wake, self.handover.backup_wake)}
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
    def _poll(sock: socket.socket, wake: PollableEvent) -> Callable[[float], list[tuple[int, int]]]:
        poll = select.poll()
        poll.register(sock, select.POLLIN)
        poll.register(wake.wakeup.descriptor, select.POLLIN)
        return poll.poll
