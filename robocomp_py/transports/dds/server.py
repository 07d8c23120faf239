"""Who is commanded and who is called."""

from __future__ import annotations

import contextlib
import logging
import struct
import threading
from collections import deque
from collections.abc import Iterable
from functools import partial
from time import monotonic, time_ns
from typing import TYPE_CHECKING

from ...errors import (
    AlreadyServed,
    DecodeError,
    TransportError,
)
from ...wire.codec import Payload
from ...wire.header import NO_DEADLINE, Flag
from ..base import (
    Channel,
    Reply,
    Service,
    Sink,
    Status,
    about_to_block,
)
from ..exclusive import Claim, claim, is_gone
from ..leader_followers import CommandLane, Job, Servant
from ..ledger import Ledger
from ..limits import QUERIES_WAITING
from ..replies import Replies
from ..turns import Turns
from .bus import Reader, Writer
from .client import client_of
from .endpoints import Endpoint
from .library import LARGE
from .link import INTAKE, KEEP_ALL, SOON, Link, endpoint_qos
from .types import (
    START,
    Message,
    Request,
    dressed,
    fill_reply,
    reply_type,
    request_fields,
    request_type,
    unreadable,
)

if TYPE_CHECKING:
    from .transport import DDSTransport

log = logging.getLogger("robocomp.transport.dds")

PATIENCE = 60.0
"""Seconds for which a reply without deadline is kept for a client that cannot be reached yet."""


_FOREVER = float("inf")

_LONG_UNDER_WAY = 60.0
"""What seems to have been under way for longer was not, but the clock was set."""

_FINE = Status.OK
"""Finding it in its class takes longer."""

LEAVING = 2.5
"""Seconds until we have heard that who served before us is gone, even if it was killed: its lease lasts for two."""

_HEARING = 10.0
"""Seconds more until we have heard it of a process of this host of which we can see that it is dead: we may be late."""

_Call = tuple[int, int]
"""Which client's request, and its number."""

_Asked = tuple[_Call, Payload, float]
"""A request, what is asked, and when that expires."""


class ServingLink(Link):
    ordered: bool
    claimed: Claim | None = None

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._ledger = Ledger(self.stats, ordered=self.ordered)
        self._requests: Reader | None = None

    def open(self) -> None:
        channel = self.channel
        if channel.exclusive or not channel.lazy:
            self.claimed = claim(self.transport.folder, channel.name, self.transport.owner or "a component")
        end = monotonic() + LEAVING
        while others := self.bus.endpoints.find(self.role, channel.name):  # on another host, or of another user
            dead = self.transport.local and all(is_gone(each.pid) for each in others)
            if monotonic() >= end + (_HEARING if dead else 0.0):
                raise AlreadyServed(f"{channel.name}: already served by {others[0].owner} (pid {others[0].pid})")
            self.closed.wait(0.005)
        if channel.lazy:
            self.transport.announcing.add(self.id, self.said())
        else:
            self.hear()

    def hear(self) -> None:
        """Make what requests come in by."""
        kind = self.channel.type
        made = request_type(kind.name, kind.request)
        requests = self.bus.reader(f"rc/{self.channel.name}Request", made, endpoint_qos(KEEP_ALL, self.about()))
        self._requests = requests
        self.bus.loop.attach(requests.condition, partial(self.accept, requests))

    def looked(self, there: list[Endpoint]) -> None:
        if self._requests is None and self.bus.endpoints.on_topic(f"rc/{self.channel.name}Request"):
            self.hear()

    def accept(self, requests: Reader) -> Iterable[Job]:
        """Have requests wait for their turn, or turn them away; what is to be done about those that wait."""
        raise NotImplementedError

    def refuse(self, request: Request) -> None:
        """Answer one that means something else."""

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
            self._requests.close()
        if self.claimed:
            self.claimed.close()
        if self.channel.lazy:
            self.transport.announcing.remove(self.id)  # at last: it may have to make a writer for the others, and fail

    def read(self, sample: bytes) -> _Asked | None:
        """A request that means what we mean, and is new."""
        message = self._message
        try:
            fields = request_fields(sample)
            start, flags, ms, fingerprint, client, sequence, stamp = fields
            if start != START:
                raise unreadable(sample)
            if fingerprint != self._fingerprint:
                request = Request._make(fields)
                self.report_mismatch((client, fingerprint), fingerprint, self._text_of(fingerprint))
                self.refuse(request)
                return None
            payload = sample if message.plain else message.payload(sample)
        except (DecodeError, struct.error) as exc:
            self.malformed(exc)
            return None
        if self._ledger.admit(client, sequence) or (flags & Flag.IDEMPOTENT and self.forgotten((client, sequence), ms)):
            if ms == NO_DEADLINE:
                return (client, sequence), payload, _FOREVER
            left = ms / 1000
            if self.transport.local:
                under_way = (time_ns() - stamp) / 1e9
                left -= under_way if 0.0 < under_way < _LONG_UNDER_WAY else 0.0
            return (client, sequence), payload, monotonic() + left
        return None

    def forgotten(self, call: _Call, remaining_ms: int) -> bool:
        """Whether a request of an idempotent operation that was seen before has to be executed again."""
        return False

    def _text_of(self, fingerprint: int) -> str:
        found = self.transport.find(self.facing, self.channel.name)
        return next((each.text for each in found if each.fingerprint == fingerprint), "")


class CommandInlet(ServingLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: DDSTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._lane = CommandLane(channel.name, sink, self.stats)

    def accept(self, requests: Reader) -> Iterable[Job]:
        for sample, info in requests.take(INTAKE):
            asked = self.read(sample) if info.valid_data else None
            if asked is not None:
                self._lane.take(asked[1], asked[2])
        return [self._lane.drain] if self._lane.summon() else []

    def release(self) -> None:
        try:
            super().release()
        finally:
            self._lane.close()


class Server(ServingLink):
    """A reply waits until its client's reader is known: what is written before that is lost.

    One request after the other is begun, the clients by turns, and between two of them the other links have their turn,
    however many wait here.
    """

    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: DDSTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._servant = Servant(channel.name, service, self.stats)
        self._response = Message(channel.type.response)
        self._incarnation = transport.incarnation
        self._writers: dict[str, Writer] = {}
        """By partition."""
        self._clients: dict[int, Writer] = {}
        """The same, by whom they reach."""
        self._others = False
        """Whether there are clients that know nothing of our partitions."""
        self._deferred: list[tuple[float, int, bytearray]] = []
        """When they expire, and for whom they are."""
        self._order = threading.Lock()
        self._waiting: Turns[_Asked] = Turns()
        self._under_way: dict[_Call, float] = {}
        """When those that wait or are being served expire."""
        self._turned_away: deque[tuple[_Call, float, Reply]] = deque(maxlen=QUERIES_WAITING)
        self._full_until = 0.0
        """When the next of those under way expires, if there were too many when we last looked."""
        self._replies = Replies() if channel.idempotent else None
        self._beginning = self._refusing = False
        """Whether somebody will call `_begin`, and `_send_refusals`."""

    def hear(self) -> None:
        super().hear()
        self._writers[""] = self._writer("")  # whom others see, and where they read

    def looked(self, there: list[Endpoint]) -> None:
        super().looked(there)
        if self._requests is None:
            return
        ends = self.bus.endpoints.on_topic(f"rc/{self.channel.name}Reply")
        partitions = {endpoint.partition for endpoint in ends if not endpoint.writes}
        self._others = "" in partitions
        for gone in self._writers.keys() - partitions - {""}:
            self._writers.pop(gone).close()
        for new in partitions - self._writers.keys():
            self._writers[new] = self._writer(new)
        self._clients = {client: self._writers[name] for client, name in map(client_of, partitions) if client}
        self._send_deferred()

    def _send_deferred(self) -> None:
        with self._order:
            deferred, self._deferred = self._deferred, []
        for expires, client, sample in deferred:
            writer = self._clients.get(client)
            if writer:
                writer.write(sample)  # to a reader that has just come: there is room
            else:
                with self._order:
                    self._deferred.append((expires, client, sample))

    def tick(self) -> float | None:
        now = monotonic()
        with self._order:
            self._deferred = [each for each in self._deferred if each[0] > now]
            return min((expires - now for expires, _, _ in self._deferred), default=None)

    def accept(self, requests: Reader) -> Iterable[Job]:
        samples, under_way = requests.take(INTAKE), self._under_way
        for sample, info in samples:
            asked = self.read(sample) if info.valid_data else None
            if asked is None:
                continue
            call, _, expires = asked
            if len(under_way) >= QUERIES_WAITING and not self._forget_expired():
                self.stats.dropped += 1
                self._turned_away.append((call, expires, Reply(Status.BUSY)))
                continue
            under_way[call] = expires
            if len(samples) == 1 and not self._waiting:
                return (partial(self._serve, asked),)  # as it is nearly always
            self._waiting.add(call[0], asked)
        return self._jobs()

    def refuse(self, request: Request) -> None:
        if not request.flags & Flag.ONEWAY:
            text = dressed(self.channel.type.text.encode())
            call = request.client, request.sequence
            self._turned_away.append((call, monotonic() + PATIENCE, Reply(Status.MISMATCH, text)))

    def forgotten(self, call: _Call, remaining_ms: int) -> bool:
        if self._replies is None or call in self._under_way:
            return False
        reply = self._replies.find(call)
        if reply:
            self._turned_away.append((call, monotonic() + min(remaining_ms / 1000, PATIENCE), reply))
        return reply is None

    def _jobs(self) -> list[Job]:
        """What is to be done, and is not being done."""
        jobs: list[Job] = []
        if self._waiting and not self._beginning:
            self._beginning = True
            jobs.append(self._begin)
        if self._turned_away and not self._refusing:
            self._refusing = True
            jobs.append(self._send_refusals)
        return jobs

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
        self._servant.close()
        for writer in self._writers.values():
            writer.close()  # before the reader, whose leaving tells callers that nothing will come any more
        super().release()

    def _begin(self) -> None:
        """Serve the next request, and have the one after it begun, by the thread that receives then."""
        try:
            asked = self._waiting.take()
        except IndexError:  # another thread was quicker
            return
        finally:
            self._beginning = False  # before looking for more: who adds some later sees this
            if self._waiting:
                for job in self._jobs():
                    self.bus.loop.do(job)
        self._serve(asked)

    def _send_refusals(self) -> None:
        self._refusing = False
        with contextlib.suppress(IndexError):  # another thread sends them, too
            while True:
                self._answer(*self._turned_away.popleft())

    def _forget_expired(self) -> bool:
        """Whether some requests that were never answered need not be counted any more."""
        now = monotonic()
        if now < self._full_until:
            return False
        under_way = list(self._under_way.items())
        for key, expires in under_way:
            if expires <= now:
                self._under_way.pop(key, None)
        self._full_until = min((expires for _, expires in under_way if expires > now), default=0.0)
        return len(self._under_way) < QUERIES_WAITING

    def _serve(self, asked: _Asked) -> None:
        call, payload, expires = asked
        answer = partial(self._answer, call, expires)
        if not self._servant.serve(payload, expires, answer):
            answer(Reply(Status.REFUSED))

    def _answer(self, call: _Call, expires: float, reply: Reply) -> None:
        if self._replies is not None:  # first: who asks again just now finds it under way, or answered
            self._replies.keep(call, reply)
        self._under_way.pop(call, None)
        client, sequence = call
        status, payload = reply
        response = self._response
        try:
            if status is not _FINE:
                sample = response.failure(payload)
            else:
                sample = payload if response.plain and type(payload) is bytearray else response.sample(payload)
            writer = self._clients.get(client)
            if len(sample) < LARGE:  # a service may answer several with one payload, and a copy is quicker than a lock
                sample = sample[:]
                fill_reply(sample, 0, START, status, client, sequence, self._incarnation, time_ns())
                if writer and writer.write(sample):
                    return
            else:
                with self._order:
                    fill_reply(sample, 0, START, status, client, sequence, self._incarnation, time_ns())
                    if writer and writer.write(sample):
                        return
                    sample = sample[:]
            self._send_later(client, sample, expires)
        except TransportError as exc:
            if not self.closed.is_set() and self._sparing.may_tell():
                log.warning("%s: a reply was dropped: %s", self.channel.name, exc)

    def _send_later(self, client: int, sample: bytearray, expires: float) -> None:
        """Send a reply for which there was no room, or no way to the client."""
        now = monotonic()
        expires = max(now + SOON, min(expires, now + PATIENCE))
        writer = self._clients.get(client)
        if writer is None:
            if self._others:
                self._writers[""].write(sample)
            with self._order:
                self._deferred.append((expires, client, sample))
                if len(self._deferred) > QUERIES_WAITING:
                    del self._deferred[0]
                    self.stats.dropped += 1
            if client in self._clients:  # since a moment ago, and those put aside before were sent then
                self._send_deferred()
            self.bus.loop.due(expires)
        elif not writer.write_within(sample, expires, self._pause) and self._sparing.may_tell():
            log.warning("%s: a reply was dropped: who asked does not take it", self.channel.name)

    def _pause(self) -> None:
        self.check_open()
        about_to_block()

    def _writer(self, partition: str) -> Writer:
        kind = self.channel.type
        made = reply_type(kind.response.name if kind.response else kind.name, kind.response)
        about = self.about("answers")
        return self.bus.writer(f"rc/{self.channel.name}Reply", made, endpoint_qos(KEEP_ALL, about), partition)
