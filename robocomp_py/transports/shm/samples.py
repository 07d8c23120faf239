"""What a message looks like in shared memory, and how it gets in and out.

    begin u32 · size u32 · member u64 · line u32 · to u32 · header · free · payload · free

The header is that of every middleware (`wire.header`); the payload begins at `begin` and has `size` octets,
and its first field lies at a multiple of 64 in memory, unless who wrote it in place chose otherwise. `to` is
whom the message is for among those who read together, and `member` and `line` are where an answer goes.

What is read is a view of the shared memory, which nobody can write to through it, and the sample stays
where it is as long as there is such a view, or an array over it. Who keeps more of them than may be out is
given copies. Short messages are copied anyway, since that takes less time.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import operator
import struct
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import iceoryx2
import numpy as np

from ...errors import TransportError
from ...wire.codec import MAX_BYTES, Payload
from .codec import Parts
from .node import FIRST_BYTES, as_transport_error, check_room, free, full

HEAD = struct.Struct("<IIQII")
HEAD_BYTES = HEAD.size
_HEADER_BYTES = 36
"""So many are there for the header."""
_BEFORE = HEAD_BYTES + _HEADER_BYTES
"""Octets in front of the earliest payload. Its fields come four octets later, behind the encapsulation."""

_ALIGNED = 64

_FREE = tuple(bytes(_HEADER_BYTES - header) for header in range(_HEADER_BYTES + 1))
"""What fills up headers."""
_SHORT = 16 * 1024
"""What has fewer octets is copied sooner than looked at where it lies."""

_LONG = 256 * 1024
"""While so many octets are copied, other threads may run."""

_PAGE = mmap.PAGESIZE
_POPULATE_WRITE = 23
"""To have memory now, or be told that there is none, rather than be killed when it is written to."""

_SAMPLE_HEAD = 48
"""Octets of iceoryx2's in front of each sample. It writes there when it gives us one, which is before we can ask for
that memory."""

_AHEAD = 16
"""So many threads may be given samples at once; the heads of the next ones have memory before they are."""

_ROOM = 1024 * 1024
"""What has to be free besides, when a pool grows: for the heads, and for what iceoryx2 notes of it."""

_library = ctypes.CDLL(None, use_errno=True)
_madvise = _library.madvise
_madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
_copy = ctypes.PyDLL(None).memmove  # keeps other threads from running meanwhile: for what takes no time
_copy.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)
_copy.restype = None
_mremap = ctypes.PyDLL(None).mremap
_mremap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t, ctypes.c_int, ctypes.c_void_p)
_mremap.restype = ctypes.c_void_p
_MAY_MOVE, _FIXED = 1, 2
_REFUSED = ctypes.c_void_p(-1).value

_NOTHING = memoryview(b"")


class Message(NamedTuple):
    """One that was read. `octets` begins with the head, followed by the header."""

    to: int
    member: int
    line: int
    octets: bytes
    payload: Payload


class Writer:
    """A port to write by. Its memory grows with the messages; whether there is some is asked before it is touched."""

    def __init__(self, port: Any) -> None:
        self._port = port
        # Without the checks of the public methods, which take as long as all the rest; with them, should these go away.
        self._loan = getattr(port, "__loan_slice_uninit", port.loan_slice_uninit)
        self._largest = 0
        self._memory: dict[int, memoryview] = {}
        """What we were given so far, by its address: as much of each piece as we have touched."""
        self._mapped: dict[int, memoryview] = {}

    def send(self, member: int, line: int, to: int, header: bytes, payload: Payload, size: int) -> int | None:
        """How many readers had room for it; None if all of our memory is in use.

        The payload is octets, or parts. Raises TransportError if there is no more memory.
        """
        if size < _SHORT:
            sample, address, _ = self._room(_BEFORE + size)
            if sample is None:
                return None
            whole = b"".join((HEAD.pack(_BEFORE, size, member, line, to), header, _FREE[len(header)], payload))
            _copy(address, whole, len(whole))
            return _send(sample)
        sample, address, memory = self._room(_BEFORE + _ALIGNED + size)
        if sample is None:
            return None
        begin = _BEFORE + (-address - _BEFORE - 4) % _ALIGNED
        head = HEAD.pack(begin, size, member, line, to) + header
        _copy(address, head, len(head))
        at = begin
        for part in payload if type(payload) is Parts else (payload,):
            if type(part) is np.ndarray:
                end = at + part.nbytes
                octets: Any = part if part.dtype == np.uint8 else part.view(np.uint8)
                if part.nbytes < _LONG:
                    memory[at:end] = octets
                else:
                    np.copyto(np.frombuffer(memory[at:end], np.uint8), octets)
            else:
                end = at + len(part)
                memory[at:end] = part
            at = end
        return _send(sample)

    def lend(self, size: int) -> Loaned | None:
        """Memory for a payload that somebody writes himself; None if all of ours is in use. Raises as `send` does."""
        whole = _BEFORE + _ALIGNED + size
        sample, address, _ = self._room(whole)
        if sample is None:
            return None
        if len(self._mapped.get(address, b"")) < whole:
            try:
                self._mapped[address] = _mapped(address, whole)
            except TransportError:
                del sample  # as below
                raise
        at = _BEFORE + (-address - _BEFORE) % _ALIGNED
        return Loaned(sample, address, at, self._mapped[address][at : at + size])

    def greet(self) -> None:
        """Give the history to those who have begun to read."""
        port = self._port
        if port is not None:
            with as_transport_error("greeting readers"):
                port.update_connections()

    def close(self) -> None:
        """Let go of the port; it is gone once nobody uses it any more."""
        self._port = None
        self._loan = _closed

    def _room(self, whole: int) -> tuple[Any, int, memoryview]:
        """A sample of that size, where it lies, and its memory; or None, if all of ours are in use."""
        if whole > self._largest:
            self._grow(whole)
        try:
            sample = self._loan(whole)
        except iceoryx2.LoanError as exc:
            if str(exc) in _ALL_IN_USE:
                return None, 0, _NOTHING
            raise TransportError(f"shm: {whole} bytes cannot be had: {exc}") from exc
        address = sample.payload_ptr
        memory = self._memory.get(address, _NOTHING)
        if len(memory) < whole:
            try:
                _own(address + len(memory), whole - len(memory))
                _own_heads(address, step(self._largest), 1 if not self._memory else _AHEAD)
            except TransportError:
                del sample  # or the error would keep it as long as somebody, such as a log, keeps the error
                raise
            self._memory[address] = memory = memoryview((ctypes.c_uint8 * whole).from_address(address)).cast("B")
        return sample, address, memory

    def _grow(self, whole: int) -> None:
        if whole > MAX_BYTES + _BEFORE + _ALIGNED:
            raise TransportError(f"shm: {whole} bytes; a message may have {MAX_BYTES}")
        if not self._largest or step(whole) > step(self._largest):
            check_room(whole + _ROOM)
            self._memory.clear()  # it lies elsewhere now
        self._largest = whole
        self._mapped.clear()


class Loaned(NamedTuple):
    """Memory that somebody writes to, ours until it is sent or forgotten."""

    sample: Any
    address: int
    at: int
    data: memoryview

    def send(self, header: bytes, begin: int, end: int) -> int:
        """Send what was written from `begin` to `end`; how many readers had room for it."""
        head = HEAD.pack(self.at + begin, end - begin, 0, 0, 0) + header
        _copy(self.address, head, len(head))
        return _send(self.sample)


_ready = operator.methodcaller("__assume_init" if hasattr(iceoryx2.SampleMutUninit, "__assume_init") else "assume_init")
_length = operator.attrgetter("__slice_len" if hasattr(iceoryx2.Sample, "__slice_len") else "header.number_of_elements")

_ALL_IN_USE = ("OutOfMemory", "ExceedsMaxLoanedSamples", "ExceedsMaxLoans")

# What happens with every message is caught where it happens: entering a context takes longer than sending a message.


def _send(sample: Any) -> int:
    try:
        taken: int = _ready(sample).send()
    except iceoryx2.SendError as exc:
        raise TransportError(f"shm: sending: {exc}") from exc
    return taken


def _closed(size: int) -> Any:
    raise TransportError("shm: this end is closed")


def size_of(payload: Payload) -> int:
    """Octets of what a codec made."""
    return payload.size if type(payload) is Parts else len(payload)


def _own(address: int, size: int) -> None:
    """Have memory behind these addresses. Raises TransportError if there is not enough."""
    start = address - address % _PAGE
    length = address + size - start
    if size >= _LONG and (left := free()) < length:  # it would take what is left, and then fail
        raise full(size, left)
    if _madvise(start, length, _POPULATE_WRITE) == 0:
        return
    error = ctypes.get_errno()
    left = free()
    if error != _INVALID or left < length:  # invalid: the kernel is older than this request (Linux 5.14)
        raise full(size, left)


_INVALID, _NOT_MAPPED = 22, 12


def step(largest: int) -> int:
    """From one sample to the next, where the largest that was asked for has so many octets."""
    if largest <= FIRST_BYTES:
        return FIRST_BYTES + _SAMPLE_HEAD
    return 1 << (largest + _SAMPLE_HEAD - 1).bit_length()


def _own_heads(address: int, step: int, first: int) -> None:
    """Have memory for the heads of samples after this one, from the `first` of them on.

    Samples are given out in the order of their addresses, unless one was given back. So those that were never given
    out, and have no memory yet, are met here before it is their turn.
    """
    for number in range(first, _AHEAD + 1):
        head = address + number * step - _SAMPLE_HEAD
        start = head - head % _PAGE
        length = head + _SAMPLE_HEAD - start
        if _madvise(start, length, _POPULATE_WRITE) == 0:
            continue
        error = ctypes.get_errno()
        if error in (_INVALID, _NOT_MAPPED):  # an older kernel; or that was the last one
            return
        raise full(_PAGE, free())


def _mapped(address: int, size: int) -> memoryview:
    """The same memory once more, for as long as somebody has an array over it: iceoryx2 may end its own view of it."""
    try:
        start, _, (_, _, offset, _, _, path) = _mapping(address)
        return _view(path, int(offset, 16) + address - start, size)
    except (OSError, ValueError, LookupError) as exc:
        raise TransportError(f"shm: memory cannot be lent: {exc}") from exc


def _mapping(address: int) -> tuple[int, int, list[str]]:
    """Where the memory around an address begins and ends, and what the kernel says of it."""
    with open("/proc/self/maps") as maps:
        for line in maps:
            start, end = (int(each, 16) for each in line.partition(" ")[0].split("-"))
            if start <= address < end:
                return start, end, line.rstrip("\n").split(None, 5)
    raise LookupError("it is not there")


def _view(path: str, offset: int, size: int) -> memoryview:
    before = offset % mmap.ALLOCATIONGRANULARITY
    with open(path, "r+b") as file:
        return memoryview(mmap.mmap(file.fileno(), before + size, offset=offset - before))[before:]


class Reader:
    """A port to read from. `share` is how many samples may be out at once."""

    def __init__(self, port: Any, share: int) -> None:
        self._receive: Callable[[], Any] = port.receive
        self._has_samples: Callable[[], bool] = port.has_samples
        self.share = share
        self._out: list[None] = []
        """One for each sample that somebody still looks at. Appending and removing are one step each."""

    def read(self) -> Message | None:
        """The next message that is one of ours; None if there is none now."""
        while True:
            try:
                sample = self._receive()
            except iceoryx2.ReceiveError as exc:
                raise TransportError(f"shm: receiving: {exc}") from exc
            if sample is None:
                return None
            address, whole = sample.payload_ptr, _length(sample)
            octets = ctypes.string_at(address, whole if whole < _SHORT else _BEFORE)
            if whole < _BEFORE:
                continue
            begin, size, member, line, to = HEAD.unpack_from(octets)
            if begin + size > whole:
                continue
            if whole < _SHORT:
                payload = memoryview(octets)[begin : begin + size]
            elif size < _SHORT or len(self._out) >= self.share:
                before = begin % 8  # so that what was aligned stays so
                payload = memoryview(ctypes.string_at(address + begin - before, before + size))[before:]
            else:
                self._out.append(None)
                lent = _Lent.from_address(address + begin)
                lent.sample, lent.out = sample, self._out
                payload = memoryview(lent).cast("B")[:size].toreadonly()
            return _message((to, member, line, octets, payload))

    def has_more(self) -> bool:
        """Whether there are messages to read."""
        try:
            return self._has_samples()
        except iceoryx2.ConnectionFailure as exc:
            raise TransportError(f"shm: receiving: {exc}") from exc

    @property
    def spent(self) -> bool:
        """Whether as many samples are out as may be: the next one is copied."""
        return len(self._out) >= self.share

    def close(self) -> None:
        """Let go of the port; what was read stays where it is."""
        self._receive, self._has_samples = _no_sample, bool


def _no_sample() -> None: ...


_message: Callable[[tuple[int, int, int, bytes, Payload]], Message] = partial(tuple.__new__, Message)


class _Lent(ctypes.c_uint8 * MAX_BYTES):  # type: ignore[misc]  # a class that ctypes makes
    """Where a payload lies. Its end is known to the views of it alone; it keeps the sample as long as there are any."""

    frozen = True  # nobody writes here: see `wire.values.snapshot`
    sample: Any
    out: list[None]

    def __del__(self) -> None:
        self.sample = None
        self.out.pop()


def let_go() -> None:
    """Give back all that is still looked at, when the process ends; or what it belongs to would stay behind.

    Whoever goes on looking (a daemon thread, a finaliser) still finds it there: iceoryx2 takes its view of the
    memory away, and gets a second one to take, which is put in place of the first.
    """
    for lent in [each for each in gc.get_objects() if type(each) is _Lent]:
        try:
            start, end, _ = _mapping(ctypes.addressof(lent))
        except (OSError, ValueError, LookupError):
            continue
        again = _mremap(start, 0, end - start, _MAY_MOVE, None)  # of no size: a second view of the same memory
        if again != _REFUSED:
            lent.sample = None
            _mremap(again, end - start, end - start, _MAY_MOVE | _FIXED, start)
