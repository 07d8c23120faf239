"""Tests of faults that every transport must survive: processes that are killed or hang, and floods. To use them:

    class TestMyTransport(TransportFaults):
        def open_transport(self) -> Transport:
            return MyTransport(TransportConfig({...}))

The module must be importable, because other processes open a transport in the same way. Requirements:

    server killed       in the middle of a large reply: its client gets all of it, or Unreachable or Timeout within its
                        deadline; the next server answers
    client killed       while the server writes: others are answered; acknowledged calls were executed, none twice
    publisher killed    in the middle of a message: no part of it is delivered; the next publisher is received
    subscriber hangs    a best-effort publisher and its other subscribers are not affected; a reliable one gives up at
                        its deadline, and continues after the subscriber is killed; memory is bounded
    tap hangs           or is killed: a reliable publisher sends on, and its reliable subscribers lose nothing
    sleeper wakes       messages accepted for a reliable subscriber reach it; messages and commands in order, once
    flood               from another process, at full speed: in order, nothing twice, every message accounted for,
                        memory bounded; reliable: every message
    clock jumps         calls, deadlines and topics are not affected (QoS of topics: `conformance/qos.py`)
    many clients        get equal shares of a server; a flood of one client delays no other
    leftovers           of a killed process are gone after the next process has opened and closed
    two users           may serve and publish the same channel, and do not receive from each other

No test judges speed. The rate of the floods is printed with `-rP`.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import queue
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ..contract.qos import QoS, Reliability
from ..errors import Timeout, Unreachable
from ..transports.base import Capability, Outlet, Reply, Status, Transport
from ..transports.runtime_folder import runtime_dir
from ..wire.codec import Payload
from .actors import (
    FLOOD,
    LARGE,
    MESSAGE,
    RELIABLE,
    Act,
    Other,
    Start,
    answered,
    ask_again_and_again,
    ask_in_a_loop,
    ask_without_waiting,
    everything,
    flood,
    flood_reliably,
    large_bytes,
    listen,
    listen_as_tap,
    number_of,
    numbered,
    open_everything,
    publish_again_and_again,
    reply_and_die,
    take_commands,
    take_numbers,
)
from .parts import A_MOMENT, TransportSuite, answering, answering_all_but, asker, blob, command, query, topic, unblob
from .patience import SOON, wait_until

MOST_MEMORY = 150_000_000
_MISSED = 100
"""Messages of MESSAGE octets for a tap that takes none: more than queues and the kernel hold."""
_CLIENTS = 6
"""Processes that ask one server at once."""
_LEAST_LEASE = 2.0
"""For so many seconds every transport bears with a process that hangs."""


class TransportFaults(TransportSuite):
    """Fill in `open_transport`, and the others if the run-time folder is not all that matters."""

    def open_as_another_user(self) -> Transport:
        """Called in a process that has another run-time folder, as that of another user has."""
        return self.open_transport()

    def leftovers(self) -> set[str]:
        """Names of files and other resources of open transports that outlive their process."""
        return {str(path) for path in runtime_dir().rglob("*")}

    # What the tests use.

    @pytest.fixture
    def start(self, name: str) -> Iterator[Start]:
        """Starts other processes; those that still run at the end are killed."""
        with contextlib.ExitStack() as running:

            def begin(act: Act, folder: str = "") -> Other:
                other = Other(type(self), name, act, folder)
                running.callback(other.kill)
                return other

            yield begin

    # Processes that send many requests.

    def test_client_processes_get_equal_shares_of_a_server(self, here: Transport, name: str, start: Start) -> None:
        done, all_there = Counter[bytes](), threading.Event()

        def service(payload: Payload, expires: float) -> Reply:
            time.sleep(0.004)  # all clients wait then: the server decides about turns, not the scheduler of the system
            if all_there.is_set():
                done[unblob(here, payload)] += 1
            return Reply(Status.OK, payload)

        here.server(query(name), service)
        clients = [start(ask_in_a_loop) for _ in range(_CLIENTS)]
        for number, client in enumerate(clients):
            client.tell(b"%d" % number)
        for client in clients:
            assert client.heard() == "answered"
        all_there.set()
        wait_until(lambda: len(done) == _CLIENTS and min(done.values()) >= 50, SOON * 3)
        shares = sorted(done.values())
        for client in clients:
            client.tell("stop")
        for client in clients:
            assert client.heard() == "stopped"
        assert shares[0] >= shares[-1] / 2, shares

    def test_a_process_that_floods_does_not_hold_up_calls_of_another(
        self, here: Transport, there: Transport, name: str, start: Start
    ) -> None:
        handled = Counter[bytes]()

        def service(payload: Payload, expires: float) -> Reply:
            time.sleep(0.0005)
            handled[unblob(here, payload)] += 1
            return Reply(Status.OK, payload)

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        start(ask_without_waiting)
        held_up = []
        wait_until(lambda: handled[b"flood"] > 200, SOON * 3)
        for _ in range(20):
            before = handled[b"flood"]
            assert asker(there, caller, "ask")(b"call") == b"call"
            held_up.append(handled[b"flood"] - before)
        assert sorted(held_up)[10] < 50, held_up

    # Processes that are killed.

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_server_killed_in_a_large_reply_leaves_no_caller_waiting(
        self, here: Transport, there: Transport, name: str, ask: str, start: Start, pool: ThreadPoolExecutor
    ) -> None:
        caller = there.caller(query(name))
        victim = start(reply_and_die)
        assert victim.heard() == "serving"
        assert caller.wait_peer(SOON)
        asking = pool.submit(asker(there, caller, ask, SOON / 2), b"6 MB")
        assert victim.heard() == "replying"
        victim.join()
        with contextlib.suppress(Unreachable, Timeout):
            assert asking.result(SOON) == large_bytes(1)
        wait_until(lambda: _serve(here, name))
        wait_until(lambda: answered(there, caller, ask, b"next") == b"NEXT")

    def test_a_client_killed_while_the_server_writes_hurts_no_other(
        self, here: Transport, there: Transport, name: str, start: Start
    ) -> None:
        executed: Counter[bytes] = Counter()

        def service(payload: Payload, expires: float) -> Reply:
            data = unblob(here, payload)
            executed[data] += 1
            return Reply(Status.OK, blob(here, data if data.startswith(b"witness") else large_bytes(2)))

        here.server(query(name), service)
        witness = there.caller(query(name))
        assert witness.wait_peer(SOON)
        victim = start(ask_again_and_again)
        acknowledged = [victim.heard() for _ in range(10)]
        victim.kill()
        asked = [b"witness %d" % number for number in range(20)]
        assert [asker(there, witness, "ask")(each) for each in asked] == asked
        acknowledged += victim.all_heard()
        assert [number for number in acknowledged if executed[b"%d" % number] != 1] == []
        assert max(executed.values()) == 1

    def test_a_publisher_killed_in_a_message_leaves_no_part_of_it(
        self, here: Transport, there: Transport, name: str, start: Start
    ) -> None:
        heard: queue.Queue[tuple[int, int, int]] = queue.Queue()

        def sink(payload: Payload) -> None:
            data = np.frombuffer(unblob(here, payload), np.uint8)
            heard.put((len(data), int(data.min()), int(data.max())))

        here.inlet(topic(name), sink)
        victim = start(publish_again_and_again)
        seen = [heard.get(timeout=SOON * 3) for _ in range(5)]  # a process has to start first
        victim.kill()
        outlet = there.outlet(topic(name))
        assert outlet.wait_peer(SOON)

        def the_next_is_heard() -> bool:
            outlet.send(blob(there, b"\0"))
            while not heard.empty():
                seen.append(heard.get())
            return seen[-1][0] == 1

        wait_until(the_next_is_heard)
        assert {size for size, _, _ in seen} == {LARGE, 1}
        assert [least for _, least, _ in seen] == [most for _, _, most in seen]

    def test_a_hanging_subscriber_is_not_waited_for_beyond_what_reliable_demands(
        self, here: Transport, there: Transport, name: str, start: Start
    ) -> None:
        loose, strict = topic(name, QoS(depth=4)), topic(name + "r", QoS(Reliability.RELIABLE, depth=4))
        reliable = Capability.RELIABLE in here.capabilities
        outlets = [here.outlet(loose), *([here.outlet(strict)] if reliable else [])]
        victim = start(listen)
        assert victim.heard() == "listening"
        for outlet in outlets:
            assert outlet.wait_peer(SOON)
            wait_until(lambda outlet=outlet: _heard_of(here, outlet, victim))  # type: ignore[misc]
        others: list[int] = []
        there.inlet(loose, lambda payload: others.append(len(unblob(there, payload))))
        wait_until(lambda: _told(here, outlets[0], b"") and others)
        before = memory()
        victim.stop()
        large = blob(here, bytes(MESSAGE))
        for _ in range(FLOOD):
            outlets[0].send(large)
        wait_until(lambda: _told(here, outlets[0], b"end") and 3 in others)
        assert memory() - before < MOST_MEMORY
        for outlet in outlets[1:]:
            with contextlib.suppress(Timeout):
                _send_many(outlet, large)
                assert not outlet.wait_peer(0.0), "it was not waited for, though it does not count as gone"
        victim.kill()
        for outlet in outlets:
            wait_until(lambda outlet=outlet: _taken(outlet, large))  # type: ignore[misc]

    def test_a_tap_that_hangs_or_is_killed_makes_no_send_of_a_reliable_publisher_fail(
        self, here: Transport, there: Transport, name: str, start: Start
    ) -> None:
        if Capability.RELIABLE not in here.capabilities:
            return  # refused, as the conformance suite shows
        heard: list[int] = []
        there.inlet(topic(name, RELIABLE), lambda payload: heard.append(number_of(there, payload)))
        outlet, numbers = here.outlet(topic(name, RELIABLE)), itertools.count(1)
        tap = start(listen_as_tap)
        assert tap.heard() == "listening"
        assert outlet.wait_peer(SOON)
        wait_until(lambda: _said(here, outlet, next(numbers)) and tap.all_heard() and heard)
        tap.stop()
        for _ in range(_MISSED):
            outlet.send(numbered(here, next(numbers)), SOON)
        tap.kill()
        for _ in range(_MISSED):
            outlet.send(numbered(here, next(numbers)), SOON)
        last = next(numbers)
        outlet.send(numbered(here, last), SOON)
        wait_until(lambda: heard[-1] == last)
        assert heard == list(range(heard[0], last + 1))

    @pytest.mark.parametrize("kind", ["topic", "command"])
    def test_a_stopped_process_gets_accepted_messages_in_order_and_once(
        self, here: Transport, name: str, kind: str, start: Start
    ) -> None:
        reliable = Capability.RELIABLE in here.capabilities
        if kind == "topic" and not reliable:
            return  # refused, as the conformance suite shows
        outlet = here.outlet(topic(name, RELIABLE) if kind == "topic" else command(name))
        sleeper = start(take_numbers if kind == "topic" else take_commands)
        assert sleeper.heard() == "listening"
        assert outlet.wait_peer(SOON)
        outlet.send(numbered(here, 0), SOON)
        assert sleeper.heard() == 0
        sleeper.stop()
        stopped, taken = time.monotonic(), []
        with contextlib.suppress(Timeout, Unreachable):
            for number in range(1, FLOOD):
                outlet.send(numbered(here, number), A_MOMENT)
                taken.append(number)
        counts = outlet.wait_peer(0.0)  # else it has been given up, for good
        assert len(taken) < FLOOD - 1 or not counts
        sleeper.go_on()
        heard, later = [0], itertools.count(FLOOD + 1)

        def the_last_is_heard() -> bool:
            with contextlib.suppress(Timeout, Unreachable):
                outlet.send(numbered(here, next(later)), A_MOMENT)
            heard.extend(sleeper.all_heard())
            return heard[-1] > FLOOD

        try:
            wait_until(the_last_is_heard)
        except AssertionError as exc:
            visible = outlet.wait_peer(0.0)
            exc.add_note(f"taken up to {len(taken)}, then heard {heard}; visible then and now: {counts}, {visible}")
            raise
        slept = time.monotonic() - stopped  # if that was long, it may have been given up since, by a lease
        assert heard == sorted(set(heard))
        if kind == "topic" and counts and slept < _LEAST_LEASE / 2:  # commands expire
            assert set(taken) - set(heard) == set()

    def test_what_a_killed_process_left_is_gone_after_the_next_one(self, name: str, start: Start) -> None:
        self._open_and_close(name)  # creates what is permanent, such as folders
        before = self.leftovers()
        victim = start(open_everything)
        assert victim.heard() == "open"
        victim.kill()
        self._open_and_close(name)
        assert self.leftovers() - before == set()

    def _open_and_close(self, name: str) -> None:
        transport = self.open_transport()
        everything(transport, name)
        transport.close()

    # Neighbours that do not take part in the call.

    def test_two_users_serve_and_publish_the_same_and_do_not_meet(
        self, here: Transport, there: Transport, name: str, start: Start
    ) -> None:
        here.server(query(name), answering(here, lambda data: b"ours: " + data))
        here.inlet(command(name + "c"), lambda _: None)
        heard: queue.Queue[bytes] = queue.Queue()
        here.inlet(topic(name + "t"), lambda payload: heard.put(unblob(here, payload)))
        caller, outlet = there.caller(query(name)), there.outlet(topic(name + "t"))
        with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
            other = start(open_everything, folder)
            assert other.heard() == "open"
            assert caller.wait_peer(SOON)
            assert outlet.wait_peer(SOON)
            assert asker(there, caller, "ask")(b"1") == b"ours: 1"
            other.tell("end")
            other.join()
        outlet.send(blob(there, b"news"))
        assert heard.get(timeout=SOON) == b"news"
        assert asker(there, caller, "ask")(b"2") == b"ours: 2"

    # Floods.

    def test_of_a_flood_every_message_is_accounted_for(self, here: Transport, name: str, start: Start) -> None:
        delivered: list[int] = []

        def sink(payload: Payload) -> None:
            delivered.append(number_of(here, payload))
            if delivered[-1] % 10 == 0:
                time.sleep(0.002)  # slower than the flood

        link = here.inlet(topic(name, QoS(depth=4)), sink)
        sender = start(flood)
        wait_until(lambda: delivered, SOON * 3)  # a process has to start first
        sender.tell("pause")  # earlier messages may have been dropped before the first one was delivered
        paused = sender.heard()
        wait_until(lambda: delivered[-1] == paused)
        before, counted = memory(), link.stats.received + link.stats.dropped + link.stats.lost
        sender.tell("go")
        print("best effort:", sender.heard())
        wait_until(lambda: delivered[-1] > FLOOD)
        sender.tell("enough")
        last = sender.heard()
        wait_until(lambda: delivered[-1] == last)
        counted += last - paused
        wait_until(lambda: link.stats.received + link.stats.dropped + link.stats.lost == counted)
        assert memory() - before < MOST_MEMORY
        assert delivered == sorted(set(delivered))
        assert (link.stats.received, link.stats.repeated) == (len(delivered), 0)

    def test_of_a_reliable_flood_every_message_arrives(self, here: Transport, name: str, start: Start) -> None:
        if Capability.RELIABLE not in here.capabilities:
            return  # refused, as the conformance suite shows
        delivered: list[int] = []
        channel = topic(name, QoS(Reliability.RELIABLE, depth=16))
        link = here.inlet(channel, lambda payload: delivered.append(number_of(here, payload)))
        sender = start(flood_reliably)
        wait_until(lambda: delivered, SOON * 3)  # a process has to start first
        before = memory()
        sender.tell("go")
        print("reliable:", sender.heard())
        wait_until(lambda: delivered[-1] == FLOOD)
        assert memory() - before < MOST_MEMORY
        assert [number for number in delivered if number] == list(range(1, FLOOD + 1))
        assert (link.stats.lost, link.stats.dropped, link.stats.repeated) == (0, 0, 0)

    # Time.

    def test_a_clock_that_leaps_breaks_no_deadline(
        self, here: Transport, there: Transport, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        heard: queue.Queue[bytes] = queue.Queue()
        here.server(query(name), answering_all_but(here, b"never"))
        here.inlet(topic(name + "t"), lambda payload: heard.put(unblob(here, payload)))
        caller, outlet = there.caller(query(name)), there.outlet(topic(name + "t"))
        assert caller.wait_peer(SOON)
        assert outlet.wait_peer(SOON)
        true_ns = time.time_ns
        for hours in (24, -24):
            leap = hours * 3600 * 10**9
            monkeypatch.setattr(time, "time_ns", lambda leap=leap: true_ns() + leap)
            monkeypatch.setattr(time, "time", lambda leap=leap: (true_ns() + leap) / 1e9)
            begun = time.monotonic()
            with pytest.raises(Timeout):
                asker(there, caller, "call", A_MOMENT)(b"never")
            assert time.monotonic() - begun >= A_MOMENT * 0.9
            for how in ("ask", "call"):
                assert asker(there, caller, how)(b"soon") == b"soon"
            outlet.send(blob(there, b"%d" % hours))
            assert heard.get(timeout=SOON) == b"%d" % hours


def _said(transport: Transport, outlet: Outlet, number: int) -> bool:
    outlet.send(numbered(transport, number), SOON)
    return True


def _heard_of(transport: Transport, outlet: Outlet, listener: Other) -> bool:
    outlet.send(blob(transport, b"hello"))
    return bool(listener.all_heard())


def memory() -> int:
    """The resident memory of this process, in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _serve(transport: Transport, name: str) -> bool:
    transport.server(query(name), answering(transport, bytes.upper))
    return True


def _told(transport: Transport, outlet: Outlet, data: bytes) -> bool:
    outlet.send(blob(transport, data))
    return True


def _send_many(outlet: Outlet, payload: Payload) -> None:
    for _ in range(FLOOD):
        outlet.send(payload, A_MOMENT)


def _taken(outlet: Outlet, payload: Payload) -> bool:
    try:
        outlet.send(payload, A_MOMENT)
    except Timeout:
        return False
    return True
