"""What this transport takes from Cyclone DDS beyond the public interface of its Python package.

Written for cyclonedds 11.0, on CPython.

    what                                        why not the public way
    reference                                   none: functions of the library take this number of an entity
    write, take                                 it encodes and decodes Python objects: our samples are octets already
    write_unlocked                              the same, and other threads run meanwhile
    dispose                                     as with `write`
    take_endpoints                              it converts QoS in a way that is not thread-safe
    matched_publications, matched_subscriptions it raises IndexError if an endpoint is met between its two calls
    Waiting, read_condition, delete             it does not tell which conditions hold
    disown_all                                  none: a forked process would delete the entities of its parent

Importing this module fails with an ImportError that names what is missing, if this version of the package lacks any of
it; `reference` fails so when the transport is opened.
"""

from __future__ import annotations

import ctypes
import importlib
from collections.abc import Callable, MutableMapping, Sequence
from functools import partial
from typing import Any

from cyclonedds.core import DDSException, Entity
from cyclonedds.internal import DDS

from ...errors import TransportError
from .library import ANY, FOREVER, checked

WRITTEN_FOR = "11.0"


def _part(owner: Any, name: str) -> Any:
    """An attribute of the library. Raises ImportError if this version does not have it."""
    try:
        return getattr(owner, name)
    except AttributeError:
        raise ImportError(
            f"cyclonedds does not have `{name}`, which the transport dds needs: pip install 'cyclonedds~={WRITTEN_FOR}'"
        ) from None


def reference(entity: Entity) -> int:
    """The library's number of an entity."""
    number: int = _part(entity, "_ref")
    return number


_compiled = importlib.import_module("cyclonedds._clayer")

write: Callable[[int, bytes | bytearray | memoryview], int] = _part(_compiled, "ddspy_write")
"""Write a sample under Python's global lock; returns the library's code."""

take: Callable[[int, int, int], list[tuple[bytes, Any]] | int] = _part(_compiled, "ddspy_take")
"""Up to a number of samples of a reader, with the library's information on each; or its code."""

_take_endpoint: Callable[..., Any] = _part(_compiled, "ddspy_take_endpoint")
_entities: MutableMapping[int, Entity] = _part(Entity, "_entities")

_library = ctypes.CDLL(_part(_part(DDS, "_dll_handle"), "_name"))  # our own: declarations on the package's affect it


def _function(name: str, *arguments: Any, result: Any = ctypes.c_int32) -> Callable[..., int]:
    function = _part(_library, name)
    function.argtypes, function.restype = arguments, result
    return function  # type: ignore[no-any-return]  # ctypes' functions have no signature


_FATAL, _ERROR = 1, 2
_function("dds_set_log_mask", ctypes.c_uint32, result=None)(_FATAL | _ERROR)  # a warning for each malformed packet

_int, _handles = ctypes.c_int32, ctypes.POINTER(ctypes.c_uint64)
delete = _function("dds_delete", _int)
"""Delete an entity; returns the library's code."""

_write = _function("dds_write", _int, ctypes.c_void_p)
_dispose = _function("dds_dispose", _int, ctypes.c_void_p)
_create_waitset = _function("dds_create_waitset", _int)
_waitset_attach = _function("dds_waitset_attach", _int, _int, ctypes.c_ssize_t)
_waitset_detach = _function("dds_waitset_detach", _int, _int)
_waitset_wait = _function("dds_waitset_wait", _int, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int64)
_create_guardcondition = _function("dds_create_guardcondition", _int)
_set_guardcondition = _function("dds_set_guardcondition", _int, ctypes.c_bool)
_create_readcondition = _function("dds_create_readcondition", _int, ctypes.c_uint32)
_qget_userdata = _function(
    "dds_qget_userdata", ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_size_t)
)
_qget_partition = _function(
    "dds_qget_partition",
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint32),
    ctypes.POINTER(ctypes.POINTER(ctypes.c_void_p)),
)
_free = _function("dds_free", ctypes.c_void_p, result=None)


class _Container(ctypes.Structure):
    """A sample in the form that the Python binding passes to the library."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t))


def write_unlocked(writer: int, sample: bytearray | bytes | memoryview) -> int:
    """Write without Python's global lock, so that other threads run meanwhile; returns the library's code."""
    size = len(sample)
    if memoryview(sample).readonly:
        held: Any = ctypes.c_char_p(bytes(sample))
        container = _Container(ctypes.cast(held, ctypes.c_void_p), size)
    else:
        held = (ctypes.c_char * size).from_buffer(sample)
        container = _Container(ctypes.addressof(held), size)
    code = _write(writer, ctypes.byref(container))
    del held
    return code


def dispose(writer: int, sample: bytes) -> int:
    """Dispose of the instance that a sample belongs to; returns the library's code."""
    held = ctypes.c_char_p(sample)
    container = _Container(ctypes.cast(held, ctypes.c_void_p), len(sample))
    return _dispose(writer, ctypes.byref(container))


def _matched(get: Callable[..., int], end: int) -> set[int]:
    room = 16
    while True:
        found = (ctypes.c_uint64 * room)()
        count = get(end, found, room)
        if count <= room:
            return set(found[: max(count, 0)])
        room = count * 2


matched_subscriptions = partial(_matched, _function("dds_get_matched_subscriptions", _int, _handles, ctypes.c_size_t))
"""The handles of the readers that are connected with a writer."""

matched_publications = partial(_matched, _function("dds_get_matched_publications", _int, _handles, ctypes.c_size_t))
"""The handles of the writers that are connected with a reader."""


def read_condition(reader: int, doing: str) -> int:
    """A condition that holds while a reader has samples. Raises TransportError."""
    return checked(_create_readcondition(reader, ANY), doing)


class Waiting:
    """Waits for conditions; any thread may end the wait by `wake`."""

    MOST = 64

    def __init__(self, participant: int) -> None:
        self._set = checked(_create_waitset(participant), "waiting")
        self._guard = checked(_create_guardcondition(participant), "waiting")
        checked(_waitset_attach(self._set, self._guard, self._guard), "waiting")
        self._found = (ctypes.c_ssize_t * self.MOST)()
        self._timeout = ctypes.c_int64()
        # Converted once: at each call, that would take half of its time.
        self._arguments = (
            ctypes.c_int32(self._set),
            ctypes.c_void_p(ctypes.addressof(self._found)),
            ctypes.c_size_t(self.MOST),
            self._timeout,
        )
        self.closed = False

    def attach(self, condition: int) -> None:
        _waitset_attach(self._set, condition, condition)

    def detach(self, condition: int) -> None:
        _waitset_detach(self._set, condition)

    def wake(self) -> None:
        _set_guardcondition(self._guard, True)

    def wait(self, timeout: float) -> Sequence[int]:
        """Wait at most `timeout` seconds; returns the conditions that hold. For one thread at a time."""
        self._timeout.value = int(timeout * 1e9) if timeout < 1e9 else FOREVER
        count = _waitset_wait(*self._arguments)
        if count == 1:
            first = self._found[0]
            if first != self._guard:
                return (first,)
        if count <= 0:
            if count < 0 and not self.closed:
                raise TransportError(f"dds: waiting: {DDSException(count)}")
            return ()
        found = self._found[: min(count, self.MOST)]
        if self._guard in found:
            _set_guardcondition(self._guard, False)
            found.remove(self._guard)
        return found

    def close(self) -> None:
        self.closed = True
        delete(self._set)
        delete(self._guard)


def take_endpoints(reader: int, most: int, make: Callable[..., Any]) -> list[Any]:
    """What `make` returns for each of at most so many samples of a built-in topic.

    It is called with the fields of the sample, its information, and in place of the QoS the user data and partition.
    """
    taken: list[Any] | int = _take_endpoint(reader, most, make, _qos)
    return taken if isinstance(taken, list) else []  # an error code if the reader was closed


def _qos(pointer: int) -> tuple[bytes, str]:
    """User data and partition. The library's own conversion is not thread-safe."""
    data, size = ctypes.c_void_p(), ctypes.c_size_t()
    said = b""
    if _qget_userdata(pointer, ctypes.byref(data), ctypes.byref(size)) & 1 and data.value:
        said = ctypes.string_at(data.value, size.value)
        _free(data)
    count, names = ctypes.c_uint32(), ctypes.POINTER(ctypes.c_void_p)()
    partition = ""
    if _qget_partition(pointer, ctypes.byref(count), ctypes.byref(names)) & 1 and count.value:
        for number in range(count.value):
            if number == 0:
                partition = ctypes.string_at(names[0]).decode(errors="replace")
            _free(names[number])
        _free(names)
    return said, partition


def disown_all() -> None:
    """Detach all Python objects from their DDS entities, so that a forked process does not delete its parent's."""
    for ref in list(_entities):
        _entities.pop(ref, None)
