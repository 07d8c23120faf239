"""Sockets that several threads may use, and the loop that waits for all of them."""

from __future__ import annotations

import contextlib
import logging
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import zmq
from zmq.utils import garbage

from ...wire.codec import MAX_BYTES
from ..border import translating
from ..leader_followers import Job
from ..unsafe import keep
from .curve import Secure
from .frames import Frames
from .zmtp import Gone

if TYPE_CHECKING:
    from .guard import Watched

log = logging.getLogger("robocomp.transport.zeromq")

keep(garbage.gc)
"""pyzmq ends this object's thread at the end of the program. Its destructor tries again while the interpreter deletes
its modules, and fails (`NameError: getpid`). This reference keeps the destructor from running; it has nothing to do."""

LINGER_MS = 500
"""Milliseconds that closing may wait until the last messages are sent."""

_SHORT = 16 * 1024
"""Frames with fewer bytes are copied, which is faster; larger ones are passed on as views of the frame."""

_LARGE = 2 * 1024 * 1024
"""Frames of this length and more are sent without a copy."""

LONGEST_PAUSE = 0.005
"""Seconds between two attempts to send, when there is no room."""

_SHORT_PAUSE, _SHORTLY = 0.0005, 0.1
"""The pause at first, since a fast subscriber makes room within milliseconds; and how long it applies, in seconds."""

# Plain numbers: an operation on the enumerations of the library takes as long as sending a frame.
_NOBLOCK, _SNDMORE, _POLLIN, _EVENTS = int(zmq.NOBLOCK), int(zmq.SNDMORE), int(zmq.POLLIN), int(zmq.EVENTS)


def new_socket(context: zmq.Context[Any], kind: int, secure: Secure | None = None, **options: int) -> zmq.Socket[Any]:
    """Open a socket; all sockets are opened here. `secure` is for those that other users can reach."""
    with as_transport_error("opening a socket"):
        socket: zmq.Socket[Any] = context.socket(kind)
        try:
            settings = {"LINGER": LINGER_MS, "MAXMSGSIZE": MAX_BYTES + 65536, "HANDSHAKE_IVL": 2000} | options
            for name, value in settings.items():
                socket.setsockopt(getattr(zmq, name), value)
            if secure:
                secure(socket)
        except BaseException:
            socket.close()
            raise
        return socket


def _reason(exc: zmq.ZMQError) -> str:
    in_use = "the address is in use by another program: end it, or choose another port"
    return in_use if exc.errno == zmq.EADDRINUSE else str(exc)


as_transport_error = translating("zeromq", zmq.ZMQError, _reason)


_send: Callable[[zmq.Socket[Any], Any, int], object] = zmq.backend.Socket.send
"""The core of `Socket.send`, without checks for kinds of sockets that are not used here."""


def send_frames(socket: zmq.Socket[Any], frames: Frames, flags: int = 0) -> None:
    """What `send_multipart` does, in a third of the time."""
    if len(frames) > 1:
        more = flags | _SNDMORE
        for frame in frames[:-1]:
            _send(socket, frame, more)
    _send(socket, frames[-1], flags)


def lend_frames(socket: zmq.Socket[Any], frames: Frames, flags: int) -> None:
    """The same without copying large frames, which must not change afterwards.

    A small frame is faster to copy than to track: a thread of pyzmq finds out when ZeroMQ no longer needs it.
    """
    last = len(frames) - 1
    for number, frame in enumerate(frames):
        how = flags if number == last else flags | _SNDMORE
        if len(frame) < _LARGE:
            _send(socket, frame, how)
        else:
            socket.send(frame, how, copy=False)


def receive_frames(socket: zmq.Socket[Any], flags: int = 0) -> Frames:
    """What `recv_multipart` does, in half the time: a frame knows whether more follow it, without asking the socket."""
    frame = socket.recv(flags, copy=False)
    frames: Frames = [frame.bytes]
    while frame.more:
        frame = socket.recv(flags, copy=False)
        frames.append(frame.bytes if len(frame) < _SHORT else _memory(frame))
    return frames


def _memory(frame: zmq.Frame) -> memoryview:
    """A view of a received frame. It never changes, so it may be sent on without a copy."""
    object.__setattr__(frame, "frozen", True)  # for `is_frozen`; frames take other attributes for options
    return frame.buffer.toreadonly()


def receive_watched(socket: zmq.Socket[Any], watched: Watched, signed: bool) -> tuple[str, Frames]:
    """The same for a watched socket; if `signed`, with the user that sent the message, as named by `curve.Gate`."""
    frame = socket.recv(0, copy=False)
    frames: Frames = [frame.bytes]
    while frame.more:
        frame = socket.recv(0, copy=False)
        frames.append(frame.bytes if len(frame) < _SHORT else _memory(frame))
    watched.took(frames, frame)
    if not signed:
        return "", frames
    try:
        return str(frame.get("User-Id")), frames
    except zmq.ZMQError:
        return "", frames


class Socket:
    """A ZeroMQ socket that several threads may use, because nothing here waits.

    Its file descriptor reports input only once, and any use of the socket may consume that report.
    So a thread that has sent something checks for input and has the loop handle it. A thread that
    receives continues until no input is left, or has the loop handle the rest.
    """

    def __init__(
        self, raw: zmq.Socket[Any], on_input: Callable[[Socket], list[Job]], attend: Callable[[Socket], None]
    ) -> None:
        self.lock = threading.RLock()
        self.fileno = int(raw.FD)
        self.raw = raw
        self.closed = False
        self.awaited = False
        """Whether the loop is going to look at it."""
        self.on_input = on_input
        self.watched: Watched | None = None
        """What a guard knows of its connections, if they lead to other hosts."""
        self._attend = attend

    def send(self, frames: Frames) -> bool:
        """Send; False if there is no room now, or no peer is connected."""
        with self.lock:
            sent = self.send_only(frames)
            if not self.closed:
                self._look()
            return sent

    def send_only(self, frames: Frames) -> bool:
        """The same in half the time, without a check for input: for callers that check themselves."""
        self.lock.acquire()  # half of what `with` takes
        try:
            if self.closed:
                return False
            if len(frames) == 1:
                _send(self.raw, frames[0], _NOBLOCK)
            else:
                send_frames(self.raw, frames, _NOBLOCK)
            return True
        except zmq.Again:
            return self._send_once_more(frames)
        finally:
            self.lock.release()

    def send_to_some(self, frames: Frames) -> bool:
        """Send by a publisher's socket; subscribers without room miss the message. False if it is closed."""
        with self.lock:
            if self.closed:
                return False
            self.raw.set(zmq.XPUB_NODROP, 0)
            try:
                return self.send_only(frames)
            finally:
                self.raw.set(zmq.XPUB_NODROP, 1)

    def _send_once_more(self, frames: Frames) -> bool:
        """Try again: the library notices room after a check for input, but only once per millisecond when sending."""
        self._look()
        try:
            send_frames(self.raw, frames, _NOBLOCK)
        except zmq.Again:
            return False
        return True

    def receive(self) -> Frames | None:
        with self.lock:
            if self.closed:
                return None
            try:
                frames = receive_frames(self.raw, _NOBLOCK)
            except zmq.Again:
                return None
            if self.watched:
                self.watched.took(frames)
            return frames

    def receive_subscription(self) -> zmq.Frame | None:
        """The next message of a publisher's socket: a topic, and whether its subscription begins or ends."""
        with self.lock:
            try:
                return None if self.closed else self.raw.recv(_NOBLOCK, copy=False)
            except zmq.Again:
                return None

    def look(self) -> None:
        """Have the loop handle its input, if there is any."""
        with self.lock:
            if not self.closed:
                self._look()

    def _look(self) -> None:
        if not self.awaited and int(self.raw.get(_EVENTS)) & _POLLIN:
            self._attend(self)

    def close(self) -> None:
        with self.lock:
            if not self.closed:
                self.closed = True
                self.raw.close()


class Feeding(Protocol):
    """Receives the messages of a publisher without waiting: `zmtp.Feed` on this host, `remote.FarFeed` by TCP."""

    def fileno(self) -> int: ...

    def receive(self) -> Frames:
        """Raises BlockingIOError if there is nothing, and may raise Gone."""
        ...

    def receive_whole(self, messages: list[Frames], most: int) -> bool:
        """Add messages that have been read already, up to `most`; whether there may be more."""
        ...

    def close(self) -> None: ...


class Subscription:
    """A feed that the loop handles like a socket. A thread may close it while another one receives."""

    def __init__(self, feed: Feeding, on_input: Callable[[Subscription], list[Job]]) -> None:
        self.lock = threading.RLock()
        self.fileno = feed.fileno()
        self.closed = False
        self.awaited = False
        self.more = False
        """Whether another message may be ready. If not, the loop reports the next one."""
        self.active = False
        """Whether a message has come since this was set to False."""
        self.on_input: Callable[[Any], list[Job]] = on_input
        self._feed, self._receive = feed, feed.receive

    def receive(self, most: int) -> list[Frames]:
        """The messages that are ready, at most `most`; sets `more`. Raises Gone if the publisher is gone."""
        messages: list[Frames] = []
        self.more, self.active = False, True
        with self.lock:
            try:
                while not self.closed and len(messages) < most:
                    messages.append(self._receive())
                    if not self._feed.receive_whole(messages, most):
                        return messages
                self.more = not self.closed
            except BlockingIOError:
                pass  # part of a message may be there
            except Gone:
                if not messages:
                    raise
                self.more = True  # so that the next call raises it
        return messages

    def look(self) -> None:
        """Nothing to do: its descriptor reports input as long as there is some."""

    def close(self) -> None:
        with self.lock:
            if not self.closed:
                self.closed = True
                self._feed.close()


class Attended(Protocol):
    """A socket or feed of a loop."""

    fileno: int
    awaited: bool

    @property
    def on_input(self) -> Callable[[Any], list[Job]]: ...

    def look(self) -> None: ...

    def close(self) -> None: ...


class Loop:
    """Waits for input on all sockets at once, and for what is due. `receive` is for one thread at a time."""

    def __init__(self, tick: Callable[[], float]) -> None:
        self._tick = tick
        self._poller = select.poll()
        self._sockets: dict[int, Attended] = {}
        self._ready: deque[Attended] = deque()
        self._resting: dict[Socket, tuple[float, bool]] = {}
        """Sockets that are ignored for a while: until when, and whether they were watched."""
        self._jobs: deque[Job] = deque()
        self._next_tick = self._ticked = 0.0
        self._due = False
        self._sleeping = False
        self._closed = False
        self._pipe = threading.Lock()
        self._wake_out, self._wake_in = os.pipe()
        os.set_blocking(self._wake_out, False)
        os.set_blocking(self._wake_in, False)
        self._poller.register(self._wake_out, select.POLLIN)

    def add(self, socket: Attended, *, watched: bool = True, first: bool = False) -> None:
        """Handle input of a socket. If not `watched`: now, and whenever `attend` is called. `first`: see `attend`."""
        self._sockets[socket.fileno] = socket
        if watched:
            self._poller.register(socket.fileno, select.POLLIN)
        self.attend(socket, first=first)

    def remove(self, socket: Attended) -> None:
        self.mute(socket)
        self.wake()

    def sockets(self) -> list[Attended]:
        return list(self._sockets.values())

    def mute(self, socket: Attended) -> None:
        """Ignore its input until it is added again."""
        if self._sockets.get(socket.fileno) is socket:
            del self._sockets[socket.fileno]
            self._unregister(socket)

    def rest(self, socket: Socket, seconds: float) -> None:
        """Ignore its input for that time. Called from `on_input` only."""
        with socket.lock:
            if not socket.closed:
                self._resting[socket] = time.monotonic() + seconds, self._unregister(socket)

    def attend(self, socket: Attended, *, first: bool = False) -> None:
        """Handle this socket next, even if its file descriptor reports no input; `first`: before the other ones."""
        if socket.awaited:  # it has its turn; further ones would add up, at the expense of others
            return
        socket.awaited = True
        (self._ready.appendleft if first else self._ready.append)(socket)
        if self._sleeping:
            self._interrupt()

    def do(self, job: Job) -> None:
        """Return this job from the next `receive`."""
        self._jobs.append(job)
        if self._sleeping:
            self._interrupt()

    def wake(self) -> None:
        """Tick now: something became due earlier, or a socket came or went."""
        self._due = True
        self._interrupt()

    def within(self, seconds: float) -> None:
        """Tick that long after the last tick, to handle frequent events together. Called from `on_input` only."""
        self._next_tick = min(self._next_tick, self._ticked + seconds)

    def receive(self) -> list[Job]:
        if self._due or time.monotonic() >= self._next_tick:
            self._due = False  # before the tick, which may miss what becomes due later
            self._next_tick = time.monotonic() + self._tick()
            self._ticked = time.monotonic()
        end = self._end_rests() if self._resting else self._next_tick
        self._sleeping = (
            True  # before checking what is ready: a thread that adds to it later sees this and wakes the loop
        )
        busy = self._ready or self._jobs or self._due
        timeout = 0.0 if busy else max(0.0, end - time.monotonic())
        events = self._poller.poll(timeout * 1000)
        self._sleeping = False
        for descriptor, _ in events:
            if descriptor == self._wake_out:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._wake_out, 4096)
            elif (socket := self._sockets.get(descriptor)) and not socket.awaited:
                socket.awaited = True
                self._ready.append(socket)
        for _ in range(len(self._ready)):
            socket = self._ready.popleft()
            socket.awaited = False
            try:
                self._jobs.extend(socket.on_input(socket))
            except Exception:
                log.exception("taking input")  # only of this socket
                socket.look()
        return [self._jobs.popleft() for _ in range(len(self._jobs))]

    def close(self) -> None:
        with self._pipe:
            self._closed = True
            os.close(self._wake_out)
            os.close(self._wake_in)

    def _end_rests(self) -> float:
        """Handle sockets again after their rest; returns when the next rest or the next tick is due."""
        for socket, (end, watched) in list(self._resting.items()):
            if end <= time.monotonic():
                del self._resting[socket]
                with socket.lock:
                    if not socket.closed:
                        self.add(socket, watched=watched)
        return min([self._next_tick, *(end for end, _ in self._resting.values())])

    def _unregister(self, socket: Attended) -> bool:
        """Whether it was watched."""
        try:
            self._poller.unregister(socket.fileno)
        except KeyError:
            return False
        return True

    def _interrupt(self) -> None:
        with self._pipe:  # a stuck handler may call this after closing
            if not self._closed:
                with contextlib.suppress(BlockingIOError):  # the pipe is full, so the loop will wake
                    os.write(self._wake_in, b"!")
