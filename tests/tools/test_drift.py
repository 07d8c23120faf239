"""The difference between what a network declares and what runs, per component, topic and query."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from robocomp_py.tools.drift import Presence, compare
from robocomp_py.tools.network import End, Network

from .facts import DIVIDE, EYE, HAND, HEARD, NEWS, THERE, WORLD, end, plan, way


def presences(*ends, of=None, tellers=None):  # type: ignore[no-untyped-def]
    """The presence of each instance, and of each use."""
    drift = compare(of or plan(DIVIDE, HEARD), Network(ends), tellers)
    return (
        {each.name: each.presence for each in drift.instances},
        {(each.client, each.channel, each.provider): each.presence for each in drift.uses},
    )


CALLED, LISTENED = ("hand", "world/Everything/divide", "world"), ("eye", "world/Everything/news", "world")


def test_what_runs_as_it_is_declared_is_present() -> None:
    instances, uses = presences(WORLD, HAND, NEWS, EYE, *THERE)
    assert set(instances.values()) == {Presence.PRESENT}
    assert uses == {CALLED: Presence.PRESENT, LISTENED: Presence.PRESENT}


def test_a_use_is_a_topic_or_a_query() -> None:
    assert [each.is_topic for each in compare(plan(DIVIDE, HEARD), Network(())).uses] == [False, True]


def test_an_instance_that_does_not_run_is_missing_with_all_its_uses() -> None:
    instances, uses = presences(HAND, EYE, *THERE[1:])
    assert instances == {"world": Presence.MISSING, "hand": Presence.PRESENT, "eye": Presence.PRESENT}
    assert set(uses.values()) == {Presence.MISSING}


def test_a_client_that_is_not_connected_misses_only_that_use() -> None:
    instances, uses = presences(WORLD, HAND, NEWS, *THERE)
    assert set(instances.values()) == {Presence.PRESENT}
    assert uses == {CALLED: Presence.PRESENT, LISTENED: Presence.MISSING}


def test_a_use_is_missing_if_its_provider_does_not_offer_the_channel() -> None:
    assert presences(WORLD, HAND, EYE, *THERE)[1][LISTENED] is Presence.MISSING


def test_what_is_on_another_host_or_goes_over_a_middleware_that_does_not_tell_is_unseen() -> None:
    instances, uses = presences(WORLD, HAND, *THERE[:2], of=plan(DIVIDE, HEARD, hosts={"eye": "robot"}))
    assert instances["eye"] is Presence.UNSEEN
    assert uses == {CALLED: Presence.PRESENT, LISTENED: Presence.UNSEEN}
    within = way("hand", "world", "world/Everything/divide", middleware="within")
    assert presences(*THERE, of=plan(within), tellers={"": ["near"]})[1] == {CALLED: Presence.UNSEEN}


def test_what_is_on_a_host_that_is_looked_at_is_missed_there() -> None:
    both = {"": ["near"], "robot": ["near"]}
    of = plan(DIVIDE, HEARD, hosts={"eye": "robot"})
    instances, uses = presences(WORLD, HAND, NEWS, *THERE[:2], of=of, tellers=both)
    assert (instances["eye"], uses[LISTENED]) == (Presence.MISSING, Presence.MISSING)
    there = [replace(each, host="robot") for each in (EYE, THERE[2])]
    instances, uses = presences(WORLD, HAND, NEWS, *THERE[:2], *there, of=of, tellers=both)
    assert {*instances.values(), *uses.values()} == {Presence.PRESENT}
    instances, uses = presences(*there, of=of, tellers={"robot": ["near"]})
    assert instances == {"world": Presence.UNSEEN, "hand": Presence.UNSEEN, "eye": Presence.PRESENT}
    assert set(uses.values()) == {Presence.UNSEEN}


def test_of_a_program_that_announces_nothing_only_what_it_serves_is_compared() -> None:
    asks = way("world", "hand", "hand/Everything/divide")
    of = plan(DIVIDE, HEARD, asks)
    del of["ours"]["world"]
    served = {"instance": "world", "owner": "world", "channel": "world/Everything/divide"}
    of["programs"] = [{"middleware": "near", "options": {}, "serve": [served]}]
    instances, uses = presences(WORLD, HAND, EYE, *THERE[1:], of=of)
    assert set(instances.values()) == {Presence.PRESENT}
    unseen = {LISTENED: Presence.UNSEEN, ("world", "hand/Everything/divide", "hand"): Presence.UNSEEN}
    assert uses == unseen | {CALLED: Presence.PRESENT}
    assert presences(WORLD, *THERE[1:], of=of)[1] == unseen | {CALLED: Presence.MISSING}
    assert presences(HAND, *THERE[1:], of=of)[0]["world"] is Presence.UNSEEN


def test_processes_of_two_hosts_may_have_one_number() -> None:
    of = plan(DIVIDE, HEARD, hosts={"eye": "robot"})
    eye = [replace(each, host="robot", told=each.told._replace(pid=1)) for each in (EYE, THERE[2])]
    spy = replace(end("spy", "subscribes", "world/Everything/news", pid=1), host="base")
    instances, uses = presences(
        WORLD, HAND, NEWS, *THERE[:2], *eye, spy, of=of, tellers={"": ["near"], "robot": ["near"]}
    )
    assert uses[LISTENED] is Presence.PRESENT
    assert instances["spy (process 1 on base)"] is Presence.UNDECLARED


def test_a_client_that_is_not_declared_is_shown_with_its_process() -> None:
    spy = end("spy", "subscribes", "world/Everything/news", pid=8)
    instances, uses = presences(WORLD, HAND, NEWS, EYE, spy, *THERE)
    assert instances["spy (process 8)"] is Presence.UNDECLARED
    assert uses["spy (process 8)", "world/Everything/news", "world"] is Presence.UNDECLARED


def test_a_provider_that_is_not_declared_is_shown_if_an_instance_uses_it() -> None:
    double = end("double", "publishes", "double/Everything/news", pid=9)
    unrelated = end("lonely", "serves", "lonely/Everything/divide", pid=10)
    instances, uses = presences(WORLD, HAND, NEWS, EYE, double, unrelated, *THERE)
    assert instances["double (process 9)"] is Presence.UNDECLARED
    assert uses["eye", "double/Everything/news", "double (process 9)"] is Presence.UNDECLARED
    assert not any(name.startswith("lonely") for name in instances)


def test_a_use_between_declared_instances_may_be_undeclared() -> None:
    instances, uses = presences(WORLD, HAND, NEWS, EYE, *THERE, of=plan(DIVIDE))
    assert set(instances) == {"world", "hand", "eye"}
    assert uses[LISTENED] is Presence.UNDECLARED


def test_a_use_over_another_middleware_than_declared_is_missing_and_undeclared() -> None:
    drift = compare(
        plan(way("hand", "world", "world/Everything/divide", middleware="far"), HEARD),
        Network((WORLD, HAND, NEWS, EYE, *THERE)),
    )
    found = {(each.channel, each.middleware): each.presence for each in drift.uses}
    assert found == {
        ("world/Everything/divide", "far"): Presence.MISSING,
        ("world/Everything/divide", "near"): Presence.UNDECLARED,
        ("world/Everything/news", "near"): Presence.PRESENT,
    }


def test_a_program_without_contracts_is_unseen() -> None:
    of = plan() | {"processes": [{"instances": ["joystick"], "host": ""}], "ours": {}}
    assert presences(*THERE, of=of)[0] == {"joystick": Presence.UNSEEN}


@pytest.mark.parametrize("broken", [{}, {"name": 1}, plan() | {"ours": {"world": 3}}, plan({"client": "hand"})])
def test_a_plan_of_another_version_is_refused(broken: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="is of another version"):
        compare(broken, Network(()))


def unheard(*ends: End, of: Mapping[str, Any] | None = None) -> set[tuple[str, str, Presence]]:
    """The topics without a subscriber, as the publisher and the channel."""
    return {(each.provider, each.channel, each.presence) for each in compare(of or plan(), Network(ends)).unheard}


def test_a_topic_without_a_subscriber_belongs_to_its_publisher() -> None:
    assert unheard(NEWS, *THERE) == {("world", "world/Everything/news", Presence.PRESENT)}
    assert unheard(NEWS, EYE, *THERE) == set()


def test_a_topic_that_is_declared_to_have_a_subscriber_is_a_use() -> None:
    assert unheard(NEWS, *THERE, of=plan(HEARD)) == set()


def test_a_stranger_has_topics_without_subscribers_if_it_is_shown_at_all() -> None:
    topic = end("spy", "publishes", "spy/Everything/news", pid=8)
    assert unheard(topic, *THERE) == set()
    asking = end("spy", "calls", "world/Everything/divide", pid=8)
    shown = ("spy (process 8)", "spy/Everything/news", Presence.UNDECLARED)
    assert unheard(topic, asking, WORLD, *THERE) == {shown}


def test_an_action_without_a_client_publishes_nothing_that_should_be_heard() -> None:
    action = [end("world", role, f"world/Gripper/grip-{part}") for role, part in ACTION]
    assert unheard(*action, *THERE) == set()


ACTION = (("serves", "start"), ("serves", "result"), ("publishes", "status"), ("publishes", "feedback"))
