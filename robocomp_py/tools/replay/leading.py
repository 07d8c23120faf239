"""A replay that leads the clock of a network, in place of the component that did.

In lock-step, each message is sent at the instant of its position, and the clock goes on when all that it caused is
done. It goes on from the latest time that followers have, which is 0 if they were just started. A clock that passes by
itself begins at 0; messages are sent when it has reached their positions.
"""

from __future__ import annotations

import contextlib
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from ...contract.component import Port
from ...contract.interface import Operation, Pattern
from ...contract.qos import DEFAULT_QOS
from ...errors import RobocompError
from ...lockstep.balance import State
from ...lockstep.free import Leading
from ...lockstep.leader import Leader
from ...lockstep.RoboCompClock import ClockState
from ...lockstep.RoboCompLockstep import Counter, Way
from ...runtime import ports
from ...runtime.clock import NEVER, SECOND
from ...runtime.monitor import Monitor
from ...runtime.route import Route
from ...runtime.settings import ClockSettings, Settings
from ...wire import names
from ..access import Access
from ..network import Network
from .ahead import Upcoming
from .choice import Part
from .player import Keys

CLOCK, CONTROL, LEADER = "Clock", "ClockControl", "LockstepLeader"
"""Interfaces."""

_DEADLINE = 2.0
"""Seconds for a call."""

_LOOK = 0.1
"""Seconds between two looks at keys."""

_FASTER, _SLOWER = 2.0, 0.5

Send = Callable[[str, bytes], object]
Queries = Callable[[], Sequence[str]]
"""Tells the channels of the queries that are answered now."""


@dataclass(frozen=True)
class Followed:
    """A clock for which components wait, and that no component leads."""

    leader: str
    """The whole name of the instance that should lead it."""
    is_lockstep: bool
    followers: Mapping[str, str]
    """Their whole names, each with the middleware over which it follows."""


def followed(network: Network) -> list[Followed]:
    """The clocks without a leader, of a network with the interfaces of the framework."""
    wanted: dict[tuple[str, bool], dict[str, str]] = {}
    for end in network.ends:
        instance, interface, operation = end.told.channel.rsplit("/", 2)
        if not end.provides and (interface, operation) in ((LEADER, "join"), (CLOCK, "tick")):
            wanted.setdefault((instance, interface == LEADER), {}).setdefault(end.told.owner, end.middleware)
    led = leaders(network)
    return [
        Followed(leader, is_lockstep, dict(sorted(followers.items())))
        for (leader, is_lockstep), followers in sorted(wanted.items())
        if leader not in led and names.instance(f"{leader}//") != names.ANY
    ]


def leaders(network: Network) -> list[str]:
    """The whole names of the instances that lead a clock now."""
    leading = (end.told.channel for end in network.ends if end.provides)
    return sorted({name.rsplit("/", 2)[0] for name in leading if names.segment(name) in (CLOCK, CONTROL)})


class Clock(Protocol):
    """What drives either clock."""

    def ClockControl_state(self) -> ClockState: ...

    def ClockControl_pause(self) -> None: ...

    def ClockControl_resume(self) -> None: ...

    def ClockControl_step(self, seconds: float) -> int: ...

    def ClockControl_setSpeed(self, speed: float) -> None: ...


class _Links:
    """The links of a leader that is no component; they end with `access`."""

    def __init__(self, access: Access, clock: Followed) -> None:
        self._access, self._clock = access, clock
        self._middlewares = list(dict.fromkeys(clock.followers.values()))
        self._monitor = Monitor("replay")

    def serve(self, port: Port, handlers: object) -> None:
        for middleware in self._middlewares:
            route = partial(self._route, self._clock.leader, [middleware])
            ports.bind_handlers(port, handlers, route, self._monitor, outside=True)

    def reach(self, port: Port, instance: str) -> tuple[Any, Callable[[], None]]:
        name = instance.strip("/")
        over = self._clock.followers.get(name, self._middlewares[0])
        proxy, links = ports.bind_proxy(port, partial(self._route, name, [over]), self._monitor)
        return proxy, partial(ports.close_all, links)

    def publish(self, port: Port) -> tuple[Any, Callable[[], None]]:
        route = partial(self._route, self._clock.leader, self._middlewares)
        proxy, links = ports.bind_proxy(port, route, self._monitor)
        return proxy, partial(ports.close_all, links)

    def _route(self, instance: str, over: Sequence[str], port: Port, operation: Operation[Any]) -> Route:
        channel = f"{instance}/{port.interface.short}/{operation.name}"
        first, *others = (Route(self._access.transport(each), each, channel, DEFAULT_QOS, _DEADLINE) for each in over)
        return Route(first.transport, first.middleware, channel, DEFAULT_QOS, _DEADLINE, tuple(others))


class Led(ABC):
    """A replay whose messages follow a clock that it leads."""

    def __init__(
        self, access: Access, clock: Followed, parts: Sequence[Part], send: Send, queries: Queries, speed: float
    ) -> None:
        """`queries` tells which ones are answered; `speed` is 0 for as fast as possible. For one thread."""
        self._name, self._parts, self._send, self._queries, self._speed = clock.leader, parts, send, queries, speed
        self._links = _Links(access, clock)
        followers = tuple(f"/{each}" for each in clock.followers)
        self._settings = Settings(f"/{clock.leader}", clock=ClockSettings(f"/{clock.leader}", followers, speed))
        self.sent = 0

    @abstractmethod
    def play(
        self, messages: Iterable[Upcoming], keys: Keys, show: Callable[[ClockState, int], object], *, is_paused: bool
    ) -> None:
        """Send these messages. `show` gets the state of the clock and its position, a few times a second.

        Raises RobocompError if the clock stops.
        """

    def _press(self, clock: Clock, key: str, due: int) -> None:
        """Do what a key says; the next message is due at that instant."""
        state = clock.ClockControl_state()
        match key:
            case " ":
                (clock.ClockControl_resume if state.paused else clock.ClockControl_pause)()
            case "s":
                clock.ClockControl_pause()
                clock.ClockControl_step(max(due - state.now, 1) / SECOND)
            case "+" | "=" | "-":
                factor = _SLOWER if key == "-" else _FASTER
                with contextlib.suppress(ValueError):  # no clock has this speed
                    clock.ClockControl_setSpeed((state.speed or 1.0) * factor)


class LedInLockstep(Led):
    """The clock waits for all components at each instant."""

    def play(
        self, messages: Iterable[Upcoming], keys: Keys, show: Callable[[ClockState, int], object], *, is_paused: bool
    ) -> None:
        failed: list[str] = []
        member = _Member(self._settings.instance, self._parts, iter(messages), self._send, self._queries)
        leader = Leader(self._settings, member, failed.append)
        member.at_end = leader.ClockControl_pause
        leader.open(self._links)
        if is_paused:
            leader.ClockControl_pause()
        leader.begin()
        try:
            while not failed and not (member.is_over and leader.ClockControl_state().paused):
                state = leader.ClockControl_state()
                show(state, member.position(state.now))
                self._press(leader, keys.wait(_LOOK), member.due)
                self.sent = member.sent
        finally:
            self.sent = member.sent
            leader.close()
        if member.error:
            raise member.error
        if failed:
            raise RobocompError(failed[0])


class _Member:
    """Takes part in the clock as the component would whose place the replay takes. It sends what is due."""

    def __init__(
        self, instance: str, parts: Sequence[Part], messages: Iterator[Upcoming], send: Send, queries: Queries
    ) -> None:
        self.instance, self._parts, self._messages, self._send = instance, parts, messages, send
        self._queries = queries
        self.at_end: Callable[[], object] = lambda: None
        self._numbers = dict.fromkeys((each.topic.name for each in parts), 0)
        self._begin: int | None = None
        """The instant before the first message: components that take part from the beginning do so at it."""
        self._next: Upcoming | None = None
        self.sent, self.is_over = 0, False
        self.error: RobocompError | None = None

    @property
    def due(self) -> int:
        return NEVER if self._next is None or self._begin is None else self._begin + 1 + self._next.position

    def position(self, now: int) -> int:
        return 0 if self._begin is None else max(0, now - self._begin)

    def work(self, now: int, asking: threading.Event | None) -> State:
        if self._begin is None:
            self._begin = now
            self._take()
        while self._next and self.due <= now:
            self._send(self._next.topic, self._next.data)
            if self._next.topic in self._numbers:
                self._numbers[self._next.topic] += 1
            self.sent += 1
            self._take()
        return self._state()

    def tell(self, now: int) -> State:
        return self._state()

    def watch(self, last: State, asking: threading.Event | None) -> State:
        return self._state()

    def counters(self) -> list[Counter]:
        ways = {Pattern.PUBLISH: Way.Publishes, Pattern.COMMAND: Way.Sends}
        sent = [Counter(ways[each.pattern], [each.channel]) for each in self._parts]
        return [*sent, *(Counter(Way.Serves, [each]) for each in self._queries())]

    def _state(self) -> State:
        """Queries are answered at once, so none is in progress here: each is under way until its client goes on."""
        served = len(self._queries())
        return State(self.due, True, 1 + served, (*self._numbers.values(), *(0 for _ in range(served))))

    def _take(self) -> None:
        try:
            self._next = next(self._messages, None)
        except RobocompError as exc:  # raised where the replay is played
            self._next, self.error = None, exc
        if self._next is None and not self.is_over:
            self.is_over = True
            self.at_end()


class LedFreely(Led):
    """The clock passes by itself."""

    def play(
        self, messages: Iterable[Upcoming], keys: Keys, show: Callable[[ClockState, int], object], *, is_paused: bool
    ) -> None:
        leader = Leading(self._settings, lambda: False)
        leader.open(self._links)
        if is_paused:
            leader.ClockControl_pause()
        leader.begin()
        try:
            shown = 0.0
            for message in messages:
                while (left := message.position - leader.clock.now()) > 0:
                    state = leader.ClockControl_state()
                    if time.monotonic() - shown > _LOOK:
                        shown = time.monotonic()
                        show(state, state.now)
                    longest = _LOOK if state.paused else min(_LOOK, left / SECOND / state.speed)
                    self._press(leader, keys.wait(longest), message.position)
                self._send(message.topic, message.data)
                self.sent += 1
        finally:
            leader.close()


def leading(access: Access, clock: Followed, parts: Sequence[Part], send: Send, queries: Queries, speed: float) -> Led:
    """A replay that leads this clock; see `Led`."""
    return (LedInLockstep if clock.is_lockstep else LedFreely)(access, clock, parts, send, queries, speed)
