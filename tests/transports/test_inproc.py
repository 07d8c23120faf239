"""The in-process transport keeps the contract."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace

import pytest

from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.errors import ConfigurationError, Timeout, Unreachable
from robocomp_py.testing.conformance import Inbox, TransportConformance, blob, drain, query, topic, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports import inproc
from robocomp_py.transports.base import Caller, Reply, Service, Status, Transport, TransportConfig, TypeRef
from robocomp_py.transports.inproc import InprocTransport


class TestInproc(TransportConformance):
    def open_transport(self) -> Transport:
        return InprocTransport(TransportConfig())


@pytest.fixture
def transport() -> Iterator[InprocTransport]:
    opened = InprocTransport(TransportConfig({"bus": "alone"}))
    yield opened
    opened.close()


def latched(name: str, depth: int) -> QoS:
    return QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=depth)


def test_a_peer_that_comes_just_after_looking_is_not_waited_for_in_vain(transport: InprocTransport) -> None:
    outlet = transport.outlet(topic("a/b/c"))
    look, looks = outlet.visible, []

    def look_too_early() -> bool:
        found = look()
        looks.append(found)
        if len(looks) == 1:
            transport.inlet(topic("a/b/c"), lambda _: None)
        assert len(looks) < 3
        return found

    outlet.visible = look_too_early  # type: ignore[method-assign, assignment]
    assert outlet.wait_peer(SOON)
    assert len(looks) == 2  # the second look was not the one after waiting for nothing


def test_a_late_subscriber_gets_as_much_of_what_is_latched_as_it_has_room_for(transport: InprocTransport) -> None:
    outlet, inbox = transport.outlet(topic("a/b/c", latched("x", 10))), Inbox()
    for number in range(10):
        outlet.send(blob(transport, str(number).encode()))
    transport.inlet(topic("a/b/c", latched("x", 2)), lambda payload: inbox.put(unblob(transport, payload)))
    outlet.send(blob(transport, b"new"), SOON)
    wait_until(lambda: inbox.qsize() >= 3)
    assert drain(inbox) == [b"8", b"9", b"new"]


def test_a_subscriber_that_joins_while_a_message_is_sent_gets_it_once(transport: InprocTransport) -> None:
    outlet = transport.outlet(topic("a/b/c", latched("x", 1)))
    for number in range(50):
        inbox = Inbox()
        sending = threading.Thread(target=outlet.send, args=(blob(transport, str(number).encode()),))
        sending.start()
        link = transport.inlet(topic("a/b/c", latched("x", 1)), lambda p, i=inbox: i.put(unblob(transport, p)))  # type: ignore[misc]
        sending.join()
        end = f"end of {number}".encode()  # if it joins before, that of the previous message comes, too
        outlet.send(blob(transport, end))
        got = [inbox.get(timeout=SOON)]
        while got[-1] != end:
            got.append(inbox.get(timeout=SOON))
        assert got.count(str(number).encode()) == 1
        link.close()


def test_publishing_is_fine_when_only_a_stranger_listens(transport: InprocTransport) -> None:
    outlet = transport.outlet(topic("a/b/c"))
    link = transport.inlet(replace(topic("a/b/c"), type=TypeRef("Other", 99)), lambda _: None)
    outlet.send(blob(transport, b"x"))
    assert (outlet.stats.mismatched, link.stats.mismatched) == (1, 1)


def test_a_subscriber_may_come_when_only_a_stranger_has_latched(transport: InprocTransport) -> None:
    transport.outlet(topic("a/b/c", latched("x", 1)))
    transport.inlet(replace(topic("a/b/c", latched("x", 1)), type=TypeRef("Other", 99)), lambda _: None)


def test_links_that_were_closed_are_forgotten(transport: InprocTransport) -> None:
    for number in range(20):
        transport.outlet(topic(f"a/b/c{number}")).close()
        transport.caller(query(f"a/b/d{number}")).close()
    assert transport._links == []


def test_a_flood_makes_one_job_for_its_lane(transport: InprocTransport) -> None:
    entered, release = threading.Event(), threading.Event()
    transport.inlet(topic("a/b/c", QoS(depth=4)), lambda _: (entered.set(), release.wait(SOON * 3)))
    outlet = transport.outlet(topic("a/b/c", QoS(depth=4)))
    outlet.send(blob(transport, b"x"))
    assert entered.wait(SOON)
    for _ in range(1000):
        outlet.send(blob(transport, b"x"))
    assert transport._work.qsize() <= 1
    release.set()


def test_too_many_calls_of_a_slow_service_are_turned_away_and_neither_queue_nor_threads_grow(
    transport: InprocTransport,
) -> None:
    release, inside = threading.Event(), threading.Semaphore(0)

    def slow(payload: object, expires: float) -> Reply:
        inside.release()
        release.wait(SOON * 3)
        return Reply(Status.OK)

    link = transport.server(query("a/b/ask"), slow)
    caller, threads = transport.caller(query("a/b/ask")), threading.active_count()
    calls = [caller.call([], SOON * 3) for _ in range(inproc.AT_ONCE)]
    for _ in calls:
        assert inside.acquire(timeout=SOON)  # all that run at once do
    calls += [caller.call([], SOON * 3) for _ in range(5000)]
    busy = [each for each in calls if each.done() and each.result().status is Status.BUSY]
    assert len(busy) == link.stats.dropped == 5000 - inproc.QUERIES_WAITING
    assert threading.active_count() - threads <= inproc.AT_ONCE + 1
    wait_until(lambda: transport._work.qsize() <= 2)
    release.set()
    served = [each.result(SOON).status for each in calls if each not in busy]
    assert served == [Status.OK] * (inproc.AT_ONCE + inproc.QUERIES_WAITING)


# Services that the asking thread runs.


def trusted(transport: InprocTransport, service: Service) -> Caller:
    """A caller of a service that was prompt so often that the calling thread runs it."""
    prompt = [Reply(Status.OK)] * inproc.TRUSTED
    transport.server(query("a/b/ask"), lambda payload, expires: prompt.pop() if prompt else service(payload, expires))
    caller = transport.caller(query("a/b/ask"))
    for _ in range(inproc.TRUSTED):
        caller.ask([], SOON)
    return caller


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Services count as prompt however loaded the machine is."""
    monkeypatch.setattr(inproc, "PROMPT", SOON)


def whoever_runs_it(payload: object, expires: float) -> Reply:
    return Reply(Status.OK, threading.get_ident())


@pytest.mark.usefixtures("patient")
def test_a_prompt_service_is_run_by_the_thread_that_asks(transport: InprocTransport) -> None:
    transport.server(query("a/b/ask"), whoever_runs_it)
    caller = transport.caller(query("a/b/ask"))
    runners = [caller.ask([], SOON).payload for _ in range(inproc.TRUSTED + 1)]
    assert threading.get_ident() not in runners[:-1]
    assert runners[-1] == threading.get_ident()


@pytest.mark.usefixtures("patient")
def test_with_hand_over_it_is_always_another_thread() -> None:
    transport = InprocTransport(TransportConfig({"bus": "handing over", "hand_over": True}))
    try:
        assert trusted(transport, whoever_runs_it).ask([], SOON).payload != threading.get_ident()
    finally:
        transport.close()


@pytest.mark.usefixtures("patient")
def test_a_caller_that_hands_over_does_not_run_what_others_serve(transport: InprocTransport) -> None:
    trusted(transport, whoever_runs_it)
    handing_over = InprocTransport(TransportConfig({"bus": "alone", "hand_over": True}))
    try:
        asked = handing_over.caller(query("a/b/ask"))
        assert asked.ask([], SOON).payload != threading.get_ident()
    finally:
        handing_over.close()


def test_a_service_that_was_slow_is_run_by_another_thread_until_it_is_prompt_again(
    transport: InprocTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inproc, "PROMPT", SOON)
    caller = trusted(transport, whoever_runs_it)
    monkeypatch.setattr(inproc, "PROMPT", 0.0)  # what it does now counts as slow
    assert caller.ask([], SOON).payload == threading.get_ident()
    assert caller.ask([], SOON).payload != threading.get_ident()


@pytest.mark.usefixtures("patient")
def test_a_trusted_service_that_takes_too_long_once_ends_its_call_late_but_by_timeout(
    transport: InprocTransport,
) -> None:
    def slow(payload: object, expires: float) -> Reply:
        wait_until(lambda: time.monotonic() > expires)
        return Reply(Status.OK)

    caller = trusted(transport, slow)
    with pytest.raises(Timeout):
        caller.ask([], 0.01)


@pytest.mark.usefixtures("patient")
def test_a_trusted_service_may_answer_later(transport: InprocTransport) -> None:
    later: list[Future[Reply]] = []

    def put_off(payload: object, expires: float) -> Future[Reply]:
        answer: Future[Reply] = Future()
        later.append(answer)
        return answer

    caller = trusted(transport, put_off)
    helper = threading.Thread(target=lambda: (wait_until(lambda: later), later[0].set_result(Reply(Status.OK, "late"))))
    helper.start()
    assert caller.ask([], SOON).payload == "late"
    helper.join()
    with pytest.raises(Timeout, match=r"no answer in 0\.01 s"):
        caller.ask([], 0.01)


@pytest.mark.usefixtures("patient")
def test_a_trusted_service_that_closes_without_a_reply_is_unreachable(transport: InprocTransport) -> None:
    server = InprocTransport(TransportConfig({"bus": "alone"}))

    def leave(payload: object, expires: float) -> Future[Reply]:
        threading.Thread(target=server.close).start()
        return Future()

    with pytest.raises(Unreachable):
        trusted_elsewhere(server, transport, leave).ask([], SOON)


def trusted_elsewhere(server: InprocTransport, client: InprocTransport, service: Service) -> Caller:
    trusted(server, service)
    return client.caller(query("a/b/ask"))


@pytest.mark.usefixtures("patient")
def test_a_trusted_service_that_raises_fails_its_call_and_ctrl_c_reaches_the_caller(transport: InprocTransport) -> None:
    errors: list[BaseException] = [KeyboardInterrupt(), SystemExit(), ValueError("no")]

    def fail(payload: object, expires: float) -> Reply:
        raise errors.pop()

    caller = trusted(transport, fail)
    assert caller.ask([], SOON).status is Status.FAILED
    assert caller.ask([], SOON).status is Status.FAILED
    with pytest.raises(KeyboardInterrupt):
        caller.ask([], SOON)


def test_an_option_that_is_neither_true_nor_false_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="`hand_over` is true or false, not 'maybe'"):
        InprocTransport(TransportConfig({"hand_over": "maybe"}))
