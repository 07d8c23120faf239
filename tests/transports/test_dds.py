"""DDS keeps the contract, shows itself to others, and gets along with them."""

from __future__ import annotations

import contextlib
import gc
import itertools
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
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
from robocomp_py.errors import Closed, ConfigurationError, Timeout, TransportError, Unreachable
from robocomp_py.runtime.ports import type_of
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
from robocomp_py.testing.patience import SOON, wait_until
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
from robocomp_py.transports.dds import DDSTransport
from robocomp_py.transports.dds_bus import compose, settings
from robocomp_py.transports.dds_types import (
    CODEC,
    Message,
    fill_reply,
    fill_request,
    publication_type,
    read_reply,
    reply_type,
    request_type,
)

_RELIABLE = QoS(Reliability.RELIABLE, depth=8)
_LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)
_numbers = itertools.count()


class TestDDS(TransportConformance):
    def open_transport(self) -> Transport:
        return DDSTransport(TransportConfig(owner="test"))


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
    transport = DDSTransport(TransportConfig(owner="tester"))
    try:
        yield transport
    finally:
        transport.close()


def _inbox(transport: DDSTransport, channel: Channel) -> list[bytes]:
    inbox: list[bytes] = []
    transport.inlet(channel, lambda payload: inbox.append(unblob(transport, payload)))
    return inbox


def test_it_is_installed() -> None:
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
    sample = Message(message).sample(payload)
    fill_request(payload, 1, 2.5, 3, 4, 5, 6)
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
    fill_reply(sample, Status.FAILED, 1, 2, 3, 4)
    read = reply_type(message.name, message).deserialize(bytes(sample))
    assert bytes(read.error) == why  # type: ignore[attr-defined]
    assert read_reply(bytes(sample)).status == Status.FAILED
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
def _stranger() -> Iterator[DomainParticipant]:
    """Somebody else on the domain, who uses the library as it is. There must be a transport of ours already."""
    participant = DomainParticipant(0)
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
    with _stranger() as participant:
        _, reader = _theirs(participant, f"rc/{name}", publication_type(kind.name, kind.request))
        assert outlet.wait_peer(SOON)
        outlet.send(CODEC.encoder(e.divide.request)((7, 3)))
        sample = _taken(reader)
    assert (sample.dividend, sample.divisor) == (7, 3)
    assert (sample.header.fingerprint, sample.header.sequence) == (e.divide.fingerprint, 1)
    assert abs(sample.header.stamp - time.time_ns()) < SOON * 1e9


def test_a_stranger_may_ask(here: DDSTransport, name: str) -> None:
    kind = type_of(e.divide, Pattern.QUERY)
    encode = CODEC.encoder(e.divide.response)
    server = here.server(Channel(name, Pattern.QUERY, kind), lambda payload, expires: Reply(Status.OK, encode((3, 1))))
    with _stranger() as participant:
        writer, _ = _theirs(participant, f"rc/{name}Request", request_type(kind.name, kind.request))
        assert kind.response
        _, reader = _theirs(participant, f"rc/{name}Reply", reply_type(kind.response.name, kind.response))
        wait_until(lambda: writer.get_matched_subscriptions() and len(reader.get_matched_publications()) > 1)
        header = _made(request_type(kind.name, kind.request), "header")(
            version=1, flags=0, remaining_ms=5000, fingerprint=kind.fingerprint, client=5, sequence=9, stamp=0
        )
        request = request_type(kind.name, kind.request)
        wait_until(lambda: server._others)
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


def test_what_is_no_message_of_ours_is_dropped_counted_and_logged_once(
    here: DDSTransport, there: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    kind = type_of(e.divide, Pattern.PUBLISH)
    heard: list[Any] = []
    link = here.inlet(Channel(name, Pattern.PUBLISH, kind), heard.append)
    with _stranger() as participant:
        made = publication_type(kind.name, kind.request)
        writer, _ = _theirs(participant, f"rc/{name}", made)
        wait_until(lambda: len(writer.get_matched_subscriptions()) > 1)
        header = made.__annotations__["header"](version=99, fingerprint=1, source=2, sequence=3, stamp=4)
        for _ in range(5):
            writer.write(made(header=header, dividend=1, divisor=1))
        wait_until(lambda: link.stats.malformed == 5)
    assert heard == []
    assert sum("malformed" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("command_line", [["ls"], ["typeof"]])
def test_the_librarys_tool_shows_topics_and_fields(here: DDSTransport, name: str, command_line: list[str]) -> None:
    here.outlet(Channel(name, Pattern.PUBLISH, type_of(e.echo_nested, Pattern.PUBLISH)))
    environment = os.environ | {"CYCLONEDDS_URI": compose(settings("lo"), "", 0), "COLUMNS": "200", "NO_COLOR": "1"}
    what = ["--topic", f".*{name}.*"] if command_line == ["ls"] else [f"rc/{name}"]
    tool = Path(sys.executable).with_name("cyclonedds")

    def shown() -> str:
        call = [tool, *command_line, "--suppress-progress-bar", "--runtime", "3s", *what]
        return subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout

    text = shown()
    expected = (
        [f"rc/{name}", "Conformance::EverythingEchoNestedRequest"]
        if command_line == ["ls"]
        else ["robocomp::PublicationHeader header", "Conformance::Nested value", "unsigned long long fingerprint"]
    )
    for each in expected:
        assert each in text


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


def test_asking_for_latched_messages_where_there_are_none_is_said(
    here: DDSTransport, there: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    here.outlet(topic(name))
    there.inlet(topic(name, _LATCHED), lambda _: None)
    wait_until(lambda: "does not keep messages for late subscribers" in caplog.text)


def test_a_second_server_is_told_who_serves(here: DDSTransport, there: DDSTransport, name: str) -> None:
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


def test_closing_the_transport_releases_who_waits_for_credit(
    here: DDSTransport, there: DDSTransport, name: str
) -> None:
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
        spawn = multiprocessing.get_context("spawn")
        self.ready, self.end = spawn.Event(), spawn.Event()
        self.process = spawn.Process(target=work, args=(self.ready, self.end, *arguments))
        self.process.start()
        assert self.ready.wait(SOON * 3)

    def __enter__(self) -> _Elsewhere:
        return self

    def __exit__(self, *exc: object) -> None:
        if self.process.is_alive():  # an event whose waiter was killed cannot be set
            self.end.set()
        self.process.join(SOON)
        self.process.kill()
        self.process.join()


def _echo_elsewhere(ready: Any, end: Any, name: str, abrupt: bool = False) -> None:
    transport = DDSTransport(TransportConfig(owner="elsewhere"))
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
def test_a_server_that_leaves_its_process_makes_calls_unreachable(there: DDSTransport, name: str, how: str) -> None:
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


# -- domains ------------------------------------------------------------------


def test_nothing_is_left_after_close(name: str) -> None:
    def held() -> tuple[int, int, list[str]]:
        gc.collect()
        folder = Path(os.environ["ROBOCOMP_RUNTIME_DIR"], "dds")
        files = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
        return len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")), files

    before, entities = held(), len(Entity._entities)
    for _ in range(3):
        _use_everything(name)
    wait_until(lambda: held() == before)
    assert len(Entity._entities) == entities


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


@pytest.mark.parametrize(
    ("uri", "complaint"),
    [("<General>", "not well-formed"), ("file:///nowhere.xml", "No such file"), ("<!-- ü -->", "ASCII")],
)
def test_settings_that_make_no_sense_are_named(uri: str, complaint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", uri)
    with pytest.raises(ConfigurationError, match=complaint):
        DDSTransport(TransportConfig({"domain": 78}))


@pytest.mark.parametrize("options", [{"domain": -1}, {"domain": "0"}, {"interface": 3}, {"port": 1}])
def test_options_that_make_no_sense_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        DDSTransport(TransportConfig(options))


def test_a_network_that_is_not_there_is_a_transport_error() -> None:
    with pytest.raises(TransportError, match="opening domain 79"):
        DDSTransport(TransportConfig({"domain": 79, "interface": "nowhere0"}))


def test_domains_do_not_hear_each_other(here: DDSTransport, name: str) -> None:
    other = DDSTransport(TransportConfig({"domain": 76}))
    outlet = here.outlet(topic(name))
    inbox, strange = _inbox(here, topic(name)), _inbox(other, topic(name))
    assert outlet.wait_peer(SOON)
    outlet.send(blob(here, b"x"))
    wait_until(lambda: inbox == [b"x"])
    other.close()
    assert strange == []
