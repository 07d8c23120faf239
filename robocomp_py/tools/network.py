"""What runs now, from what all processes announce. Pure."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from ..contract import told
from ..contract.interface import Operation, Pattern
from ..contract.qos import DEFAULT_QOS, QoS, from_traits
from ..contract.told import Supplement
from ..errors import RobocompError
from ..printable import one_line
from ..spelling import closest
from ..transports.census import Told
from ..wire import names
from .announced import OWN, PROVIDERS

if TYPE_CHECKING:
    from .posts import Post

PATTERNS = {
    "publishes": Pattern.PUBLISH,
    "subscribes": Pattern.PUBLISH,
    "commands": Pattern.COMMAND,
    "receives": Pattern.COMMAND,
    "calls": Pattern.QUERY,
    "serves": Pattern.QUERY,
}
"""By the role of an end."""

TOOL = "rc"
"""The owner that commands announce."""


class Process(NamedTuple):
    """A process of one of several hosts."""

    host: str
    """By its name in its network; "" for this host, or if that is not known."""
    pid: int

    def __str__(self) -> str:
        return f"{self.pid} on {self.host}" if self.host else f"{self.pid}"


class NotUnderstood(RobocompError, ValueError):
    """What a process announces is no contract that this version reads."""


@dataclass(frozen=True)
class End:
    """One end of a channel."""

    middleware: str
    told: Told
    host: str = ""
    """Where its process runs, by the name in its network; "" for this host, or if that is not known."""
    via: Post | None = field(default=None, compare=False)
    """The scout that tells of it; None if this process sees it itself."""
    options: Mapping[str, Any] = field(default_factory=dict, compare=False)
    """The options with which this process opens its middleware."""
    supplement: Supplement | None = field(default=None, compare=False)
    """What is known of its contract besides the text."""

    @property
    def role(self) -> str:
        return self.told.role

    @property
    def provides(self) -> bool:
        return self.told.role in PROVIDERS

    @property
    def process(self) -> Process:
        return Process(self.host, self.told.pid)


class Way(NamedTuple):
    """How to send to users of a channel."""

    middleware: str
    via: Post | None
    """The scout that sends; None if this process does."""
    options: Mapping[str, Any]
    """With which this process opens the middleware."""


@dataclass
class Channel:
    """A channel by its full name, with all its ends. Ends that name no instance belong to no channel of their own."""

    name: str
    pattern: Pattern
    ends: list[End] = field(default_factory=list)

    @property
    def instance(self) -> str:
        return names.instance(self.name)

    @property
    def interface(self) -> str:
        return names.segment(self.name)

    @property
    def providers(self) -> list[End]:
        return [each for each in self.ends if each.provides]

    @property
    def users(self) -> list[End]:
        return [each for each in self.ends if not each.provides]

    @property
    def middlewares(self) -> list[str]:
        """The middlewares over which it can be reached: those of its providers, or of its users if it has none."""
        via = self.via
        return list(dict.fromkeys(each.middleware for each in self.providers or self.users if each.via is via))

    @property
    def via(self) -> Post | None:
        """The scout through which it can be reached; None if this process reaches it itself."""
        ends = self.providers or self.users
        return ends[0].via if ends and all(each.via for each in ends) else None

    @property
    def host(self) -> str:
        """That of the scout through which it can be reached; "" if this process reaches it itself."""
        return self.via.host if self.via else ""

    @property
    def hosts(self) -> list[str]:
        """The hosts that provide it, by their names."""
        found: dict[int, str] = {}
        for each in self.providers:  # of one process, not every end may tell its host
            found[each.told.pid] = found.get(each.told.pid) or each.host
        return list(dict.fromkeys(found.values()))

    def each_way(self, is_open: Callable[[Channel], bool] = lambda each: False) -> list[Channel]:
        """The smallest number of ways, found step by step, that together reach all of its providers.

        Each way is a channel with the providers that it reaches: over one middleware, from here or through one scout.
        Ways for which `is_open` returns True are left out, and no other way is added for the providers that they reach.
        A channel without providers has one way.
        """
        ways: dict[tuple[Post | None, str], list[End]] = {}
        for each in self.providers:
            ways.setdefault((each.via, each.middleware), []).append(each)
        offered = [(Channel(self.name, self.pattern, ends), set(map(_process, ends))) for ends in ways.values()]
        if not offered:
            return [] if is_open(self) else [self]
        heard = {process for each, reached in offered if is_open(each) for process in reached}
        found: list[Channel] = []
        while True:
            best, reached = max(offered, key=lambda each: len(each[1] - heard))  # of equal ones, the first
            if reached <= heard:
                return found
            found.append(best)
            heard |= reached

    @property
    def options(self) -> Mapping[str, Any]:
        """The options with which this process opens the first of its middlewares."""
        return next((each.options for each in self.providers or self.users if each.via is None), {})

    @property
    def ways(self) -> list[Way]:
        """The ways that together reach all of its users, each process once; without users, the way to a provider."""
        nearest = {_process(each): each for each in reversed(self.users or self.providers[:1])}
        found: list[Way] = []
        for each in reversed(nearest.values()):
            way = Way(each.middleware, each.via, each.options)
            if way not in found:
                found.append(way)
        return found

    @property
    def texts(self) -> dict[int, str]:
        """The different contracts by their fingerprints, those of providers first."""
        found: dict[int, str] = {}
        for each in (*self.providers, *self.users):
            found[each.told.fingerprint] = found.get(each.told.fingerprint) or each.told.text
        return found

    @cached_property
    def operation(self) -> Operation[Any]:
        """As its providers announce it. Raises NotUnderstood."""
        fingerprint, text = next(iter(self.texts.items()))
        text = text or (_own_texts().get(fingerprint, "") if self.interface in OWN else "")
        if not text:
            raise NotUnderstood(
                f"nothing announces the contract of {self.name}; name the folder of its IDSL file: -I DIR, or in a "
                "script connect(include=DIR)"
            )
        more = next((each.supplement for each in self.providers if each.supplement), None)
        try:
            return told.completed(_understood(text), more) if more else _understood(text)
        except ValueError as exc:
            raise NotUnderstood(f"the contract of {self.name} is not understood: {exc}") from exc

    @property
    def qos(self) -> QoS:
        """What its publishers offer."""
        return next((from_traits(each.told.traits) for each in self.providers if each.told.traits), DEFAULT_QOS)


@dataclass
class Running:
    """One component, or another program that announces ends."""

    owner: str
    pid: int
    host: str = ""
    """As that of its ends."""
    middlewares: list[str] = field(default_factory=list)
    offers: list[str] = field(default_factory=list)
    """Its interfaces, as `Laser`; of another instance that it stands for, `front/Laser`."""
    uses: list[str] = field(default_factory=list)
    """`Laser of world`, or `Laser` of any instance."""


class Network:
    """All channels, and the programs that use them."""

    def __init__(self, every: Iterable[End], *, own: bool = False) -> None:
        """With `own`, the interfaces of the framework belong to it, too."""
        self._stock: list[End] = []
        self._ends: list[End] = []
        self.channels: dict[str, Channel] = {}
        unnamed: list[End] = []
        for end in every:  # there may be tens of thousands
            parts = end.told.channel.split("/")
            if len(parts) < 3 or not _is_understood(end.told):
                continue
            each = _printable(end)
            is_own, is_any = parts[-2] in OWN, parts[-3] == names.ANY
            if is_own and not is_any:
                self._stock.append(each)
            if is_own and not own:
                continue
            self._ends.append(each)
            if is_any:
                unnamed.append(each)
            else:
                _add(self.channels, each)
        alike = _by_operation(self.channels.values()) if unnamed else {}
        for each in unnamed:
            for channel in alike.get(names.tail(each.told.channel), ()):
                if PATTERNS[each.role] is channel.pattern and names.matches(each.told.channel, channel.name):
                    channel.ends.append(each)
        self.channels = dict(sorted(self.channels.items()))

    @property
    def ends(self) -> Sequence[End]:
        """All that are understood, also those that name no instance."""
        return self._ends

    def stock(self, interface: str) -> Sequence[Channel]:
        """The channels of an interface of the framework, also if these do not belong to the network."""
        return self._by_interface.get(interface, [])

    def offering(self, interface: str, operations: Iterable[str]) -> list[str]:
        """The whole names of the instances that have all these operations of an interface of the framework.

        While a component starts, it announces one operation after the other.
        """
        found: dict[str, set[str]] = {}
        for each in self.stock(interface):
            instance, _, operation = each.name.rsplit("/", 2)
            if each.providers:
                found.setdefault(instance, set()).add(operation)
        return sorted(name for name, offered in found.items() if offered.issuperset(operations))

    @cached_property
    def _by_interface(self) -> Mapping[str, list[Channel]]:
        found: dict[str, list[Channel]] = {}
        for each in self.stocked.values():
            found.setdefault(names.segment(each.name), []).append(each)
        return found

    @cached_property
    def stocked(self) -> Mapping[str, Channel]:
        """The channels of all interfaces of the framework, by name, also if these do not belong to the network."""
        found: dict[str, Channel] = {}
        for each in self._stock:
            _add(found, each)
        return found

    def complete(self, search: Callable[[Mapping[int, str]], Mapping[int, str]]) -> Network:
        """Add the texts of contracts of which programs announce only the fingerprints. Returns this network.

        `search` is only called if there are any. It takes the fingerprints, each with the name of the interface, and
        returns texts, "" for those it has not found.
        """
        wanted = {
            fingerprint: channel.interface
            for channel in self.channels.values()
            for fingerprint, text in channel.texts.items()
            if not text
        }
        if wanted:
            texts = search(wanted)
            for channel in self.channels.values():
                channel.ends = [_defined(each, texts) for each in channel.ends]
        return self

    def components(self, *, tools: bool = False) -> list[Running]:
        """In the order of their names; with `tools`, also commands such as `rc echo`."""
        serving = {_process(end) for end in (*self._stock, *self._ends) if end.role == "serves"}
        found: dict[tuple[str, int, str], Running] = {}
        for end in self._ends:
            told = end.told
            if not tools and told.owner == TOOL and _process(end) not in serving:
                continue
            running = found.setdefault(_process(end), Running(told.owner, told.pid, end.host))
            instance, interface = names.instance(told.channel), names.segment(told.channel)
            if end.provides:
                where = running.offers
                whole = told.channel.rsplit("/", 2)[0]
                text = interface if told.owner in (whole, instance) else f"{instance}/{interface}"
            else:
                where = running.uses
                text = interface if instance == names.ANY else f"{interface} of {told.channel.rsplit('/', 2)[0]}"
            for listed, one in ((where, text), (running.middlewares, end.middleware)):
                if one not in listed:
                    listed.append(one)
        return sorted(found.values(), key=lambda each: (each.owner, each.host, each.pid))

    def named(self, name: str) -> list[Channel]:
        """The channels that a name means: `world/LaserPub/pushLaserData` or a part of it between slashes.

        A whole name means only its own channel. Raises ValueError if no channel has this name; the text has the closest
        name.
        """
        if whole := self.channels.get(name.strip("/")):
            return [whole]
        wanted = name.strip("/").split("/")
        found = [each for each in self.channels.values() if contains(each.name.split("/"), wanted)]
        if not found:
            raise ValueError(self._unknown(name))
        return [each for each in found if each.interface not in OWN] or found

    def only(self, instances: Collection[str]) -> Network:
        """The channels of these instances, by their whole names, and of named instances that they stand for."""
        kept = Network([])
        owners = {*instances, *(each.rpartition("/")[2] for each in instances)}
        for name, channel in self.channels.items():
            instance = "/".join(name.split("/")[:-2])
            if instance in instances or any(end.told.owner.strip("/") in owners for end in channel.providers):
                kept.channels[name] = channel
        return kept

    def topic(self, name: str) -> Channel:
        """The only topic that a name means. A whole name may also be one that nothing publishes so far, if a subscriber
        hears it. Raises ValueError.
        """
        hearing = [each for each in self._ends if each.role == "subscribes"]
        whole = name.strip("/")
        if whole not in self.channels and whole.count("/") >= 2:
            ends = [each for each in hearing if names.matches(each.told.channel, whole)]
            if ends:
                return Channel(whole, Pattern.PUBLISH, ends)
        found = [each for each in self.named(name) if each.pattern is Pattern.PUBLISH]
        if len(found) != 1:
            listed = ", ".join(each.name for each in found)
            raise ValueError(f"`{name}` may be {listed}; write more of the name" if found else f"`{name}` is no topic")
        return found[0]

    def closest(self, name: str, pattern: Pattern | None = None) -> str:
        """The name of a channel that is provided, or of a part of it, that was meant by a misspelt one, or "".

        A name that leaves out a part, such as `world/pushLaserData`, means the only channel that has the others. With a
        pattern, only channels of that pattern are meant.
        """
        fitting = [each for each in self.channels.values() if pattern in (None, each.pattern)]
        provided = [each.name for each in fitting if each.providers]
        shortened = [each for each in provided if _leaves_out(name.strip("/").split("/"), each.split("/"))]
        if len(shortened) == 1:
            return shortened[0]
        parts = {"/".join(each.split("/")[-count:]) for each in provided for count in (1, 2, 3)}
        parts |= {part for each in provided for part in each.split("/")}
        parts |= {each.rpartition("/")[0] for each in provided}
        return closest(name.strip("/"), parts)

    def no_topic(self, name: str) -> str:
        """Why a name that is there means no topic; "" if it means one, or is not there."""
        try:
            found = self.named(name)
        except ValueError:
            return ""
        if any(each.pattern is Pattern.PUBLISH for each in found):
            return ""
        return f"`{name}` is no topic: {found[0].name} is a {found[0].pattern}"

    def has_action(self, name: str) -> bool:
        """Whether this is the name of an action, or its end, instead of that of a channel."""
        return any(f"/{each}".endswith(f"/{name.strip('/')}-start") for each in self.channels)

    def _unknown(self, name: str) -> str:
        if self.has_action(name):
            return f"`{name}` is an action; `rc action` begins, shows and cancels its goals"
        near = self.closest(name)
        return f"`{name}` is not there; " + (f"did you mean `{near}`?" if near else "`rc list --channels` shows all")


def _leaves_out(words: Sequence[str], parts: Sequence[str]) -> bool:
    """Whether several words are parts of a name, in their order, with others between them."""
    rest = iter(parts)
    return len(words) > 1 and all(word in rest for word in words)


@lru_cache(maxsize=1)
def _own_texts() -> Mapping[int, str]:
    """The contracts that are known here of the framework's interfaces, by their fingerprints."""
    from ..runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE  # most programs announce them
    from ..runtime.RoboCompIntrospection import INTROSPECTION_INTERFACE, INTROSPECTIONPUB_INTERFACE

    known = (COMMONBEHAVIOR_INTERFACE, INTROSPECTION_INTERFACE, INTROSPECTIONPUB_INTERFACE)
    return {each.fingerprint: each.text for interface in known for each in interface.operations}


@lru_cache(maxsize=256)
def _understood(text: str) -> Operation[Any]:
    return told.operation(text)


def _process(end: End) -> tuple[str, int, str]:
    return end.told.owner, end.told.pid, end.host


def _by_operation(channels: Iterable[Channel]) -> dict[str, list[Channel]]:
    """Channels by interface and operation: an end without an instance has to look among few of them."""
    found: dict[str, list[Channel]] = {}
    for each in channels:
        found.setdefault(names.tail(each.name), []).append(each)
    return found


def _add(channels: dict[str, Channel], end: End) -> None:
    name = end.told.channel
    channel = channels.get(name)
    if channel is None:
        channel = channels[name] = Channel(name, PATTERNS[end.role])
    channel.ends.append(end)


def _defined(end: End, texts: Mapping[int, str]) -> End:
    text = end.told.text or texts.get(end.told.fingerprint, "")
    return replace(end, told=end.told._replace(text=text))


def _is_understood(told: Told) -> bool:
    return told.role in PATTERNS and told.channel.isprintable()


def _printable(end: End) -> End:
    """Its owner is named to people, and may call itself anything."""
    owner = end.told.owner
    return end if owner.isprintable() else replace(end, told=end.told._replace(owner=one_line(owner)))


def contains(parts: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether some parts of a name stand side by side in it."""
    return any(parts[at : at + len(wanted)] == wanted for at in range(len(parts) - len(wanted) + 1))
