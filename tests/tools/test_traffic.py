"""Rates, gaps, sizes and ages of messages, from arrivals that are known."""

from __future__ import annotations

import math

import pytest

from robocomp_py.tools.traffic import Arrival, Traffic

TOPIC = "world/LaserPub/push"


def heard(*arrivals: Arrival, window: int = 100) -> Traffic:
    traffic = Traffic(window)
    for each in arrivals:
        traffic.note(each)
    return traffic


def at(*times: float) -> list[Arrival]:
    return [Arrival(TOPIC, each, 8, 7, number) for number, each in enumerate(times, 1)]


def numbered(*sequences: int, source: int = 7) -> list[Arrival]:
    return [Arrival(TOPIC, float(each), 8, source, each) for each in sequences]


def test_rate_and_intervals() -> None:
    rate = heard(*at(10.0, 10.5, 11.0, 12.0)).rate()
    assert rate
    assert (rate.hz, rate.shortest, rate.longest) == (pytest.approx(1.5), 0.5, 1.0)


def test_one_message_has_no_rate_and_no_sizes() -> None:
    traffic = heard(*at(10.0))
    assert traffic.rate() is None
    assert traffic.sizes() is None


def test_only_the_last_messages_count() -> None:
    traffic = heard(*at(0.0, 5.0, 10.0, 10.5, 11.0, 11.5), window=3)
    rate = traffic.rate()
    assert rate
    assert rate.hz == pytest.approx(2.0)
    assert traffic.number == 6


def test_sizes_are_those_of_the_last_messages() -> None:
    sizes = [9_000, 100, 200, 600]
    traffic = heard(*(Arrival(TOPIC, number / 2, size) for number, size in enumerate(sizes)), window=3)
    assert traffic.sizes() == (600.0, 100, 300.0, 600)


def test_missing_messages_are_counted_by_their_numbers() -> None:
    traffic = heard(*numbered(5, 6, 9, 10, 12))
    assert (traffic.missing, traffic.gaps) == (3, 2)
    assert heard(*numbered(1, 2, 3)).gaps == 0


def test_a_publisher_that_was_restarted_leaves_no_gap() -> None:
    traffic = heard(*numbered(5, 6), *numbered(1, 2, source=8))
    assert traffic.gaps == 0


def test_a_repeated_message_is_no_gap() -> None:
    assert heard(*numbered(5, 6, 5, 7)).gaps == 0


def test_messages_without_numbers_do_not_tell_of_gaps() -> None:
    assert not heard(Arrival(TOPIC, 1.0, 8)).is_numbered
    assert heard(*numbered(1)).is_numbered


def test_ages() -> None:
    ages = [each / 1000 for each in range(1, 101)]
    traffic = heard(*(Arrival(TOPIC, each, 8, age=each) for each in ages))
    assert traffic.ages() == (pytest.approx(0.0505), 0.099)
    assert heard(Arrival(TOPIC, 1.0, 8)).ages() is None
    assert not math.isnan(heard(*at(1.0), Arrival(TOPIC, 2.0, 8, age=-0.5)).ages()[0])  # type: ignore[index]


def test_a_topic_is_silent_after_more_than_its_longest_intervals() -> None:
    traffic = heard(*at(0.0, 2.0))
    assert traffic.silence(7.9) == 0.0
    assert traffic.silence(8.1) == pytest.approx(6.1)
    assert heard(*at(0.0, 0.1)).silence(1.0) == 0.0
    assert heard(*at(0.0, 0.1)).silence(1.2) == pytest.approx(1.1)


def test_a_pause_of_the_listener_is_no_interval_no_gap_and_no_silence() -> None:
    traffic = heard(*numbered(1, 2, 3))
    traffic.resume(60.0)
    assert traffic.rate() is None
    assert traffic.silence(60.5) == 0.0
    assert traffic.silence(62.0) == 2.0
    for each in numbered(61, 62):
        traffic.note(each)
    rate = traffic.rate()
    assert rate
    assert (rate.longest, traffic.gaps, traffic.number) == (1.0, 0, 5)
