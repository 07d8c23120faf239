"""One subscription: read by a thread of its own, which also gives the sink its messages, one at a time.

Zenoh's threads leave messages in a channel of Zenoh's, for which they need nothing of Python's: no
thread of theirs waits while ours compute, and ours takes many in a row. While a sink takes long,
another thread reads in place of the first one, so that messages are counted when they come in and
that those for which there is no room are given up, the oldest first, or held back.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
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
"""What is to be delivered of a message that came in, its payload as Zenoh has it, or None."""

AT_LEAST, TIMES = 4096, 8
"""If lossy, the channel holds so many messages at least, and so many times the depth; then it gives up the oldest."""

STALE = 0.01
"""Seconds that a sink may keep the channel from being read until what waits there beyond the depth is given up."""

SENDERS = 16
"""If it is not lossy, it holds all that so many senders may be ahead, however slow the sink is."""


class Reader:
    """`admit` is called for each message, in their order and by one thread at a time; it must not wait."""

    def __init__(self, name: str, admit: Admit, sink: Sink, depth: int, *, lossy: bool, stats: Statistics) -> None:
        self._name, self._admit, self._sink, self._stats = name, admit, sink, stats
        self._depth, self._lossy = depth, lossy
        self._holds = max(AT_LEAST, TIMES * depth) if lossy else SENDERS * MOST_AHEAD
        self._swept = 0.0
        self.lock = threading.Lock()
        self._changed = threading.Condition(self.lock)
        self._waiting: deque[Any] = deque()
        self._turn: threading.Thread | None = None
        """The thread that reads."""
        self._drainer = 0
        """The thread that gives the sink what waits, if there is one."""
        self._delivered = self._seen = 0
        self._closed = False
        self.waits = True
        """Whether the present message is held back until there is room, as its sender waits for us; set by `admit`."""
        self.owing = False
        """Whether `settle` is to be called after the present message; set by `admit`."""
        self.settle: Callable[[], object] = _nothing

    def through(self, wrap: Callable[[Sink], Sink]) -> None:
        """Put something in front of the sink."""
        self._sink = wrap(self._sink)

    def channel(self) -> Any:
        """What Zenoh is to put messages into."""
        return zenoh.handlers.RingChannel(self._holds)

    def start(self, handler: zenoh.Handler[Any]) -> None:
        """Begin to read the channel; `recv` raises ZError when nothing will come any more."""
        self._receive, self._receive_now = handler.recv, handler.try_recv
        with self.lock:
            started = self._hire()
        if not started:
            raise TransportError(f"{self._name}: {NO_THREAD}")

    def feed(self, messages: Callable[[], Iterable[Any]]) -> None:
        """Have these admitted and delivered before all that has not been read yet. None is held back."""
        with self.lock:
            for message in messages():
                payload = self._admit(message)
                if payload is not None:
                    self._append(payload)
            payload = None
            if self._waiting and not self._drainer and not self._closed:
                self._drainer, payload = threading.get_ident(), self._waiting.popleft()
        self._go_on(payload)

    def relieve(self) -> bool:
        """Now and then: if the thread that reads is in the sink since the last time, have another one read.

        Whether it is in the sink.
        """
        seen, self._seen = self._seen, self._delivered
        if seen == self._delivered:
            self._replace(self._drainer)
        return self._drainer != 0

    def close(self) -> None:
        """Forget what waits. The sink is not called any more once this returns."""
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
        """Have another thread read, if the one that does is this one, and is in the sink."""
        with self.lock:
            turn = self._turn
            if turn is not None and turn.ident == reading == self._drainer and not self._closed:
                self._hire()

    def _hire(self) -> bool:
        """With the lock. If no thread can be started, the present one goes on reading after its sink."""
        thread = threading.Thread(target=self._read, name=f"zenoh {self._name}")
        belongs(thread)
        started = start_thread(thread)
        if started:
            self._turn = thread
        return started

    def _read(self) -> None:
        receives(self._about_to_block)
        with self.lock:
            pass  # `_hire` has said whose turn it is
        me, receive = threading.current_thread(), self._receive
        with contextlib.suppress(zenoh.ZError):  # the subscription has ended
            while self._turn is me and not self._closed:
                message = receive()
                try:
                    self._arrive(message)
                    if self._lossy and self._turn is me and time.monotonic() - self._swept > STALE:
                        self._sweep()
                except Exception:  # if this thread ended, nobody would read any more
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
        self._go_on(payload)

    def _sweep(self) -> None:
        """Read all that is there. It came while the sink ran, or shortly before."""
        self._swept = time.monotonic()
        self.feed(lambda: islice(iter(self._receive_now, None), self._holds))

    def _go_on(self, payload: Any) -> None:
        if payload is not None:
            self._drain(payload)
        if self.owing:
            self._settle()

    def _has_room(self) -> bool:
        return len(self._waiting) < self._depth or not self._drainer or self._closed

    def _is_too_much(self, size: int) -> bool:
        """Whether more of that size waits than may; those of one topic are alike."""
        beyond = len(self._waiting) - self._depth
        return beyond >= MOST_AHEAD or beyond * size >= BYTES_WAITING

    def _append(self, payload: Any) -> None:
        if self._lossy and len(self._waiting) >= self._depth:
            self._waiting.popleft()
            self._stats.dropped += 1
        self._waiting.append(payload)

    def _drain(self, payload: Any) -> None:
        """Deliver this, what others have read meanwhile, and what can be read at once if this is the thread to read."""
        me, waiting, stats = threading.current_thread(), self._waiting, self._stats
        while not self._closed:
            stats.received += 1
            try:
                self._sink(payload)
            except BaseException:  # also SystemExit: the messages that follow are to be delivered all the same
                log.exception("%s: a message was not handled", self._name)
            if self.owing:
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
        """The next message's payload, if it is there already; nothing, if it is time to `_sweep`."""
        if self._lossy and time.monotonic() - self._swept > STALE:
            return None
        try:
            message = self._receive_now()
            return None if message is None else self._admit(message)
        except zenoh.ZError:  # the subscription has ended
            return None
        except Exception:  # if this one's turn did not end properly, nobody else would get one
            log.exception("%s: a message was not taken", self._name)
            return None

    def _settle(self) -> None:
        self.owing = False
        self.settle()


def _nothing() -> None: ...
