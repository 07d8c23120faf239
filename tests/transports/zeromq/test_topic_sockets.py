"""Many publications of a component share a few sockets, and their subscribers notice nothing."""

from __future__ import annotations

import contextlib
import os
import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robocomp_py.contract.qos import Durability, History, QoS, Reliability
from robocomp_py.errors import Timeout, TransportError
from robocomp_py.testing.conformance import blob, topic, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import SupportsSubscribers, TransportConfig
from robocomp_py.transports.zeromq import topic_sockets
from robocomp_py.transports.zeromq.topics import Publisher, Subscriber
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
from robocomp_py.wire.codec import Payload

Opening = Callable[[], ZeroMQTransport]

RELIABLE = QoS(Reliability.RELIABLE)


@pytest.fixture
def opening(own_runtime_folder: object) -> Iterator[Opening]:
    with contextlib.ExitStack() as opened:

        def open_one() -> ZeroMQTransport:
            transport = opened.enter_context(contextlib.closing(ZeroMQTransport(TransportConfig(owner="test"))))
            transport.outlet(topic("robot/first/topic")).close()  # ZeroMQ keeps some descriptors from then on
            return transport

        yield open_one


@pytest.fixture
def all_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """Publications share from the first one on, instead of from the seventeenth."""
    monkeypatch.setattr(topic_sockets, "_UNSHARED", 0)


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def publisher(transport: ZeroMQTransport, name: str, qos: QoS = RELIABLE) -> Publisher:
    outlet = transport.outlet(topic(name, qos))
    assert isinstance(outlet, Publisher)
    return outlet


def subscriber(transport: ZeroMQTransport, name: str, sink: Callable[[Payload], object]) -> Subscriber:
    inlet = transport.inlet(topic(name, RELIABLE), sink)
    assert isinstance(inlet, Subscriber)
    return inlet


def socket_of(outlet: Publisher) -> object:
    assert outlet._here
    return outlet._here.socket


def fill(outlet: Publisher, payload: Payload) -> None:
    """Send until there is no room. Raises Timeout."""
    for _ in range(100_000):
        outlet.send(payload, 0.05)


@pytest.mark.parametrize("qos", [QoS(), RELIABLE], ids=["best effort", "reliable"])
def test_256_idle_publications_take_few_descriptors_and_leave_none(opening: Opening, qos: QoS) -> None:
    transport = opening()
    before = descriptors()
    outlets = [publisher(transport, f"robot/c{number}/topic", qos) for number in range(256)]
    assert descriptors() - before <= 40
    for outlet in outlets:
        outlet.close()
    wait_until(lambda: descriptors() <= before)
    assert not [name for name in os.listdir(transport.folder) if name.startswith(transport.member.id + "-")]


def test_the_first_publications_do_not_wait_for_each_other(opening: Opening) -> None:
    transport = opening()
    outlets = [publisher(transport, f"robot/c{number}/topic") for number in range(20)]
    assert len({socket_of(each) for each in outlets}) == len({socket_of(each) for each in outlets[:16]}) == 16


@pytest.mark.usefixtures("all_share")
def test_only_publications_with_the_same_depth_and_another_channel_share(opening: Opening) -> None:
    transport = opening()
    deep, latched = QoS(history=History.KEEP_ALL), QoS(durability=Durability.TRANSIENT_LOCAL)
    one, two, other, again, kept, more = (
        socket_of(publisher(transport, name, qos))
        for name, qos in (
            ("robot/c/one", RELIABLE),
            ("robot/c/two", RELIABLE),
            ("robot/c/three", deep),
            ("robot/c/one", RELIABLE),
            ("robot/c/four", latched),
            ("robot/c/five", latched),
        )
    )
    assert one is two
    assert len({one, other, again, kept, more}) == 5


@pytest.mark.usefixtures("all_share")
def test_a_subscriber_of_several_publications_of_a_socket_hears_each_message_once(opening: Opening) -> None:
    there, here = opening(), opening()
    heard = queue.Queue[bytes]()
    any_instance = subscriber(here, "robot/*/Laser/push", lambda payload: heard.put(unblob(here, payload)))
    outlets = [publisher(there, f"robot/c{number}/Laser/push") for number in range(30)]
    for outlet in outlets:
        assert outlet.wait_connected(SOON)
    for number, outlet in enumerate(outlets):
        outlet.send(blob(there, b"%d" % number), SOON)
    assert {int(heard.get(timeout=SOON)) for _ in outlets} == set(range(30))
    assert (any_instance.stats.repeated, heard.qsize()) == (0, 0)


@pytest.mark.usefixtures("all_share")
def test_a_publication_that_ends_takes_its_subscribers_along_and_is_heard_to_the_end(opening: Opening) -> None:
    there, here = opening(), opening()
    begin, heard, others = threading.Event(), queue.Queue[Payload](), queue.Queue[Payload]()
    ending, staying = publisher(there, "robot/c/ends"), publisher(there, "robot/c/stays")
    assert socket_of(ending) is socket_of(staying)

    def take_slowly(payload: Payload) -> None:
        begin.wait(SOON * 2)
        heard.put(payload)

    slow = subscriber(here, "robot/c/ends", take_slowly)
    subscriber(here, "robot/c/stays", others.put)
    assert ending.wait_connected(SOON)
    assert staying.wait_connected(SOON)
    for _ in range(15):
        ending.send(blob(there, b"last words"), SOON)
    ending.close()
    wait_until(lambda: not slow.sources())
    began = slow._ending.copy()
    wait_until(lambda: slow._ending and slow._ending != began)  # the first look whether it has said all is over
    begin.set()
    assert all(heard.get(timeout=SOON) for _ in range(15))
    wait_until(lambda: not slow._feeds)
    staying.send(blob(there, b"still here"), SOON)
    assert others.get(timeout=SOON)


@pytest.mark.usefixtures("all_share")
def test_a_publication_opened_again_has_another_address_and_is_heard_once(opening: Opening) -> None:
    there, here = opening(), opening()
    heard = queue.Queue[bytes]()
    inlet = subscriber(here, "robot/c/again", lambda payload: heard.put(unblob(here, payload)))
    publisher(there, "robot/c/stays")
    addresses = set()
    for number in range(5):
        outlet = publisher(there, "robot/c/again")
        addresses.add(outlet._address)
        assert outlet.wait_connected(SOON)
        outlet.send(blob(there, b"%d" % number), SOON)
        assert heard.get(timeout=SOON) == b"%d" % number
        outlet.close()
    assert len(addresses) == 5
    assert (inlet.stats.repeated, heard.qsize()) == (0, 0)


@pytest.mark.usefixtures("all_share")
def test_a_subscriber_that_hangs_hinders_no_other_topic_of_the_socket(opening: Opening) -> None:
    there, here = opening(), opening()
    end, heard = threading.Event(), queue.Queue[Payload]()
    stuck, free = publisher(there, "robot/c/stuck"), publisher(there, "robot/c/free")
    assert socket_of(stuck) is socket_of(free)
    subscriber(here, "robot/c/stuck", lambda _: end.wait(SOON * 6))
    subscriber(here, "robot/c/free", heard.put)
    assert stuck.wait_connected(SOON)
    assert free.wait_connected(SOON)
    try:
        with pytest.raises(Timeout):
            fill(stuck, blob(there, bytes(1000)))
        for _ in range(100):
            free.send(blob(there, b"x"), SOON)
            assert heard.get(timeout=SOON)
    finally:
        end.set()


@pytest.mark.usefixtures("all_share")
def test_publications_come_send_and_go_on_many_threads(opening: Opening) -> None:
    there, here = opening(), opening()
    before, heard = descriptors(), Counter[str]()
    links = {
        name: subscriber(here, name, lambda payload, name=name: heard.update([name]))  # type: ignore[misc]  # its type
        for name in (f"robot/c{number}/topic" for number in range(8))
    }
    held, errors = descriptors(), list[BaseException]()

    def live(name: str) -> None:
        try:
            for _ in range(15):
                outlet = publisher(there, name)
                assert outlet.wait_connected(SOON)
                for _ in range(5):
                    outlet.send(blob(there, b"x"), SOON)
                outlet.close()
        except BaseException as exc:
            errors.append(exc)

    threads = [threading.Thread(target=live, args=(name,)) for name in links]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    wait_until(lambda: dict(heard) == dict.fromkeys(links, 75), what="all messages arrive")
    assert all((link.stats.repeated, link.stats.lost) == (0, 0) for link in links.values())
    wait_until(lambda: not any(link._feeds for link in links.values()))
    wait_until(lambda: descriptors() <= held)
    for link in links.values():
        link.close()
    wait_until(lambda: descriptors() <= before)


@pytest.mark.usefixtures("all_share")
def test_a_publication_without_its_path_is_an_error_and_leaves_no_socket_open(
    opening: Opening, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport = opening()
    address = transport.member.address
    before = descriptors()

    def taken(suffix: str) -> Any:
        return address(suffix) if suffix.startswith("t") else transport.folder

    monkeypatch.setattr(transport.member, "address", taken)
    with pytest.raises(TransportError, match="File exists"):
        transport.outlet(topic("robot/c/topic"))
    wait_until(lambda: descriptors() <= before)


@pytest.mark.usefixtures("all_share")
def test_a_publisher_knows_whether_its_own_topic_has_subscribers(opening: Opening) -> None:
    there, here = opening(), opening()
    one, two = publisher(there, "robot/c/one"), publisher(there, "robot/c/two")
    inlet = here.inlet(topic("robot/c/one"), lambda _: None)
    assert one.wait_peer(SOON)
    assert isinstance(two, SupportsSubscribers)
    assert not two.has_subscribers
    inlet.close()
    wait_until(lambda: not one.has_subscribers)
