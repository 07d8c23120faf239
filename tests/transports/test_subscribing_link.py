"""What every subscriber does that finds its publishers in the directory."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from robocomp_py.contract.qos import QoS, traits
from robocomp_py.testing.parts import topic
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
