"""The links of a replay: over each middleware by which something subscribes to its topics, also if it appears later."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

from ...contract.interface import Pattern, differences
from ...errors import ContractMismatch, DecodeError, EncodeError, RobocompError
from ...printable import one_line
from ...threads import NO_THREAD, start_thread
from ...transports.base import Outlet, wait_connected
from ...wire import names
from ...wire.cdr import Cdr
from ...wire.codec import Payload
from ..access import Access
from ..network import End, Network
from .choice import Part

log = logging.getLogger("robocomp.replay")

_LOOK = 1.0
"""Seconds between two looks for subscribers. A look takes at most a tenth of the time."""

_AGAIN = 0.05
"""Seconds between two looks while nothing subscribes."""

_SETTLING = 0.5
"""Seconds that further subscribers have to appear once there is one."""

_HEARS = {Pattern.PUBLISH: "subscribes", Pattern.COMMAND: "receives"}
"""The role of the receivers of a message."""

_DIFFERENCES = 3
"""Differences of contracts that are told."""


class _Way(NamedTuple):
    middleware: str
    outlet: Outlet
    convert: Callable[[bytes], Payload]


class Stage:
    """Sends messages of a recording. Its methods belong to one thread."""

    def __init__(
        self,
        access: Access,
        parts: Sequence[Part],
        census: Callable[[], Network],
        tell: Callable[[str], object],
        *,
        always: Sequence[str] = (),
        also: Callable[[Network], bool] = lambda network: False,
    ) -> None:
        """`tell` gets messages for people. Over middlewares in `always`, topics are published even if no subscriber is
        seen: some subscribers become visible only once there is a publisher. `also` gets each look at the network, and
        says whether something else of the recording is used."""
        self._access, self._census, self._tell, self._always = access, census, tell, always
        self._parts, self._also, self._is_used = parts, also, False
        self._by_topic = {each.topic.name: each for each in parts}
        self._ways: dict[str, tuple[_Way, ...]] = {}
        """By topic. Its values are replaced whole, so that `send` needs no lock."""
        self._told: set[str] = set()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="replay-look")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Look no more. The links end with `access`."""
        self._stopped.set()
        if self._thread.ident:
            self._thread.join()

    def ways(self, part: Part) -> list[str]:
        """The middlewares over which it is sent."""
        return [each.middleware for each in self._ways.get(part.topic.name, ())]

    def wait_heard(self, timeout: float) -> bool:
        """Wait until something subscribes to any of the topics, and until those that are visible by then are connected.

        False if nothing does in time. Raises TransportError if a middleware cannot tell.
        """
        end = time.monotonic() + timeout
        while True:
            self._look()
            if self._is_used or any(self._has_peer(each, 0.0) for each in self._every()):
                break
            if time.monotonic() > end:
                return False
            time.sleep(_AGAIN)
        settled = min(end, time.monotonic() + _SETTLING)
        for each in self._every():
            if self._has_peer(each, max(0.0, settled - time.monotonic())):
                wait_connected(each.outlet, max(0.0, end - time.monotonic()))
        return True

    def watch(self) -> None:
        """Look again and again, on a thread of its own, until the stage is closed."""
        if not start_thread(self._thread):
            raise RobocompError(NO_THREAD)

    def send(self, topic: str, data: bytes) -> None:
        """Send a message of a topic to all that hear it. What fails is counted, and told once."""
        part = self._by_topic[topic]
        for way in self._ways.get(topic, ()):
            try:
                way.outlet.send(way.convert(data))
            except (DecodeError, EncodeError) as exc:
                part.malformed += 1
                self._complain(topic, f"a message of {topic} does not fit its contract: {exc}")
                return
            except RobocompError as exc:
                part.failed += 1
                self._complain(topic, f"{part.channel} over {way.middleware}: {exc}")
        part.sent += 1

    def _watch(self) -> None:
        pause = _LOOK
        while not self._stopped.wait(pause):
            begun = time.monotonic()
            try:
                self._look()
            except RobocompError as exc:
                self._complain("", f"looking for subscribers failed: {exc}")
            except Exception:
                log.exception("looking for subscribers failed")
            pause = max(_LOOK, 10 * (time.monotonic() - begun))

    def _look(self) -> None:
        network = self._census()
        self._is_used = self._also(network)
        for part in self._parts:
            for middleware in self._wanted(part, network):
                if way := self._opened(part, middleware):
                    self._ways[part.topic.name] = (*self._ways.get(part.topic.name, ()), way)

    def _every(self) -> list[_Way]:
        return [each for ways in self._ways.values() for each in ways]

    def _has_peer(self, way: _Way, timeout: float) -> bool:
        try:
            return way.outlet.wait_peer(timeout)
        except ContractMismatch as exc:
            self._complain(str(exc), f"over {way.middleware}: {exc}")
            return False

    def _wanted(self, part: Part, network: Network) -> list[str]:
        """The middlewares over which it is to be sent, and is not yet."""
        found: dict[str, Any] = dict.fromkeys(self._always if part.pattern is Pattern.PUBLISH else ())
        for end in network.ends:
            is_meant = end.role == _HEARS[part.pattern] and names.matches(end.told.channel, part.channel)
            if is_meant and self._fits(part, end):
                found[end.middleware] = None
        return [each for each in found if each not in self.ways(part)]

    def _fits(self, part: Part, end: End) -> bool:
        """Whether both have the same contract. Programs of others tell none."""
        if end.told.fingerprint in (0, part.operation.fingerprint):
            return True
        found = differences(part.operation.text, end.told.text)[:_DIFFERENCES] if end.told.text else []
        what = one_line("; ".join(found)) or "it does not tell which"
        self._complain(
            f"{part.channel} {end.told.owner}",
            f"{end.told.owner or 'a program'} (process {end.told.pid}) hears {part.channel} with another contract than "
            f"the recorded one: {what}",
        )
        return False

    def _opened(self, part: Part, middleware: str) -> _Way | None:
        topic = part.topic
        try:
            outlet, codec = self._access.sender(middleware, part.channel, part.pattern, part.operation, topic.qos)
        except RobocompError as exc:
            self._complain(f"{part.channel} {middleware}", f"{part.channel} over {middleware}: {exc}")
            return None
        decode, encode = Cdr().decoder(part.operation.request), codec.encoder(part.operation.request, snapshot=False)
        return _Way(middleware, outlet, lambda data: encode(decode(data)))

    def _complain(self, about: str, text: str) -> None:
        if about not in self._told:
            self._told.add(about)
            self._tell(text)
