"""What the links of this transport share: its queues and threads."""

from __future__ import annotations

import atexit
import contextlib
import logging
import math
import re
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

from ...errors import TransportError
from ...wire.codec import Codec
from ...wire.header import random_id
from ..base import ANY_QOS, Capability, TransportConfig, options_of
from ..directory import Directory
from ..directory_transport import Reached
from ..exclusive import sweep
from ..inotify import Watch
from ..leader_followers import Job, LeaderFollowers
from ..limits import IDLE_TICK
from ..members import Found, Member
from ..runtime_folder import runtime_dir
from ..server import ServingLink, ServingTransport
from .codec import ApartCdr
from .dispatcher import Dispatcher
from .loop import TICK, Attending, Loop
from .node import Node
from .peer import Peer
from .queues import LINGER, InputQueue, ReplyQueue, packed
from .receipts import OPENED
from .room import FILES, spare_files
from .samples import let_go
from .wakeup import QUEUED, Waker, Wakeup, wakeup_of, wakeup_path

log = logging.getLogger("robocomp.transport.shm")

BURYING = 0.5
"""Seconds after which the remains of dead processes are removed."""


@runtime_checkable
class Reconnects(Protocol):
    """A link that has to connect again if there were too few descriptors."""

    def reconnect(self) -> None: ...


_ADDRESS = re.compile(r"[0-9]{1,9}(/([0-9a-f]{16}|counted))?")
"""What links announce as their addresses; anything else comes from another program."""

_ADDRESSED = ("serves", "receives", "publishes", "subscribes")
"""The roles of links that have an address."""


class ShmCore(ServingTransport):
    """The transport without the classes of its links."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        options_of(config)
        self.codec: Codec = ApartCdr()
        self.incarnation = random_id()
        self.owner, self.folder = config.owner, runtime_dir("shm")
        self.served = self.folder / "served"
        self._numbers = 0
        self._lines = 0
        self._wakers: dict[str, Waker] = {}
        self._bury_at, self._is_burying = 0.0, False
        self._was_short = False
        """Whether this process could open no file at the last look."""
        self._settled = self._settled_together = math.inf
        self.directory = Directory(self.folder)
        with contextlib.ExitStack() as undo:
            self.member = self.directory.join(config.owner)
            undo.callback(self.member.close)
            self.node = Node(self.folder, packed(self.member.id))
            sweep(self.served)
            undo.callback(self.node.close)
            self._watch = Watch(self.folder)
            undo.callback(self._watch.close)
            path = wakeup_path(self.folder, self.member.id)
            self._wakeup = Wakeup(path, self._watch)
            undo.callback(self._wakeup.close)
            self._own = Waker(path)
            undo.callback(self._own.close)
            self._queue = InputQueue(self.node, self.member.id)
            undo.callback(self._queue.close)
            self.dispatcher = Dispatcher(
                self._queue,
                self.node,
                self.directory,
                packed(self.member.id),
                self.incarnation,
                self.receipts(self.member.id, OPENED),
                self.do,
            )
            self._loop = Loop(self._wakeup, self._own, self._tick, self.dispatcher.open_next)
            self.afterwards = self._loop.afterwards
            self.directory.watch(self._watch, self._loop.wake)
            self._threads = LeaderFollowers("shm", self._loop.receive, self._loop.wake)
            undo.pop_all()
        self._threads.start(self.close)

    def release(self, everything: contextlib.ExitStack) -> None:
        self._settled = min(self._settled_together, time.monotonic() + LINGER)
        everything.callback(self._leave)
        everything.callback(self._let_go)
        everything.callback(self.dispatcher.close)
        everything.callback(self._threads.close)
        everything.callback(self.member.close)
        everything.callback(self.directory.stop_watching)
        everything.callback(self._settle)

    def _settle(self) -> None:
        for peer in self.known_peers():
            try:
                peer.settle(self.settling())
            except TransportError:  # closing goes on all the same
                log.debug("%s: closing without knowing what was taken", self.owner, exc_info=True)

    def _leave(self) -> None:
        _left[self.folder] = self.node
        self.node.close()

    def _let_go(self) -> None:
        with self._lock:
            held: list[Peer | Waker] = [*self._peers.values(), *self._wakers.values()]
            self._peers.clear()
            self._wakers.clear()
        for each in (*held, self._queue, self._own, self._wakeup, self._watch):
            each.close()

    # What links use.

    def number(self) -> int:
        """A new number for a link."""
        with self._lock:
            self._numbers += 1
            return self._numbers

    def attend_to(self, number: int, link: Attending) -> None:
        """Serve the link of that number whenever its wake-up number arrives."""
        self._loop.add(wakeup_of(number), link)

    def attend(self, link: Attending) -> None:
        self._loop.attend(link)

    def forget(self, number: int, link: Attending) -> None:
        self._loop.remove(wakeup_of(number), link)

    def waker(self, member: Member) -> Waker | None:
        """Wakes that member; None if it has just left."""
        with self._lock:
            self.check_open()
            if member.id not in self._wakers:
                try:
                    self._wakers[member.id] = Waker(wakeup_path(self.folder, member.id))
                except TransportError:
                    if self.directory.alive(member.id):
                        raise
                    return None
            return self._wakers[member.id]

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        self._settled_together = math.inf
        with super().gathering():
            yield

    def settling(self) -> float:
        """Until when a closing link may wait for its last messages to be taken. Links that close together share
        this time with the transport."""
        settled = min(self._settled, time.monotonic() + LINGER)
        if self.gathers:
            settled = self._settled_together = min(self._settled_together, settled)
        return settled

    def peer(self, member: Member) -> Peer | None:
        """A server process; None if it has just left."""
        try:
            own, receipts = packed(self.member.id), self.receipts(member.id, OPENED)
            make = partial(Peer, member, own, self.node, self.directory, receipts, self.new_line)
            return self.asked(packed(member.id), make)
        except TransportError:
            if self.closed or self.directory.alive(member.id):
                raise
            return None

    def new_line(self) -> ReplyQueue:
        with self._lock:
            self._lines += 1
            number = self._lines
        return ReplyQueue(self.node, self.member.id, number)

    def drop(self, peer: Reached) -> None:
        super().drop(peer)
        self.died()

    def receipts(self, member_id: str, number: int) -> Path:
        """The file in which that link of that transport notes what it has read."""
        return self.folder / f"{member_id}-{number}"

    def died(self) -> None:
        """A process was killed: remove its remains soon."""
        self._bury_at = self._bury_at or time.monotonic() + BURYING

    def wake(self) -> None:
        self._loop.wake()

    def find(self, role: str, channel: str) -> list[Found]:
        found = super().find(role, channel)
        if role not in _ADDRESSED:
            return found
        return [each for each in found if _ADDRESS.fullmatch(each.entry.address)]

    def look_soon(self) -> None:
        self._loop.wake()

    def do(self, job: Job) -> None:
        """Have a receiving thread run this."""
        self._loop.do(job)

    def enlist(self, link: ServingLink) -> str:
        number = self.number()
        self.dispatcher.serve(number, link)
        return str(number)

    def delist(self, link: ServingLink) -> None:
        if link.address:
            self.dispatcher.serving.pop(int(link.address), None)

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        if self.close_if_abandoned():
            return TICK
        version = self.directory.version()
        called = self.is_roll_call(version)
        self._look_for_files(called)
        if called:
            self._forget_the_gone()
        self.dispatcher.note()  # in case it failed before
        waits = self._look_after(version)
        if called:  # after links have read the last messages of peers that have left
            self.node.heaps.forget_left()
            self.node.heap.tidy()
        if self._bury_at and time.monotonic() >= self._bury_at:
            self._bury_at, self._is_burying = 0.0, True
        if self._is_burying:
            self._is_burying = self.node.bury()
            waits.append(0.0)
            if not self._is_burying:
                sweep(self.served)
                self._known = -1  # publishers release readers that have gone at their next look
        if self._bury_at:
            waits.append(max(0.0, self._bury_at - time.monotonic()))
        usual = self.directory.pause or IDLE_TICK if self._known == version else TICK
        return min([usual, *waits])

    def _look_for_files(self, called: bool) -> None:
        """Reconnect once there are enough descriptors again, and at each roll call as long as there are a few.

        The library connects when it receives. It needs several descriptors for that, and fails with a few left, too.
        """
        spare = spare_files(FILES)
        if self._was_short and (spare == FILES or (called and spare)):
            try:
                self._reconnect()
            except TransportError as exc:
                log.debug("%s; trying again", exc)
                return
        self._was_short = spare < FILES

    def _reconnect(self) -> None:
        """Connect to peers that came while there were no descriptors, which the library does not do itself."""
        self._queue.reconnect()
        with self._lock:
            peers, lines, links = list(self._peers.values()), self._lines, list(self._links)
        for peer in peers:
            peer.renew(lines)
        for link in links:
            if isinstance(link, Reconnects):
                link.reconnect()
        self._own.wake(QUEUED)

    def _forget_the_gone(self) -> None:
        with self._lock:
            known = self._wakers.keys() | {peer.id for peer in self.known_peers()} | self.dispatcher.correspondents()
        for member_id in known:
            if not self.directory.alive(member_id):
                with self._lock:
                    held = [self._wakers.pop(member_id, None), self._peers.pop(packed(member_id), None)]
                for each in held:
                    if each:
                        each.close()
                self.dispatcher.drop(member_id)
                self.died()


_left: dict[Path, Node] = {}
"""By folder: the node that was closed last. Messages that it received may still be in use."""


@atexit.register
def _end() -> None:
    """At the end of the process, release the messages that are still in use, so that no memory stays."""
    if _left:
        let_go()
    for node in _left.values():
        with contextlib.suppress(TransportError):
            node.close()
