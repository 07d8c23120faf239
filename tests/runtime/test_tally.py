"""What is counted of calls between two components of one process."""

from __future__ import annotations

import sys
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Pattern, Verb
from robocomp_py.contract.qos import DEFAULT_QOS
from robocomp_py.contract.types import INT32, Field
from robocomp_py.errors import RemoteFailure
from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.ports import Proxy
from robocomp_py.runtime.route import Route
from robocomp_py.runtime.tally import Tally
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.inproc import InprocTransport

HALVE: Operation[int] = Operation("Tally::Numbers", "halve", (Field("n", INT32),), (Field("ret", INT32),))
NUMBERS = Interface("Tally::Numbers", (HALVE,))


class Handlers:
    def Numbers_halve(self, n: int) -> int:
        if n % 2:
            raise ValueError(n)
        return n // 2


@contextmanager
def connected() -> Iterator[tuple[Proxy, Tally, Tally]]:
    """A proxy, what its side counts, and what the other one counts."""
    server, client = Monitor(), Monitor()
    transport = InprocTransport(TransportConfig({"bus": "tally"}))

    def route(port: Port, operation: Operation[object]) -> Route:
        return Route(transport, "inproc", f"numbers/Numbers/{operation.name}", DEFAULT_QOS, 5.0)

    links = ports.bind_handlers(Port(Verb.IMPLEMENTS, NUMBERS), Handlers(), route, server)
    try:
        proxy, more = ports.bind_proxy(Port(Verb.REQUIRES, NUMBERS, proxy=Proxy), route, client)
        links += more
        server.open()
        yield proxy, client.tallies.every[0], server.tallies.every[0]
    finally:
        server.turn_away()
        ports.close_all(links)
        server.close()
        client.close()
        transport.close()


def ask(proxy: Proxy, number: int) -> int:
    return proxy._ask(HALVE, (number,), None)


def test_counts_are_exact_also_if_several_threads_call_at_once() -> None:
    def call(proxy: Proxy) -> None:
        for _ in range(2000):
            ask(proxy, 2)

    with connected() as (proxy, asked, served):
        threads = [threading.Thread(target=call, args=(proxy,)) for _ in range(4)]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
        assert (asked.count, served.count, asked.failed, served.failed) == (8000, 8000, 0, 0)


def test_failures_are_exact_also_of_calls_that_are_not_timed() -> None:
    with connected() as (proxy, asked, served):
        asked.due = served.due = sys.maxsize  # as if they were frequent: none is timed
        for number in (2, 3, 4, 5):
            if number % 2:
                with pytest.raises(RemoteFailure):
                    ask(proxy, number)
            else:
                ask(proxy, number)
        assert (asked.count, asked.failed, asked.timed) == (4, 2, 0)
        assert (served.count, served.failed, served.timed) == (4, 2, 0)


def tally(verb: Verb = Verb.REQUIRES) -> Tally:
    route = Route(InprocTransport, "inproc", "a/Numbers/halve", DEFAULT_QOS, 1.0)  # type: ignore[arg-type]  # not used
    return Tally(Port(verb, NUMBERS), HALVE, Pattern.QUERY, route)


def call(tally: Tally, times: int, every_s: float, begin_s: float = 0.0) -> int:
    """Count calls, as a port does; return how many of them were timed."""
    before = tally.timed
    for number in range(times):
        tally.count += 1
        if tally.count >= tally.due:
            tally.take_turn()
            tally.time(begin_s + number * every_s, 1e-6, 0.0)
    return tally.timed - before


def test_every_call_is_timed_unless_calls_are_frequent() -> None:
    assert call(tally(), 1000, every_s=0.001) == 1000


@pytest.mark.parametrize("every_s", [1e-5, 4e-4])
def test_of_frequent_calls_each_64th_is_timed(every_s: float) -> None:
    made = tally()
    call(made, 128, every_s)
    assert call(made, 6400, every_s, begin_s=128 * every_s) == 100


def test_one_pause_does_not_make_frequent_calls_rare() -> None:
    made = tally()
    call(made, 1000, every_s=1e-5)
    assert call(made, 640, every_s=1e-5, begin_s=1.0) <= 11


def test_calls_that_have_become_rare_are_all_timed_again() -> None:
    made = tally()
    call(made, 1000, every_s=1e-5)
    call(made, 128, every_s=0.01, begin_s=1.0)
    assert call(made, 100, every_s=0.01, begin_s=3.0) == 100


def test_the_first_call_after_a_look_is_timed() -> None:
    made = tally()
    call(made, 1000, every_s=1e-5)
    made.time_next()
    assert call(made, 1, every_s=1.0, begin_s=1.0) == 1


def test_the_latest_256_durations_are_kept_in_their_order() -> None:
    made = tally()
    assert made.latest == []
    for number in range(100):
        made.time(number, number / 4, 0.0)
    assert made.latest == [number / 4 for number in range(100)]
    for number in range(100, 1000):
        made.time(number, number / 4, 0.0)
    assert made.latest == [number / 4 for number in range(744, 1000)]


def test_the_counters_of_a_busy_component_take_little_memory() -> None:
    made = [tally(Verb.IMPLEMENTS) for _ in range(20)]
    tracemalloc.start()
    try:
        for each in made:
            for number in range(1000):
                each.time(number, number / 3, number / 7)
        taken, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert taken < 50_000
