"""What we need of Cyclone DDS: a domain per process, readers and writers of bytes, waiting, and who is there.

Samples go through the library as the bytes they are on the wire. Listeners are never used (they run
on the library's threads and may wait for the interpreter's lock holding one of their own); one
thread waits for everything in `Loop.receive`. No call here waits while it holds the interpreter,
except a small sample written to a writer that is full, for `BLOCKING_MS`.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import logging
import os
import threading
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from cyclonedds._clayer import (  # type: ignore[import-not-found]  # compiled, without types
    ddspy_take,
    ddspy_take_endpoint,
    ddspy_write,
)
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import DDSException, Entity, InstanceState, Policy, Qos, SampleState, ViewState
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.internal import DDS
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic

from ..errors import ConfigurationError, TransportError
from ..wire.names import matches
from .crew import Job
from .dds_types import DdsType

log = logging.getLogger("robocomp.transport.dds")

BLOCKING_MS = 2
"""How long the library waits for room before it says that a sample was not written."""

LARGE = 32 * 1024
"""From so many bytes on, writing a sample takes longer than letting other threads run meanwhile."""

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_TIMEOUT = DDSException.DDS_RETCODE_TIMEOUT
_DELETED = (DDSException.DDS_RETCODE_BAD_PARAMETER, DDSException.DDS_RETCODE_ALREADY_DELETED)
_FOREVER = 2**63 - 1
_NEVER = float("inf")


class _Container(ctypes.Structure):
    """A sample, as the types of the Python binding hand it to the library."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t))


_library = ctypes.CDLL(DDS._dll_handle._name)  # a handle of our own: declaring functions on theirs would change it


def _function(name: str, *arguments: Any) -> Callable[..., int]:
    function = getattr(_library, name)
    function.argtypes, function.restype = arguments, ctypes.c_int32
    return function  # type: ignore[no-any-return]  # ctypes' functions have no signature


_int, _handles = ctypes.c_int32, ctypes.POINTER(ctypes.c_uint64)
_delete = _function("dds_delete", _int)
_write = _function("dds_write", _int, ctypes.c_void_p)
_create_waitset = _function("dds_create_waitset", _int)
_attach = _function("dds_waitset_attach", _int, _int, ctypes.c_ssize_t)
_detach = _function("dds_waitset_detach", _int, _int)
_wait = _function("dds_waitset_wait", _int, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int64)
_create_guard = _function("dds_create_guardcondition", _int)
_set_guard = _function("dds_set_guardcondition", _int, ctypes.c_bool)
_create_condition = _function("dds_create_readcondition", _int, ctypes.c_uint32)
_matched_readers = _function("dds_get_matched_subscriptions", _int, _handles, ctypes.c_size_t)
_matched_writers = _function("dds_get_matched_publications", _int, _handles, ctypes.c_size_t)
_user_data = _function(
    "dds_qget_userdata", ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_size_t)
)
_partitions = _function(
    "dds_qget_partition",
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint32),
    ctypes.POINTER(ctypes.POINTER(ctypes.c_void_p)),
)
_library.dds_free.argtypes, _library.dds_free.restype = (ctypes.c_void_p,), None

_creating = threading.RLock()
"""Held while the library makes something: it keeps some of that in variables of its classes."""


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    try:
        yield
    except DDSException as exc:
        raise TransportError(f"dds: {doing}: {exc}") from exc


def _checked(code: int, doing: str) -> int:
    if code < 0:
        raise TransportError(f"dds: {doing}: {DDSException(code)}")
    return code


def _forget(entity: Entity) -> None:
    """Delete an entity now, and not when its last reference happens to go; what that leaves is inert."""
    entity.__del__()


# -- domains ------------------------------------------------------------------


def settings(interface: str) -> dict[tuple[str, str], str]:
    """Our configuration of a domain: elements by section and name."""
    here = interface == "lo"
    found = {
        ("General", "MaxMessageSize"): "65500B" if here else "1400B",
        ("Discovery", "ParticipantIndex"): "auto",
        ("Discovery", "MaxAutoParticipantIndex"): "250",
        ("Discovery", "SPDPInterval"): "1s",
        ("Discovery", "LeaseDuration"): "2s",
        ("Internal", "SocketReceiveBufferSize"): '<SocketReceiveBufferSize max="20MB"/>',
        ("Internal", "Watermarks"): (
            "<WhcLow>8MB</WhcLow><WhcHigh>32MB</WhcHigh><WhcHighInit>32MB</WhcHighInit><WhcAdaptive>false</WhcAdaptive>"
        ),
        ("Tracing", "Verbosity"): "severe",
        ("Tracing", "OutputFile"): "stderr",  # not a file in whatever folder we are in
    }
    if interface:
        found["General", "Interfaces"] = f"<NetworkInterface name={quoteattr(interface)}/>"
    if here:
        found["General", "FragmentSize"] = "63000B"
        found["Internal", "NackDelay"] = "10ms"  # what is lost here did not fit the socket's buffer: ask at once
        found["Internal", "MaxQueuedRexmitBytes"] = "16MB"
        found["General", "AllowMulticast"] = "false"
        found["Discovery", "Peers"] = '<Peer Address="127.0.0.1"/>'
    return found


_WHERE = {("General", "Interfaces"), ("General", "AllowMulticast"), ("Discovery", "Peers")}
"""Ours for one network make no sense beside the user's choice of another."""


def compose(ours: Mapping[tuple[str, str], str], uri: str, domain: int) -> str:
    """Our configuration with the user's (`CYCLONEDDS_URI`) behind it; where both set something, ours is left out."""
    theirs = _elements(uri, domain)
    chosen = {("general", "interfaces"), ("general", "networkinterfaceaddress")} & theirs
    out = ElementTree.Element("CycloneDDS")
    inside = ElementTree.SubElement(out, "Domain", Id="any")
    sections: dict[str, ElementTree.Element] = {}
    for key, value in ours.items():
        section, name = key
        if (section.lower(), name.lower()) in theirs or (chosen and key in _WHERE):
            continue
        if section not in sections:
            sections[section] = ElementTree.SubElement(inside, section)
        whole = value if value.startswith(f"<{name}") else f"<{name}>{value}</{name}>"
        sections[section].append(ElementTree.fromstring(whole))
    text = ElementTree.tostring(out).decode()
    if not uri.isascii():
        raise ConfigurationError("CYCLONEDDS_URI: Cyclone DDS takes ASCII only")
    return f"{text},{uri}" if uri.strip() else text


def _elements(uri: str, domain: int) -> set[tuple[str, str]]:
    """What a configuration sets for this domain, as section and element, in lower case."""
    found: set[tuple[str, str]] = set()
    for text in _documents(uri):
        try:
            root = ElementTree.fromstring(f"<all>{_without_prologue(text)}</all>")
        except ElementTree.ParseError as exc:
            raise ConfigurationError(f"CYCLONEDDS_URI: not well-formed: {exc}") from exc
        for section in _sections(root, domain):
            found |= {(section.tag.lower(), element.tag.lower()) for element in section}
    return found


def _documents(uri: str) -> Iterator[str]:
    if uri.lstrip().startswith("<"):
        yield uri.replace(">,<", "><")
        return
    for part in filter(None, map(str.strip, uri.split(","))):
        path = unquote(urlparse(part).path) if part.startswith("file:") else part
        path = os.path.expanduser(os.path.expandvars(path))
        try:
            with open(path, encoding="utf-8") as file:
                yield file.read()
        except OSError as exc:
            raise ConfigurationError(f"CYCLONEDDS_URI: {path}: {exc.strerror}") from exc


def _without_prologue(text: str) -> str:
    _, end, rest = text.partition("?>")
    return rest if end and text.lstrip().startswith("<?") else text


def _sections(element: ElementTree.Element, domain: int) -> Iterator[ElementTree.Element]:
    for child in element:
        tag = child.tag.rpartition("}")[2].lower()
        if tag == "cyclonedds" or (tag == "domain" and child.get("Id", "any") in ("any", "default", str(domain))):
            yield from _sections(child, domain)
        elif tag != "domain":
            child.tag = tag
            for each in child:
                each.tag = each.tag.rpartition("}")[2]
            yield child


_domains: dict[int, tuple[Domain | None, str, int]] = {}
"""By id: the domain (None if somebody else in this process made it), its configuration, and how many use it."""


@contextlib.contextmanager
def _as_started(id: int) -> Iterator[None]:
    with _creating, as_transport_error(f"opening domain {id}"):
        yield


def _open_domain(id: int, interface: str) -> None:
    with _as_started(id):
        config = compose(settings(interface), os.environ.get("CYCLONEDDS_URI", ""), id)
        domain, used, users = _domains.get(id, (None, config, 0))
        if users == 0:
            domain = _new_domain(id, config)
        elif used != config:
            log.warning("domain %d is open in this process with other settings; they stay", id)
        _domains[id] = domain, used, users + 1


def _new_domain(id: int, config: str) -> Domain | None:
    try:
        return Domain(id, config)
    except DDSException as exc:
        if exc.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise
        log.warning("domain %d was opened by other code of this process; its settings apply to us, too", id)
        return None


def _close_domain(id: int) -> None:
    with _creating:
        domain, config, users = _domains.pop(id)
        if users > 1:
            _domains[id] = domain, config, users - 1
        elif domain is not None:
            _forget(domain)


# -- readers and writers ------------------------------------------------------


class Bus:
    """A participant: what one transport has of the library. `close` leaves nothing of it."""

    def __init__(self, domain: int, interface: str) -> None:
        self._domain = domain
        _open_domain(domain, interface)
        with contextlib.ExitStack() as undo:
            undo.callback(_close_domain, domain)
            with _creating, as_transport_error("joining the domain"):
                self.participant = DomainParticipant(domain)
            undo.callback(_forget, self.participant)
            self.loop = Loop(self.participant._ref)
            self.endpoints = Endpoints(self.participant, self.loop)
            undo.pop_all()

    def writer(self, topic: str, kind: DdsType, qos: Qos, partition: str = "") -> Writer:
        with _creating, as_transport_error(f"writing {topic}"):
            made = Topic(self.participant, topic, kind)
            parent = Publisher(self.participant, _partition(partition)) if partition else self.participant
            return Writer(DataWriter(parent, made, qos), parent if partition else None, made)

    def reader(self, topic: str, kind: DdsType, qos: Qos, partition: str = "") -> Reader:
        with _creating, as_transport_error(f"reading {topic}"):
            made = Topic(self.participant, topic, kind)
            parent = Subscriber(self.participant, _partition(partition)) if partition else self.participant
            return Reader(DataReader(parent, made, qos), parent if partition else None, made)

    def waiting(self) -> Waiting:
        return Waiting(self.participant._ref)

    def close(self) -> None:
        self.loop.close()
        _forget(self.participant)
        _close_domain(self._domain)


def _partition(name: str) -> Qos:
    return Qos(Policy.Partition((name,)))


class _End:
    """A reader or writer."""

    _matched: Callable[..., int]

    def __init__(self, entity: Entity, parent: Entity | None, topic: Topic[Any]) -> None:
        self._entity, self._parent, self._topic = entity, parent, topic
        self.ref = entity._ref

    def matched(self) -> set[int]:
        """The handles of those on the other side that hear or are heard by us."""
        room = 16
        while True:
            found = (ctypes.c_uint64 * room)()
            count = type(self)._matched(self.ref, found, room)
            if count <= room:
                return set(found[: max(count, 0)])
            room = count * 2

    def close(self) -> None:
        _forget(self._entity)
        if self._parent is not None:
            _forget(self._parent)
        _forget(self._topic)


class Writer(_End):
    _matched = staticmethod(_matched_readers)

    def write(self, sample: bytearray | bytes | memoryview) -> bool:
        """Whether it was written; if not, there is no room now. Safe to use from any thread."""
        code = ddspy_write(self.ref, sample) if len(sample) < LARGE else self._write_large(sample)
        if code and code != _TIMEOUT:
            raise TransportError(f"dds: writing: {DDSException(code)}")
        return not code

    def _write_large(self, sample: bytearray | bytes | memoryview) -> int:
        size = len(sample)
        if memoryview(sample).readonly:
            held: Any = ctypes.c_char_p(bytes(sample))
            container = _Container(ctypes.cast(held, ctypes.c_void_p), size)
        else:
            held = (ctypes.c_char * size).from_buffer(sample)
            container = _Container(ctypes.addressof(held), size)
        code = _write(self.ref, ctypes.byref(container))
        del held
        return code

    def write_within(self, sample: bytearray | bytes | memoryview, end: float, still: Callable[[], None]) -> bool:
        """Write, trying until `end`; `still` is called meanwhile, and may raise."""
        while not self.write(sample):
            still()
            if time.monotonic() >= end:
                return False
            time.sleep(0.002)
        return True


class Reader(_End):
    _matched = staticmethod(_matched_writers)

    def __init__(self, entity: Entity, parent: Entity | None, topic: Topic[Any]) -> None:
        super().__init__(entity, parent, topic)
        self.condition = _checked(_create_condition(self.ref, _ANY), "waiting for samples")

    def take(self, most: int) -> list[bytes]:
        """What came in, at most so many samples."""
        taken = ddspy_take(self.ref, _ANY, most)
        if type(taken) is not list:
            return []  # the reader was closed
        return [sample for sample, info in taken if info.valid_data]

    def close(self) -> None:
        _delete(self.condition)
        super().close()


class Waiting:
    """Waits for conditions; any thread may end that by `wake`."""

    MOST = 64

    def __init__(self, participant: int) -> None:
        self._set = _checked(_create_waitset(participant), "waiting")
        self._guard = _checked(_create_guard(participant), "waiting")
        _checked(_attach(self._set, self._guard, self._guard), "waiting")
        self._found = (ctypes.c_ssize_t * self.MOST)()
        self._address = ctypes.addressof(self._found)
        self.closed = False

    def attach(self, condition: int) -> None:
        _attach(self._set, condition, condition)

    def detach(self, condition: int) -> None:
        _detach(self._set, condition)

    def wake(self) -> None:
        _set_guard(self._guard, True)

    def wait(self, timeout: float) -> list[int]:
        """The conditions that hold, at the latest after `timeout` seconds. For one thread at a time."""
        nanoseconds = int(timeout * 1e9) if timeout < 1e9 else _FOREVER
        count = _wait(self._set, self._address, self.MOST, nanoseconds)
        if count == 1 and self._found[0] != self._guard:
            return self._found[:1]
        if count <= 0:
            if count < 0 and not self.closed:
                time.sleep(0.01)  # deleted under us: whoever did that will say so, but until then do not spin
            return []
        found = self._found[: min(count, self.MOST)]
        if self._guard in found:
            _set_guard(self._guard, False)
            found.remove(self._guard)
        return found

    def close(self) -> None:
        self.closed = True
        _delete(self._set)
        _delete(self._guard)


class Loop:
    """Waits for samples on all readers at once, and for what is due. `receive` is for one thread at a time."""

    def __init__(self, participant: int) -> None:
        self._waiting = Waiting(participant)
        self._inputs: dict[int, Callable[[], Iterable[Job]]] = {}
        self._next_tick, self._woken = 0.0, False
        self.tick: Callable[[], float] = lambda: float("inf")
        """Does what is due; returns the time of the next one."""

    def attach(self, condition: int, on_input: Callable[[], Iterable[Job]]) -> None:
        self._inputs[condition] = on_input
        self._waiting.attach(condition)

    def detach(self, condition: int) -> None:
        if self._inputs.pop(condition, None):
            self._waiting.detach(condition)

    def wake(self) -> None:
        """Tick now."""
        self._woken = True
        self._waiting.wake()

    def due(self, when: float) -> None:
        """Tick at that time, or before."""
        if when < self._next_tick:
            self.wake()

    def receive(self) -> list[Job]:
        if self._woken or time.monotonic() >= self._next_tick:
            self._woken = False  # before looking: what becomes due while we look is not missed
            self._next_tick = self.tick()
        left = self._next_tick - time.monotonic() if self._next_tick < _NEVER else _NEVER
        jobs: list[Job] = []
        for condition in self._waiting.wait(max(0.0, left)):
            on_input = self._inputs.get(condition)
            if on_input:
                jobs += on_input()
        return jobs

    def close(self) -> None:
        self._waiting.close()


# -- who is there -------------------------------------------------------------

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
        known |= {"reliable": bool, "latched": bool}
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
            with _creating, as_transport_error("looking for others"):
                reader = BuiltinDataReader(participant, topic)
            self._readers.append((reader, partial(_endpoint, topic is BuiltinTopicDcpsPublication)))
            condition = _checked(_create_condition(reader._ref, _ANY), "looking for others")
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
    if _user_data(pointer, ctypes.byref(data), ctypes.byref(size)) & 1 and data.value:
        said = ctypes.string_at(data.value, size.value)
        _library.dds_free(data)
    count, names = ctypes.c_uint32(), ctypes.POINTER(ctypes.c_void_p)()
    partition = ""
    if _partitions(pointer, ctypes.byref(count), ctypes.byref(names)) & 1 and count.value:
        for number in range(count.value):
            if number == 0:
                partition = ctypes.string_at(names[0]).decode(errors="replace")
            _library.dds_free(names[number])
        _library.dds_free(names)
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
