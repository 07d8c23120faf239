"""What goes along connections: rates, durations, failures and losses, from what both sides counted."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from robocomp_py.contract.qos import QoS
from robocomp_py.runtime.effective import toml
from robocomp_py.runtime.RoboCompIntrospection import Description, Measure, Measures
from robocomp_py.runtime.RoboCompIntrospection import End as ToldEnd
from robocomp_py.tools.drift import Drift, compare
from robocomp_py.tools.flows import Flow, Told, flows, merged, without_subscriber
from robocomp_py.tools.measure import load
from robocomp_py.tools.network import Network

from .facts import DIVIDE, EYE, HAND, HEARD, NEWS, THERE, WORLD, plan

DRIFT: Drift = compare(plan(DIVIDE, HEARD), Network((WORLD, HAND, NEWS, EYE, *THERE)))
CALL, NEWS_HEARD = DRIFT.uses


def counted(verb: str, channel: str, count: int, took: float = 0.004, **more: Any) -> Measure:
    latest = np.full(min(count, 256), took, np.float32)
    where = {"verb": verb, "channel": channel, "middleware": "near", "operation": "x"}
    return Measure(**where, count=count, timed=count, latest=latest, **more)


def told(name: str, *now: Measure, before: tuple[Measure, ...] = (), ends: tuple[ToldEnd, ...] = ()) -> Told:
    about = Description(instance=name, pid={"world": 1, "hand": 2, "eye": 3}[name], ends=list(ends))
    earlier = load(name, Measures(awake=10.0, operations=list(before)), None, about) if before else None
    first = Measures(awake=10.0, operations=list(before)) if before else None
    return Told(load(name, Measures(awake=20.0, operations=list(now)), first, about), earlier, about)


def flow_of(use: Any, *every: Told) -> Flow:
    return flows(DRIFT, {each.now.component: each for each in every})[use]


def test_of_a_call_the_client_tells_the_round_trip() -> None:
    hand = told("hand", counted("requires", "*/Everything/divide", 100, 0.004, failed=2))
    world = told("world", counted("implements", "world/Everything/divide", 300, 0.001))
    found = flow_of(CALL, hand, world)
    assert (found.rate, round(found.p50, 4), round(found.p99, 4), found.failed) == (5.0, 0.004, 0.004, 2)


def test_a_client_that_does_not_tell_is_measured_at_its_server() -> None:
    found = flow_of(CALL, told("world", counted("implements", "world/Everything/divide", 300, 0.001)))
    assert (found.rate, round(found.p50, 4)) == (15.0, 0.001)


def test_of_a_topic_the_publisher_tells_the_rate_and_the_subscriber_the_rest() -> None:
    world = told("world", counted("publishes", "world/Everything/news", 200, 0.0001))
    eye = told("eye", counted("subscribesTo", "*/Everything/news", 180, 0.003, lost=15, expired=5))
    found = flow_of(NEWS_HEARD, world, eye)
    assert (found.rate, round(found.p50, 4), found.lost) == (10.0, 0.003, 20)


def test_what_is_not_told_is_not_known() -> None:
    found = flow_of(CALL)
    assert math.isnan(found.rate)
    assert math.isnan(found.p50)
    assert not found.is_strained


def test_what_fails_or_loses_now_is_strained_and_what_did_once_is_not() -> None:
    was = counted("requires", "*/Everything/divide", 50, failed=2)
    worse = told("hand", counted("requires", "*/Everything/divide", 100, failed=3), before=(was,))
    same = told("hand", counted("requires", "*/Everything/divide", 100, failed=2), before=(was,))
    assert flow_of(CALL, worse).is_strained
    assert not flow_of(CALL, same).is_strained


def test_a_call_near_its_deadline_is_strained() -> None:
    end = ToldEnd(verb="requires", channel="*/Everything/divide", deadline=0.005)
    near = told("hand", counted("requires", "*/Everything/divide", 100, 0.0045), ends=(end,))
    far = told("hand", counted("requires", "*/Everything/divide", 100, 0.003), ends=(end,))
    assert flow_of(CALL, near).is_strained
    assert not flow_of(CALL, far).is_strained


def test_a_topic_that_comes_hardly_often_enough_is_strained() -> None:
    def at(deadline: float) -> Flow:
        end = ToldEnd(verb="subscribesTo", channel="*/Everything/news", qos=toml(QoS(deadline=deadline)))
        eye = told("eye", counted("subscribesTo", "*/Everything/news", 100), ends=(end,))  # 10 a second
        return flow_of(NEWS_HEARD, told("world", counted("publishes", "world/Everything/news", 200)), eye)

    assert at(0.11).is_strained
    assert not at(0.5).is_strained


def test_several_together_have_all_rates_and_the_longest_durations() -> None:
    found = merged([Flow(5.0, 0.1, 0.2, 1, 2), Flow(2.0, 0.3, 0.4, 10, 20, True), Flow()])
    assert found == Flow(7.0, 0.3, 0.4, 11, 22, True)
    assert math.isnan(merged([Flow()]).rate)


ALONE: Drift = compare(plan(), Network((NEWS, *THERE)))


def test_a_topic_without_a_subscriber_has_the_rate_of_its_publisher() -> None:
    (news,) = ALONE.unheard
    world = told("world", counted("publishes", "world/Everything/news", 200, 0.0001))
    found = flows(ALONE, {"world": world})[news]
    assert (found.rate, found.lost, found.is_strained) == (10.0, 0, False)
    assert math.isnan(found.p50)


def test_a_subscriber_within_the_process_of_the_publisher_is_one() -> None:
    hears = ToldEnd(verb="subscribesTo", channel="*/Everything/news")
    assert without_subscriber(ALONE, {"world": told("world", ends=(hears,))}).unheard == ()
    assert without_subscriber(ALONE, {"eye": told("eye", ends=(hears,))}) == ALONE
