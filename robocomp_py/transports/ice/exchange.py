"""A transport's dealings with IceStorm: topics are found or made there, subscriptions are kept, and losses noticed.

A topic of IceStorm carries all operations of an interface, of all who publish it. Whether it and our subscriptions
are still there is asked every few seconds, and at once when the connection to IceStorm is lost: one that was started
again knows neither. Nothing here is asked on anybody else's thread, since a call may take until it is given up.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ...errors import Closed, ConfigurationError, TransportError
from ...threads import NO_THREAD, start_thread
from ...wire.header import clock
from ..directory import runtime_dir
from ..leader_followers import belongs
from . import library
from .storm import INSTALL, Place

if TYPE_CHECKING:
    from .transport import IceTransport

log = logging.getLogger("robocomp.transport.ice")

OPEN_PATIENCE = 10.0
"""Seconds after which opening a topic gives up to reach IceStorm."""

TOLD = 1.0
"""Seconds after which it is told that opening a topic waits for IceStorm."""

CALL_MS = 2000
"""IceStorm answers within so many milliseconds, or counts as gone."""

LOOK = 2.0
"""Seconds between two looks whether all is as it was."""

ATTEMPT, LONGEST_ATTEMPT = 0.05, 0.5
"""Seconds between two attempts to reach an IceStorm that is not there, at first and in the end."""

ASKED = 0.1
"""Seconds between two looks that somebody asks for who waits for others."""

OURS = "robocomp"
"""The category of identities under which components of ours subscribe."""

ORDERED = {"reliability": "ordered"}


@dataclass(eq=False)
class Subscription:
    """What IceStorm is to send to an object of ours."""

    proxy: Any
    ordered: bool
    """Whether each message is acknowledged before the next one is sent."""
    epoch: int = 0
    """How often it was made; 0: not yet."""
    renewed: Callable[[], object] = lambda: None
    """Called when it was made again."""

    @property
    def identity(self) -> str:
        name: str = self.proxy.ice_getIdentity().name
        return name


@dataclass(eq=False)
class Topic:
    name: str
    publisher: Any = None
    """A proxy that takes what is published and tells that it did; None while IceStorm is not reached."""
    oneway: Any = None
    """The same, without telling."""
    epoch: int = 0
    """How often it was reached; 0: not yet."""
    strangers: bool = False
    """Whether somebody subscribes whom the directory does not tell of."""
    subscriptions: list[Subscription] = field(default_factory=list)
    ended: list[Subscription] = field(default_factory=list)
    found: Any = None
    users: int = 0


class Exchange:
    """Costs nothing until a topic is used. Safe to use from any thread."""

    def __init__(self, transport: IceTransport) -> None:
        self._transport = transport
        self._topics: dict[str, Topic] = {}
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._due = threading.Event()
        self._closed = False
        self._thread: threading.Thread | None = None
        self._manager: Any = None
        self._connection: Any = None
        self._lost = ""
        """Why IceStorm is not reached, if that was told."""
        self._why = ""
        self._reached = False
        self._asked_for = False
        """Whether it was told that a topic waits for IceStorm."""
        self._looked_at = 0.0
        folder = f"{clock()}{runtime_dir()}"
        self.neighbours = f"{hashlib.sha256(folder.encode()).hexdigest()[:8]}-"
        """What the names of subscribers begin with that the directory tells of."""

    @contextlib.contextmanager
    def using(self, name: str) -> Iterator[Topic]:
        """A topic that is attended to from now on; not any more if what is done with it here raises."""
        topic = self._attach(name)
        try:
            yield topic
        except BaseException:
            self.leave(topic)
            raise

    def leave(self, topic: Topic) -> None:
        """Who used a topic does so no more."""
        with self._lock:
            topic.users -= 1
            if not topic.users and not topic.ended:
                self._topics.pop(topic.name, None)

    def subscribe(self, topic: Topic, subscription: Subscription) -> None:
        """Have it made, soon, and kept."""
        with self._lock:
            topic.subscriptions.append(subscription)
        self._due.set()

    def subscribed(self, subscription: Subscription) -> None:
        """Wait until it is made. Raises TransportError if IceStorm is not there."""
        self._wait(lambda: subscription.epoch > 0)

    def unsubscribe(self, topic: Topic, subscription: Subscription) -> None:
        with self._lock:
            topic.subscriptions.remove(subscription)
            if subscription.epoch:
                topic.ended.append(subscription)
        self._due.set()

    def reach(self, topic: Topic) -> None:
        """Wait until there is somebody to publish to. Raises TransportError if IceStorm is not there."""
        self._wait(lambda: topic.publisher is not None)

    def _wait(self, condition: Callable[[], bool]) -> None:
        """Raises TransportError, which says what to do, if that does not come true; Closed, if it need not any more."""
        begun = time.monotonic()
        end = begun + OPEN_PATIENCE
        while self._transport.wanted():
            with self._lock:
                done = self._changed.wait_for(lambda: condition() or self._closed, library.SLICE)
                self._check_open()
            if done:
                return
            if time.monotonic() >= end:
                raise TransportError(self.absent())
            if time.monotonic() - begun >= TOLD and not self._asked_for:
                self._asked_for = True
                log.warning("waiting up to %g s for IceStorm; %s", OPEN_PATIENCE, self.absent())
        raise Closed("ice: asked to end while waiting for IceStorm")

    def absent(self) -> str:
        """That IceStorm is not reached, and what to do, in words."""
        return (
            f"ice: no IceStorm answers at `{self._transport.options.storm}`, and topics need one: start RoboComp's "
            "`rcnode`, or `rc host ice`, or the network by rcdeploy, which does so; if it is elsewhere, set "
            f"`transports.ice.storm`; if it is not installed, {INSTALL} ({self._why or 'it has not answered yet'})"
        )

    def look_soon(self) -> None:
        """Have it looked whether somebody came, unless that was done a moment ago."""
        if time.monotonic() - self._looked_at >= ASKED:
            self._due.set()

    def lost(self) -> None:
        """IceStorm may have gone. May be called by Ice."""
        self._due.set()

    def close(self) -> None:
        """Take back what we subscribed to, if IceStorm answers, and end."""
        with self._lock:
            self._closed = True
            self._changed.notify_all()
        self._due.set()
        if self._thread:
            self._thread.join()

    def _check_open(self) -> None:
        if self._closed:
            raise Closed("the transport is closed")

    def _attach(self, name: str) -> Topic:
        with self._lock:
            self._check_open()
            if self._thread is None:
                self._begin()
            topic = self._topics.setdefault(name, Topic(name))
            topic.users += 1
        self._due.set()
        return topic

    def _begin(self) -> None:
        try:
            import IceStorm
        except ImportError as exc:
            raise ConfigurationError(f"ice: topics need the IceStorm package of Ice for Python: {exc}") from exc
        Place.of(self._transport.options)  # raises, if that is none
        with library.as_transport_error("transports.ice.storm"):
            proxy = self._transport.communicator.stringToProxy(self._transport.options.storm)
        self._manager = IceStorm.TopicManagerPrx.uncheckedCast(proxy).ice_invocationTimeout(CALL_MS)
        self._no_such_topic, self._exists = IceStorm.NoSuchTopic, IceStorm.TopicExists
        self._subscribed_already = IceStorm.AlreadySubscribed
        thread = threading.Thread(target=self._attend, name="ice-topics")
        belongs(thread)
        if not start_thread(thread):
            raise TransportError(f"ice: topics: {NO_THREAD}")
        self._thread = thread

    # On the thread of its own.

    def _attend(self) -> None:
        pause = ATTEMPT
        while not self._closed:
            self._due.clear()
            try:
                self._look()
                pause = ATTEMPT
                self._due.wait(LOOK)
            except Exception as exc:
                if self._closed:
                    break
                self._miss(exc)
                self._due.wait(pause)
                pause = min(2 * pause, LONGEST_ATTEMPT)
        try:
            for topic in list(self._topics.values()):
                self._end(topic, [*topic.ended, *(each for each in topic.subscriptions if each.epoch)])
        except Exception as exc:  # it goes down just now, too, and forgets us then
            log.debug("unsubscribing: %s", exc)

    def _look(self) -> None:
        asked = self._manager.ice_getConnectionAsync()
        library.wait_for(asked, self._check_open)
        connection = asked.result()
        if connection != self._connection:
            connection.setCloseCallback(lambda _: self.lost())
            self._connection = connection
            self._forget()
        for topic in list(self._topics.values()):
            if self._closed:
                return
            self._look_after(topic)
        self._looked_at = time.monotonic()
        self._reached = True
        if self._lost:
            log.info("%s: IceStorm answers again", self._transport.owner or "ice")
            self._lost = ""

    def _miss(self, exc: Exception) -> None:
        """IceStorm is not there, or not what it should be."""
        self._why = library.why(exc) if isinstance(exc, library.LocalException) else f"{type(exc).__name__}: {exc}"
        if not isinstance(exc, library.LocalException):
            if self._lost != self._why:
                log.error("looking after topics; trying again", exc_info=exc)
        elif self._reached and not self._lost:
            log.warning(
                "%s: IceStorm at `%s` does not answer (%s); until it does, nothing is published over ice",
                self._transport.owner or "ice",
                self._transport.options.storm,
                self._why,
            )
        if self._reached or not isinstance(exc, library.LocalException):
            self._lost = self._why
        self._connection = None
        self._forget()

    def _forget(self) -> None:
        with self._lock:
            for topic in self._topics.values():
                topic.publisher = topic.oneway = topic.found = None

    def _look_after(self, topic: Topic) -> None:
        there = self._subscribers(topic)
        if topic.publisher is None:
            publisher = topic.found.getPublisher()
            with self._lock:
                topic.publisher, topic.oneway = publisher, publisher.ice_oneway()
                topic.epoch += 1
                self._changed.notify_all()
        with self._lock:
            wanted, ended = list(topic.subscriptions), list(topic.ended)
        for each in wanted:
            if each.identity not in there:
                self._make(topic, each)
        if ended:
            self._end(topic, ended)
        topic.strangers = any(
            category != OURS or not name.startswith(self.neighbours) for name, category in there.items()
        )

    def _subscribers(self, topic: Topic) -> dict[str, str]:
        """Who subscribes: names, and their categories. The topic is found, or made."""
        if topic.found is not None:
            try:
                return {each.name: each.category for each in topic.found.getSubscribers()}
            except library.NoSuchObject:  # another IceStorm in its place, or somebody removed it
                with self._lock:
                    topic.publisher = topic.oneway = topic.found = None
        topic.found = self._find(topic.name).ice_invocationTimeout(CALL_MS)
        return {each.name: each.category for each in topic.found.getSubscribers()}

    def _find(self, name: str) -> Any:
        while True:
            self._check_open()
            try:
                return self._manager.retrieve(name)
            except self._no_such_topic:
                with contextlib.suppress(self._exists):  # made by somebody else meanwhile
                    return self._manager.create(name)

    def _make(self, topic: Topic, subscription: Subscription) -> None:
        qos, proxy = (ORDERED, subscription.proxy) if subscription.ordered else ({}, subscription.proxy.ice_oneway())
        with contextlib.suppress(self._subscribed_already):
            topic.found.subscribeAndGetPublisher(qos, proxy)
        with self._lock:
            subscription.epoch += 1
            self._changed.notify_all()
        if subscription.epoch > 1:
            subscription.renewed()

    def _end(self, topic: Topic, ended: list[Subscription]) -> None:
        for each in ended:
            if topic.found is not None:
                topic.found.unsubscribe(each.proxy)
        with self._lock:
            topic.ended = [each for each in topic.ended if each not in ended]
            if not topic.users and not topic.ended:
                self._topics.pop(topic.name, None)
