"""Quality of service and its presets."""

from __future__ import annotations

import pytest

from robocomp_py.contract.qos import DEFAULT_QOS, PRESETS, Durability, History, QoS, Reliability


def test_by_default_a_topic_keeps_the_newest_ten_and_promises_nothing() -> None:
    assert QoS() == DEFAULT_QOS
    assert (DEFAULT_QOS.reliable, DEFAULT_QOS.latched, DEFAULT_QOS.depth) == (False, False, 10)
    assert DEFAULT_QOS.history is History.KEEP_LAST
    assert (DEFAULT_QOS.deadline, DEFAULT_QOS.lifespan, DEFAULT_QOS.lease) == (None, None, None)


@pytest.mark.parametrize(
    ("preset", "reliable", "latched", "depth"),
    [
        ("default", False, False, 10),
        ("system_default", False, False, 10),
        ("sensor_data", False, False, 5),
        ("services_default", True, False, 10),
        ("parameters", True, False, 1000),
        ("latched", True, True, 1),
    ],
)
def test_presets_have_the_names_of_ros_2(preset: str, reliable: bool, latched: bool, depth: int) -> None:
    qos = PRESETS[preset]
    assert (qos.reliable, qos.latched, qos.depth) == (reliable, latched, depth)


def test_there_are_no_other_presets() -> None:
    assert len(PRESETS) == 6


def test_words_are_those_of_ros_2() -> None:
    assert [str(word) for word in (*Reliability, *Durability, *History)] == [
        *("reliable", "best_effort"),
        *("volatile", "transient_local"),
        *("keep_last", "keep_all"),
    ]
