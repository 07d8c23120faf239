"""What all objects of a connection share: what runs, and the links to it."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from ..contract.interface import Operation
from ..contract.qos import QoS
from ..definitions import Definitions
from ..errors import Closed, RobocompError
from ..spelling import and_then, closest
from ..threads import NO_THREAD, start_thread
from ..tools.access import Access, Subscription
from ..tools.far import FarLink
from ..tools.hosts import Hosts
from ..tools.network import Channel, Network
from ..transports.base import Transport, TransportConfig, find_transport
from ..transports.leader_followers import STUCK, abandoned
from ..wire.cdr import Cdr
from ..wire.codec import Codec, Payload
from .channels import transport_channel
from .values import Types

log = logging.getLogger("robocomp.client")

T = TypeVar("T")

OWNER = "script"
"""How others see a script."""

_LOOK = 0.1
"""Seconds between two looks at whether the program has ended."""


class NotThere(RobocompError, AttributeError, KeyError):
    """Nothing of this name runs now; the text has the closest name."""

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError would show it in quotes


class Session:
    """What all objects of one connection share."""

    def __init__(
        self,
        network: str,
        middlewares: Sequence[str],
        timeout: float,
        owner: str = OWNER,
        keys: str | None = None,
        include: Sequence[Path] = (),
    ) -> None:
        """`include` are folders of IDSL files, for contracts that nothing announces."""
        if not network.isidentifier() and network:  # it is a file
            from ..deploy.client import network_of

            network = network_of(network)
        self.network, self._middlewares = network, tuple(middlewares)
        self._hosts = Hosts(network or None, log.warning, keys=keys, running=False)
        self.timeout, self._owner = timeout, owner
        self.types = Types()
        self._definitions = Definitions(include)
        self._lock = threading.RLock()
        self._transports: dict[tuple[str, str], Transport] = {}
        """By the middleware and its options."""
        self._kept: dict[str, Any] = {}
        self._end = contextlib.ExitStack()
        self._ended = threading.Event()
        self._process = os.getpid()
        self._closer: _Closer | None = None
        self._aside: list[threading.Thread] = []
        self._known = Network([])

    def close(self) -> None:
        self._ended.set()
        if os.getpid() != self._process:
            return  # a child of a fork has none of the threads
        with self._lock:
            self._end.close()
            self._transports.clear()
            self._kept.clear()
        posts = self._hosts.posts
        self._hosts.close()  # what a thread asks a scout ends with an error
        for each in self._aside:
            each.join(STUCK)
        for post in posts:
            post.close()  # a thread may have begun to ask it just now
        if self._closer and self._closer is not threading.current_thread():
            self._closer.join()

    @property
    def is_closed(self) -> bool:
        return self._ended.is_set()

    def census(self) -> Network:
        """What runs now, on all hosts that can be asked. Raises Closed, ConfigurationError and TransportErrors."""
        every = self._all(own=True)
        known = every.only(self._hosts.instances) if self.network else every
        with self._lock:
            self._known = known
        return known

    def check_publishing(self, channel: Channel) -> None:
        """See `Hosts.check_publishing`."""
        self._hosts.check_publishing(channel)

    @property
    def lost(self) -> Mapping[str, str]:
        """The hosts that the last census could not ask, and why."""
        return self._hosts.lost

    def _all(self, *, own: bool) -> Network:
        with self._lock:
            self.check_open()
            if self._hosts.renew().posts:
                self._watch()
        return self._hosts.census(self._middlewares, own=own).complete(self._definitions.search)

    def aside(self, work: Callable[[], object], name: str) -> None:
        """Do this on another thread, for which `close` waits.

        Raises RobocompError if the connection is closed, or if no thread can be started.
        """
        with self._lock:
            self.check_open()
            thread = threading.Thread(target=work, name=name)
            if not start_thread(thread):
                raise RobocompError(f"connect: {NO_THREAD}")
            self._aside = [thread, *(each for each in self._aside if each.is_alive())]

    def topic(self, name: str) -> Channel | None:
        """A topic by its whole name that nothing publishes so far, if a subscriber hears it."""
        try:
            return self._all(own=False).topic(name)
        except ValueError:
            return None

    def looked_up(self, find: Callable[[Network], T | None]) -> T | None:
        """What is found in the network as it was known, or else as it is now."""
        self.check_open()
        found = find(self._known)
        return find(self.census()) if found is None else found

    def missing(self, path: Sequence[str], name: str, children: Sequence[str], methods: Sequence[str]) -> NotThere:
        """The error for a name that is not there. It may be meant as one of the methods, which `children` lack."""
        where = "/".join(path) or self.network or "what runs on this host"
        near = closest(name, [*children, *methods])
        hint = f"did you mean `{near}`?" if near else f"there is {', '.join(children[:12]) or 'nothing'}"
        told = f"`{name}` is not in {where}; {hint}"
        why = "; ".join(self.lost.values())
        return NotThere(and_then(told, f"{why}, and it may be there") if why else told)

    def check_open(self) -> None:
        if self._ended.is_set():
            raise Closed("the connection is closed; connect again")
        if os.getpid() != self._process:
            raise Closed("this process is a fork of the one that has connected; connect here, too")

    def kept(self, name: str, make: Callable[[], T]) -> T:
        """What is kept under a name, made when it is first needed."""
        with self._lock:
            if name not in self._kept:
                self._kept[name] = make()
            made_: T = self._kept[name]
            return made_

    def opened(self, open_it: Callable[[], T], close: Callable[[T], object]) -> T:
        """Something that is closed with this connection."""
        with self._lock:
            self.check_open()
            made = open_it()
            self._end.callback(close, made)
            return made

    @cached_property
    def access(self) -> Access:
        """What publishes on other hosts."""
        return self.opened(Access, Access.close)

    def codec(self, channel: Channel) -> Codec:
        """That of the payloads which `hear` passes on."""
        return Cdr() if channel.via else self.transport(channel).codec

    def hear(
        self, channel: Channel, operation: Operation[Any], qos: QoS, take: Callable[[Payload], object]
    ) -> Subscription:
        """Open one subscription to a topic, on whatever host it is. `take` is called on a thread of the transport."""
        if channel.via:
            return self.opened(lambda: FarLink(channel, lambda heard: take(heard.payload)), lambda made: made.close())
        transport, path = self.transport(channel), transport_channel(channel, operation, qos)
        return self.opened(lambda: transport.inlet(path, take), lambda made: made.close())

    def transport(self, channel: Channel) -> Transport:
        """The transport over which a channel is reached."""
        middleware, options = channel.middlewares[0], channel.options
        key = middleware, json.dumps(options, sort_keys=True, default=str)
        with self._lock:
            self.check_open()
            if key not in self._transports:
                self._watch()
                config = TransportConfig(options, owner=self._owner)
                self._transports[key] = self.opened(
                    lambda: find_transport(middleware)(config), lambda made: made.close()
                )
            return self._transports[key]

    def _watch(self) -> None:
        if self._closer is None:
            self._closer = _Closer(self)
            if not start_thread(self._closer):
                self._closer = None
                raise RobocompError(f"connect: {NO_THREAD}")


class _Closer(threading.Thread):
    """Closes a connection when the program ends: an interpreter waits for the threads of transports before that."""

    def __init__(self, session: Session) -> None:
        super().__init__(name="connection", daemon=False)
        self._session = session

    def run(self) -> None:
        while not self._session._ended.wait(_LOOK):
            if abandoned(_Closer):
                self._session.close()
