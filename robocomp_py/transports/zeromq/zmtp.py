"""ZMTP, the protocol of ZeroMQ, for clients of `ipc://` sockets: without the library and its thread.

    greeting     64 octets from both sides: signature, version 3.0, mechanism NULL
    handshake    a command READY from both sides, with the socket's type
    traffic      frames: flags (1 more follow, 2 long, 4 a command), length (one octet, or eight), body

With the library, a message passes its I/O thread on both sides. That thread sleeps after a few idle microseconds, and
waking it takes longer than all the work in Python. Here the calling thread writes to the kernel and reads from it
itself, large arrays directly from and into their memory.
"""

from __future__ import annotations

import select
import socket
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from ...wire.codec import MAX_BYTES
from .frames import Frames

SLICE_MS = 50
"""Milliseconds without progress after which a `Wait` function is called."""

Wait = Callable[[], object]
"""Called when there was no progress for a while; raises to end the wait."""

_MORE, _LONG, _COMMAND = 1, 2, 4
_SHORTEST_LONG = 256
_HEAD, _LONG_HEAD = struct.Struct(">BB"), struct.Struct(">BQ")

_DONTWAIT, _WAITALL = int(socket.MSG_DONTWAIT), int(socket.MSG_WAITALL)
"""Plain numbers: combining enumerations takes longer than receiving a small message."""

_GREETING = b"\xff\0\0\0\0\0\0\0\1\x7f\3\0NULL".ljust(64, b"\0")
_TIMEOUT = struct.Struct("@ll").pack(0, SLICE_MS * 1000)
_MOMENT = struct.Struct("@ll").pack(0, 5000)
"""How long a subscriber waits, once, for the rest of a large frame, which usually comes at once."""

_ROOM = 1024 * 1024
"""Octets on their way to a server, if the kernel allows: more octets mean fewer thread switches."""

_FRAME = 4096
_LONGEST = MAX_BYTES + 4096 * _FRAME
"""Extra octets that each frame counts for, and the maximum octets of a message; a longer one ends the connection."""

_CHUNK = 64 * 1024
_APART = 8 * 1024
"""An incomplete frame with more octets than this gets memory of its own, and the rest is read into it."""


class Gone(ConnectionError):
    """The other side has closed the connection."""


class Garbled(Gone):
    """The other side violates the protocol."""


class _Connection:
    """The base of both kinds of connections: reads messages. For one thread at a time."""

    _waits = False
    """Whether receiving waits. If so, it returns between two parts of a message, so that the caller may stop."""
    _how = _DONTWAIT
    """The flags for receiving."""

    def __init__(self, kind: bytes) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        ready = b"\5READY\x0bSocket-Type" + len(kind).to_bytes(4, "big") + kind + b"\x08Identity" + bytes(4)
        self._begin = _GREETING + _head(_COMMAND, len(ready)) + ready
        self._recognized = self._greeted = False
        """Whether its greeting was read, and then its READY."""
        self._data, self._at = b"", 0
        """The received octets, and how many of them were used."""
        self._frames: Frames = []
        self._size = 0
        """The frames of an incomplete message."""
        self._loaded = False
        """Whether anything was received since `receive` was called."""
        self._body: memoryview | None = None
        self._flags = self._filled = 0
        """A large frame of which some is missing."""
        self._rest_flags = 0
        """The flags for its rest: the kernel waits for it, but only once."""

    @property
    def more(self) -> bool:
        """Whether more was received than was used."""
        return self._at < len(self._data)

    def close(self) -> None:
        self._socket.close()

    def receive(self) -> Frames:
        """The next message. Raises BlockingIOError if it is not complete in time; call again. Raises Gone.

        Large frames are read-only memory without other users.
        """
        if self._body is None and not self._frames:  # mostly the next message is one frame, and all there
            if self._at == len(self._data):
                self._load()
            data, at = self._data, self._at
            if data[at] == 0 and len(data) >= at + 2:
                begin, end = at + 2, at + 2 + data[at + 1]
            elif data[at] == _LONG and len(data) >= at + 9:
                begin, end = at + 9, at + 9 + int.from_bytes(data[at + 1 : at + 9], "big")
            else:
                begin, end = at, len(data) + 1
            if len(data) >= end:
                self._at = end
                return [data[begin:end]]
            self._size = 0  # commands between two messages are part of none
        self._loaded = False
        while True:
            flags, frame = self._frame()
            self._size += len(frame) + _FRAME
            if flags & _COMMAND:
                self._command(bytes(frame))
                continue
            self._frames.append(frame)
            if not flags & _MORE:
                frames, self._frames, self._size = self._frames, [], 0
                return frames

    def _frame(self) -> tuple[int, Any]:
        while True:
            if self._body is not None:
                self._fill(self._body)
                memory: Any = self._body.obj
                frame, self._body = self._body.toreadonly(), None
                memory.flags.writeable = False  # so it may be sent on without a copy
                return self._flags, frame
            data, at = self._data, self._at
            if len(data) >= at + 9 or (len(data) >= at + 2 and not data[at] & _LONG):
                flags, size = _LONG_HEAD.unpack_from(data, at) if data[at] & _LONG else _HEAD.unpack_from(data, at)
                at += 9 if flags & _LONG else 2
                if size > _LONGEST - self._size:
                    raise Garbled(f"it announced a message of {self._size + size} octets")
                if len(data) >= at + size:
                    self._at = at + size
                    return flags, data[at : at + size]
                if size > _APART:
                    import numpy as np  # whose memory is not cleared first

                    self._body = np.empty(size, np.uint8).data
                    self._flags, self._filled = flags, len(data) - at
                    self._body[: self._filled] = data[at:]
                    self._data, self._at = b"", 0
                    continue
            if self._loaded and self._waits:
                raise BlockingIOError
            self._load()
            self._loaded = True

    def _load(self) -> None:
        try:
            data = self._socket.recv(_CHUNK, self._how)
        except BlockingIOError:
            raise
        except OSError as exc:
            raise Gone(str(exc)) from exc
        if not data:
            raise Gone("it was closed")
        self._data, self._at = (self._data[self._at :] + data if self._at < len(self._data) else data), 0

    def _fill(self, body: memoryview) -> None:
        while self._filled < len(body):
            try:
                more = self._socket.recv_into(body[self._filled :], 0, _WAITALL | self._rest_flags)
            except BlockingIOError:
                self._rest_flags = self._how
                raise
            except OSError as exc:
                raise Gone(str(exc)) from exc
            if not more:
                raise Gone("it was closed in the middle of a message")
            self._filled += more
            if self._filled < len(body) and (self._waits or not self._rest_flags):
                self._rest_flags = self._how
                raise BlockingIOError
        self._rest_flags = 0

    def _greet(self) -> None:
        """Read the other side's greeting and READY. What is not all there yet is read again."""
        if not self._recognized:
            if len(self._data) < len(_GREETING):
                self._load()
            if len(self._data) < len(_GREETING):
                raise BlockingIOError
            theirs = self._data
            if theirs[0] != 0xFF or not theirs[9] & 1 or theirs[10] < 3 or theirs[12:32] != _GREETING[12:32]:
                raise Garbled("there is no ZMTP 3 without security")
            self._at, self._recognized = len(_GREETING), True
        self._loaded = False
        flags, ready = self._frame()
        if not flags & _COMMAND or ready[:6] != b"\5READY":
            raise Garbled("it was not ready")
        self._greeted = True

    def _command(self, body: bytes) -> None:
        name = body[1 : 1 + body[0]] if body else b""
        if name == b"PING":  # its time to live, in two octets, and what it wants to see again
            pong = b"\4PONG" + body[7:23]
            try:
                self._socket.send(_head(_COMMAND, len(pong)) + pong, _DONTWAIT)
            except BlockingIOError:
                pass  # then the heartbeat stays unanswered
            except OSError as exc:
                raise Gone(str(exc)) from exc
        elif name == b"ERROR":
            raise Garbled(body[7:].decode(errors="replace"))


class Stream(_Connection):
    """A connection to a server's socket, like that of a DEALER. Waits in slices.

    A caller that gives up must close it, since part of a message may have been sent.
    """

    _waits = True
    _how = 0

    def __init__(self, path: str, wait: Wait) -> None:
        """Connect. Raises OSError, and what `wait` raises."""
        super().__init__(b"DEALER")
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
            for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
                self._socket.setsockopt(socket.SOL_SOCKET, option, _TIMEOUT)
            _persist(partial(self._socket.connect, path), wait)  # it may be that too many wait there to be let in
            self._write([self._begin], wait)
            _persist(self._greet, wait)
        except BaseException:
            self._socket.close()
            raise

    def readable(self, seconds: float) -> bool:
        """Wait so long for something to receive."""
        if self._at < len(self._data):
            return True
        poller = select.poll()
        poller.register(self._socket, select.POLLIN)
        return bool(poller.poll(seconds * 1000))

    def send(self, frames: Frames, wait: Wait) -> None:
        """Send a message, of which nothing is copied; when this returns, the kernel has it. Raises Gone."""
        first = frames[0]
        if len(frames) > 1:
            self._write(_pieces(frames), wait)
            return
        message = _head(0, len(first)) + first
        try:
            sent = self._socket.send(message)
        except BlockingIOError:
            sent = 0
        except OSError as exc:
            raise Gone(str(exc)) from exc
        if sent < len(message):
            self._write([memoryview(message)[sent:]], wait)

    def _write(self, pieces: Sequence[Any], wait: Wait) -> None:
        left = [memoryview(piece).cast("B") for piece in pieces]
        while left:
            try:
                sent = self._socket.sendmsg(left)
            except BlockingIOError:
                wait()
                continue
            except OSError as exc:
                raise Gone(str(exc)) from exc
            while left and sent >= len(left[0]):
                sent -= len(left.pop(0))
            if sent:
                left[0] = left[0][sent:]


class Feed(_Connection):
    """A connection to a publisher, as a SUB has one. Hardly waits: `receive` raises BlockingIOError at once, or, in
    the middle of a large frame, after a moment."""

    def __init__(self, path: str, topics: Sequence[bytes]) -> None:
        """Connect, and subscribe to what begins so. Raises OSError."""
        super().__init__(b"SUB")
        self._topics = topics
        try:
            self._socket.setblocking(False)
            self._socket.connect(path)
            self._socket.setblocking(True)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _MOMENT)
            self._say(self._begin)
        except BaseException:
            self._socket.close()
            raise

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> Frames:
        if not self._greeted:
            self._greet()
            self._say(b"".join(_head(0, len(topic) + 1) + b"\1" + topic for topic in self._topics))
        return super().receive()

    def receive_whole(self, messages: list[Frames], most: int) -> bool:
        """Add to these, until there are so many, those of one frame that have been received altogether; if there is
        `more` then."""
        data, at = self._data, self._at
        while len(messages) < most and len(data) >= at + 2:
            if data[at] == 0:
                begin = at + 2
                end = begin + data[at + 1]
            elif data[at] == _LONG and len(data) >= at + 9:
                begin = at + 9
                end = begin + int.from_bytes(data[at + 1 : begin], "big")
            else:
                break
            if len(data) < end:
                break
            messages.append([data[begin:end]])
            at = end
        self._at = at
        return at < len(data)

    def _say(self, few: bytes) -> None:
        """So little that there is room for it in any new connection."""
        try:
            sent = self._socket.send(few, _DONTWAIT)
        except OSError as exc:
            raise Gone(str(exc)) from exc
        if sent < len(few):
            raise Gone("it takes nothing")


def _persist(act: Callable[[], object], wait: Wait) -> None:
    while True:
        try:
            act()
            return
        except BlockingIOError:
            wait()


def _head(flags: int, size: int) -> bytes:
    return _HEAD.pack(flags, size) if size < _SHORTEST_LONG else _LONG_HEAD.pack(flags | _LONG, size)


def _pieces(frames: Frames) -> list[Any]:
    """What is written for a message: its frames, each behind its head."""
    pieces: list[Any] = []
    for number, frame in enumerate(frames, 1):
        size = memoryview(frame).nbytes
        pieces += [_head(_MORE if number < len(frames) else 0, size), frame]
    return pieces
