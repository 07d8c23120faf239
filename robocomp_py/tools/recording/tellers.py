"""Records the calls and the log records of components, also of those that start later, as they tell of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

from ...contract.interface import Pattern
from ...contract.types import Struct
from ...errors import DecodeError, EncodeError, RobocompError
from ...runtime.RoboCompIntrospection import Call, Record
from ...transports.base import Heard
from ...wire import names
from ...wire.codec import Decoder
from .. import asking
from ..access import Access, Subscription
from ..announced import OWN
from ..calls import tellers
from ..leases import LEASE
from ..network import Channel, Network, NotUnderstood
from .calls import calls_topic, info_octets, joined, log_octets, logs_topic
from .session import DEPTH, Track, Tracks, host_of, listen_again, way_of

_AT_ONCE = 8
"""Components that are asked at the same time to tell."""

_AGAIN = 10.0
"""Seconds until a component that refused or did not answer is asked again."""


@dataclass
class Teller:
    """A component that tells its calls or its log records."""

    component: str
    """Its whole name."""
    what: str
    """`calls` or `logs`."""
    link: Subscription | None = None
    told: int = 0
    untold: int = 0
    """Calls or records that it did not tell, because they came too fast."""
    unknown: int = 0
    """Calls of channels that are not announced."""
    malformed: int = 0

    @property
    def host(self) -> str:
        """The name of another host that it runs on, or ""."""
        return host_of(self.link)

    @property
    def lost(self) -> int:
        return self.untold + (self.link.stats.lost + self.link.stats.dropped if self.link else 0)

    @property
    def unreadable(self) -> int:
        return self.malformed + (self.link.stats.malformed + self.link.stats.mismatched if self.link else 0)


class Tellers:
    """What components tell now. `look` is to be called again and again, by one thread."""

    def __init__(
        self,
        recorder: Tracks,
        access: Access,
        wanted: Sequence[str],
        tell: Callable[[str], object],
        *,
        calls: bool,
        logs: bool,
        served: bool = False,
    ) -> None:
        """`wanted` are names of operations, as commands take them; none are all. With `served`, servers tell of calls,
        and not those that call. `tell` gets messages for people."""
        self._recorder, self._access, self._wanted, self._tell = recorder, access, wanted, tell
        self._calls, self._logs, self._served = calls, logs, served
        self._found: dict[tuple[str, str, str, str], Teller] = {}
        """By component, operation, host and middleware."""
        self._tracks: dict[str, tuple[str, Track]] = {}
        """By the name of a channel: the name and the track of its calls."""
        self._changing = threading.Lock()
        self._channels: Mapping[str, Channel] = {}
        self._announced: Sequence[str] = ()
        self._log: Track | None = None
        self._asked: dict[str, float] = {}
        self._asking: dict[str, Future[None]] = {}
        self._failed: set[tuple[str, str]] = set()
        self._pool = ThreadPoolExecutor(_AT_ONCE, "tellers")

    @property
    def all(self) -> list[Teller]:
        return list(self._found.values())

    @property
    def tracks(self) -> list[tuple[str, Track]]:
        """All topics of calls, and that of log records, by their names."""
        logs = [(logs_topic().name, self._log)] if self._log else []
        return [*self._tracks.copy().values(), *logs]

    def look(self, network: Network) -> None:
        """Ask what is new to tell, and listen."""
        self._channels, self._announced = self._chosen(network), list(network.channels)
        known = asking.components(network)
        about = list(self._channels.values())
        callers = set(tellers(network, about, served=self._served)) if self._calls else set()
        for each in known:
            self._lease(network, each, calls=each in callers)
        for channel in network.stock("IntrospectionPub"):
            component, _, operation = channel.name.rpartition("/IntrospectionPub/")
            if channel.providers and self._is_wanted(operation):
                self._follow(channel, component, operation)

    def close(self) -> None:
        """Ask no more. The components end by themselves to tell."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _is_wanted(self, operation: str) -> bool:
        return (operation == "called" and self._calls) or (operation == "logged" and self._logs)

    def _chosen(self, network: Network) -> dict[str, Channel]:
        if not self._calls:
            return {}
        found: dict[str, Channel] = {} if self._wanted else dict(network.channels)
        for name in self._wanted:
            try:
                found |= {each.name: each for each in network.named(name)}
            except ValueError:
                continue  # it may appear later
        return {name: each for name, each in found.items() if each.pattern is not Pattern.PUBLISH}

    # Leases.

    def _lease(self, network: Network, component: str, *, calls: bool) -> None:
        """Let a component tell for a while, unless it does or is being asked."""
        waiting = self._asking.get(component)
        if waiting is not None:
            if not waiting.done():
                return
            del self._asking[component]
            if (error := waiting.exception()) is not None:
                self._complain(component, f"{component} does not tell: {error}")
                self._asked[component] = time.monotonic() - LEASE / 3 + _AGAIN
        if not (calls or self._logs) or time.monotonic() - self._asked.get(component, -LEASE) < LEASE / 3:
            return
        self._asked[component] = time.monotonic()
        self._asking[component] = self._pool.submit(
            asking.watch, self._access, network, component, calls=calls, logs=self._logs, lease=LEASE
        )

    # What they tell.

    def _follow(self, channel: Channel, component: str, operation: str) -> None:
        known: list[Teller] = []

        def key_of(way: Channel) -> tuple[str, str, str, str]:
            return component, operation, way.host, way.middlewares[0]

        def is_followed(way: Channel) -> bool:
            found = self._found.get(key_of(way))
            known.extend([found] if found else [])
            return found is not None

        for way in channel.each_way(is_followed):
            if teller := self._opened(way, component, operation):
                self._found[key_of(way)] = teller
        for teller in known:
            try:
                listen_again(teller.link)
            except RobocompError as exc:
                self._complain(channel.name, f"{channel.name}: {exc}")

    def _opened(self, channel: Channel, component: str, operation: str) -> Teller | None:
        what, kind = ("calls", Call) if operation == "called" else ("logs", Record)
        try:
            pick = _picker(channel, kind)
            sink = self._called if operation == "called" else self._logged
            decode = self._access.codec(channel).decoder(channel.operation.request)
            teller = Teller(component, what)
            take = partial(self._take, teller, decode, pick, sink)
            teller.link = self._access.hear(channel, take, DEPTH, headed=True).link
        except (NotUnderstood, RobocompError) as exc:
            self._complain(channel.name, f"{channel.name}: {exc}")
            return None
        self._tell(f"{what} of {component} {way_of(channel)}")
        return teller

    def _take(
        self,
        teller: Teller,
        decode: Decoder,
        pick: Callable[[tuple[Any, ...]], dict[str, Any]],
        sink: Callable[[Teller, dict[str, Any], Heard], None],
        heard: Heard,
    ) -> None:
        """A message has arrived, on any thread."""
        try:
            told = pick(decode(heard.payload))
            teller.untold += told["dropped"]
            sink(teller, told, heard)
        except (DecodeError, EncodeError):
            teller.malformed += 1

    def _called(self, teller: Teller, told: dict[str, Any], heard: Heard) -> None:
        if told["channel"].count("/") < 2:
            teller.malformed += 1
            return
        if self._served == bool(told["caller"]):
            return
        found = self._track_of(told["channel"])
        if found is None:
            teller.unknown += self._is_unknown(told["channel"])
            return
        teller.told += 1
        info = info_octets(
            told["caller"] or teller.component,
            told["middleware"],
            told["begun"],
            told["took"],
            told["status"],
            told["error"],
        )
        response = bytes(told["response"]) if told["status"] == "ok" else b""
        found.put([info, bytes(told["request"]), response], heard.stamp)

    def _track_of(self, name: str) -> Track | None:
        """Of the calls of a channel; made with its first call."""
        channels = self._channels
        channel = channels.get(name) or next(
            (each for each in channels.values() if names.matches(name, each.name)), None
        )
        if channel is None:
            return None
        with self._changing:
            if channel.name not in self._tracks:
                try:
                    operation = channel.operation
                except NotUnderstood:
                    return None
                owner = ",".join(dict.fromkeys(each.told.owner for each in channel.providers if each.told.owner))
                topic = calls_topic(channel.name, operation, channel.pattern, owner, channel.middlewares[0])
                self._tracks[channel.name] = topic.name, self._recorder.track(topic, joined(operation))
            return self._tracks[channel.name][1]

    def _is_unknown(self, name: str) -> bool:
        """Whether calls of a channel are not recorded for the only reason that no contract of it is announced."""
        is_announced = any(names.matches(name, each) for each in self._announced)
        return not (is_announced or self._wanted or names.segment(name) in OWN)

    def _logged(self, teller: Teller, told: dict[str, Any], heard: Heard) -> None:
        octets = log_octets(teller.component, told)
        with self._changing:
            if self._log is None:
                self._log = self._recorder.track(logs_topic(), lambda payload: payload)
        self._log.put(octets, told["at"])
        teller.told += 1

    def _complain(self, about: str, text: str) -> None:
        if (about, text) not in self._failed:
            self._failed.add((about, text))
            self._tell(text)


def _picker(channel: Channel, kind: type[Call] | type[Record]) -> Callable[[tuple[Any, ...]], dict[str, Any]]:
    """A function from a message to its fields by name; those that another version lacks have their defaults.

    Raises NotUnderstood if a field is of another type than ours.
    """
    ours: Struct = kind.__contract__
    (theirs,) = (each.type for each in channel.operation.inputs) if len(channel.operation.inputs) == 1 else (None,)
    if not isinstance(theirs, Struct):
        raise NotUnderstood(f"{channel.name} is not what IntrospectionPub has")
    places = {field.name: (place, field.type) for place, field in enumerate(theirs.fields)}
    standard = {field.name: getattr(kind(), field.name) for field in ours.fields}
    found = {}
    for each in ours.fields:
        if each.name in places:
            place, its = places[each.name]
            if its != each.type:
                raise NotUnderstood(f"{channel.name} has another type of `{each.name}`")
            found[each.name] = place

    def pick(values: tuple[Any, ...]) -> dict[str, Any]:
        (told,) = values
        return standard | {name: told[place] for name, place in found.items()}

    return pick
