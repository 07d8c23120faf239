"""Reads one subscription with a thread of its own, which also calls the sink, one message at a time.

Zenoh's threads put messages into a Zenoh channel, for which they do not need Python's global lock: they
never wait for Python code, and our thread takes many messages in a row. While a sink takes long, another
thread reads in its place. So messages are counted when they arrive; if the queue is full, the oldest are
dropped (lossy) or the new ones held back (reliable).
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

import zenoh

from ...errors import TransportError
from ...threads import NO_THREAD, start_thread
from ..base import Sink, Statistics, receives
from ..leader_followers import STUCK, belongs
from ..limits import BYTES_WAITING, MOST_AHEAD

log = logging.getLogger("robocomp.transport.zenoh")

Admit = Callable[[Any], Any]
"""Returns the payload of an arrived message, in Zenoh's own type, or None if the message is not to be delivered."""

LOSSY_LEAST, LOSSY_TIMES = 4096, 8
"""A lossy channel holds `LOSSY_TIMES` the depth, and at least `LOSSY_LEAST` messages; then it drops the oldest."""

STALE = 0.01
"""Seconds without reading, because of a slow sink, after which messages beyond the depth are dropped."""

RELIABLE_SENDERS = 16
"""A reliable channel has room for the unacknowledged messages of this many senders, however slow the sink is."""


class Reader:
    """`admit` is called for each message, in order and by one thread at a time; it must not wait."""

    def __init__(self, name: str, admit: Admit, sink: Sink, depth: int, *, lossy: bool, stats: Statistics) -> None:
        self._name, self._admit, self._sink, self._stats = name, admit, sink, stats
        self._depth, self._lossy = depth, lossy
        self._holds = max(LOSSY_LEAST, LOSSY_TIMES * depth) if lossy else RELIABLE_SENDERS * MOST_AHEAD
        self._swept = 0.0
        self.lock = threading.Lock()
        self._changed = threading.Condition(self.lock)
        self._waiting: deque[Any] = deque()
        self._turn: threading.Thread | None = None
        """The thread that reads."""
        self._drainer = 0
        """The id of the thread that calls the sink, or 0."""
        self._delivered = self._seen = 0
        self._closed = False
        self.waits = True
        """Set by `admit`: hold the present message back until there is room; its sender waits for that."""
        self.must_settle = False
        """Set by `admit`: call `settle` after the present message."""
        self.settle: Callable[[], object] = _nothing

    def wrap_sink(self, wrap: Callable[[Sink], Sink]) -> None:
        """Wrap the sink."""
        self._sink = wrap(self._sink)

    def channel(self) -> Any:
        """A Zenoh channel for the subscription."""
        return zenoh.handlers.RingChannel(self._holds)

    def start(self, handler: zenoh.Handler[Any]) -> None:
        """Begin to read the channel, until its `recv` raises ZError because the subscription has ended."""
        self._receive, self._receive_now = handler.recv, handler.try_recv
        with self.lock:
            started = self._start_thread()
        if not started:
            raise TransportError(f"{self._name}: {NO_THREAD}")

    def feed(self, messages: Callable[[], Iterable[Any]]) -> None:
        """Admit and deliver these before all unread messages. None of them is held back."""
        with self.lock:
            for message in messages():
                payload = self._admit(message)
                if payload is not None:
                    self._append(payload)
            payload = None
            if self._waiting and not self._drainer and not self._closed:
                self._drainer, payload = threading.get_ident(), self._waiting.popleft()
        self._continue(payload)

    def replace_if_slow(self) -> bool:
        """Have another thread read if the reading one has been in the sink since the previous call.

        To be called regularly. Returns whether a thread is in the sink.
        """
        seen, self._seen = self._seen, self._delivered
        if seen == self._delivered:
            self._replace(self._drainer)
        return self._drainer != 0

    def close(self) -> None:
        """Drop waiting messages. After this returns, the sink is not called again."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()
            me = threading.get_ident()
            if not self._changed.wait_for(lambda: self._drainer in (0, me), STUCK):
                log.warning("%s: still in a handler after %g s; not waiting any longer", self._name, STUCK)
            stuck = self._drainer
        turn = self._turn
        if turn and turn.ident not in (me, stuck):
            turn.join(STUCK)

    def _about_to_block(self) -> None:
        self._replace(threading.get_ident())

    def _replace(self, reading: int) -> None:
        """Have another thread read if the given thread reads and is in the sink."""
        with self.lock:
            turn = self._turn
            if turn is not None and turn.ident == reading == self._drainer and not self._closed:
                self._start_thread()

    def _start_thread(self) -> bool:
        """Start a reading thread; call it with the lock. If that fails, the present thread reads on after its sink."""
        thread = threading.Thread(target=self._read, name=f"zenoh {self._name}", daemon=False)
        belongs(thread)
        started = start_thread(thread)
        if started:
            self._turn = thread
        return started

    def _read(self) -> None:
        receives(self._about_to_block)
        with self.lock:
            pass  # wait until `_start_thread` has set `_turn`
        me, receive = threading.current_thread(), self._receive
        with contextlib.suppress(zenoh.ZError):  # the subscription has ended
            while self._turn is me and not self._closed:
                message = receive()
                try:
                    self._arrive(message)
                    if self._lossy and self._turn is me and time.monotonic() - self._swept > STALE:
                        self._sweep()
                except Exception:  # this thread must not end: it is the only one that reads
                    log.exception("%s: a message was not taken", self._name)

    def _arrive(self, message: Any) -> None:
        with self.lock:
            payload = self._admit(message)
            if payload is not None:
                if self._drainer and not self._lossy:
                    if self.waits:
                        self._changed.wait_for(self._has_room)
                    elif self._is_too_much(len(message.payload)):
                        self._stats.dropped += 1
                        return
                if self._drainer:
                    self._append(payload)
                    payload = None
                else:
                    self._drainer = threading.get_ident()
        self._continue(payload)

    def _sweep(self) -> None:
        """Read all messages that arrived while the sink ran, or shortly before."""
        self._swept = time.monotonic()
        self.feed(self._unread)

    def _unread(self) -> Iterator[Any]:
        with contextlib.suppress(zenoh.ZError):  # the subscription has ended
            yield from islice(iter(self._receive_now, None), self._holds)

    def _continue(self, payload: Any) -> None:
        if payload is not None:
            self._drain(payload)
        if self.must_settle:
            self._settle()

    def _has_room(self) -> bool:
        return len(self._waiting) < self._depth or not self._drainer or self._closed

    def _is_too_much(self, size: int) -> bool:
        """Whether too many messages wait; assumes that all messages of a topic have about this size."""
        beyond = len(self._waiting) - self._depth
        return beyond >= MOST_AHEAD or beyond * size >= BYTES_WAITING

    def _append(self, payload: Any) -> None:
        if self._lossy and len(self._waiting) >= self._depth:
            self._waiting.popleft()
            self._stats.dropped += 1
        self._waiting.append(payload)

    def _drain(self, payload: Any) -> None:
        """Deliver this payload and those that wait; on the reading thread, also those that can be read at once."""
        me, waiting, stats = threading.current_thread(), self._waiting, self._stats
        while not self._closed:
            stats.received += 1
            try:
                self._sink(payload)
            except BaseException:  # also SystemExit: later messages must still be delivered
                log.exception("%s: a message was not handled", self._name)
            if self.must_settle:
                self._settle()
            with self.lock:
                self._delivered += 1
                mine = self._turn is me and not self._closed
                if not mine:
                    self._changed.notify_all()
                payload = waiting.popleft() if waiting else self._next() if mine else None
                if payload is None:
                    self._drainer = 0
                    return
        with self._changed:
            self._drainer = 0
            self._changed.notify_all()

    def _next(self) -> Any:
        """The payload of the next message, if it has arrived; None if it is time to `_sweep`."""
        if self._lossy and time.monotonic() - self._swept > STALE:
            return None
        try:
            message = self._receive_now()
            return None if message is None else self._admit(message)
        except zenoh.ZError:  # the subscription has ended
            return None
        except Exception:  # the turn must end properly, or no other thread would get one
            log.exception("%s: a message was not taken", self._name)
            return None

    def _settle(self) -> None:
        self.must_settle = False
        self.settle()


def _nothing() -> None: ...
