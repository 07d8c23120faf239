"""The QoS of topics is that of DDS, for other programs to see and to match; what does not match is told."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterator
from typing import Any

import pytest
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.qos import History, Liveliness, QoS, Reliability
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import topic
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Source, TransportConfig
from robocomp_py.transports.dds.transport import DDSTransport
from robocomp_py.transports.dds.types import publication_type

from .domains import DOMAIN
from .test_transport import stranger

_STRICT = QoS(Reliability.RELIABLE, deadline=0.5, lifespan=2.0, liveliness=Liveliness.MANUAL_BY_TOPIC, lease=3.0)
_KIND = type_of(e.divide, Pattern.PUBLISH)
_OURS = Policy.DataRepresentation(use_cdrv0_representation=True)
_numbers = itertools.count()


@pytest.fixture
def here() -> Iterator[DDSTransport]:
    transport = DDSTransport(TransportConfig({"domain": DOMAIN}, "test"))
    yield transport
    transport.close()


@pytest.fixture
def name() -> str:
    return f"q{os.getpid()}_{next(_numbers)}/Dds/op"


def _told(participant: DomainParticipant, name: str, publishes: bool) -> Any:
    """What the library tells of the endpoint of a topic, once it does."""
    kind = BuiltinTopicDcpsPublication if publishes else BuiltinTopicDcpsSubscription
    reader = BuiltinDataReader(participant, kind)
    found: list[Any] = []

    def there() -> bool:
        found.extend(each for each in reader.take(1000) if each.topic_name == f"rc/{name}")
        return bool(found)

    wait_until(there)
    return found[0].qos


@pytest.mark.parametrize("publishes", [True, False])
def test_policies_are_those_of_dds_on_both_ends(here: DDSTransport, name: str, publishes: bool) -> None:
    if publishes:
        here.outlet(topic(name, _STRICT))
    else:
        here.inlet(topic(name, _STRICT), lambda _: None)
    with stranger() as participant:
        qos = _told(participant, name, publishes)
    assert qos[Policy.Deadline] == Policy.Deadline(500_000_000)
    assert qos[Policy.Liveliness] == Policy.Liveliness.ManualByTopic(3_000_000_000)
    assert qos[Policy.Durability] == Policy.Durability.Volatile
    assert isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable)
    if publishes:  # who reads has none, in DDS
        assert qos[Policy.Lifespan] == Policy.Lifespan(2_000_000_000)


def test_what_keeps_all_is_limited_for_dds_as_well(here: DDSTransport, name: str) -> None:
    here.outlet(topic(name, QoS(Reliability.RELIABLE, history=History.KEEP_ALL)))
    with stranger() as participant:
        qos = _told(participant, name, True)
    assert qos[Policy.History] == Policy.History.KeepAll
    assert qos[Policy.ResourceLimits].max_samples == 10_000


@pytest.mark.parametrize("publishes", [True, False])
@pytest.mark.parametrize(
    ("qos", "expected", "depth"),
    [
        (QoS(depth=3), (4, 2, 3), 3),
        (QoS(Reliability.RELIABLE, depth=3), (4, 2, 3), None),
        (QoS(Reliability.RELIABLE, history=History.KEEP_ALL), (4, 2, 3), None),
    ],
    ids=["best effort", "reliable", "keep all"],
)
def test_resource_limits_of_the_configuration_are_those_of_topics_on_both_ends(
    name: str, qos: QoS, expected: tuple[int, int, int], depth: int | None, publishes: bool
) -> None:
    options = {"domain": DOMAIN, "max_samples": 4, "max_instances": 2, "max_samples_per_instance": 3}
    with contextlib.closing(DDSTransport(TransportConfig(options, "test"))) as limited:
        if publishes:
            limited.outlet(topic(name, qos))
        else:
            limited.inlet(topic(name, qos), lambda _: None)
        with stranger() as participant:
            told = _told(participant, name, publishes)
    assert told[Policy.ResourceLimits] == Policy.ResourceLimits(*expected)
    assert told[Policy.History] == (Policy.History.KeepAll if depth is None else Policy.History.KeepLast(depth))


def test_nothing_reliable_is_lost_where_dds_keeps_one_sample(here: DDSTransport, name: str) -> None:
    channel = Channel(name, Pattern.PUBLISH, _KIND, QoS(Reliability.RELIABLE, history=History.KEEP_ALL))
    inbox: list[bytes] = []
    with contextlib.closing(DDSTransport(TransportConfig({"domain": DOMAIN, "max_samples": 1}, "test"))) as limited:
        link: Any = limited.inlet(channel, lambda payload: inbox.append(bytes(payload)))
        outlets = [here.outlet(channel), limited.outlet(channel)]
        encode = here.codec.encoder(e.divide.request)
        assert all(outlet.wait_peer(SOON) for outlet in outlets)
        wait_until(lambda: len(link.sources()) == 2)
        for number in range(20):
            for outlet in outlets:
                outlet.send(encode((number, 1)), SOON)
        wait_until(lambda: len(inbox) == 40)
        assert link.stats.dropped == link.stats.lost == 0


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"max_samples": 0}, "`max_samples` must be an integer from 1 to 2147483647, or -1 for no limit, not 0"),
        ({"max_samples": True}, "not True"),
        ({"max_instances": "3"}, "`max_instances` .* not '3'"),
        ({"max_instances": 2**31}, "`max_instances` .* not 2147483648"),
        ({"max_samples": 4, "max_samples_per_instance": 5}, "`max_samples_per_instance` is 5, which is more than .* 4"),
    ],
)
def test_resource_limits_that_make_no_sense_are_refused(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=complaint):
        DDSTransport(TransportConfig({"domain": DOMAIN, **options}))


@pytest.mark.parametrize("option", ["max_samples", "max_samples_per_instance"])
def test_a_topic_with_more_depth_than_the_resource_limits_is_refused_by_name(name: str, option: str) -> None:
    with contextlib.closing(DDSTransport(TransportConfig({"domain": DOMAIN, option: 9}))) as limited:
        complaint = f"{name}: its qos has depth 10, but transport option `{option}` of dds is 9"
        with pytest.raises(ConfigurationError, match=complaint):
            limited.inlet(Channel(f"*/{name}", Pattern.PUBLISH, _KIND), lambda _: None)
        with pytest.raises(ConfigurationError, match=complaint):
            limited.outlet(Channel(name, Pattern.PUBLISH, _KIND))
        limited.outlet(Channel(name, Pattern.PUBLISH, _KIND, QoS(depth=9)))


@pytest.mark.parametrize(
    ("asked", "missing"),
    [(QoS(), None), (QoS(deadline=1.0), "deadline"), (QoS(Reliability.RELIABLE), "reliability")],
    ids=["nothing", "deadline", "reliability"],
)
def test_a_foreign_best_effort_publisher_is_received_and_missing_qos_is_logged(
    here: DDSTransport, name: str, caplog: pytest.LogCaptureFixture, asked: QoS, missing: str | None
) -> None:
    inbox: list[Any] = []
    here.inlet(Channel(name, Pattern.PUBLISH, _KIND, asked), inbox.append)
    with stranger() as participant:
        kind: Any = publication_type(_KIND.name, _KIND.request)
        made = Topic(participant, f"rc/{name}", kind)
        writer = DataWriter(participant, made, Qos(Policy.Reliability.BestEffort, _OURS))
        numbers = itertools.count(1)

        def heard() -> bool:
            header = kind.__annotations__["header"](
                version=1, fingerprint=_KIND.fingerprint, source=5, sequence=next(numbers), stamp=0
            )
            writer.write(kind(header=header, dividend=7, divisor=3))
            return bool(inbox)

        wait_until(heard)
    told = [each.getMessage() for each in caplog.records if "offers less" in each.getMessage()]
    assert len(told) == (missing is not None)
    assert all(f"offers less {missing} than this subscription requests" in each for each in told)


def test_a_publisher_of_another_program_is_there_as_long_as_dds_says_so(here: DDSTransport, name: str) -> None:
    link: Any = here.inlet(Channel(name, Pattern.PUBLISH, _KIND, QoS(lease=1.0)), lambda _: None)
    assert link.sources() == []
    with stranger() as participant:
        made = Topic(participant, f"rc/{name}", publication_type(_KIND.name, _KIND.request))
        lives = Policy.Liveliness.Automatic(500_000_000)
        writer = DataWriter(participant, made, Qos(Policy.Reliability.Reliable(0), lives, _OURS))
        wait_until(lambda: link.sources() == [Source(name, QoS())])
        writer.__del__()
        wait_until(lambda: link.sources() == [])


def test_a_publisher_of_another_program_is_heard_by_a_subscriber_that_names_no_instance(here: DDSTransport) -> None:
    interface = f"I{os.getpid()}_{next(_numbers)}"
    inbox: list[Any] = []
    link: Any = here.inlet(Channel(f"*/{interface}/op", Pattern.PUBLISH, _KIND), inbox.append)
    with stranger() as participant:
        kind: Any = publication_type(_KIND.name, _KIND.request)
        writers = {
            name: DataWriter(
                participant, Topic(participant, f"rc/{name}", kind), Qos(Policy.Reliability.Reliable(0), _OURS)
            )
            for name in (f"raw/{interface}/op", f"raw/{interface}/other", f"ns/raw/{interface}/op")
        }
        assert link.wait_peer(SOON)
        numbers = itertools.count(1)

        def heard() -> bool:
            header = kind.__annotations__["header"](
                version=1, fingerprint=_KIND.fingerprint, source=5, sequence=next(numbers), stamp=0
            )
            writers[f"raw/{interface}/op"].write(kind(header=header, dividend=7, divisor=3))
            return bool(inbox)

        wait_until(heard)
        assert link.sources() == [Source(f"raw/{interface}/op", QoS())]
        assert [len(writer.get_matched_subscriptions()) for writer in writers.values()] == [1, 0, 0]
        writers[f"raw/{interface}/op"].__del__()
        wait_until(lambda: link.sources() == [])


def test_a_foreign_subscriber_that_asks_for_more_is_logged(
    here: DDSTransport, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    here.outlet(Channel(name, Pattern.PUBLISH, _KIND))
    with stranger() as participant:
        made = Topic(participant, f"rc/{name}", publication_type(_KIND.name, _KIND.request))
        reader = DataReader(participant, made, Qos(Policy.Deadline(1000), _OURS))
        wait_until(lambda: "asks for more deadline than is offered here" in caplog.text)
        assert reader.get_matched_publications() == []
