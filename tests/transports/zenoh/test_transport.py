"""Zenoh keeps the contract; seen from outside: plain Zenoh programs, hostile ones, routers that die, files left."""

from __future__ import annotations

import contextlib
import itertools
import os
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.errors import Closed, ConfigurationError, Timeout, TransportError, Unreachable
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import (
    A_MOMENT,
    TransportConformance,
    answering,
    blob,
    command,
    query,
    subscribe,
    topic,
    unblob,
)
from robocomp_py.testing.parts import in_time
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import (
    Channel,
    Reply,
    Status,
    Transport,
    TransportConfig,
    TypeRef,
    hosting,
    wait_connected,
)
from robocomp_py.transports.exclusive import holder
from robocomp_py.transports.limits import MOST_AHEAD
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.zenoh.client import COMMANDS_AHEAD
from robocomp_py.transports.zenoh.messages import Message, put
from robocomp_py.transports.zenoh.session import open_client, open_router
from robocomp_py.transports.zenoh.topics import Subscriber
from robocomp_py.transports.zenoh.transport import ZenohTransport
from robocomp_py.transports.zenoh.watching import peer_prefixes
from robocomp_py.wire import header
from tests.freeports import free_port

DIVIDE = Channel("robot/calculator/Everything/divide", Pattern.QUERY, TypeRef("", e.divide.fingerprint, e.divide.text))
NEWS = Channel("robot/calculator/Everything/news", Pattern.PUBLISH, TypeRef("", e.news.fingerprint, e.news.text))
DIVIDE_KEY, NEWS_KEY = f"rc/0/{DIVIDE.name}", f"rc/0/{NEWS.name}"
BLOCK = zenoh.CongestionControl.BLOCK
RELIABLE = QoS(Reliability.RELIABLE, depth=4)
LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=3)


_programs: list[subprocess.Popen[str]] = []
"""Those that `run` has started, for this test."""


@pytest.fixture(autouse=True)
def nobody_else(own_runtime_folder: Path) -> Iterator[None]:
    """Each test has its own router, and no program outlives the test that started it."""
    yield
    while _programs:
        with _programs.pop() as program:
            program.kill()


class TestZenoh(TransportConformance):
    def open_transport(self) -> Transport:
        return ZenohTransport(TransportConfig(owner="test"))


class Late(ZenohTransport):
    """Is told late of subscribers."""

    def _on_token(self, sample: zenoh.Sample) -> None:
        if "/subscribes/" in str(sample.key_expr):
            threading.Event().wait(A_MOMENT)
        super()._on_token(sample)


@pytest.fixture
def transport() -> Iterator[ZenohTransport]:
    opened = ZenohTransport(TransportConfig(owner="calculator"))
    yield opened
    opened.close()


@pytest.fixture
def other() -> Iterator[ZenohTransport]:
    opened = ZenohTransport(TransportConfig(owner="other"))
    yield opened
    opened.close()


@pytest.fixture
def outsider(transport: ZenohTransport) -> Iterator[Any]:
    """A session of a program that knows nothing of us but the protocol."""
    opened = joined(f"unixsock-stream/{runtime_dir()}/zenoh/router.sock")
    yield opened
    opened.close()


def test_a_new_publisher_knows_an_earlier_subscriber_although_its_token_is_late(
    transport: ZenohTransport,
) -> None:
    with contextlib.closing(Late(TransportConfig(owner="late"))) as late:
        late.outlet(topic("one/Conformance/other"))  # of the same interface: so it has heard who was there until now
        transport.inlet(topic("one/Conformance/news"), lambda payload: None)
        outlet = late.outlet(topic("one/Conformance/news"))
        assert wait_connected(outlet, SOON)
        assert outlet.counterparts()


def joined(router: str, settings: Mapping[str, Any] | None = None) -> Any:
    """A session by a router that may be slow to answer: Zenoh gives up after a second."""
    opened: list[Any] = []

    def tried() -> bool:
        with contextlib.suppress(zenoh.ZError):
            opened.append(open_client(router, settings))
        return bool(opened)

    wait_until(tried)
    return opened[0]


def serve_division(transport: ZenohTransport, outsider: Any) -> Any:
    decode, encode = transport.codec.decoder(e.divide.request), transport.codec.encoder(e.divide.response)
    link = transport.server(DIVIDE, lambda payload, _: Reply(Status.OK, encode(divmod(*decode(payload)))))
    wait_until(lambda: list(outsider.liveliness().get(f"rc_lv/0/serves/**/{DIVIDE.name}")))
    return link


def division(transport: ZenohTransport, dividend: int, divisor: int) -> Any:
    return transport.codec.encoder(e.divide.request)((dividend, divisor))


def request(sequence: int, *, client: int = 77, kind: int = e.divide.fingerprint, remaining: float = 5.0) -> bytes:
    return header.pack_request(0, kind, client, sequence, remaining)


def address(link: int) -> str:
    """Where a link, or the line of one, is reached."""
    return f"rc_to/0/{link >> 24:010x}/{link & 0xFFFFFF:06x}"


def send_many(transport: ZenohTransport, outlet: Any, count: int, deadline: float = SOON) -> None:
    for _ in range(count):
        outlet.send(blob(transport, b"x"), deadline)


def answers(outsider: Any, key: str, payload: bytes, head: bytes) -> list[tuple[int, bytes]]:
    """Status and payload of what is answered to a plain `get`."""
    replies = outsider.get(key, payload=payload, attachment=head, timeout=SOON)
    samples = [reply.ok for reply in replies if reply.ok]
    return [(header.read_reply(s.attachment.to_bytes()).status, s.payload.to_bytes()) for s in samples]


# Plain programs.


def test_a_script_can_call_a_query(transport: ZenohTransport, outsider: Any) -> None:
    serve_division(transport, outsider)
    ((status, payload),) = answers(outsider, DIVIDE_KEY, division(transport, 17, 5), request(1))
    assert (status, transport.codec.decoder(e.divide.response)(payload)) == (Status.OK, (3, 2))


def test_a_script_can_listen_to_a_topic(transport: ZenohTransport, outsider: Any) -> None:
    heard = outsider.declare_subscriber("rc/0/robot/*/Everything/news")
    outlet = transport.outlet(NEWS)
    wait_until(lambda: outlet._publisher.matching_status.matching)  # type: ignore[attr-defined]
    outlet.send(transport.codec.encoder(e.news.request)((1, "hello")))
    sample = heard.recv()
    assert (str(sample.key_expr), header.read_publication(sample.attachment.to_bytes()).sequence) == (NEWS_KEY, 1)
    assert transport.codec.decoder(e.news.request)(sample.payload.to_bytes()) == (1, "hello")


def test_a_call_under_another_contract_gets_ours(transport: ZenohTransport, outsider: Any) -> None:
    link = serve_division(transport, outsider)
    found = answers(outsider, DIVIDE_KEY, division(transport, 1, 1), request(1, kind=12345))
    assert found == [(Status.MISMATCH, e.divide.text.encode())]
    wait_until(lambda: link.stats.mismatched == 1)


def test_a_repeated_request_is_not_executed_again(transport: ZenohTransport, outsider: Any) -> None:
    link = serve_division(transport, outsider)
    found = [answers(outsider, DIVIDE_KEY, division(transport, 9, n), request(n, client=9)) for n in (1, 1, 1, 2)]
    assert [len(each) for each in found] == [1, 0, 0, 1]
    assert (link.stats.repeated, link.stats.received) == (2, 2)


def test_an_expired_request_is_not_executed(transport: ZenohTransport, outsider: Any) -> None:
    link = serve_division(transport, outsider)
    assert answers(outsider, DIVIDE_KEY, division(transport, 1, 1), request(1, remaining=0.0))[0][0] == Status.EXPIRED
    assert (link.stats.expired, link.stats.received) == (1, 0)


# Hostile ones.


def test_garbage_for_a_server_is_dropped_counted_and_logged_once(
    transport: ZenohTransport, outsider: Any, caplog: pytest.LogCaptureFixture
) -> None:
    link = serve_division(transport, outsider)
    for number in range(100):
        noise = secrets.token_bytes(number % 50 + 50)
        outsider.get(DIVIDE_KEY, payload=noise, attachment=noise, timeout=SOON)
        outsider.get(DIVIDE_KEY, timeout=SOON)
        outsider.put(DIVIDE_KEY, noise)  # not even a question
        outsider.put(address(link.id), noise, attachment=noise, congestion_control=BLOCK)
        outsider.put(address(link.id), noise, congestion_control=BLOCK)
    wait_until(lambda: link.stats.malformed == 400)
    assert answers(outsider, DIVIDE_KEY, division(transport, 8, 3), request(1))[0][0] == Status.OK
    assert sum(DIVIDE.name in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("make", [topic, command])
def test_garbage_for_an_inlet_is_dropped_counted_and_logged_once(
    transport: ZenohTransport, other: ZenohTransport, outsider: Any, make: Any, caplog: pytest.LogCaptureFixture
) -> None:
    heard: list[Any] = []
    link = transport.inlet(make("a/b/c"), heard.append)
    outlet = other.outlet(make("a/b/c"))
    assert outlet.wait_peer(SOON)
    for number in range(100):
        noise = secrets.token_bytes(number % 29)  # as long as no header
        outsider.put("rc/0/a/b/c", noise, attachment=noise, congestion_control=zenoh.CongestionControl.BLOCK)
        outsider.put("rc/0/a/b/c", noise, congestion_control=zenoh.CongestionControl.BLOCK)
    outsider.get("rc/0/a/b/c", payload=b"?")  # no program answers there
    wait_until(lambda: link.stats.malformed == 200)
    outlet.send(blob(other, b"good"))
    wait_until(lambda: len(heard) == 1)
    assert sum("malformed" in record.message for record in caplog.records) == 1


def test_garbage_among_tokens_acknowledgements_and_inquiries_does_no_harm(
    transport: ZenohTransport, other: ZenohTransport, outsider: Any
) -> None:
    heard: list[Any] = []
    transport.inlet(topic("a/b/c", RELIABLE), heard.append)
    outlet: Any = other.outlet(topic("a/b/c", RELIABLE))
    member, number = f"{outlet.id >> 24:010x}", f"{outlet.id & 0xFFFFFF:06x}"
    tokens = [
        outsider.liveliness().declare_token(f"rc_lv/0/{rest}")
        for rest in ("x", "publishes/-/zz/1/zz/a/b/c", "subscribes/r/-/-/-/-", "a/b/c/d/e/f/g/h/i/j")
    ]
    for key in (f"rc_ack/0/{member}/{number}", f"rc_ack/0/{member}/zz", f"rc_ack/0/{member}/-1"):
        for size in (0, 1, 15, 16, 17, 1000):
            outsider.put(key, secrets.token_bytes(size))
    for key in (
        f"rc_ask/0/{member}/{number}/nonsense",
        f"rc_ask/0/{member}/zz/history",
        f"rc_ask/0/{member}/ffffff/history",
    ):
        assert [reply.ok for reply in outsider.get(key, timeout=SOON)] == []
    for key in (f"rc_ask/0/{member}/zz/text", f"rc_ask/0/{member}/ffffff/text"):
        assert [reply.ok.attachment.to_bytes() for reply in outsider.get(key, timeout=SOON)] == [b"gone"]
    assert outlet.wait_peer(SOON)
    send_many(other, outlet, 20)
    wait_until(lambda: len(heard) == 20)
    for token in tokens:
        token.undeclare()


@pytest.mark.parametrize("ask", ["ask", "call"])
def test_garbage_is_not_taken_for_a_reply(transport: ZenohTransport, outsider: Any, ask: str) -> None:
    wrong = header.pack_reply(Status.OK, 1, 2, 3)

    def answer(question: Any) -> None:
        asked = header.read_request(question.attachment.to_bytes())
        right = header.pack_reply(Status.OK, asked.client, asked.sequence, 3)
        for attachment in (None, b"", wrong, wrong[:-1], bytes([1, 99]) + wrong[2:], right):
            outsider.put(address(asked.client), b"x", attachment=attachment, congestion_control=BLOCK)

    fake = outsider.declare_subscriber(address(1), answer)
    fingerprint = f"{e.divide.fingerprint:016x}"
    token = outsider.liveliness().declare_token(f"rc_lv/0/serves/-/{fingerprint}/1/{1:016x}/{DIVIDE.name}")
    caller = transport.caller(DIVIDE)
    assert caller.wait_peer(SOON)
    question = division(transport, 1, 1)
    reply = caller.ask(question, SOON) if ask == "ask" else caller.call(question, SOON).result(SOON)
    assert reply == Reply(Status.OK, b"x")
    assert caller.stats.malformed == 5
    token.undeclare()
    fake.undeclare()


def test_garbage_between_calls_does_no_harm(transport: ZenohTransport, other: Any) -> None:
    server = other.server(query("a/b/c"), answering(other, bytes.upper))
    caller: Any = transport.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    assert caller.ask(blob(transport, b"x"), SOON).status is Status.OK
    for line in transport.links_by_id:
        put(other.session, address(line), None, b"noise")
    assert caller.ask(blob(transport, b"x"), SOON).status is Status.OK
    server.close()


# Messages that must not be lost, and their receivers.


def test_best_effort_subscribers_hear_reliable_publishers_and_do_not_hold_them_up(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    release, first, heard = threading.Event(), threading.Event(), list[Any]()
    other.inlet(topic("a/b/c", QoS(depth=2)), lambda _: (first.set(), release.wait(SOON)))
    other.inlet(topic("a/b/c", RELIABLE), heard.append)
    outlet = transport.outlet(topic("a/b/c", RELIABLE))
    wait_until(lambda: len(outlet.counterparts()) == 2)
    assert outlet.wait_peer(SOON)
    send_many(transport, outlet, 50)
    wait_until(lambda: len(heard) == 50)
    assert first.wait(SOON)
    release.set()


def test_messages_that_cannot_be_taken_are_in_the_way_of_no_others(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    count, taken = itertools.count(), list[Any]()

    def refuse_every_third(_: str) -> None:
        if next(count) % 3 == 0:
            raise ValueError

    other.inlet(replace(topic("a/b/c", RELIABLE), on_receive=refuse_every_third), taken.append)
    outlet = transport.outlet(topic("a/b/c", RELIABLE))
    assert outlet.wait_peer(SOON)
    send_many(transport, outlet, 300)
    wait_until(lambda: len(taken) == 200)


def test_a_departed_reliable_subscriber_does_not_block_its_publisher(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    release = threading.Event()
    stuck = other.inlet(topic("a/b/c", RELIABLE), lambda _: release.wait(SOON))
    outlet = transport.outlet(topic("a/b/c", RELIABLE))
    assert outlet.wait_peer(SOON)
    with pytest.raises(Timeout):
        send_many(transport, outlet, 50, 0.1)
    release.set()
    stuck.close()
    send_many(transport, outlet, 50)


def test_a_transport_learns_only_of_possible_peers_of_its_links(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    other.server(query("robot/a/I/ask"), answering(other, bytes.upper))
    other.server(query("robot/b/I/ask"), answering(other, bytes.upper))
    other.caller(query("robot/*/I/ask"))
    asking, serving = (
        transport.caller(query("robot/a/I/ask")),
        transport.server(query("robot/c/I/ask"), answering(transport, bytes.upper)),
    )
    assert asking.wait_peer(SOON)
    assert serving.wait_peer(SOON)
    found = {(token.role, token.channel) for token in transport.table.find("serves", "robot/*/I/ask")}
    assert found == {("serves", "robot/a/I/ask"), ("serves", "robot/c/I/ask")}


@pytest.mark.parametrize(
    ("role", "channel", "found"),
    [
        ("calls", "robot/a/I/ask", ["robot/a/I"]),
        ("calls", "robot/*/I/ask", ["robot/*/I"]),
        ("serves", "robot/a/I/ask", ["robot/a/I", "robot/./I"]),
        ("publishes", "a/I/news", ["a/I", "./I"]),
    ],
)
def test_a_provider_looks_for_peers_that_name_no_instance_too(role: str, channel: str, found: list[str]) -> None:
    assert peer_prefixes(role, channel) == found


def test_a_server_that_vanished_unnoticed_is_not_waited_for(transport: ZenohTransport) -> None:
    """Zenoh may tell who joins of a server that dies just then, and never of its death."""
    ghost = f"rc_lv/0/serves/-/{1:016x}/1/{2**40:016x}/a/b/c"
    transport.table.update(ghost, True)
    caller = transport.caller(query("a/b/c"))
    with pytest.raises(Timeout):
        caller.ask(blob(transport, b"?"), 0.1)
    wait_until(lambda: not transport.table.find("serves", "a/b/c"))
    with pytest.raises(Unreachable):
        caller.ask(blob(transport, b"?"), SOON)
    transport.table.update(ghost, True)
    transport.server(query("a/b/c"), answering(transport, bytes.upper))
    assert caller.ask(blob(transport, b"x"), SOON).status is Status.OK


def test_history_is_asked_for_again_if_its_publisher_came_back_meanwhile(
    transport: ZenohTransport, other: ZenohTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport.outlet(topic("a/b/c", LATCHED)).send(blob(transport, b"1"))
    inquire, asked = other.inquire, list[int]()

    def inquire_in_vain(link: int, what: str, channel: str = "") -> tuple[list[Message], bool]:
        asked.append(link)
        if len(asked) > 1:
            return inquire(link, what, channel)
        (token,) = other.table.find("publishes", "a/b/c")
        for there in (False, True):
            other._update(other.key("rc_lv", token.key_expr()), there)
            other._look()
        return [], True

    monkeypatch.setattr(other, "inquire", inquire_in_vain)
    assert subscribe(other, topic("a/b/c", LATCHED)).get(timeout=SOON) == b"1"


def test_history_is_asked_for_again_if_its_publisher_is_too_busy_to_answer(
    transport: ZenohTransport, other: ZenohTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport.outlet(topic("a/b/c", LATCHED)).send(blob(transport, b"1"))
    inquire, asked = other.inquire, list[int]()

    def inquire_late(link: int, what: str, channel: str = "") -> tuple[list[Message], bool]:
        asked.append(link)
        return inquire(link, what, channel) if len(asked) > 2 else ([], False)

    monkeypatch.setattr(other, "inquire", inquire_late)
    assert subscribe(other, topic("a/b/c", LATCHED)).get(timeout=SOON) == b"1"


def test_a_publisher_with_an_incomplete_history_is_received_all_the_same(
    transport: ZenohTransport, other: ZenohTransport, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(other, "inquire", lambda *_: ([], False))
    outlet, inbox = transport.outlet(topic("a/b/c", LATCHED)), subscribe(other, topic("a/b/c", LATCHED))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(transport, b"news"))
    assert inbox.get(timeout=SOON) == b"news"
    assert "not all latched messages of its publisher" in caplog.text


def test_a_subscriber_that_vanished_unnoticed_is_not_waited_for_long(transport: ZenohTransport) -> None:
    transport.table.update(f"rc_lv/0/subscribes/rl/{1:016x}/1/{2**40:016x}/a/b/c", True)
    outlet = transport.outlet(topic("a/b/c", QoS(Reliability.RELIABLE, depth=1)))
    for _ in range(3):
        outlet.send(blob(transport, b"news"), SOON)
    assert not transport.table.find("subscribes", "a/b/c")


def test_a_token_means_presence_unless_its_transport_says_otherwise(
    transport: ZenohTransport, other: ZenohTransport, outsider: Any
) -> None:
    """Zenoh may find a token that has been taken back; a plain program may answer nothing but requests."""
    link: Any = other.inlet(topic("a/b/c"), lambda payload: None)
    wait_until(lambda: [*outsider.liveliness().get(f"rc_lv/0/subscribes/*/*/*/{link.id:016x}/a/b/c")])
    del other.links_by_id[link.id]
    plain = outsider.liveliness().declare_token(f"rc_lv/0/subscribes/-/{1:016x}/1/{2**40:016x}/a/b/c")
    transport.outlet(topic("a/b/c"))
    wait_until(lambda: len(transport.table.find("subscribes", "a/b/c")) == 2)
    for token in transport.table.find("subscribes", "a/b/c"):
        transport.confirm(token)
    assert [token.link for token in transport.table.find("subscribes", "a/b/c")] == [2**40]
    plain.undeclare()
    other.links_by_id[link.id] = link


def test_of_two_looks_the_later_one_counts(transport: ZenohTransport, monkeypatch: pytest.MonkeyPatch) -> None:
    link: Any = transport.inlet(topic("a/b/c"), lambda payload: None)
    find, interrupted, on = link.counterparts, threading.Event(), threading.Event()

    def find_slowly() -> list[Any]:
        found: list[Any] = find()
        if threading.current_thread() is first:
            interrupted.set()
            assert on.wait(SOON)
        return found

    monkeypatch.setattr(link, "counterparts", find_slowly)
    first = threading.Thread(target=link.look)
    first.start()
    assert interrupted.wait(SOON)
    transport.table.update(f"rc_lv/0/publishes/-/{1:016x}/1/{2**40:016x}/a/b/c", True)
    second = threading.Thread(target=link.look)
    second.start()
    on.set()
    first.join()
    second.join()
    assert link._channels == {2**40: "a/b/c"}


def test_of_threads_that_are_the_first_to_ask_one_makes_the_way(transport: ZenohTransport) -> None:
    """Zenoh may drop what goes by one of two publishers of a key while the other one is undeclared."""
    for number in range(10):
        name, together = f"a/b{number}/c", threading.Barrier(6)
        transport.server(query(name), answering(transport, bytes.upper))
        caller = transport.caller(query(name))
        assert caller.wait_peer(SOON)

        def way(_: int, caller: Any = caller, together: threading.Barrier = together) -> object:
            together.wait(SOON)
            return caller.server()[1]

        with ThreadPoolExecutor(6) as pool:
            assert len(set(pool.map(way, range(6)))) == 1


def test_nothing_reliable_is_lost_however_deep_its_publisher_is_and_however_slow_its_subscriber(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    release, heard = threading.Event(), list[Any]()
    deep, shallow = QoS(Reliability.RELIABLE, depth=9000), RELIABLE

    def sink(payload: Any) -> None:
        release.wait(SOON)
        heard.append(payload)

    link = other.inlet(topic("a/b/c", shallow), sink)
    outlet, sent = transport.outlet(topic("a/b/c", deep)), 0
    assert outlet.wait_peer(SOON)
    with contextlib.suppress(Timeout):
        while sent < 9000:
            outlet.send(blob(transport, b""), 0.2)
            sent += 1
    release.set()
    wait_until(lambda: len(heard) >= sent)
    assert link.stats.lost == 0


def test_what_waits_of_a_publisher_that_does_not_count_is_bounded(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    release, heard = threading.Event(), list[Any]()

    def sink(payload: Any) -> None:
        release.wait(SOON * 3)
        heard.append(payload)

    link = other.inlet(topic("a/b/c", RELIABLE), sink)
    outlet = transport.outlet(topic("a/b/c"))
    assert outlet.wait_peer(SOON)
    sent, most = 2 * MOST_AHEAD, 1 + RELIABLE.depth + MOST_AHEAD
    for _ in range(sent):
        outlet.send(blob(transport, b""))
    wait_until(lambda: link.stats.dropped + link.stats.lost >= sent - most)
    release.set()
    wait_until(lambda: len(heard) + link.stats.dropped + link.stats.lost >= sent)
    assert len(heard) <= most


def test_a_publisher_can_be_closed_while_other_threads_use_it(transport: ZenohTransport) -> None:
    def use(outlet: Any, begun: threading.Event) -> type[Exception]:
        try:
            while True:
                outlet.send(blob(transport, b"news"))
                outlet.wait_peer(0.0)
                begun.set()
        except Exception as exc:
            return type(exc)

    for number in range(10):
        outlet, begun = transport.outlet(topic(f"a/b{number}/c")), threading.Event()
        with ThreadPoolExecutor() as pool:
            users = [pool.submit(use, outlet, begun) for _ in range(4)]
            assert begun.wait(SOON)
            outlet.close()
            assert {user.result(SOON) for user in users} == {Closed}


def test_a_late_subscriber_gets_each_latched_message_once_and_in_order_under_traffic(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    outlet = transport.outlet(topic("a/b/c", LATCHED))
    stop = threading.Event()

    def publish() -> None:
        number = 0
        while not stop.is_set():
            number += 1
            outlet.send(blob(transport, str(number).encode()), SOON)

    publishing = threading.Thread(target=publish)
    publishing.start()
    try:
        for _ in range(10):
            heard: list[int] = []
            link = other.inlet(topic("a/b/c", LATCHED), lambda p, heard=heard: heard.append(int(unblob(other, p))))
            wait_until(lambda heard=heard: len(heard) > 20)
            link.close()
            assert heard == list(range(heard[0], heard[0] + len(heard)))
    finally:
        stop.set()
        publishing.join()


def test_history_is_asked_for_once_what_follows_it_is_heard(
    transport: ZenohTransport, other: ZenohTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport.outlet(topic("a/b/c", LATCHED))
    asked: list[bool] = []
    subscribe, subscribed, looked = Subscriber.open, threading.Event(), threading.Event()

    def open_late(self: Subscriber) -> None:
        wait_until(lambda: other.table.find("publishes", "a/b/c"))
        other._look()
        other.do(looked.set)
        assert looked.wait(SOON)
        subscribe(self)
        subscribed.set()

    def inquire(*_: object) -> tuple[list[Message], bool]:
        asked.append(subscribed.is_set())
        return [], True

    monkeypatch.setattr(Subscriber, "open", open_late)
    monkeypatch.setattr(other, "inquire", inquire)
    other.inlet(topic("a/b/c", LATCHED), print)
    wait_until(lambda: asked)
    assert asked == [True]


def test_commands_that_a_server_has_no_room_for_time_out_at_their_sender(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    release = threading.Event()
    other.inlet(command("a/b/c"), lambda _: release.wait(SOON * 3))
    outlet = transport.outlet(command("a/b/c"))
    assert outlet.wait_peer(SOON)
    with pytest.raises(Timeout, match="did not take the command"):
        send_many(transport, outlet, 1000 + COMMANDS_AHEAD + 2, 0.2)
    release.set()


def test_what_is_asked_right_after_a_server_became_visible_reaches_it(
    transport: ZenohTransport, other: ZenohTransport
) -> None:
    for number in range(100):
        server = other.server(query(f"a/b{number}/c"), answering(other, bytes.upper))
        caller = transport.caller(query(f"a/b{number}/c"))
        assert caller.wait_peer(SOON)
        assert caller.ask(blob(transport, b"x"), SOON).status is Status.OK
        server.close()
        caller.close()


@pytest.mark.parametrize("who", ["runs it", "is its client"])
def test_large_messages_of_many_all_reach_the_process_that_runs_the_router(
    transport: ZenohTransport, other: ZenohTransport, who: str
) -> None:
    heard = list[int]()
    link = (transport if who == "runs it" else other).inlet(
        topic("a/b/c", RELIABLE), lambda payload: heard.append(len(payload))
    )
    senders = [ZenohTransport(TransportConfig()) for _ in range(4)]
    outlets = [each.outlet(topic("a/b/c", QoS(Reliability.RELIABLE, depth=100))) for each in senders]
    for outlet in outlets:
        assert outlet.wait_peer(SOON)
    large = blob(transport, bytes(100_000))

    def flood(outlet: Any) -> None:
        for _ in range(200):
            outlet.send(large, SOON)

    flooding = [threading.Thread(target=flood, args=(outlet,)) for outlet in outlets]
    for each in flooding:
        each.start()
    for each in flooding:
        each.join()
    # A client in the process of the router shares its reading threads (see `session.py`). On a busy machine both may
    # wait for each other, until Zenoh closes a connection. What is lost with it is counted, and the rest arrives.
    wait_until(lambda: len(heard) + link.stats.lost == 800)
    assert link.stats.repeated == 0
    assert who == "is its client" or link.stats.lost == 0
    for sender in senders:
        sender.close()


def test_a_reader_tells_what_it_took_no_more_often_than_its_sender_needs(
    transport: ZenohTransport, other: ZenohTransport, outsider: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, heard = list[int](), list[Any]()
    telling = outsider.declare_subscriber(
        "rc_ack/**", lambda sample: told.append(int.from_bytes(sample.payload.to_bytes()[8:], "little"))
    )
    link = transport.inlet(topic("a/b/c", RELIABLE), heard.append)
    monkeypatch.setattr(link, "tick", lambda: None)  # by which a reader tells at once what a slow sink has left over
    outlet = other.outlet(topic("a/b/c", QoS(Reliability.RELIABLE, depth=40)))
    assert outlet.wait_peer(SOON)
    wait_until(lambda: link._ahead)  # type: ignore[attr-defined]  # until it knows its sender, it tells of each message
    send_many(other, outlet, 80)
    wait_until(lambda: len(heard) == 80 and 80 in told)
    assert told == list(range(10, 90, 10))
    telling.undeclare()


def test_lost_messages_of_a_reliable_publisher_are_logged_once(
    transport: ZenohTransport, outsider: Any, caplog: pytest.LogCaptureFixture
) -> None:
    heard = list[Any]()
    channel = topic("a/b/c", RELIABLE)
    link = transport.inlet(channel, heard.append)
    fingerprint = channel.type.fingerprint
    token = outsider.liveliness().declare_token(f"rc_lv/0/publishes/rw9/{fingerprint:016x}/1/{7:016x}/a/b/c")
    wait_until(lambda: 7 in link._lost)  # type: ignore[attr-defined]
    for number in (1, 2, 5, 9, 10):
        head = header.pack_publication(fingerprint, 7, number, 0)
        outsider.put("rc/0/a/b/c", b"x", attachment=head, congestion_control=BLOCK)
    wait_until(lambda: len(heard) == 5)
    assert link.stats.lost == 5
    told = [record.message for record in caplog.records if "a/b/c: lost" in record.message]
    assert len(told) == 1
    assert told[0].startswith("a/b/c: lost 2 messages of a reliable publisher")
    token.undeclare()


@pytest.mark.parametrize("end", ["the call", "the caller"])
def test_a_caller_without_a_reply_is_woken_at_the_end(
    transport: ZenohTransport, other: ZenohTransport, end: str
) -> None:
    begun, release = threading.Event(), threading.Event()
    transport.server(query("a/b/c"), lambda payload, _: (begun.set(), release.wait(SOON * 3), Reply(Status.OK))[2])
    caller = other.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    if end == "the caller":
        threading.Thread(target=lambda: begun.wait(SOON) and caller.close()).start()
    with pytest.raises(Timeout if end == "the call" else Closed):
        in_time(caller.ask(blob(other, b"x"), 0.2 if end == "the call" else SOON * 3))
    release.set()


# Who serves, and who meets.


def test_the_second_servers_error_names_the_first(transport: ZenohTransport, other: ZenohTransport) -> None:
    transport.server(query("a/b/c"), answering(transport, bytes.upper))
    with pytest.raises(TransportError, match=rf"a/b/c: already served by calculator \(pid {os.getpid()}\)"):
        other.server(query("a/b/c"), answering(other, bytes.upper))


def test_domains_do_not_meet(transport: ZenohTransport) -> None:
    elsewhere = ZenohTransport(TransportConfig({"domain": 7}))
    elsewhere.server(query("a/b/c"), answering(elsewhere, bytes.upper))
    transport.server(query("a/b/c"), answering(transport, bytes.upper))
    elsewhere.close()


def test_a_router_elsewhere_can_be_used() -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    with open_router(locator):
        here, there = (ZenohTransport(TransportConfig({"connect": locator})) for _ in range(2))
        here.server(query("a/b/c"), answering(here, bytes.upper))
        caller = there.caller(query("a/b/c"))
        assert caller.wait_peer(SOON)
        assert caller.ask(blob(there, b"x"), SOON).status is Status.OK
        here.close()
        there.close()


def test_a_stopping_component_does_not_wait_for_a_router() -> None:
    with pytest.raises(Closed, match="stopped while waiting for a router"):
        ZenohTransport(TransportConfig({"connect": f"tcp/127.0.0.1:{free_port()}"}, wanted=lambda: False))


@pytest.mark.parametrize(
    "options", [{"port": 5}, {"domain": "x"}, {"domain": -1}, {"connect": 7}, {"connect": "not an endpoint"}]
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        ZenohTransport(TransportConfig(options))


def test_a_run_time_folder_too_deep_for_a_socket_is_an_error_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / ("x" * 100)))
    with pytest.raises(ConfigurationError, match="ROBOCOMP_RUNTIME_DIR"):
        ZenohTransport(TransportConfig())


def test_nothing_is_left_behind() -> None:
    def files() -> set[str]:
        ours = {str(path) for path in (runtime_dir() / "zenoh").rglob("*") if not path.is_dir()}
        return ours | {name for name in os.listdir("/dev/shm") if name.endswith(".zenoh")}  # others have files there

    before = files()
    first, second = ZenohTransport(TransportConfig()), ZenohTransport(TransportConfig())
    first.server(query("a/b/c"), answering(first, bytes.upper))
    second.outlet(topic("a/b/d"))
    assert len(files() - before) >= 3
    first.close()
    second.close()
    assert files() <= before


def test_large_messages_for_a_slow_sink_delay_nothing_else(transport: ZenohTransport, other: ZenohTransport) -> None:
    release, first = threading.Event(), threading.Event()
    other.inlet(topic("a/b/c", QoS(depth=2)), lambda _: (first.set(), release.wait(SOON * 3)))
    other.server(query("a/b/d"), answering(other, bytes.upper))
    outlet, caller = transport.outlet(topic("a/b/c")), transport.caller(query("a/b/d"))
    assert outlet.wait_peer(SOON)
    assert caller.wait_peer(SOON)
    large = blob(transport, bytes(1_000_000))
    for _ in range(30):
        outlet.send(large)
        assert caller.ask(blob(transport, b"x"), SOON).status is Status.OK
    assert first.wait(SOON)
    release.set()


# Routers come and go.


def test_a_launcher_can_run_the_router_and_a_component_takes_over() -> None:
    folder = runtime_dir() / "zenoh"
    with hosting("zenoh", TransportConfig(owner="deployer")):
        here, there = ZenohTransport(TransportConfig(owner="here")), ZenohTransport(TransportConfig(owner="there"))
        here.server(query("a/b/c"), answering(here, bytes.upper))
        caller = there.caller(query("a/b/c"))
        assert caller.wait_peer(SOON)
        assert holder(folder, "router") == f"deployer (pid {os.getpid()})"
    wait_until(lambda: is_answered(there, caller))
    assert holder(folder, "router") != f"deployer (pid {os.getpid()})"
    here.close()
    there.close()


_COUNTING_THREADS = """
import os
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.zenoh.transport import ZenohTransport
transport = ZenohTransport(TransportConfig(owner="component"))
print(len(os.listdir("/proc/self/task")))
transport.close()
"""


def test_only_a_process_that_may_run_the_router_has_many_reading_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # else numpy has one for each processor

    def threads() -> int:
        told = subprocess.run([sys.executable, "-c", _COUNTING_THREADS], capture_output=True, text=True, check=True)
        return int(told.stdout)

    with hosting("zenoh", TransportConfig(owner="deployer")):
        assert threads() < 16
        assert "ZENOH_RUNTIME" not in os.environ
    first = ZenohTransport(TransportConfig(owner="first"))
    assert threads() > 16
    first.close()


def test_running_a_router_where_one_runs_changes_nothing(transport: ZenohTransport, other: ZenohTransport) -> None:
    transport.server(query("a/b/c"), answering(transport, bytes.upper))
    caller = other.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    with hosting("zenoh", TransportConfig(owner="deployer")):
        assert caller.ask(blob(other, b"x"), SOON).status is Status.OK
    assert caller.ask(blob(other, b"x"), SOON).status is Status.OK
    assert holder(runtime_dir() / "zenoh", "router").startswith("calculator")


def test_of_a_router_elsewhere_and_of_other_transports_nothing_is_run() -> None:
    with (
        hosting("zenoh", TransportConfig({"connect": "tcp/127.0.0.1:1"})),
        hosting("inproc", TransportConfig()),
    ):
        assert holder(runtime_dir() / "zenoh", "router") == "a process that has just started or stopped"


def test_while_the_router_hangs_deadlines_hold_and_its_holder_is_named(caplog: pytest.LogCaptureFixture) -> None:
    host = run("t = ZenohTransport(TransportConfig(owner='host')); print('up', flush=True); time.sleep(1000)")
    assert host.stdout is not None
    assert host.stdout.readline() == "up\n"
    here, there = ZenohTransport(TransportConfig()), ZenohTransport(TransportConfig())
    here.server(query("a/b/c"), answering(here, bytes.upper))
    caller = there.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    host.send_signal(signal.SIGSTOP)
    for size in (1, 6_000_000):
        with pytest.raises((Timeout, Unreachable)):
            caller.ask(blob(there, bytes(size)), 0.1)
        with pytest.raises((Timeout, Unreachable)):
            caller.call(blob(there, bytes(size)), 0.1).result(SOON)
    wait_until(lambda: sum(f"run by host (pid {host.pid})" in record.message for record in caplog.records) == 2)
    host.send_signal(signal.SIGCONT)
    wait_until(lambda: is_answered(there, caller))
    host.kill()
    host.wait()
    here.close()
    there.close()


def test_calls_under_way_end_when_the_router_is_closed_and_later_ones_are_answered() -> None:
    host = ZenohTransport(TransportConfig(owner="host"))
    here, there = ZenohTransport(TransportConfig()), ZenohTransport(TransportConfig())
    here.server(query("a/b/c"), answering(here, bytes.upper))
    caller = there.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    answered, failed, stop = [0] * 4, list[TransportError](), threading.Event()

    def call_on(number: int) -> None:
        while not stop.is_set():
            try:
                answered[number] += caller.ask(blob(there, b"x"), SOON).status is Status.OK
            except TransportError as exc:
                failed.append(exc)

    callers = [threading.Thread(target=call_on, args=(number,)) for number in range(4)]
    for each in callers:
        each.start()
    try:
        wait_until(lambda: all(answered))
        host.close()
        before = list(answered)
        wait_until(lambda: all(now > then for now, then in zip(answered, before, strict=True)))
    finally:
        stop.set()
        for each in callers:
            each.join()
    assert [exc for exc in failed if not isinstance(exc, Unreachable)] == []
    here.close()
    there.close()


def test_when_the_router_is_closed_another_transport_runs_it() -> None:
    host = ZenohTransport(TransportConfig(owner="host"))
    here, there = ZenohTransport(TransportConfig()), ZenohTransport(TransportConfig())
    here.server(query("a/b/c"), answering(here, bytes.upper))
    caller = there.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    host.close()
    wait_until(lambda: is_answered(there, caller))
    here.close()
    there.close()


def test_when_the_process_of_the_router_is_killed_another_one_runs_it() -> None:
    host = run("t = ZenohTransport(TransportConfig(owner='host')); print('up', flush=True); time.sleep(1000)")
    assert host.stdout is not None
    assert host.stdout.readline() == "up\n"
    here, there = ZenohTransport(TransportConfig()), ZenohTransport(TransportConfig())
    heard: list[Any] = []
    there.inlet(topic("a/b/d", LATCHED), heard.append)
    outlet = here.outlet(topic("a/b/d", LATCHED))
    here.server(query("a/b/c"), answering(here, bytes.upper))
    caller = there.caller(query("a/b/c"))
    assert caller.wait_peer(SOON)
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, b"1"))
    host.send_signal(signal.SIGKILL)
    host.wait()
    wait_until(lambda: is_answered(there, caller))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, b"2"), SOON)
    wait_until(lambda: len(heard) == 2)
    here.close()
    there.close()


def test_a_program_that_forgets_to_close_ends_nevertheless() -> None:
    program = run(
        "t = ZenohTransport(TransportConfig(owner='forgetful'))",
        "u = ZenohTransport(TransportConfig(owner='forgetful'))",
        "t.server(query('a/b/c'), lambda p, e: Reply(Status.OK, p)); c = u.caller(query('a/b/c')); c.wait_peer(9)",
        "print(c.ask(b'', 9.0).status, flush=True)",
    )
    out, _ = program.communicate(timeout=SOON * 3)
    assert (out, program.returncode) == ("0\n", 0)


def run(*lines: str) -> subprocess.Popen[str]:
    imports = (
        "import time",
        "from robocomp_py.transports.zenoh.transport import ZenohTransport",
        "from robocomp_py.transports.base import *",
        "from robocomp_py.testing.conformance import query",
    )
    program = subprocess.Popen([sys.executable, "-c", "\n".join((*imports, *lines))], stdout=subprocess.PIPE, text=True)
    _programs.append(program)
    return program


def is_answered(transport: ZenohTransport, caller: Any) -> bool:
    try:
        return bool(caller.ask(blob(transport, b"x"), 1.0).status is Status.OK)
    except (Unreachable, Timeout):
        time.sleep(0.02)
        return False
