"""A socket between the leader of a clock and one follower, which carries a question and its answer at a time.

    question    number, kind, instant                          for a step
                number, kind, the last state                   for a look
    answer      number, the state

It takes a tenth of the time of a query over a middleware, and its end tells at once that the other process is gone.
Both processes are on one host and belong to one user. The address is a random name without a file, which the follower
tells over the middleware: nothing is left of it after `kill -9`. If there is no such line, the leader asks by queries.
"""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import socket
import struct
import threading
from collections.abc import Iterator
from typing import Protocol

from ..errors import Timeout, Unreachable
from ..threads import start_thread
from .balance import State

log = logging.getLogger("robocomp.clock")

_STEP, _LOOK = 0, 1
_QUESTION = struct.Struct("<IBq")
_ANSWER = struct.Struct("<I")
_STATE = struct.Struct("<q?i")
_CREDENTIALS = struct.Struct("3i")
_MOST = 1 << 16
"""Octets of a message: enough for thousands of counters. A longer one ends the line."""

_STUCK = 5.0
"""Seconds that closing waits for the thread."""


class Asked(Protocol):
    """What a leader asks."""

    def step(self, now: int) -> State: ...

    def look(self, last: State) -> State: ...


class Line:
    """The leader's end. Used by one thread."""

    def __init__(self, sock: socket.socket, deadline: float) -> None:
        """A question takes at most `deadline` seconds, on a socket that was connected by `connect`."""
        self._sock, self._deadline, self._number = sock, deadline, 0
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(deadline))
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(deadline))

    def step(self, now: int) -> State:
        """Raises Timeout without an answer, and Unreachable if the follower is gone."""
        return self._ask(_STEP, now, b"")

    def look(self, last: State) -> State:
        """As `step`."""
        return self._ask(_LOOK, 0, _packed(last))

    def close(self) -> None:
        self._sock.close()

    def _ask(self, kind: int, now: int, rest: bytes) -> State:
        self._number = number = (self._number + 1) & 0xFFFFFFFF
        try:
            self._sock.send(_QUESTION.pack(number, kind, now) + rest)
            while answer := self._sock.recv(_MOST):
                if _ANSWER.unpack_from(answer)[0] == number:  # else it is one that came too late
                    return _unpacked(answer, _ANSWER.size)
        except BlockingIOError as exc:
            raise Timeout(f"no answer for {self._deadline:g} s") from exc
        except (OSError, struct.error) as exc:
            raise Unreachable("the connection has ended") from exc
        raise Unreachable("the connection has ended")


def connect(address: str, deadline: float) -> Line | None:
    """A line to the follower at this address; None if it cannot be reached there."""
    sock = _socket()
    if sock is None:
        return None
    try:
        sock.connect(f"\0{address}")
        if _user(sock) == os.getuid():
            return Line(sock, deadline)
    except OSError as exc:
        log.debug("no line to a follower: %s", exc)
    sock.close()
    return None


class Answering:
    """The follower's end: a thread that answers questions, of one leader at a time."""

    def __init__(self, name: str, asked: Asked) -> None:
        self.address = ""
        """Where a leader reaches it; "" if that is not possible."""
        self._name, self._asked = name, asked
        self._listening: socket.socket | None = None
        self._connected: socket.socket | None = None
        self._lock = threading.Lock()
        self._closed = False
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Let a leader connect from now on."""
        sock, address = _socket(), f"robocomp-clock-{secrets.token_hex(16)}"
        if sock is None:
            return
        try:
            sock.bind(f"\0{address}")
            sock.listen(1)
        except OSError as exc:
            log.debug("no line to a leader: %s", exc)
            sock.close()
            return
        self._listening = sock
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
        if self._thread and self._thread.ident:
            self._thread.join(_STUCK)
        if self._listening:
            self._listening.close()

    def _run(self) -> None:
        for sock in self._leaders():
            try:
                self._answer(sock)
            except (OSError, struct.error) as exc:
                log.debug("the line to the leader of the clock broke: %s", exc)

    def _leaders(self) -> Iterator[socket.socket]:
        assert self._listening
        while not self._closed:
            try:
                sock, _ = self._listening.accept()
            except OSError:
                return  # it is closed
            with sock:
                with self._lock:
                    if self._closed:
                        return
                    self._connected = sock
                try:
                    if _user(sock) == os.getuid():
                        yield sock
                finally:
                    with self._lock:
                        self._connected = None

    def _answer(self, sock: socket.socket) -> None:
        step, look = self._asked.step, self._asked.look
        while question := sock.recv(_MOST):
            number, kind, now = _QUESTION.unpack_from(question)
            state = step(now) if kind == _STEP else look(_unpacked(question, _QUESTION.size))
            sock.send(_ANSWER.pack(number) + _packed(state))


def _socket() -> socket.socket | None:
    """None if this system has no such sockets."""
    try:
        return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    except (OSError, AttributeError):
        return None


def _user(sock: socket.socket) -> int:
    """The user of the process at the other end."""
    credentials = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    user: int = _CREDENTIALS.unpack(credentials)[1]
    return user


def _timeval(seconds: float) -> bytes:
    return struct.pack("ll", int(seconds), int(seconds % 1 * 1_000_000))


def _packed(state: State) -> bytes:
    numbers = state.numbers
    return _STATE.pack(state.due, state.settled, state.version) + struct.pack(f"<{len(numbers)}q", *numbers)


def _unpacked(octets: bytes, at: int) -> State:
    due, settled, version = _STATE.unpack_from(octets, at)
    at += _STATE.size
    return State(due, settled, version, struct.unpack_from(f"<{(len(octets) - at) // 8}q", octets, at))
