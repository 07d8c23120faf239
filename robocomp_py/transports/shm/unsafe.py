"""What this transport takes from the C library and from iceoryx2 that neither offers to a Python program.

    what           written for              if the probe fails
    populate       Linux 5.14 and newer     EINVAL: room is checked, and a process is killed if others take it first
    copy           CPython, any C library   importing this module fails
    octets_at      CPython                  importing this module fails
    OCTETS         iceoryx2 0.10            importing this module fails: its ports take types of ctypes only
    loaner         iceoryx2 0.10            the public method: 0.3 µs more for each message sent
    initialized    iceoryx2 0.10            the public method: 0.3 µs more for each message sent
    length         iceoryx2 0.10            the public attribute: 0.2 µs more for each message read
    heads_after    iceoryx2 0.10            None: room is checked before a new slot is written to

An address is used only while its sample, or the mapping that it lies in, is kept.
"""

from __future__ import annotations

import ctypes
import errno
import operator
from collections.abc import Callable, Sequence
from typing import Any

import iceoryx2

OCTETS = iceoryx2.Slice[ctypes.c_uint8]
"""The type of what passes through a port."""

SLOT_HEAD = 48
"""Octets of iceoryx2's in front of each slot. It writes there when it gives out a slot, which is before its address is
known."""

_POPULATE_WRITE = 23
"""Allocate memory now, and get an error if there is none, instead of being killed at the first write."""

_madvise: Any = getattr(ctypes.CDLL(None, use_errno=True), "madvise", None)
if _madvise:
    _madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)

copy: Callable[[int, bytes, int], None] = ctypes.PyDLL(None).memmove
"""Copy octets to an address. It keeps other threads from running meanwhile: for what takes no time."""
copy.argtypes, copy.restype = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t), None  # type: ignore[attr-defined]  # of ctypes

octets_at: Callable[[int, int], bytes] = ctypes.string_at
"""A copy of the octets at an address."""


def populate(address: int, size: int, page: int) -> int:
    """Allocate memory at these addresses. Returns 0, or a number of `errno`.

    EINVAL: the system cannot do so; ENOMEM: nothing is mapped there; another one: there is not enough memory.
    """
    if _madvise is None:
        return errno.EINVAL
    start = address - address % page
    return ctypes.get_errno() if _madvise(start, address + size - start, _POPULATE_WRITE) else 0


def _name(kind: type, private: str, public: str) -> str:
    """The name of a private attribute, if this version has it."""
    return private if hasattr(kind, private) else public


def loaner(port: Any) -> Callable[[int], Any]:
    """What loans slots of a port, without the checks of its public method."""
    loan: Callable[[int], Any] = getattr(port, _name(type(port), "__loan_slice_uninit", "loan_slice_uninit"))
    return loan


initialized: Callable[[Any], Any] = operator.methodcaller(
    _name(iceoryx2.SampleMutUninit, "__assume_init", "assume_init")
)
"""The sample of a filled slot, ready to be sent."""

length: Callable[[Any], int] = operator.attrgetter(_name(iceoryx2.Sample, "__slice_len", "header.number_of_elements"))
"""The number of octets in a received sample."""


def heads_after(address: int, first: int, slot_bytes: int, ahead: Sequence[int]) -> list[int] | None:
    """Where iceoryx2 writes when it gives out slots behind this one, whose numbers from here are in `ahead`.

    `first` is the first slot that the port gave out. None if slots do not lie apart as expected.
    """
    step = slot_bytes + SLOT_HEAD
    if (address - first) % step:
        return None
    return [address + number * step - SLOT_HEAD for number in ahead]
