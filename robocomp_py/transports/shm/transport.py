"""The transport: its links, its mail, its threads."""

from __future__ import annotations

import atexit
import contextlib
import logging
import time
from collections.abc import Iterator
from pathlib import Path

from ...contract.interface import Pattern
from ...errors import Closed, TransportError
from ...wire.codec import Codec
from ...wire.header import random_id
from ..announced import Announcing
from ..base import ANY_QOS, Capability, Channel, Service, Sink, TransportConfig, options_of
from ..crew import Crew, Job, abandoned
from ..directory import Directory, Member, runtime_dir
from ..exclusive import sweep
from ..inotify import Watch
from ..served import CommandInlet, Server, ServingLink
from .asking import Caller, CommandOutlet, Peer
from .bells import Bell, Rope, bell_of, bell_path
from .codec import ApartCdr
from .desk import Desk
from .loop import TICK, Attending, Loop
from .mail import LINGER, Line, Mailbox
from .node import Node
from .samples import let_go
from .topics import Publisher, Subscriber

log = logging.getLogger("robocomp.transport.shm")

IDLE_TICK = 1.0
"""Seconds between two looks at what should be as it was."""

ROLL_CALL = 1.0
"""Seconds between two looks whether those we deal with still live; who is killed does not take leave."""

BURYING = 0.5
"""Seconds after which what the dead have left is removed."""


class ShmTransport(Announcing):
    """Takes no options."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        options_of(config)
        self.codec: Codec = ApartCdr()
        self.incarnation = random_id()
        self.owner, self.folder = config.owner, runtime_dir() / "shm"
        self.served = self.folder / "served"
        self._numbers = 0
        self._lines = 0
        self._ropes: dict[str, Rope] = {}
        self._peers: dict[str, Peer] = {}
        self._bury_at = 0.0
        self._call_at = 0.0
        self._settled = self._settled_together = float("inf")
        self.directory = Directory(self.folder)
        with contextlib.ExitStack() as undo:
            self.member = self.directory.join(config.owner)
            undo.callback(self.member.close)
            self.node = Node(self.folder)
            sweep(self.served)
            undo.callback(self.node.close)
            self._watch = Watch(self.folder)
            undo.callback(self._watch.close)
            path = bell_path(self.folder, self.member.id)
            self._bell = Bell(path, self._watch)
            undo.callback(self._bell.close)
            self._own = Rope(path)
            undo.callback(self._own.close)
            self._mailbox = Mailbox(self.node, self.member.id)
            undo.callback(self._mailbox.close)
            self.desk = Desk(self, self._mailbox)
            self._loop = Loop(self._bell, self._own, self._tick, self.desk.open_next)
            self.afterwards = self._loop.afterwards
            self.directory.heed(self._watch, self._loop.wake)
            self._crew = Crew("shm", self._loop.receive, self._loop.wake)
            undo.pop_all()
        self._crew.start()

    def outlet(self, channel: Channel) -> Publisher | CommandOutlet:
        kind = Publisher if channel.pattern is Pattern.PUBLISH else CommandOutlet
        return self._open(kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> Subscriber | CommandInlet:
        kind = Subscriber if channel.pattern is Pattern.PUBLISH else CommandInlet
        return self._open(kind(self, channel, sink))

    def caller(self, channel: Channel) -> Caller:
        return self._open(Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> Server:
        return self._open(Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
            self._settled = min(self._settled_together, time.monotonic() + LINGER)
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self._leave)
            everything.callback(self._let_go)
            everything.callback(self.desk.close)
            everything.callback(self._crew.close)
            everything.callback(self.member.close)
            everything.callback(self.directory.heed_no_more)
            everything.callback(self._settle)
            for link in list(self._links):
                everything.callback(link.close)

    def _settle(self) -> None:
        with self._lock:
            peers = list(self._peers.values())
        for peer in peers:
            try:
                peer.settle(self.settling())
            except TransportError:  # they have what they have
                log.debug("%s: closing without knowing what was taken", self.owner, exc_info=True)

    def _leave(self) -> None:
        _left[self.folder] = self.node
        self.node.close()

    def _let_go(self) -> None:
        with self._lock:
            held: list[Peer | Rope] = [*self._peers.values(), *self._ropes.values()]
            self._peers.clear()
            self._ropes.clear()
        for each in (*held, self._mailbox, self._own, self._bell, self._watch):
            each.close()

    # What links use.

    def number(self) -> int:
        """A new number for a link."""
        with self._lock:
            self._numbers += 1
            return self._numbers

    def attend_to(self, number: int, link: Attending) -> None:
        """Have the link of that number attended to from now on whenever its bell is rung."""
        self._loop.add(bell_of(number), link)

    def attend(self, link: Attending) -> None:
        self._loop.attend(link)

    def forget(self, number: int, link: Attending) -> None:
        self._loop.remove(bell_of(number), link)

    def rope(self, member: Member) -> Rope | None:
        """By which somebody's bell is rung; None if he has just left."""
        with self._lock:
            if self.closed:
                raise Closed("the transport is closed")
            if member.id not in self._ropes:
                try:
                    self._ropes[member.id] = Rope(bell_path(self.folder, member.id))
                except TransportError:
                    if self.directory.alive(member.id):
                        raise
                    return None
            return self._ropes[member.id]

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        self._settled_together = float("inf")
        with super().gathering():
            yield

    def settling(self) -> float:
        """Until when somebody who closes may wait for what was sent last to be taken; all that close together, and the
        transport if it is closed after them, have the same time."""
        settled = min(self._settled, time.monotonic() + LINGER)
        if self.gathers:
            settled = self._settled_together = min(self._settled_together, settled)
        return settled

    def peer(self, member: Member) -> Peer | None:
        """Somebody who serves; None if he has just left."""
        with self._lock:
            if self.closed:
                raise Closed("the transport is closed")
            if member.id not in self._peers:
                try:
                    self._peers[member.id] = Peer(self, member)
                except TransportError:
                    if self.directory.alive(member.id):
                        raise
                    return None
            return self._peers[member.id]

    def new_line(self) -> Line:
        with self._lock:
            self._lines += 1
            number = self._lines
        return Line(self.node, self.member.id, number)

    def drop(self, peer: Peer) -> None:
        """Its process is dead: nobody we wait for there will answer."""
        with self._lock:
            self._peers.pop(peer.id, None)
        peer.close()
        self.died()

    def receipts(self, member_id: str, number: int) -> Path:
        """Where that link of that transport notes what it has read."""
        return self.folder / f"{member_id}-{number}"

    def died(self) -> None:
        """Somebody was killed: what he has left is removed soon."""
        self._bury_at = self._bury_at or time.monotonic() + BURYING

    def wake(self) -> None:
        self._loop.wake()

    def look_soon(self) -> None:
        self._loop.wake()

    def do(self, job: Job) -> None:
        """Have the crew run this."""
        self._loop.do(job)

    def enlist(self, link: ServingLink) -> str:
        number = self.number()
        self.desk.serving[number] = link
        return str(number)

    def delist(self, link: ServingLink) -> None:
        if link.address:
            self.desk.serving.pop(int(link.address), None)

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        if abandoned():
            log.warning("%s: not closed at the end of the program; closing", self.owner or "shm")
            self.close()
            return TICK
        version = self.directory.version()
        if version != self._known or time.monotonic() >= self._call_at:
            self._call_at = time.monotonic() + ROLL_CALL
            self._forget_the_gone()
        waits = self._look_after(version)
        if self._bury_at and time.monotonic() >= self._bury_at:
            self._bury_at = 0.0
            self.node.bury()
            sweep(self.served)
            self._known = -1  # publishers let go of readers that are gone when they look who is there
        if self._bury_at:
            waits.append(max(0.0, self._bury_at - time.monotonic()))
        usual = self.directory.pause or IDLE_TICK if self._known == version else TICK
        return min([usual, *waits])

    def _forget_the_gone(self) -> None:
        with self._lock:
            known = self._ropes.keys() | self._peers.keys() | self.desk.correspondents()
        for member_id in known:
            if not self.directory.alive(member_id):
                with self._lock:
                    held = [self._ropes.pop(member_id, None), self._peers.pop(member_id, None)]
                for each in held:
                    if each:
                        each.close()
                self.desk.drop(member_id)
                self.died()


_left: dict[Path, Node] = {}
"""By its folder, the node that was closed last. What was received by it may still be looked at."""


@atexit.register
def _end() -> None:
    """Of a process that keeps what it received to its end, nothing stays either."""
    if _left:
        let_go()
    for node in _left.values():
        with contextlib.suppress(TransportError):
            node.close()
