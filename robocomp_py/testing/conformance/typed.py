"""What user code sees: every type, every outcome of a call, and one handler at a time."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from ...contract.component import Port
from ...contract.interface import Operation, Pattern, Verb
from ...errors import Busy, Closed, EncodeError, RemoteFailure, Timeout, Unreachable
from ...runtime import ports
from ...runtime.calls import type_of
from ...runtime.monitor import MAX_SUSPENDED, Monitor
from ...runtime.route import Route, Router
from ...transports.base import Channel, Link, Transport
from .. import everything as e
from ..parts import A_MOMENT, TransportSuite, blob
from ..patience import SOON, wait_until
from .values import assert_same, everything_odd


class TypedConformance(TransportSuite):
    @pytest.fixture
    def proxy(self, here: Transport, there: Transport, name: str) -> Iterator[_Proxy]:
        with _Served(here, name, _Handlers()), _Using(there, name) as proxy:
            yield proxy

    def test_every_type_there_and_back(self, proxy: _Proxy) -> None:
        for value in (e.Nested(), everything_odd()):
            assert_same(proxy.ask(e.echo_nested, value), value)

    def test_large_and_empty_arrays_there_and_back(self, proxy: _Proxy) -> None:
        image = np.random.default_rng(1).integers(0, 256, 6_000_000, np.uint8)
        large = e.Arrays(
            image,
            np.array([-32768, 32767], np.int16),
            np.array([-(2**63), 2**63 - 1], np.int64),
            np.array([math.nan, math.inf, -math.inf, 1e-45], np.float32),
            np.linspace(0, 1, 100_000),
            np.array([True, False]),
        )
        for value in (e.Arrays(), large):
            back = proxy.ask(e.echo_arrays, value)
            assert_same(back, value)
            assert not back.octets.flags.writeable

    def test_lists_bytes_and_buffers_are_taken_for_arrays(self, proxy: _Proxy) -> None:
        # The fields are annotated as what they are once received.
        given = e.Arrays(b"abc", [1, 2], range(3), memoryview(np.ones(2, np.float32)), (0.5,), [True])  # type: ignore[arg-type]
        back = proxy.ask(e.echo_arrays, given)
        assert back.octets.tobytes() == b"abc"
        assert (back.small.tolist(), back.ints.tolist(), back.floats.tolist()) == ([1, 2], [0, 1, 2], [1.0, 1.0])

    def test_a_receiver_cannot_alter_what_was_sent(self, here: Transport, there: Transport, name: str) -> None:
        kept: list[e.Nested] = []

        class Vandal(_Handlers):
            def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
                kept.append(value)
                value.names.append("vandalised")
                value.scalars.text = "vandalised"
                return value

        sent = everything_odd()
        names, text = list(sent.names), sent.scalars.text
        with _Served(here, name, Vandal()), _Using(there, name) as proxy:
            got = proxy.ask(e.echo_nested, sent)
        assert (sent.names, sent.scalars.text) == (names, text)
        got.names.append("mine")
        assert kept[0].names == [*names, "vandalised"]

    def test_results_then_outputs_come_as_a_tuple(self, proxy: _Proxy) -> None:
        assert proxy.ask(e.divide, 17, 5) == (3, 2)
        assert proxy.ask(e.divide, 2**63 - 1, 1) == (2**63 - 1, 0)

    def test_declared_exceptions_arrive_as_themselves(self, proxy: _Proxy) -> None:
        with pytest.raises(e.Failed) as caught:
            proxy.ask(e.divide, 1, 0)
        assert (type(caught.value), caught.value.what, caught.value.code) == (e.Failed, "division by zero", 7)

    def test_exceptions_derived_from_declared_ones_do_too(self, proxy: _Proxy) -> None:
        with pytest.raises(e.Failed) as caught:
            proxy.ask(e.divide, 1, -1)
        assert isinstance(caught.value, e.FailedBadly)
        assert caught.value.where == e.Point(1.0, 2.0)

    def test_an_undeclared_exception_is_told_with_its_traceback(
        self, proxy: _Proxy, caplog: pytest.LogCaptureFixture
    ) -> None:
        with pytest.raises(RemoteFailure, match="ZeroDivisionError: on purpose") as caught:
            proxy.ask(e.work, "raise")
        assert "Everything_work" in caught.value.trace
        assert "ZeroDivisionError" in caplog.text

    def test_a_wrong_return_value_fails_the_call_and_says_why(
        self, proxy: _Proxy, caplog: pytest.LogCaptureFixture
    ) -> None:
        with pytest.raises(RemoteFailure, match="ret must be a str"):
            proxy.ask(e.work, "return nonsense")

    def test_a_wrong_argument_is_not_sent(self, proxy: _Proxy) -> None:
        with pytest.raises(EncodeError, match="divisor must be an int"):
            proxy.ask(e.divide, 1, "two")
        with pytest.raises(EncodeError, match=r"dividend must be an int from -9223372036854775808"):
            proxy.ask(e.divide, 2**63, 1)

    def test_asynchronous_calls_end_like_synchronous_ones(self, proxy: _Proxy) -> None:
        futures = [proxy.ask_async(e.divide, number, 7) for number in range(50)]
        assert [f.result(SOON) for f in futures] == [divmod(number, 7) for number in range(50)]
        with pytest.raises(e.Failed):
            proxy.ask_async(e.divide, 1, 0).result(SOON)

    def test_they_can_be_awaited(self, proxy: _Proxy) -> None:
        async def both() -> list[Any]:
            calls = [asyncio.wrap_future(proxy.ask_async(e.divide, number, 3)) for number in (10, 11)]
            return list(await asyncio.gather(*calls))

        assert asyncio.run(both()) == [(3, 1), (3, 2)]
        with proxy.monitor.held():
            assert asyncio.run(both()) == [(3, 1), (3, 2)]

    def test_calls_that_are_awaited_end_as_closed_when_their_component_stops(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        async def awaited(proxy: _Proxy) -> str:
            return str(await asyncio.wrap_future(proxy.ask_async(e.work, "stay", deadline=10 * SOON)))

        class Slow(_Handlers):
            def __init__(self) -> None:
                super().__init__()
                self.begun, self.released = threading.Event(), threading.Event()

            def Everything_work(self, task: str) -> Any:
                self.begun.set()
                self.released.wait(10 * SOON)
                return task

        slow = Slow()
        with _Served(here, name, slow), _Using(there, name) as proxy:
            try:
                answer = pool.submit(asyncio.run, awaited(proxy))
                assert slow.begun.wait(SOON)
                proxy.monitor.turn_away()
                with pytest.raises(Closed, match="the component is stopping"):
                    answer.result(SOON)
            finally:
                slow.released.set()

    def test_callbacks_run_like_handlers(self, proxy: _Proxy) -> None:
        inside: list[bool] = []
        done = threading.Event()
        future = proxy.ask_async(e.divide, 1, 1)

        def called_back(_: object) -> None:
            inside.append(proxy.monitor.is_inside)
            done.set()

        future.add_done_callback(called_back)
        assert done.wait(SOON)
        assert inside == [True]

    def test_idempotent_calls_outlast_a_restart_of_their_server_and_others_do_not(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        with contextlib.ExitStack() as everything:
            with _Served(here, name, _Handlers()):
                proxy = everything.enter_context(_Using(there, name))
                assert proxy.ask(e.divide, 7, 2) == (3, 1)
            with pytest.raises(Unreachable):
                proxy.ask(e.work, "once", deadline=SOON)
            later = [pool.submit(proxy.ask, e.divide, 9, 2, deadline=SOON), proxy.ask_async(e.divide, 9, 2)]
            with _Served(here, name, _Handlers()):
                assert [each.result(SOON) for each in later] == [(4, 1)] * 2

    def test_a_handler_that_takes_too_long_times_out(self, proxy: _Proxy) -> None:
        with pytest.raises(Timeout):
            proxy.ask(e.work, "wait", deadline=A_MOMENT)
        assert proxy.ask(e.work, "quick") == "quick"

    def test_what_expired_while_it_waited_is_not_executed(self, here: Transport, there: Transport, name: str) -> None:
        handlers = _Handlers()
        with _Served(here, name, handlers) as served, _Using(there, name) as proxy:
            served.monitor.enter()
            for task in ("never", "somewhat later"):  # when the second call ends, the first has expired there
                with pytest.raises(Timeout):
                    proxy.ask(e.work, task, deadline=A_MOMENT)
            served.monitor.leave()
            assert proxy.ask(e.work, "later") == "later"
        assert "never" not in handlers.done

    def test_commands_and_publications_reach_their_handlers(self, here: Transport, there: Transport, name: str) -> None:
        handlers = _Handlers()
        with _Served(here, name, handlers), _Using(there, name) as proxy:
            proxy.send(e.poke, 3)
            wait_until(lambda: handlers.done == [3])

    def test_malformed_messages_are_dropped_counted_and_logged_once(
        self, here: Transport, there: Transport, name: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        handlers = _Handlers()
        route = _router(there, name)(Port(Verb.REQUIRES, e.EVERYTHING), e.poke)
        channel = Channel(route.channel, Pattern.COMMAND, type_of(e.poke, Pattern.COMMAND))
        with _Served(here, name, handlers) as served:
            outlet = there.outlet(channel)
            assert outlet.wait_peer(SOON)
            caplog.clear()
            for _ in range(20):
                outlet.send(blob(there, b"these are not the bytes you are looking for"))
            outlet.send(there.codec.encoder(e.poke.request)((5,)))
            wait_until(lambda: handlers.done == [5])
            assert served.stats(e.poke).malformed == 20
        assert sum("malformed" in record.message for record in caplog.records) == 1

    def test_eight_clients_get_their_own_answers(self, here: Transport, name: str, pool: ThreadPoolExecutor) -> None:
        def client(number: int) -> list[str]:
            transport = self.open_transport()
            try:
                with _Using(transport, name) as proxy:
                    return [proxy.ask(e.work, f"{number}.{n}") for n in range(40)]
            finally:
                transport.close()

        with _Served(here, name, _Handlers()):
            answers = list(pool.map(client, range(8)))
        assert answers == [[f"{number}.{n}" for n in range(40)] for number in range(8)]

    def test_a_component_that_stops_is_unreachable(self, here: Transport, there: Transport, name: str) -> None:
        served = _Served(here, name, _Handlers())
        with served, _Using(there, name) as proxy:
            assert proxy.ask(e.work, "first") == "first"
            served.monitor.turn_away()
            for how in (proxy.ask, lambda *call: proxy.ask_async(*call).result(SOON)):
                with pytest.raises(Unreachable, match=r"its server left$"):
                    how(e.work, "stopping")
        with pytest.raises((Unreachable, Closed)):
            proxy.ask(e.work, "gone")

    def test_threads_may_share_a_proxy(self, proxy: _Proxy, pool: ThreadPoolExecutor) -> None:
        assert list(pool.map(lambda n: proxy.ask(e.work, str(n)), range(200))) == [str(n) for n in range(200)]

    def test_handlers_of_a_worker_never_overlap(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        inside, most = [0], [0]

        class Nosy(_Handlers):
            def Everything_work(self, task: str) -> str:
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                time.sleep(0.001)
                inside[0] -= 1
                return task

        with _Served(here, name, Nosy()), _Using(there, name) as proxy:
            list(pool.map(lambda n: proxy.ask(e.work, str(n), deadline=SOON), range(60)))
        assert most == [1]

    def test_waiting_handlers_let_others_in_so_components_may_call_in_circles(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        ours, theirs = name + "ours", name + "theirs"
        with (
            _Served(here, ours, _Onward()) as a,
            _Served(there, theirs, _Onward()) as b,
            _Using(here, theirs, a.monitor) as a_to_b,
            _Using(there, ours, b.monitor) as b_to_a,
            _Using(there, ours) as start,
        ):
            a.handlers.onward, b.handlers.onward = a_to_b, b_to_a
            assert start.ask(e.work, "go 5", deadline=SOON) == "arrived"

    def test_too_many_suspended_handlers_make_it_busy(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        waits, release = threading.Semaphore(0), threading.Event()
        served = _Served(here, name, _Handlers())

        def work(task: str) -> str:
            if task == "quick":
                return task
            with served.monitor.suspended():
                waits.release()
                release.wait(SOON)
            return task

        served.handlers.Everything_work = work
        with served, _Using(there, name) as proxy:
            futures = [proxy.ask_async(e.work, "wait", deadline=SOON * 3) for _ in range(MAX_SUSPENDED)]
            for _ in futures:
                assert waits.acquire(timeout=SOON)
            served.monitor.enter()
            with pytest.raises(Busy):
                proxy.ask(e.work, "one too many")
            served.monitor.leave()
            release.set()
            assert [f.result(SOON) for f in futures] == ["wait"] * MAX_SUSPENDED
            assert proxy.ask(e.work, "quick") == "quick"


class _Handlers:
    """Implements `Everything`."""

    def __init__(self) -> None:
        self.done: list[object] = []
        self.onward: Any = None

    def Everything_echo_nested(self, value: e.Nested) -> e.Nested:
        return value

    def Everything_echo_arrays(self, value: e.Arrays) -> e.Arrays:
        return value

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        if divisor == 0:
            raise e.Failed("division by zero", 7)
        if divisor == -1:
            raise e.FailedBadly("worse", 8, e.Point(1.0, 2.0))
        return divmod(dividend, divisor)

    def Everything_work(self, task: str) -> Any:
        self.done.append(task)
        if task == "raise":
            raise ZeroDivisionError("on purpose")
        if task == "wait":
            time.sleep(A_MOMENT * 2)
        return None if task == "return nonsense" else task

    def Everything_poke(self, number: int) -> None:
        self.done.append(number)


class _Onward(_Handlers):
    """Passes work on until its count is 0."""

    def Everything_work(self, task: str) -> Any:
        left = int(task.split()[1])
        return self.onward.ask(e.work, f"go {left - 1}", deadline=SOON) if left else "arrived"


class _Served:
    """Handlers behind a transport, under a monitor of their own."""

    def __init__(self, transport: Transport, name: str, handlers: Any) -> None:
        self.monitor = Monitor("served")
        self.monitor.open()
        self.handlers = handlers
        self._operations = [operation for operation, _ in e.EVERYTHING.under(Verb.IMPLEMENTS)]
        self._port = Port(Verb.IMPLEMENTS, e.EVERYTHING)
        self._route = _router(transport, name)
        self._links: list[Link] = []

    def stats(self, operation: Operation[Any]) -> Any:
        return self._links[self._operations.index(operation)].stats

    def __enter__(self) -> _Served:
        self._links = ports.bind_handlers(self._port, self.handlers, self._route, self.monitor)
        return self

    def __exit__(self, *exc: object) -> None:
        ports.close_all(self._links)
        self.monitor.close()


class _Proxy(ports.Proxy):
    """What a generated proxy does, for any operation."""

    monitor: Monitor

    def ask(self, operation: Operation[Any], *arguments: Any, deadline: float | None = None) -> Any:
        return self._ask(operation, arguments, deadline)

    def ask_async(self, operation: Operation[Any], *arguments: Any, deadline: float | None = None) -> Future[Any]:
        return self._ask_async(operation, arguments, deadline)

    def send(self, operation: Operation[None], *arguments: Any) -> None:
        self._send(operation, arguments, None)


class _Using:
    """A proxy of `Everything` over a transport, once its server is visible."""

    def __init__(self, transport: Transport, name: str, monitor: Monitor | None = None) -> None:
        self._monitor, self._own = monitor or Monitor("using"), monitor is None
        if self._own:
            self._monitor.open()
        port = Port(Verb.REQUIRES, e.EVERYTHING, proxy=_Proxy)
        self._proxy, self._links = ports.bind_proxy(port, _router(transport, name), self._monitor)

    def __enter__(self) -> _Proxy:
        for link in self._links:
            assert link.wait_peer(SOON)
        assert isinstance(self._proxy, _Proxy)
        self._proxy.monitor = self._monitor
        return self._proxy

    def __exit__(self, *exc: object) -> None:
        ports.close_all(self._links)
        if self._own:
            self._monitor.close()


def _router(transport: Transport, name: str) -> Router:
    instance = name.replace("/", "_")

    def route(port: Port, operation: Operation[Any]) -> Route:
        return Route(transport, "tested", f"{instance}/{port.interface.short}/{operation.name}", port.qos, SOON)

    return route
