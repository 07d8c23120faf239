"""Publishers and subscribers."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import zmq

from ...contract.qos import from_traits
from ...errors import (
    DecodeError,
    Timeout,
    TransportError,
)
from ...wire.codec import Payload
from ...wire.header import (
    publications_of,
    random_id,
)
from ..base import (
    Channel,
    Sink,
    SupportsSubscribers,
    depth_of,
)
from ..directory_transport import DirectoryLink
from ..leader_followers import Job
from ..limits import BATCH
from ..link import persist
from ..members import Entry, Member
from ..topics import SubscribingLink
from .core import TICK
from .frames import Frames, is_welcome, joined, read_publication_frames, topic, welcome_topic
from .remote import FarFeed, is_far
from .sockets import Socket, Subscription
from .topic_sockets import TopicSocket, open_here, remove
from .zmtp import Feed, Garbled, Gone

if TYPE_CHECKING:
    from .core import ZeroMQCore


_LAST_WORDS = 1.0
"""Seconds for which messages of a remote publisher are still received after it has left."""

_AT_FIRST, _LATER = 0.005, 1.0
"""Seconds between two looks for a subscriber that is expected, and for one that has not come for a while."""

WELCOMES = "h"
"""The mark of a publisher that tells its subscribers that they are connected."""

SPARES = "b"
"""The mark of a reliable publisher that opens a second socket for best-effort subscribers. So it does not wait for
them: it waits for all subscribers of the first one, since ZeroMQ cannot tell them apart."""


class Publisher(DirectoryLink["ZeroMQCore"], SupportsSubscribers):
    role, facing, marks = "publishes", "subscribes", WELCOMES
    _here: TopicSocket | None = None
    """The socket for this host."""
    _beside: TopicSocket | None = None
    """That for best-effort subscribers of a reliable topic on this host, once there is one."""
    _far: TopicSocket | None = None
    """The socket for other hosts, if there may be any."""
    _sent_here: Frames | None = None
    """The message that was sent on this host, but not to other hosts yet."""

    def open(self) -> None:
        qos = self.channel.qos
        depth = max(depth_of(qos), 8)
        self._topic = topic(self.channel.name)
        self._source, self._sequence = random_id(), itertools.count(1)
        self._begin = publications_of(self._topic, self.channel.type.fingerprint, self._source)
        self._history: deque[Frames] = deque(maxlen=qos.depth if qos.latched else 0)
        self._expected: set[bytes] = set()
        """The welcome topics of all subscribers in the directory."""
        self._pause = _AT_FIRST
        """Seconds until the next look for expected subscribers."""
        self._order = threading.Lock()
        self._looking = threading.RLock()
        self._depth, self._lossy = depth, not qos.reliable
        self._path = self.transport.member.address(ending(self._source))
        self._address = f"ipc://{self._path}"
        if not self._lossy:
            self.marks += SPARES
        self._here = self._open_here(depth)
        self._far = self._open_far(depth)
        if self._far is None:
            self._send = self._send_here
            # sending may consume the report of a subscription: see `TopicSocket.count`
            self._at_once = self._send if self._history.maxlen else self._here.socket.send_only
        else:
            self._send = self._at_once = self._send_everywhere
        self.announce(self._address)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = 0.0
        if not self._order.acquire(blocking=False):  # faster than with a timeout
            end = time.monotonic() + deadline
            self.take_turn(self._order, deadline)
        try:
            frames = joined(self._begin(next(self._sequence), time.time_ns()), payload)
            if not self._at_once(frames):
                self.check_open()
                end = end or time.monotonic() + deadline
                if not persist(partial(self._send, frames), end, self.check_open, self.closed):
                    self.check_open()
                    raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
        except zmq.ZMQError as exc:
            self.check_open()  # an error after closing is reported as Closed
            raise TransportError(f"zeromq: publishing {self.channel.name}: {exc}") from exc
        finally:
            self._order.release()

    def look(self) -> bool:
        with self._looking:  # an interrupted thread must not overwrite a newer result
            found = [entry for _, entry in self.counterparts()]
            self._expected = {named for entry in found if (named := self._welcome_of(entry))}
            self._pause = _AT_FIRST
            if not (self._lossy or self._beside or self.closed.is_set()) and any(map(_is_lossy, found)):
                self._open_beside()
        return True

    def tick(self) -> float | None:
        self._count()  # limits the subscriptions that pile up to those between two ticks
        if self._is_known_to_all():
            return super().tick()
        self._pause = min(2 * self._pause, _LATER)
        return self._pause

    def visible(self) -> bool:
        self.counterparts(strict=True)
        self._count()
        return self._is_subscribed()

    def connected(self) -> bool:
        if self._far and not self.transport.may_be_known:
            return False
        self._count()
        with self._looking:
            return self.look() and self._is_known_to_all()

    @property
    def has_subscribers(self) -> bool:
        if not self._is_subscribed():
            self._count()
        return bool(self._is_subscribed() or self._history.maxlen)

    def release(self) -> None:
        with self._looking:
            if self._beside:
                remove(beside(self._path))
                self._beside.close()
        if self._far:
            self.transport.end_topic(self._address)
            self._far.close()
        if self._here and self._history.maxlen:
            remove(self._path)
            self._here.close()
        elif self._here:
            self.transport.shared_sockets.leave(self._here, self._path)

    def _open_here(self, depth: int) -> TopicSocket:
        if self._history.maxlen:
            opening = partial(open_here, self.transport.reactor, self._path, depth, watched=True)
            return TopicSocket(self.transport.reactor, opening, [self._topic], self._repeat_to)
        return self.transport.shared_sockets.join(self._topic, depth, self._path)

    def _open_beside(self) -> None:
        opening = partial(
            open_here, self.transport.reactor, beside(self._path), self._depth, watched=bool(self._history.maxlen)
        )
        self._beside = TopicSocket(self.transport.reactor, opening, [self._topic], self._repeat_to)
        if self._far is None:
            self._at_once = self._send

    def _open_far(self, depth: int) -> TopicSocket | None:
        if not self.transport.bound:
            return None
        opening = partial(self.transport.far_topic, self.channel, self._address, ending(self._source), depth)
        return TopicSocket(self.transport.reactor, opening, [self._topic], self._repeat_to)

    def _send_everywhere(self, frames: Frames) -> bool:
        """Send on this host and to other hosts. A repetition for lack of room does not send on this host again."""
        assert self._far
        if self._sent_here is not frames:
            if not self._send_here(frames):
                return False
            self._sent_here = frames
        self._far.take_subscriptions()
        far = self._far.socket
        return far.send_only(frames) or (self._lossy and far.send_to_some(frames))

    def _send_here(self, frames: Frames) -> bool:
        assert self._here
        socket, spare = self._here.socket, self._beside
        if not self._history.maxlen:
            sent = socket.send_only(frames) or (self._lossy and socket.send_to_some(frames))
            if sent and spare:
                _send_to_some(spare.socket, frames)
            return sent
        # at once, so that a new subscriber gets this message only once, as news or as history
        with socket.lock, spare.socket.lock if spare else contextlib.nullcontext():
            if self._here.take_subscriptions() or (spare and spare.take_subscriptions()):
                return False
            sent = socket.send(frames) or (self._lossy and socket.send_to_some(frames))
            if sent:
                if spare:
                    _send_to_some(spare.socket, frames)
                    spare.socket.look()
                first, *arrays = frames
                self._history.append([first[len(self._topic) :], *map(bytes, arrays)])
            return sent

    def _sockets(self) -> list[TopicSocket]:
        return [each for each in (self._here, self._beside, self._far) if each]

    def _count(self) -> None:
        for each in self._sockets():
            each.count()

    def _is_subscribed(self) -> bool:
        return any(self._topic in each.subscribed for each in self._sockets())

    def _is_known_to_all(self) -> bool:
        """Whether all subscribers in the directory are connected."""
        missing = self._expected
        for each in self._sockets():
            missing = missing - each.welcomed
        return not missing

    def _welcome_of(self, subscriber: Entry) -> bytes:
        alike = subscriber.channel == self.channel.name
        return welcome_topic(subscriber.address, "0" if alike else ending(self._source))

    def _repeat_to(self, socket: Socket, named: bytes) -> None:
        for first, *arrays in list(self._history):  # a copy, since another thread may be sending
            socket.send([named + first, *arrays])


class Subscriber(SubscribingLink["ZeroMQCore"]):
    def __init__(self, transport: ZeroMQCore, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel, sink)
        self._looking = threading.RLock()
        self._feeds: dict[str, Subscription] = {}
        """By the address of their publisher."""
        self._incomplete = False
        """Whether a publisher may exist that could not be connected yet."""
        self._garbled: set[str] = set()
        """Addresses that use another protocol."""
        self._channels: dict[str, str] = {}
        """By the ending of a publisher's address."""
        self._muted: deque[Subscription] = deque()
        """Feeds that found no room. They are resumed before others, so that a publisher that floods does not starve
        them."""
        self._id = f"{random_id():016x}"
        self._welcomed: set[str] = set()
        """The addresses of publishers that have confirmed the connection."""
        self._ending: dict[str, float] = {}
        """Addresses whose publisher has left, and until when its last messages are received."""

    def open(self) -> None:
        self.look()
        self.announce(self._id)

    def look(self) -> bool:
        with self._looking:  # two threads must not connect the same publisher
            found = self.counterparts()
            there = {entry.address: entry.channel for _, entry in found}
            self._end_others(there)
            connected = {address[-6:] for address in self._feeds}  # some have left; their last messages may come
            self._channels = {end: channel for end, channel in self._channels.items() if end in connected}
            self._channels |= {address[-6:]: channel for address, channel in there.items()}
            self.meet(found)
            self._garbled &= there.keys()
            if self.closed.is_set():
                return True
            for member, entry in found:
                if entry.address not in self._feeds and entry.address not in self._garbled:
                    self._connect(member, entry)
        return True

    def tick(self) -> float | None:
        if self._ending:
            self._leave_those_that_ended()
        if not self._incomplete:
            return _LAST_WORDS if self._ending else super().tick()
        self._incomplete = False
        self.look()
        return TICK

    def connected(self) -> bool:
        self.look()
        return self.transport.knows_others and all(self._hears(entry) for _, entry in self.counterparts())

    def hears(self, member_id: str) -> bool:
        """Whether this subscriber is connected to all its publishers of that member."""
        return all(self._hears(entry) for member, entry in self.counterparts() if member.id == member_id)

    def _hears(self, entry: Entry) -> bool:
        return entry.address in self._welcomed or WELCOMES not in entry.traits

    def visible(self) -> bool:
        publishers = self.counterparts(strict=True)
        return any(e.address in self._feeds and self.transport.directory.alive(m.id) for m, e in publishers)

    def release(self) -> None:
        try:
            super().release()
        finally:
            with self._looking:
                for address in list(self._feeds):
                    self._leave(address)

    def _end_others(self, there: Mapping[str, str]) -> None:
        """Schedule the end of connections to publications that are not `there` any more.

        Remote ones would reconnect for ever. On this host, other publications may keep the socket open.
        """
        end = time.monotonic() + _LAST_WORDS
        self._ending = {address: self._ending.get(address, end) for address in self._feeds if address not in there}

    def _leave_those_that_ended(self) -> None:
        now = time.monotonic()
        for address in [address for address, end in self._ending.items() if end <= now]:
            if is_far(address) or self._has_said_all(address):
                del self._ending[address]
                self._leave(address)
            else:
                self._ending[address] = now + _LAST_WORDS

    def _has_said_all(self, address: str) -> bool:
        """Whether nothing has come lately from a publication of this host, and nothing waits. Until then it is heard.

        If its process has ended, so has the connection, and what is left of it is received first.
        """
        feed = self._feeds.get(address)
        if feed is None:
            return True
        was_active, feed.active = feed.active, False
        member_id = PurePath(address).name.rpartition("-")[0]
        return not was_active and feed not in self._muted and self.transport.directory.alive(member_id)

    def _connect(self, member: Member, publisher: Entry) -> None:
        address, channel = publisher.address, publisher.channel
        topics = [topic(channel)]
        if self.channel.qos.latched:
            topics.append(b"\0" + random_id().to_bytes(8, "little"))
        # last, so that its confirmation covers the others
        topics.append(welcome_topic(self._id, address[-6:] if channel != self.channel.name else "0"))
        feed: Feed | FarFeed
        try:
            if is_far(address):
                secure = self.transport.secure_to(member)
                feed = FarFeed(self.transport.reactor, address, topics, secure, max(self._depth, 8))
            else:
                path = PurePath(address.removeprefix("ipc://"))
                is_spared = not self.lossless and SPARES in publisher.traits
                feed = Feed(str(beside(path) if is_spared else path), topics)
        except (ConnectionError, FileNotFoundError, BlockingIOError):
            self._incomplete = True  # it has gone, or accepts no connection just now
        except OSError as exc:
            raise TransportError(f"zeromq: connecting to {address}: {exc.strerror}") from exc
        else:
            self._feeds[address] = self.transport.reactor.subscription(feed, partial(self._on_message, address))

    def _leave(self, address: str) -> None:
        with self._looking:
            self._welcomed.discard(address)
            if feed := self._feeds.pop(address, None):
                self.transport.reactor.forget(feed)

    def _on_message(self, address: str, feed: Subscription) -> list[Job]:
        most = min(self._lane.room, BATCH)
        if most <= 0:
            if self._pause(feed):
                return []
            most = 1
        taken = self._take(address, feed, most)
        if self._lane.lossy:  # it keeps the newest of all that is there
            for _ in range(BATCH // most):
                if not feed.more:
                    break
                taken += self._take(address, feed, most)
        if feed.more:
            self.transport.reactor.attend(feed)
        return [self._drain] if taken else []

    def _take(self, address: str, feed: Subscription, most: int) -> int:
        """Move at most so many messages into the lane; how many it took."""
        try:
            messages = feed.receive(most)
        except Gone as exc:
            if isinstance(exc, Garbled):
                self.malformed(exc)
                self._garbled.add(address)
            self._leave(address)
            self._incomplete = True  # it may still exist
            self.transport.reactor.within(TICK)
            return 0
        admitted = [payload for frames in messages if (payload := self._admitted(address, frames)) is not None]
        if len(admitted) == 1:  # the usual case
            return int(self._lane.put(admitted[0]))
        return self._lane.put_all(admitted)

    def _pause(self, feed: Subscription) -> bool:
        """Stop to receive until there is room; False if there is room by now."""
        self.transport.reactor.mute(feed)  # first: `_drain` may resume it as soon as it is in `_muted`
        self._muted.append(feed)
        if self._lane.full:  # checked again: `_drain` resumes the feeds that it finds in `_muted`
            return True
        self._hear_all()
        return False

    def _hear_all(self) -> None:
        with contextlib.suppress(IndexError):
            while True:  # the last one first: each is put in front of the others
                self.transport.reactor.hear(self._muted.pop())

    def _admitted(self, address: str, frames: Frames) -> Payload | None:
        """The payload to deliver; None if there is none."""
        try:
            header, payload = read_publication_frames(frames)
        except DecodeError as exc:
            if is_welcome(frames[0]):
                self._welcomed.add(address)
                if is_far(address):
                    self.transport.reactor.within(0.0)  # reveals the services of that member
            else:
                self.malformed(exc)
            return None
        name = self._channels.get(ending(header[2]), self.channel.name) if self._reception.on else ""
        return self.admitted(name, header, payload)

    def _drain(self) -> None:
        self._lane.drain()
        if self._muted:
            self._hear_all()


def _is_lossy(subscriber: Entry) -> bool:
    """Whether a subscriber uses the second socket of a reliable publisher."""
    return not from_traits(subscriber.traits).reliable


def _send_to_some(socket: Socket, frames: Frames) -> None:
    """Send; subscribers without room miss the message."""
    if not socket.send_only(frames):
        socket.send_to_some(frames)


def beside(path: Path | PurePath) -> Path:
    """Where a reliable publisher at this path has its second socket."""
    head, _, end = path.name.rpartition("-")
    return Path(path.with_name(f"{head}-b{end}"))


def ending(source: int) -> str:
    """The ending of the address of a publisher."""
    return f"{source & 0xFFFFFF:06x}"
