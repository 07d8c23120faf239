"""The server's links: a command inlet and a server."""

from __future__ import annotations

import contextlib
import logging
import math
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
from ..senders import From
from ..turns import Turns
from .bus import Reader, Writer
from .client import client_of
from .endpoints import Endpoint
from .library import LARGE
from .link import DISCOVERY_PAUSE, INTAKE, Link
from .qos import KEEP_ALL, endpoint_qos
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
    from .core import DDSCore

log = logging.getLogger("robocomp.transport.dds")

REPLY_EXPIRY = 60.0
"""Seconds for which a reply without deadline waits for a client that cannot be reached yet."""


_FOREVER = math.inf

_OLDEST = 60.0
"""A request that seems to be older than this many seconds is not: the clock was set."""

_FINE = Status.OK
"""Attribute access to the enumeration is slower."""

LEAVING = 2.5
"""Seconds until DDS reports that a previous server has gone, even if it was killed: its lease lasts two seconds."""

_LEAVING_DEAD = 10.0
"""Further seconds for the same, if the previous server's process is known to be dead: the report may be late."""

_Call = tuple[int, int]
"""Client and number of a request."""

_Queued = tuple[_Call, Payload, float]
"""A request's identity, payload and expiry time."""


class ServerLink(Link):
    ordered: bool
    claimed: Claim | None = None

    def __init__(self, transport: DDSCore, channel: Channel) -> None:
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
            if monotonic() >= end + (_LEAVING_DEAD if dead else 0.0):
                raise AlreadyServed.by(channel.name, f"{others[0].owner} (pid {others[0].pid})")
            self.closed.wait(0.005)
        if channel.lazy:
            self.transport.announcing.add(self.id, self.said())
        else:
            self.open_reader()

    def open_reader(self) -> None:
        """Make the reader of requests."""
        kind = self.channel.type
        made = request_type(kind.name, kind.request)
        requests = self.bus.reader(f"rc/{self.channel.name}Request", made, endpoint_qos(KEEP_ALL, self.about()))
        self._requests = requests
        self.bus.loop.attach(requests.condition, partial(self.accept, requests))

    def peers_changed(self, there: list[Endpoint]) -> None:
        if self._requests is None and self.bus.endpoints.on_topic(f"rc/{self.channel.name}Request"):
            self.open_reader()

    def accept(self, requests: Reader) -> Iterable[Job]:
        """Queue or refuse the arrived requests; returns jobs that handle the queue."""
        raise NotImplementedError

    def refuse(self, request: Request) -> None:
        """Refuse a request with another contract."""

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
            self._requests.close()
        if self.claimed:
            self.claimed.close()
        if self.channel.lazy:
            self.transport.announcing.remove(self.id)  # last: it may fail, as it may make a writer

    def read(self, sample: bytes) -> _Queued | None:
        """A valid, new request with our contract; None for any other."""
        message = self._message
        try:
            fields = request_fields(sample)
            start, flags, ms, fingerprint, client, sequence, stamp = fields
            if start != START:
                raise unreadable(sample)
            if fingerprint != self._fingerprint:
                request = Request._make(fields)
                self.meet_stranger((client, fingerprint), fingerprint)
                self.refuse(request)
                return None
            payload = sample if message.plain else message.payload(sample)
        except (DecodeError, struct.error) as exc:
            self.malformed(exc)
            return None
        if self.channel.signed:
            payload = From(partial(self._owner_of, client), payload)
        if self._ledger.admit(client, sequence) or (flags & Flag.IDEMPOTENT and self.forgotten((client, sequence), ms)):
            if ms == NO_DEADLINE:
                return (client, sequence), payload, _FOREVER
            left = ms / 1000
            if self.transport.local:
                open_requests = (time_ns() - stamp) / 1e9
                left -= open_requests if 0.0 < open_requests < _OLDEST else 0.0
            return (client, sequence), payload, monotonic() + left
        return None

    def forgotten(self, call: _Call, remaining_ms: int) -> bool:
        """Whether a repeated request has to be executed again, since its reply is not kept any more."""
        return False

    def _owner_of(self, client: int) -> str:
        """The instance that opened a client; "" if it is not ours."""
        found = self.transport.find(self.facing, self.channel.name)
        return next((each.owner for each in found if each.id == client), "")


class CommandInlet(ServerLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: DDSCore, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._lane = CommandLane(channel.name, sink, self.stats)

    def accept(self, requests: Reader) -> Iterable[Job]:
        for sample, info in requests.take(INTAKE):
            queued = self.read(sample) if info.valid_data else None
            if queued is not None:
                self._lane.take(queued[1], queued[2])
        return [self._lane.drain] if self._lane.summon() else []

    def release(self) -> None:
        try:
            super().release()
        finally:
            self._lane.close()


class Server(ServerLink):
    """Serves the clients in turn, one request at a time; other links get their turn between two requests.

    A reply waits until its client's reader is known, because a sample written before that is lost.
    """

    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: DDSCore, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._servant = Servant(channel.name, service, self.stats)
        self._response = Message(channel.type.response)
        self._incarnation = transport.incarnation
        self._writers: dict[str, Writer] = {}
        """The writer in each partition."""
        self._clients: dict[int, Writer] = {}
        """The writer for each client that it reaches."""
        self._foreign_clients = False
        """Whether there are clients that do not use our partitions."""
        self._deferred: list[tuple[float, int, bytearray]] = []
        """Replies that wait for their client's reader: expiry time, client, sample."""
        self._order = threading.Lock()
        self._waiting: Turns[_Queued] = Turns()
        self._open_requests: dict[_Call, float] = {}
        """Expiry time of each request that waits or is being served."""
        self._refusals: deque[tuple[_Call, float, Reply]] = deque(maxlen=QUERIES_WAITING)
        self._full_until = 0.0
        """While there are too many open requests: when the next of them expires."""
        self._replies = Replies() if channel.idempotent else None
        self._beginning = self._refusing = False
        """Whether a job for `_begin`, or for `_send_refusals`, is queued."""

    def open_reader(self) -> None:
        super().open_reader()
        self._writers[""] = self._writer("")  # for clients that do not use our partitions

    def peers_changed(self, there: list[Endpoint]) -> None:
        super().peers_changed(there)
        if self._requests is None:
            return
        ends = self.bus.endpoints.on_topic(f"rc/{self.channel.name}Reply")
        partitions = {endpoint.partition for endpoint in ends if not endpoint.writes}
        self._foreign_clients = "" in partitions
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
                writer.write(sample)  # a new reader has room
            else:
                with self._order:
                    self._deferred.append((expires, client, sample))

    def tick(self) -> float | None:
        now = monotonic()
        with self._order:
            self._deferred = [each for each in self._deferred if each[0] > now]
            return min((expires - now for expires, _, _ in self._deferred), default=None)

    def accept(self, requests: Reader) -> Iterable[Job]:
        samples, open_requests = requests.take(INTAKE), self._open_requests
        for sample, info in samples:
            queued = self.read(sample) if info.valid_data else None
            if queued is None:
                continue
            call, _, expires = queued
            if len(open_requests) >= QUERIES_WAITING and not self._forget_expired():
                self.stats.dropped += 1
                self._refusals.append((call, expires, Reply(Status.BUSY)))
                continue
            open_requests[call] = expires
            if len(samples) == 1 and not self._waiting:
                return (partial(self._serve, queued),)  # the usual case
            self._waiting.add(call[0], queued)
        return self._jobs()

    def refuse(self, request: Request) -> None:
        if not request.flags & Flag.ONEWAY:
            text = dressed(self.channel.type.text.encode())
            call = request.client, request.sequence
            self._refusals.append((call, monotonic() + REPLY_EXPIRY, Reply(Status.MISMATCH, text)))

    def forgotten(self, call: _Call, remaining_ms: int) -> bool:
        if self._replies is None or call in self._open_requests:
            return False
        reply = self._replies.find(call)
        if reply:
            self._refusals.append((call, monotonic() + min(remaining_ms / 1000, REPLY_EXPIRY), reply))
        return reply is None

    def _jobs(self) -> list[Job]:
        """Jobs for waiting requests and refusals, unless such jobs are queued."""
        jobs: list[Job] = []
        if self._waiting and not self._beginning:
            self._beginning = True
            jobs.append(self._begin)
        if self._refusals and not self._refusing:
            self._refusing = True
            jobs.append(self._send_refusals)
        return jobs

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
        self._servant.close()
        for writer in self._writers.values():
            writer.close()  # before the reader: when that goes, clients expect no further replies
        super().release()

    def _begin(self) -> None:
        """Serve the next request, and queue a job for the one after it."""
        try:
            queued = self._waiting.take()
        except IndexError:  # another thread has taken it
            return
        finally:
            self._beginning = False  # before the check: a thread that adds one later sees this
            if self._waiting:
                for job in self._jobs():
                    self.bus.loop.do(job)
        self._serve(queued)

    def _send_refusals(self) -> None:
        self._refusing = False
        with contextlib.suppress(IndexError):  # another thread may send them, too
            while True:
                self._answer(*self._refusals.popleft())

    def _forget_expired(self) -> bool:
        """Forget expired requests that were never answered; returns whether there is room now."""
        now = monotonic()
        if now < self._full_until:
            return False
        open_requests = list(self._open_requests.items())
        for key, expires in open_requests:
            if expires <= now:
                self._open_requests.pop(key, None)
        self._full_until = min((expires for _, expires in open_requests if expires > now), default=0.0)
        return len(self._open_requests) < QUERIES_WAITING

    def _serve(self, queued: _Queued) -> None:
        call, payload, expires = queued
        answer = partial(self._answer, call, expires)
        if not self._servant.serve(payload, expires, answer):
            answer(Reply(Status.REFUSED))

    def _answer(self, call: _Call, expires: float, reply: Reply) -> None:
        if self._replies is not None:  # before the pop: a retry finds the request either open or answered
            self._replies.keep(call, reply)
        self._open_requests.pop(call, None)
        client, sequence = call
        status, payload = reply
        response = self._response
        try:
            if status is not _FINE:
                sample = response.failure(payload)
            else:
                sample = payload if response.plain and type(payload) is bytearray else response.sample(payload)
            writer = self._clients.get(client)
            if len(sample) < LARGE:  # one payload may answer several requests: a copy is faster than a lock
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
        """Send a reply for which there was no room, or which has to wait for its client's reader."""
        now = monotonic()
        expires = max(now + DISCOVERY_PAUSE, min(expires, now + REPLY_EXPIRY))
        writer = self._clients.get(client)
        if writer is None:
            if self._foreign_clients:
                self._writers[""].write(sample)
            with self._order:
                self._deferred.append((expires, client, sample))
                if len(self._deferred) > QUERIES_WAITING:
                    del self._deferred[0]
                    self.stats.dropped += 1
            if client in self._clients:  # it has just come: the earlier deferred replies were sent
                self._send_deferred()
            self.bus.loop.due(expires)
        elif not writer.write_within(sample, expires, self._pause) and self._sparing.may_tell():
            log.warning("%s: a reply was dropped: the client has no room for it", self.channel.name)

    def _pause(self) -> None:
        self.check_open()
        about_to_block()

    def _writer(self, partition: str) -> Writer:
        kind = self.channel.type
        made = reply_type(kind.response.name if kind.response else kind.name, kind.response)
        about = self.about("answers")
        return self.bus.writer(f"rc/{self.channel.name}Reply", made, endpoint_qos(KEEP_ALL, about), partition)
