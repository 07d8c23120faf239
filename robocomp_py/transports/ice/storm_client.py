"""The client of IceStorm: finds or makes topics, keeps subscriptions, and notices when IceStorm is lost.

An IceStorm topic carries all operations of an interface, from all its publishers. A restarted IceStorm has lost its
topics and subscriptions. So we check them every few seconds, and at once when the connection to IceStorm is lost.
This happens on a thread of its own, because each call may take until its timeout.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from ...errors import Closed, ConfigurationError, TransportError
from ...threads import NO_THREAD, start_thread
from ...wire.header import clock
from ..leader_followers import belongs
from ..runtime_folder import runtime_dir
from . import library
from .storm import INSTALL, Place

if TYPE_CHECKING:
    from ..iceoptions import IceOptions
    from ..leader_followers import Job
    from ..membership import Membership
    from .objects import Port, Take

log = logging.getLogger("robocomp.transport.ice")

OPEN_TIMEOUT = 10.0
"""Seconds that opening a topic waits for IceStorm."""

LOG_AFTER = 1.0
"""Seconds of waiting for IceStorm before that is logged."""

CALL_MS = 2000
"""Timeout of a call to IceStorm in ms; after that it counts as gone."""

CHECK_PERIOD = 2.0
"""Seconds between two checks of topics and subscriptions."""

FIRST_PAUSE, LONGEST_PAUSE = 0.05, 0.5
"""Seconds between two attempts to reach an IceStorm that does not answer: the first pause, and the longest."""

SHORTEST_PERIOD = 0.1
"""Minimum seconds between two checks that waiting links request."""

OURS = "robocomp"
"""The category of our subscribers' identities."""

ORDERED = {"reliability": "ordered"}


@dataclass(eq=False)
class Subscription:
    """A subscription of one of our objects to a topic."""

    proxy: Any
    ordered: bool
    """Whether each message is acknowledged before the next one is sent."""
    epoch: int = 0
    """How often it was made; 0 before the first time."""
    renewed: Callable[[], object] = lambda: None
    """Called after it was made again."""

    @property
    def identity(self) -> str:
        name: str = self.proxy.ice_getIdentity().name
        return name


@dataclass(eq=False)
class Topic:
    name: str
    publisher: Any = None
    """The proxy to publish with acknowledgement; None while IceStorm does not answer."""
    oneway: Any = None
    """The proxy to publish without acknowledgement."""
    epoch: int = 0
    """How often the topic was found; 0 before the first time."""
    foreign_subscribers: bool = False
    """Whether it has subscribers that are not in the directory."""
    subscriptions: list[Subscription] = field(default_factory=list)
    ended: list[Subscription] = field(default_factory=list)
    found: Any = None
    users: int = 0


class Surroundings(Protocol):
    """What topics need of their transport; see `core.IceCore`."""

    owner: str
    options: IceOptions
    limit: int
    communicator: Any
    member: Membership

    @property
    def wanted(self) -> Callable[[], bool]:
        """Returns False when opening the transport should be given up."""
        ...

    def do(self, job: Job) -> None: ...

    def port(self, identity: str, endpoints: str, take: Take) -> Port: ...


class StormClient:
    """Connects when the first topic is used. Safe to use from any thread."""

    def __init__(self, transport: Surroundings) -> None:
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
        """Why IceStorm does not answer, if that was logged."""
        self._why = ""
        self._reached = False
        self._wait_logged = False
        """Whether it was logged that a topic waits for IceStorm."""
        self._checked_at = 0.0
        folder = f"{clock()}{runtime_dir()}"
        self.own_prefix = f"{hashlib.sha256(folder.encode()).hexdigest()[:8]}-"
        """Prefix of the names of those subscribers that are in the directory."""

    @contextlib.contextmanager
    def using(self, name: str) -> Iterator[Topic]:
        """Start to use a topic; the use ends if the body raises."""
        topic = self._attach(name)
        try:
            yield topic
        except BaseException:
            self.leave(topic)
            raise

    def leave(self, topic: Topic) -> None:
        """End the use of a topic."""
        with self._lock:
            topic.users -= 1
            if not topic.users and not topic.ended:
                self._topics.pop(topic.name, None)

    def subscribe(self, topic: Topic, subscription: Subscription) -> None:
        """Have the thread make and keep this subscription."""
        with self._lock:
            topic.subscriptions.append(subscription)
        self._due.set()

    def subscribed(self, subscription: Subscription) -> None:
        """Wait until it is made. Raises TransportError if IceStorm does not answer."""
        self._wait(lambda: subscription.epoch > 0)

    def unsubscribe(self, topic: Topic, subscription: Subscription) -> None:
        with self._lock:
            topic.subscriptions.remove(subscription)
            if subscription.epoch:
                topic.ended.append(subscription)
        self._due.set()

    def reach(self, topic: Topic) -> None:
        """Wait until a topic can be published to. Raises TransportError if IceStorm does not answer."""
        self._wait(lambda: topic.publisher is not None)

    def _wait(self, condition: Callable[[], bool]) -> None:
        """Wait for a condition. Raises TransportError, with a hint, after a timeout; Closed if stopped meanwhile."""
        begun = time.monotonic()
        end = begun + OPEN_TIMEOUT
        while self._transport.wanted():
            with self._lock:
                done = self._changed.wait_for(lambda: condition() or self._closed, library.SLICE)
                self._check_open()
            if done:
                return
            if time.monotonic() >= end:
                raise TransportError(self.absent())
            if time.monotonic() - begun >= LOG_AFTER and not self._wait_logged:
                self._wait_logged = True
                log.warning("waiting up to %g s for IceStorm; %s", OPEN_TIMEOUT, self.absent())
        raise Closed("ice: stopped while waiting for IceStorm")

    def absent(self) -> str:
        """The message that IceStorm does not answer, and what to do about it."""
        return (
            f"ice: no IceStorm answers at `{self._transport.options.storm}`, and topics need one: start RoboComp's "
            "`rcnode` or `rc host ice`, or the network by rcdeploy, which starts IceStorm; if it is elsewhere, set "
            f"`transports.ice.storm`; if it is not installed, {INSTALL} ({self._why or 'it has not answered yet'})"
        )

    def look_soon(self) -> None:
        """Have the thread check the topics now, unless it did so a moment ago."""
        if time.monotonic() - self._checked_at >= SHORTEST_PERIOD:
            self._due.set()

    def lost(self) -> None:
        """Note that IceStorm may have gone. Ice may call this."""
        self._due.set()

    def close(self) -> None:
        """Unsubscribe, if IceStorm answers, and end the thread."""
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
        Place.of(self._transport.options)  # raises if the options are wrong
        with library.as_transport_error("transports.ice.storm"):
            proxy = self._transport.communicator.stringToProxy(self._transport.options.storm)
        self._manager = IceStorm.TopicManagerPrx.uncheckedCast(proxy).ice_invocationTimeout(CALL_MS)
        self._no_such_topic, self._exists = IceStorm.NoSuchTopic, IceStorm.TopicExists
        self._subscribed_already = IceStorm.AlreadySubscribed
        thread = threading.Thread(target=self._run, name="ice-topics", daemon=False)
        belongs(thread)
        if not start_thread(thread):
            raise TransportError(f"ice: topics: {NO_THREAD}")
        self._thread = thread

    # On its own thread.

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._closed:
            self._due.clear()
            try:
                self._check()
                pause = FIRST_PAUSE
                self._due.wait(CHECK_PERIOD)
            except Exception as exc:
                if self._closed:
                    break
                self._note_failure(exc)
                self._due.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
        try:
            for topic in list(self._topics.values()):
                self._end(topic, [*topic.ended, *(each for each in topic.subscriptions if each.epoch)])
        except Exception as exc:  # IceStorm is ending, too, and will forget us
            log.debug("unsubscribing: %s", exc)

    def _check(self) -> None:
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
            self._check_topic(topic)
        self._checked_at = time.monotonic()
        self._reached = True
        if self._lost:
            log.info("%s: IceStorm answers again", self._transport.owner or "ice")
            self._lost = ""

    def _note_failure(self, exc: Exception) -> None:
        """Note that IceStorm does not answer, or not as expected."""
        self._why = library.why(exc) if isinstance(exc, library.LocalException) else f"{type(exc).__name__}: {exc}"
        if not isinstance(exc, library.LocalException):
            if self._lost != self._why:
                log.error("checking topics failed; trying again", exc_info=exc)
        elif self._reached and not self._lost:
            log.warning(
                "%s: IceStorm at `%s` does not answer (%s); until it does, publications over ice fail",
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

    def _check_topic(self, topic: Topic) -> None:
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
        topic.foreign_subscribers = any(
            category != OURS or not name.startswith(self.own_prefix) for name, category in there.items()
        )

    def _subscribers(self, topic: Topic) -> dict[str, str]:
        """The names of a topic's subscribers and their categories. Finds the topic, or makes it."""
        if topic.found is not None:
            try:
                return {each.name: each.category for each in topic.found.getSubscribers()}
            except library.NoSuchObject:  # IceStorm was restarted, or the topic was removed
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
                with contextlib.suppress(self._exists):  # another program has made it meanwhile
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
