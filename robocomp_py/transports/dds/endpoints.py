"""Discovery: the endpoints of all participants, with the descriptions that they carry."""

from __future__ import annotations

import json
import threading
import zlib
from collections.abc import Callable, Iterable, Set
from dataclasses import dataclass
from functools import partial
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import InstanceState, Policy
from cyclonedds.domain import DomainParticipant

from ...wire.names import ANY as STAR
from ...wire.names import is_namespace, matches, tail
from ..leader_followers import Job
from .library import as_transport_error, creating
from .unsafe import read_condition, reference, take_endpoints

_MARK = b"robocomp1 "
_MOST_TEXT = 8192


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A reader or writer of the domain. The fields from `role` on are empty if another program made it."""

    handle: int
    topic: str
    partition: str
    writes: bool
    role: str = ""
    channel: str = ""
    fingerprint: int = 0
    text: str = ""
    id: int = 0
    reliable: bool = False
    latched: bool = False
    owner: str = ""
    pid: int = 0
    traits: str = ""
    """Those of its QoS, in the form of `contract.qos.traits`."""

    @property
    def key(self) -> tuple[int, int]:
        return self.id, self.fingerprint


Said = dict[str, Any]
"""The fields of an `Endpoint` that USER_DATA carries."""

_DESCRIBED: dict[str, type] = {
    "role": str, "channel": str, "fingerprint": int, "text": str, "id": int, "reliable": bool, "latched": bool,
    "owner": str, "pid": int, "traits": str,
}  # fmt: skip


def user_data(said: Said) -> Policy.Userdata:
    """The USER_DATA of an endpoint: the description of its link, without its contract if that is too long."""
    packed = _packed(said)
    return Policy.Userdata(packed if len(packed) <= _MOST_TEXT else _packed(said | {"text": ""}))


def announced_data(said: list[Said]) -> list[Policy.Userdata]:
    """The USER_DATA of endpoints that announce all these links: of as many endpoints as it takes."""
    if not said:
        return []
    packed = _packed(said)
    if len(packed) <= _MOST_TEXT:
        return [Policy.Userdata(packed)]
    if len(said) == 1:
        return [user_data(said[0])]
    half = len(said) // 2
    return [*announced_data(said[:half]), *announced_data(said[half:])]


def _packed(said: Said | list[Said]) -> bytes:
    return _MARK + zlib.compress(json.dumps(said).encode())


def _said(data: bytes) -> list[Said]:
    if not data.startswith(_MARK):
        return [{}]
    try:
        said = json.loads(zlib.decompressobj().decompress(data[len(_MARK) :], 1 << 20))
        each = said if isinstance(said, list) else [said]
        return [{key: kind(said[key]) for key, kind in _DESCRIBED.items()} for said in each]
    except (ValueError, TypeError, KeyError, ArithmeticError, RecursionError, zlib.error):
        return [{}]  # from another program, or another version


class Endpoints:
    """The readers and writers of the domain, our own included, from the library's built-in topics."""

    def __init__(
        self, participant: DomainParticipant, attach: Callable[[int, Callable[[], Iterable[Job]]], object]
    ) -> None:
        """`attach` has the receiving thread call a function while a condition holds."""
        self._lock = threading.Lock()
        self._known: dict[int, list[Endpoint]] = {}
        """By handle: the endpoint, or all links that it announces (`announcing`)."""
        self._index: dict[tuple[str, str], dict[Endpoint, None]] = {}
        """By role and channel, and by role and the `_tail` of a channel."""
        self._topics: dict[str, dict[Endpoint, None]] = {}
        self.on_change: Callable[[Set[str]], None] = lambda channels: None
        """Called with the names of the channels whose endpoints have changed."""
        self._readers = []
        for topic in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription):
            with creating, as_transport_error("discovery"):
                reader = BuiltinDataReader(participant, topic)
            self._readers.append((reader, partial(_endpoint, topic is BuiltinTopicDcpsPublication)))
            condition = read_condition(reference(reader), "discovery")
            attach(condition, self._look)

    def find(self, role: str, channel: str) -> list[Endpoint]:
        """Ends of a channel in that role; either channel may have `*` for its instance."""
        with self._lock:
            named = self._index.get((role, tail(channel) if STAR in channel else channel), ())
            stars = self._index.get((role, STAR + tail(channel)), ())
            found = dict.fromkeys(each for each in named if matches(channel, each.channel))
            found |= dict.fromkeys(each for each in stars if matches(each.channel, channel))
            return list(found)

    def every(self) -> list[Endpoint]:
        """All readers, writers and announced links."""
        with self._lock:
            return [each for endpoints in self._known.values() for each in endpoints]

    def on_topic(self, topic: str) -> list[Endpoint]:
        """All readers and writers of a topic."""
        with self._lock:
            return list(self._topics.get(topic, ()))

    def published_by_others(self, channel: str) -> list[str]:
        """The matching channels that programs without robocomp_py publish; `channel` may have `*`."""
        with self._lock:
            found = [_name(each) for each in self._index.get(("", tail(channel)), ()) if each.writes]
        return sorted({name for name in found if is_namespace(name) and matches(channel, name)})

    def there(self, endpoint: Endpoint) -> bool:
        return endpoint in self._known.get(endpoint.handle, ())

    def _look(self) -> list[Job]:
        changed: set[str] = set()
        for reader, make in self._readers:
            while True:
                taken = take_endpoints(reference(reader), 64, make)
                if not taken:
                    break
                with self._lock:
                    for handle, endpoints in taken:
                        changed |= self._replace_endpoints(handle, endpoints)
        if changed:
            self.on_change(changed)
        return []

    def _replace_endpoints(self, handle: int, endpoints: list[Endpoint]) -> set[str]:
        """Replace the endpoints of a handle; returns the channels that changed."""
        endpoints = [each for each in dict.fromkeys(endpoints) if each.topic.startswith(TOPIC)]
        changed: set[str] = set()
        for each in self._known.pop(handle, ()):
            changed |= _channels(each)
            for index, key in self._index_entries(each):
                del index[key][each]
                if not index[key]:
                    del index[key]
        for each in endpoints:
            self._known.setdefault(handle, []).append(each)
            changed |= _channels(each)
            for index, key in self._index_entries(each):
                index.setdefault(key, {})[each] = None
        return changed

    def _index_entries(self, endpoint: Endpoint) -> Iterable[tuple[dict[Any, dict[Endpoint, None]], Any]]:
        role, channel = endpoint.role, endpoint.channel or _name(endpoint)
        yield self._topics, endpoint.topic
        for key in {channel, tail(channel), STAR + tail(channel) if STAR in channel else channel}:
            yield self._index, (role, key)


TOPIC = "rc/"
"""Prefix of our topics' names."""


def _name(endpoint: Endpoint) -> str:
    """The channel of the topic of an endpoint."""
    return endpoint.topic.removeprefix(TOPIC)


def _channels(endpoint: Endpoint) -> set[str]:
    """The names of the channels that an endpoint may belong to."""
    if endpoint.channel:
        return {endpoint.channel}
    name = _name(endpoint)  # an endpoint of another program
    return {name, *(name.removesuffix(end) for end in ("Request", "Reply", "Credit"))}


def concerned(channel: str, changed: Set[str]) -> bool:
    """Whether a change at these channels may concern an end of this channel."""
    if channel in changed:
        return True
    either = changed if STAR in channel else [each for each in changed if STAR in each]
    return any(matches(channel, each) or matches(each, channel) for each in either)


# Called by the library for each sample of a built-in topic; it must not raise.


def _endpoint(
    writes: bool,
    key: bytes,
    participant_key: bytes,
    participant: int,
    topic: str,
    kind: str,
    qos: tuple[bytes, str] | None,
    info: Any,
    type_id: bytes | None,
) -> tuple[int, list[Endpoint]]:
    handle = info.instance_handle
    if info.instance_state != InstanceState.Alive or qos is None:
        return handle, []
    return handle, [Endpoint(handle, topic, qos[1], writes, **said) for said in _said(qos[0])]
