"""Listens to topics of a running network, at no cost of its publishers."""

from __future__ import annotations

import contextlib
import math
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from types import FrameType
from typing import Any, NamedTuple

from ..errors import DecodeError
from ..threads import start_thread
from ..transports.base import Heard, SupportsSources
from ..wire import json
from ..wire.codec import Decoder, Payload
from .access import Access, Subscription
from .far import Far, FarArrivals
from .far import Message as Message
from .network import Channel
from .posts import Post
from .traffic import Arrival

DEPTH = 100
"""Messages of a topic that may wait to be printed."""

OCTETS = 64 * 1024 * 1024
"""Octets of all messages that may wait."""

ARRIVALS = 100_000
"""Arrivals of messages that may wait to be counted."""

_LOOK = 0.1
"""Seconds between two looks at the clock and at signals."""

_FAR = 64 * 1024
"""Octets that a message which a scout has decoded counts for."""


class Presence(NamedTuple):
    """A topic has lost its last publisher, or has got one again."""

    channel: str
    is_published: bool


class Resumed(NamedTuple):
    """This process went on after the user had stopped it. Until then it had no subscriptions."""

    at: float
    """`time.monotonic()`."""


class _Arrived(NamedTuple):
    time: float
    channel: str
    heard: Heard | Message
    """A message if a scout has decoded it."""
    octets: int


class Inbox:
    """Messages that wait, bounded in number and octets. It never holds up the thread that receives."""

    def __init__(self, most: int) -> None:
        self._waiting: queue.Queue[_Arrived] = queue.Queue(most)
        self._lock = threading.Lock()
        self._octets = 0
        self._dropped = 0

    def put(self, channel: str, heard: Heard | Message) -> None:
        size = _FAR if isinstance(heard, Message) else octets_of(heard.payload)
        with self._lock:
            if isinstance(heard, Message):
                self._dropped += heard.dropped
            if self._octets + size <= OCTETS or not self._octets:
                with contextlib.suppress(queue.Full):
                    self._waiting.put_nowait(_Arrived(time.time(), channel, heard, size))
                    self._octets += size
                    return
            self._dropped += 1

    def miss(self, number: int) -> None:
        """Some messages were lost on their way here."""
        with self._lock:
            self._dropped += number

    def get(self, timeout: float) -> tuple[_Arrived, int] | None:
        """The next message, and the number of messages dropped since the last one; None if no message comes in time."""
        try:
            arrived = self._waiting.get(timeout=timeout)
        except queue.Empty:
            return None
        with self._lock:
            self._octets -= arrived.octets
            dropped, self._dropped = self._dropped, 0
        return arrived, dropped


def tapped(
    topics: Sequence[Channel], *, first: float, whole: float | None, full: bool = True
) -> Generator[Message | Presence, None, None]:
    """The messages of these topics, for `whole` seconds or for ever; none if the `first` one does not come in time.

    Whether topics are published is noticed while no message comes. Unless `full`, messages from other hosts may be
    shortened.
    """
    inbox, span = Inbox(DEPTH * len(topics)), Span(first, whole)
    decoders: dict[str, Decoder] = {}
    published = dict.fromkeys((each.name for each in topics), False)
    lost: set[str] = set()

    def resumed() -> None:
        published.update(dict.fromkeys(published, False))  # new subscriptions find their publishers anew

    subscriptions = _Subscriptions(topics, inbox.put, decoders, resumed, far=Far(inbox.put, inbox.miss, full))
    with _listening(subscriptions) as check:
        while span.goes_on():
            check()
            if found := inbox.get(_LOOK):
                span.heard = True
                arrived, dropped = found
                published[arrived.channel] = True
                yield _message(topics, decoders, arrived, dropped)
                continue
            for channel, is_published in subscriptions.presences():
                if published[channel] and not is_published:
                    lost.add(channel)
                    yield Presence(channel, False)
                elif is_published and channel in lost:
                    lost.remove(channel)
                    yield Presence(channel, True)
                published[channel] = is_published


class Tap:
    """Messages of topics, for one thread to take."""

    def __init__(
        self,
        topics: Sequence[Channel],
        inbox: Inbox,
        decoders: dict[str, Decoder],
        check: Callable[[], None],
        presences: Callable[[], list[tuple[str, bool]]],
    ) -> None:
        self._topics, self._inbox, self._decoders, self._check = topics, inbox, decoders, check
        self.presences = presences
        """Tells the topics, and whether something publishes them now, as far as their middleware can tell."""

    def take(self, timeout: float) -> Message | None:
        """The next message; None if none comes in time. Raises what has gone wrong with the subscriptions."""
        self._check()
        found = self._inbox.get(timeout)
        return _message(self._topics, self._decoders, *found) if found else None


@contextlib.contextmanager
def tap(topics: Sequence[Channel]) -> Iterator[Tap]:
    """Listen to these topics until the end."""
    inbox, decoders = Inbox(DEPTH * len(topics)), dict[str, Decoder]()
    subscriptions = _Subscriptions(topics, inbox.put, decoders, far=Far(inbox.put, inbox.miss))
    with _listening(subscriptions) as check:
        yield Tap(topics, inbox, decoders, check, subscriptions.presences)


def arrivals(topics: Sequence[Channel], *, first: float, whole: float | None) -> Iterator[Arrival | Resumed | None]:
    """The arrivals of new messages, as long as `tapped`; None whenever a while passes without one.

    While the caller does not take them, at most `ARRIVALS` wait; further ones are not counted.
    """
    waiting: queue.SimpleQueue[Arrival | Resumed] = queue.SimpleQueue()
    span = Span(first, whole)

    def put(arrival: Arrival) -> None:
        if waiting.qsize() < ARRIVALS:
            waiting.put(arrival)

    def note(channel: str, heard: Heard) -> None:
        if waiting.qsize() < ARRIVALS:
            age = (time.time_ns() - heard.stamp) / 1e9 if heard.stamp else math.nan
            size = octets_of(heard.payload)
            waiting.put(Arrival(channel, time.monotonic(), size, heard.source, heard.sequence, age))

    def resumed() -> None:
        waiting.put(Resumed(time.monotonic()))  # these are as many as a user types

    with _listening(_Subscriptions(topics, note, {}, resumed, latched=False, far=FarArrivals(put))) as check:
        while span.goes_on():
            check()
            try:
                arrival = waiting.get(timeout=_LOOK)
            except queue.Empty:
                yield None
            else:
                span.heard = span.heard or isinstance(arrival, Arrival)
                yield arrival


class Span:
    """How long to listen: `whole` seconds, or for ever unless nothing is heard in the `first` seconds."""

    def __init__(self, first: float, whole: float | None) -> None:
        self._end = time.monotonic() + (whole or first)
        self._is_endless = whole is None
        self.heard = False

    def goes_on(self) -> bool:
        return (self._is_endless and self.heard) or time.monotonic() < self._end


@contextlib.contextmanager
def _listening(subscriptions: _Subscriptions) -> Iterator[Callable[[], None]]:
    """Open subscriptions until the end. The yielded function raises what has gone wrong with them meanwhile.

    When the user stops this process (Ctrl-Z), it first closes them: otherwise publishers could have to wait for it. A
    thread does so, because the main thread may be writing to a pipe that takes nothing.
    """
    in_main = threading.current_thread() is threading.main_thread()
    try:
        before = signal.signal(signal.SIGTSTP, subscriptions.stop) if in_main else None
        subscriptions.open()
        yield subscriptions.check
    finally:
        subscriptions.close()
        if in_main:
            signal.signal(signal.SIGTSTP, before or signal.SIG_DFL)


class _Subscriptions:
    def __init__(
        self,
        topics: Sequence[Channel],
        take: Callable[[str, Heard], None],
        decoders: dict[str, Decoder],
        resumed: Callable[[], None] = lambda: None,
        *,
        far: Far | FarArrivals,
        latched: bool = True,
    ) -> None:
        """`take` gets the name of a channel and a message; unless `latched`, only those that are sent from now on.

        `resumed` is called when this process goes on after a stop, before the first message. `far` takes what is heard
        on other hosts.
        """
        self._topics = [each for each in topics if each.via is None]
        self._take, self._decoders, self._resumed = take, decoders, resumed
        self._latched, self._far = latched, far
        self._posts: dict[Post, list[Channel]] = {}
        for each in topics:
            if each.via:
                self._posts.setdefault(each.via, []).append(each)
        self._following = contextlib.ExitStack()
        self._access: Access | None = None
        self._links: dict[str, Subscription] = {}
        self._wanted: queue.SimpleQueue[None] = queue.SimpleQueue()
        """Gets an item when this process is to stop, or the subscriptions are to end.

        No `threading.Event`: a signal handler that sets one waits for ever if its thread was just setting it.
        """
        self._is_over = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._pause, name="pause", daemon=True)

    def open(self) -> None:
        self._listen()
        start_thread(self._thread)

    def stop(self, number: int, frame: FrameType | None) -> None:
        """The handler of a signal."""
        self._wanted.put(None)

    def check(self) -> None:
        if error := self._error or self._far.error:
            raise error

    def presences(self) -> list[tuple[str, bool]]:
        """The topics, and whether something publishes them now, as far as their middleware can tell."""
        links = self._links
        found = [
            (name, bool(link.sources())) for name, link in list(links.items()) if isinstance(link, SupportsSources)
        ]
        return (found if links is self._links else []) + self._far.presences()  # they may have been closed meanwhile

    def close(self) -> None:
        self._is_over = True
        self._wanted.put(None)
        if self._thread.ident:
            self._thread.join()
        self._silence()

    def _pause(self) -> None:
        while True:
            self._wanted.get()
            while not self._wanted.empty():  # several signals stop it once
                self._wanted.get()
            if self._is_over:
                return
            self._silence()
            os.kill(os.getpid(), signal.SIGSTOP)
            self._resumed()
            try:
                self._listen()
            except Exception as exc:  # for `check`
                self._error = exc
                return

    def _listen(self) -> None:
        self._access = access = Access()
        for topic in self._topics:
            sink = partial(self._take, topic.name)
            heard = access.hear(topic, sink, DEPTH, headed=True, latched=self._latched)
            self._decoders[topic.name] = heard.codec.decoder(topic.operation.request)
            self._links[topic.name] = heard.link
        for post, there in self._posts.items():
            self._following.enter_context(self._far.following(post, there))

    def _silence(self) -> None:
        self._following.close()
        self._links = {}
        if self._access:
            self._access.close()
            self._access = None


def _message(topics: Sequence[Channel], decoders: dict[str, Decoder], arrived: _Arrived, dropped: int) -> Message:
    heard = arrived.heard
    if isinstance(heard, Message):
        return heard._replace(time=arrived.time, dropped=dropped)
    topic = next(each for each in topics if each.name == arrived.channel)
    shown: Any
    try:
        shown = json.show_fields(topic.operation.inputs, decoders[arrived.channel](heard.payload))
    except DecodeError as exc:
        shown = f"not understood: {exc}"
    sent = heard.stamp / 1e9 if heard.stamp else None
    return Message(arrived.time, arrived.channel, shown, dropped, sent, heard.sequence if heard.source else None)


def octets_of(payload: Payload) -> int:
    """The size of a received payload of any codec."""
    if isinstance(payload, list):
        return sum(map(octets_of, payload))
    return memoryview(payload).nbytes if payload is not None else 0
