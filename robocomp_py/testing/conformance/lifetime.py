"""Lifetime: transports close, restart, move, and are killed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest

from ...errors import Closed, Unreachable
from ...transports.base import Caller, Link, Transport
from ...wire.codec import Payload
from ..parts import (
    A_MOMENT,
    Inbox,
    TransportSuite,
    Victim,
    answering,
    answering_all_but,
    asker,
    blob,
    command,
    publish_once,
    put,
    query,
    subscribe,
    topic,
)
from ..patience import SOON, wait_until

_CLOSINGS = 8
"""Transports that a test closes while threads use them."""


class LifetimeConformance(TransportSuite):
    def test_close_releases_waiters(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        here.server(query(name), answering_all_but(here, b"stuck"))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        pending = caller.call(blob(there, b"stuck"), SOON * 3)
        asking = pool.submit(caller.ask, blob(there, b"stuck"), SOON * 3)
        wait_until(lambda: asking.running())
        caller.close()
        for waiting in (pending, asking):
            with pytest.raises(Closed):
                waiting.result(SOON)

    def test_closing_a_transport_ends_its_calls_as_closed(
        self, here: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        here.server(query(name), answering_all_but(here, b"stuck"))

        def ask_until_it_fails(transport: Transport, caller: Caller, answered: threading.Semaphore) -> None:
            while True:
                caller.ask(blob(transport, b"x"), SOON)
                answered.release()

        for _ in range(5):
            transport = self.open_transport()
            caller, answered = transport.caller(query(name)), threading.Semaphore(0)
            assert caller.wait_peer(SOON)
            asking: list[Future[Any]] = []
            asking += [pool.submit(ask_until_it_fails, transport, caller, answered) for _ in range(6)]
            asking += [pool.submit(asker(transport, caller, how, SOON * 3), b"stuck") for how in ("ask", "call")]
            for _ in range(20):
                assert answered.acquire(timeout=SOON)
            transport.close()
            assert [type(each.exception(SOON)) for each in asking] == [Closed] * len(asking)

    def test_a_transport_that_closes_ends_what_uses_it_as_closed(
        self, here: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        """Threads that open links or publish at that moment get Closed, whatever exception the middleware raises."""

        def repeat(use: Callable[[], object], begun: threading.Event) -> None:
            while True:
                use()
                begun.set()

        def open_and_close(open_it: Callable[[], Link]) -> None:
            open_it().close()

        def drop(payload: Payload) -> None: ...

        for _ in range(_CLOSINGS):
            transport = self.open_transport()
            outlet, payload = transport.outlet(topic(name)), blob(transport, b"x")
            inlet = here.inlet(topic(name), drop)
            assert outlet.wait_peer(SOON)
            openings: list[Callable[[], Link]] = [
                partial(transport.outlet, topic(name)),
                partial(transport.inlet, topic(name), drop),
                partial(transport.caller, query(name)),
            ]
            uses = [partial(outlet.send, payload), *(partial(open_and_close, each) for each in openings)]
            begun = [threading.Event() for _ in uses]
            using = [pool.submit(repeat, use, each) for use, each in zip(uses, begun, strict=True)]
            assert all(each.wait(SOON) for each in begun)
            transport.close()
            inlet.close()
            assert [repr(each.exception(SOON)) for each in using if type(each.exception()) is not Closed] == []

    def test_close_is_final_and_may_be_repeated(self, here: Transport, name: str) -> None:
        outlet, caller = here.outlet(topic(name)), here.caller(query(name))
        here.server(query(name), answering(here, bytes.upper))
        here.close()
        here.close()
        outlet.close()
        for use in (
            lambda: outlet.send(blob(here, b"")),
            lambda: caller.ask(blob(here, b""), SOON),
            lambda: caller.call(blob(here, b""), SOON),
            lambda: here.outlet(topic(name)),
            lambda: here.server(query(name), answering(here, bytes.upper)),
        ):
            with pytest.raises(Closed):
                use()

    def test_a_sink_may_close_its_own_link(self, here: Transport, there: Transport, name: str) -> None:
        closed = threading.Event()
        links: list[Link] = []

        def sink(payload: Payload) -> None:
            links[0].close()
            closed.set()

        links.append(there.inlet(topic(name), sink))
        outlet = here.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"x"))
        assert closed.wait(SOON)

    def test_no_thread_is_left_after_close(self, name: str) -> None:
        before = set(threading.enumerate())
        transport = self.open_transport()
        transport.inlet(topic(name), lambda _: time.sleep(A_MOMENT))
        transport.server(query(name), answering(transport, bytes.upper))
        outlet, caller = transport.outlet(topic(name)), transport.caller(query(name))
        assert outlet.wait_peer(SOON)
        assert caller.wait_peer(SOON)
        outlet.send(blob(transport, b"x"))
        assert asker(transport, caller, "ask")(b"x") == b"X"
        transport.close()
        assert set(threading.enumerate()) - before == set()

    def test_a_server_may_be_restarted_under_its_clients(self, there: Transport, name: str) -> None:
        caller = there.caller(query(name))
        for life in range(3):
            transport = self.open_transport()
            transport.server(query(name), answering(transport, partial(_signed, str(life))))
            assert caller.wait_peer(SOON)
            assert asker(there, caller, "ask")(b"life ") == f"life {life}".encode()
            assert asker(there, caller, "call")(b"life ") == f"life {life}".encode()
            transport.close()
            with pytest.raises(Unreachable):
                asker(there, caller, "ask")(b"")

    def test_a_publisher_and_its_subscribers_may_be_restarted(self, name: str) -> None:
        stays, inbox = self.open_transport(), Inbox()
        stays.inlet(topic(name), put(stays, inbox))
        for life in (b"first", b"second"):
            transport = self.open_transport()
            outlet = transport.outlet(topic(name))
            assert outlet.wait_peer(SOON)
            outlet.send(blob(transport, life))
            assert inbox.get(timeout=SOON) == life
            transport.close()
        stays.close()
        transport, other = self.open_transport(), self.open_transport()
        outlet = transport.outlet(topic(name))
        inbox = subscribe(other, topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(transport, b"third"))
        assert inbox.get(timeout=SOON) == b"third"
        transport.close()
        other.close()

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_server_may_move_to_another_transport(
        self, here: Transport, there: Transport, name: str, ask: str
    ) -> None:
        """Calls in between find no server, or the new one; never the old one, which no longer serves the channel."""
        asking = self.open_transport()
        caller = asking.caller(query(name))
        question = asker(asking, caller, ask)
        server = here.server(query(name), answering(here, partial(_signed, "one")))
        assert caller.wait_peer(SOON)
        assert question(b"by ") == b"by one"
        server.close()
        with pytest.raises(Unreachable):
            question(b"by ")
        assert not caller.wait_peer(0.0)
        there.server(query(name), answering(there, partial(_signed, "two")))
        assert caller.wait_peer(SOON)
        assert question(b"by ") == b"by two"
        asking.close()

    def test_a_receiver_of_commands_may_move_too(self, here: Transport, there: Transport, name: str) -> None:
        asking = self.open_transport()
        outlet, inbox = asking.outlet(command(name)), Inbox()
        inlet = here.inlet(command(name), lambda _: None)
        assert outlet.wait_peer(SOON)
        outlet.send(blob(asking, b"one"))
        inlet.close()
        with pytest.raises(Unreachable):
            outlet.send(blob(asking, b"nobody"))
        there.inlet(command(name), put(there, inbox))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(asking, b"two"))
        assert inbox.get(timeout=SOON) == b"two"
        asking.close()

    def test_a_killed_publisher_may_be_followed_by_another(self, here: Transport, there: Transport, name: str) -> None:
        inbox = subscribe(here, topic(name))
        victim = Victim(self, here, name, publish_once)
        assert inbox.get(timeout=SOON * 3) == b"last words"
        victim.kill()
        outlet = there.outlet(topic(name))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(there, b"new"))
        assert inbox.get(timeout=SOON) == b"new"

    def test_a_killed_server_is_not_waited_for_in_vain(self, there: Transport, name: str) -> None:
        victim = Victim(self, there, name)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON * 3)
        victim.kill()
        wait_until(lambda: not caller.wait_peer(0.0))

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_server_that_dies_in_a_call_makes_it_unreachable(
        self, there: Transport, name: str, ask: str, pool: ThreadPoolExecutor
    ) -> None:
        victim = Victim(self, there, name)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON * 3)  # a process has to start first
        asking = pool.submit(asker(there, caller, ask, SOON * 3), b"stuck")
        victim.wait_until_stuck()
        victim.kill()
        with pytest.raises(Unreachable):
            asking.result(SOON)


def _signed(name: str, data: bytes) -> bytes:
    return data + name.encode()
