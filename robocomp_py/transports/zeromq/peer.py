"""A server process, as the links of its clients use it."""

from __future__ import annotations

import contextlib
import logging
from functools import partial
from typing import Any

import zmq

from ...errors import (
    DecodeError,
    TransportError,
)
from ...wire.header import (
    Flag,
)
from ..client import CallingLink
from ..directory import Directory
from ..leader_followers import Job
from .curve import Secure
from .frames import read_reply_frames
from .reactor import Reactor
from .remote import FarStream, is_far, to_far
from .sockets import Socket, as_transport_error
from .zmtp import Gone, Stream, Wait

log = logging.getLogger("robocomp.transport.zeromq")

_GREETINGS = 3
"""Attempts to connect if the server hangs up during the handshake, as it does if this process is delayed."""

_TO_SERVER = {"IMMEDIATE": 1, "RECONNECT_IVL": -1, "SNDHWM": 1000, "RCVHWM": 1000}
"""No queueing for a dead server; one that comes back has another address."""


class Peer:
    """A server process: a shared connection to it, and streams for blocking calls."""

    def __init__(
        self, reactor: Reactor, directory: Directory, member_id: str, address: str, secure: Secure | None = None
    ) -> None:
        self.id = self.key = member_id
        self._reactor, self._directory = reactor, directory
        self._address, self._secure = address, secure
        self.closed, self.is_far = False, is_far(address)
        self.flags = Flag.NONE
        """The flags of all requests to it."""
        self.callers: dict[int, CallingLink[Any, Any, Any]] = {}
        self._idle: list[Stream | FarStream] = []
        options = _TO_SERVER | (to_far(address) if self.is_far else {})
        self.line = reactor.socket(zmq.DEALER, self._on_reply, secure, **options)
        if self.is_far:
            reactor.watch(self.line)
        with as_transport_error(f"connecting to {address}"), self.line.lock:
            self.line.raw.connect(address)

    def alive(self) -> bool:
        return not self.closed and self._directory.alive(self.id)

    def take(self, wait: Wait) -> Stream | FarStream:
        """A stream for the calling thread alone; it must `give` it back, or close it. Raises Gone."""
        try:
            return self._idle.pop()
        except IndexError:
            pass
        if self.closed:
            raise Gone("it was closed")
        if self.is_far:
            return FarStream(self._reactor, self._address, self._secure)
        try:
            return self._stream(wait)
        except TransportError:  # from `wait`; some are OSErrors, too
            raise
        except (ConnectionError, FileNotFoundError) as exc:
            raise Gone(str(exc)) from exc
        except OSError as exc:
            raise TransportError(f"zeromq: connecting to {self._address}: {exc.strerror}") from exc

    def _stream(self, wait: Wait) -> Stream:
        path = self._address.removeprefix("ipc://")
        for _ in range(_GREETINGS - 1):
            with contextlib.suppress(Gone):
                return Stream(path, wait)
            wait()
        return Stream(path, wait)

    def give(self, stream: Stream | FarStream) -> None:
        self._idle.append(stream)
        if self.closed:
            self._close_idle()

    def close(self) -> None:
        self.closed = True
        self._close_idle()
        self._reactor.forget(self.line)

    def _close_idle(self) -> None:
        """Close idle streams one by one, since other threads may add or take some meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()

    def _on_reply(self, socket: Socket) -> list[Job]:
        jobs: list[Job] = []  # callbacks of a Future may take long, or make calls
        while (frames := socket.receive()) is not None:
            try:
                header, payload = read_reply_frames(frames)
            except DecodeError as exc:
                log.warning("%s: dropped a malformed reply: %s", self._address, exc)
                continue
            caller = self.callers.get(header.client)
            if caller:
                jobs.append(partial(caller.answered, self.key, header, payload))
        return jobs
