"""A socket between the leader of a clock and one follower, which carries a question and its answer at a time.

This is the leader's end, and the form of the messages; that of the follower is in `answering.py`.

    question    number, kind, hops, instant, dues       for a step
                number, kind, 0, 0, the last answer     for a look
                number, kind, 0, instant                for a step, after a socket was taken: see `chain.py`
    answer      number, dues, the state

A question with `hops` left is passed on to the next follower, with the time at which this one is due. So an answer may
hold the dues of those that passed the question on. Numbers increase over all lines of a leader: a follower that has got
a later question ignores an earlier one.

It takes a tenth of the time of a query over a middleware, and its end tells at once that the other process is gone.
Both processes are on one host and belong to one user. The address is a random name without a file, which the follower
tells over the middleware: nothing is left of it after `kill -9`. If there is no such line, the leader asks by queries.
"""

from __future__ import annotations

import itertools
import logging
import os
import socket
import struct
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, Protocol

from ..errors import Timeout, Unreachable
from .balance import State

log = logging.getLogger("robocomp.clock")

STEP, LOOK, HEAR, TELL = range(4)
QUESTION = struct.Struct("<QBHq")
KIND = struct.calcsize("<Q")
"""Where a question tells its kind."""
DUE = struct.Struct("<q")
_ANSWER = "<QHq?iq{}q"
_ANSWER_SIZE = struct.calcsize(_ANSWER.format(0))
_CREDENTIALS = struct.Struct("3i")
MOST = 1 << 16
"""Octets of a message: enough for thousands of counters. A longer one ends the line."""


class Asked(Protocol):
    """What a leader asks."""

    def step(self, now: int) -> State: ...

    def look(self, last: State) -> State: ...


class Answer(NamedTuple):
    number: int
    """That of the question."""
    dues: Sequence[int]
    """When those are due that passed the question on."""
    state: State


class Line:
    """The leader's end. Used by one thread."""

    def __init__(self, sock: socket.socket, deadline: float) -> None:
        """A question takes at most `deadline` seconds, on a socket that was connected by `connect`."""
        self._sock, self._deadline = sock, deadline
        self._buffer = bytearray(MOST)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(deadline))
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(deadline))

    def step(self, now: int) -> State:
        """Raises Timeout without an answer, and Unreachable if the follower is gone."""
        return self._answer_to(self.send(STEP, now))

    def look(self, last: State) -> State:
        """As `step`."""
        return self._answer_to(self.send(LOOK, 0, rest=pack_answer(0, last)))

    def take(self, kind: int, end: socket.socket, now: int) -> State:
        """As `step`. The follower first takes this socket: to hear questions from it, or to tell them there."""
        number = self.send(kind, now)
        try:
            socket.send_fds(self._sock, [b"."], [end.fileno()])
        except OSError as exc:
            raise Unreachable("the connection has ended") from exc
        return self._answer_to(number)

    def fileno(self) -> int:
        return self._sock.fileno()

    def close(self) -> None:
        self._sock.close()

    def send(self, kind: int, now: int, hops: int = 0, rest: bytes = b"") -> int:
        """Send a question, and return its number."""
        number = next(_numbers)
        try:
            self._sock.send(QUESTION.pack(number, kind, hops, now) + rest)
        except BlockingIOError as exc:
            raise Timeout(f"no answer for {self._deadline:g} s") from exc
        except OSError as exc:
            raise Unreachable("the connection has ended") from exc
        return number

    def receive(self) -> Answer:
        """The next answer. Raises as `step`."""
        try:
            if size := self._sock.recv_into(self._buffer):
                return unpack_answer(self._buffer, 0, size)
        except BlockingIOError as exc:
            raise Timeout(f"no answer for {self._deadline:g} s") from exc
        except (OSError, struct.error) as exc:
            raise Unreachable("the connection has ended") from exc
        raise Unreachable("the connection has ended")

    def _answer_to(self, number: int) -> State:
        while True:
            answered, _, state = self.receive()
            if answered == number:  # else it is one that came too late
                return state


_numbers = itertools.count(1)
"""Those of questions."""


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


def pack_answer(number: int, state: State, dues: Sequence[int] = ()) -> bytes:
    """The answer to the question of this number."""
    due, settled, version, numbers, made = state
    form = _form(len(dues) + len(numbers))
    return form.pack(number, len(dues), due, settled, version, made, *dues, *numbers)


def unpack_answer(octets: bytes | bytearray, begin: int, end: int) -> Answer:
    """An answer that is a part of these octets."""
    form = _form((end - begin - _ANSWER_SIZE) // 8)
    number, before, due, settled, version, made, *numbers = form.unpack_from(octets, begin)
    return Answer(number, numbers[:before], State(due, settled, version, tuple(numbers[before:]), made))


def unpack_dues(question: bytes) -> Sequence[int]:
    """When those are due that passed this question on."""
    return [due for (due,) in DUE.iter_unpack(question[QUESTION.size :])]


@cache
def _form(numbers: int) -> struct.Struct:
    """The form of an answer with so many numbers, dues included."""
    return struct.Struct(_ANSWER.format(numbers))
