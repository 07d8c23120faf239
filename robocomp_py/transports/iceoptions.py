"""The options of transport `ice`, and Ice's own way of writing addresses: text and values, without Ice.

    [transports.ice]
    host = "127.0.0.1"                       for whatever names no `-h`: endpoints, proxies, and the TopicManager
    storm = "IceStorm/TopicManager:tcp -p 9999"
    message_size_max = 67108864              bytes
    [transports.ice.endpoints]               where what is provided is served; else at a port that is free
    Laser = "tcp -p 10003"                   by interface, `Laser1` for the second one; `front/Laser` for that of a
                                             named instance
    LaserPubTopic = "tcp -p 0"               where publications arrive, as RoboComp calls that
    [transports.ice.proxies]                 where what is used is found, if not in the directory
    base = "laser:tcp -h 10.0.0.2 -p 10003"  by the instance that `from` names: `base/Laser` for one of its interfaces,
                                             `/robot2/base/Laser` with its namespace
    Laser = "laser:tcp -p 10003"             by the interface, for any instance
    [transports.ice.topics]                  what IceStorm calls them; else as the interface, behind its namespace
    LaserPub = "zed/LaserPub"                by the interface; `base/LaserPub` for that of one instance
    [transports.ice.properties]              whatever else Ice itself knows
    "Ice.Override.ConnectTimeout" = "2000"

They are not in the transport, because checks of configurations and plans of networks read them, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..contract.parameters import Complaint, Key
from ..errors import ConfigurationError
from ..spelling import unknown
from ..wire import names

HOST = "127.0.0.1"
STORM = "IceStorm/TopicManager:tcp -p 9999"
"""Where RoboComp's `rcnode` has it."""

MOST_BYTES = 2**31 - 1
"""Ice counts the bytes of a message in 32 bits."""

FIXED: Mapping[str, str] = {
    "Ice.RetryIntervals": "-1",  # Ice would repeat; we do, and know what was asked before
    "Ice.Default.CollocationOptimized": "0",  # what is sent to ourselves takes the same way as everything
    "Ice.Default.EncodingVersion": "1.1",
    # One thread reads requests, one reads replies; both leave everything else to the receiving threads.
    "Ice.ThreadPool.Server.Size": "1",
    "Ice.ThreadPool.Server.SizeMax": "1",
    "Ice.ThreadPool.Client.Size": "1",
    "Ice.ThreadPool.Client.SizeMax": "1",
    "Ice.Warn.Dispatch": "0",
    "Ice.Warn.UnusedProperties": "0",
    # What is told under a lock of Ice's, which a thread may want that holds Python's: both would wait for ever.
    "Ice.Warn.Connections": "0",
    "Ice.Trace.Network": "0",
    "Ice.Trace.Protocol": "0",
}
"""Properties of Ice that the transport needs to be so."""

_SAID_BY = {
    "Ice.Default.Host": "`host` says it",
    "Ice.MessageSizeMax": "`message_size_max` says it",
    "Ice.Default.InvocationTimeout": "each call has its deadline",
}
"""Properties that are set from elsewhere."""

_UNSEEN = ("Ice.Admin.", "Ice.Default.Locator", "Ice.Default.Router")
"""Prefixes of properties that open connections past the checks of this package."""

PROTOCOLS = ("tcp", "ssl", "ws", "wss", "default")
"""Of endpoints that calls can go to."""


# -- addresses -------------------------------------------------------------------------


@dataclass(frozen=True)
class IceEndpoint:
    """`tcp -h localhost -p 10003`; no host is the one of the options, no port any that is free."""

    protocol: str
    host: str = ""
    port: int = 0


@dataclass(frozen=True)
class IceProxy:
    """`IceStorm/TopicManager -t:tcp -p 9999`."""

    identity: str
    """With its category in front: `IceStorm/TopicManager`."""
    endpoints: tuple[IceEndpoint, ...]


def parse_proxy(text: str) -> IceProxy:
    """The parts of a proxy string. Raises ValueError, with a message for people, if it is not one."""
    head, *endpoints = _split(text)
    words = _words(head)
    if not words:
        raise ValueError(f"`{text}` lacks the name of an object, as in `laser:tcp -h localhost -p 10003`")
    name, *options = words
    if name.lower() in PROTOCOLS and (options[:1] == ["-h"] or options[:1] == ["-p"]):
        raise ValueError(f"`{text}` lacks the name of an object in front of it: `NAME:{text.strip()}`")
    if "@" in options:
        raise ValueError(f"`{text}` needs IceGrid to be found: write `{name}:tcp -h HOST -p PORT`")
    _check_options(text, options, _OF_PROXIES)
    if not endpoints:
        raise ValueError(f"`{text}` says no place: write `{name}:tcp -h HOST -p PORT`")
    found = tuple(_endpoint(each, text) for each in endpoints)
    for each in found:
        if not each.port:
            raise ValueError(f"`{text}` says no port: write `-p` and the number of the port that it is served at")
    return IceProxy(name, found)


def parse_endpoints(text: str) -> tuple[IceEndpoint, ...]:
    """What endpoints say at which something is served; raises ValueError with the reason, for people."""
    first, *others = _split(text)
    if others and _is_endpoint(others[0]) and not _is_endpoint(first):
        raise ValueError(f"`{text}` begins with the name of an object: write `{':'.join(others).strip()}`")
    return tuple(_endpoint(part, text) for part in (first, *others))


def _is_endpoint(part: str) -> bool:
    return bool(words := _words(part)) and words[0].lower() in PROTOCOLS


def _endpoint(part: str, text: str) -> IceEndpoint:
    words = _words(part)
    if not words:
        raise ValueError(f"`{text}` has an empty endpoint; write `tcp -h HOST -p PORT`")
    protocol, *options = words
    if protocol.lower() not in PROTOCOLS:
        raise ValueError(f"`{text}`: {unknown('protocol', protocol, PROTOCOLS)}")
    said = _check_options(text, options, _OF_ENDPOINTS)
    port = said.get("-p", "0")
    if not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"`{text}`: `-p {port}` is not a port; ports are 1 to 65535")
    return IceEndpoint(protocol.lower(), said.get("-h", ""), int(port))


_OF_ENDPOINTS = {"-h": True, "-p": True, "-t": True, "-z": False, "-r": True, "--sourceAddress": True}
_OF_PROXIES = {"-f": True, "-e": True, "-p": True, "-t": False, "-o": False, "-O": False, "-d": False}
_OF_PROXIES |= {"-D": False, "-s": False}
"""Options of Ice, and whether a value follows."""


def _check_options(text: str, words: Iterable[str], known: Mapping[str, bool]) -> dict[str, str]:
    said: dict[str, str] = {}
    rest = iter(words)
    for word in rest:
        if word not in known:
            raise ValueError(f"`{text}`: {unknown('option', word, known)}")
        value = next(rest, None) if known[word] else ""
        if value is None or (known[word] and value in known):
            raise ValueError(f"`{text}`: `{word}` lacks its value")
        said[word] = value
    return said


def _split(text: str) -> list[str]:
    """A proxy's parts, which have colons between them; those in quotes are none."""
    return _COLON.split(text)


def _words(part: str) -> list[str]:
    return [word.strip("\"'") if word[:1] in "\"'" else word for word in _WORD.findall(part)]


_COLON = re.compile(r""":(?=(?:[^"']|"[^"]*"|'[^']*')*$)""")
_WORD = re.compile(r""""[^"]*"|'[^']*'|@|[^\s@]+""")


# -- options ---------------------------------------------------------------------------


@dataclass(frozen=True)
class IceOptions:
    """What `[transports.ice]` says, with its defaults."""

    host: str = HOST
    storm: str = STORM
    message_size_max: int = 0
    """Bytes; 0 for what the transport takes for enough."""
    endpoints: Mapping[str, str] = field(default_factory=dict)
    proxies: Mapping[str, str] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    properties: Mapping[str, str] = field(default_factory=dict)

    def proxy_of(self, channel: str) -> str | None:
        """Where a channel's operations are found, if the options say so."""
        return _of(self.proxies, channel)

    def endpoint_of(self, channel: str) -> str | None:
        """Where an operation is served that we provide, if the options say so."""
        named = f"{names.instance(channel)}/{names.segment(channel)}"
        return self.endpoints.get(named) or self.endpoints.get(names.segment(channel))

    def subscriber_endpoint_of(self, channel: str) -> str | None:
        """Where publications of a channel arrive, if the options say so."""
        return self.endpoints.get(f"{names.segment(channel)}Topic")

    def topic_of(self, channel: str) -> str:
        """What IceStorm calls the topic of a channel."""
        namespace, segment = "/".join(channel.split("/")[:-3]), names.segment(channel)
        return self.topic_said_of(channel) or "/".join(filter(None, (namespace, segment)))

    def topic_said_of(self, channel: str) -> str | None:
        """The same, if the options say so."""
        return _of(self.topics, channel) or self.topics.get(names.segment(channel))


def key_of(channel: str) -> str:
    """The key of an interface of an instance in `proxies` and `topics`."""
    *namespace, instance, segment, _ = channel.split("/")
    return "/".join(("", *namespace, instance, segment)) if namespace else f"{instance}/{segment}"


def operation_of(channel: str) -> str:
    """What Ice calls the operation of a channel: names of Slice have no hyphen."""
    return names.operation(channel).replace("-", "_")


def identity_of(channel: str) -> str:
    """What the object that serves a channel's operations is called: `laser`."""
    return names.segment(channel).lower()


def _of(table: Mapping[str, str], channel: str) -> str | None:
    *namespace, instance, segment, _ = channel.split("/")
    if instance == names.ANY:
        return table.get(segment)
    keys = "/".join(("", *namespace, instance, segment)), f"{instance}/{segment}", instance
    return next((table[key] for key in keys if key in table), None)


def read(options: Mapping[str, Any]) -> IceOptions:
    """The options of a table; raises ConfigurationError with the first thing that is wrong."""
    for complaint in examine(options):
        raise ConfigurationError(f"transports.ice.{complaint.path}: {complaint.message}")
    texts = {name: {str(key): str(value) for key, value in options.get(name, {}).items()} for name in _TABLES}
    return IceOptions(
        host=options.get("host", HOST),
        storm=options.get("storm") or STORM,
        message_size_max=options.get("message_size_max", 0),
        **texts,
    )


def examine(options: Mapping[str, Any]) -> Iterator[Complaint]:
    """All that is wrong with a table of options, with its keys below `transports.ice`."""
    for name, value in options.items():
        if name in _TABLES:
            yield from _examine_table(name, value)
        elif name == "message_size_max":
            if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= MOST_BYTES:
                yield Complaint(
                    (name,), f"`{name}` is {value!r}; allowed: bytes, 0 to {MOST_BYTES}", "config-out-of-range"
                )
        elif name not in _TEXTS:
            yield Complaint(
                (name,), unknown("key", name, (*_TEXTS, "message_size_max", *_TABLES)), "config-unknown-key"
            )
        elif not isinstance(value, str):
            yield Complaint((name,), f"`{name}` is a string, not {value!r}", "config-wrong-type")
        elif name == "host" and not re.fullmatch(r"[^\s\"'/]+", value):
            yield Complaint((name,), f"{value!r} is not an address; {HOST} is this machine alone", "config-bad-address")
        elif name == "storm" and value:
            yield from _examine_address((name,), value)


_TEXTS = ("host", "storm")
_TABLES = ("endpoints", "proxies", "topics", "properties")


def _examine_table(name: str, table: Any) -> Iterator[Complaint]:
    if not isinstance(table, Mapping):
        yield Complaint((name,), f"`{name}` is a table, not {table!r}", "config-wrong-type")
        return
    for key, value in table.items():
        at: Key = (name, key)
        if name == "properties":
            yield from _examine_property(at, key, value)
        elif not isinstance(value, str):
            yield Complaint(at, f"`{key}` is a string, not {value!r}", "config-wrong-type")
        elif name == "topics":
            if not all(value.split("/")):
                yield Complaint(at, f"{value!r} is not a topic name: parts with `/` between them", "config-bad-name")
        else:
            yield from _examine_address(at, value)


def _examine_address(at: Key, text: str) -> Iterator[Complaint]:
    parse = parse_endpoints if at[0] == "endpoints" else parse_proxy
    try:
        parse(text)
    except ValueError as exc:
        yield Complaint(at, str(exc), "config-bad-address")


def _examine_property(at: Key, key: str, value: Any) -> Iterator[Complaint]:
    if isinstance(value, Mapping):
        whole = key
        while isinstance(value, Mapping):
            name, value = next(iter(value.items()), ("…", None))
            whole += f".{name}"
        yield Complaint(at, f'the name of a property is one key: write "{whole}" in quotes', "config-wrong-type")
    elif not key.startswith(("Ice.", "IceSSL.")):
        yield Complaint(at, f"`{key}` is not a property of Ice; their names begin with `Ice.`", "config-unknown-key")
    elif why := why_not_set(key, value):
        yield Complaint(at, why, "config-unknown-key")
    elif isinstance(value, list):
        yield Complaint(at, f"`{key}` is a string, not {value!r}", "config-wrong-type")


def why_not_set(key: str, value: object) -> str:
    """Why a property of Ice cannot have a value; "" if it can."""
    if key in _SAID_BY:
        return f"`{key}` is set by the transport itself; {_SAID_BY[key]}"
    if key in FIXED and str(value) != FIXED[key]:
        return f"`{key}` is {FIXED[key]}, as the transport needs it"
    if key.startswith(_UNSEEN):
        return f"`{key}` has no place here: programs are reached by `endpoints`, and reach others by `proxies`"
    return ""
