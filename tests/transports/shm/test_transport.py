"""Shared memory keeps the contract. What is special about it: nothing is copied that need not be, and nothing stays."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import gc
import itertools
import mmap
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.qos import Durability, History, QoS, Reliability
from robocomp_py.errors import Closed, ConfigurationError, Timeout, TransportError
from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.testing.faults import TransportFaults
from robocomp_py.testing.parts import (
    A_MOMENT,
    BLOB,
    Inbox,
    blob,
    command,
    drain,
    greet,
    put,
    query,
    subscribe,
    topic,
    unblob,
)
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Status, Transport, TransportConfig, gathering, wait_connected
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.inotify import Watch
from robocomp_py.transports.members import Entry, Found
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.shm import dispatcher, node, room, samples
from robocomp_py.transports.shm.early_wakeup import EarlyWakeup
from robocomp_py.transports.shm.loop import Loop
from robocomp_py.transports.shm.queues import AHEAD, LINGER, Sender, packed, unpacked
from robocomp_py.transports.shm.receipts import SLOTS, Backlog, Reader, Receipts
from robocomp_py.transports.shm.topics import LOANS, SHARE, Publisher, Subscriber
from robocomp_py.transports.shm.transport import ShmTransport
from robocomp_py.transports.shm.wakeup import NEWS, NUDGE, QUEUED, WAKEUPS, Waker, Wakeup

LARGE = 1_000_000
MANY = 16
"""Transports that open or close at once."""
NAME = "shm/Conformance/op"
RELIABLE = QoS(Reliability.RELIABLE, depth=4)
LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)


def opened(owner: str = "test") -> ShmTransport:
    return ShmTransport(TransportConfig(owner=owner))


def segments(folder: Path | None = None) -> set[str]:
    """What transports of a run-time folder have in shared memory; by default, of the one for tests."""
    return {path.name for path in Path("/dev/shm").glob(node.prefix((folder or runtime_dir()) / "shm") + "*")}


def files() -> set[str]:
    found = (path for path in (runtime_dir() / "shm").rglob("*") if not path.is_dir())
    return {str(path) for path in found if path.name != "nodes.lock"}


@pytest.fixture(autouse=True)
def nothing_is_left(own_runtime_folder: Path) -> Iterator[None]:
    """In a folder of its own: an array that an earlier test has forgotten is a transport's until it is collected, and
    leftovers are removed only without members."""
    yield
    if segments():
        gc.collect()
        opened().close()
    assert segments() == set()


class TestShm(TransportConformance):
    def open_transport(self) -> Transport:
        return opened()


class TestShmFaults(TransportFaults):
    def open_transport(self) -> Transport:
        return opened()

    def leftovers(self) -> set[str]:
        return segments() | files()


@pytest.fixture
def here() -> Iterator[ShmTransport]:
    transport = opened("here")
    yield transport
    transport.close()


@pytest.fixture
def there() -> Iterator[ShmTransport]:
    transport = opened("there")
    yield transport
    transport.close()


class Kept:
    """A subscriber that keeps every array it gets."""

    def __init__(self, transport: ShmTransport, name: str = NAME, qos: QoS = QoS(depth=50)) -> None:  # noqa: B008
        self.arrays: list[Any] = []
        self._decode = transport.codec.decoder(BLOB)
        self.link = transport.inlet(topic(name, qos), self._keep)

    def _keep(self, payload: Any) -> None:
        self.arrays.append(self._decode(payload)[0])

    def wait(self, count: int) -> None:
        wait_until(lambda: len(self.arrays) >= count)


def mapped(array: Any) -> str:
    """The file of which this array's memory is a part; empty if it is none's."""
    address = array.ctypes.data
    for line in Path("/proc/self/maps").read_text().splitlines():
        first, last = (int(number, 16) for number in line.split()[0].split("-"))
        if first <= address < last:
            return "".join(line.split(maxsplit=5)[5:])
    return ""


def is_shared(array: Any) -> bool:
    return mapped(array).startswith("/dev/shm/rc")


# Nothing is copied.


def test_what_is_received_lies_where_it_was_written(here: ShmTransport, there: ShmTransport) -> None:
    kept, outlet = Kept(there), here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, bytes(range(250)) * 4000))
    kept.wait(1)
    (array,) = kept.arrays
    assert is_shared(array)
    assert array.tobytes() == bytes(range(250)) * 4000
    assert not array.flags.writeable
    with pytest.raises(ValueError, match="WRITEABLE"):
        array.flags.writeable = True
    with pytest.raises(TypeError, match="read-only"):
        memoryview(array)[0] = 1


def test_fields_are_aligned_whether_they_are_copied_or_not(here: ShmTransport, there: ShmTransport) -> None:
    inbox: list[int] = []
    there.inlet(topic(NAME), lambda payload: inbox.append(np.frombuffer(payload, np.uint8).ctypes.data))
    outlet = here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    sizes = (100, 10_000, 20_000, LARGE)
    for number, size in enumerate(sizes, 1):
        outlet.send(blob(here, bytes(size)))
        wait_until(lambda n=number: len(inbox) == n)  # type: ignore[misc]
    assert [(address + 4) % 8 for address in inbox] == [0] * len(sizes)


def test_answers_are_not_copied_either(here: ShmTransport, there: ShmTransport) -> None:
    seen: list[Any] = []
    decode, encode = here.codec.decoder(BLOB), here.codec.encoder(BLOB)

    def service(payload: Any, expires: float) -> Reply:
        seen.append(decode(payload)[0])
        return Reply(Status.OK, encode((seen[-1],)))

    here.server(query(NAME), service)
    caller = there.caller(query(NAME))
    assert caller.wait_peer(SOON)
    (answer,) = decode(caller.ask(blob(there, b"x" * LARGE), SOON).payload)
    assert is_shared(seen[0])
    assert is_shared(answer)
    assert answer.tobytes() == b"x" * LARGE


@pytest.mark.parametrize("early", [False, True])
def test_it_does_not_matter_to_an_answer_whether_it_is_waited_for_awake(
    here: ShmTransport, there: ShmTransport, early: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EarlyWakeup, "next", lambda trial: early)
    there.server(query(NAME), lambda payload, _: Reply(Status.OK, blob(there, unblob(there, payload))))
    caller = here.caller(query(NAME))
    assert caller.wait_peer(SOON)
    for size in (0, 1000, 100_000, LARGE) * 20:  # the last one is not written as quickly as one wakes up
        data = bytes([size % 251]) * size
        assert unblob(here, caller.ask(blob(here, data), SOON).payload) == data


@pytest.mark.parametrize("size", [0, 64 * 1024 * 1024])
def test_queries_and_commands_may_be_as_large_as_messages(here: ShmTransport, there: ShmTransport, size: int) -> None:
    data = np.arange(size, dtype=np.uint8).tobytes()
    taken: list[bytes] = []
    there.server(query(NAME), lambda payload, _: Reply(Status.OK, blob(there, unblob(there, payload))))
    there.inlet(command(NAME + "c"), lambda payload: taken.append(unblob(there, payload)))
    caller, outlet = here.caller(query(NAME)), here.outlet(command(NAME + "c"))
    assert caller.wait_peer(SOON)
    assert outlet.wait_peer(SOON)
    assert unblob(here, caller.ask(blob(here, data), SOON * 3).payload) == data
    outlet.send(blob(here, data), SOON * 3)
    wait_until(lambda: taken == [data])


def test_arrays_outlive_larger_messages_their_publisher_and_their_transport() -> None:
    here, there = opened(), opened()
    kept, outlet = Kept(there), here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    for number, size in enumerate((LARGE, 2 * LARGE, 9 * LARGE)):
        outlet.send(blob(here, bytes([number]) * size))
        kept.wait(number + 1)
    here.close()
    there.close()
    assert all(map(is_shared, kept.arrays))
    assert [(int(array[0]), int(array[-1]), array.size) for array in kept.arrays] == [
        (0, 0, LARGE),
        (1, 1, 2 * LARGE),
        (2, 2, 9 * LARGE),
    ]
    kept.arrays.clear()

    def nothing_is_left() -> bool:
        opened().close()  # the last process to leave cleans up
        return not segments()

    wait_until(nothing_is_left)  # a thread of the closed ones may have held the last message for a moment more


def test_a_subscriber_that_keeps_too_many_payloads_gets_copies(here: ShmTransport, there: ShmTransport) -> None:
    kept, inbox = Kept(there), subscribe(there, topic(NAME))
    outlet = here.outlet(topic(NAME))
    greet(here, outlet, inbox)
    wait_until(lambda: kept.arrays and bytes(kept.arrays[-1]) == b"go")  # each is told by itself
    begun = len(kept.arrays)
    for number in range(3 * SHARE):
        outlet.send(blob(here, bytes([number]) * 100_000))
        kept.wait(begun + number + 1)
        assert inbox.get(timeout=SOON)[:1] == bytes([number])
    arrays = kept.arrays[begun:]
    assert [int(array[0]) for array in arrays] == list(range(3 * SHARE))
    assert sum(map(is_shared, arrays)) == SHARE
    assert outlet.stats.dropped == 0
    del arrays
    kept.arrays.clear()
    outlet.send(blob(here, b"z" * 100_000))
    kept.wait(1)
    assert is_shared(kept.arrays[0])


def test_kept_requests_and_replies_become_copies_too(here: ShmTransport, there: ShmTransport) -> None:
    kept: list[Any] = []
    decode = here.codec.decoder(BLOB)

    def service(payload: Any, expires: float) -> Reply:
        kept.append(decode(payload)[0])
        return Reply(Status.OK, blob(here, bytes(kept[-1][:1]) * 50_000))

    here.server(query(NAME), service)
    caller = there.caller(query(NAME))
    assert caller.wait_peer(SOON)
    answers = [decode(caller.ask(blob(there, bytes([n]) * 50_000), SOON).payload)[0] for n in range(40)]
    assert [(int(request[0]), int(answer[-1])) for request, answer in zip(kept, answers, strict=True)] == [
        (n, n) for n in range(40)
    ]
    assert 0 < sum(map(is_shared, kept)) < 40
    assert 0 < sum(map(is_shared, answers)) < 40


# Loans.


def fill(data: memoryview, begin: int, content: bytes) -> int:
    """Write a blob as the codec would; where it ends."""
    payload = b"\0\1\0\0" + len(content).to_bytes(4, "little") + content
    data[begin : begin + len(payload)] = payload
    return begin + len(payload)


@pytest.mark.parametrize(("size", "begin"), [(0, 4), (1000, 4), (1000, 61), (LARGE, 4), (LARGE, 20)])
def test_a_loaned_message_begins_wherever_it_was_written(
    here: ShmTransport, there: ShmTransport, size: int, begin: int
) -> None:
    inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    loan = outlet.loan(size + 100)  # type: ignore[union-attr]
    assert np.frombuffer(loan.data, np.uint8).ctypes.data % 8 == 0
    loan.send(begin, fill(loan.data, begin, b"\7" * size))
    assert inbox.get(timeout=SOON) == b"\7" * size
    loan.close()
    with pytest.raises(ValueError, match="ended"):
        loan.send(0, 8)


def test_a_loan_is_written_where_it_is_read(here: ShmTransport, there: ShmTransport) -> None:
    kept, outlet = Kept(there), here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    loan = outlet.loan(LARGE)  # type: ignore[union-attr]
    lent = np.frombuffer(loan.data, np.uint8)
    loan.send(4, fill(loan.data, 4, b"\1" * 500_000))
    kept.wait(1)
    assert mapped(lent) == mapped(kept.arrays[0])
    lent[100] = 9
    assert kept.arrays[0][100 - 12] == 9  # the same memory, so this shows; who sends a loan has given it away


def test_loans_that_are_not_sent_give_their_memory_back(here: ShmTransport, there: ShmTransport) -> None:
    inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    for _ in range(1000):
        outlet.loan(LARGE).close()  # type: ignore[union-attr]
    outlet.send(blob(here, b"after"))
    assert inbox.get(timeout=SOON) == b"after"


def test_when_all_is_lent_a_further_loan_is_refused_until_one_is_given_back(
    here: ShmTransport, there: ShmTransport
) -> None:
    inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    loans = [outlet.loan(LARGE) for _ in range(LOANS)]  # type: ignore[union-attr]
    with pytest.raises(TransportError, match="all memory for messages is in use"):
        outlet.loan(LARGE)  # type: ignore[union-attr]
    loans.pop().close()
    outlet.send(blob(here, b"x"))
    assert inbox.get(timeout=SOON) == b"x"


def test_memory_of_a_loan_can_be_read_when_all_is_closed() -> None:
    here = opened()
    outlet = here.outlet(topic(NAME))
    loan = outlet.loan(LARGE)  # type: ignore[union-attr]
    lent = np.frombuffer(loan.data, np.uint8)
    lent[:] = 5
    here.close()
    assert int(lent.sum()) == 5 * lent.size
    with pytest.raises(Closed):
        outlet.loan(1)  # type: ignore[union-attr]


def test_loans_are_latched_and_numbered_like_others(here: ShmTransport, there: ShmTransport) -> None:
    outlet = here.outlet(topic(NAME, LATCHED))
    for number in (b"1", b"2", b"3"):
        loan = outlet.loan(100)  # type: ignore[union-attr]
        loan.send(4, fill(loan.data, 4, number))
    inbox = Inbox()
    link = there.inlet(topic(NAME, LATCHED), put(there, inbox))
    assert [inbox.get(timeout=SOON), inbox.get(timeout=SOON)] == [b"2", b"3"]
    outlet.send(blob(here, b"4"))
    assert inbox.get(timeout=SOON) == b"4"
    assert (link.stats.lost, link.stats.repeated) == (0, 0)


# Slow readers.


def send_until_it_waits(transport: ShmTransport, outlet: Any) -> int:
    """How many messages were sent, 0, 1, 2 and so on, before one found no room."""
    for number in range(10_000):
        try:
            outlet.send(blob(transport, b"%d" % number), 0.05)
        except Timeout:
            return number
    raise AssertionError("nobody waits")


def test_a_reliable_publisher_goes_on_when_its_reader_leaves(here: ShmTransport, there: ShmTransport) -> None:
    release = threading.Event()
    link = there.inlet(topic(NAME, RELIABLE), lambda _: release.wait(SOON * 3))
    outlet = here.outlet(topic(NAME, RELIABLE))
    assert outlet.wait_peer(SOON)
    assert send_until_it_waits(here, outlet) > 0
    release.set()
    link.close()
    for _ in range(1000):
        outlet.send(blob(here, b"x"), SOON)


def test_keep_all_publishers_wait_for_keep_all_subscribers(here: ShmTransport, there: ShmTransport) -> None:
    inbox, channel = Inbox(), topic(NAME, QoS(history=History.KEEP_ALL))
    link, outlet = there.inlet(channel, put(there, inbox)), here.outlet(channel)
    assert outlet.wait_peer(SOON)
    for number in range(3000):
        outlet.send(blob(here, b"%d" % number), SOON)
    wait_until(lambda: inbox.qsize() == 3000)
    assert (link.stats.lost, link.stats.dropped) == (0, 0)


def test_numbers_are_without_gaps_after_a_timeout(here: ShmTransport, there: ShmTransport) -> None:
    release, inbox = threading.Event(), Inbox()

    def sink(payload: Any) -> None:
        release.wait(SOON * 3)
        inbox.put(unblob(there, payload))

    link, outlet = there.inlet(topic(NAME, RELIABLE), sink), here.outlet(topic(NAME, RELIABLE))
    assert outlet.wait_peer(SOON)
    sent = send_until_it_waits(here, outlet)
    release.set()
    outlet.send(blob(here, b"last"), SOON)
    wait_until(lambda: inbox.qsize() == sent + 1)
    assert drain(inbox) == [*(b"%d" % number for number in range(sent)), b"last"]
    assert (link.stats.lost, link.stats.repeated) == (0, 0)


def test_the_slowest_reader_decides_how_far_a_publisher_goes(tmp_path: Path) -> None:
    quick, slow = Receipts(tmp_path / "quick"), Receipts(tmp_path / "slow")
    backlog = Backlog()
    backlog.meet([Reader(tmp_path / name, 7, 10) for name in ("quick", "slow")])
    assert backlog.wait(11, 2, time.monotonic(), lambda: None)
    assert not backlog.wait(12, 2, time.monotonic(), lambda: None)  # two are on their way to both, who begin at 10
    for receipts in (quick, slow):
        receipts.begin(7)
    quick.took(7, 12)
    assert not backlog.wait(12, 2, time.monotonic(), lambda: None)
    slow.took(7, 11)
    assert backlog.wait(12, 2, time.monotonic(), lambda: None)


def test_a_publisher_that_waits_is_called_once_there_is_room(tmp_path: Path) -> None:
    receipts, backlog = Receipts(tmp_path / "reader"), Backlog()
    receipts.begin(7)
    backlog.meet([Reader(tmp_path / "reader", 7, 0)])
    assert not receipts.took(7, 1)  # no thread waits
    assert not backlog.wait(5, 4, time.monotonic(), lambda: None)
    assert [receipts.took(7, number) for number in (2, 3, 4)] == [False, True, False]


def test_a_slot_belongs_to_one_publisher_after_the_other(tmp_path: Path) -> None:
    receipts = Receipts(tmp_path / "reader")
    for source in range(1, SLOTS + 1):
        receipts.begin(source)
    with pytest.raises(TransportError, match="more than"):
        receipts.begin(SLOTS + 1)
    former = Reader(tmp_path / "reader", 7, 0)
    receipts.took(7, 100)
    assert former.taken() == 100
    receipts.end(7)
    receipts.begin(SLOTS + 1)
    receipts.took(SLOTS + 1, 5)
    assert former.taken() == 0  # what stands there is not its own


@pytest.mark.parametrize("size", [1, 3 * LARGE])
def test_what_is_sent_right_before_closing_arrives(there: ShmTransport, size: int) -> None:
    news, orders = subscribe(there, topic(NAME, RELIABLE)), Inbox()
    there.inlet(command(NAME), put(there, orders))
    for _ in range(5):
        here = opened()
        outlet, order = here.outlet(topic(NAME, RELIABLE)), here.outlet(command(NAME))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, bytes(size)))
        order.send(blob(here, bytes(size)))
        here.close()
        assert [len(news.get(timeout=SOON)), len(orders.get(timeout=SOON))] == [size, size]


def test_a_request_is_served_although_its_acknowledgement_cannot_be_sent(
    here: ShmTransport, there: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures = [TransportError("no descriptor")]

    def receipts(path: Path) -> Receipts:
        if failures:
            raise failures.pop()
        return Receipts(path)

    monkeypatch.setattr(dispatcher, "Receipts", receipts)
    here.server(query(NAME), lambda payload, _: Reply(Status.OK, payload))
    caller = there.caller(query(NAME))
    assert caller.wait_peer(SOON)
    for number in range(3 * AHEAD):  # more than may be ahead of what the sender is told
        assert unblob(there, caller.ask(blob(there, bytes([number % 256])), SOON).payload) == bytes([number % 256])
    assert not failures


def test_messages_that_wait_for_their_handler_do_not_hold_up_their_publisher(
    here: ShmTransport, there: ShmTransport
) -> None:
    go_on, heard = threading.Event(), Inbox()

    def handle(payload: Any) -> None:
        assert go_on.wait(SOON)
        heard.put(bytes(1))

    channel = topic(NAME, QoS(Reliability.RELIABLE, depth=10))
    there.inlet(channel, handle)
    outlet = here.outlet(channel)
    assert outlet.wait_peer(SOON)
    payload = blob(here, bytes(2_500_000))
    for _ in range(6):  # more than may be ahead of who reads
        outlet.send(payload, SOON)
    assert heard.empty()
    outlet.close()
    go_on.set()
    wait_until(lambda: heard.qsize() == 6)


# Nothing stays, and no other user sees it.


def test_closing_leaves_nothing() -> None:
    before = segments(), files()
    here, there = opened(), opened()
    inbox = subscribe(there, topic(NAME, RELIABLE))
    there.inlet(command(NAME + "x"), lambda _: None)
    here.server(query(NAME), lambda payload, _: Reply(Status.OK, payload))
    outlet, caller, order = (
        here.outlet(topic(NAME, RELIABLE)),
        there.caller(query(NAME)),
        here.outlet(command(NAME + "x")),
    )
    for link in (outlet, caller, order):
        assert link.wait_peer(SOON)
    outlet.send(blob(here, bytes(LARGE)))
    order.send(blob(here, bytes(LARGE)))
    caller.ask(blob(there, bytes(LARGE)), SOON)
    assert len(inbox.get(timeout=SOON)) == LARGE
    assert segments() > before[0]
    del outlet, caller, order
    here.close()
    there.close()
    assert (segments(), files()) == before


KILLED = """
import sys
from robocomp_py.testing.parts import blob, query, topic
from robocomp_py.transports.base import Reply, Status, TransportConfig
from robocomp_py.transports.shm.transport import ShmTransport

transport = ShmTransport(TransportConfig())
transport.server(query("shm/Conformance/op"), lambda payload, _: Reply(Status.OK, payload))
transport.inlet(topic("shm/Conformance/op"), lambda _: None)
outlet = transport.outlet(topic("shm/Conformance/other"))
loan = outlet.loan(1_000_000)
print("ready", flush=True)
sys.stdin.read()
"""


def test_what_a_killed_process_left_is_removed_at_the_next_start() -> None:
    before = segments(), files()
    process = subprocess.Popen([sys.executable, "-c", KILLED], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        assert segments() > before[0]
    finally:
        process.kill()
        process.communicate()
    assert segments() > before[0]
    opened().close()
    assert (segments(), files()) == before


def test_what_a_killed_process_left_is_removed_at_the_next_start_though_the_folder_went_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As that of a user who logs out does."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", folder)
        process = subprocess.Popen([sys.executable, "-c", KILLED], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
        finally:
            process.kill()
            process.communicate()
        shutil.rmtree(Path(folder, "shm"))
        assert segments()
        opened().close()
        assert segments() == set()


def test_closing_after_the_folder_was_removed_keeps_the_links_in_the_new_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", folder)
        former = opened()
        shutil.rmtree(Path(folder, "shm"))
        here, there = opened(), opened()
        inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
        assert outlet.wait_peer(SOON)
        former.close()
        late = subscribe(here, topic(NAME))
        greet(here, outlet, inbox)
        greet(here, outlet, late)
        here.close()
        there.close()
        assert segments() == set()


def test_many_nodes_open_and_close_at_once_without_waiting_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    before = segments(), files()
    first = opened()
    monkeypatch.setattr(node, "_PATIENCE", 0.0)  # whatever waits for the lock fails
    with ThreadPoolExecutor(MANY) as threads:
        together = threading.Barrier(MANY)

        def open_and_close(number: int) -> bool:
            together.wait(SOON)
            transport = opened(f"component {number}")
            together.wait(SOON)
            transport.close()
            return transport.closed

        assert all(threads.map(open_and_close, range(MANY)))
    first.close()
    assert (segments(), files()) == before


def test_the_last_of_many_nodes_that_close_at_once_leaves_nothing() -> None:
    before = segments(), files()
    transports = [opened() for _ in range(MANY)]
    together = threading.Barrier(MANY)
    with ThreadPoolExecutor(MANY) as threads:
        list(threads.map(lambda transport: (together.wait(SOON), transport.close()), transports))
    assert (segments(), files()) == before


def test_opening_waits_while_another_node_removes_what_was_left(monkeypatch: pytest.MonkeyPatch) -> None:
    lock = runtime_dir() / "shm" / "nodes.lock"
    lock.parent.mkdir(exist_ok=True)
    with lock.open("w") as held, ThreadPoolExecutor(1) as thread:
        fcntl.flock(held, fcntl.LOCK_EX)
        with monkeypatch.context() as hurried:
            hurried.setattr(node, "_PATIENCE", 0.0)
            with pytest.raises(TransportError, match=r"nodes\.lock is locked, for 0 s"):
                opened()
        opening = thread.submit(opened)
        fcntl.flock(held, fcntl.LOCK_UN)
        opening.result(SOON).close()


def test_an_array_that_outlives_its_transport_does_not_notice_that_the_next_one_cleans_up() -> None:
    before = segments()
    here, there = opened(), opened()
    kept: list[Any] = []
    there.inlet(topic(NAME), lambda payload: kept.extend(there.codec.decoder(BLOB)(payload)))
    outlet = here.outlet(topic(NAME))
    assert outlet.wait_peer(SOON)
    wait_until(lambda: (outlet.send(blob(here, bytes([7]) * LARGE)), kept)[1])
    here.close()
    there.close()
    opened().close()
    assert set(kept[0].tolist()) == {7}
    kept.clear()
    opened().close()
    assert segments() == before


def test_files_of_a_process_killed_at_its_start_or_end_are_removed_with_the_last_member() -> None:
    before = segments(), files()
    half = runtime_dir() / "shm" / "i" / "nodes" / "12345"  # of which iceoryx2 does not know, without the other half
    half.mkdir(parents=True)
    (half / "details").touch()
    Path("/dev/shm", node.prefix(runtime_dir() / "shm") + "half.data").touch()
    opened().close()
    assert (segments(), files()) == before
    assert not half.exists()


def test_a_program_that_forgets_to_close_ends_and_leaves_nothing() -> None:
    before = segments(), files()
    program = KILLED.replace("sys.stdin.read()", "").replace("loan = ", "")  # which would be in use to the end
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=SOON * 6)
    assert (done.returncode, done.stdout) == (0, "ready\n")
    assert "not closed at the end of the program" in done.stderr
    assert (segments(), files()) == before


KEPT = """
import atexit
import sys
import numpy as np

kept = []  # in a module, and so to the end


@atexit.register  # before the transport is imported, so run after all of its own
def look():
    print(sum(int(array.sum()) for array in kept), flush=True)


from robocomp_py.testing.parts import topic
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.shm.transport import ShmTransport

transport = ShmTransport(TransportConfig())
transport.inlet(topic("shm/Conformance/op"), lambda payload: kept.append(np.frombuffer(payload, np.uint8)))
print("ready", flush=True)
sys.stdin.read()
transport.close()
"""


def test_a_program_that_keeps_what_it_received_leaves_nothing_and_may_look_at_it_to_the_end() -> None:
    before = segments(), files()
    here = opened()
    outlet = here.outlet(topic(NAME, RELIABLE))
    process = subprocess.Popen([sys.executable, "-c", KEPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        assert outlet.wait_peer(SOON)
        payloads = [blob(here, bytes([number]) * size) for number, size in ((1, LARGE), (2, LARGE), (3, 2 * LARGE))]
        for payload in payloads:
            outlet.send(payload)
        here.close()
        out, _ = process.communicate(timeout=SOON * 3)
    finally:
        process.kill()
        process.communicate()
    octets = [b"".join(bytes(part) for part in payload) for payload in payloads]
    assert (process.returncode, out) == (0, f"{sum(map(sum, octets))}\n")
    assert (segments(), files()) == before


def test_live_processes_remove_what_killed_ones_left(here: ShmTransport) -> None:
    outlet, inbox = here.outlet(topic(NAME)), subscribe(here, topic(NAME))
    greet(here, outlet, inbox)
    before = segments()
    process = subprocess.Popen([sys.executable, "-c", KILLED], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert outlet.wait_peer(SOON * 3)
        outlet.send(blob(here, b"x"))
    finally:
        process.kill()
        process.communicate()
    wait_until(lambda: segments() == before)


def test_run_time_folders_do_not_meet_and_are_for_their_owner_alone(
    here: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = runtime_dir()
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as second:
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", second)
        elsewhere = opened()
        try:
            inbox, outlet = subscribe(elsewhere, topic(NAME)), here.outlet(topic(NAME))
            greet(here, outlet, subscribe(here, topic(NAME)))
            assert inbox.empty()
            found = segments(first), segments(Path(second))
            assert all(found)
            modes = {stat.S_IMODE((Path("/dev/shm") / name).stat().st_mode) for name in found[0] | found[1]}
            assert modes == {0o600}
        finally:
            elsewhere.close()
    assert not segments(Path(second))


def test_names_in_shared_memory_cannot_be_taken_beforehand(own_runtime_folder: Path) -> None:
    """`/dev/shm` is open to all users. A folder of that name stays in the way, as the file of another user does."""
    opened().close()
    with opened_for_a_moment() as names:
        assert names
    taken = [Path("/dev/shm", name) for name in names]
    for path in taken:
        path.mkdir()
    try:
        with opened_for_a_moment() as others:
            assert others - names
    finally:
        for path in taken:
            path.rmdir()


def test_topics_without_subscribers_take_no_descriptors_and_no_shared_memory(here: ShmTransport) -> None:
    before, descriptors = segments(), len(list(Path("/proc/self/fd").iterdir()))
    with gathering(here):
        outlets = [here.outlet(topic(f"shm/Idle{number}/op")) for number in range(256)]
    for outlet in outlets:
        outlet.send(blob(here, b"unheard"))
    assert segments() == before
    # Threads of other tests may open a file meanwhile, and garbage of other tests may be collected.
    assert len(list(Path("/proc/self/fd").iterdir())) < descriptors + len(outlets) // 8


def test_a_latched_topic_keeps_what_was_sent_before_its_first_subscriber(
    here: ShmTransport, there: ShmTransport
) -> None:
    outlet = here.outlet(topic(NAME, LATCHED))
    for word in (b"1", b"2", b"3"):
        outlet.send(blob(here, word))
    inbox = Inbox()
    there.inlet(topic(NAME, LATCHED), put(there, inbox))
    assert [inbox.get(timeout=SOON) for _ in range(2)] == [b"2", b"3"]


def test_while_a_publisher_looks_for_readers_a_thread_that_sends_looks_too(
    here: ShmTransport, there: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise that thread would take the publisher for up to date, and drop the first message to a new reader."""
    outlet = here.outlet(topic(NAME))
    assert isinstance(outlet, Publisher)
    looks: list[str] = []
    is_open = threading.Event()  # the reader connects after that, so that the publisher has to look once more
    counterparts, connect = outlet.counterparts, Subscriber.look

    def while_looking(*, strict: bool = False) -> list[Found]:
        with monkeypatch.context() as sending:
            sending.setattr(outlet, "look", lambda: looks.append("sender"))
            if outlet.has_subscribers:  # what each `send` asks, too
                is_open.set()
        return counterparts(strict=strict)

    monkeypatch.setattr(outlet, "counterparts", while_looking)
    monkeypatch.setattr(Subscriber, "look", lambda reader: is_open.is_set() and connect(reader))
    inbox = subscribe(there, topic(NAME))
    assert wait_connected(outlet, SOON)
    outlet.send(blob(here, b"word"))
    assert inbox.get(timeout=SOON) == b"word"
    assert looks


def test_an_obstructing_file_is_reported_with_its_owner_and_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        node.os, "urandom", lambda count: bytes.fromhex("0123456789abcdef")[:count]
    )  # as if it were known
    with opened_for_a_moment() as names:
        (shared,) = (Path("/dev/shm", name) for name in names if name.endswith(".global_mgmt"))
    shared.mkdir()
    try:
        with pytest.raises(TransportError, match=f"{shared} belongs to user .* in the way: have it removed .sudo rm"):
            opened()
    finally:
        shared.rmdir()


@contextlib.contextmanager
def opened_for_a_moment() -> Iterator[set[str]]:
    """What is in shared memory while a transport is open."""
    transport = opened()
    try:
        yield segments()
    finally:
        transport.close()


# Bells.


def test_wake_ups_sent_while_not_waiting_are_found_together(tmp_path: Path) -> None:
    wakeup = Wakeup(tmp_path / "wakeup")
    waker = Waker(tmp_path / "wakeup")
    for number in (3, 7, 3):
        assert waker.wake(number)
    assert set(wakeup.wait(SOON)) == {3, 7}
    assert not list(wakeup.wait(0.0))
    wakeup.close()


def test_after_too_many_wake_ups_all_numbers_count_as_received(tmp_path: Path) -> None:
    wakeup = Wakeup(tmp_path / "wakeup")
    waker = Waker(tmp_path / "wakeup")
    for _ in range(10_000):
        assert waker.wake(3)  # no thread is held up
    assert set(wakeup.wait(SOON)) == set(range(WAKEUPS))
    wakeup.close()


def test_what_is_only_announced_wakes_and_is_not_taken_for_a_message(tmp_path: Path) -> None:
    wakeup = Wakeup(tmp_path / "wakeup")
    waker = Waker(tmp_path / "wakeup")
    waker.wake(NUDGE)
    assert not list(wakeup.wait(SOON))
    waker.wake(NUDGE)
    waker.wake(3)
    assert wakeup.wait(SOON) == bytes((3,))  # as if only that number had come, once
    waker.wake(NUDGE)
    assert wakeup.woken(SOON)
    for _ in range(10_000):
        waker.wake(NUDGE)
    assert QUEUED in wakeup.wait(SOON)  # the later number did not fit in
    wakeup.close()


def test_a_closed_wake_up_pipe_has_no_reader(tmp_path: Path) -> None:
    wakeup = Wakeup(tmp_path / "wakeup")
    waker = Waker(tmp_path / "wakeup")
    wakeup.close()
    assert not waker.wake(3)
    waker.close()
    assert not waker.wake(3)
    with pytest.raises(TransportError, match="wakeup: No such file"):
        Waker(tmp_path / "wakeup")


def test_a_wake_up_pipe_also_reports_that_the_folder_has_changed(tmp_path: Path) -> None:
    (tmp_path / "watched").mkdir()
    watch = Watch(tmp_path)
    watch.add(str(tmp_path / "watched"))
    wakeup, waker = Wakeup(tmp_path / "wakeup", watch), Waker(tmp_path / "wakeup")
    (tmp_path / "new").touch()
    (tmp_path / "new").rename(tmp_path / "watched" / "new.json")
    assert list(wakeup.wait(SOON)) == [NEWS]
    waker.wake(3)
    (tmp_path / "watched" / "new.json").unlink()
    assert set(wakeup.wait(SOON)) == {NEWS, 3}
    assert not list(wakeup.wait(0.0))
    wakeup.close()
    watch.close()


class Counting:
    """A link that counts how often it is attended to, and how often for one message."""

    turns = ones = 0

    def on_input(self, *, one: bool = False) -> tuple[()]:
        self.turns += 1
        self.ones += one
        return ()


def test_a_link_that_was_asked_for_several_times_is_attended_to_once(tmp_path: Path) -> None:
    wakeup, waker, link = Wakeup(tmp_path / "wakeup"), Waker(tmp_path / "wakeup"), Counting()
    loop = Loop(wakeup, waker, lambda: SOON, lambda: None)
    loop.add(3, link)
    loop.attend(link)
    waker.wake(3)
    assert not list(loop.receive())
    assert link.turns == 1
    waker.close()
    wakeup.close()


def test_one_wake_up_takes_one_message_and_looks_for_more_afterwards(tmp_path: Path) -> None:
    wakeup, waker, link = Wakeup(tmp_path / "wakeup"), Waker(tmp_path / "wakeup"), Counting()
    loop = Loop(wakeup, waker, lambda: SOON, lambda: None)
    loop.add(3, link)
    loop.receive()
    assert (link.turns, link.ones) == (1, 0)  # when it was added
    waker.wake(3)
    loop.afterwards(lambda: loop.attend(link))
    loop.receive()
    assert (link.turns, link.ones) == (2, 0)  # it was to be attended to anyhow: all is taken
    waker.wake(3)
    loop.receive()
    assert (link.turns, link.ones) == (3, 1)
    for _ in range(2):
        waker.wake(3)
    loop.receive()
    assert (link.turns, link.ones) == (4, 1)  # there may be several
    waker.close()
    wakeup.close()


def test_a_failure_in_later_work_does_not_stop_receiving(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    wakeup, waker, link = Wakeup(tmp_path / "wakeup"), Waker(tmp_path / "wakeup"), Counting()
    loop = Loop(wakeup, waker, lambda: SOON, lambda: None)
    loop.add(3, link)

    def fail() -> None:
        raise TransportError("broken")

    loop.afterwards(fail)
    loop.receive()
    assert link.turns == 1
    assert "broken" in caplog.text
    waker.close()
    wakeup.close()


# Shared memory is limited.


def test_opening_says_what_to_do_when_there_is_too_little(monkeypatch: pytest.MonkeyPatch) -> None:
    before = segments()
    monkeypatch.setattr(room, "free", lambda: 1_000_000)
    with pytest.raises(TransportError, match=r"1000000 are left in /dev/shm; make it larger .*--shm-size"):
        opened()
    monkeypatch.undo()
    assert segments() == before
    opened().close()


def test_opening_says_what_to_do_where_nothing_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node, "SHARED_MEMORY", str(tmp_path / "nowhere"))
    with pytest.raises(TransportError, match="cannot be written to; mount it"):
        opened()


def test_a_run_time_folder_with_too_long_a_path_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / ("x" * 100)))
    with pytest.raises(ConfigurationError, match="100 is the limit; set ROBOCOMP_RUNTIME_DIR to a shorter path"):
        opened()


NO_MORE_FILES = """
import contextlib
import resource
from robocomp_py.errors import TransportError
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.shm.transport import ShmTransport

resource.setrlimit(resource.RLIMIT_NOFILE, (200, 200))
with contextlib.ExitStack() as opened:
    try:
        while True:
            opened.callback(ShmTransport(TransportConfig()).close)
    except TransportError as exc:
        print(exc)
"""


def test_reaching_the_file_limit_is_reported_and_leaves_nothing() -> None:
    before = segments(), files()
    done = subprocess.run([sys.executable, "-c", NO_MORE_FILES], capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0
    assert "may have 200: let it have more (ulimit -n" in done.stdout or "Too many open files" in done.stdout
    assert (segments(), files()) == before


SHORT_OF_FILES = """
import os, resource, sys, threading
from robocomp_py.testing.conformance import answering, query
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.shm.transport import ShmTransport

transport, hoard = ShmTransport(TransportConfig()), []
transport.server(query(sys.argv[1]), answering(transport, bytes.upper))
_, most = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (max(map(int, os.listdir("/proc/self/fd"))) + 20, most))

def take():
    try:
        while True:
            hoard.append(os.dup(0))
    except OSError:
        pass

def leave(count):
    while len(hoard) > count:
        os.close(hoard.pop())

print("serving", flush=True)
for line in sys.stdin:
    {"none": take, "two": lambda: leave(len(hoard) - 2), "all": lambda: leave(0)}[line.strip()]()
    before = transport._call_at
    wait_until(lambda: transport._call_at > before)  # it has looked
    print(line, end="", flush=True)
transport.close()
"""


def test_a_server_short_of_files_serves_its_client_later(there: ShmTransport) -> None:
    program = [sys.executable, "-c", SHORT_OF_FILES, NAME]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdin
        assert server.stdout
        assert server.stdout.readline() == "serving\n"

        def have(files: str) -> None:
            print(files, file=server.stdin, flush=True)
            assert server.stdout.readline().strip() == files  # type: ignore[union-attr]  # seen above

        caller = there.caller(query(NAME))
        have("none")
        assert caller.wait_peer(SOON)
        with pytest.raises(Timeout):
            caller.ask(blob(there, b"early"), A_MOMENT)
        have("two")  # too few to connect
        have("all")
        assert unblob(there, caller.ask(blob(there, b"late"), SOON).payload) == b"LATE"
        server.stdin.close()


def test_sending_raises_when_there_is_no_more_and_goes_on_when_there_is(
    here: ShmTransport, there: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
    greet(here, outlet, inbox)

    monkeypatch.setattr(room, "populate", lambda *_: errno.EFAULT)
    with pytest.raises(TransportError, match="shared memory are needed"):
        outlet.send(blob(here, bytes(LARGE)))
    with pytest.raises(TransportError, match="shared memory are needed"):
        outlet.loan(LARGE)  # type: ignore[union-attr]
    monkeypatch.undo()
    outlet.send(blob(here, bytes(LARGE)))
    assert len(inbox.get(timeout=SOON)) == LARGE


def resident(address: int) -> bool:
    """Whether there is memory behind that address already."""
    page = address - address % mmap.PAGESIZE
    found = ctypes.c_ubyte()
    assert ctypes.CDLL(None).mincore(ctypes.c_void_p(page), 1, ctypes.byref(found)) == 0
    return bool(found.value & 1)


def test_the_next_slots_have_memory_where_iceoryx2_writes_before_we_are_asked(here: ShmTransport) -> None:
    _, port = here.node.new_topic("heads", 8, 0, 8, 64, 16)
    writer = samples.Writer(port, here.node.heap, 16)
    for loans in ([writer.lend(100)], [writer.lend(100) for _ in range(16)]):
        addresses = [loan.address for loan in loans if loan]
        apart = node.SLOT_BYTES + 48
        assert all(after - before == apart for before, after in itertools.pairwise(addresses))
        assert all(
            resident(addresses[-1] + n * apart - 48) and resident(addresses[-1] + n * apart - 1) for n in (1, 16)
        )
        del loans


def test_a_large_message_for_which_there_is_no_room_does_not_take_what_is_left(
    here: ShmTransport, there: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
    greet(here, outlet, inbox)
    outlet.send(blob(here, bytes(600_000)))
    assert inbox.get(timeout=SOON) == bytes(600_000)
    monkeypatch.setattr(room, "free", lambda: 300_000)
    with pytest.raises(TransportError, match="300000 are left"):
        outlet.send(blob(here, bytes(LARGE)))
    outlet.send(blob(here, b"a short one"))
    assert inbox.get(timeout=SOON) == b"a short one"


def test_kept_errors_keep_no_memory(here: ShmTransport, monkeypatch: pytest.MonkeyPatch) -> None:
    _, port = here.node.new_topic("errors", 8, 0, 8, 8, LOANS)
    writer = samples.Writer(port, here.node.heap, LOANS)
    kept: list[pytest.ExceptionInfo[TransportError]] = []
    with monkeypatch.context() as little:
        little.setattr(room, "populate", lambda *_: errno.EFAULT)
        for _ in range(50):
            with pytest.raises(TransportError, match="bytes of shared memory are needed") as failure:
                writer.lend(LARGE)
            kept.append(failure)
    assert writer.lend(LARGE) is not None


def test_an_answer_for_which_there_is_no_memory_fails_its_call(
    here: ShmTransport, there: ShmTransport, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    here.server(query(NAME), lambda payload, _: Reply(Status.OK, blob(here, bytes(LARGE))))
    caller = there.caller(query(NAME))
    assert caller.wait_peer(SOON)

    monkeypatch.setattr(room, "populate", lambda address, size, page: 0 if size < LARGE else errno.EFAULT)
    assert caller.ask(blob(there, b""), SOON).status is Status.FAILED
    assert "shared memory are needed" in caplog.text


# What is not ours.


@pytest.mark.parametrize("address", ["", "x", "1/", "1/zz", "-1/0", "1/counted/2", "9" * 30])
def test_a_peer_whose_address_is_not_understood_is_left_out(
    address: str, here: ShmTransport, there: ShmTransport, caplog: pytest.LogCaptureFixture
) -> None:
    """Whatever an entry of another program is, the others are found."""
    asked = query(NAME)
    alien = Directory(runtime_dir() / "shm").join("alien")
    for role, channel in (("publishes", topic(NAME)), ("subscribes", topic(NAME)), ("serves", asked)):
        alien.add(Entry(role, NAME, channel.type.fingerprint, channel.type.text, address))
    inbox, outlet = subscribe(there, topic(NAME)), here.outlet(topic(NAME))
    greet(here, outlet, inbox)
    with pytest.raises(TransportError):
        here.caller(asked).ask(blob(here, b"hello"), A_MOMENT)
    alien.close()
    assert not caplog.records


def test_malformed_messages_are_counted(
    here: ShmTransport, there: ShmTransport, caplog: pytest.LogCaptureFixture
) -> None:
    inbox = Inbox()
    link = here.inlet(command(NAME), put(here, inbox))
    outlet = there.outlet(command(NAME))
    assert outlet.wait_peer(SOON)
    sender = Sender(there.node, packed(there.member.id), here.member.id, 0)
    for header in (b"", b"\x63" * 30):
        assert sender.send(0, int(link.address), header, b"rubbish", 7)  # type: ignore[union-attr]
        assert sender.send(0, 0, header, b"rubbish", 7)
        assert sender.send(0, 12345, header, b"rubbish", 7)
    outlet.send(blob(there, b"fine"))
    assert inbox.get(timeout=SOON) == b"fine"
    wait_until(lambda: link.stats.malformed == 2)
    assert sum("malformed" in record.message for record in caplog.records) == 2  # of the link, and of none
    sender.close()


def test_names_of_members_are_numbers_too() -> None:
    for name in ("1-00000000", "4194304-deadbeef", "77-0000000a"):
        assert unpacked(packed(name)) == name


def test_what_is_closed_together_is_given_time_once(here: ShmTransport) -> None:
    with gathering(here):
        first = here.settling()
        wait_until(lambda: time.monotonic() + LINGER > first)
        assert here.settling() == first
    assert here.settling() > first
