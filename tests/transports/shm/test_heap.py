"""A heap has as much memory as is in use, and a little more; what is free goes back to the system."""

from __future__ import annotations

import contextlib
import random
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.errors import TransportError
from robocomp_py.testing.parts import BLOB, Inbox, blob, command, query, topic, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Status, TransportConfig
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.shm import heap, node
from robocomp_py.transports.shm.heap import SPARE
from robocomp_py.transports.shm.pages import Pages
from robocomp_py.transports.shm.queues import packed
from robocomp_py.transports.shm.receipts import Receipts
from robocomp_py.transports.shm.transport import ShmTransport

MB = 1_000_000
NAME = "shm/Heap/op"
RELIABLE = QoS(Reliability.RELIABLE, depth=4)


@st.composite
def histories(draw: st.DrawFn) -> list[tuple[str, int]]:
    step = st.tuples(st.sampled_from(("take", "take", "give", "chill")), st.integers(1, 40))
    return draw(st.lists(step, max_size=60))


@given(histories())
def test_no_page_is_used_twice_and_those_with_memory_are_counted(history: list[tuple[str, int]]) -> None:
    pages, taken = Pages(64), list[range]()
    warm = set[int]()
    for what, number in history:
        if what == "take":
            while (begin := pages.place(number)) is None:
                pages.grow(2 * pages.size)
            extent = range(begin, begin + number)
            assert not any(set(extent) & set(other) for other in taken)
            assert pages.cold(begin, number) == len(set(extent) - warm) == pages.take(begin, number)
            taken.append(extent)
            warm |= set(extent)
        elif what == "give" and taken:
            extent = taken.pop(number % len(taken))
            pages.give(extent.start, len(extent))
        elif what == "chill":
            used = {page for extent in taken for page in extent}
            for begin, count in pages.chill(number):
                chilled = set(range(begin, begin + count))
                assert chilled <= warm - used
                warm -= chilled
            assert len(warm) <= number or warm == used
        assert (pages.warm, pages.taken) == (len(warm), sum(map(len, taken)))


def memory() -> int:
    """Bytes that transports of the run-time folder for tests have in shared memory."""
    found = 0
    for path in Path("/dev/shm").glob(node.prefix(runtime_dir() / "shm") + "*"):
        try:
            found += path.stat().st_blocks * 512
        except FileNotFoundError:  # meanwhile
            continue
    return found


def opened(owner: str = "test") -> ShmTransport:
    return ShmTransport(TransportConfig(owner=owner))


@pytest.fixture
def here(own_runtime_folder: Path) -> Iterator[ShmTransport]:
    transport = opened("here")
    yield transport
    transport.close()


@pytest.fixture
def there(own_runtime_folder: Path) -> Iterator[ShmTransport]:
    transport = opened("there")
    yield transport
    transport.close()


CONTAINER = """
from robocomp_py.testing.parts import blob, command, query
from robocomp_py.transports.base import Reply, Status, TransportConfig
from robocomp_py.transports.shm.transport import ShmTransport

client, server = (ShmTransport(TransportConfig(owner=name)) for name in ("client", "server"))
dropped = []
server.server(query("shm/Heap/keep"), lambda payload, _: Reply(Status.OK, blob(server, b"kept")))
server.inlet(command("shm/Heap/drop"), lambda _: dropped.append(1))
keep, drop = client.caller(query("shm/Heap/keep")), client.outlet(command("shm/Heap/drop"))
assert keep.wait_peer(20) and drop.wait_peer(20)
large, small = blob(client, bytes(5_000_000)), blob(client, bytes(64))
for _ in range(40):
    assert keep.ask(large, 20.0).status is Status.OK
    for _ in range(100):
        drop.send(small, 20.0)
client.close()
server.close()
print("ok")
"""


@pytest.mark.tool
def test_large_and_small_requests_by_turns_fit_into_the_shared_memory_of_a_container() -> None:
    """64 MB by default. Mounting needs root."""
    mount = 'mount -t tmpfs -o size=64m tmpfs /dev/shm && exec "$0" -c "$1"'
    whole = ["unshare", "-m", "sh", "-c", mount, sys.executable, CONTAINER]
    done = subprocess.run(whole, capture_output=True, text=True, timeout=SOON * 12)
    assert (done.returncode, done.stdout) == (0, "ok\n"), done.stderr


def test_large_and_small_requests_by_turns_take_what_is_in_use_and_little_more(
    here: ShmTransport, there: ShmTransport
) -> None:
    sizes: list[int] = []
    there.server(query(NAME), lambda payload, _: Reply(Status.OK, blob(there, b"kept")))
    there.inlet(command(NAME + "c"), lambda payload: sizes.append(len(payload)))
    keep, drop = here.caller(query(NAME)), here.outlet(command(NAME + "c"))
    assert keep.wait_peer(SOON)
    assert drop.wait_peer(SOON)
    large, small = blob(here, bytes(5 * MB)), blob(here, bytes(64))
    highest = 0
    for _ in range(30):
        keep.ask(large, SOON)
        for _ in range(100):
            drop.send(small, SOON)
        highest = max(highest, memory())
    in_use = 2 * 5 * MB  # on a busy machine, the server still has the one before when the next one is sent
    assert highest <= 1.5 * in_use + 4 * MB
    wait_until(lambda: len(sizes) == 3000)


def test_memory_of_random_sizes_is_bounded_by_what_is_in_use_and_goes_back(
    here: ShmTransport, there: ShmTransport
) -> None:
    """One subscriber keeps some of what it gets, at random; what else is in use is on its way."""
    chance = random.Random(1)
    kept: dict[int, Any] = {}
    heard = Inbox()
    decode = there.codec.decoder(BLOB)

    def take(payload: Any) -> None:
        array = decode(payload)[0]
        kept[chance.randrange(5)] = array
        heard.put(array.size)

    there.inlet(topic(NAME, RELIABLE), take)
    outlet = here.outlet(topic(NAME, RELIABLE))
    assert outlet.wait_peer(SOON)
    most = 0
    for _ in range(150):
        size = int(8 * MB * chance.random() ** 3)
        outlet.send(blob(here, bytes(size)), SOON)
        assert heard.get(timeout=SOON) == size
        most = max(most, sum(array.nbytes for array in kept.values()) + 8 * MB)
        assert memory() <= 1.5 * most + 4 * MB
    kept.clear()
    wait_until(lambda: memory() <= SPARE * 4096 + MB)


def test_what_is_kept_is_not_written_to_when_its_sender_goes_on_without_that_link(
    here: ShmTransport, there: ShmTransport
) -> None:
    kept: list[Any] = []
    decode = there.codec.decoder(BLOB)
    there.inlet(topic(NAME), lambda payload: kept.append(decode(payload)[0]))
    first = here.outlet(topic(NAME))
    assert first.wait_peer(SOON)
    for number in range(4):
        first.send(blob(here, bytes([number]) * MB))
        wait_until(lambda n=number: len(kept) == n + 1)  # type: ignore[misc]
    first.close()
    second = here.outlet(topic(NAME + "2"))
    for _ in range(20):
        for size in (MB, 3 * MB):
            second.loan(size).data[:] = b"\xff" * size  # type: ignore[union-attr]
    here.node.heap.tidy()
    assert [set(array.tolist()) for array in kept] == [{0}, {1}, {2}, {3}]
    kept.clear()
    wait_until(lambda: memory() <= SPARE * 4096 + MB)


def test_a_request_waits_for_memory_that_others_are_about_to_give_back(
    here: ShmTransport, there: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robocomp_py.transports.shm import room

    go_on, taken = threading.Event(), Inbox()

    def slow(payload: Any) -> None:
        assert go_on.wait(SOON * 3)
        taken.put(len(unblob(there, payload)))

    there.inlet(command(NAME), slow)
    outlet = here.outlet(command(NAME))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, bytes(MB)), SOON)
    with monkeypatch.context() as little:
        little.setattr(room, "free", lambda: 0)
        threading.Timer(0.05, go_on.set).start()
        outlet.send(blob(here, bytes(MB)), SOON)  # where the first one was
    assert [taken.get(timeout=SOON), taken.get(timeout=SOON)] == [MB, MB]


def test_threads_that_send_at_once_do_not_mix_up_their_memory(here: ShmTransport, there: ShmTransport) -> None:
    there.server(query(NAME), lambda payload, _: Reply(Status.OK, blob(there, unblob(there, payload))))
    caller = here.caller(query(NAME))
    assert caller.wait_peer(SOON)
    wrong: list[str] = []

    def ask(seed: int) -> None:
        chance = random.Random(seed)
        for _ in range(40):
            data = bytes([chance.randrange(256)]) * chance.choice((10, 5000, 50_000, 300_000, 900_000))
            if unblob(here, caller.ask(blob(here, data), SOON * 3).payload) != data:
                wrong.append(f"{seed}: {len(data)}")

    threads = [threading.Thread(target=ask, args=(seed,)) for seed in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_an_answer_can_be_read_when_its_server_has_closed_meanwhile(
    here: ShmTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that waits for it may be slow, and others of its transport see sooner that the server has left."""
    server, asked = opened("server"), []

    def service(payload: Any, expires: float) -> Reply:
        asked.append(payload)
        return Reply(Status.OK, blob(server, b"x" * MB))

    server.server(query(NAME), service)
    caller = here.caller(query(NAME))
    assert caller.wait_peer(SOON)
    caller.ask(blob(here, b""), SOON)
    member, _ = here.directory.find("serves", NAME)[0]
    peer, number = here.peer(member), packed(member.id)
    assert peer
    line = peer.take(NAME)
    woken = line.woken

    def woken_while_the_server_closes(seconds: float) -> bool:
        found = woken(seconds)
        if found and len(asked) == 2:  # else it was woken late for the first answer
            server.close()
            here.node.heaps.forget_left()
        return found

    monkeypatch.setattr(line, "woken", woken_while_the_server_closes)
    peer.give(line)
    assert len(unblob(here, caller.ask(blob(here, b""), SOON).payload)) == MB
    assert number in here.node.heaps.known()
    monkeypatch.setattr(heap, "LINGERING", 0.0)
    wait_until(lambda: number not in here.node.heaps.known())


LIVING = """
import sys
from pathlib import Path
from robocomp_py.transports.shm.node import Node
node = Node(Path(sys.argv[1]), int(sys.argv[2]))
print("ready", flush=True)
input()
"""


def test_heaps_of_killed_processes_are_removed_one_by_one_by_a_node_that_lives(own_runtime_folder: Path) -> None:
    folder, pipe = own_runtime_folder / "apart", subprocess.PIPE
    folder.mkdir()

    def heaps() -> set[Path]:
        return set(Path("/dev/shm").glob(f"{node.prefix(folder)}*.heap"))

    with contextlib.closing(node.Node(folder, 1)) as living, contextlib.ExitStack() as ends:
        ours = heaps()
        assert len(ours) == 1
        commands = [[sys.executable, "-c", LIVING, str(folder), str(number)] for number in (2, 3)]
        others = [ends.enter_context(subprocess.Popen(each, stdin=pipe, stdout=pipe)) for each in commands]
        assert [each.stdout.readline() for each in others if each.stdout] == [b"ready\n"] * 2
        for each in others:
            each.kill()
            each.wait()
        assert living.bury(), "it removes what one of them has left"
        assert not living.bury()
        assert heaps() == ours


@pytest.mark.tool
def test_receipts_on_a_full_disk_are_an_error_and_kill_no_process(tmp_path: Path) -> None:
    """Room that is only promised would be missed at the first write, by a signal that ends the process."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(tmp_path)], check=True)
    try:
        with pytest.raises(TransportError, match="No space left"):
            Receipts(tmp_path / "receipts")
        assert not list(tmp_path.iterdir())
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
