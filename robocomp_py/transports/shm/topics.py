"""Publishers and subscribers. Each publisher has a topic; a subscriber reads the topics of all its publishers."""

from __future__ import annotations

import contextlib
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any

from ...errors import DecodeError, Timeout, TransportError
from ...wire.codec import Payload
from ...wire.header import pack_publication, publication_at, random_id
from ..base import Channel, Sink, SupportsLoan, SupportsSubscribers, depth_of
from ..directory_transport import DirectoryLink
from ..leader_followers import Job
from ..limits import BATCH
from ..members import Member
from ..topics import SubscribingLink
from .node import READERS
from .queues import packed
from .receipts import Backlog, Receipts
from .receipts import Reader as Receiver
from .samples import HEAD_BYTES, Loaned, Message, Reader, Writer, size_of
from .wakeup import LOOK, Waker, wakeup_of

if TYPE_CHECKING:
    from .core import ShmCore

LEAST_AHEAD, MOST_AHEAD = 32, 256
"""The least and the most messages that may be on their way to a reader. Between these limits, it is the depth."""

FEW_AHEAD, BYTES_AHEAD = 4, 8 * 1024 * 1024
"""For large messages: at least this number, and about this number of bytes. More would not fit into CPU caches."""

_SMALL = BYTES_AHEAD // MOST_AHEAD

SPARE = 8
"""Room for further messages, because a reader may begin to read before it is counted."""

SHARE = 8
"""Maximum number of messages that a reader may keep without a copy."""

SHARES = 16
"""Maximum number of readers that may keep `SHARE` messages; with more readers, each may keep less."""

LOANS = 16
"""Maximum number of messages that are written at the same time."""

LOANING = 5.0
"""Seconds for which a loan waits for another thread that is sending."""

PAUSE = 0.001
"""Seconds between two attempts to get memory when all of it is in use."""


class Publisher(DirectoryLink["ShmCore"], SupportsSubscribers, SupportsLoan):
    role, facing = "publishes", "subscribes"
    _number = 0
    _writer: Writer | None = None
    _dynamic: Any = None

    def open(self) -> None:
        qos = self.channel.qos
        self._lossless = qos.reliable
        self._history = qos.depth if qos.latched else 0
        self._ahead = min(max(depth_of(qos), LEAST_AHEAD), MOST_AHEAD)
        self._backlog = Backlog()
        self._source, self._sent = random_id(), 0
        self._order, self._looking = threading.Lock(), threading.Lock()
        self._readers: dict[tuple[str, str], _Known] = {}
        self._wakers: list[tuple[Waker, int]] = []
        self._seen = 0
        """The number of readers that iceoryx2 knew at the last look; -1 if that is no longer known."""
        self._missing = False
        """Whether the directory then had another number of subscribers."""
        self._looked_at = -1
        """The version of the directory at the last look."""
        self._number = self.transport.number()
        self.transport.attend_to(self._number, self)
        self.announce(f"{self._number}/{self._source:016x}")
        self.look()

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = self._take_turn(deadline)
        try:
            size = size_of(payload)
            if self._is_to_be_written(size, end, deadline):
                writer = self._writer or self._opened()
                while writer.send(0, 0, 0, self._header(), payload, size) is None:
                    if not self._await_memory(end, deadline):
                        break
                else:
                    self._was_sent()
        except TransportError:
            self.check_open()  # an error after closing is reported as Closed
            raise
        finally:
            self._order.release()

    def loan(self, size: int) -> _Loan:
        self._take_turn(LOANING)
        try:
            writer = self._writer or self._opened()
            loaned = writer.lend(size)
            if loaned is None:  # no wait here: the caller can send without a loan, and waits then
                raise TransportError(f"{self.channel.name}: all memory for messages is in use")
            return _Loan(self, loaned)
        except TransportError:
            self.check_open()
            raise
        finally:
            self._order.release()

    def send_loaned(self, loaned: Loaned, begin: int, end: int, deadline: float) -> None:
        until = self._take_turn(deadline)
        try:
            if self._is_to_be_written(end - begin, until, deadline):
                loaned.send(self._header(), begin, end)
                self._was_sent()
        except TransportError:
            self.check_open()
            raise
        finally:
            self._order.release()

    def look(self) -> bool:
        with self._looking:
            if self.closed.is_set():
                return True
            version = self.transport.directory.version()
            there = {(member.id, entry.address): (member, entry) for member, entry in self.counterparts()}
            is_new = bool(there) and self._writer is None
            if is_new:
                self._open_topic()
            present = self._present()
            for gone in self._readers.keys() - there.keys():
                del self._readers[gone]
            for key in there.keys() - self._readers.keys():
                member, entry = there[key]
                waker = self.transport.waker(member)
                if waker:
                    text, _, counted = entry.address.partition("/")
                    path = self.transport.receipts(member.id, int(text)) if counted and self._lossless else None
                    receiver = Receiver(path, self._source, self._sent) if path else None
                    self._readers[key] = _Known(waker, wakeup_of(int(text)), receiver)
            known = list(self._readers.values())
            self._backlog.meet([each.receiver for each in known if each.receiver])
            self._wakers = [(each.waker, each.wakeup) for each in known]
            if self._writer:
                self._writer.greet()  # new readers get the history now
            # last: a thread that is sending compares these to know whether it needs to look, too
            self._looked_at, self._missing, self._seen = version, present != len(there), present
        for waker, number in self._wakers:
            waker.wake(LOOK if is_new else number)
        return all(key in self._readers for key in there)

    def _opened(self) -> Writer:
        """The writer, even without subscribers: for messages that are kept for later ones, and for loans."""
        with self._looking:
            self.check_open()
            return self._writer or self._open_topic()

    def _open_topic(self) -> Writer:
        """Open the topic. A publisher without subscribers has none, because it takes memory and descriptors."""
        self._seen = -1  # a subscriber may connect before this returns: a thread that is sending looks, too
        service, port = self.transport.node.new_topic(
            f"{self.transport.member.id}.{self._number}",
            self._ahead + SPARE + self._history,
            self._history,
            SHARE + 1,
            SHARE * SHARES + READERS,
            LOANS,
        )
        self._dynamic = service.dynamic_config
        self._writer = writer = Writer(port, self.transport.node.heap, LOANS)
        return writer

    def on_input(self, *, one: bool = False) -> tuple[Job, ...]:
        """A subscriber sent a wake-up: it begins to read, or it has read as much as this publisher waited for."""
        self._backlog.called()
        self._meet_new_readers()
        return ()

    def visible(self) -> bool:
        if not self.counterparts(strict=True):
            return False
        self.look()
        return bool(self._wakers) and self._seen > 0

    def connected(self) -> bool:
        if self.look() and not self._missing:
            return True
        for waker, _ in self._wakers:
            waker.wake(LOOK)  # its subscriber need not wait for its next look into the directory
        return False

    @property
    def has_subscribers(self) -> bool:
        self._meet_new_readers()
        return bool(self._wakers) or self._history > 0

    def close(self) -> None:
        if self._writer and not self.closed.is_set():  # while readers can still receive
            self._backlog.settle(self._sent, self.transport.settling())
        super().close()

    def release(self) -> None:
        self.transport.forget(self._number, self)
        if self._writer:
            self._backlog.called()
            with self._looking:
                self._writer.close()
                self._dynamic = None

    # For every message. The sending thread has the turn.

    def _take_turn(self, deadline: float) -> float:
        """Wait for the turn to send, which must be released afterwards. Returns when the deadline ends."""
        end = time.monotonic() + deadline
        self.take_turn(self._order, deadline)
        if self.closed.is_set() or self.transport.closed:
            self._order.release()
            self.check_open()
        return end

    def _is_to_be_written(self, size: int, end: float, deadline: float) -> bool:
        """Wait until all readers have room; whether there is a reader or a history to write for."""
        self._meet_new_readers()
        if self._lossless:
            ahead = self._ahead if size < _SMALL else max(FEW_AHEAD, min(self._ahead, BYTES_AHEAD // size))
            if self._sent >= self._backlog.slowest + ahead and not self._backlog.wait(
                self._sent, ahead, end, self._still
            ):
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
        return bool(self._wakers) or self._history > 0

    def _header(self) -> bytes:
        return pack_publication(self.channel.type.fingerprint, self._source, self._sent + 1, time.time_ns())

    def _was_sent(self) -> None:
        self._sent += 1
        for waker, number in self._wakers:
            waker.wake(number)

    def _await_memory(self, end: float, deadline: float) -> bool:
        """All memory for messages is in use: wait. Returns whether to try again; otherwise the message is dropped."""
        if not self._lossless:
            self._sent += 1  # so that subscribers count it as lost
            self.stats.dropped += 1
            return False
        if time.monotonic() >= end:
            raise Timeout(f"{self.channel.name}: subscribers kept all memory for messages, for {deadline:g} s")
        self._pause()
        return True

    def _pause(self) -> None:
        self.closed.wait(PAUSE)
        self.check_open()

    def _meet_new_readers(self) -> None:
        """Update the readers, if they have changed: a connected subscriber hears what is sent from now on."""
        if self._seen != self._present() or (self._missing and self._looked_at != self.transport.directory.version()):
            self.look()

    def _present(self) -> int:
        """The number of readers known to iceoryx2."""
        present = self._dynamic
        number: int = present.number_of_subscribers if present is not None else 0
        return number

    def _still(self) -> None:
        """Called while waiting for readers, to stop waiting for killed ones."""
        self.check_open()
        for member_id, _ in list(self._readers):
            if not self.transport.directory.alive(member_id):
                self.transport.died()
                self.look()


class _Known:
    """A subscriber, as its publisher knows it."""

    def __init__(self, waker: Waker, wakeup: int, receiver: Receiver | None) -> None:
        self.waker, self.wakeup, self.receiver = waker, wakeup, receiver


class _Loan:
    """See `transports.base.Loan`."""

    def __init__(self, publisher: Publisher, loaned: Loaned) -> None:
        self._publisher = publisher
        self._loaned: Loaned | None = loaned
        self.data = loaned.data

    def send(self, begin: int, end: int, deadline: float = 5.0) -> None:
        loaned = self._loaned
        if loaned is None:
            raise ValueError("this loan has ended")
        if not 0 <= begin <= end <= len(self.data):
            raise ValueError(f"{begin} to {end} of {len(self.data)} bytes")
        self._publisher.send_loaned(loaned, begin, end, deadline)
        self._loaned = None

    def close(self) -> None:
        self._loaned = None


class Subscriber(SubscribingLink["ShmCore"]):
    _number = 0
    _receipts: Receipts | None = None

    def __init__(self, transport: ShmCore, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel, sink)
        self._heard: dict[tuple[str, str], _Heard] = {}
        self._looking = threading.RLock()
        self._paused = False
        self._turn = 0
        """The publisher that is read first; then it is the next one's turn: one that fills the lane does so once."""

    def open(self) -> None:
        self._number = self.transport.number()
        if self.lossless:
            self._receipts = Receipts(self.transport.receipts(self.transport.member.id, self._number))
        self.announce(f"{self._number}/counted" if self.lossless else str(self._number))
        self.look()
        self.transport.attend_to(self._number, self)

    def look(self) -> bool:
        with self._looking:
            if self.closed.is_set():
                return True
            found = self.counterparts()
            self.meet(found)
            there = {(member.id, entry.address): (member, entry.channel) for member, entry in found}
            for key in self._heard.keys() - there.keys():
                self._hear_out(self._heard.pop(key))
            for key in there.keys() - self._heard.keys():
                self._begin(key, *there[key])
            for heard in self._heard.values():
                heard.reader.share = _share(heard.service)
        self.transport.attend(self)
        return self._heard.keys() >= there.keys()

    def connected(self) -> bool:
        try:
            return self.look()
        except TransportError:  # the receiving thread logs it
            self.check_open()
            return False

    def visible(self) -> bool:
        publishers = self.counterparts(strict=True)
        return any((m.id, e.address) in self._heard and self.transport.directory.alive(m.id) for m, e in publishers)

    def release(self) -> None:
        try:
            super().release()
        finally:
            self.transport.forget(self._number, self)
            with self._looking:
                for heard in self._heard.values():
                    heard.reader.close()
                self._heard.clear()
            if self._receipts:
                self._receipts.close()

    def on_input(self, *, one: bool = False) -> tuple[Job, ...]:
        taken = 0
        all_heard = tuple(self._heard.values())
        if len(all_heard) > 1:
            self._turn = turn = (self._turn + 1) % len(all_heard)
            all_heard = all_heard[turn:] + all_heard[:turn]
        for heard in all_heard:
            for _ in range(min(BATCH, self._depth)):
                self._paused = True  # before the check: a thread that makes room later sees this, and resumes
                self._paused = self._lane.full
                message = None if self._paused else heard.reader.read()
                if message is None:
                    break
                taken += self._take(heard, message)
                if one:
                    break
                if heard.reader.spent:  # what follows would be copied; once the handler had these, it need not be
                    self.transport.attend(self)
                    break
            else:
                self.transport.attend(self)
            if not one:
                self._note(heard)
            elif taken:
                break
        if one:
            self.transport.afterwards(self._look_round)
        return (self._drain,) if taken else ()

    def _look_round(self) -> None:
        """After a message was delivered: tell its publisher, and read further messages."""
        for heard in tuple(self._heard.values()):
            self._note(heard)
            if not self._paused and heard.reader.has_more():
                self.transport.attend(self)

    def _note(self, heard: _Heard) -> None:
        """Tell a publisher which messages were taken."""
        if self._receipts and heard.last != heard.noted:
            heard.noted = heard.last
            if self._receipts.took(heard.source, heard.last):
                heard.call()

    def _begin(self, key: tuple[str, str], member: Member, channel: str) -> None:
        """Connect to a publisher. If that fails, it is tried again while the publisher exists."""
        number, source = key[1].split("/")
        waker = self.transport.waker(member)
        if waker is None:
            return
        missed = self.channel.qos.depth if self.channel.qos.latched else 0
        with contextlib.ExitStack() as undo:
            if self._receipts:
                self._receipts.begin(int(source, 16))
                undo.callback(self._receipts.end, int(source, 16))
            try:
                topic = self.transport.node.topic(f"{member.id}.{number}", missed)
            except TransportError as exc:
                if self.transport.directory.alive(member.id):
                    raise TransportError(f"{channel}: {exc}") from exc
                return
            if topic is None:  # its publisher opens it once it has seen us, and wakes us then
                waker.wake(LOOK)
                return
            undo.pop_all()
        service, port = topic
        reader = Reader(port, _share(service), self.transport.node.heaps)
        self.transport.node.heaps.meet(packed(member.id))  # to read its last messages even after it has left
        self._heard[key] = _Heard(
            service, reader, channel, int(source, 16), partial(waker.wake, wakeup_of(int(number)))
        )
        waker.wake(wakeup_of(int(number)))

    def reconnect(self) -> None:
        """Subscribe again to the publishers from which nothing was received."""
        with self._looking:
            for key in [key for key, heard in self._heard.items() if not heard.last]:
                self._hear_out(self._heard.pop(key))
        self.look()

    def _hear_out(self, heard: _Heard) -> None:
        """A publisher has left: read its last messages."""
        taken = 0
        with contextlib.suppress(TransportError):
            while (message := heard.reader.read()) is not None:
                taken += self._take(heard, message)
        heard.reader.close()
        if self._receipts:
            self._receipts.end(heard.source)
        if taken:
            self.transport.do(self._drain)

    def _take(self, heard: _Heard, message: Message) -> bool:
        try:
            header = publication_at(message.octets, HEAD_BYTES)
        except DecodeError as exc:
            self.malformed(exc)
            return False
        if header.fingerprint == self._fingerprint:
            heard.last = header.sequence
        payload = self.admitted(heard.channel, header, message.payload)
        return payload is not None and self._lane.put(payload)

    def _drain(self) -> None:
        self._lane.drain()
        if self._paused:
            self.transport.attend(self)


class _Heard:
    """A publisher, as its subscriber knows it."""

    def __init__(self, service: Any, reader: Reader, channel: str, source: int, call: partial[bool]) -> None:
        self.service, self.reader, self.channel, self.source, self.call = service, reader, channel, source, call
        self.last = self.noted = 0
        """The number of its last message, and of the last one that it knows to be taken."""


def _share(service: Any) -> int:
    """How many messages one of its readers may keep."""
    readers: int = service.dynamic_config.number_of_subscribers
    return max(1, min(SHARE, SHARE * SHARES // max(1, readers)))
