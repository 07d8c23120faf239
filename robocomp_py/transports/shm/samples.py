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
import mmap
import operator
import struct
from typing import Any, NamedTuple

import iceoryx2
import numpy as np

from ...errors import TransportError
from ...wire.codec import MAX_BYTES, Payload
from .node import as_transport_error, free, full

HEAD = struct.Struct("<IIQII")
HEAD_BYTES = HEAD.size
_HEADER_BYTES = 36
"""So many are there for the header."""
_BEFORE = HEAD_BYTES + _HEADER_BYTES
"""Octets in front of the earliest payload. Its fields come four octets later, behind the encapsulation."""

_ALIGNED = 64
_SHORT = 16 * 1024
"""What has fewer octets is copied sooner than looked at where it lies."""

_PAGE = mmap.PAGESIZE
_POPULATE_WRITE = 23
"""To have memory now, or be told that there is none, rather than be killed when it is written to."""

_library = ctypes.CDLL(None, use_errno=True)
_madvise = _library.madvise
_madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
_copy_long = ctypes.CDLL(None).memmove  # lets other threads run meanwhile
_copy_short = ctypes.PyDLL(None).memmove
for _copy in (_copy_long, _copy_short):
    _copy.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)
    _copy.restype = None


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
        self._owned: dict[int, int] = {}
        """Of each piece of memory that we were given, how much of it we have touched."""
        self._mapped: dict[int, memoryview] = {}

    def room(self, size: int) -> Room | None:
        """Memory for a payload; None if all of ours is in use. Raises TransportError if there is no more of it."""
        if size > MAX_BYTES:
            raise TransportError(f"shm: {size} bytes; a message may have {MAX_BYTES}")
        whole = _BEFORE + _ALIGNED + size
        if whole > self._largest:
            self._largest = whole
            self._owned.clear()  # it may lie elsewhere now
            self._mapped.clear()
        try:
            sample = self._loan(whole)
        except iceoryx2.LoanError as exc:
            if str(exc) in _ALL_IN_USE:
                return None
            raise TransportError(f"shm: {whole} bytes cannot be had: {exc}") from exc
        address = sample.payload_ptr
        if self._owned.get(address, 0) < whole:
            _own(address, whole)
            self._owned[address] = whole
        return Room(sample, address, whole)

    def lend(self, size: int) -> Loaned | None:
        """Like `room`, but for somebody who writes there himself."""
        room = self.room(size)
        if room is None:
            return None
        address, whole = room.address, room.whole
        if len(self._mapped.get(address, b"")) < whole:
            self._mapped[address] = _mapped(address, whole)
        at = _BEFORE + (-address - _BEFORE) % _ALIGNED
        return Loaned(room, at, self._mapped[address][at : at + size])

    def greet(self) -> None:
        """Give the history to those who have begun to read."""
        port = self._port
        if port is not None:
            with as_transport_error("greeting readers"):
                port.update_connections()

    def close(self) -> None:
        """Let go of the port; it is gone once nobody uses it any more."""
        self._port = self._loan = None


_ready = operator.methodcaller("__assume_init" if hasattr(iceoryx2.SampleMutUninit, "__assume_init") else "assume_init")
_length = operator.attrgetter("__slice_len" if hasattr(iceoryx2.Sample, "__slice_len") else "header.number_of_elements")

_ALL_IN_USE = ("OutOfMemory", "ExceedsMaxLoanedSamples", "ExceedsMaxLoans")


class Room(NamedTuple):
    """Memory for one message, ours until it is sent or forgotten."""

    sample: Any
    address: int
    whole: int

    def send(self, header: bytes, begin: int, size: int) -> int:
        """Send the payload that was written there; how many readers had room for it."""
        _copy_short(self.address, HEAD.pack(begin, size, 0, 0, 0) + header, HEAD_BYTES + len(header))
        return self._send()

    def fill_and_send(self, member: int, line: int, to: int, header: bytes, payload: Payload, size: int) -> int:
        """The same, after writing the payload: octets, or a list of those and arrays."""
        address = self.address
        begin = _BEFORE + (-address - _BEFORE - 4) % _ALIGNED
        head = HEAD.pack(begin, size, member, line, to) + header
        if size < _SHORT:
            data = payload if type(payload) is bytes else b"".join(payload) if type(payload) is list else bytes(payload)
            octets = head + bytes(begin - len(head)) + data
            _copy_short(address, octets, len(octets))
        else:
            _copy_short(address, head, len(head))
            at = address + begin
            for part in payload if type(payload) is list else (payload,):
                at = _write(at, part)
        return self._send()

    def _send(self) -> int:
        sample = self.sample
        ready = _ready(sample)
        with as_transport_error("sending"):
            taken: int = ready.send()
        return taken


class Loaned(NamedTuple):
    """Room that somebody writes to."""

    room: Room
    at: int
    data: memoryview

    def send(self, header: bytes, begin: int, end: int) -> int:
        """Send what was written from `begin` to `end`."""
        return self.room.send(header, self.at + begin, end - begin)


def size_of(payload: Payload) -> int:
    """Octets of what a codec made."""
    if type(payload) is list:
        return sum(part.nbytes if isinstance(part, np.ndarray) else len(part) for part in payload)
    return len(payload)


def _write(at: int, part: Any) -> int:
    source: bytes | int
    if isinstance(part, bytes):
        size, source = len(part), part
    else:
        array = part if isinstance(part, np.ndarray) else np.frombuffer(part, np.uint8)
        size, source = array.nbytes, array.ctypes.data
    (_copy_long if size >= _SHORT else _copy_short)(at, source, size)
    return at + size


def _own(address: int, size: int) -> None:
    """Have memory behind these addresses. Raises TransportError if there is not enough."""
    start = address - address % _PAGE
    length = address + size - start
    if _madvise(start, length, _POPULATE_WRITE) == 0:
        return
    error = ctypes.get_errno()
    left = free()
    if error != _INVALID or left < length:  # invalid: the kernel is older than this request (Linux 5.14)
        raise full(size, left)


_INVALID = 22


def _mapped(address: int, size: int) -> memoryview:
    """The same memory once more, for as long as somebody has an array over it: iceoryx2 may end its own view of it."""
    try:
        with open("/proc/self/maps") as maps:
            for line in maps:
                first, _, rest = line.partition("-")
                start = int(first, 16)
                if start <= address < int(rest.partition(" ")[0], 16):
                    _, _, offset, _, _, path = line.rstrip("\n").split(None, 5)
                    return _view(path, int(offset, 16) + address - start, size)
    except (OSError, ValueError) as exc:
        raise TransportError(f"shm: memory cannot be lent: {exc}") from exc
    raise TransportError("shm: memory cannot be lent: it is not there")


def _view(path: str, offset: int, size: int) -> memoryview:
    before = offset % mmap.ALLOCATIONGRANULARITY
    with open(path, "r+b") as file:
        return memoryview(mmap.mmap(file.fileno(), before + size, offset=offset - before))[before:]


class Reader:
    """A port to read from. `share` is how many samples may be out at once."""

    def __init__(self, port: Any, share: int) -> None:
        self._port, self.share = port, share
        self._out: list[None] = []
        """One for each sample that somebody still looks at. Appending and removing are one step each."""

    def read(self) -> Message | None:
        """The next message that is one of ours; None if there is none now."""
        while (sample := self._receive()) is not None:
            message = self._message(sample)
            if message:
                return message
        return None

    def close(self) -> None:
        """Let go of the port; what was read stays where it is."""
        self._port = None

    def _receive(self) -> Any:
        port = self._port
        if port is None:
            return None
        with as_transport_error("receiving"):
            return port.receive()

    def _message(self, sample: Any) -> Message | None:
        address = sample.payload_ptr
        whole = _length(sample)
        if whole < _BEFORE:
            return None
        if whole < _SHORT:
            octets = ctypes.string_at(address, whole)
            begin, size, member, line, to = HEAD.unpack_from(octets)
            if begin + size > whole:
                return None
            return Message(to, member, line, octets, memoryview(octets)[begin : begin + size])
        octets = ctypes.string_at(address, _BEFORE)
        begin, size, member, line, to = HEAD.unpack_from(octets)
        if begin + size > whole:
            return None
        if size < _SHORT or len(self._out) >= self.share:
            before = begin % 8  # so that what was aligned stays so
            payload = memoryview(ctypes.string_at(address + begin - before, before + size))[before:]
        else:
            self._out.append(None)
            lent = _Lent.from_address(address + begin)
            lent.sample, lent.out = sample, self._out
            payload = memoryview(lent).cast("B")[:size].toreadonly()
        return Message(to, member, line, octets, payload)


class _Lent(ctypes.c_uint8 * MAX_BYTES):  # type: ignore[misc]  # a class that ctypes makes
    """Where a payload lies. Its end is known to the views of it alone; it keeps the sample as long as there are any."""

    frozen = True  # nobody writes here: see `wire.values.snapshot`
    sample: Any
    out: list[None]

    def __del__(self) -> None:
        self.sample = None
        self.out.pop()
