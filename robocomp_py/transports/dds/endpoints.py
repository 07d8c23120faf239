"""Who is there: the endpoints of all participants, as each says of itself."""

from __future__ import annotations

import ctypes
import json
import threading
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from cyclonedds._clayer import (  # type: ignore[import-not-found]  # compiled, without types
    ddspy_take_endpoint,
)
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import InstanceState, Policy
from cyclonedds.domain import DomainParticipant

from ...wire.names import matches
from ..crew import Job
from .library import (
    ANY,
    as_transport_error,
    checked,
    creating,
    dds_create_readcondition,
    dds_qget_partition,
    dds_qget_userdata,
    library,
)

if TYPE_CHECKING:
    from .bus import Loop


_MARK = b"robocomp1 "
_MOST_TEXT = 8192


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A reader or writer of the domain. What its owner says about it is empty if it is none of ours."""

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
    """Of its QoS, as `contract.qos.traits` writes them."""


def user_data(**said: Any) -> Policy.Userdata:
    """What an endpoint of ours says about itself."""
    packed = _MARK + zlib.compress(json.dumps(said).encode())
    if len(packed) > _MOST_TEXT:
        packed = _MARK + zlib.compress(json.dumps(said | {"text": ""}).encode())
    return Policy.Userdata(packed)


def _said(data: bytes) -> dict[str, Any]:
    if not data.startswith(_MARK):
        return {}
    try:
        said = json.loads(zlib.decompressobj().decompress(data[len(_MARK) :], 1 << 20))
        known = {"role": str, "channel": str, "fingerprint": int, "text": str, "id": int, "owner": str, "pid": int}
        known |= {"reliable": bool, "latched": bool, "traits": str}
        return {key: kind(said[key]) for key, kind in known.items()}
    except (ValueError, TypeError, KeyError, zlib.error):
        return {}  # not written by us, or by another version


class Endpoints:
    """The readers and writers of the domain, our own included, from the library's built-in topics."""

    def __init__(self, participant: DomainParticipant, loop: Loop) -> None:
        self._lock = threading.Lock()
        self._known: dict[int, Endpoint] = {}
        self._index: dict[tuple[str, str], dict[int, Endpoint]] = {}
        self._topics: dict[str, dict[int, Endpoint]] = {}
        self.on_change: Callable[[], None] = lambda: None
        self._readers = []
        for topic in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription):
            with creating, as_transport_error("looking for others"):
                reader = BuiltinDataReader(participant, topic)
            self._readers.append((reader, partial(_endpoint, topic is BuiltinTopicDcpsPublication)))
            condition = checked(dds_create_readcondition(reader._ref, ANY), "looking for others")
            loop.attach(condition, self._look)

    def find(self, role: str, channel: str) -> list[Endpoint]:
        """Ends of a channel in that role; the channel, or theirs, may have `*` for its instance."""
        with self._lock:
            candidates = list(self._index.get((role, _tail(channel)), {}).values())
        return [e for e in candidates if matches(channel, e.channel) or matches(e.channel, channel)]

    def on_topic(self, topic: str) -> list[Endpoint]:
        """All readers and writers of a topic."""
        with self._lock:
            return list(self._topics.get(topic, {}).values())

    def there(self, endpoint: Endpoint) -> bool:
        return endpoint.handle in self._known

    def _look(self) -> list[Job]:
        changed = False
        for reader, make in self._readers:
            while True:
                taken = ddspy_take_endpoint(reader._ref, 64, make, _qos)
                if type(taken) is int or not taken:
                    break
                with self._lock:
                    for handle, alive, endpoint in taken:
                        changed |= self._add(endpoint) if alive else self._remove(handle)
        if changed:
            self.on_change()
        return []

    def _add(self, endpoint: Endpoint | None) -> bool:
        if endpoint is None or not endpoint.topic.startswith("rc/"):
            return False
        self._remove(endpoint.handle)
        self._known[endpoint.handle] = endpoint
        self._index.setdefault((endpoint.role, _tail(endpoint.channel)), {})[endpoint.handle] = endpoint
        self._topics.setdefault(endpoint.topic, {})[endpoint.handle] = endpoint
        return True

    def _remove(self, handle: int) -> bool:
        endpoint = self._known.pop(handle, None)
        if endpoint is None:
            return False
        for index, key in ((self._index, (endpoint.role, _tail(endpoint.channel))), (self._topics, endpoint.topic)):
            there: dict[int, Endpoint] = index[key]  # type: ignore[index]  # each with its own kind of key
            del there[handle]
            if not there:
                del index[key]  # type: ignore[arg-type]
        return True


def _tail(channel: str) -> str:
    """Interface and operation: what a channel has in common with all that it may match."""
    return "/".join(channel.split("/")[-2:])


# Called by the library for each sample of a built-in topic; they must not raise.


def _qos(pointer: int) -> tuple[bytes, str]:
    """User data and partition. The library's own conversion keeps them in variables that all threads share."""
    data, size = ctypes.c_void_p(), ctypes.c_size_t()
    said = b""
    if dds_qget_userdata(pointer, ctypes.byref(data), ctypes.byref(size)) & 1 and data.value:
        said = ctypes.string_at(data.value, size.value)
        library.dds_free(data)
    count, names = ctypes.c_uint32(), ctypes.POINTER(ctypes.c_void_p)()
    partition = ""
    if dds_qget_partition(pointer, ctypes.byref(count), ctypes.byref(names)) & 1 and count.value:
        for number in range(count.value):
            if number == 0:
                partition = ctypes.string_at(names[0]).decode(errors="replace")
            library.dds_free(names[number])
        library.dds_free(names)
    return said, partition


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
) -> tuple[int, bool, Endpoint | None]:
    alive = info.instance_state == InstanceState.Alive
    if not alive or qos is None:
        return info.instance_handle, False, None
    return info.instance_handle, True, Endpoint(info.instance_handle, topic, qos[1], writes, **_said(qos[0]))
