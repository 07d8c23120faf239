"""Listens to topics of a running network. No publisher waits for it."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from functools import cached_property
from types import FrameType, ModuleType
from typing import Any, NamedTuple

from ..errors import DecodeError, RobocompError
from ..threads import start_thread
from ..transports.base import Heard, SupportsSources
from ..wire.codec import Decoder, Payload
from .absent import Absent
from .access import Access, Subscription
from .far import Far, FarArrivals
from .far import Message as Message
from .network import Channel
from .posts import Post
from .traffic import Arrival

log = logging.getLogger("robocomp.tools")

DEPTH = 100
"""Messages of a topic that may wait to be printed."""

OCTETS = 64 * 1024 * 1024
"""Octets of all messages that may wait."""

ARRIVALS = 100_000
"""Arrivals of messages that may wait to be counted."""

_LOOK = 0.1
"""Seconds between two looks at the clock and at signals."""

_AGAIN = 2.0
"""Seconds between two attempts to hear a lost host."""

_SEEKING = 0.5
"""Seconds that the end waits for a look for hosts. If a scout hangs, the look ends only with that scout."""

_FAR = 64 * 1024
"""Octets that count for a message that a scout has decoded, whatever its size."""


class Presence(NamedTuple):
    """A topic has lost its last publisher, or has got one again."""

    channel: str
    is_published: bool
    host: str = ""
    """As that of a message."""


class Lost(NamedTuple):
    """A host is not heard any more. The subscriptions on other hosts go on, and this one is tried again."""

    host: str
    why: str


class Back(NamedTuple):
    """A lost host is heard again."""

    host: str


class Found(NamedTuple):
    """Hosts that were out of reach at first can be asked now. These topics of theirs are heard from now on."""

    topics: Sequence[Channel]


class Seek(NamedTuple):
    """How to find topics on hosts that were out of reach at first."""

    absent: Absent
    look: Callable[[], tuple[Sequence[Channel], Collection[str]]]
    """Returns the topics, and the hosts that cannot be asked. It may take long, and raise RobocompError."""


class Resumed(NamedTuple):
    """This process went on after the user had stopped it. Until then it had no subscriptions."""

    at: float
    """`time.monotonic()`."""


Show = Callable[[Payload], Any]
"""Makes JSON of a payload, or a text that says why the payload cannot be decoded."""


class _Arrived(NamedTuple):
    time: float
    channel: str
    heard: Heard | Message
    """A `Message` if a scout has decoded it."""
    octets: int
    show: Show | None


class Inbox:
    """Messages that wait, bounded in number and octets. `put` never blocks; a message that does not fit is dropped."""

    def __init__(self, most: int) -> None:
        self._waiting: queue.Queue[_Arrived] = queue.Queue(most)
        self._lock = threading.Lock()
        self._octets = 0
        self._dropped = 0

    def put(self, channel: str, heard: Heard | Message, show: Show | None = None) -> None:
        """`show` decodes the payload of a `Heard`; without it, the message has no content."""
        size = _FAR if isinstance(heard, Message) else octets_of(heard.payload)
        with self._lock:
            if isinstance(heard, Message):
                self._dropped += heard.dropped
            if self._octets + size <= OCTETS or not self._octets:
                with contextlib.suppress(queue.Full):
                    self._waiting.put_nowait(_Arrived(time.time(), channel, heard, size, show))
                    self._octets += size
                    return
            self._dropped += 1

    def miss(self, number: int) -> None:
        """Count messages that were lost on their way here as dropped."""
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
    topics: Sequence[Channel],
    *,
    first: float,
    whole: float | None,
    full: bool = True,
    seek: Seek | None = None,
    meanwhile: Callable[[], object] = lambda: None,
) -> Generator[Message | Presence | Lost | Back | Found, None, None]:
    """The messages of these topics, for `whole` seconds or for ever. Ends if none comes in the `first` seconds.

    A topic may be given several times, once for each way of `Channel.each_way`. Whether topics are published is only
    checked while no message comes. Unless `full`, messages from other hosts may be shortened. `meanwhile` is called
    after each message, and every 0.1 s while none comes. Raises what it raises, and the error of a subscription when
    no subscription is left.
    """
    inbox, span = Inbox(DEPTH * len(topics)), Span(first, whole)
    published: dict[tuple[str, str], bool] = {}
    ended: set[tuple[str, str]] = set()
    subscriptions = _Subscriptions(
        topics,
        inbox.put,
        published.clear,  # new subscriptions find their publishers anew
        far=Far(inbox.put, inbox.miss, full),
        seek=seek,
    )
    with _listening(subscriptions):
        subscriptions.prepare()
        while span.goes_on():
            meanwhile()
            yield from subscriptions.finds()
            for lost in subscriptions.losses():
                for key in [each for each in published if each[1] == lost.host]:
                    del published[key]
                    ended.discard(key)
                yield lost
            if found := inbox.get(_LOOK):
                span.heard = True
                message = _message(*found)
                if subscriptions.is_back(message.host):
                    yield Back(message.host)
                published[message.channel, message.host] = True
                yield message
                continue
            for key, is_published in subscriptions.presences().items():
                channel, host = key
                if published.get(key) and not is_published:
                    ended.add(key)
                    yield Presence(channel, False, host)
                elif is_published and key in ended:
                    ended.remove(key)
                    yield Presence(channel, True, host)
                published[key] = is_published


class Tap:
    """Messages of topics, for one thread to take."""

    def __init__(self, inbox: Inbox, subscriptions: _Subscriptions) -> None:
        self._inbox, self._subscriptions = inbox, subscriptions
        self.lost: list[Lost] = []
        """The hosts that are not heard any more."""

    def take(self, timeout: float) -> Message | None:
        """The next message; None if none comes in time. Raises an error when no subscription is left."""
        self.lost.extend(self._subscriptions.losses())
        found = self._inbox.get(timeout)
        return _message(*found) if found else None

    def presences(self) -> Mapping[tuple[str, str], bool]:
        """The topics by name and host, and whether something publishes them now, as far as middlewares can tell."""
        return self._subscriptions.presences()


@contextlib.contextmanager
def tap(topics: Sequence[Channel]) -> Iterator[Tap]:
    """Listen to these topics until the end."""
    inbox = Inbox(DEPTH * len(topics))
    with _listening(subscriptions := _Subscriptions(topics, inbox.put, far=Far(inbox.put, inbox.miss))):
        yield Tap(inbox, subscriptions)


def arrivals(
    topics: Sequence[Channel], *, first: float, whole: float | None, seek: Seek | None = None
) -> Generator[Arrival | Lost | Back | Found | Resumed | None, None, None]:
    """The arrivals of new messages, for as long as `tapped`; None whenever 0.1 s pass without one.

    If the caller does not take them, at most `ARRIVALS` wait; further ones are not counted.
    """
    waiting: queue.SimpleQueue[Arrival | Resumed] = queue.SimpleQueue()
    span = Span(first, whole)

    def put(arrival: Arrival) -> None:
        if waiting.qsize() < ARRIVALS:
            waiting.put(arrival)

    def note(channel: str, heard: Heard, show: Show) -> None:
        if waiting.qsize() < ARRIVALS:
            age = (time.time_ns() - heard.stamp) / 1e9 if heard.stamp else math.nan
            size = octets_of(heard.payload)
            waiting.put(Arrival(channel, time.monotonic(), size, heard.source, heard.sequence, age))

    def resumed() -> None:
        waiting.put(Resumed(time.monotonic()))  # not bounded: only a user who types causes them

    subscriptions = _Subscriptions(topics, note, resumed, latched=False, far=FarArrivals(put), seek=seek)
    with _listening(subscriptions):
        while span.goes_on():
            yield from subscriptions.finds()
            yield from subscriptions.losses()
            try:
                arrival = waiting.get(timeout=_LOOK)
            except queue.Empty:
                yield None
            else:
                if isinstance(arrival, Arrival):
                    span.heard = True
                    if subscriptions.is_back(arrival.host):
                        yield Back(arrival.host)
                yield arrival


class Span:
    """How long to listen: `whole` seconds. If that is None, for ever, but only `first` seconds if nothing is heard."""

    def __init__(self, first: float, whole: float | None) -> None:
        self._end = time.monotonic() + (whole or first)
        self._is_endless = whole is None
        self.heard = False

    def goes_on(self) -> bool:
        return (self._is_endless and self.heard) or time.monotonic() < self._end


@contextlib.contextmanager
def _listening(subscriptions: _Subscriptions) -> Iterator[None]:
    """Open subscriptions until the end.

    When the user stops this process (Ctrl-Z), it first closes them: otherwise publishers could have to wait for it. A
    thread does so, because the main thread may be writing to a pipe that takes nothing.
    """
    in_main = threading.current_thread() is threading.main_thread()
    try:
        before = signal.signal(signal.SIGTSTP, subscriptions.stop) if in_main else None
        subscriptions.open()
        yield
    finally:
        subscriptions.close()
        if in_main:
            signal.signal(signal.SIGTSTP, before or signal.SIG_DFL)


class _Subscriptions:
    def __init__(
        self,
        topics: Sequence[Channel],
        take: Callable[[str, Heard, Show], None],
        resumed: Callable[[], None] = lambda: None,
        *,
        far: Far | FarArrivals,
        latched: bool = True,
        seek: Seek | None = None,
    ) -> None:
        """`take` gets the name of a channel, a message, and the function that shows its payload.

        Unless `latched`, it gets only messages that are sent from now on. `resumed` is called when this process goes on
        after a stop, before the first message. `far` takes the messages of other hosts.
        """
        self._topics = [each for each in topics if each.via is None]
        self._take, self._resumed = take, resumed
        self._latched, self._far, self._seek = latched, far, seek
        self._found: queue.SimpleQueue[Sequence[Channel]] = queue.SimpleQueue()
        self._seeking: threading.Thread | None = None
        self._posts: dict[Post, list[Channel]] = {}
        for each in topics:
            if each.via:
                self._posts.setdefault(each.via, []).append(each)
        self._untold = {each.name for each in topics if any(end.supplement for end in each.providers)}
        """The topics of foreign programs. No middleware tells whether these publish."""
        self._following: dict[Post, contextlib.ExitStack] = {}
        self._access: Access | None = None
        self._links: list[tuple[str, Subscription]] = []
        self._shows: list[_Show] = []
        self._reported: set[str] = set()
        """The lost hosts that `losses` has yielded, and that are not back."""
        self._changing = threading.Lock()
        """Held while subscriptions are opened or closed."""
        self._again = 0.0
        """When to try lost hosts again, by `time.monotonic()`."""
        self._wanted: queue.SimpleQueue[None] = queue.SimpleQueue()
        """Gets an item when this process is to stop, or the subscriptions are to end.

        No `threading.Event`: a signal handler that sets one waits for ever if its thread was just setting it.
        """
        self._is_over = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._pause, name="pause", daemon=True)

    def open(self) -> None:
        with self._changing:
            self._listen()
        start_thread(self._thread)

    def prepare(self) -> None:
        """Import and make what shows messages. After `open`, it costs no time: a message is awaited anyway."""
        for each in self._shows:
            each.prepare()

    def stop(self, number: int, frame: FrameType | None) -> None:
        """The handler of a signal."""
        self._wanted.put(None)

    def check(self) -> None:
        """Raise the error of a subscription if there is one."""
        if error := self._error or next(reversed(self._far.lost.copy().values()), None):
            raise error

    def losses(self) -> Iterator[Lost]:
        """The hosts that were lost since the last call. Raises an error when no subscription is left."""
        lost = self._far.lost
        if self._error or (lost and not self._topics and all(post.host in lost for post in self._posts)):
            self.check()
        for host, error in lost.copy().items():
            if host not in self._reported:
                self._reported.add(host)
                yield Lost(host, str(error))
        if lost and time.monotonic() > self._again:
            self._again = time.monotonic() + _AGAIN
            self._try_again()

    def finds(self) -> Iterator[Found]:
        """Look for absent hosts from time to time, on another thread, and subscribe to the topics found there."""
        seek = self._seek
        if seek and seek.absent and seek.absent.is_due():
            self._seeking = threading.Thread(target=self._look, args=(seek,), name="looking for hosts", daemon=True)
            if not start_thread(self._seeking):
                seek.absent.looked()
        while not self._found.empty():
            topics = self._found.get()
            yield Found(topics)
            with self._changing:
                self._add(topics)

    def _look(self, seek: Seek) -> None:
        lost: Collection[str] | None = None
        try:
            topics, lost = seek.look()
            found = [way for each in topics for way in each.each_way(lambda way: way.host not in seek.absent)]
            if found:
                self._found.put(found)
            for each in found:
                seek.absent.found(each.host)
        except (RobocompError, ValueError) as exc:
            log.debug("looking for hosts: %s", exc)  # it is tried again
        finally:
            seek.absent.looked(lost)

    def _add(self, topics: Sequence[Channel]) -> None:
        by_post: dict[Post, list[Channel]] = {}
        for each in topics:
            if each.via:
                by_post.setdefault(each.via, []).append(each)
        self._posts |= by_post
        for post, there in by_post.items() if self._access else ():
            self._follow(post, there)

    def is_back(self, host: str) -> bool:
        """Whether `losses` has yielded this host, of which a message has come. True only once for each loss."""
        was_lost = host in self._reported and host not in self._far.lost
        if was_lost:
            self._reported.discard(host)
        return was_lost

    def _try_again(self) -> None:
        """Subscribe on lost hosts, unless this process is about to be stopped."""
        with self._changing:
            for post, there in self._posts.items() if self._access else ():
                if post.host in self._far.lost:
                    self._follow(post, there)

    def presences(self) -> Mapping[tuple[str, str], bool]:
        """The topics by name and host, and whether something publishes them now, as far as middlewares can tell."""
        links, found = self._links, dict[tuple[str, str], bool]()
        for name, link in links.copy():
            if isinstance(link, SupportsSources) and name not in self._untold:
                found[name, ""] = found.get((name, "")) or bool(link.sources())
        return (found if links is self._links else {}) | self._far.presences()  # they may have been closed meanwhile

    def close(self) -> None:
        self._is_over = True
        self._wanted.put(None)
        if self._thread.ident:
            self._thread.join()
        if self._seeking and self._seeking.ident:
            self._seeking.join(_SEEKING)
        with self._changing:
            self._silence()

    def _pause(self) -> None:
        while True:
            self._wanted.get()
            while not self._wanted.empty():  # several signals stop it once
                self._wanted.get()
            if self._is_over:
                return
            with self._changing:
                self._silence()
            os.kill(os.getpid(), signal.SIGSTOP)
            self._resumed()
            try:
                with self._changing:
                    self._listen()
            except Exception as exc:  # for `check`
                self._error = exc
                return

    def _listen(self) -> None:
        self._access = access = Access()
        self._far.lost.clear()
        self._reported.clear()
        for topic in self._topics:
            self._shows.append(show := _Show(topic, access))
            heard = access.hear(topic, self._sink(topic.name, show), DEPTH, headed=True, latched=self._latched)
            self._links.append((topic.name, heard.link))
        for post, there in self._posts.items():
            self._follow(post, there)

    def _follow(self, post: Post, topics: Sequence[Channel]) -> None:
        self._far.lost.pop(post.host, None)
        self._following.setdefault(post, contextlib.ExitStack()).close()
        try:
            self._following[post].enter_context(self._far.following(post, topics))
        except RobocompError as exc:  # for `check` and `losses`
            self._far.lost[post.host] = exc

    def _sink(self, name: str, show: Show) -> Callable[[Heard], None]:
        return lambda heard: self._take(name, heard, show)

    def _silence(self) -> None:
        for each in self._following.values():
            each.close()
        self._links = []
        self._shows = []
        if self._access:
            self._access.close()
            self._access = None


class _Show:
    """Shows the payloads of a topic. It is ready after `prepare`, or else makes itself ready for the first payload."""

    def __init__(self, topic: Channel, access: Access) -> None:
        self._topic, self._access = topic, access

    def prepare(self) -> None:
        _ = self._decode, self._json

    def __call__(self, payload: Payload) -> Any:
        try:
            return self._json.show_fields(self._topic.operation.inputs, self._decode(payload))
        except DecodeError as exc:
            return f"not understood: {exc}"

    @cached_property
    def _decode(self) -> Decoder:
        return self._access.codec(self._topic).decoder(self._topic.operation.request)

    @cached_property
    def _json(self) -> ModuleType:
        from ..wire import json

        return json


def _message(arrived: _Arrived, dropped: int) -> Message:
    heard = arrived.heard
    if isinstance(heard, Message):
        return heard._replace(time=arrived.time, dropped=dropped)
    sent = heard.stamp / 1e9 if heard.stamp else None
    shown = arrived.show(heard.payload) if arrived.show else None
    return Message(arrived.time, arrived.channel, shown, dropped, sent, heard.sequence if heard.source else None)


def octets_of(payload: Payload) -> int:
    """The size of a received payload of any codec."""
    if isinstance(payload, list):
        return sum(map(octets_of, payload))
    return memoryview(payload).nbytes if payload is not None else 0
