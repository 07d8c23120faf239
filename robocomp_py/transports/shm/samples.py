"""The layout of a message in shared memory, and how it is written and read.

    begin u32 · size u32 · member u64 · line u32 · to u32 · header · free · payload
    0 u32 · size u32 · member u64 · line u32 · to u32 · header · free · heap u64 · offset u64

The header is that of every middleware (`wire.header`). A small payload begins at `begin` of its slot and has `size`
octets. A larger one lies in the heap of that number. Its first field lies at a multiple of 64 in memory, unless the
program that wrote it in place chose otherwise. `to` says which of the links that read together the message is for;
`member` and `line` are the address for a reply.

A received payload is a read-only view of the shared memory. The sample stays while such a view, or an array over it,
exists. A reader that keeps too many samples is given copies. Short messages are always copied, since that is faster.
"""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import iceoryx2
import numpy as np

from ...errors import TransportError
from ...wire.codec import MAX_BYTES, Payload
from .codec import Parts
from .heap import Heap, Heaps
from .node import SLOT_BYTES, as_transport_error
from .room import PAGE, check_room, is_owned, own
from .unsafe import SLOT_HEAD, copy, heads_after, initialized, length, loaner, octets_at

log = logging.getLogger("robocomp.transport.shm")

HEAD = struct.Struct("<IIQII")
HEAD_BYTES = HEAD.size
_HEADER_BYTES = 36
"""Octets for the header."""
_BEFORE = HEAD_BYTES + _HEADER_BYTES
"""Octets in front of the earliest payload. Its fields come four octets later, behind the encapsulation."""

_APART = struct.Struct("<QQ")
_APART_BYTES = _BEFORE + _APART.size
"""A slot that says where its payload lies: in which heap, and where in there."""

_IN_PAGE = 576
"""Octets of the first page of a payload in a heap that are in front of its first field. Large arrays begin near the
beginning of a page, and copying is a fifth slower to where it is at the same place in its page as what is copied."""

_SMALL = SLOT_BYTES - _BEFORE
"""Maximum octets of a payload in a slot."""

_FREE = tuple(bytes(_HEADER_BYTES - header) for header in range(_HEADER_BYTES + 1))
"""What fills up headers."""
_SHORT = 16 * 1024
"""Payloads with fewer octets are copied, since that is faster."""

_LONG = 256 * 1024
"""From this many octets on, other threads may run while a payload is copied."""

_AHEAD = 16
"""So many threads may be given slots at once; the heads of the next ones have memory before they are."""


class Message(NamedTuple):
    """One that was read. `octets` begins with the head, followed by the header."""

    to: int
    member: int
    line: int
    octets: bytes
    payload: Payload


class Writer:
    """A port for sending. Small messages lie in its slots, larger ones in the heap. Pages that are bound to a slot are
    in use as long as the slot is."""

    def __init__(self, port: Any, heap: Heap, loans: int = 0) -> None:
        """`loans` is the maximum number of loans at once."""
        self._port, self._heap, self._loans = port, heap, loans
        self.lent: list[None] = []
        """One entry for each loan."""
        self._loan = loaner(port)
        self._first = 0
        """The address of the first slot."""
        self._owned: dict[int, int] = {}
        """Octets of each slot that have memory, by its address."""
        self._bound: dict[int, tuple[int, int]] = {}
        """By the address of a slot, the pages of its payload: where they begin, and how many they are."""
        self._finding = threading.Lock()

    def send(self, member: int, line: int, to: int, header: bytes, payload: Payload, size: int) -> int | None:
        """Returns how many readers had room for it; None if all slots are in use.

        The payload is octets, or parts. Raises `Full` if there is no more memory.
        """
        if size <= _SMALL:
            sample, address = self._slot(_BEFORE + size)
            if sample is None:
                return None
            if self._bound:
                self._unbind(address)
            whole = b"".join((HEAD.pack(_BEFORE, size, member, line, to), header, _FREE[len(header)], payload))
            copy(address, whole, len(whole))
            return _send(sample)
        sample, address = self._slot(_APART_BYTES)
        if sample is None:
            return None
        try:
            offset, memory = self._bind(address, _IN_PAGE - 4, size)
        except TransportError:
            del sample  # or the error would keep it as long as a log, say, keeps the error
            raise
        if type(payload) is Parts:
            end = 0
            for part in payload:
                begin = end
                if type(part) is np.ndarray:
                    end += part.nbytes
                    octets: Any = part if part.dtype == np.uint8 else part.view(np.uint8)
                    if part.nbytes < _LONG:
                        memory[begin:end] = octets
                    else:
                        np.copyto(np.frombuffer(memory[begin:end], np.uint8), octets)
                else:
                    end += len(part)
                    memory[begin:end] = part
        else:
            memory[:] = payload
        self._point(address, offset, size, member, line, to, header)
        return _send(sample)

    def lend(self, size: int) -> Loaned | None:
        """Memory for a payload that the caller fills; None if all memory is in use. Raises as `send` does."""
        sample, address = self._slot(_APART_BYTES) if len(self.lent) < self._loans else (None, 0)
        if sample is None:
            return None
        try:
            offset, memory = self._bind(address, _IN_PAGE, size)
        except TransportError:
            del sample  # as above
            raise
        return Loaned(self, sample, address, offset, memory)

    def greet(self) -> None:
        """Give the history to new readers."""
        port = self._port
        if port is not None:
            with as_transport_error("greeting readers"):
                port.update_connections()

    @property
    def waits(self) -> bool:
        """Whether there will be more memory once readers give some back."""
        return bool(self._bound)

    def find_free(self) -> None:
        """See `heap.Borrower`."""
        with self._finding:
            found = []
            try:
                while self._bound:
                    sample = self._loan(1)
                    found.append(sample)
                    address = sample.payload_ptr
                    if address not in self._owned:
                        break  # it was never used; nor were the ones after it
                    self._unbind(address)
            except (iceoryx2.LoanError, TransportError):  # those were all; or we are closed
                pass
            while found:  # in this order, the one that was returned last is still given out first
                found.pop()
        if self._port is None and not self._bound:
            self._heap.borrowers.discard(self)
            self.end()

    def close(self) -> None:
        """Let go of the port; it is gone once it is not used any more. What readers still have is not used again."""
        self._port = None
        with self._heap.lock:
            self.find_free()

    def end(self) -> None:
        """See `heap.Borrower`."""
        self._port, self._loan = None, _closed

    def _slot(self, whole: int) -> tuple[Any, int]:
        """A slot for this many octets, and its address; None if all slots are in use."""
        if self._port is None:
            _closed(whole)
        try:
            sample = self._loan(whole)
        except iceoryx2.LoanError as exc:
            sample = self._try_again(whole, exc)
            if sample is None:
                return None, 0
        address = sample.payload_ptr
        owned = self._owned.get(address, 0)
        if owned < whole:
            try:
                own(address + owned, whole - owned, whole - owned)
                self._own_heads(address)
            except TransportError:
                del sample  # as in `send`
                raise
            self._owned[address] = whole
        return sample, address

    def _own_heads(self, address: int) -> None:
        """Have memory for the heads of the slots after this one: of the next ones at first, then of one more each time.

        Slots are given out in the order of their addresses, unless one was given back. So those that were never given
        out, and have no memory yet, are met here before it is their turn.
        """
        self._first = self._first or address
        ahead = range(_AHEAD if self._owned else 1, _AHEAD + 1)
        heads = heads_after(address, self._first, SLOT_BYTES, ahead)
        if heads is None:
            check_room(PAGE * _AHEAD)
            return
        for head in heads:
            if not is_owned(head, SLOT_HEAD):
                return  # that was the last one

    def _try_again(self, whole: int, why: iceoryx2.LoanError) -> Any:
        """Another thread may hold all free slots, to find out which are free."""
        if str(why) not in _ALL_IN_USE:
            raise TransportError(f"shm: {whole} bytes cannot be had: {why}") from why
        with self._finding:
            try:
                return self._loan(whole)
            except iceoryx2.LoanError:
                return None

    def _bind(self, address: int, begin: int, size: int) -> tuple[int, memoryview]:
        """Get memory for a payload that begins this many octets after a page: where in the heap, and the memory."""
        if size > MAX_BYTES:
            raise TransportError(f"shm: {size} bytes; a message may have {MAX_BYTES}")
        heap, count = self._heap, -(-(begin + size) // PAGE)
        bound = self._bound.get(address)
        if bound is None or bound[1] != count:
            if bound:
                self._unbind(address)
            heap.borrowers.add(self)
            bound = self._bound[address] = heap.take(count), count
        offset = bound[0] * PAGE + begin
        return offset, heap.memory(offset, size)

    def _unbind(self, address: int) -> None:
        """This slot is free, or about to be used for something else."""
        bound = self._bound.pop(address, None)
        if bound:
            self._heap.give(*bound)

    def _point(self, address: int, offset: int, size: int, member: int, line: int, to: int, header: bytes) -> None:
        """Write into a slot where in the heap its payload lies."""
        apart = _APART.pack(self._heap.number, offset)
        whole = b"".join((HEAD.pack(0, size, member, line, to), header, _FREE[len(header)], apart))
        copy(address, whole, len(whole))


class Loaned:
    """Memory that the caller fills. It belongs to the port until it is sent or dropped."""

    def __init__(self, writer: Writer, sample: Any, address: int, offset: int, data: memoryview) -> None:
        self._writer, self._sample, self.address, self._offset, self.data = writer, sample, address, offset, data
        writer.lent.append(None)

    def __del__(self) -> None:
        self._writer.lent.pop()

    def send(self, header: bytes, begin: int, end: int) -> int:
        """Send what was written from `begin` to `end`; how many readers had room for it."""
        self._writer._point(self.address, self._offset + begin, end - begin, 0, 0, 0, header)
        sample, self._sample = self._sample, None
        return _send(sample)


_ALL_IN_USE = ("OutOfMemory", "ExceedsMaxLoanedSamples", "ExceedsMaxLoans")

# What happens with every message is caught where it happens: entering a context takes longer than sending a message.


def _send(sample: Any) -> int:
    try:
        taken: int = initialized(sample).send()
    except iceoryx2.SendError as exc:
        raise TransportError(f"shm: sending: {exc}") from exc
    return taken


def _closed(size: int) -> Any:
    raise TransportError("shm: this end is closed")


def size_of(payload: Payload) -> int:
    """Octets of what a codec made."""
    return payload.size if type(payload) is Parts else len(payload)


class Reader:
    """A port to read from. `share` is how many samples may be out at once."""

    def __init__(self, port: Any, share: int, heaps: Heaps) -> None:
        self._heaps = heaps
        self._receive: Callable[[], Any] = port.receive
        self._has_samples: Callable[[], bool] = port.has_samples
        self.share = share
        self._out: list[None] = []
        """One entry for each sample in use. Appending and removing are atomic."""

    def read(self) -> Message | None:
        """The next message that is one of ours; None if there is none now."""
        while True:
            try:
                sample = self._receive()
            except iceoryx2.ReceiveError as exc:
                raise TransportError(f"shm: receiving: {exc}") from exc
            if sample is None:
                return None
            address, whole = sample.payload_ptr, length(sample)
            octets = octets_at(address, whole)
            if whole < _BEFORE:
                continue
            begin, size, member, line, to = HEAD.unpack_from(octets)
            if begin:
                if begin + size > whole:
                    continue
                payload = memoryview(octets)[begin : begin + size]
            elif (found := self._apart(sample, octets, size)) is not None:
                payload = found
            else:
                continue
            return _message((to, member, line, octets, payload))

    def _apart(self, sample: Any, octets: bytes, size: int) -> memoryview | None:
        """A payload that lies in a heap; None if it does not."""
        try:
            number, offset = _APART.unpack_from(octets, _BEFORE)
            memory = self._heaps.of(number).at(offset, size)
        except (struct.error, ValueError):
            return None  # it is no message of ours
        except TransportError as exc:
            log.info("a message of %d bytes is lost: its sender has ended (%s)", size, exc)
            return None
        if size < _SHORT or len(self._out) >= self.share:
            before = offset % 8  # so that what was aligned stays so
            return memoryview(memory[offset - before : offset + size])[before:]
        self._out.append(None)
        lent = _Lent(size, np.uint8, memory, offset)
        lent.kept[id(lent)], lent.out = sample, self._out
        return memoryview(lent)  # type: ignore[arg-type]  # an array is one, by its stub from Python 3.12 on

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


class _Lent(np.ndarray[tuple[int], np.dtype[np.uint8]]):
    """A payload in shared memory. Its sample is kept as long as there are views of it."""

    kept: ClassVar[dict[int, Any]] = {}
    """The samples of all payloads that are in use, by `id`. Changing it is atomic."""
    out: list[None]

    def __del__(self) -> None:
        self.kept.pop(id(self), None)
        self.out.pop()


def let_go() -> None:
    """Give back all that is still looked at, when the process ends; or what it belongs to would stay behind.

    The memory stays as long as anything (a daemon thread, a finaliser) uses it: its mapping is ours.
    """
    _Lent.kept.clear()
