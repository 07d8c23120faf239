"""What shared memory takes beyond public interfaces is there; without it, the public way does the same."""

from __future__ import annotations

import errno
import mmap
import operator
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import iceoryx2
import numpy as np
import pytest

from robocomp_py.errors import TransportError
from robocomp_py.transports.shm import room, samples, unsafe
from robocomp_py.transports.shm.node import SLOT_BYTES, Node


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Node]:
    opened = Node(tmp_path, 1)
    yield opened
    opened.close()


def ends(here: Node, name: str = "a") -> tuple[samples.Writer, samples.Reader]:
    _, port = here.new_topic(name, 8, 0, 8, 64, 16)
    return samples.Writer(port, here.heap, 16), samples.Reader(here.topic(name, 0)[1], 8, here.heaps)


def passes(writer: samples.Writer, reader: samples.Reader) -> bool:
    for payload in (b"short", bytes(range(256)) * 100):
        writer.send(0, 0, 0, b"header", payload, len(payload))
        message = reader.read()
        if message is None or bytes(message.payload) != payload:
            return False
    return True


def test_all_private_names_exist_in_the_libraries() -> None:
    assert unsafe._madvise is not None
    assert hasattr(iceoryx2.Publisher, "__loan_slice_uninit")
    assert hasattr(iceoryx2.SampleMutUninit, "__assume_init")
    assert hasattr(iceoryx2.Sample, "__slice_len")


def test_without_private_names_the_public_ones_are_taken() -> None:
    assert unsafe._name(str, "__upper", "upper") == "upper"
    assert unsafe._name(str, "upper", "lower") == "upper"


def test_messages_pass_by_the_public_ways_as_well(here: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    assert passes(*ends(here))
    monkeypatch.setattr(unsafe, "_name", lambda kind, private, public: public)
    monkeypatch.setattr(samples, "initialized", operator.methodcaller("assume_init"))
    monkeypatch.setattr(samples, "length", operator.attrgetter("header.number_of_elements"))
    assert passes(*ends(here, "b"))


def test_slots_lie_as_expected(here: Node) -> None:
    writer, _ = ends(here)
    loans = [writer.lend(100) for _ in range(3)]
    first, *others = [loan.address for loan in loans if loan]
    assert [unsafe.heads_after(first, first, SLOT_BYTES, [number])[0] for number in (1, 2)] == [  # type: ignore[index]
        other - unsafe.SLOT_HEAD for other in others
    ]


def test_where_slots_lie_otherwise_room_is_checked_instead(here: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    assert unsafe.heads_after(1000, 0, SLOT_BYTES, [1]) is None
    monkeypatch.setattr(unsafe, "SLOT_HEAD", 64)
    writer, _ = ends(here)
    kept = [writer.lend(100)]
    monkeypatch.setattr(room, "free", lambda: 0)
    with pytest.raises(TransportError, match="shared memory are needed"):
        writer.lend(100)
    del kept


def test_memory_is_populated_and_errors_are_distinguished() -> None:
    memory = mmap.mmap(-1, mmap.PAGESIZE)
    address = np.frombuffer(memory, np.uint8).ctypes.data
    assert unsafe.populate(address + 8, 16, mmap.PAGESIZE) == 0
    assert unsafe.populate(mmap.PAGESIZE, 16, mmap.PAGESIZE) == errno.ENOMEM


def test_where_memory_cannot_be_populated_free_memory_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    unpopulated: Any = None
    monkeypatch.setattr(unsafe, "_madvise", unpopulated)
    room.own(0, mmap.PAGESIZE, mmap.PAGESIZE)
    assert not room.is_owned(0, mmap.PAGESIZE)
    monkeypatch.setattr(room, "free", lambda: 0)
    with pytest.raises(TransportError, match="shared memory are needed"):
        room.own(0, mmap.PAGESIZE, mmap.PAGESIZE)
