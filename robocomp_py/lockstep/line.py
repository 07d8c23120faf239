"""A socket between the leader of a clock and one follower, which carries a question and its answer at a time.

This is the leader's end, and the form of the messages; that of the follower is in `answering.py`.

    question    number, kind, instant, core                    for a step, or to tell an instant
                number, kind, 0, core, the last answer         for a look
    answer      number, the state

`core` is the core on which the leader's loop waits, so that the follower's loop can wait there, too (`handover.py`).

It takes a tenth of the time of a query over a middleware, and its end tells at once that the other process is gone.
Both processes are on one host and belong to one user. The address is a random name without a file, which the follower
tells over the middleware: nothing is left of it after `kill -9`. If there is no such line, the leader asks by queries.
"""

from __future__ import annotations

import logging
import os
import socket
import struct
import time
from functools import cache

from ..errors import Timeout, Unreachable
from .balance import State
from .cores import ANY_CORE

log = logging.getLogger("robocomp.clock")

STEP, LOOK, TELL = range(3)
QUESTION = struct.Struct("<IBqh")
_ANSWER = "<Iq?iq{}q"
_ANSWER_SIZE = struct.calcsize(_ANSWER.format(0))
_CREDENTIALS = struct.Struct("3i")
MOST = 1 << 16
"""Octets of a message: enough for thousands of counters. A longer one ends the line."""

_SLICE = 0.05
"""Longest wait for an answer in seconds before the leader may do something else."""


class Line:
    """The leader's end. Used by one thread at a time. A question is `step`, `tell` or `look`; then `answer` is called.

    All of them raise Unreachable if the follower is gone.
    """

    def __init__(self, sock: socket.socket, deadline: float) -> None:
        """The follower has `deadline` seconds for an answer."""
        self.core = ANY_CORE
        """That of the leader's loop."""
        self._sock, self._deadline, self._number = sock, deadline, 0
        self._until = 0.0
        """When the deadline of the question is over; 0 before the first wait for its answer has ended."""
        self._buffer = bytearray(MOST)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(min(_SLICE, deadline)))
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(deadline))

    def step(self, now: int) -> None:
        """Have it do all that is due until an instant."""
        self._ask(STEP, now, b"")

    def tell(self, now: int) -> None:
        """Have it show an instant to its handlers."""
        self._ask(TELL, now, b"")

    def look(self, last: State) -> None:
        """Have it tell its state, as soon as that differs from the last one."""
        self._ask(LOOK, 0, pack_answer(0, last))

    def answer(self, asking: object = None) -> State | None:
        """The answer; None if it takes longer: call this again, on any thread.

        Raises Timeout when the deadline is over.
        """
        try:
            while size := self._sock.recv_into(self._buffer):
                answered, state = unpack_answer(self._buffer, 0, size)
                if answered == self._number:  # else it is one that came too late
                    return state
        except BlockingIOError:
            now = time.monotonic()
            self._until = self._until or now + self._deadline - _SLICE
            if now < self._until:
                return None
            raise Timeout(f"no answer for {self._deadline:g} s") from None
        except (OSError, struct.error) as exc:
            raise Unreachable("the connection has ended") from exc
        raise Unreachable("the connection has ended")

    def close(self) -> None:
        self._sock.close()

    def _ask(self, kind: int, now: int, rest: bytes) -> None:
        self._number = number = (self._number + 1) & 0xFFFFFFFF
        self._until = 0.0
        try:
            self._sock.send(QUESTION.pack(number, kind, now, self.core) + rest)
        except BlockingIOError as exc:
            raise Timeout(f"no question could be sent for {self._deadline:g} s") from exc
        except OSError as exc:
            raise Unreachable("the connection has ended") from exc


def connect(address: str, deadline: float) -> Line | None:
    """A line to the follower at this address; None if it cannot be reached there."""
    sock = _new_socket()
    if sock is None:
        return None
    try:
        sock.connect(f"\0{address}")
        if is_own(sock):
            return Line(sock, deadline)
    except OSError as exc:
        log.debug("no line to a follower: %s", exc)
    sock.close()
    return None


def bound(address: str) -> socket.socket | None:
    """A socket that listens at this address; None if that is not possible."""
    sock = _new_socket()
    if sock is None:
        return None
    try:
        sock.bind(f"\0{address}")
        sock.listen(1)
    except OSError as exc:
        log.debug("no line to a leader: %s", exc)
        sock.close()
        return None
    return sock


def is_own(sock: socket.socket) -> bool:
    """Whether the process at the other end belongs to the same user."""
    credentials = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return bool(_CREDENTIALS.unpack(credentials)[1] == os.getuid())


def _new_socket() -> socket.socket | None:
    """None if this system has no such sockets."""
    try:
        return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    except (OSError, AttributeError):
        return None


def _timeval(seconds: float) -> bytes:
    return struct.pack("ll", int(seconds), int(seconds % 1 * 1_000_000))


def pack_answer(number: int, state: State) -> bytes:
    """The answer to the question of this number."""
    due, settled, version, numbers, made = state
    return _form(len(numbers)).pack(number, due, settled, version, made, *numbers)


def unpack_answer(octets: bytes | bytearray, begin: int, end: int) -> tuple[int, State]:
    """The number of the question, and the state, of an answer that is a part of these octets."""
    form = _form((end - begin - _ANSWER_SIZE) // 8)
    number, due, settled, version, made, *numbers = form.unpack_from(octets, begin)
    return number, State(due, settled, version, tuple(numbers), made)


@cache
def _form(numbers: int) -> struct.Struct:
    """The form of an answer with that number of counters."""
    return struct.Struct(_ANSWER.format(numbers))
