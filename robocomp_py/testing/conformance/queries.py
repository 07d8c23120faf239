"""Queries: every call ends once, with its own reply, and no client waits for another's flood."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest

from ...errors import AlreadyServed, Timeout, Unreachable
from ...transports.base import Caller, Reply, Status, SupportsQuestion, Transport
from ...wire.codec import Payload
from ..parts import (
    A_MOMENT,
    Inbox,
    TransportSuite,
    answering,
    answering_all_but,
    asker,
    blob,
    query,
    subscribe,
    topic,
    unblob,
)
from ..patience import SOON, wait_until


class QueriesConformance(TransportSuite):
    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_question_gets_its_answer(self, here: Transport, there: Transport, name: str, ask: str) -> None:
        here.server(query(name), answering(here, bytes.upper))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert asker(there, caller, ask)(b"abc") == b"ABC"

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_questions_and_answers_of_any_size(self, here: Transport, there: Transport, name: str, ask: str) -> None:
        here.server(query(name), answering(here, bytes.upper))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        for size in (0, 4_000, 10_000, 20_000, 65_535, 65_536):
            assert asker(there, caller, ask)(b"a" * size) == b"A" * size

    def test_an_answer_may_come_later(self, here: Transport, there: Transport, name: str) -> None:
        later: queue.Queue[Future[Reply]] = queue.Queue()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            reply: Future[Reply] = Future()
            later.put(reply)
            return reply

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        asked = caller.call(blob(there, b""), SOON)
        later.get(timeout=SOON).set_result(Reply(Status.OK, blob(here, b"later")))
        assert unblob(there, asked.result(SOON).payload) == b"later"

    def test_answers_out_of_order_find_their_callers(
        self, here: Transport, there: Transport, name: str, pool: ThreadPoolExecutor
    ) -> None:
        waiting: list[tuple[Payload, Future[Reply]]] = []
        all_in = threading.Event()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            waiting.append((payload, Future()))
            if len(waiting) == 64:
                all_in.set()
            return waiting[-1][1]

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        futures = [caller.call(blob(there, str(number).encode()), SOON) for number in range(64)]
        assert all_in.wait(SOON)
        for payload, reply in reversed(waiting):
            reply.set_result(Reply(Status.OK, blob(here, unblob(here, payload))))
        assert [unblob(there, f.result(SOON).payload) for f in futures] == [str(n).encode() for n in range(64)]

    @pytest.mark.parametrize("ask", ["ask", "call"])
    @pytest.mark.parametrize(
        "status", [Status.OK, Status.THROWN, Status.FAILED, Status.EXPIRED, Status.BUSY, Status.REFUSED]
    )
    def test_every_status_arrives(self, here: Transport, there: Transport, name: str, status: Status, ask: str) -> None:
        here.server(query(name), lambda payload, expires: Reply(status, blob(here, b"why")))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        payload = blob(there, b"")
        reply = caller.ask(payload, SOON) if ask == "ask" else caller.call(payload, SOON).result(SOON)
        assert (reply.status, unblob(there, reply.payload)) == (status, b"why")

    def test_a_service_that_raises_fails_its_call(
        self, here: Transport, there: Transport, name: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        def service(payload: Payload, expires: float) -> Reply:
            raise ValueError("broken service")

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert caller.ask(blob(there, b""), SOON).status is Status.FAILED
        assert "broken service" in caplog.text

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_a_call_without_a_server_is_unreachable(self, here: Transport, name: str, ask: str) -> None:
        with pytest.raises(Unreachable):
            asker(here, here.caller(query(name)), ask)(b"")

    @pytest.mark.parametrize("ask", ["ask", "call"])
    def test_the_deadline_holds_and_a_late_answer_reaches_no_other_call(
        self, here: Transport, there: Transport, name: str, ask: str, pool: ThreadPoolExecutor
    ) -> None:
        release = threading.Event()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            data = unblob(here, payload)
            return pool.submit(lambda: (data == b"slow" and release.wait(SOON), Reply(Status.OK, blob(here, data)))[1])

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        begun = time.monotonic()
        with pytest.raises(Timeout):
            asker(there, caller, ask, A_MOMENT)(b"slow")
        assert time.monotonic() - begun >= A_MOMENT * 0.9
        release.set()
        assert [asker(there, caller, ask)(str(n).encode()) for n in range(3)] == [b"0", b"1", b"2"]

    def test_what_is_asked_again_is_executed_once_and_answered_again(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        executed: list[bytes] = []

        def service(payload: Payload, expires: float) -> Reply:
            executed.append(unblob(here, payload))
            return Reply(Status.OK, blob(here, b"%d" % len(executed)))

        channel = replace(query(name), idempotent=True)
        here.server(channel, service)
        caller: Any = there.caller(channel)
        assert caller.wait_peer(SOON)
        if not isinstance(numbering := caller, SupportsQuestion):
            return  # an optional part of the contract
        question = numbering.question(blob(there, b"first"))
        for _ in range(3):
            assert unblob(there, question.ask(SOON).payload) == b"1"
        question.close()
        question = numbering.question(blob(there, b"second"))
        for _ in range(3):
            assert unblob(there, question.call(SOON).result(SOON).payload) == b"2"
        question.close()
        assert unblob(there, caller.ask(blob(there, b"third"), SOON).payload) == b"3"
        assert executed == [b"first", b"second", b"third"]

    def test_the_answer_to_a_retry_goes_to_the_last_attempt(self, here: Transport, there: Transport, name: str) -> None:
        answers: queue.Queue[Future[Reply]] = queue.Queue()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            answer: Future[Reply] = Future()
            answers.put(answer)
            return answer

        channel = replace(query(name), idempotent=True)
        here.server(channel, service)
        caller: Any = there.caller(channel)
        assert caller.wait_peer(SOON)
        if not isinstance(numbering := caller, SupportsQuestion):
            return  # an optional part of the contract
        question = numbering.question(blob(there, b"long"))
        question.call(SOON).cancel()
        wait_until(lambda: answers.qsize() == 1)
        last = question.call(SOON)
        assert unblob(there, _asked_meanwhile(there, caller, answers, here).payload) == b"meanwhile"
        answers.get().set_result(Reply(Status.OK, blob(here, b"done")))
        assert unblob(there, last.result(SOON).payload) == b"done"
        assert answers.empty()
        question.close()

    def test_giving_up_leaves_nothing_behind(self, here: Transport, there: Transport, name: str) -> None:
        here.server(query(name), answering_all_but(here, b"stuck"))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        stuck = caller.call(blob(there, b"stuck"), SOON)
        assert stuck.cancel()
        assert asker(there, caller, "call")(b"next") == b"next"

    def test_a_service_may_ask_another(self, here: Transport, there: Transport, name: str) -> None:
        there.server(query(name + "inner"), answering(there, lambda data: data + b"!"))
        onward = here.caller(query(name + "inner"))
        assert onward.wait_peer(SOON)
        here.server(query(name), lambda payload, expires: onward.ask(blob(here, unblob(here, payload)), SOON))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert asker(there, caller, "ask")(b"hop") == b"hop!"

    def test_a_service_may_be_called_back(self, here: Transport, there: Transport, name: str) -> None:
        here.server(query(name + "back"), answering(here, lambda data: data + b"back"))
        back = there.caller(query(name + "back"))
        assert back.wait_peer(SOON)
        there.server(query(name + "on"), lambda payload, expires: back.ask(blob(there, unblob(there, payload)), SOON))
        on = here.caller(query(name + "on"))
        assert on.wait_peer(SOON)
        here.server(query(name), lambda payload, expires: on.ask(blob(here, unblob(here, payload)), SOON))
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        assert asker(there, caller, "ask")(b"there and ") == b"there and back"

    def test_a_callback_may_ask_again(self, here: Transport, there: Transport, name: str) -> None:
        later: queue.Queue[Future[Reply]] = queue.Queue()

        def service(payload: Payload, expires: float) -> Reply | Future[Reply]:
            data = unblob(here, payload)
            if data != b"first":
                return Reply(Status.OK, blob(here, data.upper()))
            reply: Future[Reply] = Future()
            later.put(reply)
            return reply

        here.server(query(name), service)
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        answers = Inbox()

        def again(done: Future[Reply]) -> None:
            answers.put(unblob(there, caller.ask(blob(there, b"again"), SOON).payload))

        for _ in range(20):
            caller.call(blob(there, b"first"), SOON).add_done_callback(again)
            later.get(timeout=SOON).set_result(Reply(Status.OK, blob(here, b"FIRST")))
        assert [answers.get(timeout=SOON) for _ in range(20)] == [b"AGAIN"] * 20
        assert asker(there, caller, "call")(b"afterwards") == b"AFTERWARDS"

    def test_a_slow_callback_delays_nothing_else(self, here: Transport, there: Transport, name: str) -> None:
        later: queue.Queue[Future[Reply]] = queue.Queue()
        called_back, release = threading.Event(), threading.Event()

        def service(payload: Payload, expires: float) -> Future[Reply]:
            reply: Future[Reply] = Future()
            later.put(reply)
            return reply

        def slow(done: Future[Reply]) -> None:
            called_back.set()
            release.wait(SOON * 3)

        here.server(query(name), service)
        here.server(query(name + "x"), answering(here, bytes.upper))
        caller, other = there.caller(query(name)), there.caller(query(name + "x"))
        inbox, outlet = subscribe(there, topic(name + "news")), here.outlet(topic(name + "news"))
        for link in (caller, other, outlet):
            assert link.wait_peer(SOON)
        caller.call(blob(there, b""), SOON * 3).add_done_callback(slow)
        later.get(timeout=SOON).set_result(Reply(Status.OK, blob(here, b"")))
        assert called_back.wait(SOON)
        try:
            outlet.send(blob(here, b"news"))
            assert inbox.get(timeout=SOON) == b"news"
            assert asker(there, other, "call")(b"x") == b"X"
        finally:
            release.set()

    def test_a_second_server_is_refused(self, here: Transport, there: Transport, name: str) -> None:
        first = here.server(query(name), answering(here, bytes.upper))
        with pytest.raises(AlreadyServed):
            there.server(query(name), answering(there, bytes.lower))
        first.close()
        there.server(query(name), answering(there, bytes.lower))

    def test_a_second_server_is_refused_also_where_one_claim_stands_for_several(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        claimed, unclaimed = query(name), replace(query(name), exclusive=False)
        for channel, again in ((claimed, unclaimed), (unclaimed, claimed), (unclaimed, unclaimed)):
            first = here.server(channel, answering(here, bytes.upper))
            with pytest.raises(AlreadyServed):
                there.server(again, answering(there, bytes.lower))
            first.close()
        there.server(unclaimed, answering(there, bytes.lower))

    def test_clients_get_equal_shares_of_a_server(self, here: Transport, name: str, pool: ThreadPoolExecutor) -> None:
        def service(payload: Payload, expires: float) -> Reply:
            time.sleep(0.0001)  # so that the server decides about turns, and not the interpreter
            return Reply(Status.OK, payload)

        here.server(query(name), service)
        done, start, stop = [0] * 16, threading.Barrier(16), threading.Event()

        def client(number: int) -> None:
            with contextlib.closing(self.open_transport()) as transport:
                caller = transport.caller(query(name))
                assert caller.wait_peer(SOON)
                ask = asker(transport, caller, "ask")
                ask(b"hello")
                start.wait(SOON * 3)
                while not stop.is_set():
                    ask(b"again")
                    done[number] += 1

        clients = [pool.submit(client, number) for number in range(16)]
        wait_until(lambda: min(done) >= 100 or any(each.done() for each in clients), SOON * 3)
        shares = sorted(done)
        stop.set()
        for each in clients:
            each.result(SOON * 6)  # they all close their transports at once
        assert shares[0] >= shares[-1] / 2, shares

    def test_a_flood_of_one_client_does_not_hold_up_calls_of_another(
        self, here: Transport, there: Transport, name: str
    ) -> None:
        handled, stop, room = [0], threading.Event(), threading.Semaphore(200)

        def service(payload: Payload, expires: float) -> Reply:
            time.sleep(0.0005)
            handled[0] += 1
            return Reply(Status.OK, payload)

        here.server(query(name), service)
        flooding, other = there.caller(query(name)), self.open_transport()
        caller = other.caller(query(name))
        assert flooding.wait_peer(SOON)
        assert caller.wait_peer(SOON)

        def flood() -> None:
            while not stop.is_set():
                if room.acquire(timeout=A_MOMENT):
                    flooding.call(blob(there, b"flood"), SOON * 3).add_done_callback(lambda _: room.release())

        flooder = threading.Thread(target=flood)
        flooder.start()
        held_up = []
        try:
            wait_until(lambda: handled[0] > 200)
            for _ in range(20):
                before = handled[0]
                assert asker(other, caller, "ask")(b"call") == b"call"
                held_up.append(handled[0] - before)
        finally:
            stop.set()
            flooder.join()
            other.close()
        assert sorted(held_up)[10] < 50, held_up


def _asked_meanwhile(
    transport: Transport, caller: Caller, answers: queue.Queue[Future[Reply]], serving: Transport
) -> Reply:
    """A call after others, answered at once: everything sent before it has arrived."""
    known = answers.qsize()
    asked = caller.call(blob(transport, b"meanwhile"), SOON)
    wait_until(lambda: answers.qsize() > known)
    answers.queue.pop().set_result(Reply(Status.OK, blob(serving, b"meanwhile")))
    return asked.result(SOON)
