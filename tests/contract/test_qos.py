"""Quality of service and its presets."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.qos import (
    DEFAULT_QOS,
    PRESETS,
    TIMES,
    WORDS,
    Durability,
    History,
    Liveliness,
    QoS,
    Reliability,
    from_traits,
    shortfalls,
    traits,
)
from robocomp_py.dsl.cdsl.qos import KNOWN

STRICT = QoS(
    Reliability.RELIABLE,
    Durability.TRANSIENT_LOCAL,
    deadline=0.5,
    liveliness=Liveliness.MANUAL_BY_TOPIC,
    lease=1.0,
)
_seconds = st.none() | st.floats(1e-6, 1e6)
_any_qos = st.builds(
    QoS,
    st.sampled_from(Reliability),
    st.sampled_from(Durability),
    deadline=_seconds,
    lifespan=_seconds,
    liveliness=st.sampled_from(Liveliness),
    lease=_seconds,
)


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


def test_a_publisher_that_offers_the_same_or_more_falls_short_of_nothing() -> None:
    assert shortfalls(STRICT, STRICT) == []
    assert shortfalls(QoS(), STRICT) == []
    assert shortfalls(STRICT, replace(STRICT, deadline=0.1, lease=0.9, history=History.KEEP_ALL)) == []


def test_each_policy_of_which_less_is_offered_is_named_with_both_ends() -> None:
    told = {each.policy: str(each) for each in shortfalls(STRICT, QoS(deadline=2.0))}
    assert told == {
        "reliability": "`reliable` is asked for, `best_effort` is offered",
        "durability": "`transient_local` is asked for, `volatile` is offered",
        "deadline": "`deadline 500 ms` is asked for, `deadline 2 s` is offered",
        "lease": "`lease 1 s` is asked for, none is offered",
        "liveliness": "`liveliness manual_by_topic` is asked for, `liveliness automatic` is offered",
    }


def test_lifespan_and_history_are_no_promises() -> None:
    assert shortfalls(QoS(lifespan=1.0, history=History.KEEP_ALL), QoS(depth=1)) == []


@given(_any_qos)
def test_the_traits_of_a_qos_are_complete_and_fit_into_names(qos: QoS) -> None:
    text = traits(qos)
    assert re.fullmatch(r"[a-z0-9-]+", text)
    again = from_traits(text)
    assert shortfalls(qos, again) == shortfalls(again, qos) == []
    assert again.lifespan == pytest.approx(qos.lifespan, abs=1e-9)
    assert again.history is qos.history
    assert again.depth == qos.depth or qos.history is History.KEEP_ALL


@given(st.text())
def test_unknown_traits_are_not_an_error(text: str) -> None:
    assert isinstance(from_traits(text), QoS)


def test_every_setting_is_a_word_of_cdsl_a_key_of_configurations_and_in_the_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "qos.md").read_text(encoding="utf-8")
    for name in (each.name for each in fields(QoS)):
        assert name in {*KNOWN, *WORDS}
        assert any(word in page for word in (name, *WORDS.get(name, ())))
        assert name in WORDS or name in TIMES or name == "depth"
    assert {str(word) for values in WORDS.values() for word in values} <= {*KNOWN, *Liveliness}


def test_every_time_travels_with_the_traits() -> None:
    for name in TIMES:
        assert from_traits(traits(QoS(**{name: 2.5}))) == QoS(**{name: 2.5})
