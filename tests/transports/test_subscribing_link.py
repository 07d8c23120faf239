"""What every subscriber does that finds its publishers in the directory."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from robocomp_py.contract.qos import QoS, traits
from robocomp_py.testing.parts import topic
from robocomp_py.transports.base import TypeRef
from robocomp_py.transports.members import Entry, Found, Member
from robocomp_py.transports.topics import SubscribingLink
from robocomp_py.wire.header import Publication, pack_publication, read_publication

NAME = "i/Conformance/op"


def publication(source: int, age: float) -> Publication:
    stamp = time.time_ns() - int(age * 1e9)
    return read_publication(pack_publication(topic(NAME).type.fingerprint, source, 1, stamp))


def test_the_lifespan_of_a_publisher_counts_from_its_first_message_on() -> None:
    """The message may come before the subscriber has looked into the directory."""
    kind = topic(NAME).type
    entry = Entry("publishes", NAME, kind.fingerprint, kind.text, "", traits(QoS(lifespan=1.0)))
    published: list[Found] = []
    transport: Any = SimpleNamespace(find=lambda role, channel: list(published), is_own=lambda peer: False)
    heard: list[object] = []
    link: SubscribingLink[Any] = SubscribingLink(transport, topic(NAME), heard.append)
    assert link.look()
    published.append(Found(Member("1-a", "other", 1, (entry,)), entry))
    for age in (5.0, 0.0):
        job = link.take(NAME, publication(int(age) + 1, age), b"%d" % age)
        if job:
            job()
    assert heard == [b"0"]
    assert link.stats.expired == 1


@pytest.mark.parametrize("is_announced", [True, False])
def test_a_publisher_with_another_contract_is_reported_once(
    is_announced: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """With its contract, if it becomes visible only after its first messages."""
    other = topic(NAME).type
    published: list[Found] = []
    jobs: list[Callable[[], object]] = []
    transport: Any = SimpleNamespace(
        find=lambda role, channel: list(published), is_own=lambda peer: False, do=jobs.append
    )
    mine = replace(topic(NAME), type=TypeRef("Conformance::Blob", 2, "operation Conformance::Blob.send\n"))
    link: SubscribingLink[Any] = SubscribingLink(transport, mine, lambda payload: None)
    for _ in range(3):
        assert link.take(NAME, publication(1, 0.0), b"") is None
    if is_announced:
        entry = Entry("publishes", NAME, other.fingerprint, other.text, "", traits(QoS()))
        published.append(Found(Member("1-a", "other", 1, (entry,)), entry))
    with caplog.at_level(logging.ERROR):
        for job in jobs:
            job()
        link.look()
    (line,) = caplog.messages
    assert ("does not send its contract" not in line) is is_announced
    assert (link.stats.mismatched, link.stats.received) == (1, 0)
