"""DDS keeps the contract, shows itself to others, and gets along with them."""

from __future__ import annotations

import contextlib
import gc
import itertools
import os
import secrets
import socket
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Set
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from cyclonedds.core import Entity, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.contract.types import INT32, UINT8, Field, Sequence, Struct
from robocomp_py.errors import (
    AlreadyServed,
    Closed,
    ConfigurationError,
    ContractMismatch,
    Timeout,
    TransportError,
    Unreachable,
)
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import (
    TransportConformance,
    answering,
    blob,
    command,
    everything_odd,
    query,
    topic,
    unblob,
)
from robocomp_py.testing.parts import in_time, processes, start_process
from robocomp_py.testing.patience import SCALE, SOON, wait_until
from robocomp_py.transports.base import (
    Channel,
    Outlet,
    Reply,
    Status,
    Transport,
    TransportConfig,
    TypeRef,
    find_transport,
)
from robocomp_py.transports.dds import announcing as announcing_module
from robocomp_py.transports.dds import client as client_module
from robocomp_py.transports.dds import core as core_module
from robocomp_py.transports.dds import endpoints as endpoints_module
from robocomp_py.transports.dds import server as server_module
from robocomp_py.transports.dds.core import FIRST_USER, domain_of_user
from robocomp_py.transports.dds.domain import (
    _keep_to_loopback,
    _udp_sockets,
    address_of,
    compose,
    note_on_sockets,
    settings,
)
from robocomp_py.transports.dds.qos import KEEP_ALL, endpoint_qos
from robocomp_py.transports.dds.topics import BYTES_WAITING, MESSAGES_WAITING
from robocomp_py.transports.dds.transport import DDSTransport
from robocomp_py.transports.dds.types import (
    BEFORE_TAIL,
    CODEC,
    START,
    Message,
    announcement_type,
    fill_reply,
    fill_request,
    publication_type,
    reply_fields,
    reply_type,
    request_type,
)
from robocomp_py.transports.limits import COMMANDS_WAITING, QUERIES_WAITING

from .domains import DOMAIN

_RELIABLE = QoS(Reliability.RELIABLE, depth=8)
_LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)
_numbers = itertools.count()


class TestDDS(TransportConformance):
    def open_transport(self) -> Transport:
        return DDSTransport(TransportConfig({"domain": DOMAIN}, "test"))


@pytest.fixture
def here() -> Iterator[DDSTransport]:
    with _opened() as transport:
        yield transport


@pytest.fixture
def there() -> Iterator[DDSTransport]:
    with _opened() as transport:
        yield transport


@pytest.fixture
def name() -> str:
    return f"t{os.getpid()}_{next(_numbers)}/Dds/op"


@contextlib.contextmanager
def _opened() -> Iterator[DDSTransport]:
    transport = DDSTransport(TransportConfig({"domain": DOMAIN}, "tester"))
    try:
        yield transport
    finally:
        transport.close()


def _inbox(transport: DDSTransport, channel: Channel) -> list[bytes]:
    inbox: list[bytes] = []
    transport.inlet(channel, lambda payload: inbox.append(unblob(transport, payload)))
    return inbox


def test_the_transport_is_installed() -> None:
    assert find_transport("dds") is DDSTransport


# -- samples ------------------------------------------------------------------

_VALUES: list[tuple[Operation[Any], tuple[Any, ...]]] = [
    (e.echo_nested, (everything_odd(),)),
    (e.echo_nested, (e.Nested(),)),
    (e.echo_arrays, (e.Arrays(),)),
    (e.echo_arrays, (e.Arrays(b"abc", [1], [2, 3], [0.5], [0.25], [True]),)),  # type: ignore[arg-type]
    (e.divide, (1, 2)),
]


@pytest.mark.parametrize(("operation", "values"), _VALUES)
def test_the_librarys_own_codec_reads_our_samples(operation: Operation[Any], values: tuple[Any, ...]) -> None:
    message = operation.request
    payload = CODEC.encoder(message)(values)
    sample = memoryview(Message(message).sample(payload))[:BEFORE_TAIL]
    fill_request(payload, 0, START, 1, 2500, 3, 4, 5, 6)
    kind = request_type(message.name, message)
    read = kind.deserialize(bytes(sample))
    header = read.header  # type: ignore[attr-defined]  # made at run time
    assert (header.flags, header.remaining_ms, header.fingerprint, header.client) == (1, 2500, 3, 4)
    again = read.serialize(use_version_2=False)
    assert bytes(sample[: len(again)]) == again
    assert len(sample) - len(again) < 4


@pytest.mark.parametrize("message", [e.echo_nested.response, e.echo_arrays.response, e.divide.response, e.poke.request])
@pytest.mark.parametrize("why", [b"", b"x", b"because"])
def test_failures_are_samples_of_the_replys_type(message: Struct, why: bytes) -> None:
    kind = Message(message)
    payload = Message(None).payload(_counted(why)) if why else None
    sample = kind.failure(payload)
    fill_reply(sample, 0, START, Status.FAILED, 1, 2, 3, 4)
    read = reply_type(message.name, message).deserialize(bytes(sample))
    assert bytes(read.error) == why  # type: ignore[attr-defined]
    assert reply_fields(sample) == (START, Status.FAILED, 1, 2, 3, 4)
    found = kind.why(bytes(sample))
    assert (b"" if found is None else bytes(found[44:])) == why


def _counted(octets: bytes) -> bytes:
    return bytes(44) + len(octets).to_bytes(4, "little") + octets


def test_members_may_have_any_name() -> None:
    fields = Field("header", Sequence(UINT8)), Field("lambda", INT32)
    made = publication_type("Odd::Names", Struct("Odd::Names", fields))
    assert list(made.__annotations__) == ["header", "header_", "lambda"]


# -- others -------------------------------------------------------------------


@contextlib.contextmanager
def stranger() -> Iterator[DomainParticipant]:
    """Somebody else on the domain, who uses the library as it is. There must be a transport of ours already."""
    participant = DomainParticipant(DOMAIN)
    try:
        yield participant
    finally:
        participant.__del__()


def _theirs(participant: DomainParticipant, name: str, kind: type[Any]) -> tuple[DataWriter[Any], DataReader[Any]]:
    qos = Qos(
        Policy.Reliability.Reliable(0),
        Policy.History.KeepAll,
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    made = Topic(participant, name, kind)
    return DataWriter(participant, made, qos), DataReader(participant, made, qos)


def test_a_stranger_reads_every_field_of_a_publication(here: DDSTransport, name: str) -> None:
    kind = type_of(e.divide, Pattern.PUBLISH)
    outlet = here.outlet(Channel(name, Pattern.PUBLISH, kind))
    with stranger() as participant:
        _, reader = _theirs(participant, f"rc/{name}", publication_type(kind.name, kind.request))
        assert outlet.wait_peer(SOON)
        outlet.send(CODEC.encoder(e.divide.request)((7, 3)))
        sample = _taken(reader)
    assert (sample.dividend, sample.divisor) == (7, 3)
    assert (sample.header.fingerprint, sample.header.sequence) == (e.divide.fingerprint, 1)
    assert abs(sample.header.stamp - time.time_ns()) < SOON * 1e9


@pytest.mark.parametrize("lazy", [False, True])
def test_a_stranger_may_ask(here: DDSTransport, name: str, lazy: bool) -> None:
    kind = type_of(e.divide, Pattern.QUERY)
    encode = CODEC.encoder(e.divide.response)
    channel = Channel(name, Pattern.QUERY, kind, lazy=lazy)
    server = here.server(channel, lambda payload, expires: Reply(Status.OK, encode((3, 1))))
    with stranger() as participant:
        writer, _ = _theirs(participant, f"rc/{name}Request", request_type(kind.name, kind.request))
        assert kind.response
        _, reader = _theirs(participant, f"rc/{name}Reply", reply_type(kind.response.name, kind.response))
        wait_until(lambda: writer.get_matched_subscriptions() and len(reader.get_matched_publications()) > 1)
        header = _made(request_type(kind.name, kind.request), "header")(
            version=1, flags=0, remaining_ms=5000, fingerprint=kind.fingerprint, client=5, sequence=9, stamp=0
        )
        request = request_type(kind.name, kind.request)
        wait_until(lambda: server._foreign_clients)
        writer.write(request(header=header, dividend=10, divisor=3))
        sample = _taken(reader)
    assert (sample.ret, sample.remainder) == (3, 1)
    assert (sample.header.client, sample.header.sequence, bytes(sample.error)) == (5, 9, b"")


def _made(kind: type[Any], member: str) -> Any:
    return kind.__annotations__[member]


def _taken(reader: DataReader[Any]) -> Any:
    found: list[Any] = []

    def come() -> bool:
        found.extend(each for each in reader.take(1) if hasattr(each, "header"))
        return bool(found)

    wait_until(come)
    return found[0]


def test_foreign_messages_are_dropped_counted_and_logged_once(
    here: DDSTransport, there: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    kind = type_of(e.divide, Pattern.PUBLISH)
    heard: list[Any] = []
    link = here.inlet(Channel(name, Pattern.PUBLISH, kind), heard.append)
    with stranger() as participant:
        made = publication_type(kind.name, kind.request)
        writer, _ = _theirs(participant, f"rc/{name}", made)
        wait_until(lambda: len(writer.get_matched_subscriptions()) > 1)
        header = made.__annotations__["header"](version=99, fingerprint=1, source=2, sequence=3, stamp=4)
        for _ in range(5):
            writer.write(made(header=header, dividend=1, divisor=1))
        wait_until(lambda: link.stats.malformed == 5)
    assert heard == []
    assert sum("malformed" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("where", ["as it is", "on a machine without network"])
@pytest.mark.parametrize("what", ["ls", "typeof"])
def test_the_librarys_tool_shows_topics_and_fields(here: DDSTransport, name: str, what: str, where: str) -> None:
    here.outlet(Channel(name, Pattern.PUBLISH, type_of(e.echo_nested, Pattern.PUBLISH)))
    environment = os.environ | {"COLUMNS": "200", "NO_COLOR": "1"}
    if where != "as it is":
        loopback = '<General><Interfaces><NetworkInterface name="lo"/></Interfaces></General>'
        environment["CYCLONEDDS_URI"] = environment.get("CYCLONEDDS_URI", "") + loopback
    tool = Path(sys.executable).with_name("cyclonedds")
    call = [tool, what, "--id", str(DOMAIN), *(["--topic", f".*{name}.*"] if what == "ls" else [f"rc/{name}"])]
    expected = {
        "ls": [f"rc/{name}", "Conformance::EverythingEchoNestedPublication"],
        "typeof": ["robocomp::PublicationHeader header", "Conformance::Nested value", "long long fingerprint"],
    }[what]

    def shown() -> bool:
        """It looks for a second, which may be too short for a busy machine."""
        text = subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout
        return all(each in text for each in expected)

    wait_until(shown, SOON * 3)


def test_the_librarys_tool_shows_the_values_of_what_is_published(here: DDSTransport, name: str) -> None:
    outlet = here.outlet(Channel(name, Pattern.PUBLISH, type_of(e.echo_nested, Pattern.PUBLISH)))
    value = e.Nested(points=[e.Point(1.5, -2.5)], names=["north", ""], by_number={3: "three"})
    message = CODEC.encoder(e.echo_nested.request)((value,))
    expected = (
        f"fingerprint={e.echo_nested.fingerprint}",
        "points=[Point(x=1.5, y=-2.5)]",
        "names=['north', '']",
        "(key=3, value='three')",
    )
    tool = Path(sys.executable).with_name("cyclonedds")
    call = [tool, "subscribe", "--id", str(DOMAIN), "--suppress-progress-bar", "--qos", "scan-random", f"rc/{name}"]
    environment = os.environ | {"COLUMNS": "200", "NO_COLOR": "1", "PYTHONUNBUFFERED": "1"}
    lines: list[str] = []
    with subprocess.Popen(call, env=environment, stdout=subprocess.PIPE, text=True) as process:

        def shown() -> bool:
            outlet.send(message)
            return all(any(each in line for line in lines) for each in expected)

        reader = threading.Thread(target=lambda: [lines.append(line) for line in process.stdout or ()])
        reader.start()
        try:
            wait_until(shown, SOON * 3)
        finally:
            process.kill()
            reader.join()


def test_octets_travel_where_the_fields_are_not_known(here: DDSTransport, there: DDSTransport, name: str) -> None:
    unknown = TypeRef("Unknown::Thing", 7, "text")
    here.server(replace(query(name), type=unknown), answering(here, bytes.upper))
    caller = there.caller(replace(query(name), type=unknown))
    assert caller.wait_peer(SOON)
    assert unblob(there, caller.ask(blob(there, b"abcde"), SOON).payload) == b"ABCDE"
    inbox = _inbox(here, replace(topic(name + "t"), type=unknown))
    outlet = there.outlet(replace(topic(name + "t"), type=unknown))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(there, b"xyz"))
    wait_until(lambda: inbox == [b"xyz"])


# -- channels -----------------------------------------------------------------


@pytest.mark.parametrize("pattern", ["query", "command"])
def test_a_star_takes_any_server_and_the_next_one_when_that_leaves(
    there: DDSTransport, name: str, pattern: str
) -> None:
    instance, rest = name.split("/", 1)
    anyone = f"*/{rest}{instance}"
    asking: Any = there.caller(query(anyone)) if pattern == "query" else there.outlet(command(anyone))
    for instance_name in ("one", "two"):
        with _opened() as serving:
            concrete = f"{instance_name}/{rest}{instance}"
            if pattern == "query":
                serving.server(query(concrete), answering(serving, lambda data, n=instance_name: n.encode()))  # type: ignore[misc]
            else:
                inbox = _inbox_of_commands(serving, concrete)
            assert asking.wait_peer(SOON)
            if pattern == "query":
                assert unblob(there, asking.ask(blob(there, b""), SOON).payload) == instance_name.encode()
            else:
                asking.send(blob(there, b"do"))
                wait_until(lambda: inbox == [b"do"])  # noqa: B023 - waited for in the loop
        wait_until(lambda: not asking.wait_peer(0.0))
        with pytest.raises(Unreachable):
            asking.ask(blob(there, b""), SOON) if pattern == "query" else asking.send(blob(there, b""))


def _inbox_of_commands(transport: DDSTransport, name: str) -> list[bytes]:
    inbox: list[bytes] = []
    transport.inlet(command(name), lambda payload: inbox.append(unblob(transport, payload)))
    return inbox


def test_a_call_that_waited_for_its_server_to_be_found_ends_no_later_for_that(
    here: DDSTransport, there: DDSTransport, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here.server(query(name), lambda payload, expires: Future())
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)
    begun = time.monotonic() - 3600
    monkeypatch.setattr(client_module, "monotonic", lambda: begun)  # it has taken an hour until now
    with pytest.raises(Timeout):
        caller.call(blob(there, b""), 3600).result(SOON)


def _lazy(name: str, **more: Any) -> Channel:
    return replace(query(name), lazy=True, **more)


def test_lazy_links_have_no_readers_and_writers_until_a_request(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    with here.gathering():
        links = [here.server(_lazy(f"{name}{n}"), answering(here, bytes.upper)) for n in range(3)]
    wait_until(lambda: len([n for n in range(3) if there.bus.endpoints.find("serves", f"{name}{n}")]) == 3)
    assert len({each.handle for n in range(3) for each in there.bus.endpoints.find("serves", f"{name}{n}")}) == 1
    assert not any(there.bus.endpoints.on_topic(f"rc/{name}{n}{end}") for n in range(3) for end in ("Request", "Reply"))

    caller = there.caller(query(f"{name}1"))
    assert unblob(there, caller.ask(blob(there, b"x"), SOON).payload) == b"X"
    assert not there.bus.endpoints.on_topic(f"rc/{name}0Request")

    for each in links:
        each.close()
    wait_until(lambda: not any(there.bus.endpoints.find("serves", f"{name}{n}") for n in range(3)))
    with pytest.raises(Unreachable):
        caller.ask(blob(there, b"x"), SOON)


def test_what_is_lazy_is_served_once_and_under_one_contract(
    here: DDSTransport, there: DDSTransport, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "LEAVING", 0.0)  # no process does
    here.server(_lazy(name, exclusive=False), answering(here, bytes.upper))
    wait_until(lambda: there.bus.endpoints.find("serves", name))
    with pytest.raises(AlreadyServed):
        there.server(_lazy(name, exclusive=False), answering(there, bytes.lower))
    caller = there.caller(Channel(name, Pattern.QUERY, type_of(e.divide, Pattern.QUERY)))
    with pytest.raises(ContractMismatch):
        caller.wait_peer(SOON)


def test_an_announcement_with_a_duplicate_is_withdrawn_completely(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    link = here.server(_lazy(name), answering(here, bytes.upper))
    [said] = here.announcing._descriptions.values()
    (about,) = endpoints_module.announced_data([said, said])
    writer = here.bus.writer(announcing_module.NAME, announcement_type(), endpoint_qos(KEEP_ALL, about))
    wait_until(lambda: len(there.bus.endpoints.find("serves", name)) == 2)  # that of the transport, and the other one
    link.close()
    writer.close()
    wait_until(lambda: not there.bus.endpoints.find("serves", name))


def test_many_long_contracts_are_announced_whole(here: DDSTransport, there: DDSTransport, name: str) -> None:
    link = here.server(_lazy(name), answering(here, bytes.upper))
    [said] = here.announcing._descriptions.values()
    texts = {f"{name}{number}": secrets.token_hex(3000) for number in range(12)}
    with here.announcing.gathering():
        for channel, text in texts.items():
            here.announcing.add(channel, said | {"channel": channel, "text": text})

    def found(channel: str) -> list[str]:
        return [each.text for each in there.bus.endpoints.find("serves", channel)]

    wait_until(lambda: all(found(channel) == [text] for channel, text in texts.items()))
    for channel in texts:
        here.announcing.remove(channel)
    wait_until(lambda: not any(map(found, texts)))
    assert found(name) == [said["text"]]
    link.close()


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"id": 1e999}',
        '{"id": Infinity}',
        '{"id": []}',
        "[1]",
        "1",
        "half",
        pytest.param("[" + "{}," * 20_000_000 + "{}]", id="60 MB"),
    ],
)
def test_what_strangers_say_of_themselves_may_be_anything(text: str) -> None:
    assert endpoints_module._said(endpoints_module._MARK + zlib.compress(text.encode())) == [{}]


def test_a_client_of_any_instance_finds_a_lazy_server(here: DDSTransport, there: DDSTransport, name: str) -> None:
    instance, rest = name.split("/", 1)
    here.server(_lazy(f"one/{rest}{instance}"), answering(here, bytes.upper))
    caller = there.caller(query(f"*/{rest}{instance}"))
    assert caller.wait_peer(SOON)
    assert unblob(there, caller.ask(blob(there, b"x"), SOON).payload) == b"X"


def test_a_reliable_publisher_is_no_further_ahead_than_its_reader_takes(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    release, got = threading.Event(), []

    def sink(payload: Any) -> None:
        release.wait(SOON * 3)
        got.append(unblob(there, payload))

    there.inlet(topic(name, _RELIABLE), sink)
    outlet = here.outlet(topic(name, _RELIABLE))
    wait_until(lambda: outlet._greeted)  # type: ignore[union-attr]
    with pytest.raises(Timeout, match="did not keep up"):
        _flood(here, outlet)
    release.set()
    wait_until(lambda: len(got) == 8)
    outlet.send(blob(here, b"\x08"), SOON)
    wait_until(lambda: got == [bytes([number]) for number in range(9)])


def _flood(transport: DDSTransport, outlet: Outlet) -> None:
    for number in range(100):
        outlet.send(blob(transport, bytes([number])), 0.2)


def test_a_reader_that_leaves_frees_its_publisher(here: DDSTransport, there: DDSTransport, name: str) -> None:
    release = threading.Event()
    link = there.inlet(topic(name, _RELIABLE), lambda _: release.wait(SOON * 3))
    outlet = here.outlet(topic(name, _RELIABLE))
    wait_until(lambda: outlet._greeted)  # type: ignore[union-attr]
    with pytest.raises(Timeout):
        _flood(here, outlet)
    threading.Timer(0.2, release.set).start()
    link.close()
    for _ in range(20):
        outlet.send(blob(here, b"x"), SOON)


def test_a_latched_subscriber_receives_from_latched_and_other_publishers(
    here: DDSTransport, there: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    keeping, forgetful = here.outlet(topic(name, _LATCHED)), here.outlet(topic(name, _RELIABLE))
    for number in range(3):
        keeping.send(blob(here, b"kept %d" % number))
        forgetful.send(blob(here, b"never heard"))
    inbox: list[bytes] = []
    link = there.inlet(topic(name, _LATCHED), lambda payload: inbox.append(unblob(there, payload)))
    assert forgetful.wait_peer(SOON)
    for number in range(3):
        forgetful.send(blob(here, b"news %d" % number))
        keeping.send(blob(here, b"more %d" % number))
    wait_until(lambda: len(inbox) == 8)
    assert [each for each in inbox if b"news" in each] == [b"news 0", b"news 1", b"news 2"]
    assert [each for each in inbox if b"news" not in each] == [b"kept 1", b"kept 2", b"more 0", b"more 1", b"more 2"]
    assert (link.stats.lost, link.stats.repeated) == (0, 0)
    complaints = [record.getMessage() for record in caplog.records if "keeps less than" in record.message]
    assert len(complaints) == 1
    assert 'durability = "volatile"' in complaints[0]


def test_what_a_best_effort_publisher_sends_to_a_slow_reliable_subscriber_is_bounded_and_counted(
    here: DDSTransport, there: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    begun, release = threading.Event(), threading.Event()

    def sink(payload: Any) -> None:
        begun.set()
        release.wait(SOON * 3)

    link = there.inlet(topic(name, _RELIABLE), sink)
    outlet = here.outlet(topic(name, QoS(depth=5000)))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, b""))
    assert begun.wait(SOON)
    for _ in range(MESSAGES_WAITING + 500):
        outlet.send(blob(here, b""))

    def all_there() -> bool:
        outlet.send(blob(here, b""))
        return link.stats.dropped >= 300

    wait_until(all_there)
    release.set()
    wait_until(lambda: link.stats.received + link.stats.dropped + link.stats.lost >= MESSAGES_WAITING + 500)
    assert "`reliable` is asked for, `best_effort` is offered" in caplog.text
    assert 'reliability = "best_effort"' in caplog.text


def test_the_bytes_that_wait_for_a_slow_subscriber_are_bounded(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    release, heard = threading.Event(), list[int]()

    def sink(payload: Any) -> None:
        release.wait(SOON * 3)
        heard.append(len(payload))

    link = there.inlet(topic(name, _RELIABLE), sink)
    outlet = here.outlet(topic(name))
    assert outlet.wait_peer(SOON)
    large = blob(here, bytes(BYTES_WAITING // 16))

    def one_too_many() -> bool:
        outlet.send(large)
        return link.stats.dropped > 0

    wait_until(one_too_many)
    release.set()
    wait_until(lambda: len(heard) >= _RELIABLE.depth)
    in_the_library = 8
    assert sum(heard) <= BYTES_WAITING + (2 + in_the_library) * len(large)


def test_a_publisher_that_counts_is_heard_beside_one_that_does_not(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    release, inbox = threading.Event(), []

    def sink(payload: Any) -> None:
        release.wait(SOON * 3)
        inbox.append(unblob(there, payload))

    link = there.inlet(topic(name, _RELIABLE), sink)
    careless, careful = here.outlet(topic(name, QoS(depth=5000))), here.outlet(topic(name, _RELIABLE))
    wait_until(lambda: careful._greeted)  # type: ignore[union-attr]
    assert careless.wait_peer(SOON)

    def full() -> bool:
        careless.send(blob(here, b"careless"))
        return link.stats.dropped > 0

    wait_until(full)
    for number in range(8):
        careful.send(blob(here, b"careful %d" % number), SOON)
    release.set()
    wait_until(lambda: b"careful 7" in inbox)
    assert [each for each in inbox if b"careful" in each] == [b"careful %d" % number for number in range(8)]


def test_a_client_for_which_the_server_has_no_room_gets_busy(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    under_way: list[Future[Reply]] = []

    def service(payload: Any, expires: float) -> Future[Reply]:
        under_way.append(Future())
        return under_way[-1]

    link = here.server(query(name), service)
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)
    asked = [caller.call(blob(there, b""), SOON * 6) for _ in range(QUERIES_WAITING)]
    wait_until(lambda: len(under_way) == QUERIES_WAITING)
    assert caller.ask(blob(there, b""), SOON).status is Status.BUSY
    assert caller.call(blob(there, b""), SOON).result(SOON).status is Status.BUSY
    assert link.stats.dropped == 2
    for each in under_way[:QUERIES_WAITING]:
        each.set_result(Reply(Status.OK, blob(here, b"at last")))
    assert {each.result(SOON).status for each in asked} == {Status.OK}
    last = caller.call(blob(there, b""), SOON)
    wait_until(lambda: len(under_way) == QUERIES_WAITING + 1)
    under_way[-1].set_result(Reply(Status.OK))
    assert last.result(SOON).status is Status.OK


def test_requests_that_are_never_answered_stop_counting_when_they_expire(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    begun: list[None] = []

    def service(payload: Any, expires: float) -> Reply | Future[Reply]:
        if unblob(here, payload) == b"stuck":
            begun.append(None)
            return Future()
        return Reply(Status.OK, blob(here, b""))

    here.server(query(name), service)
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)

    def asked_in_vain() -> bool:
        asked = [caller.call(blob(there, b"stuck"), SCALE * 2) for _ in range(QUERIES_WAITING)]
        for each in asked:
            with pytest.raises(Timeout):
                in_time(each.result(SOON))
        return bool(begun)

    wait_until(asked_in_vain)
    wait_until(lambda: caller.ask(blob(there, b"x"), SOON).status is Status.OK)


def test_a_server_with_many_slow_requests_stalls_no_other_of_its_process(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    """Between any two requests that are begun the others have their turn."""
    release, begun = threading.Event(), threading.Semaphore(0)
    order: list[str] = []

    def slow(payload: Any, expires: float) -> Reply:
        order.append("slow")
        begun.release()
        release.wait(SOON * 3)
        return Reply(Status.OK, blob(here, b""))

    def quick(payload: Any, expires: float) -> Reply:
        order.append("quick")
        return Reply(Status.OK, blob(here, b""))

    here.server(query(name + "slow"), slow)
    here.server(query(name + "quick"), quick)
    slowly, quickly = there.caller(query(name + "slow")), there.caller(query(name + "quick"))
    for each in (slowly, quickly):
        assert each.wait_peer(SOON)
    asked = [slowly.call(blob(there, b""), SOON * 6) for _ in range(500)]
    assert begun.acquire(timeout=SOON)
    assert quickly.ask(blob(there, b""), SOON).status is Status.OK
    release.set()
    assert {each.result(SOON * 3).status for each in asked} == {Status.OK}
    assert order.index("quick") < 400


def test_no_command_goes_to_a_server_that_left_though_dds_has_not_told_yet(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    outlet = there.outlet(command(name))
    inlet = here.inlet(command(name), lambda _: None)
    assert outlet.wait_peer(SOON)
    outlet.send(blob(there, b"heard"))
    tell, late = there.bus.endpoints.on_change, list[threading.Timer]()

    def tell_late(channels: Set[str]) -> None:
        late.append(threading.Timer(0.1, tell, [channels]))
        late[-1].start()

    there.bus.endpoints.on_change = tell_late
    inlet.close()
    with pytest.raises(Unreachable):
        outlet.send(blob(there, b"nobody"))
    there.bus.endpoints.on_change = tell
    for each in late:
        each.join()


def test_commands_beyond_the_limit_are_dropped_counted_and_logged_once(
    here: DDSTransport, there: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    release, begun = threading.Event(), threading.Event()
    done: list[None] = []

    def sink(payload: Any) -> None:
        begun.set()
        release.wait(SOON * 3)
        done.append(None)

    link = here.inlet(command(name), sink)
    outlet = there.outlet(command(name))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(there, b""), SOON * 3)
    assert begun.wait(SOON)
    for _ in range(COMMANDS_WAITING + 50):
        outlet.send(blob(there, b""), SOON * 3)
    wait_until(lambda: link.stats.dropped == 50)
    release.set()
    wait_until(lambda: len(done) == COMMANDS_WAITING + 1)
    assert sum("commands wait" in record.message for record in caplog.records) == 1


def test_the_error_of_a_second_server_names_the_first(here: DDSTransport, there: DDSTransport, name: str) -> None:
    here.server(query(name), answering(here, bytes.upper))
    with pytest.raises(TransportError, match=rf"already served by tester \(pid {os.getpid()}\)"):
        there.server(query(name), answering(there, bytes.upper))


def test_threads_that_ask_while_others_wait_get_their_own_answers(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    def service(payload: Any, expires: float) -> Reply:
        data = unblob(here, payload)
        time.sleep(0.001 * (data[0] % 3))
        return Reply(Status.OK, blob(here, data))

    here.server(query(name), service)
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)
    wrong: list[Any] = []

    def client(number: int) -> None:
        for turn in range(40):
            data = bytes([number, turn])
            payload = blob(there, data)
            reply = caller.call(payload, SOON).result(SOON) if turn % 4 == 0 else caller.ask(payload, SOON)
            if unblob(there, reply.payload) != data:
                wrong.append(data)

    threads = [threading.Thread(target=client, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_closing_the_transport_releases_waits_for_credit(here: DDSTransport, there: DDSTransport, name: str) -> None:
    release = threading.Event()
    there.inlet(topic(name, _RELIABLE), lambda _: release.wait(SOON * 3))
    outlet = here.outlet(topic(name, _RELIABLE))
    wait_until(lambda: outlet._greeted)  # type: ignore[union-attr]
    ended: list[BaseException] = []

    def flood() -> None:
        try:
            while True:
                outlet.send(blob(here, b"x"), SOON * 3)
        except TransportError as exc:
            ended.append(exc)

    thread = threading.Thread(target=flood)
    thread.start()
    wait_until(lambda: outlet._sent >= 8)  # type: ignore[union-attr]
    here.close()
    thread.join()
    release.set()
    assert isinstance(ended[0], Closed)


# -- processes ----------------------------------------------------------------


class _Elsewhere:
    """A function that runs with a transport in another process, until it is told to end or killed."""

    def __init__(self, work: Callable[..., None], *arguments: Any) -> None:
        self.ready, self.end, self.begun = processes.Event(), processes.Event(), processes.Event()
        self.process = start_process(work, self.ready, self.end, self.begun, *arguments)
        assert self.ready.wait(SOON * 3)

    def __enter__(self) -> _Elsewhere:
        return self

    def __exit__(self, *exc: object) -> None:
        if self.process.is_alive():  # an event whose waiter was killed cannot be set
            self.end.set()
        self.process.join(SOON)
        self.process.kill()
        self.process.join()


def _echo_elsewhere(
    ready: Any, end: Any, begun: Any, name: str, abrupt: bool = False, options: Mapping[str, Any] = MappingProxyType({})
) -> None:
    transport = DDSTransport(TransportConfig({"domain": DOMAIN, **options}, "elsewhere"))
    transport.server(query(name), answering(transport, bytes))
    outlet = transport.outlet(topic(name + "back", _RELIABLE))
    transport.inlet(
        topic(name + "to", _RELIABLE), lambda payload: outlet.send(blob(transport, unblob(transport, payload)), SOON)
    )
    ready.set()
    end.wait(SOON * 10)
    if abrupt:
        os._exit(1)
    transport.close()


@pytest.mark.parametrize("size", [0, 1, 65_535, 1_000_003, 64 * 1024 * 1024])
def test_questions_of_any_size_cross_processes(there: DDSTransport, name: str, size: int) -> None:
    with _Elsewhere(_echo_elsewhere, name):
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        sent = np.arange(size, dtype=np.uint8).tobytes()
        assert unblob(there, caller.ask(blob(there, sent), SOON * 3).payload) == sent


def test_a_reply_put_aside_while_its_client_is_found_is_sent(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
    server: Any = here.server(query(name), answering(here, bytes.upper))
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)
    assert unblob(there, caller.ask(blob(there, b"x"), SOON).payload) == b"X"

    class FoundNow(dict[int, Any]):
        """The known clients, a moment after a look for one, and one to put a reply aside for."""

        looks = 0

        def get(self, client: int, default: Any = None) -> Any:
            self.looks += 1
            return None if self.looks <= 2 else super().get(client, default)

    server._clients = FoundNow(server._clients)
    assert unblob(there, caller.ask(blob(there, b"y"), SOON).payload) == b"Y"


@pytest.mark.parametrize("beside", ["nobody", "a future"])
def test_a_client_that_gives_up_does_not_lose_the_replies_of_others(
    here: DDSTransport, there: DDSTransport, name: str, beside: str
) -> None:
    """Who asks first receives for all; when that one has left, the others get theirs nevertheless."""
    asked: dict[bytes, Future[Reply]] = {}

    def service(payload: Any, expires: float) -> Future[Reply]:
        return asked.setdefault(unblob(here, payload), Future())

    here.server(query(name), service)
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)
    with ThreadPoolExecutor() as pool:
        hasty = pool.submit(caller.ask, blob(there, b"hasty"), 0.2)
        wait_until(lambda: b"hasty" in asked)
        patient = [pool.submit(caller.ask, blob(there, b"patient %d" % number), SOON * 2) for number in range(3)]
        future = caller.call(blob(there, b"later"), SOON * 2) if beside == "a future" else None
        wait_until(lambda: len(asked) == 4 + bool(future))
        assert isinstance(hasty.exception(SOON), Timeout)
        for question, answer in asked.items():
            answer.set_result(Reply(Status.OK, blob(here, question)))
        for number, each in enumerate(patient):
            assert unblob(there, each.result(SOON).payload) == b"patient %d" % number
        if future:
            assert unblob(there, future.result(SOON).payload) == b"later"


def test_a_question_right_after_the_server_was_seen_is_answered(there: DDSTransport, name: str) -> None:
    caller = there.caller(query(name))
    with _Elsewhere(_echo_elsewhere, name):
        wait_until(lambda: there.bus.endpoints.find("serves", name))
        assert unblob(there, caller.ask(blob(there, b"at once"), SOON).payload) == b"at once"


def test_reliable_messages_cross_processes_without_loss(there: DDSTransport, name: str) -> None:
    with _Elsewhere(_echo_elsewhere, name):
        inbox = _inbox(there, topic(name + "back", _RELIABLE))
        outlet = there.outlet(topic(name + "to", _RELIABLE))
        assert outlet.wait_peer(SOON)
        wait_until(lambda: there.bus.endpoints.find("publishes", name + "back"))
        sent = [b"hello" for _ in range(3)]
        while not inbox:
            outlet.send(blob(there, b"hello"), SOON)
            time.sleep(0.01)
        sent = [str(number).encode() + bytes(20_000) for number in range(500)]
        for message in sent:
            outlet.send(blob(there, message), SOON)
        wait_until(lambda: inbox and inbox[-1] == sent[-1])
        assert [message for message in inbox if message != b"hello"] == sent


@pytest.mark.parametrize("how", ["clean", "abrupt"])
def test_calls_to_a_server_whose_process_ended_are_unreachable(there: DDSTransport, name: str, how: str) -> None:
    with _Elsewhere(_echo_elsewhere, name, how == "abrupt") as other:
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        other.end.set()

        def gone() -> bool:
            try:
                caller.ask(blob(there, b""), SOON)
            except Unreachable:
                return True
            return False

        wait_until(gone)


def test_a_second_server_in_another_process_is_refused_until_that_is_killed(there: DDSTransport, name: str) -> None:
    with _Elsewhere(_echo_elsewhere, name) as other:
        with pytest.raises(TransportError, match=rf"already served by elsewhere \(pid {other.process.pid}\)"):
            there.server(query(name), answering(there, bytes))
        other.process.kill()
        other.process.join()

        def served() -> bool:
            try:
                there.server(query(name), answering(there, bytes))
            except TransportError:
                return False
            return True

        wait_until(served)


def test_the_successor_of_a_killed_server_serves_at_the_first_try(
    there: DDSTransport, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "LEAVING", 0.0)  # we hear late of it
    with _Elsewhere(_echo_elsewhere, name) as other:
        wait_until(lambda: there.bus.endpoints.find("serves", name))
        other.process.kill()
        other.process.join()
        there.server(query(name), answering(there, bytes.upper))
    caller = there.caller(query(name))
    assert caller.wait_peer(SOON)
    assert unblob(there, caller.ask(blob(there, b"next"), SOON).payload) == b"NEXT"


def test_a_participant_without_remote_peers_is_not_reachable_from_other_hosts(there: DDSTransport) -> None:
    """Its sockets are those of the loopback interface, though the library opens them for all addresses."""
    first = 7400 + 250 * there.bus.participant.domain_id  # by the standard, 9.6.2.3
    heard = set()
    for number in _udp_sockets():
        with socket.socket(fileno=os.dup(number)) as each:
            if first <= each.getsockname()[1] < first + 250:
                heard.add(each.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16))
    assert heard == {b"lo\0"}


@pytest.mark.parametrize(
    ("senders", "apart"),
    [(["127.0.0.1"], True), (["127.0.0.1", "192.0.2.7"], False), (["192.0.2.7"], False), ([], False)],
)
def test_a_participant_with_remote_peers_is_reachable_from_them(senders: list[str], apart: bool) -> None:
    """Several interfaces may be named in CYCLONEDDS_URI."""
    with contextlib.ExitStack() as undo:
        sockets = [undo.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(len(senders) + 1)]
        addresses = ["0.0.0.0", *senders]
        _keep_to_loopback({each.fileno(): address for each, address in zip(sockets, addresses, strict=True)})
        heard = [each.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16) for each in sockets]
    assert heard == [b"lo\0" if apart else b"", *(b"" for _ in senders)]


@pytest.mark.parametrize("ask", ["ask", "call"])
def test_a_server_that_is_killed_ends_the_calls_under_way(there: DDSTransport, name: str, ask: str) -> None:
    """By the library's lease of 2 s: a call with a later deadline ends as `Unreachable`, not `Timeout`."""
    assert settings("lo")["Discovery", "LeaseDuration"] == "2s"
    with _Elsewhere(_stuck_elsewhere, name) as other:
        caller = there.caller(query(name))
        assert caller.wait_peer(SOON)
        ended: list[BaseException] = []

        def wait() -> None:
            try:
                if ask == "ask":
                    caller.ask(blob(there, b""), SOON * 3)
                else:
                    caller.call(blob(there, b""), SOON * 3).result()
            except TransportError as exc:
                ended.append(exc)

        thread = threading.Thread(target=wait)
        thread.start()
        assert other.begun.wait(SOON)
        other.process.kill()
        thread.join()
    assert [type(each) for each in ended] == [Unreachable]


def _stuck_elsewhere(ready: Any, end: Any, begun: Any, name: str) -> None:
    transport = DDSTransport(TransportConfig({"domain": DOMAIN}, "elsewhere"))

    def service(payload: Any, expires: float) -> Future[Reply]:
        begun.set()
        return Future()

    transport.server(query(name), service)
    ready.set()
    end.wait(SOON * 10)
    transport.close()


def test_the_claim_of_a_killed_server_is_claimed_again_and_removed_in_the_end(there: DDSTransport, name: str) -> None:
    claim = there.folder / f"{name.replace('/', '.')}.lock"
    with _Elsewhere(_stuck_elsewhere, name) as other:
        assert claim.exists()
        other.process.kill()
        other.process.join()
    assert claim.exists()
    wait_until(lambda: not there.bus.endpoints.find("serves", name))
    link = there.server(query(name), answering(there, bytes))
    assert claim.exists()
    link.close()
    assert not claim.exists()


def _ways_out() -> list[str]:
    """The network interfaces by which this host reaches others. Those that tests make, and remove, are none of them."""
    rows: list[list[str]] = []
    with contextlib.suppress(OSError), open("/proc/net/route", encoding="ascii") as table:  # Linux has it
        rows = [line.split() for line in list(table)[1:]]
    return sorted({name for name, destination, *_ in rows if destination == "00000000" and address_of(name)})


_NETWORKS = _ways_out()


@pytest.mark.parametrize("network", ["", *_NETWORKS])
def test_two_processes_talk_over_another_network_than_this_hosts_own(name: str, network: str) -> None:
    options = {"domain": 75, "interface": network}
    mine = DDSTransport(TransportConfig(options, "tester"))
    with contextlib.closing(mine), _Elsewhere(_echo_elsewhere, name, False, options):
        caller, inbox = mine.caller(query(name)), _inbox(mine, topic(name + "back", _RELIABLE))
        outlet = mine.outlet(topic(name + "to", _RELIABLE))
        assert caller.wait_peer(SOON)
        assert outlet.wait_peer(SOON)
        sent = bytes(range(256)) * 4000
        assert unblob(mine, caller.ask(blob(mine, sent), SOON).payload) == sent
        wait_until(lambda: mine.bus.endpoints.find("publishes", name + "back"))

        def heard() -> bool:
            outlet.send(blob(mine, b"hello"), SOON)
            return bool(inbox)

        wait_until(heard)


def test_a_program_that_forgets_to_close_ends_nevertheless(name: str) -> None:
    out, code = _run(
        "t, u = (DDSTransport(TransportConfig(OWN, 'forgetful')) for _ in range(2))",
        f"t.server(query({name!r}), answering(t, bytes.upper)); c = u.caller(query({name!r}))",
        "assert c.wait_peer(SOON)",
        "print(unblob(u, c.ask(blob(u, b'x'), SOON).payload).decode())",
    )
    assert (out, code) == ("X\n", 0)


def test_forked_processes_end_and_their_calls_raise_errors(name: str) -> None:
    doings = {
        "None": "",
        "t.close()": "",
        "c.ask(blob(t, b'x'), SOON)": "Closed: {name}: it was opened before this process was forked",
        "o.send(blob(t, b'x'))": "Closed: {name}t: it was opened before this process was forked",
        "t.caller(query('a/b/c'))": "Closed: the transport is closed: it was opened before this process was forked",
        "DDSTransport(TransportConfig())": "TransportError: dds: Cyclone DDS was in use when this process was forked",
    }
    out, code = _run(
        "t = DDSTransport(TransportConfig(OWN, 'forking'))",
        f"t.server(query({name!r}), answering(t, bytes.upper)); c = t.caller(query({name!r}))",
        f"o = t.outlet(topic({name + 't'!r}))",
        "assert c.wait_peer(SOON)",
        f"for do in ({', '.join(f'lambda: {each}' for each in doings)}):",
        "    child = os.fork()",
        "    if child == 0:",
        "        try:",
        "            do()",
        "            print(flush=True)",
        "        except TransportError as exc:",
        "            print(f'{type(exc).__name__}: {exc}', flush=True)",
        "        sys.exit(7)",
        "    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7",
        "    assert unblob(t, c.ask(blob(t, b'fine'), SOON).payload) == b'FINE'",
        "t.close()",
    )
    assert code == 0
    outcomes = [each.format(name=name) for each in doings.values()]
    assert [line[: len(each)] for line, each in zip(out.splitlines(), outcomes, strict=True)] == outcomes


def _run(*lines: str) -> tuple[str, int]:
    """What a program prints, and how it ends."""
    imports = (
        "import os, sys",
        "from robocomp_py.errors import *",
        "from robocomp_py.transports.dds.transport import DDSTransport",
        "from robocomp_py.transports.base import TransportConfig",
        "from robocomp_py.testing.conformance import answering, blob, query, topic, unblob",
        "from robocomp_py.testing.patience import SOON",
        f"OWN = {{'domain': {DOMAIN}}}",
    )
    call = [sys.executable, "-c", "\n".join((*imports, *lines))]
    done = subprocess.run(call, stdout=subprocess.PIPE, text=True, timeout=SOON * 3)
    return done.stdout, done.returncode


# -- domains ------------------------------------------------------------------


def test_nothing_is_left_after_close(name: str) -> None:
    def held() -> tuple[int, int, set[str], int]:
        gc.collect()
        folder = Path(os.environ["ROBOCOMP_RUNTIME_DIR"], "dds")
        files = {path.name for path in folder.iterdir()} if folder.exists() else set()
        return len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")), files, len(Entity._entities)

    _use_everything(name)  # what is opened once and kept
    before = held()
    for _ in range(3):
        _use_everything(name)
    # what a test before this one left to be freed may be gone by now
    wait_until(lambda: all(now <= then for now, then in zip(held(), before, strict=True)))


def _use_everything(name: str) -> None:
    with _opened() as here, _opened() as there:
        here.server(query(name), answering(here, bytes))
        caller = there.caller(query(name))
        _inbox(here, topic(name + "t", _RELIABLE))
        outlet = there.outlet(topic(name + "t", _RELIABLE))
        assert caller.wait_peer(SOON)
        assert outlet.wait_peer(SOON)
        outlet.send(blob(there, b"x"))
        caller.ask(blob(there, b"x"), SOON)
        caller.call(blob(there, b"x"), SOON).result(SOON)


def test_many_ask_each_other_less_often_whether_they_got_everything() -> None:
    few, many = settings("lo"), settings("lo", many=True)
    assert many == few | {("Internal", "HeartbeatInterval"): "500ms"}
    DDSTransport(TransportConfig({"domain": 78, "many": True})).close()  # the library knows it


def test_the_users_settings_win_and_the_rest_is_ours() -> None:
    ours = settings("lo")
    uri = "<General><AllowMulticast>true</AllowMulticast></General>"
    uri += "<Discovery><SPDPInterval>5s</SPDPInterval></Discovery>"
    both = compose(ours, uri, 0)
    assert both.endswith("," + uri)
    mine = both[: -len(uri)]
    assert "AllowMulticast" not in mine
    assert "SPDPInterval" not in mine
    assert "LeaseDuration" in mine


@pytest.mark.parametrize(
    "uri",
    [
        '<CycloneDDS><Domain Id="any">{}</Domain></CycloneDDS>',
        '<?xml version="1.0"?><CycloneDDS xmlns="https://cdds.io/config"><Domain Id="3">{}</Domain></CycloneDDS>',
    ],
)
@pytest.mark.parametrize("as_file", [False, True])
def test_the_users_network_replaces_all_of_ours(uri: str, as_file: bool, tmp_path: Path) -> None:
    uri = uri.format('<General><Interfaces><NetworkInterface name="eth0"/></Interfaces></General>')
    if as_file:
        path = tmp_path / "settings.xml"
        path.write_text(uri)
        uri = f"file://{path}"
    both = compose(settings("lo"), uri, 3)
    mine = both[: -len(uri)]
    for each in ("Interfaces", "Peers", "AllowMulticast"):
        assert each not in mine


def test_settings_for_another_domain_are_not_ours_to_make_way_for() -> None:
    uri = '<CycloneDDS><Domain Id="3"><Discovery><SPDPInterval>5s</SPDPInterval></Discovery></Domain></CycloneDDS>'
    assert "<SPDPInterval>1s" in compose(settings("lo"), uri, 0)


def test_settings_of_the_user_reach_the_library(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    trace = tmp_path / "trace.log"
    monkeypatch.setenv(
        "CYCLONEDDS_URI", f"<Tracing><Verbosity>config</Verbosity><OutputFile>{trace}</OutputFile></Tracing>"
    )
    DDSTransport(TransportConfig({"domain": 77})).close()
    text = trace.read_text()
    assert "SPDPInterval" in text
    assert "65500" in text


@pytest.mark.parametrize(("limit", "told"), [("212992", "limited to 212 KB"), ("4194304", ""), ("", "")])
def test_small_socket_buffers_are_reported_with_a_remedy(limit: str, told: str) -> None:
    note = note_on_sockets(limit)
    assert (told in note) if told else not note
    assert "rmem_max=20000000" in note or not told


@pytest.mark.parametrize(
    ("uri", "complaint"),
    [
        ("<General>", r"CYCLONEDDS_URI: not well-formed XML: mismatched tag \(line 1, column 12\)"),
        ("<General>\n  <Oops</General>", r"not well-formed \(invalid token\) \(line 2, column 8\)"),
        ('<?xml version="1.0"?><A>\n</B>', r"mismatched tag \(line 2, column 3\)"),
        ('<?xml version="1.0"?><A></B>', r"mismatched tag \(line 1, column 27\)"),
        ("file:///nowhere.xml", "No such file"),
        ("<!-- ü -->", "ASCII"),
        ("<General><Nonsense/></General>", r"CYCLONEDDS_URI: CycloneDDS/Domain/General: Nonsense: unknown element$"),
    ],
)
def test_settings_that_make_no_sense_are_named(uri: str, complaint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", uri)
    with pytest.raises(ConfigurationError, match=complaint):
        DDSTransport(TransportConfig({"domain": 78}))


@pytest.mark.parametrize("options", [{"domain": -1}, {"domain": "0"}, {"interface": 3}, {"port": 1}, {"many": 60}])
def test_options_that_make_no_sense_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        DDSTransport(TransportConfig(options))


def test_a_network_that_is_not_there_is_an_error_that_names_those_that_are() -> None:
    with pytest.raises(TransportError, match=r"opening domain 79: nowhere0: does not match .*available: .*\blo\b"):
        DDSTransport(TransportConfig({"domain": 79, "interface": "nowhere0"}))


def test_one_process_too_many_gets_an_error_with_a_remedy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "<Discovery><MaxAutoParticipantIndex>1</MaxAutoParticipantIndex></Discovery>")
    complaint = r"participant index.*another `domain`.*MaxAutoParticipantIndex"
    with _Elsewhere(_echo_elsewhere, name, False, {"domain": 74}), pytest.raises(TransportError, match=complaint):
        DDSTransport(TransportConfig({"domain": 74}))
    DDSTransport(TransportConfig({"domain": 74})).close()


def test_without_threads_it_is_not_opened_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def threads() -> int:
        return len(os.listdir("/proc/self/task"))

    before = threads()

    def fail(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", fail)
        with pytest.raises(TransportError, match="no thread can be started"):
            DDSTransport(TransportConfig({"domain": 73}))
    wait_until(lambda: threads() <= before)  # those of a test before this one may have been on their way out
    DDSTransport(TransportConfig({"domain": 73})).close()


def test_without_file_descriptors_it_is_not_opened_and_later_it_is() -> None:
    """In a process of its own, since everything in it needs them."""
    out, code = _run(
        "import resource",
        "DDSTransport(TransportConfig({'domain': 71})).close()  # Python, too, opens files at the first time",
        "resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))",
        "held = []",
        "try:",
        "    while True: held.append(os.open('/dev/null', 0))",
        "except OSError:",
        "    pass",
        "try:",
        "    DDSTransport(TransportConfig({'domain': 72}))",
        "except TransportError as exc:",
        "    print(exc)",
        "for each in held: os.close(each)",
        "DDSTransport(TransportConfig({'domain': 72})).close()",
    )
    assert code == 0
    assert "Too many open files" in out


def test_domains_do_not_hear_each_other(here: DDSTransport, name: str) -> None:
    other = DDSTransport(TransportConfig({"domain": 76}))
    outlet = here.outlet(topic(name))
    inbox, strange = _inbox(here, topic(name)), _inbox(other, topic(name))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, b"x"))
    wait_until(lambda: inbox == [b"x"])
    other.close()
    assert strange == []


def test_the_same_may_be_served_in_each_domain(name: str) -> None:
    first, second = (DDSTransport(TransportConfig({"domain": domain})) for domain in (7, 8))
    with contextlib.closing(first), contextlib.closing(second):
        for transport, answer in ((first, b"in 7"), (second, b"in 8")):
            transport.server(query(name), answering(transport, lambda _, answer=answer: answer))
        for transport, answer in ((first, b"in 7"), (second, b"in 8")):
            caller = transport.caller(query(name))
            assert caller.wait_peer(SOON)
            assert unblob(transport, caller.ask(blob(transport, b""), SOON).payload) == answer


def test_each_user_of_a_host_has_a_domain_and_the_first_one_that_of_the_tools() -> None:
    assert [domain_of_user(number) for number in (0, 33, 1000, 1001, 1002, 1231)] == [0, 0, 0, 1, 2, 0]


def test_users_of_one_host_do_not_meet_unless_they_name_a_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second one serves what the first one serves, in a run-time folder of another name."""
    with contextlib.closing(DDSTransport(TransportConfig())) as first:
        first.server(query("a/b/ask"), lambda payload, expires: Reply(Status.OK, payload))
        monkeypatch.setattr(core_module, "domain_of_user", lambda _: domain_of_user(FIRST_USER + 7))
        second = DDSTransport(TransportConfig())
        try:
            assert not second.caller(query("a/b/ask")).wait_peer(0.5)
        finally:
            second.close()
