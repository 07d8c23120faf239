"""Which connections are closed for what they take is decided without a socket."""

from __future__ import annotations

import pytest

from robocomp_py.transports.zeromq.bounds import (
    HEARTBEATS,
    ON_PROBATION,
    STILL,
    SUBSCRIBED,
    SUBSCRIBED_IN_ALL,
    UNFINISHED,
    Connection,
    Descriptors,
    Kind,
    too_large,
    too_many,
)

KIB, MIB = 1024, 1024 * 1024
NOBODY: frozenset[str] = frozenset()


def connection(
    address: str = "10.0.0.1", kind: Kind = Kind.MESSAGES, since: float = 0.0, received: int = 0
) -> Connection:
    made = Connection(kind, address, 4000, since)
    made.received = received
    return made


def looked_at(received: int, times: int = STILL + 1, delivered: int = 0, address: str = "10.0.0.1") -> Connection:
    made = connection(address)
    made.delivered = delivered
    for number in range(times):
        made.look(received, 1.0 + number / 100)
    return made


def closed(*connections: Connection, on_probation: frozenset[str] = NOBODY) -> list[Connection]:
    return [each for each, _ in too_large(connections, on_probation)]


def test_a_message_that_never_ends_is_closed_at_the_bound() -> None:
    within, beyond = looked_at(UNFINISHED), looked_at(UNFINISHED + KIB)
    assert closed(within) == []
    assert closed(beyond) == [beyond]


def test_what_was_delivered_does_not_count() -> None:
    busy = looked_at(100 * UNFINISHED, delivered=100 * UNFINISHED - MIB)
    assert busy.unfinished <= MIB
    assert closed(busy) == []


def test_a_connection_that_delivers_between_two_looks_is_not_closed() -> None:
    busy = connection()
    for number in range(10):
        busy.delivered += MIB
        busy.look(2 * UNFINISHED, number / 100)
    assert closed(busy) == []


def test_all_unfinished_messages_together_have_the_same_bound_and_the_largest_goes() -> None:
    small, middle, large = (looked_at(size * MIB, address=f"10.0.0.{size}") for size in (60, 100, 150))
    assert closed(small, middle) == []
    assert closed(small, large, middle) == [large]


def test_a_peer_closed_for_its_size_is_on_probation() -> None:
    again, other = looked_at(2 * ON_PROBATION), looked_at(2 * ON_PROBATION, address="10.0.0.2")
    assert closed(again, other, on_probation=frozenset({"10.0.0.1"})) == [again]


def test_heartbeats_do_not_add_up() -> None:
    quiet = connection()
    for second in range(1, 3600 * 24 * 30, 3600):
        quiet.look(second * HEARTBEATS * 2 // 3, float(second))
    assert quiet.unfinished == 0


def test_what_is_not_counted_helps_no_message_that_comes_later() -> None:
    quiet = connection()
    quiet.look(1000, 3600.0 * 24)
    for number in range(3):
        quiet.look(UNFINISHED + 2 * KIB, 3600.0 * 24 + number / 100)
    assert closed(quiet) == [quiet]


def test_a_subscriber_says_little_and_all_subscribers_together_say_not_much() -> None:
    honest = connection(kind=Kind.SUBSCRIPTIONS, received=SUBSCRIBED)
    greedy = connection(kind=Kind.SUBSCRIPTIONS, received=SUBSCRIBED + 1)
    assert closed(honest, greedy) == [greedy]
    many = [
        connection(kind=Kind.SUBSCRIPTIONS, received=SUBSCRIBED) for _ in range(SUBSCRIBED_IN_ALL // SUBSCRIBED + 3)
    ]
    assert len(closed(*many)) == 3


FEW = Descriptors(1024)


def dismissed(*connections: Connection, highest: int = 0, now: Descriptors = FEW) -> list[Connection]:
    return [each for each, _ in too_many(connections, now, highest)]


def test_of_silent_connections_the_oldest_go_first() -> None:
    silent = [connection(since=float(number)) for number in range(FEW.silent + 5)]
    spoke = connection(since=-1.0, received=500)
    assert dismissed(spoke, *silent) == silent[:5]


def test_silent_connections_of_one_address_do_not_count_for_another() -> None:
    here = [connection(since=float(number)) for number in range(FEW.silent)]
    assert dismissed(*here, connection("10.0.0.2")) == []


def test_of_those_that_spoke_the_newest_go_first() -> None:
    spoke = [connection(since=float(number), received=500) for number in range(FEW.of_address + 2)]
    assert dismissed(*spoke) == [spoke[-1], spoke[-2]]


@pytest.mark.parametrize("limit", [256, 1024, 20_000, 1_000_000])
def test_a_process_keeps_descriptors_for_itself(limit: int) -> None:
    given = Descriptors(limit)
    assert given.for_others + given.reserve <= limit
    assert given.silent < given.of_address <= given.for_others


def test_of_all_connections_together_the_newest_go_first() -> None:
    many = [connection(f"10.0.0.{n}", since=float(n), received=500) for n in range(Descriptors(256).for_others + 3)]
    assert dismissed(*many, now=Descriptors(256)) == [many[-1], many[-2], many[-3]]


def test_a_reserve_is_kept_whatever_takes_the_others() -> None:
    spoke = [connection(f"10.0.0.{number}", since=float(number), received=500) for number in range(20)]
    assert dismissed(*spoke, highest=FEW.limit - FEW.reserve - 1) == []
    assert dismissed(*spoke, highest=FEW.limit - FEW.reserve + 1) == [spoke[-1], spoke[-2]]


def test_connections_that_we_made_are_not_too_many() -> None:
    ours = [Connection(Kind.MESSAGES, "10.0.0.1", n, 0.0, accepted=False) for n in range(FEW.limit)]
    assert dismissed(*ours) == []
