"""The sockets and feeds of a transport, and the loop that receives from all of them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import zmq

from ...errors import TransportError
from ..leader_followers import Job
from ..memory import keep_memory
from .bounds import Kind
from .curve import WATCHED, Secure
from .guard import Guard
from .sockets import Feeding, Loop, Socket, Subscription, as_transport_error, new_socket


class Reactor:
    """Opens sockets, whose input the receiving threads handle from then on. Safe to use from any thread."""

    def __init__(self, tick: Callable[[], float], owner: str) -> None:
        """`tick` does what is due, and returns the seconds until the next time. Raises TransportError."""
        keep_memory()
        self._owner = owner
        with as_transport_error("opening a context"):
            self.context = zmq.Context()
        try:
            self._loop = loop = Loop(tick)
        except OSError as exc:
            self.context.term()
            raise TransportError(f"zeromq: opening a pipe: {exc.strerror}") from exc
        self.guard: Guard | None = None
        """Watches the connections of other hosts, if there may be some."""
        self.add, self.receive, self.wake = loop.add, loop.receive, loop.wake
        """See `Loop`."""
        self.attend, self.rest = loop.attend, loop.rest
        """See `Loop`."""
        self.within = loop.within
        """Has links tick soon; for what is called when there is input."""
        self.do = loop.do
        """Has a receiving thread run a job."""

    def start_guard(self) -> None:
        """Watch the connections of other hosts from now on."""
        self.guard = Guard(self.context, self._owner)

    def close_sockets(self) -> None:
        with contextlib.ExitStack() as everything:
            for socket in self._loop.sockets():  # those of links that could not be closed
                everything.callback(socket.close)

    def close(self) -> None:
        """Called after all sockets are closed."""
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self._loop.close)
            everything.callback(self.context.term)
            if self.guard:
                everything.callback(self.guard.close)

    def close_unstarted(self) -> None:
        """The same if no thread has begun to receive."""
        for each in self._loop.sockets():
            each.close()
        if self.guard:
            self.guard.close()
        self.context.destroy(linger=0)
        self._loop.close()

    def socket(
        self,
        kind: int,
        on_input: Callable[[Socket], list[Job]],
        secure: Secure | None = None,
        watched: bool = True,
        /,
        **options: int,
    ) -> Socket:
        """A shared socket. The receiving threads handle its input from now on; if not `watched`, on request."""
        socket = Socket(new_socket(self.context, kind, secure, **options), on_input, self._loop.attend)
        self._loop.add(socket, watched=watched)
        return socket

    def subscription(self, feed: Feeding, on_input: Callable[[Subscription], list[Job]]) -> Subscription:
        """A feed, whose input the receiving threads handle from now on."""
        subscription = Subscription(feed, on_input)
        self._loop.add(subscription)
        return subscription

    def forget(self, socket: Socket | Subscription) -> None:
        with socket.lock:
            self._loop.remove(socket)
            if self.guard and isinstance(socket, Socket) and socket.watched:
                self.guard.forget(socket.watched)
            socket.close()

    def watch(
        self, socket: Socket, kind: Kind = Kind.MESSAGES, told: Callable[[list[bytes]], object] | None = None
    ) -> None:
        """Have the guard watch the connections of a socket that leads to other hosts, before it is connected or bound.

        `told` is called with the events of connections that were not let in.
        """
        if self.guard:
            socket.watched = self.guard.watch(socket.raw, kind, told=told, also=WATCHED if told else 0)

    def mute(self, subscription: Subscription) -> None:
        """Ignore its input until `hear` is called."""
        with subscription.lock:
            self._loop.mute(subscription)

    def hear(self, subscription: Subscription) -> None:
        """Go on to receive, from this one before the others."""
        with subscription.lock:
            if not subscription.closed:
                self._loop.add(subscription, first=True)
