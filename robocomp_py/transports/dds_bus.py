"""What we need of Cyclone DDS: a domain per process, readers and writers of bytes, waiting, and who is there.

Samples go through the library as the bytes they are on the wire. Listeners are never used (they run
on the library's threads and may wait for the interpreter's lock holding one of their own); one
thread waits for everything in `Loop.receive`. No call here waits while it holds the interpreter,
except a small sample written to a writer that is full, for `BLOCKING_MS`.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import json
import logging
import os
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import weakref
import zlib
from collections import deque
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
from .memory import keep_memory

log = logging.getLogger("robocomp.transport.dds")

BLOCKING_MS = 2
"""How long the library waits for room before it says that a sample was not written."""

LARGE = 32 * 1024
"""From so many bytes on, writing a sample takes longer than letting other threads run meanwhile."""

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_TIMEOUT = DDSException.DDS_RETCODE_TIMEOUT
_FOREVER = 2**63 - 1


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


def settings(interface: str, domain: int = 0) -> dict[tuple[str, str], str]:
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
        found["Discovery", "Peers"] = '<Peer Address="127.0.0.1"/>' + "".join(map(partial(_beacon, domain), _own()))
    return found


def _beacon(domain: int, address: str) -> str:
    """Where programs of this host that use the library as it is listen for others.

    They expect these by multicast on one network interface. We tell that address of our own, which
    leaves the host as little as what we send to 127.0.0.1.
    """
    return f'<Peer Address="{address}:{7400 + 250 * domain}" PruneDelay="inf"/>'


def _own() -> list[str]:
    """The IPv4 addresses of this host, as far as it tells them."""
    try:
        names = [name for _, name in socket.if_nameindex()] if sys.platform == "linux" else []
    except OSError:
        return []
    return [address for address in map(address_of, names) if address]


def address_of(interface: str) -> str:
    """The IPv4 address of a network interface, or nothing."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            answer = fcntl.ioctl(asking, _SIOCGIFADDR, struct.pack("40s", interface.encode()[:15]))
    except OSError:
        return ""
    return socket.inet_ntoa(answer[20:24])


_SIOCGIFADDR = 0x8915


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
    for where, text in _documents(uri):
        for section in _sections(_parsed(where, text), domain):
            found |= {(section.tag.lower(), element.tag.lower()) for element in section}
    return found


_AROUND = "<all>"
"""A configuration may be a row of elements, which no XML document may."""


def _parsed(where: str, text: str) -> ElementTree.Element:
    bare = _without_prologue(text)
    try:
        return ElementTree.fromstring(f"{_AROUND}{bare}</all>")
    except ElementTree.ParseError as exc:
        line, column = exc.position
        before = text[: len(text) - len(bare)]
        column += 1 - (len(_AROUND) if line == 1 else 0) + (len(before.rpartition("\n")[2]) if line == 1 else 0)
        line += before.count("\n")
        what = str(exc).partition(":")[0]
        raise ConfigurationError(f"{where}: not well-formed XML: {what} (line {line}, column {column})") from exc


def _documents(uri: str) -> Iterator[tuple[str, str]]:
    """What a configuration consists of, each part with where it stands."""
    if uri.lstrip().startswith("<"):
        yield "CYCLONEDDS_URI", uri.replace(">,<", "> <")
        return
    for part in filter(None, map(str.strip, uri.split(","))):
        path = unquote(urlparse(part).path) if part.startswith("file:") else part
        path = os.path.expanduser(os.path.expandvars(path))
        try:
            with open(path, encoding="utf-8") as file:
                yield f"CYCLONEDDS_URI: {path}", file.read()
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


_domains: dict[int, tuple[Domain | None, tuple[str, str], int]] = {}
"""By id: the domain (None if somebody else in this process made it), of what settings, and how many use it."""


def _open_domain(id: int, interface: str) -> None:
    with _creating:
        _check_that_we_were_not_forked()
        asked = interface, os.environ.get("CYCLONEDDS_URI", "")
        config = compose(settings(interface, id), asked[1], id)
        domain, used, users = _domains.get(id, (None, asked, 0))
        if users == 0:
            keep_memory()
            domain = _new_domain(id, config, asked)
        elif used != asked:
            log.warning("domain %d is open in this process with other settings; they stay", id)
        _domains[id] = domain, used, users + 1


def _new_domain(id: int, config: str, asked: tuple[str, str]) -> Domain | None:
    try:
        return Domain(id, config)
    except DDSException as exc:
        if exc.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise _why(id, config, asked) from exc
    log.warning("domain %d was opened by other code of this process; its settings apply to us, too", id)
    return None


def _why(id: int, config: str, asked: tuple[str, str]) -> TransportError | ConfigurationError:
    """Why a domain could not be opened, and what to do about it."""
    interface, _ = asked
    lines = _complaints(id, config)
    said = "; ".join(lines) or "Cyclone DDS says why on standard error"
    if any(line.startswith("config: ") for line in lines):
        said = re.sub(r" \(CYCLONEDDS_URI\+\d+ line \d+\)", "", said)  # counted in something that nobody has written
        return ConfigurationError(f"CYCLONEDDS_URI: {said.replace('config: //', '')}")
    remedy = ""
    if "participant index" in said:
        remedy = (
            "; too many processes of this host use it: take another `domain` for some of them, "
            "or allow for more by <Discovery><MaxAutoParticipantIndex> in CYCLONEDDS_URI"
        )
    elif interface and "available interface" in said:
        remedy = f"; there are {', '.join(name for _, name in socket.if_nameindex())}"
    return TransportError(f"dds: opening domain {id}: {said}{remedy}")


def _complaints(id: int, config: str) -> list[str]:
    """What the library says about a configuration it cannot use.

    It says that to standard error alone, and its return code is always the same; so it is asked once
    more, in a process whose standard error is ours.
    """
    code = "import sys; from cyclonedds.domain import Domain; Domain(int(sys.argv[1]), sys.argv[2])"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    call = [sys.executable, "-c", code, str(id), config]
    try:
        done = subprocess.run(
            call, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=30
        )
    except (OSError, subprocess.SubprocessError) as exc:
        log.debug("asking Cyclone DDS why: %s", exc)
        return []
    return re.findall(r"^[\d.]+ \[\d*\]\s+\S+: (.*\S)", done.stderr, re.MULTILINE)  # time [domain] thread: text


def _close_domain(id: int) -> None:
    with _creating:
        domain, config, users = _domains.pop(id)
        if users > 1:
            _domains[id] = domain, config, users - 1
        elif domain is not None:
            _forget(domain)


# The library has threads, which a forked process lacks; whatever waits for them there waits for ever.

_buses: weakref.WeakSet[Bus] = weakref.WeakSet()
_forked = False


def _check_that_we_were_not_forked() -> None:
    if _forked:
        raise TransportError(
            "dds: Cyclone DDS was in use when this process was forked, and cannot be used in it: start processes "
            "by `spawn` or `forkserver`, or fork before a transport is opened"
        )


def _in_forked_process() -> None:
    global _forked, _creating
    _creating = threading.RLock()  # somebody may have held it
    if not _domains:
        return
    _forked = True
    for entity in list(Entity._entities.values()):
        _disown(entity)
    for bus in list(_buses):
        bus.lose()


def _disown(entity: Entity) -> None:
    """Have an entity forget what it stands for."""
    Entity._entities.pop(entity._ref, None)


os.register_at_fork(after_in_child=_in_forked_process)


# -- readers and writers ------------------------------------------------------


class Bus:
    """A participant: what one transport has of the library. `close` leaves nothing of it."""

    def __init__(self, domain: int, interface: str) -> None:
        self._domain = domain
        self.lost = False
        """Whether it belongs to the process we were forked from."""
        self.on_loss: Callable[[], None] = lambda: None
        _open_domain(domain, interface)
        with contextlib.ExitStack() as undo:
            undo.callback(_close_domain, domain)
            with _creating, as_transport_error("joining the domain"):
                self.participant = DomainParticipant(domain)
            undo.callback(_forget, self.participant)
            self.loop = Loop(self.participant._ref)
            undo.callback(self.loop.close)
            self.endpoints = Endpoints(self.participant, self.loop)
            undo.pop_all()
        _buses.add(self)

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

    def lose(self) -> None:
        self.lost = True
        self.on_loss()

    def close(self) -> None:
        if self.lost:
            return
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
    """What is sent. Small samples are written holding the interpreter, since that is quicker than to let it go."""

    _matched = staticmethod(_matched_readers)

    def write(self, sample: bytearray | bytes | memoryview) -> bool:
        """Whether it was written; if not, there is no room now. Safe to use from any thread."""
        code = ddspy_write(self.ref, sample) if len(sample) < LARGE else self._write_aside(sample)
        return not code or self._written(code)

    def write_within(self, sample: bytearray | bytes | memoryview, end: float, still: Callable[[], None]) -> bool:
        """Write, trying until `end`; `still` is called meanwhile, and may raise."""
        while not self._written(self._write_aside(sample)):
            still()
            if time.monotonic() >= end:
                return False
            time.sleep(0.002)
        return True

    def _written(self, code: int) -> bool:
        if code and code != _TIMEOUT:
            raise TransportError(f"dds: writing: {DDSException(code)}")
        return not code

    def _write_aside(self, sample: bytearray | bytes | memoryview) -> int:
        """Write while other threads run."""
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
        if len(taken) == 1 and taken[0][1].valid_data:
            return [taken[0][0]]
        return [sample for sample, info in taken if info.valid_data]

    def take_signed(self, most: int) -> list[tuple[bytes, int]]:
        """The same, each with the handle of who wrote it."""
        taken = ddspy_take(self.ref, _ANY, most)
        if type(taken) is not list:
            return []
        return [(sample, info.publication_handle) for sample, info in taken if info.valid_data]

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
                raise TransportError(f"dds: waiting: {DDSException(count)}")
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
        self._jobs: deque[Job] = deque()
        self._next_tick, self._woken, self._sleeping = 0.0, False, False
        self.tick: Callable[[], float] = lambda: float("inf")
        """Does what is due; returns the time of the next one."""

    def attach(self, condition: int, on_input: Callable[[], Iterable[Job]]) -> None:
        self._inputs[condition] = on_input
        self._waiting.attach(condition)

    def detach(self, condition: int) -> None:
        if self._inputs.pop(condition, None):
            self._waiting.detach(condition)

    def do(self, job: Job) -> None:
        """Return this job next. From any thread."""
        self._jobs.append(job)
        if self._sleeping:
            self._waiting.wake()

    def wake(self) -> None:
        """Tick now."""
        self._woken = True
        self._waiting.wake()

    def due(self, when: float) -> None:
        """Tick at that time, or before."""
        if when < self._next_tick:
            self.wake()

    def receive(self) -> list[Job]:
        now = time.monotonic()
        if self._woken or now >= self._next_tick:
            self._woken = False  # before looking: what becomes due while we look is not missed
            self._next_tick = self.tick()
        self._sleeping = True  # before looking at the jobs: whoever adds one later sees this, and wakes us
        ready = self._waiting.wait(0.0 if self._jobs else max(0.0, self._next_tick - now))
        self._sleeping = False
        jobs: list[Job] = []
        for condition in ready:
            on_input = self._inputs.get(condition)
            if on_input is None:
                continue
            try:
                jobs += on_input()
            except Exception:
                log.exception("taking input")  # of one reader; the others have theirs taken
        if self._jobs:
            jobs += [self._jobs.popleft() for _ in range(len(self._jobs))]
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
