"""Losses and repetitions, counted exactly."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.transports.base import Statistics
from robocomp_py.transports.ledger import SENDERS, WINDOW, Ledger


@given(st.lists(st.integers(1, 5), min_size=1, max_size=200))
def test_of_an_ordered_stream_every_gap_is_counted(steps: list[int]) -> None:
    stats = Statistics()
    ledger = Ledger(stats, ordered=True)
    number = 0
    for step in steps:
        number += step
        assert ledger.admit(1, number)
    assert stats.lost == number - steps[0] + 1 - len(steps)
    assert stats.repeated == 0


@given(st.lists(st.tuples(st.integers(1, 3), st.integers(1, 50)), max_size=300))
def test_nothing_is_admitted_twice(messages: list[tuple[int, int]]) -> None:
    stats = Statistics()
    ledger = Ledger(stats, ordered=False)
    admitted = [message for message in messages if ledger.admit(*message)]
    assert len(admitted) == len(set(admitted)) == len(set(messages))
    assert stats.repeated == len(messages) - len(admitted)


def test_what_was_sent_before_we_listened_is_no_loss() -> None:
    stats = Statistics()
    assert Ledger(stats, ordered=True).admit(1, 1000)
    assert stats.lost == 0


def test_old_numbers_count_as_seen() -> None:
    ledger = Ledger(Statistics(), ordered=False)
    assert ledger.admit(1, 10_000)
    assert not ledger.admit(1, 5)
    assert ledger.admit(1, 9_999)


def test_a_repetition_is_recognized_of_the_newest_senders() -> None:
    ledger = Ledger(Statistics(), ordered=False)
    assert ledger.admit(0, 1)
    for sender in range(1, SENDERS):
        assert ledger.admit(sender, 1)
    assert not ledger.admit(0, 1)  # docs/guides/security.md
    assert SENDERS == 1024


def test_many_senders_take_bounded_memory() -> None:
    ledger = Ledger(Statistics(), ordered=False)
    for sender in range(SENDERS * 3):
        assert ledger.admit(sender, 1)
    assert len(ledger._seen) <= SENDERS


def test_what_was_held_up_is_new_however_many_others_passed() -> None:
    stats = Statistics()
    ledger = Ledger(stats, ordered=False)
    for number in (1, *range(3, 5000)):
        assert ledger.admit(1, number)
    assert ledger.admit(1, 2)
    assert not ledger.admit(1, 2)
    assert stats.repeated == 1


def test_what_may_have_been_seen_counts_as_seen() -> None:
    ledger = Ledger(Statistics(), ordered=False)
    for number in range(1, 2 * WINDOW + 5, 2):  # every other one is skipped, one more than can be remembered
        assert ledger.admit(1, number)
    assert not ledger.admit(1, 2)
    assert ledger.admit(1, 4)


def test_a_sender_that_skips_astronomically_costs_no_more_than_others() -> None:
    ledger = Ledger(Statistics(), ordered=False)
    assert ledger.admit(1, 1)
    assert ledger.admit(1, 2**63)
    assert ledger.admit(1, 2**63 - 1)
    assert not ledger.admit(1, 2)
