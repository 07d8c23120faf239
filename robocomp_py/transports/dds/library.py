"""Bindings to functions of the C library that its Python package does not offer."""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Callable, Iterator
from typing import Any

from cyclonedds.core import DDSException, Entity, InstanceState, SampleState, ViewState
from cyclonedds.internal import DDS

from ...errors import TransportError

BLOCKING_MS = 2
"""Maximum time in ms that the library waits for room before a write fails."""

LARGE = 32 * 1024
"""Samples of at least this many bytes are written without Python's global lock."""

ANY = SampleState.Any | ViewState.Any | InstanceState.Any
TIMEOUT = DDSException.DDS_RETCODE_TIMEOUT
FOREVER = 2**63 - 1


class Container(ctypes.Structure):
    """A sample in the form that the Python binding passes to the library."""

    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_size_t))


class IncompatibleQos(ctypes.Structure):
    """Number of writers that offer too little for a reader, or of readers that request too much of a writer."""

    _fields_ = (("total", ctypes.c_uint32), ("change", ctypes.c_int32), ("policy", ctypes.c_uint32))


POLICIES = {2: "durability", 4: "deadline", 8: "liveliness", 11: "reliability"}
"""Names of QoS policies, by the library's numbers."""


class LivelinessChanged(ctypes.Structure):
    """Numbers of a reader's connected writers whose leases are valid and expired."""

    _fields_ = (
        ("alive", ctypes.c_uint32),
        ("not_alive", ctypes.c_uint32),
        ("alive_change", ctypes.c_int32),
        ("not_alive_change", ctypes.c_int32),
        ("last", ctypes.c_uint64),
    )


library = ctypes.CDLL(DDS._dll_handle._name)  # a handle of our own: declarations on the package's would affect it


def _function(name: str, *arguments: Any) -> Callable[..., int]:
    function = getattr(library, name)
    function.argtypes, function.restype = arguments, ctypes.c_int32
    return function  # type: ignore[no-any-return]  # ctypes' functions have no signature


_FATAL, _ERROR = 1, 2
library.dds_set_log_mask.argtypes, library.dds_set_log_mask.restype = (ctypes.c_uint32,), None
library.dds_set_log_mask(_FATAL | _ERROR)  # no warnings: there is one for every malformed packet

_int, _handles = ctypes.c_int32, ctypes.POINTER(ctypes.c_uint64)
dds_delete = _function("dds_delete", _int)
dds_write = _function("dds_write", _int, ctypes.c_void_p)
dds_dispose = _function("dds_dispose", _int, ctypes.c_void_p)
dds_create_waitset = _function("dds_create_waitset", _int)
dds_waitset_attach = _function("dds_waitset_attach", _int, _int, ctypes.c_ssize_t)
dds_waitset_detach = _function("dds_waitset_detach", _int, _int)
dds_waitset_wait = _function("dds_waitset_wait", _int, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int64)
dds_create_guardcondition = _function("dds_create_guardcondition", _int)
dds_set_guardcondition = _function("dds_set_guardcondition", _int, ctypes.c_bool)
dds_create_readcondition = _function("dds_create_readcondition", _int, ctypes.c_uint32)
dds_get_matched_subscriptions = _function("dds_get_matched_subscriptions", _int, _handles, ctypes.c_size_t)
dds_get_matched_publications = _function("dds_get_matched_publications", _int, _handles, ctypes.c_size_t)
dds_get_requested_incompatible_qos_status = _function(
    "dds_get_requested_incompatible_qos_status", _int, ctypes.c_void_p
)
dds_get_offered_incompatible_qos_status = _function("dds_get_offered_incompatible_qos_status", _int, ctypes.c_void_p)
dds_get_liveliness_changed_status = _function("dds_get_liveliness_changed_status", _int, ctypes.c_void_p)
dds_qget_userdata = _function(
    "dds_qget_userdata", ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_size_t)
)
dds_qget_partition = _function(
    "dds_qget_partition",
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint32),
    ctypes.POINTER(ctypes.POINTER(ctypes.c_void_p)),
)
library.dds_free.argtypes, library.dds_free.restype = (ctypes.c_void_p,), None


class _Creating:
    """A lock for making entities: the library's Python classes keep state in class variables."""

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *exc: object) -> None:
        self._lock.release()

    def renew(self) -> None:
        """In a forked process, where a thread that is missing may have held the lock."""
        self._lock = threading.RLock()


creating = _Creating()


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    try:
        yield
    except DDSException as exc:
        raise TransportError(f"dds: {doing}: {exc}") from exc


def checked(code: int, doing: str) -> int:
    if code < 0:
        raise TransportError(f"dds: {doing}: {DDSException(code)}")
    return code


def forget(entity: Entity) -> None:
    """Delete an entity now, instead of when its last reference goes. The Python object becomes inert."""
    entity.__del__()
